//! The rows of a run: both engines over the receiver points, timed.

use super::audit::{Audit, RAYS};
use super::measure::{MrRun, Questions, Run, Timer};
use super::options::Options;
use super::prepare::timed;
use super::record::{ExactRow, MrRow, interpolate_log_log};
use super::reference::Reference;
use super::rounds::rounds;
use super::sample::Sample;
use super::unbiased::SEGMENTS;
use super::workload::Workload;
use crate::embree::Traversal;
use crate::model::Model;
use crate::progress::Progress;
use crate::ray::Packet;
use crate::scene::Scene;
use crate::visibility::{Exact, MultiResolution, fastest_traversal};

/// Rays of the exact rows.
const EXACT_RAYS: [usize; 5] = [1, 4, 16, 64, 256];
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
    /// How often each row was run.
    pub rounds: usize,
}

/// A multi-resolution row as it is asked.
pub(super) struct Asked {
    /// Feature size and segments.
    pub s: f64,
    pub rays: usize,
    /// Whether a sample of the bundles says that the engine pays. If not the row is handed over whole: it asks what the
    /// exact row of as many rays asks, so it is that row, with its answers and its time.
    pub pays: bool,
    /// Seconds of deciding that.
    pub decide_s: f64,
}

impl Asked {
    /// A row without figures.
    fn row(&self) -> MrRow {
        MrRow { feature_size: self.s, rays: self.rays, decide_s: self.decide_s, ..Default::default() }
    }
}

/// What all rows of a run share.
pub(super) struct Bench<'a> {
    pub model: &'a Model,
    pub scene: &'a Scene,
    pub options: &'a Options,
    pub timer: Timer,
    pub sizes: Vec<f64>,
    pub progress: &'a dyn Progress,
}

impl Bench<'_> {
    /// Numbers of segments of the multi-resolution rows.
    pub fn mr_rays(&self) -> Vec<usize> {
        self.options.mr_rays()
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
        fastest_traversal(self.model.traced(), self.model.native_width(), &sample)
    }

    /// Embree as it traces so many rays a pair fastest.
    pub fn embree(&self, workload: &Workload, rays: usize) -> Exact {
        Exact { scene: self.model.traced().clone(), traversal: self.traversal(workload, rays) }
    }

    pub fn reference(&self, stage: &str, questions: Questions, rays: usize) -> Reference {
        self.progress.stage(stage, 2 * questions.pairs.len() as u64);
        let exact = self.embree(questions.workload, rays);
        Reference::trace(questions, &exact, rays, [1, 2], &|n| self.progress.advance(n as u64))
    }

    /// Embree as it traces so many rays a pair fastest, and the seconds that it took to find out.
    pub fn embree_timed(&self, workload: &Workload, rays: usize) -> (Exact, f64) {
        let mut seconds = 0.0;
        let exact = timed(&mut seconds, || self.embree(workload, rays));
        (exact, seconds)
    }

    /// A run of an exact row, after an untimed one of a few pairs.
    pub fn exact(&self, questions: Questions, engine: &Exact, rays: usize, first: bool) -> Run {
        self.timer.exact(questions.first(WARM_UP), engine, rays, &|_| ());
        self.timer.exact(questions, engine, rays, &self.advance(first, rays))
    }

    /// A run of a multi-resolution row, likewise.
    pub fn mr(&self, questions: Questions, engine: &MultiResolution, row: &Asked, first: bool) -> MrRun {
        let (s, rays) = (row.s as f32, row.rays);
        self.timer.multi_resolution(questions.first(WARM_UP), engine, s, rays, &|_| ());
        self.timer.multi_resolution(questions, engine, s, rays, &self.advance(first, rays))
    }

    /// A run of a row of exact rays with certificates, likewise.
    fn certified(&self, questions: Questions, engine: &MultiResolution, rays: usize, first: bool) -> MrRun {
        self.timer.certified(questions.first(WARM_UP), engine, rays, &|_| ());
        self.timer.certified(questions, engine, rays, &self.advance(first, rays))
    }

    /// Decides on a sample of the bundles whether the engine pays at a feature size.
    pub fn decide(&self, sample: &Sample, engine: &MultiResolution, s: f64, rays: usize) -> Asked {
        let mut decide_s = 0.0;
        let pays = timed(&mut decide_s, || sample.pays(engine, s as f32, rays));
        Asked { s, rays, pays, decide_s }
    }

    /// The decisions for all rows, in their order.
    pub fn decisions(&self, sample: &Sample, engine: &MultiResolution) -> Vec<Asked> {
        let rows = self.mr_rays().into_iter().flat_map(|rays| self.sizes.iter().map(move |&s| (s, rays)));
        rows.map(|(s, rays)| self.decide(sample, engine, s, rays)).collect()
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
    pub fn points(&self, questions: Questions, engine: &MultiResolution, sample: &Sample) -> Measured {
        let pairs = questions.pairs.len() as u64;
        let reference = self.reference("reference", questions, self.options.reference_rays);
        let audit = self.audit(questions);
        self.progress.stage("choosing", 0);
        let (mut exact, mut calls) = (Vec::new(), Vec::new());
        for rays in self.exact_rays() {
            let (engine, setup_s) = self.embree_timed(questions.workload, rays);
            let (mode, coherent) = (format!("occluded{}", engine.traversal.width), engine.traversal.coherent);
            exact.push(ExactRow { rays, mode, coherent, setup_s, ..Default::default() });
            calls.push((rays, engine));
        }
        let row = |rays| ExactRow { rays, mode: "certified".into(), ..Default::default() };
        let mut certified: Vec<ExactRow> = self.mr_rays().into_iter().map(row).collect();
        let asked = self.decisions(sample, engine);
        let mut rows: Vec<MrRow> = asked.iter().map(Asked::row).collect();

        let walked: Vec<usize> = (0..rows.len()).filter(|&k| asked[k].pays).collect();
        let all_rays: usize = calls.iter().map(|call| call.0).sum::<usize>()
            + self.mr_rays().iter().sum::<usize>()
            + walked.iter().map(|&k| rows[k].rays).sum::<usize>();
        self.progress.stage("both engines", pairs * all_rays as u64);
        let (first_certified, first_mr) = (exact.len(), exact.len() + certified.len());
        let timed = rounds(first_mr + walked.len(), |k, first| {
            if k < first_certified {
                let (rays, engine) = (calls[k].0, &calls[k].1);
                let run = self.exact(questions, engine, rays, first);
                exact[k].judge(first, &reference, &run);
                for (row, _) in
                    rows.iter_mut().zip(&asked).filter(|(r, a)| first && r.rays == rays && !a.pays)
                {
                    row.judge(&reference, audit.as_ref(), &MrRun::handed_over(run.clone(), rays));
                }
                run.sections
            } else if k < first_mr {
                let row = &mut certified[k - first_certified];
                let run = self.certified(questions, engine, row.rays, first).run;
                row.judge(first, &reference, &run);
                run.sections
            } else {
                let k = walked[k - first_mr];
                let result = self.mr(questions, engine, &asked[k], first);
                if first {
                    rows[k].judge(&reference, audit.as_ref(), &result);
                }
                result.run.sections
            }
        });
        let mut seconds = timed.seconds.iter().copied();
        exact.iter_mut().chain(&mut certified).zip(&mut seconds).for_each(|(row, s)| row.seconds = s);
        let curve = curve(&exact);
        for (row, asked) in rows.iter_mut().zip(&asked) {
            let as_many = exact.iter().find(|e| e.rays == row.rays).map_or(0.0, |e| e.seconds);
            row.seconds = if asked.pays { seconds.next().unwrap_or(0.0) } else { as_many };
            let same_rms = interpolate_log_log(&curve, row.rms);
            row.speedup_per_segment = ratio(as_many, row.seconds).unwrap_or(0.0);
            row.speedup_at_same_rms = same_rms.and_then(|t| ratio(t.seconds, row.seconds));
            row.extrapolated = same_rms.is_some_and(|t| t.extrapolated);
        }
        Measured { reference, exact, certified, mr: rows, rounds: timed.rounds }
    }

    /// The audit's own rays, if one was asked for.
    pub fn audit(&self, questions: Questions) -> Option<Audit> {
        (self.options.audit > 0.0).then(|| {
            self.progress.stage("audit", 0);
            Audit::trace(
                questions,
                &self.embree(questions.workload, RAYS),
                self.options.audit,
                self.options.seed,
            )
        })
    }
}

impl ExactRow {
    /// Notes what a first run's answers are worth.
    fn judge(&mut self, first: bool, reference: &Reference, run: &Run) {
        if first {
            (self.rms, self.bias) = reference.errors(&run.visible);
        }
    }
}

impl MrRow {
    /// Notes what a run's answers are worth and what they rest on.
    fn judge(&mut self, reference: &Reference, audit: Option<&Audit>, result: &MrRun) {
        let cost = result.cost;
        let segments = cost.segments.max(1) as f64;
        (self.rms, self.bias) = reference.errors(&result.run.visible);
        self.interval_coverage = reference.coverage(&result.run.visible, &result.intervals);
        self.audit = audit.map(|audit| audit.judge(result));
        self.aggregated_fraction = cost.aggregated as f64 / segments;
        self.certified_fraction = cost.certified as f64 / segments;
        self.exact_rays = cost.exact_rays;
        self.handed_over = cost.handed_over as f64 / segments;
        self.nodes_per_segment = cost.nodes as f64 / segments;
    }
}

/// Seconds and errors of exact rows: what speed-ups are measured against.
pub(super) fn curve(rows: &[ExactRow]) -> Vec<(f64, f64)> {
    rows.iter().map(|row| (row.seconds, row.rms)).collect()
}

/// `a / b` if that is a number.
pub(super) fn ratio(a: f64, b: f64) -> Option<f64> {
    let ratio = a / b;
    ratio.is_finite().then_some(ratio)
}
