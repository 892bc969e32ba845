//! Callers that stop, for tests.

use super::Progress;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

/// Progress that a computation has reported.
#[derive(Clone, Copy, Debug)]
pub struct ReportedProgress<'a> {
    /// The stage that has begun last, empty before the first.
    pub stage: &'a str,
    /// Stages that have begun.
    pub stages: usize,
    /// Steps of this stage that are done.
    pub stage_steps: u64,
    /// Steps of all stages that are done.
    pub steps: u64,
    /// Number of checks for cancellation, this one included.
    pub asked: u64,
}

/// A caller that stops permanently once a condition on the reported progress holds.
pub struct StopWhen<F> {
    begun: Mutex<Vec<String>>,
    stage_steps: AtomicU64,
    steps: AtomicU64,
    asked: AtomicU64,
    has_stopped: AtomicBool,
    is_over: F,
}

/// A caller who stops when `is_over`.
pub fn stop_when<F: Fn(ReportedProgress) -> bool + Send + Sync>(is_over: F) -> StopWhen<F> {
    let [stage_steps, steps, asked] = std::array::from_fn(|_| AtomicU64::new(0));
    let (begun, has_stopped) = Default::default();
    StopWhen { begun, stage_steps, steps, asked, has_stopped, is_over }
}

impl<F> StopWhen<F> {
    /// Names of the stages that have begun.
    pub fn begun(&self) -> Vec<String> {
        self.begun.lock().unwrap().clone()
    }

    /// Steps that are done.
    pub fn steps(&self) -> u64 {
        self.steps.load(Relaxed)
    }

    /// Number of checks for cancellation.
    pub fn asked(&self) -> u64 {
        self.asked.load(Relaxed)
    }
}

impl<F: Fn(ReportedProgress) -> bool + Send + Sync> Progress for StopWhen<F> {
    fn stage(&self, name: &str, _: u64) {
        self.begun.lock().unwrap().push(name.into());
        self.stage_steps.store(0, Relaxed);
    }

    fn advance(&self, steps: u64) {
        self.stage_steps.fetch_add(steps, Relaxed);
        self.steps.fetch_add(steps, Relaxed);
    }

    fn stopped(&self) -> bool {
        let asked = self.asked.fetch_add(1, Relaxed) + 1;
        let begun = self.begun.lock().unwrap();
        let told = ReportedProgress {
            stage: begun.last().map_or("", String::as_str),
            stages: begun.len(),
            stage_steps: self.stage_steps.load(Relaxed),
            steps: self.steps(),
            asked,
        };
        self.has_stopped.fetch_or((self.is_over)(told), Relaxed);
        self.has_stopped.load(Relaxed)
    }
}
