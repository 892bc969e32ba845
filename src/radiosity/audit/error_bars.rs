//! The audit of error bars: independent paths from a few elements, followed to the end by exact rays. They share with the solution which
//! sides count as unlit, and the closed form of the light of diffuse emitters without obstacles.

use crate::math::parallel;
use crate::math::sampling::{mix, point_on};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::final_gather::{Buffers, FinalGather, IndependentLight, PathVertex};
use crate::radiosity::links::Tally;
use crate::radiosity::options::Options;
use crate::radiosity::rgb::mean;
use glam::Vec3;
use sobol_burley::sample_4d;

/// Groups of paths from an element, whose spread gives the standard error of their mean to 1/√(2 · 7) = 27 %.
const GROUPS: u32 = 8;
/// Paths of a group: with 512 paths an element is known to about 3 %, where single paths deviate by two thirds of the mean.
const PATHS: u32 = 64;
/// Target of the error that these paths can distinguish from half of it: the mean square of a noise of 3 % at 200 elements
/// has a standard error of √(2 / 200) of itself, the root of which is 0.95 %.
const TARGET_OF_PATHS: f64 = 0.02;
/// Largest factor of the number of paths, for a target of 0.25 %: limits the time of the audit to 64 times that of one without target.
const MAX_PATH_FACTOR: f64 = 64.0;

/// Comparison of error bars with errors of sampled elements, each weighted by the area that it represents.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct ErrorBarAudit {
    /// Elements whose irradiance was computed again by paths.
    pub elements: usize,
    /// Fraction of the area whose error lies within the bar (0.68 for a normal distribution).
    pub within_one: f64,
    /// Fraction of the area whose error lies within twice the bar (0.95 for a normal distribution).
    pub within_two: f64,
    /// Fraction of the area whose error lies within 1/4, 2/4, … 12/4 of the bar.
    pub within_quarters: [f64; 12],
    /// Root mean square of the errors, less the noise of the paths, relative to the mean irradiance of all elements.
    pub rms_error: f64,
    /// RMS error, at least the detection limit: the root of one standard error of the mean square.
    pub expected_rms: f64,
    /// Upper end of the 95 % interval of `expected_rms`.
    pub rms_upper: f64,
    /// Root mean square of the bars, relative to the mean irradiance of all elements.
    pub rms_bar: f64,
    /// The factor in `[1/4, 4]` by which the bars were multiplied, found at as many other elements.
    pub factor: f64,
}

/// Bounds of the factor that corrects bars: errors of the estimate beyond a factor of 4 stay visible in the audit.
const FACTOR_LIMITS: [f64; 2] = [0.25, 4.0];
/// Smallest number of elements that determine the factor: 2 of 40 are expected beyond the 95 % quantile that it is fitted to.
const MIN_ELEMENTS: usize = 40;
/// Fraction of the errors that should lie within twice the bars: two standard deviations of a normal distribution. Errors have longer
/// tails, so that bars fitted to one standard deviation would be too small.
const FRACTION_WITHIN_TWO: f64 = 0.9545;
/// Position in each stratum of the summed draw weights at which an element is drawn: for the factor, and for the audit.
const FACTOR_POSITION: f64 = 0.25;
const AUDIT_POSITION: f64 = 0.75;

/// The size of an audit.
#[derive(Clone, Copy, Debug)]
pub struct AuditSize {
    /// Elements that are checked.
    pub elements: usize,
    /// Paths of each group of an element.
    paths: u32,
}

impl AuditSize {
    /// The size for these options; smaller targets need more paths.
    pub fn of(options: &Options) -> AuditSize {
        let elements = if options.direct_only || !options.elements { 0 } else { options.audit };
        let factor = options.target_error.map_or(1.0, |target| (TARGET_OF_PATHS / target).powi(2));
        AuditSize { elements, paths: PATHS * factor.clamp(1.0, MAX_PATH_FACTOR).ceil() as u32 }
    }
}

/// An element that was checked, W/m².
#[derive(serde::Deserialize, serde::Serialize)]
struct Check {
    /// Difference of the solution from the paths.
    error: f64,
    /// Standard error of the paths.
    noise: f64,
    /// Error bar.
    bar: f64,
    /// The area that the element represents, divided by the mean of these areas.
    weight: f64,
}

/// The mean of squared errors and its standard error; none without any.
pub(super) fn mean_square(squares: &[f64]) -> Option<(f64, f64)> {
    let n = squares.len() as f64;
    let mean = squares.iter().sum::<f64>() / n;
    let variance = squares.iter().map(|s| s * s).sum::<f64>() / n - mean * mean;
    (n > 0.0).then(|| (mean, (variance.max(0.0) / n).sqrt()))
}

/// Squared errors less the noise of the paths, weighted by the represented areas.
fn squares(checks: &[Check]) -> Vec<f64> {
    checks.iter().map(|c| c.weight * (c.error * c.error - c.noise * c.noise)).collect()
}

/// The fraction of the area whose error is within a bound.
fn part_within(checks: &[Check], bound: impl Fn(&Check) -> f64) -> f64 {
    let within = checks.iter().filter(|check| check.error <= bound(check));
    within.map(|check| check.weight).sum::<f64>() / checks.iter().map(|check| check.weight).sum::<f64>()
}

impl FinalGather<'_> {
    /// Compares the solution's irradiance with paths, and the differences with `bars` (standard uncertainty by element, W/m²), at
    /// some elements. The audit is empty if the deadline ends it early.
    pub fn audit(&self, bars: &[f64], size: AuditSize, deadline: &Deadline) -> (ErrorBarAudit, Tally) {
        let (checks, tally) = self.checks(bars, size, AUDIT_POSITION, deadline);
        if checks.is_empty() {
            return (ErrorBarAudit::default(), tally);
        }
        let mut audit = ErrorBarAudit { elements: checks.len(), ..ErrorBarAudit::default() };
        let within = |bars: f64| part_within(&checks, |check| bars * check.bar.hypot(check.noise));
        (audit.within_one, audit.within_two) = (within(1.0), within(2.0));
        audit.within_quarters = std::array::from_fn(|k| within(0.25 * (k + 1) as f64));
        audit.rms_bar = checks.iter().map(|check| check.weight * check.bar * check.bar).sum();
        let (n, level) = (audit.elements as f64, self.level());
        let (mean_square, resolved) = mean_square(&squares(&checks)).unwrap_or_default();
        audit.rms_upper = (mean_square.max(0.0) + 2.0 * resolved).sqrt() / level;
        audit.expected_rms = mean_square.max(resolved).sqrt() / level;
        audit.rms_error = mean_square.max(0.0).sqrt() / level;
        audit.rms_bar = (audit.rms_bar / n).sqrt() / level;
        (audit, tally)
    }

    /// RMS error of elements relative to the mean irradiance, from other elements than those of the audit; at least the detection
    /// limit. `None` if no element was checked.
    pub fn sampled_error(&self, bars: &[f64], size: AuditSize, deadline: &Deadline) -> (Option<f64>, Tally) {
        let (checks, tally) = self.checks(bars, size, FACTOR_POSITION, deadline);
        let error =
            mean_square(&squares(&checks)).map(|(mean, resolved)| mean.max(resolved).sqrt() / self.level());
        (error, tally)
    }

    /// The factor by which bars must be multiplied so that 95 % of the errors at some elements (others than those of the audit)
    /// lie within twice the bars; 1 if too few of them have bars above the noise of the paths. Bars assume
    /// independent samples, but stratified samples are better, and errors of links are correlated.
    pub fn bar_factor(&self, bars: &[f64], size: AuditSize, deadline: &Deadline) -> (f64, Tally) {
        let (mut checks, tally) = self.checks(bars, size, FACTOR_POSITION, deadline);
        checks.retain(|check| check.noise < check.bar);
        if checks.len() < MIN_ELEMENTS {
            return (1.0, tally);
        }
        let within =
            |factor: f64| part_within(&checks, |check| 2.0 * (factor * check.bar).hypot(check.noise));
        let [mut low, mut high] = FACTOR_LIMITS;
        for _ in 0..20 {
            let middle = (low * high).sqrt();
            if within(middle) < FRACTION_WITHIN_TWO { low = middle } else { high = middle }
        }
        (high, tally)
    }

    /// Mean irradiance of the sides that [count](LinkedScene::lit_sides), W/m².
    fn level(&self) -> f64 {
        let elements = &self.linked().elements;
        let (mut area, mut light) = (0.0, 0.0);
        for e in self.linked().lit_leaves() {
            let own = elements.elements[e as usize].area;
            (area, light) = (area + own, light + own * mean(elements.states[e as usize].irradiance));
        }
        if area > 0.0 { light / area } else { 0.0 }
    }

    /// Checks elements, drawn by area, light and error bars in strata; one drawn twice is checked by other paths; `position` in `[0, 1)`
    /// lies in each stratum. No checks without light or after an early stop.
    fn checks(
        &self,
        bars: &[f64],
        size: AuditSize,
        position: f64,
        deadline: &Deadline,
    ) -> (Vec<Check>, Tally) {
        if deadline.late() {
            return (Vec::new(), Tally::default());
        }
        let Elements { elements, states, .. } = &self.linked().elements;
        let (mut sums, mut sum) = (Vec::new(), 0.0);
        for (e, chance) in self.draw_weights(bars) {
            sum += elements[e as usize].area * chance;
            sums.push((sum, e, chance));
        }
        if sums.is_empty() {
            return (Vec::new(), Tally::default());
        }
        let drawn = |k: usize| {
            let at = (k as f64 + position) / size.elements as f64 * sum;
            sums[sums.partition_point(|a| a.0 <= at).min(sums.len() - 1)]
        };
        let rows = self.ranks.rows(size.elements);
        let made: Vec<Option<(Check, Tally)>> =
            parallel::map_with(rows.numbers(), Buffers::default, |buffers, k| {
                if deadline.late() {
                    return None;
                }
                buffers.scratch.tally = Tally::default();
                let (_, e, chance) = drawn(k);
                let (by_paths, noise) =
                    self.path_irradiance(e, size.paths, mix(position.to_bits() ^ k as u64), buffers);
                deadline.advance(rows.steps(1));
                let error = (mean(states[e as usize].irradiance) - by_paths).abs();
                let check = Check { error, noise, bar: bars[e as usize], weight: 1.0 / chance };
                Some((check, buffers.scratch.tally))
            });
        let (mut checks, mut tally) = (Vec::new(), Tally::default());
        let made: Option<Vec<(Check, Tally)>> = rows.gather(made).into_iter().collect();
        for (check, cost) in made.into_iter().flatten() {
            checks.push(check);
            tally.add(cost);
        }
        (checks, tally)
    }

    /// The elements that receive light, each with its probability to be drawn relative to that by area alone: a third of the draws is by
    /// area, a third by light, and a third by error bars (half by area and half by light without bars). If a lamp lights a thousandth of
    /// a floor, all error is there; in a room full of objects most of it lies in few elements with large bars.
    fn draw_weights(&self, bars: &[f64]) -> Vec<(u32, f64)> {
        let Elements { elements, states, .. } = &self.linked().elements;
        let leaves = self.linked().lit_leaves();
        let area = |e: u32| elements[e as usize].area;
        let light = |e: u32| mean(states[e as usize].irradiance).max(0.0);
        let bar = |e: u32| bars[e as usize];
        let sum = |of: &dyn Fn(u32) -> f64| leaves.iter().map(|&e| area(e) * of(e)).sum::<f64>();
        let (all_area, all_light, all_bars) = (sum(&|_| 1.0), sum(&light), sum(&bar));
        let exists = |sum: f64| sum > 0.0 && sum.is_finite();
        let parts = 1.0 + f64::from(exists(all_light)) + f64::from(exists(all_bars));
        let relative = |v: f64, sum: f64| if exists(sum) { v * all_area / sum } else { 0.0 };
        let chance = |e: u32| (1.0 + relative(light(e), all_light) + relative(bar(e), all_bars)) / parts;
        leaves.iter().map(|&e| (e, chance(e))).collect()
    }

    /// Irradiance of an element by independent paths, mean over the channels, and its standard error; W/m².
    pub(in crate::radiosity) fn path_irradiance(
        &self,
        element: u32,
        paths: u32,
        seed: u64,
        buffers: &mut Buffers,
    ) -> (f64, f64) {
        let Shape::Surface { side, corners } = self.linked().elements.elements[element as usize].shape else {
            return (0.0, 0.0);
        };
        let seed = mix(!self.linked().settings.seed ^ mix(seed ^ u64::from(element)));
        let groups: Vec<IndependentLight> = (0..GROUPS)
            .map(|g| {
                let seed = mix(seed ^ u64::from(g));
                buffers.vertices.clear();
                buffers.vertices.extend((0..paths).map(|k| {
                    let [u, v, ..] = sample_4d(k, 0, seed as u32);
                    PathVertex {
                        at: point_on(&corners, u, v),
                        side,
                        leaf: element,
                        triangle: Elements::NONE,
                        path: 0,
                        share: Vec3::ONE,
                    }
                }));
                self.independent_light(mix(seed), buffers)
            })
            .collect();
        let groups = IndependentLight::means(&groups, paths);
        let n = f64::from(GROUPS);
        let level = groups.iter().sum::<f64>() / n;
        let spread: f64 = groups.iter().map(|g| (g - level).powi(2)).sum();
        (level, (spread / (n * (n - 1.0))).sqrt())
    }
}
