//! Callers that stop, for tests.

use super::Progress;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// How often a computation has reported.
#[derive(Clone, Copy, Debug)]
pub struct Counts {
    /// Stages that have begun.
    pub stages: u64,
    /// Steps that are done.
    pub steps: u64,
    /// Questions whether to stop, this one included.
    pub asked: u64,
}

/// A caller who stops by what it was told.
pub struct StopWhen<F> {
    stages: AtomicU64,
    steps: AtomicU64,
    asked: AtomicU64,
    is_over: F,
}

/// A caller who stops when `is_over`.
pub fn stop_when<F: Fn(Counts) -> bool + Send + Sync>(is_over: F) -> StopWhen<F> {
    let [stages, steps, asked] = std::array::from_fn(|_| AtomicU64::new(0));
    StopWhen { stages, steps, asked, is_over }
}

impl<F> StopWhen<F> {
    /// What it was told so far.
    pub fn counts(&self) -> Counts {
        let [stages, steps, asked] = [&self.stages, &self.steps, &self.asked].map(|n| n.load(Relaxed));
        Counts { stages, steps, asked }
    }
}

impl<F: Fn(Counts) -> bool + Send + Sync> Progress for StopWhen<F> {
    fn stage(&self, _: &str, _: u64) {
        self.stages.fetch_add(1, Relaxed);
    }

    fn advance(&self, steps: u64) {
        self.steps.fetch_add(steps, Relaxed);
    }

    fn stopped(&self) -> bool {
        let asked = self.asked.fetch_add(1, Relaxed) + 1;
        (self.is_over)(Counts { asked, ..self.counts() })
    }
}
