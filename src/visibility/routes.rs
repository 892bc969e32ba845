//! Routes of bundles: the distance cut, walks, or exact rays, whichever takes the least time to an error.

use super::answer::{Answer, Bundle};
use super::bundle_walks::Workspace;
use super::cost_model::Work;
use super::cut::{Cut, Mode, Sums, rays_for};
use super::multires::MultiResolution;
use super::route::Route;
use crate::ray::{LANES, Packet};
use std::sync::Arc;

/// Largest time to an error, relative to that of exact rays, at which another route is taken: work is an estimate, and the mean squares
/// of a sample of 256 bundles are known to about a tenth.
const MAX_COST_RATIO: f64 = 0.8;

/// Fewest runs of a sample with something averaged by which the error of averages is judged. The bundles of a run are neighbours and err
/// alike; by five runs a mean square is known to about a factor of two. With fewer, exact rays are taken.
const MIN_AVERAGED_RUNS: usize = 5;

/// Time of a unit of work of walks, and beside it of a segment, in units of work of the cut's tree: 5.8 ns to 2.3 ns. Times of rows of park,
/// orchard and leaf forest with 16, 64 and 256 segments are those of this formula to a fifth (`mrvis bench`).
const WALK_WORK: f64 = 2.5;

/// Visible fractions of the bundles of a sample by two independent halves of many rays.
pub type Halves = [Vec<f32>; 2];

/// Bundles like those that are to be answered.
pub struct RouteSample<'a> {
    /// Runs of neighbouring bundles.
    pub runs: Vec<Vec<Bundle<'a>>>,
    /// A fraction for each bundle, in order.
    pub truth: &'a Halves,
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
    pub fn with_cut(mut self, cut: Option<Arc<Cut>>) -> Self {
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
    #[cfg(any(test, feature = "reports"))]
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
        let taken = |cut: &Arc<Cut>| sample.runs.iter().flatten().any(|bundle| cut.takes(bundle));
        let cuts = if self.cut.as_ref().is_some_and(taken) { cuts } else { 0..0 };
        let walks = self.fitted_walks(mean, s, workspace);
        let others = [Route::Certified, walks].into_iter().chain(cuts.map(Route::Cut));
        let rays = sample.runs.iter().flatten().map(|bundle| self.rays_work(bundle)).collect::<Vec<f64>>();
        let mut cost = |route| self.with_route(route).cost((sample, &rays), s, workspace);
        let limit = MAX_COST_RATIO * cost(Route::Exact);
        let faster = others.map(|route| (cost(route), route)).filter(|(cost, _)| *cost < limit);
        faster.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(Route::Exact, |(_, route)| route)
    }

    /// Work of exact rays for a bundle, in units of work of the cut's tree.
    fn rays_work(&self, bundle: &Bundle) -> f64 {
        match &self.cut {
            Some(cut) => cut.embree_work(bundle),
            None => WALK_WORK * self.rays_of(bundle) as f64,
        }
    }

    /// Time for bundles times the number of rays that their mean square error takes: the time to an error but for a factor. Times are in
    /// units of work of the cut's tree, `rays` those of exact rays. Infinite for averages that hardly average anything.
    fn cost(&self, (sample, rays): (&RouteSample, &[f64]), s: f32, workspace: &mut Workspace) -> f64 {
        let RouteSample { runs, truth: [a, b] } = sample;
        let walked = |work: Work| {
            let segments: usize =
                runs.iter().flatten().flat_map(|bundle| bundle.packets).map(Packet::len).sum();
            WALK_WORK * (work.own as f64 + segments as f64)
        };
        let mut time = match self.route {
            Route::Walks { .. } => {
                walked(self.work_of(runs, |run, ws| self.work(run, &vec![s; run.len()], ws), workspace))
            }
            Route::Certified => walked(self.work_of(runs, |run, ws| self.certified_work(run, ws), workspace)),
            Route::Exact | Route::Cut(_) => 0.0,
        };
        let traced = |bundle: &Bundle| match self.route {
            Route::Exact => true,
            Route::Cut(_) => self.mode(bundle).is_none(),
            Route::Walks { .. } | Route::Certified => false,
        };
        let (mut averaged, mut n) = (0, 0);
        let mut squares = Vec::with_capacity(runs.len());
        for run in runs {
            let (mut averages, mut square) = (false, 0.0);
            let mut bundles = run.iter();
            self.routed(run, s, workspace, |answer, sums| {
                let bundle = bundles.next().expect("an answer a bundle");
                time += sums.work() + if sums.left || traced(bundle) { rays[n] } else { 0.0 };
                averages |= answer.cost.aggregated > 0;
                // The noise of the halves is independent: their product has no bias.
                let [a, b] = [a, b].map(|half| f64::from(answer.transmittance - half[n]));
                square += a * b;
                n += 1;
            });
            averaged += usize::from(averages);
            squares.push(square);
        }
        let sum = squares.iter().sum::<f64>();
        let square = match self.route {
            Route::Exact | Route::Certified => sum,
            Route::Walks { .. } | Route::Cut(_) if averaged < MIN_AVERAGED_RUNS => return f64::INFINITY,
            // Few bundles with large errors may have been missed: one standard error more, which is known from the runs.
            Route::Walks { .. } | Route::Cut(_) => sum + standard_error(&squares),
        };
        let n = n.max(1) as f64;
        let noise: f64 = a.iter().zip(b).map(|(a, b)| 0.25 * f64::from(a - b).powi(2)).sum();
        time * rays_for(square.max(noise / n.sqrt()).max(1e-12 * n))
    }

    /// Sum of the work for runs of bundles.
    fn work_of(
        &self,
        runs: &[Vec<Bundle>],
        of: impl Fn(&[Bundle], &mut Workspace) -> Work,
        workspace: &mut Workspace,
    ) -> Work {
        let mut work = Work::default();
        runs.iter().for_each(|run| work.add(of(run, workspace)));
        work
    }

    /// How the cut answers a bundle, if it does.
    fn mode(&self, bundle: &Bundle) -> Option<(&Cut, &Mode)> {
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

    /// The answers of the route and what the cut met.
    fn routed(
        &self,
        bundles: &[Bundle],
        s: f32,
        workspace: &mut Workspace,
        mut each: impl FnMut(Answer, Sums),
    ) {
        match self.route {
            Route::Walks { .. } => {
                return self.walked_answers(bundles, s, workspace, |answer| each(answer, Sums::default()));
            }
            Route::Certified => {
                return self.certified(bundles, workspace, |answer| each(answer, Sums::default()));
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
                    group.iter().for_each(|&bundle| each(self.hand_over(bundle, workspace), Sums::default()));
                }
            }
        }
    }
}
