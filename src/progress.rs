//! Progress of long computations, and cancellation.

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
