//! Progress of long computations, and cancellation.

#[cfg(any(test, feature = "reports"))]
use std::io::{Error, Result, Seek, SeekFrom, Write};
use std::time::Instant;

/// Receives the progress of a computation and can cancel it. `()` ignores progress and never cancels.
///
/// Methods are called from any thread, and never inside a timed section of a benchmark.
pub trait Progress: Sync {
    /// A stage of `steps` steps begins; 0 if the number is unknown.
    fn stage(&self, name: &str, steps: u64) {
        let _ = (name, steps);
    }
    /// `steps` more steps of the stage are done.
    fn advance(&self, steps: u64) {
        let _ = steps;
    }
    /// Whether the computation shall stop: a solver then returns the consistent solution reached so far, a preparation
    /// returns [`crate::Error::Cancelled`]. Polled every few milliseconds.
    fn stopped(&self) -> bool {
        false
    }
}

impl Progress for () {}

/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled) if the caller wants the computation to stop before `what` is complete.
pub fn go_on(progress: &dyn Progress, what: &str) -> crate::Result<()> {
    match progress.stopped() {
        true => Err(crate::Error::Cancelled(format!("stopped before {what} complete"))),
        false => Ok(()),
    }
}

/// The result of `make`; adds its time to `seconds`.
pub fn timed<R>(seconds: &mut f64, make: impl FnOnce() -> R) -> R {
    let start = Instant::now();
    let result = make();
    *seconds += start.elapsed().as_secs_f64();
    result
}

/// Bytes that are written between two looks at the caller: a millisecond.
#[cfg(any(test, feature = "reports"))]
const SLICE: usize = 1 << 20;

/// A writer that fails once `progress` has stopped.
#[cfg(any(test, feature = "reports"))]
pub struct Stoppable<'a, W> {
    /// Where the bytes go.
    pub out: W,
    /// The caller.
    pub progress: &'a dyn Progress,
}

#[cfg(any(test, feature = "reports"))]
impl<W: Write> Write for Stoppable<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        match self.progress.stopped() {
            true => Err(Error::other("interrupted")),
            false => self.out.write(&bytes[..bytes.len().min(SLICE)]),
        }
    }

    fn flush(&mut self) -> Result<()> {
        self.out.flush()
    }
}

#[cfg(any(test, feature = "reports"))]
impl<W: Seek> Seek for Stoppable<'_, W> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        self.out.seek(to)
    }
}
