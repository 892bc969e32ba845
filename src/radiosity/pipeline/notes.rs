//! Notes for the user about a solution that falls short of the options. Options are named by their field, between `⟨` and `⟩`.

use crate::error::number;
use crate::radiosity::audit::Ledger;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::options::Options;
use crate::radiosity::refinement::StopReason;
use crate::radiosity::rgb::Rgb;
use crate::radiosity::surroundings::Unlit;
use crate::radiosity::transport::Convergence;

/// Fraction of the emitted power that may appear or vanish without a note, however small the estimated error: a quarter of the error
/// that is asked for by default, as sampling has noise.
const MAX_IMBALANCE: f64 = 0.005;
/// Largest error of links that finds the light of a small lamp on a large surface. Floors of 3 m to 1,000 km below lamps of 2 cm to 1 m
/// lose none with 0.5; with 0.7, black floors from 30 km on lose all of it (`mrvis solve --local-rays 0 --error 0.7`). A lamp of 5 m
/// loses the 3 % of its light that a black floor of 1 m below it would get with 0.5.
const MAX_SAFE_LINK_ERROR: f64 = 0.5;
/// A note reports fewer rays below this fraction of the useful rays: above it, noise grows by 1/√0.9 − 1 = 5 % at most.
const MIN_RAY_FRACTION: f64 = 0.9;
/// Fraction of the surfaces that may be unlit without a note: the insides of closed boxes are about half of a scene.
const USUAL_UNLIT_AREA: f64 = 0.5;

/// A note if refinement ended before the requested error.
pub fn ended(ended: StopReason, options: &Options, estimate: Option<f64>) -> Option<String> {
    let why = match ended {
        StopReason::Error | StopReason::Target | StopReason::Interrupted | StopReason::Nothing => {
            return None;
        }
        StopReason::Time => limit(options),
        StopReason::Links => format!("⟨max_links⟩ {}", options.max_links),
    };
    let (error, estimate) = (options.error, in_words(estimate));
    Some(format!("{why} ended refinement with links not yet refined to ⟨error⟩ {error}; {estimate}"))
}

/// A note if the ledger does not balance: by a larger fraction than [`MAX_IMBALANCE`] and the smaller of estimated and requested error.
pub fn imbalance(
    ledger: &Ledger,
    estimate: Option<f64>,
    ended: StopReason,
    options: &Options,
) -> Option<String> {
    let part = ledger.created / ledger.emitted;
    let asked = options.target_error.unwrap_or(options.error);
    let allowed = estimate.unwrap_or(0.0).min(asked).max(MAX_IMBALANCE);
    // For points alone, leaves have a few rays each, whatever the error.
    let cure = match ended {
        _ if !options.elements => {
            "points have rays of their own; outputs of surfaces, such as meshes, balance it"
        }
        StopReason::Time => "more time (⟨max_seconds⟩) brings it down",
        StopReason::Links => "more links (⟨max_links⟩) bring it down",
        StopReason::Interrupted => "a run that is not interrupted brings it down",
        StopReason::Error | StopReason::Target | StopReason::Nothing => {
            "a smaller ⟨error⟩ or ⟨min_area⟩ brings it down"
        }
    };
    (part.abs() > allowed).then(|| {
        format!(
            "the energy does not balance: {:.2} % of the emitted power {}, more than the {:.2} % that the error allows; {cure}",
            100.0 * part.abs(),
            if part > 0.0 { "arrives without having been sent" } else { "is lost on its way" },
            100.0 * allowed
        )
    })
}

/// A note if the estimated error is larger than the target.
pub fn missed(options: &Options, ended: StopReason, estimate: Option<f64>) -> Option<String> {
    let target = options.target_error.filter(|target| estimate.is_none_or(|e| e > *target))?;
    let estimate = in_words(estimate);
    let cure = match ended {
        StopReason::Links => "more links (⟨max_links⟩) bring it down",
        StopReason::Time => "more time (⟨max_seconds⟩) brings it down",
        _ => "a smaller ⟨error⟩ or ⟨min_area⟩ brings it down",
    };
    Some(format!("⟨target_error⟩ {target} was missed: {estimate}; {cure}"))
}

fn in_words(estimate: Option<f64>) -> String {
    estimate.map_or_else(
        || "the error is unknown".into(),
        |e| format!("the estimated error is {} %", number(100.0 * e)),
    )
}

/// A note if light does not arrive although a target is set.
pub fn lost_with_target(options: &Options) -> Option<String> {
    options
        .target_error
        .map(|_| "⟨target_error⟩ counts as missed, because light is lost (see the note before); without it that is a note alone".into())
}

/// A note, with its cause, if no light of emitters arrives at surfaces but for rounding, as that of a narrow beam past all of them.
pub fn all_lost(ledger: &Ledger, cause: &str) -> Option<String> {
    (ledger.absorbed <= Ledger::ROUNDING * ledger.emitted)
        .then(|| format!("none of the light of the emitters arrives at surfaces: {cause}"))
}

/// A note if more of the scene is unlit than objects usually hide.
pub fn unlit(unlit: &Unlit) -> Option<String> {
    (unlit.area > USUAL_UNLIT_AREA).then(|| {
        format!(
            "{} of {} sides, {:.0} % of the surface, receive no light: if they should, look for emitters whose fronts turn away from \
             them, and for closed doors",
            unlit.sides,
            unlit.of,
            100.0 * unlit.area
        )
    })
}

/// All notes of a solution.
#[derive(Default)]
pub struct Notes {
    said: Vec<String>,
    fewer: Vec<FewerRays>,
}

/// Why and where there are fewer rays than planned.
pub struct FewerRays {
    why: &'static str,
    place: Place,
    /// Number of elements, 0 if the note is about all of them.
    elements: usize,
    what: String,
}

/// Stage in which rays are missing. Several steps of an attempt may report one stage.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    Reflected,
    Hurried,
    Untraced,
}

impl Extend<String> for Notes {
    fn extend<I: IntoIterator<Item = String>>(&mut self, notes: I) {
        self.said.extend(notes);
    }
}

impl Extend<FewerRays> for Notes {
    fn extend<I: IntoIterator<Item = FewerRays>>(&mut self, notes: I) {
        for note in notes {
            match self.fewer.iter_mut().find(|other| other.place == note.place) {
                Some(other) if other.elements > note.elements => {}
                // The first cause stays.
                Some(other) => *other = FewerRays { why: other.why, ..note },
                None => self.fewer.push(note),
            }
        }
    }
}

impl Notes {
    /// Clears the records of the previous attempt: the next one traces all rays again, and more.
    pub fn start_attempt(&mut self) {
        self.fewer.clear();
    }

    /// One note for all places with fewer rays, after the others so far.
    pub fn join(&mut self) {
        // The first cause explains the later ones.
        let Some(why) = self.fewer.first().map(|note| note.why) else { return };
        self.fewer.sort_by_key(|note| note.place);
        let places: Vec<String> = self.fewer.drain(..).map(|note| note.what).collect();
        self.said.push(format!("{why}: {}; elements are noisier than ⟨error⟩ says", places.join("; ")));
    }

    /// The notes in words.
    pub fn into_words(mut self) -> Vec<String> {
        self.join();
        self.said
    }
}

/// A note if the local pass had time for less than [`MIN_RAY_FRACTION`] of the useful rays; `part` is that fraction, and `None` means the
/// smallest number of rays.
pub fn fewer_local_rays(part: Option<f64>, all: f64, deadline: &Deadline) -> Option<FewerRays> {
    let rays = match part {
        Some(part) if part >= MIN_RAY_FRACTION => return None,
        Some(part) => format!("{} % of its {} rays", number(100.0 * part), number(all)),
        None => format!("the fewest rays there can be, not {}", number(all)),
    };
    let what = format!("reflected light is by {rays}");
    Some(FewerRays { why: why(deadline), place: Place::Reflected, elements: 0, what })
}

/// A note if some of the leaves have fewer rays than planned.
pub fn reduced_leaves(reduced: usize, all: usize, deadline: &Deadline) -> Option<FewerRays> {
    let what = || format!("{reduced} of {all} elements have fewer rays than planned");
    (reduced > 0).then(|| FewerRays {
        why: why(deadline),
        place: Place::Hurried,
        elements: reduced,
        what: what(),
    })
}

/// A note if there was no time for any rays of some of the leaves.
pub fn untraced(untraced: usize, all: usize, deadline: &Deadline) -> Option<FewerRays> {
    let what = || {
        format!(
            "{untraced} of {all} elements have no rays: their light is that along links, times the factor that rays have found at elements \
             around them, and their error bars are the deviations from it"
        )
    };
    (untraced > 0).then(|| FewerRays {
        why: why(deadline),
        place: Place::Untraced,
        elements: untraced,
        what: what(),
    })
}

/// The cause of the smaller number of rays.
fn why(deadline: &Deadline) -> &'static str {
    if deadline.interrupted() { "an interruption" } else { "⟨max_seconds⟩" }
}

/// A note if preparation used up the time.
pub fn late_preparation(options: &Options, deadline: &Deadline) -> Option<String> {
    let limit = options.max_seconds.filter(|_| deadline.late() && !deadline.interrupted())?;
    let taken = deadline.elapsed();
    Some(format!(
        "⟨max_seconds⟩ {limit}: reading and preparing the scene took {taken:.1} s; this is the coarsest light there is"
    ))
}

/// A note if the row factors of leaves were limited.
pub fn bounded(leaves: usize) -> Option<String> {
    (leaves > 0).then(|| {
        format!(
            "the links of {leaves} elements bring more light than form factors can: cut down, so that light does not grow \
             without end (⟨rows⟩ balanced, ⟨inside⟩ visible or a smaller ⟨error⟩ avoid it)"
        )
    })
}

/// A note if the light did not converge although there was time.
pub fn unconverged(convergence: &Convergence, deadline: &Deadline) -> Option<String> {
    (!convergence.converged && !deadline.late()).then(|| {
        format!(
            "the light has not converged after {} sweeps: it still changes by {:.1e} of itself",
            convergence.sweeps, convergence.residual
        )
    })
}

/// A note if no point receives light: an irradiance (W/m²) of up to `dark` counts as none.
pub fn dark_points(irradiance: &[Rgb], dark: f64) -> Option<String> {
    let is_dark = !irradiance.is_empty() && irradiance.iter().flatten().all(|&e| e <= dark);
    is_dark.then(|| {
        let (which, why) = match irradiance.len() {
            1 => ("the point".into(), "it lies behind surfaces, or its normal points away from the light"),
            count => (
                format!("any of the {count} points"),
                "they lie behind surfaces, or their normals point away from the light",
            ),
        };
        format!("no light arrives at {which}: {why}")
    })
}

/// The time limit as notes name it.
pub fn limit(options: &Options) -> String {
    format!("⟨max_seconds⟩ {}", options.max_seconds.unwrap_or_default())
}

/// Note if direct light and elements are both requested.
pub const DIRECT_AT_POINTS: &str = "elements have reflected light: ⟨direct_only⟩ leaves it out at points and in pictures whose pixels are gathered";

/// Note if the light of luminaires comes from links alone.
pub const DIFFUSE_LUMINAIRES: &str = "without a local pass (⟨local_rays⟩ 0, ⟨direct_only⟩) elements see luminaires as diffuse \
     emitters; direct light at points has their distribution";

/// A note if links alone are so coarse that they may miss the light of small lamps ([`MAX_SAFE_LINK_ERROR`]).
pub fn coarse_links(options: &Options) -> Option<String> {
    let error = options.error;
    (error > MAX_SAFE_LINK_ERROR).then(|| {
        format!(
            "links with an ⟨error⟩ of {error} may miss the light of lamps that are small compared with the surfaces below them, which then counts as \
             escaped: {MAX_SAFE_LINK_ERROR} or less finds it"
        )
    })
}

/// A note if the light of elements that walls cross comes from links alone.
pub fn walls_across_elements(count: usize) -> Option<String> {
    (count > 0).then(|| {
        format!(
            "{count} elements lie on both sides of a wall and have one irradiance for both, so that without a local pass (⟨local_rays⟩ 0) \
             light leaks through the wall; a smaller ⟨min_area⟩ reduces it"
        )
    })
}

/// Note if the scene has no emitters.
pub const NO_EMITTERS: &str =
    "nothing emits light: everything is black (⟨LoadOptions::emitters⟩ makes something emit)";

/// Note if the light of a scene overflows.
pub const NOT_FINITE: &str = "the light in this scene is beyond all numbers: give it in other units of length or power, so that \
     neither are far from 1";

#[cfg(test)]
mod tests {
    use super::*;

    /// The power that may appear or vanish is the smallest of what is stated and what was asked for, but no less than the noise of
    /// sampling.
    #[test]
    fn power_that_appears_or_vanishes_is_noted() {
        let ended_by = |ended: StopReason, created: f64, estimate, error, target_error| {
            let ledger = Ledger { emitted: 50.0, created: 50.0 * created, ..Ledger::default() };
            imbalance(&ledger, estimate, ended, &Options { error, target_error, ..Options::default() })
        };
        let noted = |created: f64, estimate: Option<f64>, error: f64, target_error: Option<f64>| {
            ended_by(StopReason::Error, created, estimate, error, target_error)
        };
        for (ended, cure) in [
            (StopReason::Error, "⟨min_area⟩"),
            (StopReason::Time, "⟨max_seconds⟩"),
            (StopReason::Links, "⟨max_links⟩"),
        ] {
            assert!(ended_by(ended, 0.2, None, 0.1, None).is_some_and(|note| note.contains(cure)));
        }
        let lost = noted(-0.12, Some(1.48), 0.1, None).expect("a note");
        assert!(lost.contains("12.00 % of the emitted power is lost") && lost.contains("10.00 %"), "{lost}");
        assert!(noted(-0.12, Some(1.48), 0.2, None).is_none());
        let made = noted(0.03, Some(0.02), 0.1, None).expect("a note");
        assert!(made.contains("3.00 % of the emitted power arrives") && made.contains("2.00 %"), "{made}");
        // A target counts instead of the error asked for, which is that of single links.
        assert!(noted(0.03, Some(0.04), 0.01, Some(0.05)).is_none());
        assert!(noted(0.06, Some(1.0), 0.5, Some(0.05)).is_some());
        // The noise of sampling, also where no error is known.
        for estimate in [None, Some(1e-4)] {
            assert!(
                noted(0.0049, estimate, 0.1, None).is_none() && noted(-0.0051, estimate, 0.1, None).is_some()
            );
        }
    }

    #[test]
    fn the_largest_count_and_the_first_cause_of_an_attempt_are_told() {
        let fewer = |why, place, elements: usize| {
            Some(FewerRays { why, place, elements, what: format!("{elements} elements") })
        };
        let mut notes = Notes::default();
        notes.extend(fewer("time", Place::Hurried, 90));
        notes.start_attempt();
        notes.extend(fewer("time", Place::Untraced, 7));
        notes.extend(fewer("time", Place::Hurried, 30));
        notes.extend(fewer("an interruption", Place::Hurried, 5));
        notes.extend(fewer("an interruption", Place::Reflected, 0));
        let want = "time: 0 elements; 30 elements; 7 elements; elements are noisier than ⟨error⟩ says";
        assert_eq!(notes.into_words(), [want]);
    }
}
