//! The rows of a run: both engines over the receiver points, timed.

use super::audit::{Audit, RAYS};
use super::measure::{MrRun, Questions, Run, Timer, pays};
use super::options::{MAX_RAYS, Options};
use super::progress::Progress;
use super::record::{ExactRow, MrRow, interpolate_log_log};
use super::reference::Reference;
use super::unbiased::SEGMENTS;
use super::workload::Workload;
use crate::embree::{CommittedScene, Traversal};
use crate::ray::Packet;
use crate::scene::Scene;
use crate::visibility::{Exact, MultiResolution, fastest_traversal};
use std::time::Instant;

/// Rays of the exact rows.
const EXACT_RAYS: [usize; 5] = [1, 4, 16, 64, 256];
/// Multi-resolution rows have this many times the segments asked for.
const MR_FACTORS: [usize; 3] = [1, 4, 16];
/// Rows faster than this many seconds are run again, this often in all; the least time of each section counts.
const SHORT: f64 = 0.3;
const REPEATS: usize = 6;
/// Seconds after which they are not, with the time for making segments: a run shall end.
const PATIENCE: f64 = 1.0;
/// Pairs that are asked, untimed, before each timed row.
pub(super) const WARM_UP: usize = 1024;
/// Segments that a traversal is chosen on.
const TRIAL: usize = 1 << 14;

/// What the rows are judged by, and the rows.
pub(super) struct Measured {
    pub reference: Reference,
    pub exact: Vec<ExactRow>,
    /// With certificates.
    pub certified: Vec<ExactRow>,
    pub mr: Vec<MrRow>,
}

/// What all rows of a run share.
pub(super) struct Bench<'a> {
    pub scene: &'a Scene,
    pub options: &'a Options,
    pub timer: Timer,
    pub traced: &'a CommittedScene,
    /// The widest packet that Embree traces on this machine.
    pub width: usize,
    pub sizes: Vec<f64>,
    pub progress: &'a dyn Progress,
}

impl Bench<'_> {
    /// Numbers of segments of the multi-resolution rows.
    pub fn mr_rays(&self) -> Vec<usize> {
        MR_FACTORS.iter().map(|f| f * self.options.rays).filter(|&n| n <= MAX_RAYS).collect()
    }

    /// Numbers of rays of the exact rows: the fixed ones and those that multi-resolution rows are compared with.
    pub fn exact_rays(&self) -> Vec<usize> {
        let unbiased = if self.options.unbiased { &SEGMENTS[..] } else { &[] };
        let mut rays: Vec<usize> = EXACT_RAYS.iter().chain(unbiased).copied().chain(self.mr_rays()).collect();
        rays.sort_unstable();
        rays.dedup();
        rays
    }

    /// The fastest way of tracing packets like those of a row, on a sample spread over the workload.
    pub fn traversal(&self, workload: &Workload, rays: usize) -> Traversal {
        let pairs = workload.pairs.len();
        let run = (1024 / rays).clamp(1, 256).min(pairs);
        let runs = (TRIAL / (run * rays)).max(1).min(pairs.div_ceil(run));
        let (mut sample, mut part): (Vec<Packet>, Vec<Packet>) = (Vec::new(), Vec::new());
        for k in 0..runs {
            let first = (pairs - run) * k / runs;
            let pairs: Vec<usize> = (first..first + run).collect();
            workload.packed(self.scene, &pairs, rays, 0, &mut part);
            sample.append(&mut part);
        }
        fastest_traversal(self.traced, self.width, &sample)
    }

    /// Embree as it traces so many rays a pair fastest.
    pub fn embree(&self, workload: &Workload, rays: usize) -> Exact<'_> {
        Exact { scene: self.traced, traversal: self.traversal(workload, rays) }
    }

    pub fn reference(&self, stage: &str, questions: Questions, rays: usize) -> Reference {
        self.progress.stage(stage, 2 * questions.pairs.len() as u64);
        let exact = self.embree(questions.workload, rays);
        Reference::trace(questions, exact, rays, [1, 2], &|n| self.progress.advance(n as u64))
    }

    /// An exact row: warm, then the least time of one or several runs.
    pub fn exact(&self, questions: Questions, rays: usize) -> (Traversal, Run) {
        let engine = self.embree(questions.workload, rays);
        self.timer.exact(questions.first(WARM_UP), engine, rays, &|_| ());
        let run = least(
            |first| self.timer.exact(questions, engine, rays, &self.advance(first, rays)),
            |run: &mut Run| run,
        );
        (engine.traversal, run)
    }

    /// A multi-resolution row, likewise. Where a sample of the bundles says that the engine cannot pay, exact rays
    /// answer in its place.
    pub fn mr(&self, questions: Questions, engine: &MultiResolution, s: f64, rays: usize) -> MrRun {
        let s = s as f32;
        let start = Instant::now();
        let pays = pays(self.scene, questions.workload, engine, s, rays);
        let decide_s = start.elapsed().as_secs_f64();
        if !pays {
            return MrRun { decide_s, ..MrRun::handed_over(self.exact(questions, rays).1, rays) };
        }
        self.timer.multi_resolution(questions.first(WARM_UP), engine, s, rays, &|_| ());
        let run = least(
            |first| self.timer.multi_resolution(questions, engine, s, rays, &self.advance(first, rays)),
            |run: &mut MrRun| &mut run.run,
        );
        MrRun { decide_s, ..run }
    }

    /// A row of exact rays with certificates, likewise.
    fn certified(&self, questions: Questions, engine: &MultiResolution, rays: usize) -> MrRun {
        self.timer.certified(questions.first(WARM_UP), engine, rays, &|_| ());
        least(
            |first| self.timer.certified(questions, engine, rays, &self.advance(first, rays)),
            |run: &mut MrRun| &mut run.run,
        )
    }

    /// Tells the progress of a run with `rays` segments a pair, if it is the first.
    fn advance(&self, first: bool, rays: usize) -> impl Fn(usize) {
        let progress = self.progress;
        move |pairs| {
            if first {
                progress.advance((pairs * rays) as u64)
            }
        }
    }

    /// All rows over the receiver points.
    pub fn points(&self, questions: Questions, engine: &MultiResolution) -> Measured {
        let pairs = questions.pairs.len() as u64;
        let reference = self.reference("reference", questions, self.options.reference_rays);
        let audit = self.audit(questions);
        let all_rays: usize = self.exact_rays().iter().chain(&self.mr_rays()).sum();
        self.progress.stage("exact", pairs * all_rays as u64);
        let mut exact = Vec::new();
        for rays in self.exact_rays() {
            let (traversal, run) = self.exact(questions, rays);
            let (rms, bias) = reference.errors(&run.visible);
            let mode = format!("occluded{}", traversal.width);
            let coherent = traversal.coherent;
            let seconds = run.seconds();
            exact.push(ExactRow { rays, seconds, mode, coherent, rms, bias });
        }
        let mut certified = Vec::new();
        for rays in self.mr_rays() {
            let run = self.certified(questions, engine, rays).run;
            let (rms, bias) = reference.errors(&run.visible);
            let (mode, seconds) = ("certified".into(), run.seconds());
            certified.push(ExactRow { rays, seconds, mode, coherent: false, rms, bias });
        }
        let curve = curve(&exact);
        let mr_rays: usize = self.mr_rays().iter().sum();
        self.progress.stage("multi-resolution", pairs * (mr_rays * self.sizes.len()) as u64);
        let mut rows = Vec::new();
        for rays in self.mr_rays() {
            for &s in &self.sizes {
                let result = self.mr(questions, engine, s, rays);
                let seconds = result.run.seconds();
                let (rms, bias) = reference.errors(&result.run.visible);
                let same_rms = interpolate_log_log(&curve, rms);
                let cost = result.cost;
                let segments = cost.segments.max(1) as f64;
                let as_many = exact.iter().find(|row| row.rays == rays).map_or(0.0, |row| row.seconds);
                rows.push(MrRow {
                    feature_size: s,
                    rays,
                    seconds,
                    rms,
                    bias,
                    interval_coverage: reference.coverage(&result.run.visible, &result.intervals),
                    audit: audit.as_ref().map(|audit| audit.judge(&result)),
                    aggregated_fraction: cost.aggregated as f64 / segments,
                    exact_rays: cost.exact_rays,
                    handed_over: cost.handed_over as f64 / segments,
                    decide_s: result.decide_s,
                    nodes_per_segment: cost.nodes as f64 / segments,
                    speedup_per_segment: ratio(as_many, seconds).unwrap_or(0.0),
                    speedup_at_same_rms: same_rms.and_then(|t| ratio(t.seconds, seconds)),
                    speedup_at_same_fbem: None,
                    extrapolated: same_rms.is_some_and(|t| t.extrapolated),
                });
            }
        }
        Measured { reference, exact, certified, mr: rows }
    }

    /// The audit's own rays, if one was asked for.
    pub fn audit(&self, questions: Questions) -> Option<Audit> {
        (self.options.audit > 0.0).then(|| {
            self.progress.stage("audit", 0);
            Audit::trace(
                questions,
                self.embree(questions.workload, RAYS),
                self.options.audit,
                self.options.seed,
            )
        })
    }
}

/// Seconds and errors of exact rows: what speed-ups are measured against.
pub(super) fn curve(rows: &[ExactRow]) -> Vec<(f64, f64)> {
    rows.iter().map(|row| (row.seconds, row.rms)).collect()
}

/// One run or, if it is short, several, with the least times. `run` is told whether it is the first; `times` finds the
/// times in what it returns.
pub(super) fn least<R>(mut run: impl FnMut(bool) -> R, times: impl Fn(&mut R) -> &mut Run) -> R {
    let start = Instant::now();
    let mut best = run(true);
    let mut total = times(&mut best).seconds();
    for _ in 1..REPEATS {
        if total >= SHORT || start.elapsed().as_secs_f64() >= PATIENCE {
            break;
        }
        let mut again = run(false);
        let again = times(&mut again);
        total += again.seconds();
        times(&mut best).shorten(again);
    }
    best
}

/// `a / b` if that is a number.
pub(super) fn ratio(a: f64, b: f64) -> Option<f64> {
    let ratio = a / b;
    ratio.is_finite().then_some(ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_runs_are_repeated_and_the_least_times_count() {
        let run = |seconds: f64| Run { visible: Vec::new(), sections: vec![seconds] };
        let mut next = [0.04, 0.02, 0.03, 0.05, 0.06, 0.07, 0.001].into_iter();
        assert_eq!(least(|_| run(next.next().unwrap()), |r| r).seconds(), 0.02);
        let mut calls = 0;
        let long = |first: bool| {
            assert!(first);
            calls += 1;
            run(1.0)
        };
        assert_eq!(least(long, |r| r).seconds(), 1.0);
        assert_eq!(calls, 1);
    }
}
