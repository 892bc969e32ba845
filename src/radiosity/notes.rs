//! What a user should know about a solution that is not all that was asked for.

use super::Options;
use super::clock::Clock;
use super::record::{Ended, Iteration, Settled, Unlit};

impl Ended {
    /// What a user should know, if refinement ended before the error asked for.
    pub(super) fn note(self, options: &Options, last: Option<&Iteration>, estimate: f64) -> Option<String> {
        let why = match self {
            Ended::Error | Ended::Target | Ended::Interrupted | Ended::Nothing => return None,
            Ended::Time => format!("--max-seconds {}", options.max_seconds.unwrap_or_default()),
            Ended::Links => format!("--max-links {}", options.max_links),
        };
        let bound = last.map_or(f64::INFINITY, |i| i.error_bound);
        let error = options.error;
        Some(format!(
            "{why} ended refinement before --error {error} was reached: links with errors below {bound:.1e} are as they were, \
             the estimated error is {estimate:.2e}"
        ))
    }
}

/// Part of the surfaces that may be dark without a word: insides of boxes are.
const DARK: f64 = 0.5;

impl Unlit {
    /// What a user should know, if more of the scene is dark than things in it hide.
    pub(super) fn note(&self) -> Option<String> {
        (self.area > DARK).then(|| {
            format!(
                "no light reaches {} of {} sides, {:.0} % of the surface: lamps shine on the front of their faces only, and not \
                 through closed doors",
                self.sides,
                self.of,
                100.0 * self.area
            )
        })
    }
}

/// What a user should know about a local pass that had time for fewer rays than were asked for; none: a few each.
pub(super) fn hurried(rays: Option<f64>, all: f64, clock: &Clock) -> Option<String> {
    let fewer = match rays {
        Some(rays) if rays >= all => return None,
        Some(rays) => format!("{rays:.1e}"),
        None => "the least".into(),
    };
    let why = if clock.interrupted() { "an interruption" } else { "--max-seconds" };
    Some(format!(
        "{why} left the local pass {fewer} of {all:.1e} rays: elements are noisier than --error says"
    ))
}

/// What a user should know about light that has not settled although there was time, and about leaves that were bounded.
pub(super) fn unsettled(settled: &Settled, bounded: usize, clock: &Clock) -> Vec<String> {
    let mut notes = Vec::new();
    if bounded > 0 {
        notes.push(format!(
            "the links of {bounded} elements bring more light than form factors can: cut down, so that light does not grow \
             without end (--rows balanced, --inside visible or a smaller --error avoid it)"
        ));
    }
    if !settled.converged && !clock.late() {
        notes.push(format!(
            "the light has not settled after {} sweeps: it still changes by {:.1e} of itself",
            settled.sweeps, settled.residual
        ));
    }
    notes
}
