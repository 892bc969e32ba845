//! The distance cut of a model: built on the first multi-resolution query, then kept.

use super::Model;
use super::engines::{SEED, Surfaces};
use crate::math::sampling::{on_triangle, sobol};
use crate::math::triangle_normal;
use crate::ray::{EndRule, LANES, Packet, gather_neighbours};
use crate::threads::Threads;
use crate::visibility::{
    Bundle, Candidate, DistanceCut, LeafMode, MultiResolution, ReferenceHalves, Route, RouteSample,
};
use glam::Vec3;
use sobol_burley::sample_4d;
use std::sync::{Arc, PoisonError};

/// First number of the points that select the engine of single queries: beyond those of the pilot.
const FIRST_POINT: u32 = 1 << 17;
/// Number of points that select the engine of single queries: as many as for batches.
const SAMPLE_POINTS: u32 = 256;
/// Largest number of segments of a bundle that the cut answers: the error of its model does not fall with more, and is known from
/// samples of as many.
const MAX_SEGMENTS: usize = 256;
/// Segments of each half of the reference of a visible fraction: [`MAX_SEGMENTS`], so that the noise of a half is no larger than that of
/// a bundle.
const REFERENCE_SEGMENTS: usize = 256;

/// Segments of a point to an emitter.
struct PointSegments<'a> {
    packets: Vec<Packet>,
    emitter_size: f32,
    emitter: &'a [Vec3],
}

impl PointSegments<'_> {
    fn bundle(&self) -> Bundle<'_> {
        Bundle { packets: &self.packets, emitter_size: self.emitter_size, emitter: self.emitter }
    }
}

impl Model {
    /// The distance cut; none in models with placed meshes, whose groups the walk of a whole bundle averages, without emitters, where it
    /// pays for no receiver, and where the system refuses threads. Made for the first query that asks.
    ///
    /// # Panics
    /// If making it does.
    pub(crate) fn cut(&self) -> Option<Arc<DistanceCut>> {
        if self.inner.top.is_some() || self.scene().emitters.is_empty() {
            return None;
        }
        // On threads of its own: those of a pool that wait for others take up further queries meanwhile, which would wait for this cut.
        let make = || {
            let threads = Threads::new(self.inner.threads.count()).ok()?;
            let made = std::thread::scope(|scope| scope.spawn(|| threads.run(|| self.made_cut())).join());
            made.unwrap_or_else(|panic| std::panic::resume_unwind(panic)).ok().flatten().map(Arc::new)
        };
        self.inner.engines.cut.get_or_init(make).clone()
    }

    /// The engine with the distance cut, if queries like this bundle at feature size `s` are answered in less time to the same error by
    /// it than by `engine` without: decided on a sample, once for each power of two of the feature size and the number of segments. A
    /// segment to a point averages nothing by the cut, and the average visibility of the paper has none; then it is not made.
    pub(crate) fn with_cut_for(&self, engine: &MultiResolution, s: f32, bundle: &Bundle) -> MultiResolution {
        if bundle.emitter_size <= 0.0 || engine.leaf() != LeafMode::Exact {
            return engine.clone();
        }
        let n = bundle.packets.iter().map(Packet::len).sum::<usize>().max(1).next_power_of_two();
        let Some(cut) = self.cut().filter(|_| n <= MAX_SEGMENTS) else { return engine.clone() };
        let octave = s.log2().floor();
        let routes = || self.inner.engines.routes.lock().unwrap_or_else(PoisonError::into_inner);
        let known = routes().get(&(octave as i32, n)).copied();
        let engine = engine.clone().with_cut(Some(cut));
        // The lock is not held meanwhile: another thread makes the same decision, which is deterministic.
        let route = known.unwrap_or_else(|| {
            let route = self.sampled_route(&engine, (octave + 0.5).exp2(), n);
            routes().insert((octave as i32, n), route);
            route
        });
        // Walks hand bundles that they take longer for to exact rays by themselves, and find certain answers.
        match route {
            Route::Walks { .. } | Route::Cut(_) => engine.with_route(route),
            Route::Exact | Route::Certified => engine,
        }
    }

    /// The route of an engine for bundles of `n` segments from points on surfaces.
    fn sampled_route(&self, engine: &MultiResolution, s: f32, n: usize) -> Route {
        let surfaces = Surfaces::receiving(self.scene(), self.bounds());
        let exact = self.exact();
        let mut blocked = Vec::new();
        let (mut asked, mut reference) = (Vec::new(), ReferenceHalves::default());
        for k in FIRST_POINT..FIRST_POINT + SAMPLE_POINTS {
            let of = |set: u32, count: usize| self.segments(&surfaces, k, set, count);
            let sets = [of(0, n), of(1, REFERENCE_SEGMENTS), of(2, REFERENCE_SEGMENTS)];
            let [Some(own), Some(first), Some(second)] = sets else { continue };
            for (half, rays) in reference.iter_mut().zip([first, second]) {
                half.push(exact.answer(rays.bundle(), &mut blocked).transmittance);
            }
            asked.push(own);
        }
        // Points do not lie together: each bundle is walked by itself.
        let runs: Vec<Vec<Bundle>> = asked.iter().map(|own| vec![own.bundle()]).collect();
        let sample = RouteSample { runs, reference: &reference };
        self.with_workspace(|workspace| engine.route(&sample, &sample.runs, s, workspace))
    }

    fn made_cut(&self) -> Option<DistanceCut> {
        let surfaces = Surfaces::receiving(self.scene(), self.bounds());
        DistanceCut::fitted(self.scene(), |k| self.candidate(&surfaces, k), &self.exact())
    }

    /// Receiver `k` of the pilot, unless it emits or faces no emitter.
    fn candidate(&self, surfaces: &Surfaces, k: u32) -> Option<Candidate<'_>> {
        let mut sets = [0, 1].map(|set| self.segments(surfaces, k, set, LANES)).into_iter().flatten();
        let (mut first, mut second) = (sets.next()?, sets.next()?);
        let packets = [first.packets.swap_remove(0), second.packets.swap_remove(0)];
        Some(Candidate { packets, emitter_size: first.emitter_size, emitter: first.emitter })
    }

    /// Stratified segments from point `k` on the surfaces to the front of an emitter, unless the point emits or faces none, or rounding
    /// turns the segments around. Points are even over all surfaces, sets of a point independent of each other.
    fn segments(&self, surfaces: &Surfaces, k: u32, set: u32, count: usize) -> Option<PointSegments<'_>> {
        let (scene, samplers) = (self.scene(), self.samplers());
        let [u, v, w, pick] = sobol(k, 0, SEED);
        let [side, ..] = sobol(k, 1, SEED);
        let face = surfaces.face(u)?;
        if scene.triangle_emitter[face as usize] != u32::MAX {
            return None;
        }
        let sampler = &samplers[((pick * samplers.len() as f32) as usize).min(samplers.len() - 1)];
        let corners = scene.corners(face);
        let at = on_triangle(corners, v, w);
        let side = if scene.triangle_sides[face as usize] == 2 && side < 0.5 { -1.0 } else { 1.0 };
        let normal = side * triangle_normal(corners[0], corners[1], corners[2]);
        let (emitter_size, _) = sampler.size_and_weight(at, normal)?;
        let facing = sampler.facing(scene, at);
        let rule = EndRule::new(self.base().magnitudes()[face as usize]);
        let from = rule.lifted(at, normal);
        let own = (SEED ^ k.wrapping_mul(0x9e37_79b9)).wrapping_add(set.wrapping_mul(0x85eb_ca6b));
        let end = |i: u32| {
            let [u, v, ..] = sample_4d(i, 0, own);
            rule.other_end(from, facing.sample(scene, u, v))
        };
        let mut ends: Vec<(Vec3, EndRule)> = (0..count as u32).map(end).collect();
        gather_neighbours(&mut ends);
        let mut packets = vec![Packet::EMPTY; ends.len().div_ceil(LANES)];
        for (i, (to, there)) in ends.into_iter().enumerate() {
            packets[i / LANES].set_lifted(i % LANES, from, to, [rule, there]);
        }
        Packet::share_slack(&mut packets);
        let forwards = packets.iter().all(|packet| packet.backwards == 0);
        forwards.then(|| PointSegments { packets, emitter_size, emitter: sampler.hull() })
    }
}
