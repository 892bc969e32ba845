//! Progress of long computations, and cancellation.

#[cfg(test)]
pub mod testing;

use std::fmt;
use std::sync::Arc;
use std::time::Instant;

/// Receives the progress of a computation and can cancel it.
///
/// ```
/// use mrvis::{Error, Model, PrepareOptions, Progress, Scene};
/// use std::sync::Arc;
/// use std::sync::atomic::{AtomicBool, Ordering};
///
/// #[derive(Default)]
/// struct Button(AtomicBool);
///
/// impl Progress for Button {
///     fn stage(&self, name: &str, _steps: u64) {
///         eprintln!("{name}");
///     }
///
///     fn stopped(&self) -> bool {
///         self.0.load(Ordering::Relaxed)
///     }
/// }
///
/// let model = Model::prepare(Scene::generate("cornell")?, &PrepareOptions::default())?;
/// let button = Arc::new(Button::default());
/// button.0.store(true, Ordering::Relaxed); // at any time, from any thread
/// let stopped = model.with_progress(button.clone()).form_factors(&Default::default());
/// assert!(matches!(stopped, Err(Error::Cancelled(_))));
/// # Ok::<(), mrvis::Error>(())
/// ```
///
/// It is given by [`PrepareOptions::with_progress`](crate::PrepareOptions::with_progress),
/// [`Model::with_progress`](crate::Model::with_progress) or [`Solution::with_progress`](crate::Solution::with_progress). Who wants to keep
/// it gives an `Arc`. Its methods are called from any thread, and never inside a timed section of a benchmark.
pub trait Progress: Send + Sync {
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

/// Ignores progress and never cancels.
impl Progress for () {}

/// Shared progress.
impl<P: Progress + ?Sized> Progress for Arc<P> {
    fn stage(&self, name: &str, steps: u64) {
        (**self).stage(name, steps);
    }

    fn advance(&self, steps: u64) {
        (**self).advance(steps);
    }

    fn stopped(&self) -> bool {
        (**self).stopped()
    }
}

/// The progress that a caller gave to a handle, if any.
#[derive(Clone, Default)]
pub struct Watcher(Option<Arc<dyn Progress>>);

impl Watcher {
    /// The progress of a caller.
    pub fn new(progress: impl Progress + 'static) -> Watcher {
        Watcher(Some(Arc::new(progress)))
    }

    /// The progress that computations report to.
    pub fn progress(&self) -> &dyn Progress {
        self.0.as_deref().unwrap_or(&())
    }
}

impl fmt::Debug for Watcher {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(if self.0.is_some() { "Watcher" } else { "none" })
    }
}

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
