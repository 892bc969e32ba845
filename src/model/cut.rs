//! The distance cut of a model: made when multi-resolution visibility is first asked for, then kept.

use super::Model;
use super::engines::{SEED, Surfaces};
use crate::math::sampling::on_triangle;
use crate::math::triangle_normal;
use crate::ray::{EndRule, LANES, Packet, gather_neighbours};
use crate::threads::Threads;
use crate::visibility::{Bundle, Cut};
use glam::Vec3;
use rayon::prelude::*;
use sobol_burley::sample_4d;
use std::sync::Arc;

/// Bundles of the pilot that fits the cut: 2¹⁷ segments give the mean transmittance to 0.0014, a standard error.
const PILOT_BUNDLES: u32 = 1 << 13;

/// A bundle of the pilot: sixteen segments from a point of a surface to the front of an emitter.
struct Pilot<'a> {
    packet: Packet,
    emitter_size: f32,
    hull: &'a [Vec3],
}

impl Model {
    /// The distance cut; none in models with placed meshes, whose groups the walk of a whole bundle averages, without emitters, and where
    /// the system refuses threads.
    pub(crate) fn cut(&self) -> Option<Arc<Cut>> {
        if self.inner.top.is_some() || self.scene().emitters.is_empty() {
            return None;
        }
        // On threads of its own: those of a pool that wait for others take up further queries meanwhile, which would wait for this cut.
        let make = || {
            let threads = Threads::new(self.inner.threads.count()).ok()?;
            let made = std::thread::scope(|scope| scope.spawn(|| threads.run(|| self.made_cut())).join());
            made.ok()?.ok().map(Arc::new)
        };
        self.inner.engines.cut.get_or_init(make).clone()
    }

    fn made_cut(&self) -> Cut {
        let pilots = self.pilots();
        let mut bundles = Vec::with_capacity(pilots.len());
        for Pilot { packet, emitter_size, hull } in &pilots {
            bundles.push(Bundle { emitter: hull, ..Bundle::of_packet(packet, *emitter_size) });
        }
        Cut::build(self.scene()).fitted(&bundles, &self.exact())
    }

    fn pilots(&self) -> Vec<Pilot<'_>> {
        let surfaces = Surfaces::of(self.scene(), self.bounds());
        let magnitudes = self.base().magnitudes();
        (0..PILOT_BUNDLES).into_par_iter().filter_map(|k| self.pilot(&surfaces, magnitudes, k)).collect()
    }

    /// Bundle `k` of the pilot, unless its receiver emits or faces no emitter.
    fn pilot(&self, surfaces: &Surfaces, magnitudes: &[f32], k: u32) -> Option<Pilot<'_>> {
        let (scene, samplers) = (self.scene(), self.samplers());
        let [u, v, w, pick] = sample_4d(k, 0, SEED);
        let face = surfaces.face(u)?;
        if scene.triangle_emitter[face as usize] != u32::MAX {
            return None;
        }
        let sampler = &samplers[((pick * samplers.len() as f32) as usize).min(samplers.len() - 1)];
        let corners = scene.corners(face);
        let at = on_triangle(corners, v, w);
        let side = if scene.triangle_sides[face as usize] == 2 && k % 2 == 1 { -1.0 } else { 1.0 };
        let normal = side * triangle_normal(corners[0], corners[1], corners[2]);
        let (emitter_size, _) = sampler.size_and_weight(at, normal)?;
        let facing = sampler.facing(scene, at);
        let rule = EndRule::new(magnitudes[face as usize]);
        let from = rule.lifted(at, normal);
        let end = |i: usize| {
            // Independent of each other, so that their spread tells their error; even over all bundles.
            let [u, v, ..] = sample_4d(k, 1 + i as u32, SEED);
            let (at, normal, magnitude) = facing.sample(scene, u, v);
            let there = EndRule::new(magnitude).seen_from(rule);
            (there.lifted_towards(at, normal, from), there)
        };
        let mut ends: Vec<(Vec3, EndRule)> = (0..LANES).map(end).collect();
        gather_neighbours(&mut ends);
        let mut packet = Packet::EMPTY;
        for (lane, (to, there)) in ends.into_iter().enumerate() {
            packet.set_lifted(lane, from, to, [rule, there]);
        }
        (packet.backwards == 0).then(|| Pilot { packet, emitter_size, hull: sampler.hull() })
    }
}
