//! How a long computation reports its stage and learns that it should stop.

/// Receives the stage of a computation and says whether the computation should stop.
pub trait Progress: Sync {
    /// A stage of the work begins.
    fn stage(&self, name: &str);
    /// Whether refinement should end now with the present solution.
    fn stopped(&self) -> bool;
}

impl Progress for () {
    fn stage(&self, _: &str) {}
    fn stopped(&self) -> bool {
        false
    }
}
