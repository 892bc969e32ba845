//! What all rows of a run share: the model, its options, the engines and the timer.

use super::audit::{AUDIT_RAYS, Audit};
use super::measure::{MrRun, Questions, Run, Timer};
use super::options::Options;
use super::pilot::UNBIASED_SEGMENTS;
use super::record::MrRow;
use super::reference::Reference;
use super::rounds::{WARM_UP_PAIRS, timed};
use super::sample::Sample;
use super::workload::Workload;
use crate::embree::Traversal;
use crate::model::Model;
use crate::progress::Progress;
use crate::ray::Packet;
use crate::scene::Scene;
use crate::visibility::{Exact, MultiResolution, fastest_traversal};

/// Rays of the exact rows.
const EXACT_RAYS: [usize; 5] = [1, 4, 16, 64, 256];
/// Segments that a traversal is chosen on.
const TRIAL_SEGMENTS: usize = 1 << 14;

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
    pub fn row(&self) -> MrRow {
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
        let unbiased = if self.options.unbiased { &UNBIASED_SEGMENTS[..] } else { &[] };
        let mut rays: Vec<usize> = EXACT_RAYS.iter().chain(unbiased).copied().chain(self.mr_rays()).collect();
        rays.sort_unstable();
        rays.dedup();
        rays
    }

    /// The fastest way of tracing packets like those of a row, on a sample spread over the workload.
    pub fn traversal(&self, workload: &Workload, rays: usize) -> Traversal {
        let pairs = workload.pairs.len();
        let run = (1024 / rays).clamp(1, 256).min(pairs);
        let runs = (TRIAL_SEGMENTS / (run * rays)).max(1).min(pairs.div_ceil(run));
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
        self.timer.exact(questions.first(WARM_UP_PAIRS), engine, rays, &|_| ());
        self.timer.exact(questions, engine, rays, &self.advance(first, rays))
    }

    /// A run of a multi-resolution row, likewise.
    pub fn mr(&self, questions: Questions, engine: &MultiResolution, row: &Asked, first: bool) -> MrRun {
        let (s, rays) = (row.s as f32, row.rays);
        self.timer.multi_resolution(questions.first(WARM_UP_PAIRS), engine, s, rays, &|_| ());
        self.timer.multi_resolution(questions, engine, s, rays, &self.advance(first, rays))
    }

    /// A run of a row of exact rays with certificates, likewise.
    pub fn certified(
        &self,
        questions: Questions,
        engine: &MultiResolution,
        rays: usize,
        first: bool,
    ) -> MrRun {
        self.timer.certified(questions.first(WARM_UP_PAIRS), engine, rays, &|_| ());
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

    /// The audit's own rays, if one was asked for.
    pub fn audit(&self, questions: Questions) -> Option<Audit> {
        (self.options.audit > 0.0).then(|| {
            self.progress.stage("audit", 0);
            Audit::trace(
                questions,
                &self.embree(questions.workload, AUDIT_RAYS),
                self.options.audit,
                self.options.seed,
            )
        })
    }
}
