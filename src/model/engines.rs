//! Engines and samplers of a model, made on first use, then kept.

use super::Model;
use crate::math::Aabb;
use crate::math::sampling::on_triangle;
use crate::ray::{LANES, Packet};
use crate::scene::{EmitterSampler, Scene};
use crate::visibility::{
    Bundle, CALIBRATION_BUNDLES, DistanceCut, Exact, LeafMode, MultiResolution, Route, Workspace,
};
use glam::Vec3;
use sobol_burley::sample_4d;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Seed of the ends of sample segments.
pub(super) const SEED: u32 = 0x6d72_7669;

/// Engines and samplers that are kept between queries.
#[derive(Default)]
pub(super) struct Engines {
    multi_resolution: OnceLock<MultiResolution>,
    pub(super) cut: OnceLock<Option<Arc<DistanceCut>>>,
    /// The route of single queries, by the power of two of feature size and number of segments.
    pub(super) routes: Mutex<BTreeMap<(i32, usize), Route>>,
    samplers: OnceLock<Vec<EmitterSampler>>,
    workspaces: Mutex<Vec<Workspace>>,
}

impl Model {
    /// Exact rays.
    #[doc(hidden)]
    pub fn exact(&self) -> Exact {
        Exact { scene: self.traced().clone(), traversal: self.widest_packets() }
    }

    /// The multi-resolution engine, if the model holds optics. The cost of exact rays is estimated once, on bundles between
    /// surfaces and emitters of the scene.
    pub(crate) fn multi_resolution(&self) -> Option<&MultiResolution> {
        let engine = self.engine(self.widest_packets(), LeafMode::Exact)?;
        Some(self.inner.engines.multi_resolution.get_or_init(|| {
            let sample = self.sample();
            let bundles: Vec<Bundle> = sample.iter().map(|(p, size)| Bundle::of_packet(p, *size)).collect();
            engine.with_budget(&bundles, &mut Workspace::default())
        }))
    }

    /// Average visibility [SD95 sec 5], if the model holds optics.
    pub(crate) fn average(&self) -> Option<MultiResolution> {
        self.engine(self.widest_packets(), LeafMode::Average)
    }

    /// A sampler for each emitter of the scene.
    pub(crate) fn samplers(&self) -> &[EmitterSampler] {
        let (scene, magnitudes) = (self.scene(), self.base().magnitudes());
        self.inner.engines.samplers.get_or_init(|| {
            scene.emitters.iter().map(|emitter| EmitterSampler::new(scene, emitter, magnitudes)).collect()
        })
    }

    /// Does `work` with buffers that are kept for the next.
    pub(crate) fn with_workspace<R>(&self, work: impl FnOnce(&mut Workspace) -> R) -> R {
        let workspaces = || self.inner.engines.workspaces.lock().unwrap_or_else(PoisonError::into_inner);
        let mut workspace = workspaces().pop().unwrap_or_default();
        let result = work(&mut workspace);
        workspaces().push(workspace);
        result
    }

    /// Packets of sixteen segments from points on surfaces to an emitter, or to another face if nothing emits, with the size of
    /// the emitter.
    fn sample(&self) -> Vec<(Packet, f32)> {
        let (scene, ends, samplers) = (self.scene(), self.end_rule(), self.samplers());
        let surfaces = Surfaces::of(scene, self.bounds());
        let bundle = |k: u32| {
            let [u, v, w, other] = sample_4d(k, 0, SEED);
            let from = surfaces.point(scene, u, v, w);
            let target = samplers.get(k as usize % samplers.len().max(1));
            let size = target.map_or(0.0, |sampler| sampler.size_from(from));
            let mut packet = Packet::EMPTY;
            for lane in 0..LANES {
                let [u, v, w, _] = sample_4d(lane as u32, 1, SEED ^ k);
                let to = match target {
                    Some(sampler) => sampler.all().sample(scene, u, v).position,
                    None => surfaces.point(scene, other, v, w),
                };
                packet.set_unknown(lane, from, to, [ends; 2]);
            }
            (packet, size)
        };
        (0..CALIBRATION_BUNDLES as u32).map(bundle).collect()
    }
}

/// Running sums of the areas of the faces of a scene, and the box of a model.
pub(super) struct Surfaces {
    sums: Vec<f64>,
    bounds: Aabb,
}

impl Surfaces {
    /// All surfaces.
    pub fn of(scene: &Scene, bounds: Aabb) -> Surfaces {
        Surfaces::with(scene, bounds, |_| true)
    }

    /// Surfaces that do not emit.
    pub fn receiving(scene: &Scene, bounds: Aabb) -> Surfaces {
        Surfaces::with(scene, bounds, |t| scene.triangle_emitter[t as usize] == u32::MAX)
    }

    fn with(scene: &Scene, bounds: Aabb, counts: impl Fn(u32) -> bool) -> Surfaces {
        let mut sum = 0.0;
        let areas = (0..scene.triangles.len() as u32).map(|t| {
            sum += if counts(t) { scene.face_area(t) } else { 0.0 };
            sum
        });
        Surfaces { sums: areas.collect(), bounds }
    }

    /// The face that `u` picks by area; none in a scene without faces of its own.
    pub fn face(&self, u: f32) -> Option<u32> {
        let all = *self.sums.last()?;
        let face = self.sums.partition_point(|&sum| sum <= f64::from(u) * all);
        Some(face.min(self.sums.len() - 1) as u32)
    }

    /// A point on the face that `u` picks by area; one in the box of a scene without faces of its own.
    fn point(&self, scene: &Scene, u: f32, v: f32, w: f32) -> Vec3 {
        match self.face(u) {
            Some(face) => on_triangle(scene.corners(face), v, w),
            None => self.bounds.min + Vec3::new(u, v, w) * self.bounds.extent(),
        }
    }
}
