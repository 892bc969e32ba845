//! Progress bar.

use crate::progress::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
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
        let known = "{msg:24} {wide_bar} {percent:>3} %, {eta} left";
        let template = if steps > 0 { known } else { "{spinner} {msg} {elapsed}" };
        self.bar.set_style(
            ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()),
        );
        self.bar.set_message(name.to_string());
        self.bar.set_length(steps.max(1));
        self.bar.reset();
        self.show();
        self.bar.tick();
    }

    fn advance(&self, steps: u64) {
        self.show();
        self.bar.inc(steps);
    }
}
