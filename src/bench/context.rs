//! Data and engines that all rows of a run share.

use super::audit::{AUDIT_RAYS, AuditRays};
use super::measure::{MrRun, Queries, Run, Timer, WARM_UP_PAIRS};
use super::options::BenchOptions;
use super::record::MrRow;
use super::reference::Reference;
use super::sample::Sample;
use super::workload::Workload;
use crate::Result;
use crate::embree::Traversal;
use crate::model::Model;
use crate::progress::{Progress, go_on, timed};
use crate::scene::Scene;
use crate::visibility::{Exact, MultiResolution, Route, fastest_traversal};

/// Numbers of rays of the exact rows: steps of 4 halve the error, and 256 rays bracket the errors of the MR rows, so
/// that times at equal error are interpolated.
pub(super) const EXACT_RAYS: [usize; 5] = [1, 4, 16, 64, 256];
/// Segments on which Embree's ray calls are timed: limits the trial to 16,384 segments per call. Selects the fastest
/// call; results are the same.
const TRIAL_SEGMENTS: usize = 1 << 14;

/// A multi-resolution row to be measured.
#[derive(Clone, Copy)]
pub(super) struct PlannedRow {
    /// Feature size, scene units.
    pub s: f64,
    pub rays: usize,
    /// What answers bundles. With exact rays the row takes the answers of the exact row with as many rays, and the time of the
    /// faster one of exact rays with and without certificates.
    pub route: Route,
    /// Time of that decision, seconds.
    pub decide_s: f64,
}

impl PlannedRow {
    /// Whether the engine is estimated to be faster than exact rays.
    pub fn pays(&self) -> bool {
        self.route != Route::Exact
    }

    /// Whether the engine averages.
    pub fn averages(&self) -> bool {
        self.pays() && self.route != Route::Certified
    }

    /// Name of the route: the cut, walks of bundles, or exact rays with or without certificates.
    pub fn route_name(&self) -> &'static str {
        match self.route {
            Route::Cut(_) => "cut",
            Route::Walks { .. } => "bundle",
            Route::Exact => "embree",
            Route::Certified => "certified",
        }
    }

    /// Whether this row has the answers of another one: those of the distance cut and of exact rays do not depend on the feature size.
    fn is_answered_as(&self, other: &Self) -> bool {
        matches!(self.route, Route::Cut(_) | Route::Certified)
            && (self.route, self.rays) == (other.route, other.rays)
    }

    /// Indices of the rows that MR answers, those with the same answers together.
    pub fn runs(rows: &[Self]) -> Vec<Vec<usize>> {
        let mut runs: Vec<Vec<usize>> = Vec::new();
        for (k, row) in rows.iter().enumerate().filter(|(_, row)| row.pays()) {
            match runs.iter_mut().find(|run| row.is_answered_as(&rows[run[0]])) {
                Some(run) => run.push(k),
                None => runs.push(vec![k]),
            }
        }
        runs
    }

    /// A row without results.
    pub fn row(&self) -> MrRow {
        let route = self.route_name().into();
        MrRow { feature_size: self.s, rays: self.rays, route, decide_s: self.decide_s, ..Default::default() }
    }
}

/// Data that all rows of a run share.
pub(super) struct Bench<'a> {
    pub model: &'a Model,
    pub scene: &'a Scene,
    pub options: &'a BenchOptions,
    pub timer: Timer,
    pub sizes: Vec<f64>,
    pub progress: &'a dyn Progress,
}

impl Bench<'_> {
    /// # Errors
    /// The caller wants the run to stop.
    pub fn go_on(&self) -> Result<()> {
        go_on(self.progress, "the benchmark was")
    }

    /// Numbers of segments of the MR rows.
    pub fn mr_rays(&self) -> Vec<usize> {
        self.options.mr_rays()
    }

    /// Numbers of rays of the exact rows: the fixed ones and those that MR rows are compared with.
    pub fn exact_rays(&self) -> Vec<usize> {
        let mut rays: Vec<usize> = EXACT_RAYS.into_iter().chain(self.mr_rays()).collect();
        rays.sort_unstable();
        rays.dedup();
        rays
    }

    /// Embree's fastest ray call for packets like those of a row, timed on a sample of the workload.
    pub fn traversal(&self, workload: &Workload, rays: usize) -> Traversal {
        let pairs = workload.pairs.len();
        let run = (1024 / rays).clamp(1, 256).min(pairs);
        let runs = (TRIAL_SEGMENTS / (run * rays)).max(1).min(pairs.div_ceil(run));
        let mut sample = Vec::new();
        for k in 0..runs {
            let first = (pairs - run) * k / runs;
            let pairs: Vec<usize> = (first..first + run).collect();
            workload.pack(self.scene, &pairs, rays, 0, &mut sample);
        }
        fastest_traversal(self.model.traced(), self.model.native_width(), &sample)
    }

    /// The exact engine with the fastest ray call for this number of rays per pair.
    pub fn embree(&self, workload: &Workload, rays: usize) -> Exact {
        Exact { scene: self.model.traced().clone(), traversal: self.traversal(workload, rays) }
    }

    pub fn reference(&self, stage: &str, queries: Queries, rays: usize) -> Reference {
        self.progress.stage(stage, 2 * queries.pairs.len() as u64);
        let exact = self.embree(queries.workload, rays);
        Reference::trace(queries, &exact, rays, [1, 2], &|n| self.progress.advance(n as u64))
    }

    /// [`Bench::embree`], and the time that choosing the call took, seconds.
    pub fn embree_timed(&self, workload: &Workload, rays: usize) -> (Exact, f64) {
        let mut seconds = 0.0;
        let exact = timed(&mut seconds, || self.embree(workload, rays));
        (exact, seconds)
    }

    /// Runs an exact row, after an untimed warm-up on a few pairs.
    pub fn exact(&self, queries: Queries, engine: &Exact, rays: usize, first: bool) -> Run {
        self.timer.exact(queries.first(WARM_UP_PAIRS), engine, rays, &|_| ());
        self.timer.exact(queries, engine, rays, &self.advance(first, rays))
    }

    /// Runs an MR row, after an untimed warm-up.
    pub fn mr(&self, queries: Queries, engine: &MultiResolution, row: &PlannedRow, first: bool) -> MrRun {
        let (s, rays) = (row.s as f32, row.rays);
        let engine = &engine.with_route(row.route);
        self.timer.multi_resolution(queries.first(WARM_UP_PAIRS), engine, s, rays, &|_| ());
        self.timer.multi_resolution(queries, engine, s, rays, &self.advance(first, rays))
    }

    /// Runs a row of exact rays with certificates, after an untimed warm-up.
    pub fn certified(&self, queries: Queries, engine: &MultiResolution, rays: usize, first: bool) -> MrRun {
        self.timer.certified(queries.first(WARM_UP_PAIRS), engine, rays, &|_| ());
        self.timer.certified(queries, engine, rays, &self.advance(first, rays))
    }

    /// Decides on a sample of the bundles whether MR is faster than exact rays at feature size `s`.
    pub fn decide(&self, sample: &Sample, engine: &MultiResolution, s: f64, rays: usize) -> PlannedRow {
        let mut decide_s = 0.0;
        let route = timed(&mut decide_s, || sample.route(engine, s as f32, rays));
        PlannedRow { s, rays, route, decide_s }
    }

    /// The decisions for all MR rows, in order.
    pub fn decisions(&self, sample: &Sample, engine: &MultiResolution) -> Vec<PlannedRow> {
        let rows = self.mr_rays().into_iter().flat_map(|rays| self.sizes.iter().map(move |&s| (s, rays)));
        rows.map(|(s, rays)| self.decide(sample, engine, s, rays)).collect()
    }

    /// Numbers of segments of the rows of exact rays with certificates: those for which certificates may pay.
    pub fn certified_rays(&self, sample: &Sample, engine: &MultiResolution) -> Vec<usize> {
        self.mr_rays().into_iter().filter(|&rays| sample.certifies(engine, rays)).collect()
    }

    /// Callback that reports progress of the first run of a row, with `rays` segments per pair.
    fn advance(&self, first: bool, rays: usize) -> impl Fn(usize) {
        let progress = self.progress;
        move |pairs| {
            if first {
                progress.advance((pairs * rays) as u64)
            }
        }
    }

    /// Traces the rays of the audit, if one was asked for.
    pub fn audit(&self, queries: Queries) -> Option<AuditRays> {
        (self.options.audit > 0.0).then(|| {
            self.progress.stage("audit", 0);
            AuditRays::trace(
                queries,
                &self.embree(queries.workload, AUDIT_RAYS),
                self.options.audit,
                self.options.seed,
            )
        })
    }
}
