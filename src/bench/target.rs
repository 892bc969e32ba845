//! Chooses engine, feature size and segments for a target error or a target time.
//!
//! A pilot on a sample runs candidate plans, measures their time and their error against independent exact rays. The
//! fastest plan that meets the target error, or the most accurate that meets the target time, runs on all pairs. A
//! plan queries all pairs with few segments, and again with more segments the pairs that are partly visible.

use super::context::Bench;
use super::measure::{MrRun, Queries, Timer};
use super::options::{MAX_RAYS, Target};
use super::pilot::{PILOT_RUN_PAIRS, pilot_pairs};
use super::record::{self, TargetChoice};
use super::reference::{Reference, RmsEstimate};
use crate::visibility::MultiResolution;
use std::time::Instant;

/// Numbers of segments of plans: steps of 4 halve the error.
const SEGMENT_STEPS: [usize; 6] = [1, 4, 16, 64, 256, 1024];
/// Fewest segments of MR plans: MR traverses a packet of 16 lanes as a whole.
const MIN_MR_SEGMENTS: usize = 16;
/// Rays per pair of the pilot's exact reference, and its random streams: noise of at most √(¼ / 2,048) = 1.1 %.
const TRUTH_RAYS: usize = 2048;
const STREAMS: [u64; 2] = [8, 9];
/// Part of a target time for the pilot: the larger part is for queries. Changes results with a target time only.
const PILOT_TIME_PART: f64 = 0.4;
/// Part of the pilot's time for its exact reference; the rest is for the rows that it compares.
const TRUTH_TIME_PART: f64 = 0.3;
/// Fewest rays per pair of that reference: noise of at most √(¼ / 64) = 6 %.
const MIN_TRUTH_RAYS: usize = 64;
/// Fewest pairs per run of the pilot, so that neighbours share their traversal.
const MIN_RUN_PAIRS: usize = 4;
/// Part of a target time that pilot and plan may be expected to take: a tenth is kept for the variation of times.
const PLAN_TIME_PART: f64 = 0.9;
/// Visible fractions of partly visible pairs: 0 and 1 are excluded with a margin of 1e-4, some 800 spacings of f32.
const PARTLY_VISIBLE: std::ops::RangeInclusive<f32> = 1e-4..=0.9999;

/// Segments of all pairs.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Plan {
    /// `None`: exact.
    feature_size: Option<f64>,
    rays: usize,
    /// Segments of the second query of partly visible pairs.
    more: Option<usize>,
}

/// Error and time of a plan as measured by the pilot.
#[derive(Clone, Copy, Debug)]
struct Expected {
    plan: Plan,
    error: RmsEstimate,
    /// Time for all pairs, seconds.
    seconds: f64,
    /// Part of the pairs that are queried twice.
    partly: f64,
}

impl Bench<'_> {
    /// Chooses a plan, runs it, and compares error and time with the pilot's expectation.
    pub fn target(
        &self,
        target: Target,
        queries: Queries,
        engine: &MultiResolution,
        reference: &Reference,
    ) -> record::Target {
        self.progress.stage("choosing", 0);
        let start = Instant::now();
        let plans = self.pilot(queries, engine, target, start);
        let spent = start.elapsed().as_secs_f64();
        let (best, reachable) = choose(&plans, target, spent);
        let pilot_s = start.elapsed().as_secs_f64();
        self.progress.stage("the choice", 0);
        let (run, _) = self.follow(best.plan, queries, engine);
        let (rms, bias) = reference.errors(&run.run.visible);
        let found = RmsEstimate::of(&reference.squares(&run.run.visible), 1);
        let seconds = run.run.seconds();
        record::Target {
            asked: match target {
                Target::Error(error) => record::TargetAsked { error: Some(error), seconds: None },
                Target::Seconds(seconds) => record::TargetAsked { error: None, seconds: Some(seconds) },
            },
            chosen: TargetChoice {
                feature_size: best.plan.feature_size,
                exact: best.plan.feature_size.is_none(),
                rays: best.plan.rays,
                rays_where_partly_visible: best.plan.more,
                partly_visible: best.partly,
            },
            expected_rms: best.error.rms,
            expected_rms_lo: best.error.lo,
            expected_rms_hi: best.error.hi,
            expected_seconds: best.seconds,
            pilot_s,
            seconds,
            rms,
            bias,
            rms_lo: found.lo,
            rms_hi: found.hi,
            reachable,
            met: match target {
                Target::Error(error) => rms <= error,
                Target::Seconds(limit) => pilot_s + seconds <= limit,
            },
            as_expected: found.lo <= best.error.hi && best.error.lo <= found.hi,
            audit: self.audit(queries).map(|audit| audit.evaluate(&run)),
        }
    }

    /// Measures plans on a sample in order of their segments; with a target time, until the pilot's time is used up.
    fn pilot(
        &self,
        queries: Queries,
        engine: &MultiResolution,
        target: Target,
        start: Instant,
    ) -> Vec<Expected> {
        let limit = match target {
            Target::Error(_) => f64::INFINITY,
            Target::Seconds(limit) => PILOT_TIME_PART * limit,
        };
        let spent = || start.elapsed().as_secs_f64();
        let mut pairs = pilot_pairs(queries);
        // A pilot of limited time uses fewer pairs and fewer rays for its exact reference.
        let (mut rays, mut run) = (TRUTH_RAYS, PILOT_RUN_PAIRS.min(pairs.len().max(1)));
        if limit.is_finite() {
            let few = Queries { pairs: &pairs[..run.min(pairs.len())], ..queries };
            let call = self.embree(queries.workload, MIN_TRUTH_RAYS);
            let before = spent();
            Reference::trace(few, &call, MIN_TRUTH_RAYS, STREAMS, &|_| ());
            let each = (spent() - before) / (few.pairs.len() * MIN_TRUTH_RAYS).max(1) as f64;
            let affordable = (TRUTH_TIME_PART * (limit - spent()).max(0.0) / each.max(1e-12)) as usize;
            rays = (affordable / pairs.len().max(1) / 2 * 2).clamp(MIN_TRUTH_RAYS, TRUTH_RAYS);
            let runs = pairs.len().div_ceil(run);
            let shorter = (affordable / (rays * runs.max(1))).clamp(MIN_RUN_PAIRS.min(run), run);
            pairs = first_of_each(&pairs, run, shorter);
            run = shorter;
        }
        let pilot = Queries { pairs: &pairs, ..queries };
        let exact = self.embree(queries.workload, rays);
        let truth = Reference::trace(pilot, &exact, rays, STREAMS, &|_| ());
        let scale = queries.pairs.len() as f64 / pairs.len() as f64;
        let mut found: Vec<Expected> = Vec::new();
        for plan in self.plans() {
            if !found.is_empty() && spent() > limit {
                break;
            }
            if cannot_win(plan, &found, target) {
                continue;
            }
            // The first run also fills the caches.
            let (first, partly) = self.follow(plan, pilot, engine);
            let again = self.follow(plan, pilot, engine).0.run.seconds();
            let error = RmsEstimate::of(&truth.squares(&first.run.visible), run);
            // A target error needs the time without disturbance; a target time needs the pessimistic one.
            let seconds = match target {
                Target::Error(_) => first.run.seconds().min(again),
                Target::Seconds(_) => first.run.seconds().max(again),
            };
            found.push(Expected { plan, error, seconds: scale * seconds, partly });
        }
        let dearest = found.iter().rfind(|p| p.plan.feature_size.is_none() && p.plan.more.is_none()).copied();
        found.extend(dearest.into_iter().flat_map(beyond));
        found
    }

    /// All plans, by total segments; an exact plan is first.
    fn plans(&self) -> Vec<Plan> {
        let mut plans = Vec::new();
        for (k, &rays) in SEGMENT_STEPS.iter().enumerate() {
            for feature_size in [None].into_iter().chain(self.sizes.iter().map(|&s| Some(s))) {
                if feature_size.is_none() || rays >= MIN_MR_SEGMENTS {
                    let more = SEGMENT_STEPS[k + 1..].iter().map(|&n| Some(n));
                    let plan = |more| Plan { feature_size, rays, more };
                    plans.extend([None].into_iter().chain(more).map(plan));
                }
            }
        }
        plans.sort_by_key(|plan| plan.rays + plan.more.unwrap_or(0));
        plans
    }

    /// Runs a plan; its answers, and the part of the pairs that were queried twice.
    fn follow(&self, plan: Plan, queries: Queries, engine: &MultiResolution) -> (MrRun, f64) {
        let ask = |queries: Queries, rays: usize| match plan.feature_size {
            Some(s) => self.timer.multi_resolution(queries, engine, s as f32, rays, &|_| ()),
            None => exactly(&self.timer, queries, self, rays),
        };
        let mut run = ask(queries, plan.rays);
        let Some(more) = plan.more else { return (run, 0.0) };
        let partly: Vec<usize> =
            (0..queries.pairs.len()).filter(|&k| PARTLY_VISIBLE.contains(&run.run.visible[k])).collect();
        let pairs: Vec<usize> = partly.iter().map(|&k| queries.pairs[k]).collect();
        let again = ask(Queries { pairs: &pairs, ..queries }, more);
        for (&k, (&visible, &interval)) in partly.iter().zip(again.run.visible.iter().zip(&again.intervals)) {
            (run.run.visible[k], run.intervals[k]) = (visible, interval);
        }
        run.run.sections.extend(again.run.sections);
        run.cost.add(again.cost);
        (run, partly.len() as f64 / queries.pairs.len().max(1) as f64)
    }
}

/// Exact rays for a plan.
fn exactly(timer: &Timer, queries: Queries, bench: &Bench, rays: usize) -> MrRun {
    MrRun::handed_over(timer.exact(queries, &bench.embree(queries.workload, rays), rays, &|_| ()), rays)
}

/// Exact plans beyond the pilot's, extrapolated: error ∝ rays^(−1/2), time ∝ rays.
fn beyond(limit: Expected) -> impl Iterator<Item = Expected> {
    let steps =
        (1..).map(move |k| (4usize.pow(k), limit.plan.rays.max(limit.plan.more.unwrap_or(0)) << (2 * k)));
    steps.take_while(|&(_, rays)| rays <= MAX_RAYS).map(move |(factor, rays)| {
        let less = |e: f64| e / (factor as f64).sqrt();
        let RmsEstimate { rms, lo, hi } = limit.error;
        Expected {
            plan: Plan { feature_size: None, rays, more: None },
            error: RmsEstimate { rms: less(rms), lo: less(lo), hi: less(hi) },
            seconds: limit.seconds * factor as f64,
            partly: 0.0,
        }
    })
}

/// The first `count` of each run of `length` pairs.
fn first_of_each(pairs: &[usize], length: usize, count: usize) -> Vec<usize> {
    pairs.chunks(length).flat_map(|run| &run[..count.min(run.len())]).copied().collect()
}

/// Whether a plan cannot be the fastest that meets a target error: its first query, or one with fewer segments of the
/// same engine, took as long as a complete plan that meets the target.
fn cannot_win(plan: Plan, found: &[Expected], target: Target) -> bool {
    let Target::Error(limit) = target else { return false };
    let good = found.iter().filter(|p| good_enough(p, limit)).map(|p| p.seconds).fold(f64::MAX, f64::min);
    let begins = |p: &&Expected| {
        p.plan.more.is_none() && p.plan.feature_size == plan.feature_size && p.plan.rays <= plan.rays
    };
    found.iter().filter(begins).any(|p| p.seconds >= good)
}

/// Whether a plan is expected to meet a target error: the upper end of its 95 % interval does, or the pilot saw no
/// error.
fn good_enough(plan: &Expected, limit: f64) -> bool {
    plan.error.hi <= limit || plan.error.rms == 0.0
}

/// The best plan for a target, and whether it is expected to meet the target.
///
/// `spent`: seconds of a target time that the pilot used.
fn choose(plans: &[Expected], target: Target, spent: f64) -> (Expected, bool) {
    let minimum = |key: fn(&Expected) -> f64, good: &dyn Fn(&Expected) -> bool| {
        plans.iter().filter(|p| good(p)).min_by(|a, b| key(a).total_cmp(&key(b))).copied()
    };
    let all = |_: &Expected| true;
    let seconds: fn(&Expected) -> f64 = |p| p.seconds;
    let error: fn(&Expected) -> f64 = |p| p.error.rms;
    let (found, otherwise) = match target {
        Target::Error(limit) => (minimum(seconds, &|p| good_enough(p, limit)), minimum(error, &all)),
        Target::Seconds(limit) => {
            (minimum(error, &|p| spent + p.seconds <= PLAN_TIME_PART * limit), minimum(seconds, &all))
        }
    };
    (found.or(otherwise).expect("exact rays are always a plan"), found.is_some())
}

#[cfg(test)]
mod tests;
