//! The umbra criterion against brute force, the engines against each other, and invariants under the feature size.

mod against_plain_walk;
mod answers;
mod certificates;
mod edges;
mod ends;
mod extinction;
mod folded;
mod instances;
mod routes;
mod same_bits;
mod solid;

use super::plain_walk::{Segment, end_rule, peak_occlusion, umbra};
use super::{LeafMode, MultiResolution, WideTree, *};
use crate::clusters::{self, Hierarchy};
use crate::embree::{CommittedScene, Traversal, committed};
use crate::optics::{self, AxisMix, ClusterOptics, Extinction};
use crate::ray::{EndRule, LANES, Packet};
use crate::scene::Scene;
use crate::scene::generate::{self, Spec};
use crate::scene::testing::{Pieces, unit};
use glam::{DVec3, Vec3};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;
use std::sync::Arc;

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

pub const SINGLE: Traversal = Traversal { width: 1, coherent: false };

/// A scene with cluster hierarchy, optics and Embree scene.
pub struct Stage {
    pub scene: Scene,
    pub hierarchy: Hierarchy,
    pub optics: Vec<ClusterOptics>,
    pub traced: CommittedScene,
}

impl Stage {
    pub fn with(scene: Scene, options: &clusters::Options, how: &optics::Options) -> Stage {
        let hierarchy = clusters::build(&scene, options);
        hierarchy.check(&scene).expect("hierarchy");
        let optics = optics::measure(&scene, &hierarchy.micro, how);
        let traced = committed(&scene.positions, &scene.triangles);
        Stage { scene, hierarchy, optics, traced }
    }

    /// A scene in which all surfaces belong to clusters: nothing counts as large.
    pub fn apart(scene: Scene, how: &optics::Options) -> Stage {
        let apart = clusters::Options { large_surface: f32::INFINITY, ..Default::default() };
        Stage::with(scene, &apart, how)
    }

    pub fn engine(&self, leaf: LeafMode) -> MultiResolution {
        let tree = WideTree::build(&self.scene, &self.hierarchy, &self.optics);
        MultiResolution::new(Arc::new(tree), self.traced.clone(), SINGLE, leaf)
    }
}

// The umbra criterion: the clusters that are aggregated, and penumbrae that stay.

/// One plate between a point and an emitter is aggregated if and only if the umbra of its size is below s.
#[test]
fn a_cluster_is_aggregated_where_its_umbra_is_small() {
    for height in [0.2, 0.5, 0.8] {
        let mut pieces = Pieces::new();
        pieces.quad(height * DVec3::Z, 0.1 * DVec3::X, 0.1 * DVec3::Y);
        let stage = Stage::soft(pieces.scene());
        let engine = stage.engine(LeafMode::Exact);
        let at = |x: f32, y: f32, z: f64| Vec3::new(x, y, z as f32) - stage.scene.origin.as_vec3();
        let mut packet = Packet::EMPTY;
        packet.set(0, at(0.013, 0.007, 0.0), at(0.013, 0.007, 1.0), EndRule::new(1.0));
        let mix = AxisMix::around(towards(&packet));
        let b = mix.mix(|axis| stage.optics[0].feature_size(axis));
        for e in [0.0, 0.3 * b, 0.9 * b, 2.2 * b] {
            let critical = umbra(f64::from(e), f64::from(b), 1.0 - height, height) as f32;
            // Tolerance two percent: sizes are stored in 16 bits, rounded up, and the plate has a thickness.
            for (s, aggregated) in [(0.98 * critical, 0), (1.02 * critical, 1)] {
                let (s, aggregated) = if critical <= 0.0 { (1e-6, 1) } else { (s, aggregated) };
                let bundle = Bundle::of_packet(&packet, e);
                let answer = engine.answer(bundle, s, &mut Workspace::default());
                let place = format!("height {height}, e {e}, b {b}, s {s}, umbra {critical}: {answer:?}");
                assert_eq!(answer.cost.aggregated, aggregated, "{place}");
                // A plate that blocks a single segment covers its whole shaft.
                let method = if aggregated == 1 { Method::Aggregated } else { Method::Covered };
                assert_eq!(answer.method, method, "{place}");
                assert_eq!(answer.transmittance == 0.0, aggregated == 0, "{place}");
            }
        }
    }
}

/// A disc of half the emitter's size has no umbra but occludes up to three quarters of the emitter (docs/method.md,
/// Traps: penumbrae). Two such discs side by side form one cluster. By umbra size alone the cluster could be averaged
/// at any s, and the shadow behind each disc would be lost. The averaging width keeps the shadow.
#[test]
fn penumbrae_of_strong_contrast_stay() {
    let mut discs = Pieces::new();
    for x in [0.0, 2.0] {
        let rim = (0..8).map(|k| (f64::from(k) + 0.5) * std::f64::consts::TAU / 8.0);
        discs.polygon(&rim.map(|t| DVec3::new(x + 0.25 * t.cos(), 0.25 * t.sin(), 4.0)).collect::<Vec<_>>());
    }
    let stage = Stage::with(
        discs.scene(),
        &clusters::Options { large_surface: f32::INFINITY, ..Default::default() },
        &measured(Extinction::Measured),
    );
    // The paper's size of both discs together is below the emitter's: no umbra at any s.
    let both = &stage.optics[0];
    assert!(umbra(1.0, f64::from(both.blocker_size[2]), 3.0, 4.0) < 0.0, "{both:?}");
    assert!(both.coverage[2] < 0.4 && both.feature_size(2) > 0.6, "{both:?}");
    let (mut random, mut workspace) = (Pcg64Mcg::new(31), Workspace::default());
    let at = |p: DVec3| (p - stage.scene.origin).as_vec3();
    let mut packets = vec![Packet::EMPTY; 64];
    let mut hit = 0;
    for k in 0..64 * LANES {
        let turn = std::f64::consts::TAU * unit(&mut random);
        let rim = 0.5 * unit(&mut random).sqrt();
        // The disc is at 4/7 of the segment.
        hit += usize::from(rim * 4.0 / 7.0 < 0.25);
        let end = DVec3::new(rim * turn.cos(), rim * turn.sin(), 7.0);
        packets[k / LANES].set(k % LANES, at(DVec3::ZERO), at(end), end_rule(&stage.scene));
    }
    let reference = 1.0 - hit as f32 / (64 * LANES) as f32;
    assert!((1.0 - peak_occlusion(1.0, 0.5, 3.0, 4.0) as f32 - reference).abs() < 0.05, "{reference}");
    let bundle = Bundle { packets: &packets, emitter_size: 1.0, emitter: &[] };
    for s in [0.05, 0.2, 0.4] {
        let found = stage.engine(LeafMode::Exact).answer(bundle, s, &mut workspace).transmittance;
        // An octagon covers nine tenths of its disc.
        assert!((found - reference).abs() < 0.12, "s {s}: {found} passes, {reference} should");
    }
}
