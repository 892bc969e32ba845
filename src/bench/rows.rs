//! Timed rows of both engines over the receiver points.

use super::audit::AuditRays;
use super::context::{Bench, PlannedRow};
use super::measure::{MrRun, Queries, Run, rounds};
use super::record::{ExactRow, MrRow};
use super::reference::Reference;
use super::sample::Sample;
use crate::visibility::MultiResolution;
use std::time::Duration;

/// Rows and the reference that gives their errors.
pub(super) struct Measured {
    pub reference: Reference,
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
    fn evaluate(&mut self, first: bool, reference: &Reference, run: &Run) {
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
    fn evaluate(&mut self, reference: &Reference, audit: Option<&AuditRays>, result: &MrRun) {
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
