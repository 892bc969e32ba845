//! Error as the input: an error or a time is asked for, and the engine, its feature size and its segments follow.
//!
//! A pilot on a sample runs every plan that comes into question, takes its time and finds its error against exact rays
//! of its own; the cheapest plan that is good enough, or the best that is cheap enough, is run on all pairs.
//! A plan asks all pairs with few segments and those again with more whose light is neither clear nor blocked.

use super::context::Bench;
use super::measure::{MrRun, Questions, Timer};
use super::options::{MAX_RAYS, Target};
use super::pilot::{PILOT_RUN_PAIRS, pilot_pairs};
use super::record::{self, TargetChoice};
use super::reference::{Found, Reference};
use crate::visibility::MultiResolution;
use std::time::Instant;

/// Segments of the plans.
const SEGMENT_STEPS: [usize; 6] = [1, 4, 16, 64, 256, 1024];
/// The least for the multi-resolution engine: a packet is walked whole.
const MIN_MR_SEGMENTS: usize = 16;
/// Rays of the pilot's truth, and their sample sets.
const TRUTH_RAYS: usize = 2048;
const STREAMS: [u64; 2] = [8, 9];
/// Part of a time asked for that the pilot may take, about, and part of that for its truth.
const PILOT_TIME_PART: f64 = 0.4;
const TRUTH_TIME_PART: f64 = 0.3;
/// Least rays of its truth, and pairs of its runs.
const MIN_TRUTH_RAYS: usize = 64;
const MIN_RUN_PAIRS: usize = 4;
/// Part of the time asked for that a plan may be expected to take: clocks wander.
const PLAN_TIME_PART: f64 = 0.9;

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
        let plans = self.pilot(questions, engine, target, start);
        let spent = start.elapsed().as_secs_f64();
        let (best, reachable) = choose(&plans, target, spent);
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
                Target::Seconds(most) => pilot_s + seconds <= most,
            },
            as_expected: found.lo <= best.error.hi && best.error.lo <= found.hi,
            audit: self.audit(questions).map(|audit| audit.judge(&run)),
        }
    }

    /// Plans on a sample, the cheap ones first: every one, or as many as there is time for.
    fn pilot(
        &self,
        questions: Questions,
        engine: &MultiResolution,
        target: Target,
        start: Instant,
    ) -> Vec<Expected> {
        let most = match target {
            Target::Error(_) => f64::INFINITY,
            Target::Seconds(most) => PILOT_TIME_PART * most,
        };
        let spent = || start.elapsed().as_secs_f64();
        let mut pairs = pilot_pairs(questions);
        // A pilot that may take no longer than this looks at fewer pairs, with fewer rays for its truth.
        let (mut rays, mut run) = (TRUTH_RAYS, PILOT_RUN_PAIRS.min(pairs.len().max(1)));
        if most.is_finite() {
            let few = Questions { pairs: &pairs[..run.min(pairs.len())], ..questions };
            let call = self.embree(questions.workload, MIN_TRUTH_RAYS);
            let before = spent();
            Reference::trace(few, &call, MIN_TRUTH_RAYS, STREAMS, &|_| ());
            let each = (spent() - before) / (few.pairs.len() * MIN_TRUTH_RAYS).max(1) as f64;
            let affordable = (TRUTH_TIME_PART * (most - spent()).max(0.0) / each.max(1e-12)) as usize;
            rays = (affordable / pairs.len().max(1) / 2 * 2).clamp(MIN_TRUTH_RAYS, TRUTH_RAYS);
            let runs = pairs.len().div_ceil(run);
            let shorter = (affordable / (rays * runs.max(1))).clamp(MIN_RUN_PAIRS.min(run), run);
            pairs = first_of_each(&pairs, run, shorter);
            run = shorter;
        }
        let pilot = Questions { pairs: &pairs, ..questions };
        let exact = self.embree(questions.workload, rays);
        let truth = Reference::trace(pilot, &exact, rays, STREAMS, &|_| ());
        let scale = questions.pairs.len() as f64 / pairs.len() as f64;
        let mut found: Vec<Expected> = Vec::new();
        for plan in self.plans() {
            if !found.is_empty() && spent() > most {
                break;
            }
            if too_dear(plan, &found, target) {
                continue;
            }
            // The first call finds cold caches.
            let (first, partly) = self.follow(plan, pilot, engine);
            let again = self.follow(plan, pilot, engine).0.run.seconds();
            let error = Found::of(&truth.squares(&first.run.visible), run);
            // The least time tells plans apart; the greater one promises less.
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

    /// All plans, by the segments that they start with; exact rays first, so that there always is one of them.
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
    MrRun::handed_over(timer.exact(questions, &bench.embree(questions.workload, rays), rays, &|_| ()), rays)
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

/// The first `count` of each run of this length.
fn first_of_each(pairs: &[usize], length: usize, count: usize) -> Vec<usize> {
    pairs.chunks(length).flat_map(|run| &run[..count.min(run.len())]).copied().collect()
}

/// Whether a plan cannot be the cheapest that is good enough: it begins as one does, or with more segments of the same
/// engine, that took as long as another that is good enough.
fn too_dear(plan: Plan, found: &[Expected], target: Target) -> bool {
    let Target::Error(most) = target else { return false };
    let good = found.iter().filter(|p| good_enough(p, most)).map(|p| p.seconds).fold(f64::MAX, f64::min);
    let begins = |p: &&Expected| {
        p.plan.more.is_none() && p.plan.feature_size == plan.feature_size && p.plan.rays <= plan.rays
    };
    found.iter().filter(begins).any(|p| p.seconds >= good)
}

/// Whether a plan is expected to err by no more than this. The pilot itself is uncertain: the upper end has to do. Where
/// it has seen no error at all there is nothing better to choose.
fn good_enough(plan: &Expected, most: f64) -> bool {
    plan.error.hi <= most || plan.error.rms == 0.0
}

/// The plan for a target, and whether it is expected to do.
///
/// `spent` seconds of a target of time are gone.
fn choose(plans: &[Expected], target: Target, spent: f64) -> (Expected, bool) {
    let least = |key: fn(&Expected) -> f64, good: &dyn Fn(&Expected) -> bool| {
        plans.iter().filter(|p| good(p)).min_by(|a, b| key(a).total_cmp(&key(b))).copied()
    };
    let all = |_: &Expected| true;
    let seconds: fn(&Expected) -> f64 = |p| p.seconds;
    let error: fn(&Expected) -> f64 = |p| p.error.rms;
    let (found, otherwise) = match target {
        Target::Error(most) => (least(seconds, &|p| good_enough(p, most)), least(error, &all)),
        Target::Seconds(most) => {
            (least(error, &|p| spent + p.seconds <= PLAN_TIME_PART * most), least(seconds, &all))
        }
    };
    (found.or(otherwise).expect("exact rays are always a plan"), found.is_some())
}

#[cfg(test)]
mod tests;
