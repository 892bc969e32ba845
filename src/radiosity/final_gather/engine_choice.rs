//! Choice between the distance cut and other engines for the direct light of points.
//!
//! A sample of few points queries an emitter by each engine, as all points will. The cut is chosen if it needs less work for the same
//! error, and if its error is no larger than the tolerance of the visible fraction, which the model error of the cut may exceed.

use super::direct_light::EmitterView;
use super::gather_point::GatherPoint;
use super::gatherer::FinalGather;
use crate::math::sampling::mix;
use crate::radiosity::elements::Shape;
use crate::radiosity::links::{Scratch, VisibilityEngine, VisibilityQuery};
use crate::visibility::{DistanceCut, LeafMode, rays_for, sample_runs};
use glam::Vec3;
use std::sync::Arc;

/// Smallest number of points for which the cut is built: with exact rays, these points and those of [`TRIANGLES_PER_POINT`] take about
/// twice the time of building it, 1 s on each of two processors for the garden of `make scenes` and 6 s for its park of 1.9 million
/// triangles.
const MIN_CUT_POINTS: usize = 1 << 14;
/// Number of triangles for which this number of points is larger by one.
const TRIANGLES_PER_POINT: usize = 16;
/// The cut is chosen up to this ratio of its work to the work of exact rays for the same error: work is an estimate, and mean squares
/// of 256 points are known to about a tenth.
const MAX_WORK_RATIO: f64 = 0.8;

/// Results of a sample of points for one emitter and one engine.
struct Trial {
    /// Number of segments.
    segments: f64,
    /// Visible fractions, in the order of the points.
    visible: Vec<f64>,
}

impl FinalGather<'_> {
    /// The distance cut, if there are enough points to repay building it, time is not limited, and visibility is multi-resolution.
    pub(super) fn cut_for(&self, points: usize) -> Option<Arc<DistanceCut>> {
        match &self.linked.engine {
            VisibilityEngine::MultiResolution(engine) if engine.leaf() == LeafMode::Exact => {}
            _ => return None,
        }
        let enough = MIN_CUT_POINTS + self.scene.triangles.len() / TRIANGLES_PER_POINT;
        (self.may_build_cut && points >= enough).then(|| self.model.cut()).flatten()
    }

    /// The engine for rays from elements to emitters: the rays of a leaf all end on one emitter only if the scene has a single emitter.
    pub(super) fn engine_of_elements(&self) -> VisibilityEngine {
        let elements = &self.linked.elements;
        if self.emitters.emitters.len() != 1 {
            return self.linked.engine.scattered();
        }
        let centre = |leaf: u32| {
            let element = &elements.elements[leaf as usize];
            let Shape::Surface { side, .. } = element.shape else { unreachable!("leaves are surfaces") };
            (element.centre, elements.sides[side as usize].normal)
        };
        let centres: Vec<(Vec3, Vec3)> = self.linked.leaves().into_iter().map(centre).collect();
        self.engines(&centres, None).swap_remove(0)
    }

    /// By emitter, the visibility engine for points like these, which may use the cut.
    pub(super) fn engines(
        &self,
        points: &[(Vec3, Vec3)],
        cut: Option<Arc<DistanceCut>>,
    ) -> Vec<VisibilityEngine> {
        let point = |i: usize| {
            let (at, normal) = points[i];
            self.gather_point(at, normal, mix(i as u64))
        };
        let runs: Vec<Vec<GatherPoint>> =
            sample_runs(points.len()).map(|run| run.map(point).collect()).collect();
        let cut = self.engines_by_cut(cut);
        let of = |emitter: usize| {
            let queries = |sample: &Vec<GatherPoint>| -> Vec<VisibilityQuery> {
                let views = self.emitter_views(sample, emitter);
                views.iter().map(|view| self.shadow_rays(view, emitter, 0).0).collect()
            };
            let engine = self.linked.engine.for_queries(runs.iter().map(queries));
            self.fastest(engine, &cut, &runs.concat(), emitter)
        };
        (0..self.emitters.emitters.len()).map(of).collect()
    }

    /// The engines by the distance cut, with the work of a segment over that of exact rays; none unless visibility is multi-resolution.
    fn engines_by_cut(&self, cut: Option<Arc<DistanceCut>>) -> Vec<(VisibilityEngine, f64)> {
        let VisibilityEngine::MultiResolution(engine) = &self.linked.engine else { return Vec::new() };
        let engine = (**engine).clone().with_cut(cut);
        engine.by_cut().map(|(by, work)| (VisibilityEngine::MultiResolution(Arc::new(by)), work)).collect()
    }

    /// The engine that needs the least work for a given error of an emitter's visible fraction at points like those of a sample: `other`,
    /// or one of the engines by the cut.
    fn fastest(
        &self,
        other: VisibilityEngine,
        cut: &[(VisibilityEngine, f64)],
        sample: &[GatherPoint],
        emitter: usize,
    ) -> VisibilityEngine {
        if cut.is_empty() {
            return other;
        }
        let exact = VisibilityEngine::Exact(self.linked.engine.exact());
        let mut scratch = Scratch::default();
        // Different seeds give the points different rays.
        let mut reference = [1, 2].map(|half| {
            let seeded = sample.iter().map(|point| GatherPoint { seed: mix(point.seed ^ half), ..*point });
            self.trial(&exact, &seeded.collect::<Vec<_>>(), emitter, &mut scratch).visible
        });
        let first = self.trial(&exact, sample, emitter, &mut scratch);
        let [a, b] = &mut reference;
        let n = first.visible.len().max(1) as f64;
        let noise: f64 = a.iter().zip(&*b).map(|(a, b)| 0.25 * (a - b).powi(2)).sum::<f64>() / n;
        // The noise of the halves is independent: the mean product has no bias. The result is at least its standard error.
        let square = |trial: &Trial| {
            let products = trial.visible.iter().zip(&*a).zip(&*b).map(|((x, a), b)| (x - a) * (x - b));
            (products.sum::<f64>() / n).max(noise / n.sqrt())
        };
        let time = |segments: f64, square: f64| segments * rays_for(square.max(f64::MIN_POSITIVE));
        let mut best = (MAX_WORK_RATIO * time(first.segments, square(&first)), other);
        for (engine, work) in cut {
            let trial = self.trial(engine, sample, emitter, &mut scratch);
            let square = square(&trial);
            let time = time(work * trial.segments, square);
            if time < best.0 && square <= self.visibility_tolerance().powi(2) {
                best = (time, engine.clone());
            }
        }
        best.1
    }

    fn trial(
        &self,
        engine: &VisibilityEngine,
        points: &[GatherPoint],
        emitter: usize,
        scratch: &mut Scratch,
    ) -> Trial {
        let mut views = self.emitter_views(points, emitter);
        let before = scratch.tally.segments;
        let tolerance = self.visibility_tolerance();
        self.measure_visibility(&mut views, emitter, engine, scratch, |view| {
            view.rays_for(tolerance).min(self.light_rays)
        });
        let segments = (scratch.tally.segments - before) as f64;
        Trial { segments, visible: views.iter().map(EmitterView::visible).collect() }
    }
}
