//! Progress bar.

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use mrvis::Progress;
use std::fmt::Write;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Progress bar; appears on a terminal after one second.
pub struct Bar {
    bar: ProgressBar,
    started: Instant,
    quiet: bool,
    /// Whether the bar is visible.
    shown: Mutex<bool>,
}

impl Bar {
    /// A bar that is not visible yet.
    pub fn new(quiet: bool) -> Bar {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        Bar { bar, started: Instant::now(), quiet, shown: Mutex::new(false) }
    }

    fn show(&self) {
        let mut shown = self.shown.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if !*shown && !self.quiet && self.started.elapsed() > Duration::from_secs(1) {
            *shown = true;
            self.bar.set_draw_target(ProgressDrawTarget::stderr_with_hz(5));
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.finish();
    }
}

impl Progress for Bar {
    fn stage(&self, name: &str, steps: u64) {
        let known = "{msg:24} {wide_bar} {percent:>3} %{left}";
        let template = if steps > 0 { known } else { "{spinner} {msg} {elapsed}" };
        let left = |state: &ProgressState, out: &mut dyn Write| {
            let part = state.pos() as f64 / state.len().unwrap_or(0).max(1) as f64;
            if let Some(left) = time_left(state.elapsed(), part) {
                let _ = write!(out, ", {} left", HumanDuration(left));
            }
        };
        // A stage starts at 0 with a time of its own.
        self.bar.reset();
        self.bar.set_style(
            ProgressStyle::with_template(template)
                .unwrap_or_else(|_| ProgressStyle::default_bar())
                .with_key("left", left),
        );
        self.bar.set_message(name.to_string());
        self.bar.set_length(steps.max(1));
        self.show();
        self.bar.tick();
    }

    fn advance(&self, steps: u64) {
        self.show();
        self.bar.inc(steps);
    }
}

/// Fraction of a stage from which its remaining time is estimated: before it, the first few steps decide.
const MIN_KNOWN_FRACTION: f64 = 0.02;

/// The time that the rest of a stage takes at its mean speed so far; none before the speed is known.
pub fn time_left(elapsed: Duration, part: f64) -> Option<Duration> {
    (part >= MIN_KNOWN_FRACTION).then(|| elapsed.mul_f64((1.0 - part).max(0.0) / part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_that_of_the_rest() {
        let seconds = Duration::from_secs;
        assert_eq!(time_left(seconds(1), 0.01), None);
        assert_eq!(time_left(seconds(10), 0.25), Some(seconds(30)));
        assert_eq!(time_left(seconds(10), 1.0), Some(seconds(0)));
    }

    /// A stage does not inherit the steps and the time of the one before it.
    #[test]
    fn each_stage_has_its_own_time() {
        let bar = Bar::new(true);
        bar.stage("slow", 100);
        bar.advance(1);
        std::thread::sleep(Duration::from_millis(300));
        bar.stage("fast", 1000);
        assert!(bar.bar.position() == 0 && bar.bar.elapsed() < Duration::from_millis(300));
    }
}
