//! Rows by class of receiver: how much MR gains depends on what lies around a receiver point.

mod surroundings;

use super::context::Bench;
use super::measure::{Queries, Timer};
use super::record::{ClassRecord, ReceiverClass};
use super::rows::Measured;
use super::workload::{ReceiverPoint, Workload};
use crate::Result;
use crate::visibility::{MultiResolution, Workspace};
use std::time::Duration;
use surroundings::Surroundings;

/// Fewest points of a class that are measured: a share of them is known to √(¼ / 50) = 7 %.
const MIN_POINTS: usize = 50;
/// Most points of a class that are measured, evenly chosen along the curve: four classes take less than half of the time of the default
/// 20,000 points.
const MAX_POINTS: usize = 2_000;
/// A further round of the rows of a class starts only if it is expected to end within this time.
const MAX_TIME: Duration = Duration::from_secs(3);

impl Bench<'_> {
    /// Rows of each class that has points, in the order of [`ReceiverClass::ALL`]. `whole` are the rows over all points, which are those
    /// of the class if there is only one.
    pub fn classes(
        &self,
        workload: &Workload,
        engine: &MultiResolution,
        whole: &Measured,
    ) -> Result<Vec<ClassRecord>> {
        self.go_on()?;
        self.progress.stage("classes", ReceiverClass::ALL.len() as u64);
        let points = workload.facing_points();
        let found = Surroundings::of(self.model).classes(&points, self.options.seed);
        let of = |class| -> Vec<ReceiverPoint> {
            points.iter().zip(&found).filter(|(_, of)| **of == class).map(|(point, _)| *point).collect()
        };
        if let Some(&class) = found.first().filter(|first| found.iter().all(|class| class == *first)) {
            let Measured { reference, exact, certified, mr, .. } = whole;
            return Ok(vec![ClassRecord {
                class,
                points: points.len(),
                measured: points.len(),
                reference_rms: reference.standard_error(),
                exact: exact.clone(),
                certified: certified.clone(),
                mr: mr.clone(),
            }]);
        }
        let timer = Timer::new(self.options.threads)?;
        // The stages of each class are not shown.
        let bench = Bench { timer, sizes: self.sizes.clone(), progress: &(), ..*self };
        let mut classes = Vec::new();
        for class in ReceiverClass::ALL {
            self.go_on()?;
            let points = of(class);
            if points.len() >= MIN_POINTS {
                classes.push(bench.class(class, &points, engine));
            }
            self.progress.advance(1);
        }
        Ok(classes)
    }

    /// Measures the rows of one class; their routes are decided on a sample of the class.
    fn class(&self, class: ReceiverClass, points: &[ReceiverPoint], engine: &MultiResolution) -> ClassRecord {
        let measured = points.len().min(MAX_POINTS);
        let chosen = (0..measured).map(|k| points[k * points.len() / measured]).collect();
        let workload = Workload::new(self.model, chosen, self.options.seed ^ 0x63_6c61_7373_6573);
        let every: Vec<usize> = (0..workload.pairs.len()).collect();
        let queries = Queries { scene: self.scene, workload: &workload, pairs: &every };
        let sample = self.sample(&workload);
        let engine = engine.clone().with_budget(&sample.bundles(1).concat(), &mut Workspace::default());
        let Measured { reference, exact, certified, mr, .. } =
            self.points(queries, &engine, &sample, MAX_TIME);
        let (points, reference_rms) = (points.len(), reference.standard_error());
        ClassRecord { class, points, measured, reference_rms, exact, certified, mr }
    }
}

impl Workload {
    /// The points that face an emitter, in order.
    fn facing_points(&self) -> Vec<ReceiverPoint> {
        let mut facing: Vec<u32> = self.pairs.iter().map(|pair| pair.point).collect();
        facing.dedup();
        facing.into_iter().map(|point| self.points[point as usize]).collect()
    }
}

#[cfg(test)]
mod tests;
