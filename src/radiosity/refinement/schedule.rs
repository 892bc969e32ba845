//! The steps of refinement, until the requested error is reached, or time or memory is used up.

use super::importance::propagate_importance;
use super::link_measurement::remeasure_links;
use super::linked_scene::LinkedScene;
use super::refine::{StepResult, link_errors, refine, threshold};
use super::sky_links::{remeasure_sky_links, sky_link_errors};
use crate::progress::Progress;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::options::Options;
use crate::radiosity::surroundings::SkyPower;
use crate::radiosity::transport::{Convergence, cap_row_sums, link_row_sums};
use serde::Serialize;
use std::time::Instant;

/// Error to which links are refined, relative to the requested error: the errors of the links of an element add up. Without a local pass
/// 0.005, 0.01 and 0.02 leave errors of 1.15 %, 1.29 % and 1.32 % in 0.45 s, 0.26 s and 0.20 s (`constants.py solve`).
const LINK_ERROR_SHARE: f64 = 0.01;
/// Factor by which the error of links may be larger before a local pass, for which links are only the first guess. 2 or
/// 8 instead change irradiance by less than 0.01 % (`constants.py solve`).
const COARSE_BEFORE_LOCAL_PASS: f64 = 4.0;
/// The error threshold of each step divided by that of the next. 2 or 8 instead change irradiance without a local pass
/// by at most 0.1 % (`constants.py solve`).
const THRESHOLD_RATIO: f64 = 4.0;
/// Smallest number of divisions of the threshold: the first threshold is at least 4⁴ = 256 times the last one.
const MIN_STEPS: i32 = 4;
/// Smallest threshold of the first step, relative to the mean irradiance. 0.025 or 0.1 instead change irradiance by
/// less than 0.01 % (`constants.py solve`).
const FIRST_THRESHOLD: f64 = 0.05;
/// Smallest fraction of a step of limited time in which links are refined: above 0, so that every step makes progress. This and the
/// next two change results with a time limit only.
const MIN_REFINING_SHARE: f64 = 0.05;
/// Links of the first step of limited time: one slice of [`super::refine`], so that a slow machine does not miss the first step.
const FIRST_STEP_LINKS: f64 = 64.0;
/// Bounds of the factor by which the links of a step grow: at most doubled, so that a wrong estimate of the time costs
/// one step.
const STEP_GROWTH: [f64; 2] = [0.25, 2.0];
/// Relative change of the light at which sweeps between steps end. 0.001 or 0.01 instead change irradiance by less than
/// 0.02 % (`constants.py solve`).
const STEP_TOLERANCE: f64 = 3e-3;
/// Largest number of sweeps between steps: the change is below [`STEP_TOLERANCE`] after 12 at reflectances up to 0.6
/// (0.6¹² = 0.002).
const MAX_STEP_SWEEPS: usize = 12;
/// Sweeps that row normalisation and the last light are expected to need, which changes results with a time limit only: at reflectance
/// 0.42, light changes by [`FINAL_TOLERANCE`] in the 16th (0.42¹⁶ = 9e-7). `mrvis solve --local-rays 0` makes 6 sweeps in the orchard, 15
/// in sponza, 11 and 18 in a generated desk-room and office; where it makes more, as in the assembled office, 147, the deadline ends them.
const CLOSING_SWEEPS: f64 = 16.0;
/// Relative change of the light at which the last sweeps end: below the precision that the energy balance is printed
/// with. 1e-5 instead changes irradiance by less than 0.001 % (`constants.py solve`).
const FINAL_TOLERANCE: f64 = 1e-6;
/// Largest number of the last sweeps: the change is below [`FINAL_TOLERANCE`] after 400 at reflectances up to 0.966
/// (0.966⁴⁰⁰ = 1e-6).
const MAX_FINAL_SWEEPS: usize = 400;

/// One step of refinement with the sweeps after it.
#[derive(Clone, Debug, Serialize)]
pub struct Iteration {
    /// Seconds that the step took.
    pub seconds: f64,
    /// Links after the step.
    pub links: usize,
    /// Elements after the step.
    pub elements: usize,
    /// Links that were replaced.
    pub refined: usize,
    /// Largest error of a link that could still be refined, relative to the mean irradiance.
    pub error_bound: f64,
    /// Relative change of the radiosity in the last sweep.
    pub residual: f64,
}

/// Why refinement ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// No link that could be refined exceeds the requested error.
    Error,
    /// The estimated error was no larger than the target.
    Target,
    /// The time was used up.
    Time,
    /// The limit of links was reached.
    Links,
    /// The caller interrupted refinement.
    Interrupted,
    /// There was nothing to refine: the scene has no light, or only direct light at points was requested.
    Nothing,
}

/// A scene before refinement: its only link joins the root with itself.
pub struct Unrefined(pub LinkedScene);

/// A scene with refined links and consistent light.
pub struct Refined {
    /// Elements, links and light.
    pub linked: LinkedScene,
    /// The steps.
    pub iterations: Vec<Iteration>,
    /// Reason why refinement ended.
    pub ended: StopReason,
    /// The last sweeps.
    pub convergence: Convergence,
    /// Tolerated error of links relative to the mean irradiance.
    link_error: f32,
    /// Whether a local pass follows, for which links are only the first guess.
    is_coarse: bool,
    /// Seconds that the last sweeps need, for each link and element.
    closing_cost: f64,
}

/// Row sums of every element along its links, and the convergence of the last light along the links.
pub struct LinkClosing {
    /// Row sums before normalisation.
    pub sampled: Vec<f64>,
    /// Row sums used, before multiplication by each element's own gather factor.
    pub used: Vec<f64>,
    /// Leaves whose light would have grown without end and was bounded.
    pub bounded: usize,
    /// Size of the active nodes in memory, bytes.
    pub bytes: usize,
    /// The last sweeps.
    pub convergence: Convergence,
    /// Power of sky and suns that arrives at elements.
    pub arrived: SkyPower,
}

impl Unrefined {
    /// Whether a local pass follows refinement: in scenes that have light.
    pub fn needs_local_pass(&self, options: &Options) -> bool {
        let Unrefined(linked) = self;
        options.local_rays() > 0 && !options.direct_only && linked.mean_irradiance > 0.0
    }

    /// Ends without refinement.
    pub fn unrefined(self, options: &Options) -> Refined {
        let link_error = self.tolerated_link_error(options);
        let is_coarse = self.needs_local_pass(options);
        Refined {
            linked: self.0,
            iterations: Vec::new(),
            ended: StopReason::Nothing,
            convergence: Convergence::default(),
            link_error,
            is_coarse,
            closing_cost: 0.0,
        }
    }

    /// Refines in steps until the requested error or the deadline is reached. `estimate` gives the error estimate that is
    /// compared with [`Options::target_error`].
    pub fn refine(
        self,
        options: &Options,
        estimate: &dyn Fn(&LinkedScene) -> f64,
        progress: &dyn Progress,
        deadline: &Deadline,
    ) -> Refined {
        let mut refined = self.unrefined(options);
        if refined.linked.mean_irradiance <= 0.0 {
            return refined;
        }
        let few = refined.is_coarse && !deadline.limited();
        // Under a sky most light comes from the sky, not from other elements, and rays replace all of this light.
        let is_guess = few
            && refined.linked.environment.is_some()
            && options.step_seconds.is_none()
            && options.target_error.is_none()
            && refined.linked.feature_sizes.important.is_empty();
        if is_guess {
            refined.link_error = refined.link_error.max(FIRST_THRESHOLD as f32);
        }
        let mut steps = Steps::new(refined.link_error, few, options.step_seconds);
        loop {
            let (replaced, threshold) = refined.step(&mut steps, progress, deadline);
            let last = refined.iterations.last().expect("a step has been made");
            let size = last.links + last.elements;
            let is_done = match steps.seconds {
                Some(_) => replaced.links == 0,
                None => f64::from(threshold) <= f64::from(refined.link_error),
            };
            let reached = || options.target_error.is_some_and(|t| estimate(&refined.linked) <= t);
            refined.ended = if deadline.interrupted() {
                StopReason::Interrupted
            } else if deadline.left() <= refined.closing_cost * size as f64 {
                StopReason::Time
            } else if replaced.full {
                StopReason::Links
            } else if reached() {
                StopReason::Target
            } else if is_done {
                StopReason::Error
            } else {
                continue;
            };
            return refined;
        }
    }

    /// The error that links are refined to, relative to the mean irradiance.
    fn tolerated_link_error(&self, options: &Options) -> f32 {
        let coarse = if self.needs_local_pass(options) { COARSE_BEFORE_LOCAL_PASS } else { 1.0 };
        (options.error * LINK_ERROR_SHARE * coarse) as f32
    }
}

/// Estimates that one refinement step passes to the next.
struct Steps {
    /// Seconds of a step, if they are limited.
    seconds: Option<f64>,
    /// Threshold of the next step if time is not limited, and its divisor for the step after that.
    next: f64,
    ratio: f64,
    /// Links of the next step of limited time.
    links: f64,
    /// Expected seconds of its sweeps.
    sweeping: f64,
}

impl Steps {
    /// Steps down to the threshold `last`. With `few` there are two steps: the first computes the light from which the second refines
    /// links; or only one step if `last` is the first threshold.
    fn new(last: f32, few: bool, seconds: Option<f64>) -> Steps {
        let all = FIRST_THRESHOLD / f64::from(last);
        let ratio = if few { all.max(THRESHOLD_RATIO) } else { THRESHOLD_RATIO };
        let least = match few {
            true if all <= 1.0 => 0.0,
            true => 1.0,
            false => f64::from(MIN_STEPS),
        };
        let steps = all.log(ratio).ceil().max(least);
        let next = f64::from(last) * ratio.powf(steps);
        Steps { seconds, next, ratio, links: FIRST_STEP_LINKS, sweeping: 0.0 }
    }

    /// Seconds in which the next step may refine links.
    fn room(&self) -> f64 {
        self.seconds.map_or(f64::INFINITY, |step| (step - self.sweeping).max(MIN_REFINING_SHARE * step))
    }

    /// Updates the estimates from a step of limited time.
    fn learn(&mut self, replaced: usize, room: f64, refining: f64, sweeping: f64) {
        // The mean with the earlier estimate halves the effect of a step that other processes delayed.
        self.sweeping = if self.sweeping > 0.0 { 0.5 * (self.sweeping + sweeping) } else { sweeping };
        let factor = room * replaced.max(1) as f64 / (refining.max(1e-6) * self.links);
        self.links = (self.links * factor.clamp(STEP_GROWTH[0], STEP_GROWTH[1])).max(1.0);
    }
}

impl Refined {
    /// One step: refines links, sweeps, and updates importance and statistics. Returns its threshold.
    fn step(&mut self, steps: &mut Steps, progress: &dyn Progress, deadline: &Deadline) -> (StepResult, f32) {
        let start = Instant::now();
        let linked = &mut self.linked;
        let errors = [link_errors(linked), sky_link_errors(linked, &linked.sky_links)];
        let once = steps.seconds.is_some();
        let threshold = match once {
            true => threshold(&errors, steps.links as usize, self.link_error),
            false => (steps.next as f32).max(self.link_error),
        };
        let (room, closing) = (steps.room(), self.closing_cost);
        let over =
            |size: usize| deadline.left() <= closing * size as f64 || start.elapsed().as_secs_f64() > room;
        let replaced = refine(linked, &errors, threshold, once, &over, progress);
        let refining = start.elapsed().as_secs_f64();
        let mut nodes = linked.active_nodes();
        cap_row_sums(&mut linked.elements, &mut nodes);
        let max_sweeps = if once { 1 } else { MAX_STEP_SWEEPS };
        self.convergence = linked.iterate(&nodes, STEP_TOLERANCE, max_sweeps, deadline);
        propagate_importance(linked, &nodes);
        linked.update_oracle_statistics();
        let seconds = start.elapsed().as_secs_f64();
        let (links, elements) = (linked.link_count(), linked.elements.len());
        let sweeps = self.convergence.sweeps.max(1) * (links + elements);
        self.closing_cost = CLOSING_SWEEPS * (seconds - refining) / sweeps as f64;
        if once {
            steps.learn(replaced.links, room, refining, seconds - refining);
        }
        steps.next /= steps.ratio;
        self.iterations.push(Iteration {
            seconds,
            links,
            elements,
            refined: replaced.links,
            error_bound: threshold.into(),
            residual: self.convergence.residual,
        });
        (replaced, threshold)
    }

    /// Measures the links again, normalises row sums, and finds the last light along the links.
    pub fn close_links(&mut self, deadline: &Deadline) -> LinkClosing {
        let linked = &mut self.linked;
        remeasure_links(linked, self.link_error, self.closing_cost, deadline);
        remeasure_sky_links(linked, self.link_error, self.closing_cost, deadline);
        let (sampled, bounded) = linked.normalise_rows(deadline);
        let nodes = linked.active_nodes();
        let convergence = linked.iterate(&nodes, FINAL_TOLERANCE, MAX_FINAL_SWEEPS, deadline);
        let used = link_row_sums(&linked.elements, &nodes);
        linked.update_oracle_statistics();
        LinkClosing { sampled, used, bounded, bytes: nodes.bytes(), convergence, arrived: linked.arrived() }
    }
}
