//! The umbra criterion against brute force, the engines against each other, and invariants under the feature size.

mod against_reference;
mod answers;
mod certificates;
mod edges;
mod ends;
mod extinction;
mod folded;
mod instances;
mod routes;
mod rule;
mod same_bits;
mod solid;

use super::reference::{Segment, end_rule};
use super::testing::{SINGLE, Stage};
use super::*;
use crate::clusters;
use crate::optics::{self, Extinction};
use crate::ray::{EndRule, LANES, Packet};
use crate::scene::Scene;
use crate::scene::generate::{self, Spec};
use crate::scene::testing::unit;
use glam::Vec3;
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

/// Optics options of the tests.
fn measured(extinction: Extinction) -> optics::Options {
    optics::Options { extinction, tolerance: 0.1 }
}

impl Stage {
    fn new(scene: Scene) -> Stage {
        Stage::with(scene, &Default::default(), &measured(Extinction::Measured))
    }

    /// All surfaces in clusters, analytic extinction.
    fn soft(scene: Scene) -> Stage {
        Stage::apart(scene, &measured(Extinction::Analytic))
    }

    fn generated(name: &str) -> Stage {
        let mut spec = Spec::new(name);
        (spec.trees, spec.leaves, spec.trunks, spec.count) = (9, 120, true, None);
        Stage::new(generate::build(&spec).expect(name))
    }

    /// Blocked lanes by Embree.
    fn exact(&self, packet: &Packet) -> u32 {
        let mut blocked = [0];
        self.traced.occluded_by(SINGLE, std::slice::from_ref(packet), &mut blocked);
        blocked[0]
    }

    fn size(&self) -> f32 {
        self.scene.bounds.diagonal()
    }

    /// A random point of a random triangle, and the triangle.
    fn point(&self, random: &mut Pcg64Mcg, triangles: &[u32]) -> Vec3 {
        let corners = self.scene.corners(triangles[random.next_u32() as usize % triangles.len()]);
        let (u, v) = (unit(random).sqrt() as f32, unit(random) as f32);
        corners[0] + u * (1.0 - v) * (corners[1] - corners[0]) + u * v * (corners[2] - corners[0])
    }

    /// Triangles that do not belong to the first emitter.
    fn surfaces(&self) -> Vec<u32> {
        let emitter = &self.scene.emitters[0].triangles;
        (0..self.scene.triangles.len() as u32).filter(|t| !emitter.contains(t)).collect()
    }

    /// Packets of `lanes` segments from points on surfaces to points on the first emitter.
    fn bundles(&self, seed: u64, count: usize, lanes: usize) -> Vec<Packet> {
        let mut random = Pcg64Mcg::new(seed.into());
        let emitter = &self.scene.emitters[0].triangles;
        let surfaces = self.surfaces();
        let ends = end_rule(&self.scene);
        (0..count)
            .map(|_| {
                let from = self.point(&mut random, &surfaces);
                let mut packet = Packet::EMPTY;
                (0..lanes).for_each(|i| packet.set(i, from, self.point(&mut random, emitter), ends));
                packet
            })
            .collect()
    }

    fn sizes(&self) -> [f32; 5] {
        [1e-6, 0.003, 0.01, 0.05, 0.3].map(|part| part * self.size())
    }
}

fn segment(packet: &Packet, lane: usize) -> Segment {
    Segment {
        origin: Vec3::from(packet.origin.map(|axis| axis[lane])),
        direction: Vec3::from(packet.direction.map(|axis| axis[lane])),
        near: packet.near[lane],
        far: packet.far[lane],
    }
}

/// Vector from the centre of the receiver ends to the centre of the emitter ends.
fn towards(packet: &Packet) -> Vec3 {
    let middle = |t: f32| crate::math::Aabb::of(packet.lanes().map(|i| packet.point(i, t))).center();
    middle(1.0) - middle(0.0)
}

/// Parallel lines over a square that covers the scene, and the area that each line represents.
fn parallel(stage: &Stage, view: Vec3, lanes: usize, random: &mut Pcg64Mcg) -> (Vec<Packet>, f64) {
    let (u, v) = view.any_orthonormal_pair();
    let (centre, reach, n) = (stage.scene.bounds.center(), 1.01 * stage.size(), 160);
    let mut packets: Vec<Packet> = Vec::new();
    for i in 0..n * n {
        let mut at = |k: usize| ((k as f64 + unit(random)) / n as f64 - 0.5) as f32 * reach;
        let p = centre + at(i % n) * u + at(i / n) * v;
        if i % lanes == 0 {
            packets.push(Packet::EMPTY);
        }
        let last = packets.last_mut().expect("just pushed");
        last.set(i % lanes, p - 2.0 * reach * view, p + 2.0 * reach * view, EndRule::new(0.0));
    }
    (packets, f64::from(reach * reach) / (n * n) as f64)
}
