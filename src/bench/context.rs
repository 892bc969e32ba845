//! Data and engines that all rows of a run share, and the timed rows of both engines over the receiver points.

use super::audit::{AUDIT_RAYS, AuditRays};
use super::exact_reference::ExactReference;
use super::measure::{MrRun, Queries, Run, Timer, WARM_UP_PAIRS, rounds};
use super::options::BenchOptions;
use super::record::{ExactRow, MrRow};
use super::sample::Sample;
use super::workload::Workload;
use crate::Result;
use crate::embree::Traversal;
use crate::model::Model;
use crate::progress::{Progress, go_on, timed};
use crate::scene::Scene;
use crate::visibility::{Exact, MultiResolution, Route, fastest_traversal};
use std::time::Duration;

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
    /// Engine of the row. With exact rays the row takes the answers of the exact row with as many rays, and the time of the
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

    pub fn reference(&self, stage: &str, queries: Queries, rays: usize) -> ExactReference {
        self.progress.stage(stage, 2 * queries.pairs.len() as u64);
        let exact = self.embree(queries.workload, rays);
        ExactReference::trace(queries, &exact, rays, [1, 2], &|n| self.progress.advance(n as u64))
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

/// Rows and the reference that gives their errors.
pub(super) struct Measured {
    pub reference: ExactReference,
    pub exact: Vec<ExactRow>,
    /// Exact rows with certificates.
    pub certified: Vec<ExactRow>,
    pub mr: Vec<MrRow>,
    /// Number of runs of each row.
    pub rounds: usize,
}

impl Bench<'_> {
    /// Measures all rows over receiver points. A further round of the rows starts only if it is expected to end within `max_time`.
    pub fn points(
        &self,
        queries: Queries,
        engine: &MultiResolution,
        sample: &Sample,
        max_time: Duration,
    ) -> Measured {
        let pairs = queries.pairs.len() as u64;
        let reference = self.reference("reference", queries, self.options.reference_rays);
        let audit = self.audit(queries);
        self.progress.stage("choosing", 0);
        let (mut exact, mut calls) = (Vec::new(), Vec::new());
        for rays in self.exact_rays() {
            let (engine, setup_s) = self.embree_timed(queries.workload, rays);
            let (mode, coherent) = (format!("occluded{}", engine.traversal.width), engine.traversal.coherent);
            exact.push(ExactRow { rays, mode, coherent, setup_s, ..Default::default() });
            calls.push((rays, engine));
        }
        let row = |rays| ExactRow { rays, mode: "certified".into(), ..Default::default() };
        let mut certified: Vec<ExactRow> = self.certified_rays(sample, engine).into_iter().map(row).collect();
        let asked = self.decisions(sample, engine);
        let mut rows: Vec<MrRow> = asked.iter().map(PlannedRow::row).collect();

        let runs = PlannedRow::runs(&asked);
        let all_rays: usize = calls.iter().map(|call| call.0).sum::<usize>()
            + certified.iter().map(|row| row.rays).sum::<usize>()
            + runs.iter().map(|run| rows[run[0]].rays).sum::<usize>();
        self.progress.stage("both engines", pairs * all_rays as u64);
        let (first_certified, first_mr) = (exact.len(), exact.len() + certified.len());
        let timed = rounds(self.options.rounds, max_time, first_mr + runs.len(), |k, first| {
            if k < first_certified {
                let (rays, engine) = (calls[k].0, &calls[k].1);
                let run = self.exact(queries, engine, rays, first);
                exact[k].evaluate(first, &reference, &run);
                for (row, _) in
                    rows.iter_mut().zip(&asked).filter(|(r, a)| first && r.rays == rays && !a.pays())
                {
                    row.evaluate(&reference, audit.as_ref(), &MrRun::handed_over(run.clone(), rays));
                }
                run.sections
            } else if k < first_mr {
                let row = &mut certified[k - first_certified];
                let run = self.certified(queries, engine, row.rays, first).run;
                row.evaluate(first, &reference, &run);
                run.sections
            } else {
                let run = &runs[k - first_mr];
                let result = self.mr(queries, engine, &asked[run[0]], first);
                for &k in run.iter().filter(|_| first) {
                    rows[k].evaluate(&reference, audit.as_ref(), &result);
                }
                result.run.sections
            }
        });
        let mut seconds = timed.seconds.iter().copied();
        exact.iter_mut().chain(&mut certified).zip(&mut seconds).for_each(|(row, s)| row.seconds = s);
        rows.iter_mut()
            .zip(&asked)
            .filter(|(_, a)| !a.pays())
            .for_each(|(row, _)| row.take_time(&exact, &certified));
        for (run, seconds) in runs.iter().zip(seconds) {
            run.iter().for_each(|&k| rows[k].seconds = seconds);
        }
        rows.iter_mut().for_each(|row| row.compare(&exact, &certified));
        Measured { reference, exact, certified, mr: rows, rounds: timed.rounds }
    }
}

impl ExactRow {
    /// Computes the errors of the first run.
    fn evaluate(&mut self, first: bool, reference: &ExactReference, run: &Run) {
        if first {
            (self.rms, self.bias) = reference.errors(&run.visible);
        }
    }
}

impl MrRow {
    /// Takes the time of exact rays with as many segments, with certificates if these took less: they see the same.
    fn take_time(&mut self, exact: &[ExactRow], certified: &[ExactRow]) {
        let as_many = exact.iter().chain(certified).filter(|row| row.rays == self.rays);
        self.seconds = as_many.map(|row| row.seconds).min_by(f64::total_cmp).unwrap_or(0.0);
    }

    /// Computes errors, interval coverage and cost fractions of a run.
    fn evaluate(&mut self, reference: &ExactReference, audit: Option<&AuditRays>, result: &MrRun) {
        let cost = result.cost;
        let segments = cost.segments.max(1) as f64;
        (self.rms, self.bias) = reference.errors(&result.run.visible);
        self.interval_coverage = reference.coverage(&result.run.visible, &result.intervals);
        self.audit = audit.map(|audit| audit.evaluate(result));
        self.aggregated_fraction = cost.aggregated as f64 / segments;
        self.certified_fraction = cost.certified as f64 / segments;
        self.exact_rays = cost.exact_rays;
        self.handed_over = cost.handed_over as f64 / segments;
        self.nodes_per_segment = cost.nodes as f64 / segments;
    }
}
