//! Routes of bundles: the distance cut, walks, or exact rays, whichever takes the least time to an error.

use super::answer::{Answer, Bundle};
use super::bundle_walks::Workspace;
use super::cut::{BundleSums, DistanceCut, Mode, rays_for};
use super::multires::{MultiResolution, Route};
use crate::ray::{LANES, Packet};
use std::sync::Arc;

/// Largest time to an error, relative to that of exact rays, at which another route is taken: work is an estimate, and the mean squares
/// of a sample of 256 bundles are known to about a tenth.
const MAX_COST_RATIO: f64 = 0.8;

/// Fewest runs of a sample with aggregated geometry from which the error of averages is estimated. The bundles of a run are neighbours
/// with similar errors; five runs give a mean square to about a factor of two. With fewer, exact rays are taken.
const MIN_AVERAGED_RUNS: usize = 5;

/// Time of a unit of work of walks, and additionally of each segment, in units of work of the cut's tree: 5.8 ns to 2.3 ns. Times of rows
/// of park, orchard and leaf forest with 16, 64 and 256 segments are those of this formula to a fifth (`mrvis bench`).
const WALK_WORK: f64 = 2.5;

/// Visible fractions of the bundles of a sample by two independent halves of many rays.
pub type ReferenceHalves = [Vec<f32>; 2];

/// Bundles like those that are to be answered.
pub struct RouteSample<'a> {
    /// Runs of neighbouring bundles.
    pub runs: Vec<Vec<Bundle<'a>>>,
    /// A fraction for each bundle, in order.
    pub reference: &'a ReferenceHalves,
}

/// Time and errors of a route for the bundles of a sample.
struct Trial {
    /// Units of work of the cut's tree; infinite for averages that hardly average anything.
    time: f64,
    /// Sum of the squares of the errors.
    square: f64,
    /// Standard error of `square` for averages, which is added to it; 0 for other routes.
    standard_error: f64,
    /// What the mean error contributes to `square`.
    mean: f64,
    /// Detection limit of `square`: noise of the reference.
    detection_limit: f64,
}

impl Trial {
    /// Time to an error up to a constant factor: the time times the relative number of rays that the mean square error requires.
    fn cost(&self) -> f64 {
        self.time * rays_for((self.square + self.standard_error).max(self.detection_limit))
    }

    /// The same route with a mean error of zero.
    fn without_mean(self) -> Trial {
        Trial { square: self.square - self.mean.max(0.0), ..self }
    }
}

/// Standard error of a sum of independent values.
pub(super) fn standard_error(values: &[f64]) -> f64 {
    let (sum, count) = (values.iter().sum::<f64>(), values.len().max(1) as f64);
    let spread: f64 = values.iter().map(|value| (value - sum / count).powi(2)).sum();
    (spread * count / (count - 1.0).max(1.0)).sqrt()
}

impl MultiResolution {
    /// Adds the distance cut, if the model has one.
    #[must_use]
    pub fn with_cut(mut self, cut: Option<Arc<DistanceCut>>) -> Self {
        self.cut = cut;
        self
    }

    /// The engine that takes this route for all bundles.
    #[must_use]
    pub fn with_route(&self, route: Route) -> Self {
        let mut engine = self.clone();
        engine.route = route;
        engine
    }

    /// The engine by the distance cut in each of its modes, with the work of a segment over that of exact rays, as the pilot measured it.
    pub fn by_cut(&self) -> impl Iterator<Item = (MultiResolution, f64)> {
        let modes = self.cut.as_ref().map_or(&[][..], |cut| cut.modes());
        modes.iter().enumerate().map(|(k, mode)| (self.with_route(Route::Cut(k)), f64::from(mode.work())))
    }

    /// [`MultiResolution::answers_lanes`] by the distance cut, and by exact rays for bundles that it does not take.
    pub(super) fn lanes_by_cut(
        &self,
        bundles: &[Bundle],
        workspace: &mut Workspace,
        mut each: impl FnMut(usize, Answer, &[f32; LANES]),
    ) {
        let mut k = 0;
        for group in bundles.chunk_by(|a, b| self.mode(a).is_some() == self.mode(b).is_some()) {
            match self.mode(&group[0]) {
                Some((cut, mode)) => cut.lanes(group, mode, |answer, lanes| {
                    each(k, answer, lanes);
                    k += 1;
                }),
                None => {
                    for bundle in group {
                        let answer = self.hand_over(*bundle, workspace);
                        each(k, answer, &workspace.open_lanes(bundle));
                        k += 1;
                    }
                }
            }
        }
    }

    /// Memory of the distance cut, bytes.
    pub fn cut_bytes(&self) -> usize {
        self.cut.as_ref().map_or(0, |cut| cut.bytes())
    }

    /// The route that takes the least time to an error for bundles like those of a sample at feature size `s`; that of exact rays unless
    /// another is clearly faster. Walks are fitted to the mean of runs of bundles.
    pub fn route(
        &self,
        sample: &RouteSample,
        mean: &[Vec<Bundle>],
        s: f32,
        workspace: &mut Workspace,
    ) -> Route {
        let cuts = 0..self.cut.as_ref().map_or(0, |cut| cut.modes().len());
        let taken = |cut: &Arc<DistanceCut>| sample.runs.iter().flatten().any(|bundle| cut.takes(bundle));
        let cuts = if self.cut.as_ref().is_some_and(taken) { cuts } else { 0..0 };
        let rays = sample.runs.iter().flatten().map(|bundle| self.rays_work(bundle)).collect::<Vec<f64>>();
        let mut trial = |route, limit| self.with_route(route).trial(sample, &rays, s, limit, workspace);
        let mut best = (MAX_COST_RATIO * trial(Route::Exact, f64::INFINITY).cost(), Route::Exact);
        for route in cuts.map(Route::Cut).chain([Route::Certified]) {
            let cost = trial(route, best.0).cost();
            if cost < best.0 {
                best = (cost, route);
            }
        }
        // Fitting takes longer than a trial, so that walks that would be too slow even with a mean error of zero are not fitted.
        if trial(Route::WALKS, best.0).without_mean().cost() < best.0 {
            let walks = self.fitted_walks(mean, s, workspace);
            if self.with_route(walks).trial(sample, &rays, s, best.0, workspace).cost() < best.0 {
                return walks;
            }
        }
        best.1
    }

    /// Work of exact rays for a bundle, in units of work of the cut's tree.
    fn rays_work(&self, bundle: &Bundle) -> f64 {
        match &self.cut {
            Some(cut) => cut.embree_work(bundle),
            None => WALK_WORK * self.rays_of(bundle) as f64,
        }
    }

    /// Time and errors of this route. `rays` are the times of exact rays for each bundle, in units of work of the cut's tree. Ends early,
    /// with an infinite time, if the cost exceeds `limit` whatever the errors are.
    fn trial(
        &self,
        sample: &RouteSample,
        rays: &[f64],
        s: f32,
        limit: f64,
        workspace: &mut Workspace,
    ) -> Trial {
        let RouteSample { runs, reference: [a, b] } = sample;
        let averages = matches!(self.route, Route::Walks { .. } | Route::Cut(_));
        let traced = |bundle: &Bundle| match self.route {
            Route::Exact => true,
            Route::Cut(_) => self.mode(bundle).is_none(),
            Route::Walks { .. } | Route::Certified => false,
        };
        let noise: f64 = a.iter().zip(b).map(|(a, b)| 0.25 * f64::from(a - b).powi(2)).sum();
        let all = rays.len().max(1) as f64;
        let mut trial = Trial {
            time: 0.0,
            square: 0.0,
            standard_error: 0.0,
            mean: 0.0,
            detection_limit: (noise / all.sqrt()).max(1e-12 * all),
        };
        let (mut averaged, mut n, mut means) = (0, 0, [0.0; 2]);
        let mut squares = Vec::with_capacity(runs.len());
        for run in runs {
            trial.time += self.walk_time(run, s, workspace);
            if trial.cost() > limit {
                return Trial { time: f64::INFINITY, ..trial };
            }
            let (mut is_averaged, mut square) = (false, 0.0);
            let mut bundles = run.iter();
            self.routed(run, s, workspace, |answer, sums| {
                let bundle = bundles.next().expect("an answer a bundle");
                trial.time += sums.work() + if sums.left || traced(bundle) { rays[n] } else { 0.0 };
                is_averaged |= answer.cost.aggregated > 0;
                // The noise of the halves is independent: their product has no bias.
                let [a, b] = [a, b].map(|half| f64::from(answer.transmittance - half[n]));
                square += a * b;
                means = [means[0] + a, means[1] + b];
                n += 1;
            });
            averaged += usize::from(is_averaged);
            squares.push(square);
        }
        if averages && averaged < MIN_AVERAGED_RUNS {
            trial.time = f64::INFINITY;
        }
        trial.square = squares.iter().sum();
        // A few bundles with large errors may be missing from the sample: one standard error is added, estimated from the runs.
        trial.standard_error = if averages { standard_error(&squares) } else { 0.0 };
        trial.mean = means[0] * means[1] / all;
        trial
    }

    /// Time of walks of a run of bundles, in units of work of the cut's tree; 0 for other routes.
    fn walk_time(&self, run: &[Bundle], s: f32, workspace: &mut Workspace) -> f64 {
        let work = match self.route {
            Route::Walks { .. } => self.work(run, &vec![s; run.len()], workspace),
            Route::Certified => self.certified_work(run, workspace),
            Route::Exact | Route::Cut(_) => return 0.0,
        };
        let segments: usize = run.iter().flat_map(|bundle| bundle.packets).map(Packet::len).sum();
        WALK_WORK * (work.own as f64 + segments as f64)
    }

    /// How the cut answers a bundle, if it does.
    fn mode(&self, bundle: &Bundle) -> Option<(&DistanceCut, &Mode)> {
        let (Some(cut), Route::Cut(mode)) = (&self.cut, self.route) else { return None };
        cut.takes(bundle).then(|| (&**cut, &cut.modes()[mode]))
    }

    /// The visible fractions of several bundles, passed to `each` in order.
    ///
    /// Walks of consecutive bundles with close ends share their upper part; each applies the umbra criterion by itself. Answers equal
    /// those of [`MultiResolution::answer`] up to rounding, except for bundles that only one of the two ways hands over.
    pub fn answers(
        &self,
        bundles: &[Bundle],
        s: f32,
        workspace: &mut Workspace,
        mut each: impl FnMut(Answer),
    ) {
        self.routed(bundles, s, workspace, |answer, _| each(answer));
    }

    /// The answers of the route and the sums of the cut.
    fn routed(
        &self,
        bundles: &[Bundle],
        s: f32,
        workspace: &mut Workspace,
        mut each: impl FnMut(Answer, BundleSums),
    ) {
        match self.route {
            Route::Walks { .. } => {
                return self
                    .walked_answers(bundles, s, workspace, |answer| each(answer, BundleSums::default()));
            }
            Route::Certified => {
                return self.certified(bundles, workspace, |answer| each(answer, BundleSums::default()));
            }
            Route::Exact | Route::Cut(_) => {}
        }
        for group in bundles.chunk_by(|a, b| self.mode(a).is_some() == self.mode(b).is_some()) {
            match self.mode(&group[0]) {
                Some((cut, mode)) => {
                    let mut bundles = group.iter();
                    cut.answers_that_pay(group, mode, |answer, sums| {
                        let bundle = bundles.next().expect("an answer a bundle");
                        each(answer.unwrap_or_else(|| self.hand_over(*bundle, workspace)), sums);
                    });
                }
                None => {
                    group
                        .iter()
                        .for_each(|&bundle| each(self.hand_over(bundle, workspace), BundleSums::default()));
                }
            }
        }
    }
}

// The factor of the extinctions of walks that makes their mean transmittance right, fitted on a sample.

/// Smallest and largest factor: half and twice the optical depth of the clusters.
const FACTOR_RANGE: [f32; 2] = [0.5, 2.0];
/// Ratio between 1 and the first trial, down or up by the sign of the error: a tenth, so that the secant rule has two points.
const FIRST_FACTOR_STEP: f32 = 0.9;
/// Steps of the secant rule after the first: an error of the mean of 0.01 falls below 0.0001.
const FACTOR_STEPS: usize = 2;

impl MultiResolution {
    /// Walks at feature size `s` with the factor for which the mean transmittance of runs of neighbouring bundles is that of exact rays
    /// along the same segments; with the unchanged extinctions if these means already agree to the standard error of their difference.
    pub(super) fn fitted_walks(&self, runs: &[Vec<Bundle>], s: f32, workspace: &mut Workspace) -> Route {
        let seen = self.with_route(Route::Exact).sums(runs, s, workspace);
        let mut errors = |factor: f32| -> Vec<f64> {
            let passed = self.with_route(Route::Walks { factor }).sums(runs, s, workspace);
            passed.iter().zip(&seen).map(|(passed, seen)| passed - seen).collect()
        };
        let mean = |errors: &[f64]| errors.iter().sum::<f64>();
        let first = errors(1.0);
        if mean(&first).abs() <= standard_error(&first) {
            return Route::WALKS;
        }
        let (mut last, mut next) = ((1.0, mean(&first)), FIRST_FACTOR_STEP);
        if last.1 > 0.0 {
            next = 1.0 / FIRST_FACTOR_STEP;
        }
        for _ in 0..=FACTOR_STEPS {
            let found = (next, mean(&errors(next)));
            if found.1 == last.1 {
                return Route::WALKS;
            }
            let step = found.1 * f64::from(found.0 - last.0) / (found.1 - last.1);
            (last, next) = (found, (found.0 - step as f32).clamp(FACTOR_RANGE[0], FACTOR_RANGE[1]));
        }
        Route::Walks { factor: next }
    }

    /// Sum of the transmittances of the bundles of each run: neighbours err alike.
    fn sums(&self, runs: &[Vec<Bundle>], s: f32, workspace: &mut Workspace) -> Vec<f64> {
        let sum = |run: &Vec<Bundle>| {
            let mut sum = 0.0;
            self.answers(run, s, workspace, |answer| sum += f64::from(answer.transmittance));
            sum
        };
        runs.iter().map(sum).collect()
    }
}
