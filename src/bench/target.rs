//! Error as the input: an error or a time is asked for, and the engine, its feature size and its segments follow
//! (method E.3).
//!
//! A pilot on a sample runs every plan that comes into question, takes its time and finds its error against exact rays
//! of its own; the cheapest plan that is good enough, or the best that is cheap enough, is run on all pairs.
//! A plan asks all pairs with few segments and those again with more whose light is neither clear nor blocked.

use super::measure::{MrRun, Questions, Timer};
use super::options::{MAX_RAYS, Target};
use super::record::{self, TargetChoice};
use super::reference::{Found, Reference};
use super::rows::Bench;
use super::unbiased::{PILOT, sample};
use crate::visibility::MultiResolution;
use std::time::Instant;

/// Segments of the plans.
const LADDER: [usize; 6] = [1, 4, 16, 64, 256, 1024];
/// The least for the multi-resolution engine: a packet is walked whole.
const LEAST_WALKED: usize = 16;
/// Rays of the pilot's truth, and their sample sets.
const TRUTH: usize = 2048;
const STREAMS: [u64; 2] = [8, 9];
/// Part of the time asked for that a plan may be expected to take: clocks wander.
const CAREFUL: f64 = 0.9;

/// How all pairs are asked.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Plan {
    /// None: exact.
    feature_size: Option<f64>,
    rays: usize,
    /// Segments of the pairs that turn out partly visible.
    more: Option<usize>,
}

/// What the pilot expects of a plan.
#[derive(Clone, Copy, Debug)]
struct Expected {
    plan: Plan,
    error: Found,
    /// For all pairs.
    seconds: f64,
    /// Part of the pairs that are asked again.
    partly: f64,
}

impl Bench<'_> {
    /// Chooses, runs, compares with what was expected. Without a reference the audit has to do.
    pub fn target(
        &self,
        target: Target,
        questions: Questions,
        engine: &MultiResolution,
        reference: &Reference,
    ) -> record::Target {
        self.progress.stage("choosing", 0);
        let start = Instant::now();
        let (best, reachable) = choose(&self.pilot(questions, engine), target);
        let pilot_s = start.elapsed().as_secs_f64();
        self.progress.stage("the choice", 0);
        let (run, _) = self.follow(best.plan, questions, engine);
        let (rms, bias) = reference.errors(&run.run.visible);
        let found = Found::of(&reference.squares(&run.run.visible), 1);
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
                Target::Seconds(most) => seconds <= most,
            },
            as_expected: found.lo <= best.error.hi && best.error.lo <= found.hi,
            audit: self.audit(questions).map(|audit| audit.judge(&run)),
        }
    }

    /// Every plan on a sample.
    fn pilot(&self, questions: Questions, engine: &MultiResolution) -> Vec<Expected> {
        let pairs = sample(questions);
        let pilot = Questions { pairs: &pairs, ..questions };
        let exact = self.embree(questions.workload, TRUTH);
        let truth = Reference::trace(pilot, exact, TRUTH, STREAMS, &|_| ());
        let scale = questions.pairs.len() as f64 / pairs.len() as f64;
        let mut found = Vec::new();
        for feature_size in self.sizes.iter().map(|&s| Some(s)).chain([None]) {
            let least = if feature_size.is_some() { LEAST_WALKED } else { 1 };
            for (k, &rays) in LADDER.iter().enumerate().filter(|&(_, &n)| n >= least) {
                for more in [None].into_iter().chain(LADDER[k + 1..].iter().map(|&n| Some(n))) {
                    let plan = Plan { feature_size, rays, more };
                    // The first call finds cold caches.
                    let (run, partly) = self.follow(plan, pilot, engine);
                    let again = self.follow(plan, pilot, engine).0.run.seconds();
                    let error = Found::of(&truth.squares(&run.run.visible), PILOT.1);
                    let seconds = scale * run.run.seconds().min(again);
                    found.push(Expected { plan, error, seconds, partly });
                }
            }
        }
        let most = *found.last().expect("exact rays are always a plan");
        found.extend(beyond(most));
        found
    }

    /// Runs a plan; the answers and the part of the pairs that were asked again.
    fn follow(&self, plan: Plan, questions: Questions, engine: &MultiResolution) -> (MrRun, f64) {
        let ask = |questions: Questions, rays: usize| match plan.feature_size {
            Some(s) => self.timer.multi_resolution(questions, engine, s as f32, rays, &|_| ()),
            None => exactly(&self.timer, questions, self, rays),
        };
        let mut run = ask(questions, plan.rays);
        let Some(more) = plan.more else { return (run, 0.0) };
        let partly: Vec<usize> =
            (0..questions.pairs.len()).filter(|&k| (1e-4..=0.9999).contains(&run.run.visible[k])).collect();
        let pairs: Vec<usize> = partly.iter().map(|&k| questions.pairs[k]).collect();
        let again = ask(Questions { pairs: &pairs, ..questions }, more);
        for (&k, (&visible, &interval)) in partly.iter().zip(again.run.visible.iter().zip(&again.intervals)) {
            (run.run.visible[k], run.intervals[k]) = (visible, interval);
        }
        run.run.sections.extend(again.run.sections);
        run.cost.add(again.cost);
        (run, partly.len() as f64 / questions.pairs.len().max(1) as f64)
    }
}

/// Exact rays for a plan.
fn exactly(timer: &Timer, questions: Questions, bench: &Bench, rays: usize) -> MrRun {
    MrRun::handed_over(timer.exact(questions, bench.embree(questions.workload, rays), rays, &|_| ()), rays)
}

/// Exact rays beyond those that the pilot tried: error ~ rays^-1/2, time ~ rays.
fn beyond(most: Expected) -> impl Iterator<Item = Expected> {
    let steps =
        (1..).map(move |k| (4usize.pow(k), most.plan.rays.max(most.plan.more.unwrap_or(0)) << (2 * k)));
    steps.take_while(|&(_, rays)| rays <= MAX_RAYS).map(move |(factor, rays)| {
        let less = |e: f64| e / (factor as f64).sqrt();
        let Found { rms, lo, hi } = most.error;
        Expected {
            plan: Plan { feature_size: None, rays, more: None },
            error: Found { rms: less(rms), lo: less(lo), hi: less(hi) },
            seconds: most.seconds * factor as f64,
            partly: 0.0,
        }
    })
}

/// The plan for a target, and whether it is expected to do.
fn choose(plans: &[Expected], target: Target) -> (Expected, bool) {
    let least = |key: fn(&Expected) -> f64, good: &dyn Fn(&Expected) -> bool| {
        plans.iter().filter(|p| good(p)).min_by(|a, b| key(a).total_cmp(&key(b))).copied()
    };
    let all = |_: &Expected| true;
    let seconds: fn(&Expected) -> f64 = |p| p.seconds;
    let error: fn(&Expected) -> f64 = |p| p.error.rms;
    let (found, otherwise) = match target {
        // The pilot itself is uncertain: the upper end has to do. Where it has seen no error at all there is nothing
        // better to choose.
        Target::Error(most) => {
            (least(seconds, &|p| p.error.hi <= most || p.error.rms == 0.0), least(error, &all))
        }
        Target::Seconds(most) => (least(error, &|p| p.seconds <= CAREFUL * most), least(seconds, &all)),
    };
    (found.or(otherwise).expect("exact rays are always a plan"), found.is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expected(rays: usize, rms: f64, seconds: f64) -> Expected {
        let error = Found { rms, lo: 0.9 * rms, hi: 1.1 * rms };
        Expected { plan: Plan { feature_size: None, rays, more: None }, error, seconds, partly: 0.0 }
    }

    #[test]
    fn the_cheapest_that_is_good_enough_or_the_best_that_is_cheap_enough() {
        let plans = [expected(1, 0.4, 0.1), expected(4, 0.2, 0.4), expected(16, 0.05, 1.6)];
        let rays = |target| {
            let (best, reachable) = choose(&plans, target);
            (best.plan.rays, reachable)
        };
        assert_eq!(rays(Target::Error(0.25)), (4, true));
        // 0.2 may well be 0.22.
        assert_eq!(rays(Target::Error(0.21)), (16, true));
        assert_eq!(rays(Target::Error(0.01)), (16, false));
        assert_eq!(rays(Target::Seconds(1.0)), (4, true));
        assert_eq!(rays(Target::Seconds(100.0)), (16, true));
        assert_eq!(rays(Target::Seconds(0.01)), (1, false));
    }

    #[test]
    fn more_rays_than_were_tried_follow_the_law() {
        let all: Vec<Expected> = beyond(expected(1024, 0.01, 2.0)).collect();
        assert_eq!(all.iter().map(|p| p.plan.rays).collect::<Vec<_>>(), [4096, 16384, 65536]);
        assert!((all[0].error.rms - 0.005).abs() < 1e-12 && all[0].seconds == 8.0);
    }
}
