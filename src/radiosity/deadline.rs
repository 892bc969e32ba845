//! Deadlines of the stages of a solution: a stage ends on an interruption, or when its share of the time limit is used up.
//!
//! The shares of the time between stages are in this file; stages receive a [`Deadline`] and never compute one from the options.

use crate::progress::Progress;
use std::time::Instant;

// The shares below change results with a time limit only. Each divides the time between stages so that the later one is not cut
// short. With 0.3 or 0.7 instead of RAY_SHARE, or 0.2 instead of REFINEMENT_SHARE_BEFORE_LOCAL_PASS, the error of the elements of an
// office with 14 s is 8.5, 10.6 or 10.4 % instead of 9.2 %, that of a kitchen with 20 s 21.4, 13.3 or 13.3 % instead of 13.8 %
// (`scenes/room.py SCENE --elements 1500 --options='--max-seconds 14 --threads 1'`, with 20 for the kitchen).

/// Seconds by which the last stages may exceed the limit, however short it is: the options state the limit as approximate.
const GRACE_SECONDS: f64 = 0.5;
/// Fraction of the limit by which the last stages may exceed it, if that is more than [`GRACE_SECONDS`].
const GRACE_SHARE: f64 = 0.05;
/// Fraction of the time after preparation for the light of elements: a tenth is kept for the error of the estimated time.
const LIGHT_SHARE: f64 = 0.9;
/// [`LIGHT_SHARE`] if points follow: a quarter is kept for the final gather.
const LIGHT_SHARE_BEFORE_POINTS: f64 = 0.75;
/// Fraction of the time for light in which links are refined before a local pass: less than half, because the local pass finds the
/// light and links are only its first guess.
const REFINEMENT_SHARE_BEFORE_LOCAL_PASS: f64 = 0.4;
/// Fraction of the time for light in which links are refined without a local pass: the rest is for the second measurement of all links and
/// the last sweeps.
const REFINEMENT_SHARE: f64 = 0.6;
/// Fraction of the time of the local pass that its rays may take; the solver of its matrix has the other half.
pub const RAY_SHARE: f64 = 0.5;
/// Fraction of the time that is left after the local pass that the rays of its elements are planned for, by the speed of those before.
pub const GATHER_SHARE: f64 = 0.8;
/// Fraction of the time of a point query that its rays are planned for: the estimate comes from a sample of points, so
/// that a fifth is kept for its error.
pub const QUERY_SHARE: f64 = 0.8;

/// The time limit of a computation. Inner loops check it every few milliseconds.
#[derive(Clone, Copy)]
pub struct Deadline<'a> {
    progress: &'a dyn Progress,
    /// Clock; tests use one that counts calls.
    clock: fn() -> Instant,
    begun: Instant,
    /// Seconds that count as spent before `begun`.
    spent: f64,
    /// Seconds after the start; infinite without a limit.
    seconds: f64,
}

impl<'a> Deadline<'a> {
    /// A deadline this number of seconds from now; with `None` only an interruption ends the computation.
    pub fn start(progress: &'a dyn Progress, seconds: Option<f64>) -> Deadline<'a> {
        let clock = Instant::now;
        Deadline { progress, clock, begun: clock(), spent: 0.0, seconds: seconds.unwrap_or(f64::INFINITY) }
    }

    /// The same deadline by another clock, from now on.
    #[cfg(test)]
    pub fn with_clock(self, clock: fn() -> Instant) -> Deadline<'a> {
        Deadline { clock, begun: clock(), ..self }
    }

    /// The same deadline with these seconds already spent before its start.
    pub fn after(self, spent: f64) -> Deadline<'a> {
        Deadline { spent, ..self }
    }

    /// The same deadline with the interruptions of another caller.
    pub fn for_caller<'b>(&self, progress: &'b dyn Progress) -> Deadline<'b> {
        let Deadline { clock, begun, spent, seconds, .. } = *self;
        Deadline { progress, clock, begun, spent, seconds }
    }

    /// A deadline after this fraction of the time that is left now.
    pub fn part(self, part: f64) -> Deadline<'a> {
        let kept = if self.limited() { (1.0 - part) * self.unused().max(0.0) } else { 0.0 };
        Deadline { seconds: self.seconds - kept, ..self }
    }

    /// A slightly later deadline, for stages that are begun only if they are expected to end in time.
    pub fn with_grace(self) -> Deadline<'a> {
        Deadline { seconds: self.seconds + (GRACE_SHARE * self.seconds).max(GRACE_SECONDS), ..self }
    }

    /// Whether there is a time limit.
    pub fn limited(&self) -> bool {
        self.seconds.is_finite()
    }

    /// Seconds left; 0 after an interruption.
    pub fn left(&self) -> f64 {
        if self.interrupted() { 0.0 } else { self.unused().max(0.0) }
    }

    /// Whether the time is used up or the work is interrupted.
    pub fn late(&self) -> bool {
        self.left() <= 0.0
    }

    /// Whether the caller has interrupted the work.
    pub fn interrupted(&self) -> bool {
        self.progress.stopped()
    }

    /// Reports to the caller that a stage of `steps` steps begins.
    pub fn stage(&self, name: &str, steps: usize) {
        self.progress.stage(name, steps as u64);
    }

    /// Reports to the caller that `steps` more steps of the stage are done.
    pub fn advance(&self, steps: usize) {
        self.progress.advance(steps as u64);
    }

    /// Seconds since the start.
    pub fn elapsed(&self) -> f64 {
        self.spent + (self.clock)().duration_since(self.begun).as_secs_f64()
    }

    fn unused(&self) -> f64 {
        self.seconds - self.elapsed()
    }
}

/// The deadlines of the stages that follow preparation.
#[derive(Clone, Copy)]
pub struct DeadlinePlan<'a> {
    /// The light of all elements.
    pub light: Deadline<'a>,
    /// Refinement of links, which ends earlier.
    pub refinement: Deadline<'a>,
    /// Points and the audit, which may end a little late.
    pub closing: Deadline<'a>,
}

impl<'a> DeadlinePlan<'a> {
    /// Divides the time that is left of `whole`. `points`: irradiance at points follows; `local_pass`: so does a local pass.
    pub fn new(whole: Deadline<'a>, points: bool, local_pass: bool) -> DeadlinePlan<'a> {
        let light = whole.part(if points { LIGHT_SHARE_BEFORE_POINTS } else { LIGHT_SHARE });
        let share = if local_pass { REFINEMENT_SHARE_BEFORE_LOCAL_PASS } else { REFINEMENT_SHARE };
        DeadlinePlan { light, refinement: light.part(share), closing: whole.with_grace() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_end_before_the_whole() {
        let endless = Deadline::start(&(), None);
        assert!(
            !endless.late() && !endless.part(0.1).limited() && endless.with_grace().left() == f64::INFINITY
        );
        let whole = Deadline::start(&(), Some(100.0));
        let left = whole.part(0.25).left();
        assert!(left > 20.0 && left < 25.1 && whole.left() > 99.0 && whole.with_grace().left() > 104.0);
        let plan = DeadlinePlan::new(whole, true, true);
        assert!(plan.refinement.left() < plan.light.left() && plan.light.left() < whole.left());
        let over = Deadline::start(&(), Some(0.0));
        assert!(over.late() && over.part(0.5).late() && !over.interrupted());
    }
}
