//! How a run tells how far it has come.

/// Is told how far a run has come. `()` ignores it.
pub trait Progress: Sync {
    /// A stage of so many steps begins; 0 if nobody knows.
    fn stage(&self, name: &str, steps: u64);
    /// So many more steps are done. Never called inside a timed section.
    fn advance(&self, steps: u64);
}

impl Progress for () {
    fn stage(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
}
