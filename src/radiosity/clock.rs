//! When to stop: because somebody asks for it, or because the time that was given is up.

use crate::progress::Progress;
use std::time::Instant;

/// Seconds that last things may take after the time is up, at least, and as part of the time.
const GRACE: f64 = 0.5;
const GRACE_PART: f64 = 0.05;

/// The time there is for a piece of work; asked every few milliseconds of it.
#[derive(Clone, Copy)]
pub struct Clock<'a> {
    progress: &'a dyn Progress,
    begun: Instant,
    /// Seconds that count as spent before.
    spent: f64,
    /// Seconds from then on; infinite if nobody has set a limit.
    seconds: f64,
}

impl<'a> Clock<'a> {
    /// Starts now. Without a limit only interruption ends it.
    pub fn start(progress: &'a dyn Progress, seconds: Option<f64>) -> Clock<'a> {
        Clock { progress, begun: Instant::now(), spent: 0.0, seconds: seconds.unwrap_or(f64::INFINITY) }
    }

    /// Starts now, with so many seconds spent before.
    pub fn start_after(spent: f64, progress: &'a dyn Progress, seconds: Option<f64>) -> Clock<'a> {
        Clock { spent, ..Clock::start(progress, seconds) }
    }

    /// Part of the time that is left.
    pub fn part(self, part: f64) -> Clock<'a> {
        let kept = if self.limited() { (1.0 - part) * self.unused().max(0.0) } else { 0.0 };
        Clock { seconds: self.seconds - kept, ..self }
    }

    /// A little longer: for what is not begun unless it is likely to end in time.
    pub fn with_grace(self) -> Clock<'a> {
        Clock { seconds: self.seconds + (GRACE_PART * self.seconds).max(GRACE), ..self }
    }

    /// Whether there is a limit.
    pub fn limited(&self) -> bool {
        self.seconds.is_finite()
    }

    /// Seconds left; none when interrupted.
    pub fn left(&self) -> f64 {
        if self.interrupted() { 0.0 } else { self.unused().max(0.0) }
    }

    /// Whether it is time to stop.
    pub fn late(&self) -> bool {
        self.left() <= 0.0
    }

    /// Whether that was asked for from outside.
    pub fn interrupted(&self) -> bool {
        self.progress.stopped()
    }

    /// Seconds since the start.
    pub fn elapsed(&self) -> f64 {
        self.spent + self.begun.elapsed().as_secs_f64()
    }

    fn unused(&self) -> f64 {
        self.seconds - self.elapsed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_end_before_the_whole() {
        let endless = Clock::start(&(), None);
        assert!(
            !endless.late() && !endless.part(0.1).limited() && endless.with_grace().left() == f64::INFINITY
        );
        let clock = Clock::start(&(), Some(100.0));
        let left = clock.part(0.25).left();
        assert!(left > 20.0 && left < 25.1 && clock.left() > 99.0 && clock.with_grace().left() > 104.0);
        let over = Clock::start(&(), Some(0.0));
        assert!(over.late() && over.part(0.5).late() && !over.interrupted());
    }
}
