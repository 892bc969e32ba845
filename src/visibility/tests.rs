//! The rule of method A.6 against brute force, the engines against each other, and what no feature size may change.

use super::reference::{Segment, end_rule, peak_occlusion, penumbra, umbra, walk};
use super::*;
use crate::characterise::{self, AxisMix, Extinction, Traits, characterise};
use crate::embree::{CommittedScene, Device, SceneBuilder, Traversal};
use crate::hierarchy::{self, Hierarchy};
use crate::ray::{Brute, EndRule, LANES, Verdict};
use crate::scene::Scene;
use crate::scene::generate::{self, Spec};
use crate::scene::testing::{Pieces, cloud, direction, in_cube, unit};
use crate::simd::Isa;
use glam::{DVec2, DVec3, Vec3};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;
use rayon::prelude::*;

const SINGLE: Traversal = Traversal { width: 1, coherent: false };
const ISAS: [Isa; 3] = [Isa::Portable, Isa::Avx2, Isa::Avx512];

/// A scene with all that the engines need.
struct Stage {
    scene: Scene,
    hierarchy: Hierarchy,
    traits: Vec<Traits>,
    traced: CommittedScene,
}

impl Stage {
    fn new(scene: Scene) -> Stage {
        Stage::with(scene, &Default::default(), Extinction::Measured)
    }

    /// Nothing counts as large; extinction by the formula.
    fn soft(scene: Scene) -> Stage {
        let apart = hierarchy::Options { large_surface: f32::INFINITY, ..Default::default() };
        Stage::with(scene, &apart, Extinction::Analytic)
    }

    fn with(scene: Scene, options: &hierarchy::Options, extinction: Extinction) -> Stage {
        let hierarchy = hierarchy::build(&scene, options);
        hierarchy.check(&scene).expect("hierarchy");
        let options = characterise::Options { extinction, tolerance: 0.1, ..Default::default() };
        let traits = characterise(&scene, &hierarchy.micro, &options);
        let device = Device::new(1).expect("device");
        let mut builder = SceneBuilder::new(&device, Default::default()).expect("builder");
        builder.add_triangles(&scene.positions, &scene.triangles, 1).expect("triangles");
        let traced = builder.commit().expect("scene");
        Stage { scene, hierarchy, traits, traced }
    }

    fn generated(name: &str) -> Stage {
        let mut spec = Spec::new(name);
        (spec.trees, spec.leaves, spec.trunks, spec.count) = (9, 120, true, None);
        Stage::new(generate::build(&spec).expect(name))
    }

    fn engine(&self, leaf: Leaf) -> MultiResolution<'_> {
        MultiResolution::new(&self.scene, &self.hierarchy, &self.traits, &self.traced, SINGLE, leaf)
    }

    /// Blocked lanes by Embree.
    fn exact(&self, packet: &Packet) -> u32 {
        let mut blocked = [0];
        self.traced.occluded_by(SINGLE, u32::MAX, std::slice::from_ref(packet), &mut blocked);
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

    /// Bundles of `lanes` segments from points on surfaces to points on the first emitter.
    fn bundles(&self, seed: u64, count: usize, lanes: usize) -> Vec<Packet> {
        let mut random = Pcg64Mcg::new(seed.into());
        let emitter = &self.scene.emitters[0].triangles;
        let surfaces: Vec<u32> =
            (0..self.scene.triangles.len() as u32).filter(|t| !emitter.contains(t)).collect();
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
        origin: packet.point(lane, 0.0),
        direction: Vec3::from(packet.direction.map(|axis| axis[lane])),
        near: packet.near[lane],
        far: packet.far[lane],
    }
}

/// From the middle of the receiver ends to the middle of the emitter ends.
fn towards(packet: &Packet) -> Vec3 {
    let middle = |t: f32| crate::math::Aabb::of(packet.lanes().map(|i| packet.point(i, t))).center();
    middle(1.0) - middle(0.0)
}

// --- the rule ----------------------------------------------------------------------------------------------------------

/// Points of a disc of this diameter, its rim among them.
fn disc(diameter: f64) -> Vec<DVec2> {
    let n = 4000;
    let inner = (0..n).map(|i| ((f64::from(i) + 0.5) / f64::from(n)).sqrt());
    inner
        .chain((0..400).map(|_| 1.0))
        .enumerate()
        .map(|(i, r)| 0.5 * diameter * r * DVec2::from_angle(i as f64 * 2.399_963_229_728_653))
        .collect()
}

/// Largest `x` in `[0, 20]` at which the condition still holds, which it does below and not above.
fn last(holds: impl Fn(f64) -> bool) -> Option<f64> {
    let (mut low, mut high) = (0.0, 20.0);
    if !holds(low) {
        return None;
    }
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if holds(middle) { low = middle } else { high = middle }
    }
    Some(low)
}

/// The five configurations of method A.6, every emitter point traced to the blocker's plane.
#[test]
fn umbra_penumbra_and_peak_are_those_of_discs() {
    for (e, b, d1, d2) in [
        (1.0, 2.0, 3.0, 1.0),
        (1.0, 0.5, 3.0, 1.0),
        (1.0, 0.5, 3.0, 4.0),
        (2.0, 0.5, 1.0, 0.5),
        (0.0, 0.5, 1.0, 2.0),
    ] {
        let emitter = disc(e);
        let blocked = |x: f64, y: DVec2| {
            let receiver = DVec2::new(x, 0.0);
            (receiver + (y - receiver) * d2 / (d1 + d2)).length() <= 0.5 * b
        };
        let place = format!("e {e}, b {b}, d1 {d1}, d2 {d2}");
        let width = last(|x| emitter.iter().all(|&y| blocked(x, y))).map(|x| 2.0 * x);
        let formula = umbra(e, b, d1, d2);
        match width {
            Some(width) => {
                assert!((width - formula).abs() < 0.01 * b, "{place}: umbra {width}, formula {formula}")
            }
            None => assert!(formula <= 0.0, "{place}: no umbra, formula {formula}"),
        }
        let width = last(|x| emitter.iter().any(|&y| blocked(x, y))).map_or(0.0, |x| 2.0 * x);
        let formula = penumbra(e, b, d1, d2);
        assert!((width / formula - 1.0).abs() < 0.01, "{place}: penumbra {width}, formula {formula}");
        if e > 0.0 {
            // Without the rim points: they are no area.
            let inside = &emitter[..4000];
            let peak = inside.iter().filter(|&&y| blocked(0.0, y)).count() as f64 / inside.len() as f64;
            let formula = peak_occlusion(e, b, d1, d2);
            assert!((peak - formula).abs() < 0.005, "{place}: peak {peak}, formula {formula}");
        }
    }
}

/// One plate between a point and an emitter: aggregated if and only if the umbra of its size is below s.
#[test]
fn a_cluster_is_aggregated_where_its_umbra_is_small() {
    for height in [0.2, 0.5, 0.8] {
        let mut pieces = Pieces::new();
        pieces.quad(height * DVec3::Z, 0.1 * DVec3::X, 0.1 * DVec3::Y);
        let stage = Stage::soft(pieces.scene());
        let engine = stage.engine(Leaf::Exact);
        let at = |x: f32, y: f32, z: f64| Vec3::new(x, y, z as f32) - stage.scene.origin.as_vec3();
        let mut packet = Packet::EMPTY;
        packet.set(0, at(0.013, 0.007, 0.0), at(0.013, 0.007, 1.0), EndRule::new(1.0));
        let mix = AxisMix::around(towards(&packet));
        let b = mix.mix(|axis| stage.traits[0].feature_size(axis));
        for e in [0.0, 0.3 * b, 0.9 * b, 2.2 * b] {
            let critical = umbra(f64::from(e), f64::from(b), 1.0 - height, height) as f32;
            // Two per cent for sizes stored in 16 bits, rounded up, and for the plate's thickness.
            for (s, aggregated) in [(0.98 * critical, 0), (1.02 * critical, 1)] {
                let (s, aggregated) = if critical <= 0.0 { (1e-6, 1) } else { (s, aggregated) };
                let bundle = Bundle { packets: std::slice::from_ref(&packet), emitter_size: e };
                let answer = engine.answer(bundle, s, &mut Workspace::default());
                let place = format!("height {height}, e {e}, b {b}, s {s}, umbra {critical}: {answer:?}");
                assert_eq!(answer.cost.aggregated, aggregated, "{place}");
                let method = if aggregated == 1 { Method::Aggregated } else { Method::Exact };
                assert_eq!(answer.method, method, "{place}");
                assert_eq!(answer.transmittance == 0.0, aggregated == 0, "{place}");
            }
        }
    }
}

// --- the fast engine against the reference ---------------------------------------------------------------------------

/// How often fast engine and reference differ by more than a hundredth, and by how much in the mean.
#[derive(Default)]
struct Differences {
    segments: usize,
    large: usize,
    sum: f64,
    /// Squared errors of the fast engine and of the reference.
    squares: [f64; 2],
}

/// What must hold for every segment, with `tolerance` for the verdict of exact arithmetic:
///
/// * whatever the reference blocks with a triangle, the fast engine blocks too: it never aggregates more;
/// * a segment that the fast engine blocks is blocked, one that is clear passes something;
/// * where the reference aggregates nothing, so does the fast engine, and the answer is 0 or 1 and right.
///
/// A fast answer may rest on more triangles than the reference's, so the transmittances are compared in the mean.
fn compare(stage: &Stage, packets: &[Packet], e: f32, s: f32) -> Differences {
    let brute = Brute::new(&stage.scene.positions, &stage.scene.triangles);
    let single: Vec<Brute> = stage
        .scene
        .triangles
        .iter()
        .map(|t| Brute::new(&stage.scene.positions, std::slice::from_ref(t)))
        .collect();
    let engine = stage.engine(Leaf::Exact);
    let mut workspace = Workspace::default();
    let mut differences = Differences::default();
    for packet in packets {
        let fast = engine.transmittances(packet, e, s, &mut workspace);
        let bundle = Bundle { packets: std::slice::from_ref(packet), emitter_size: e };
        let cost = engine.answer(bundle, s, &mut workspace).cost;
        let mut aggregated = 0;
        for lane in packet.lanes() {
            let Segment { origin, direction, near, far } = segment(packet, lane);
            let verdict = brute.verdict(origin, direction, near, far, 1e-5);
            let mut clearly = false;
            let met = walk(
                &stage.hierarchy,
                &stage.traits,
                segment(packet, lane),
                towards(packet),
                (e, s),
                Leaf::Exact,
                |t| {
                    let one = |tolerance| single[t as usize].verdict(origin, direction, near, far, tolerance);
                    clearly |= one(1e-5) == Verdict::Blocked;
                    one(0.0) != Verdict::Clear
                },
            );
            let t = fast[lane];
            let place =
                format!("s {s}, e {e}: {t} against {met:?}, {verdict:?}, {:?}", segment(packet, lane));
            assert!((0.0..=1.0).contains(&t), "{place}");
            assert!(!clearly || t == 0.0, "a triangle that the reference tests was not tested: {place}");
            assert!(t > 0.0 || verdict != Verdict::Clear, "blocked by nothing: {place}");
            if met.aggregated == 0 {
                assert!(t == 0.0 || t == 1.0, "aggregated more than the reference: {place}");
                assert!(verdict != Verdict::Blocked || t == 0.0, "missed: {place}");
            }
            aggregated += u64::from(met.aggregated > 0 && !met.blocked);
            if verdict != Verdict::Marginal {
                differences.segments += 1;
                differences.large += usize::from((f64::from(t) - met.transmittance()).abs() > 0.01);
                differences.sum += f64::from(t) - met.transmittance();
                let truth = if verdict == Verdict::Clear { 1.0 } else { 0.0 };
                differences.squares[0] += (f64::from(t) - truth).powi(2);
                differences.squares[1] += (met.transmittance() - truth).powi(2);
            }
        }
        assert!(cost.aggregated <= aggregated, "s {s}: {cost:?}, the reference aggregates for {aggregated}");
    }
    differences
}

#[test]
fn fast_engine_keeps_the_rule_of_the_reference() {
    for name in ["forest", "cubes", "desk-room", "louvres"] {
        let stage = Stage::generated(name);
        let e = stage.scene.emitters[0].min_width;
        for (lanes, count) in [(1, 300), (16, 25)] {
            let packets = stage.bundles(3, count, lanes);
            for s in stage.sizes() {
                for e in [0.0, 0.5 * e] {
                    let d = compare(&stage, &packets, e, s);
                    let n = d.segments as f64;
                    let (large, mean) = (d.large as f64 / n, d.sum / n);
                    println!("{name}, {lanes} lanes, s {s:.4}, e {e:.2}: {large:.3} differ, mean {mean:+.4}");
                    // It judges whole boxes, opens more, and is nearer to the truth for it.
                    let [fast, slow] = d.squares.map(|sum| (sum / n).sqrt());
                    assert!(fast < 1.1 * slow + 0.005, "{name}, s {s}, e {e}: RMS {fast} and {slow}");
                    assert!(mean.abs() < 0.03, "{name}, s {s}, e {e}: fast - reference {mean:+.4}");
                    assert!(large < 0.1, "{name}, s {s}, e {e}: {large} of the segments differ");
                }
            }
        }
    }
}

/// Neighbours that are asked together share the upper part of the traversal: what is exact stays the same bit for
/// bit, and what is aggregated differs by no more than the direction that traits are taken along.
#[test]
fn groups_answer_as_their_bundles_do() {
    for name in ["forest", "cubes", "desk-room", "bookshelf"] {
        let stage = Stage::generated(name);
        let engine = stage.engine(Leaf::Exact);
        let emitter = &stage.scene.emitters[0].triangles;
        let ends = end_rule(&stage.scene);
        let mut random = Pcg64Mcg::new(12);
        let surfaces: Vec<u32> =
            (0..stage.scene.triangles.len() as u32).filter(|t| !emitter.contains(t)).collect();
        let mut packets = Vec::new();
        for _ in 0..20 {
            // A crowd of points around one of a surface.
            let middle = stage.point(&mut random, &surfaces);
            for _ in 0..25 {
                let from = middle + 0.02 * stage.size() * direction(&mut random);
                let mut packet = Packet::EMPTY;
                (0..16).for_each(|i| packet.set(i, from, stage.point(&mut random, emitter), ends));
                packets.push(packet);
            }
        }
        let width = stage.scene.emitters[0].min_width;
        for (e, s) in [(1e-6 * width, 1e-6 * stage.size()), (width, 0.02 * stage.size())] {
            let bundles: Vec<Bundle> = packets
                .iter()
                .map(|p| Bundle { packets: std::slice::from_ref(p), emitter_size: e })
                .collect();
            let mut workspace = Workspace::default();
            let mut together = Vec::new();
            engine.answers(&bundles, s, &mut workspace, |answer| together.push(answer));
            assert_eq!(together.len(), bundles.len());
            let (mut sum, mut nodes) = (0.0, [0, 0]);
            for (bundle, shared) in bundles.iter().zip(&together) {
                let alone = engine.answer(*bundle, s, &mut workspace);
                nodes = [nodes[0] + alone.cost.nodes, nodes[1] + shared.cost.nodes];
                if alone.cost.aggregated + shared.cost.aggregated == 0 {
                    assert_eq!(alone.transmittance, shared.transmittance, "{name}, e {e}, s {s}");
                }
                sum += f64::from(shared.transmittance - alone.transmittance);
            }
            let mean = sum / bundles.len() as f64;
            assert!(mean.abs() < 0.01, "{name}, e {e}, s {s}: groups answer {mean:+.4} more");
            assert!(nodes[1] < nodes[0] / 2, "{name}, e {e}, s {s}: nothing is shared: {nodes:?}");
        }
    }
}

#[test]
fn bundles_with_sizes_of_their_own_answer_as_they_do_alone() {
    let stage = Stage::generated("forest");
    let engine = stage.engine(Leaf::Extinction);
    let mut random = Pcg64Mcg::new(5);
    let (mut workspace, mut differ, mut fractions) = (Workspace::default(), 0.0, 0);
    let bounds = stage.scene.bounds;
    for _ in 0..20 {
        // Neighbours, so that they share a front.
        let [a, b] = [0, 1].map(|_| bounds.min + in_cube(&mut random).as_vec3() * (bounds.max - bounds.min));
        let packets: Vec<Packet> = (0..12).map(|_| around(a, b, 0.3, &mut random)).collect();
        let sizes: Vec<f32> = (0..12).map(|k| 0.02 * 1.5f32.powi(k)).collect();
        let bundles: Vec<Bundle> =
            packets.iter().map(|p| Bundle { packets: std::slice::from_ref(p), emitter_size: 0.3 }).collect();
        let mut together = Vec::new();
        engine.answers_lanes(&bundles, &sizes, &mut workspace, |k, answer, lanes| {
            assert_eq!(k, together.len());
            let mean = packets[k].lanes().map(|l| lanes[l]).sum::<f32>() / packets[k].len() as f32;
            assert!((mean - answer.transmittance).abs() < 1e-5, "{mean} {answer:?}");
            together.push(*lanes);
        });
        for (k, lanes) in together.iter().enumerate() {
            let (_, alone) = engine.answer_lanes(&packets[k], 0.3, sizes[k], &mut workspace);
            for (x, y) in lanes.iter().zip(alone) {
                differ += x - y;
                fractions += usize::from(*x > 0.0 && *x < 1.0);
            }
        }
    }
    // As in groups: what is aggregated may differ, the mean does not.
    let mean = differ / (20 * 12 * LANES) as f32;
    assert!(mean.abs() < 0.01 && fractions > 100, "{mean} {fractions}");
}

/// Segments between boxes about two places.
fn around(a: Vec3, b: Vec3, width: f32, random: &mut Pcg64Mcg) -> Packet {
    let ends = EndRule::new(1.0);
    let mut packet = Packet::EMPTY;
    for lane in 0..LANES {
        let [from, to] = [a, b].map(|p| p + width * (in_cube(random).as_vec3() - 0.5));
        packet.set(lane, from, to, ends);
    }
    packet
}

#[test]
fn fast_engine_keeps_the_rule_in_random_clouds() {
    for seed in 0..12 {
        let mut random = Pcg64Mcg::new(seed);
        let count = 1 << (random.next_u32() % 9);
        let edge = 10f64.powf(-1.5 * unit(&mut random));
        let mut pieces = cloud(seed as u64, count, edge, in_cube(&mut random) + 0.1, seed % 2 == 0);
        pieces.light(DVec3::new(0.5, 0.5, 2.0), 0.4 * DVec3::Y, 0.4 * DVec3::X);
        let stage = Stage::new(pieces.scene());
        let packets = stage.bundles(seed as u64, 20, 16);
        // From an element instead of a point: no end is shared.
        let apart: Vec<Packet> = packets
            .iter()
            .map(|p| {
                let mut apart = Packet::EMPTY;
                for lane in p.lanes() {
                    let from = p.point(lane, 0.0) + 0.02 * direction(&mut random);
                    apart.set(lane, from, p.point(lane, 1.0), end_rule(&stage.scene));
                }
                apart
            })
            .collect();
        for (s, e) in stage.sizes().into_iter().flat_map(|s| [(s, 0.0), (s, 0.1), (s, 0.4)]) {
            let d = compare(&stage, &apart, e, s);
            let mean = d.sum / d.segments.max(1) as f64;
            assert!(mean.abs() < 0.05, "seed {seed}, apart, {count} of {edge:.3}, s {s}, e {e}: {mean:+.4}");
            let d = compare(&stage, &packets, e, s);
            let mean = d.sum / d.segments.max(1) as f64;
            assert!(mean.abs() < 0.05, "seed {seed}, {count} of {edge:.3}, s {s}, e {e}: {mean:+.4}");
        }
    }
}

#[test]
fn instruction_sets_threads_and_history_change_no_bit() {
    for name in ["forest", "desk-room"] {
        let stage = Stage::generated(name);
        let packets = stage.bundles(8, 300, 16);
        let e = 0.3 * stage.scene.emitters[0].min_width;
        for leaf in [Leaf::Exact, Leaf::Extinction] {
            for s in stage.sizes() {
                let ask = |engine: &MultiResolution, packet: &Packet, workspace: &mut Workspace| {
                    let bundle = Bundle { packets: std::slice::from_ref(packet), emitter_size: e };
                    let answer = engine.answer(bundle, s, workspace);
                    let bits = [answer.transmittance, answer.lo, answer.hi].map(f32::to_bits);
                    (engine.transmittances(packet, e, s, workspace).map(f32::to_bits), bits, answer.cost)
                };
                let plain = stage.engine(leaf).with_isa(Isa::Portable);
                let truth: Vec<_> =
                    packets.iter().map(|p| ask(&plain, p, &mut Workspace::default())).collect();
                for isa in ISAS.into_iter().filter(|isa| isa.available()) {
                    let engine = stage.engine(leaf).with_isa(isa);
                    assert_eq!(engine.isa(), isa);
                    // Backwards with one workspace: what came before must not show.
                    let mut kept = Workspace::default();
                    let mut again: Vec<_> =
                        packets.iter().rev().map(|p| ask(&engine, p, &mut kept)).collect();
                    again.reverse();
                    assert!(again == truth, "{name}, {leaf:?}, s {s}: {} differs", isa.name());
                }
                let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
                let engine = stage.engine(leaf);
                let shared: Vec<_> = pool.install(|| {
                    packets.par_iter().map_init(Workspace::default, |w, p| ask(&engine, p, w)).collect()
                });
                assert!(shared == truth, "{name}, {leaf:?}, s {s}: two threads differ");
            }
        }
    }
}

/// Feature sizes and emitters of a millionth of the scene leave nothing to aggregate but what lies edge-on.
#[test]
fn vanishing_sizes_are_exact() {
    for name in ["forest", "cubes", "desk-room", "brick-wall", "louvres", "bookshelf", "cube-groups"] {
        let stage = Stage::generated(name);
        let brute = Brute::new(&stage.scene.positions, &stage.scene.triangles);
        let tiny = 1e-6 * stage.size();
        let engine = stage.engine(Leaf::Exact);
        let mut workspace = Workspace::default();
        let (mut aggregated, mut marginal, mut segments) = (0, 0, 0);
        for packet in stage.bundles(17, 150, 16) {
            let bundle = Bundle { packets: std::slice::from_ref(&packet), emitter_size: tiny };
            let cost = engine.answer(bundle, tiny, &mut workspace).cost;
            (aggregated, segments) = (aggregated + cost.aggregated, segments + cost.segments);
            if cost.aggregated > 0 {
                continue;
            }
            let fast = engine.transmittances(&packet, tiny, tiny, &mut workspace);
            let blocked = stage.exact(&packet);
            for lane in packet.lanes() {
                let exact = if blocked >> lane & 1 == 1 { 0.0 } else { 1.0 };
                if fast[lane] != exact {
                    let Segment { origin, direction, near, far } = segment(&packet, lane);
                    let verdict = brute.verdict(origin, direction, near, far, 1e-5);
                    assert_eq!(
                        verdict,
                        Verdict::Marginal,
                        "{name}: {} and Embree {exact}: {origin} {direction}",
                        fast[lane]
                    );
                    marginal += 1;
                }
            }
        }
        assert!(aggregated * 50 <= segments, "{name}: {aggregated} of {segments} aggregated");
        assert!(marginal * 200 <= segments, "{name}: {marginal} of {segments} segments are marginal");
    }
}

/// Larger features to resolve, more to aggregate; one segment a bundle, so that each is judged on its own.
#[test]
fn aggregation_grows_with_the_feature_size() {
    for name in ["forest", "cubes", "desk-room"] {
        let stage = Stage::generated(name);
        let engine = stage.engine(Leaf::Exact);
        let mut workspace = Workspace::default();
        let (mut sums, mut nodes) = ([0u64; 12], [0u64; 12]);
        for packet in stage.bundles(5, 400, 1) {
            let mut before = Cost::default();
            for (k, sum) in sums.iter_mut().enumerate() {
                let s = 1e-4 * stage.size() * 2f32.powi(k as i32);
                let bundle = Bundle { packets: std::slice::from_ref(&packet), emitter_size: 0.0 };
                let cost = engine.answer(bundle, s, &mut workspace).cost;
                if before.handed_over + cost.handed_over == 0 {
                    assert!(
                        cost.aggregated >= before.aggregated,
                        "{name}: opened again at s {s}: {packet:?}"
                    );
                }
                *sum += cost.aggregated;
                nodes[k] += cost.nodes;
                before = cost;
            }
        }
        assert!(sums.windows(2).all(|w| w[0] <= w[1]), "{name}: {sums:?}");
        assert!(sums[11] > sums[0], "{name}: {sums:?}");
        assert!(nodes[11] < nodes[0], "{name}: {nodes:?} nodes");
    }
}

// --- what no feature size may change ---------------------------------------------------------------------------------

/// Method D.8: two rooms of clutter with a thin wall between them, all one object. Nothing passes the wall.
#[test]
fn nothing_passes_a_thin_wall() {
    for cells in [1, 12] {
        let mut pieces = cloud(31, 1500, 0.06, DVec3::new(4.0, 3.0, 3.0), true);
        let (dy, dz) = (3.0 / f64::from(cells), 3.0 / f64::from(cells));
        for (j, k) in (0..cells * cells).map(|n| (f64::from(n % cells), f64::from(n / cells))) {
            pieces.quad(DVec3::new(2.0, (j + 0.5) * dy, (k + 0.5) * dz), dy * DVec3::Y, dz * DVec3::Z);
        }
        let stage = Stage::new(pieces.scene());
        let mut random = Pcg64Mcg::new(2);
        let origin = stage.scene.origin;
        for leaf in [Leaf::Exact, Leaf::Extinction] {
            let engine = stage.engine(leaf);
            let mut workspace = Workspace::default();
            for _ in 0..200 {
                let mut packet = Packet::EMPTY;
                let left =
                    |random: &mut Pcg64Mcg| in_cube(random) * DVec3::new(1.99, 2.9, 2.9) + DVec3::splat(0.0);
                let from = (left(&mut random) - origin).as_vec3();
                for lane in 0..LANES {
                    let to = DVec3::new(2.01, 0.05, 0.05) + in_cube(&mut random) * DVec3::new(1.9, 2.9, 2.9);
                    packet.set(lane, from, (to - origin).as_vec3(), end_rule(&stage.scene));
                }
                // The end rule leaves up to a thousandth of the segment out.
                if from.x + origin.x as f32 > 1.98 {
                    continue;
                }
                for s in [1e-3, 0.03, 0.3, 1.0, 10.0, 1e3] {
                    for e in [0.0, 0.1, 5.0] {
                        let passed = engine.transmittances(&packet, e, s, &mut workspace);
                        assert_eq!(passed, [0.0; LANES], "{cells} cells, {leaf:?}, s {s}, e {e}: {packet:?}");
                    }
                }
            }
        }
    }
}

/// Method D.6: bricks that touch are opaque together, whatever size decides about each. With the paper's isolated
/// BSIZE and κ = ΣA/4V such a wall passes exp(-1.5) = 22 %; a twentieth of the light is the bar here, until
/// sizes are measured in context.
#[test]
fn brick_walls_leak_little() {
    let stage = Stage::generated("brick-wall");
    let bricks: Vec<u32> = (0..stage.scene.triangles.len() as u32)
        .filter(|&t| {
            stage.scene.objects[stage.scene.triangle_object[t as usize] as usize].name.starts_with("brick")
        })
        .collect();
    let wall = crate::math::Aabb::of(bricks.iter().flat_map(|&t| stage.scene.corners(t)));
    let engine = stage.engine(Leaf::Exact);
    let (mut random, mut workspace) = (Pcg64Mcg::new(6), Workspace::default());
    let e = stage.scene.emitters[0].min_width;
    for s in [0.02, 0.05, 0.1, 0.2, 0.4, 0.8] {
        let (mut sum, mut worst) = (0.0f32, 0.0f32);
        for _ in 0..400 {
            let aim = in_cube(&mut random).as_vec3() * 0.9 + 0.05;
            let through = wall.min + aim * wall.extent();
            let slope = 0.2 * direction(&mut random).with_y(0.0);
            let mut packet = Packet::EMPTY;
            let along = (Vec3::Y + slope) * 0.7;
            packet.set(0, through + along, through - along, end_rule(&stage.scene));
            let t = engine.transmittances(&packet, e, s, &mut workspace)[0];
            (sum, worst) = (sum + t / 400.0, worst.max(t));
        }
        println!("brick wall, s {s}: mean {sum}, worst {worst}");
        assert!(sum < 0.05 && worst < 0.22, "s {s}: the wall passes {sum}, in places {worst}");
    }
}

/// Method D.9: a disc of half the emitter's size has no umbra, yet hides three quarters of it. Two such discs side by
/// side are one cluster; by the size of its umbra alone it may be averaged at any s, and the shadow behind each disc
/// is gone. The grain keeps it.
#[test]
fn penumbrae_of_strong_contrast_stay() {
    let mut discs = Pieces::new();
    for x in [0.0, 2.0] {
        let rim = (0..8).map(|k| (f64::from(k) + 0.5) * std::f64::consts::TAU / 8.0);
        discs.polygon(&rim.map(|t| DVec3::new(x + 0.25 * t.cos(), 0.25 * t.sin(), 4.0)).collect::<Vec<_>>());
    }
    let stage = Stage::with(
        discs.scene(),
        &hierarchy::Options { large_surface: f32::INFINITY, ..Default::default() },
        Extinction::Measured,
    );
    // What the paper's rule sees of both together: less than the emitter, so no umbra whatever s is.
    let both = &stage.traits[0];
    assert!(umbra(1.0, f64::from(both.blocked[2]), 3.0, 4.0) < 0.0, "{both:?}");
    assert!(both.coverage[2] < 0.4 && both.feature_size(2) > 0.6, "{both:?}");
    let (mut random, mut workspace) = (Pcg64Mcg::new(31), Workspace::default());
    let at = |p: DVec3| (p - stage.scene.origin).as_vec3();
    let mut packets = vec![Packet::EMPTY; 64];
    let mut hit = 0;
    for k in 0..64 * LANES {
        let turn = std::f64::consts::TAU * unit(&mut random);
        let rim = 0.5 * unit(&mut random).sqrt();
        // At the disc's height the segment has come four sevenths of its way.
        hit += usize::from(rim * 4.0 / 7.0 < 0.25);
        let end = DVec3::new(rim * turn.cos(), rim * turn.sin(), 7.0);
        packets[k / LANES].set(k % LANES, at(DVec3::ZERO), at(end), end_rule(&stage.scene));
    }
    let truth = 1.0 - hit as f32 / (64 * LANES) as f32;
    assert!((1.0 - peak_occlusion(1.0, 0.5, 3.0, 4.0) as f32 - truth).abs() < 0.05, "{truth}");
    let bundle = Bundle { packets: &packets, emitter_size: 1.0 };
    for s in [0.05, 0.2, 0.4] {
        let found = stage.engine(Leaf::Exact).answer(bundle, s, &mut workspace).transmittance;
        // An octagon covers nine tenths of its disc.
        assert!((found - truth).abs() < 0.12, "s {s}: {found} passes, {truth} should");
    }
}

/// A segment in the plane of a triangle that it passes aside, between others that cross the plane.
#[test]
fn triangles_on_their_edge_block_nothing() {
    let mut pieces = Pieces::new();
    let corners = [DVec3::new(0.5, 0.3, 0.0), DVec3::new(0.6, 0.3, 0.0), DVec3::new(0.5, 0.4, 0.0)];
    pieces.polygon(&corners);
    pieces.light(DVec3::X, DVec3::Y, DVec3::Z);
    let stage = Stage::new(pieces.scene());
    let origin = stage.scene.origin.as_vec3();
    let mut packet = Packet::EMPTY;
    for lane in 0..LANES {
        let z = if lane < 4 { 0.0 } else { lane as f32 / 8.0 - 1.0 };
        let to = Vec3::new(1.0, -0.5 - 0.02 * lane as f32, z);
        packet.set(lane, -origin, to - origin, end_rule(&stage.scene));
    }
    let t = stage.engine(Leaf::Exact).transmittances(&packet, 1e-6, 1e-6, &mut Workspace::default());
    assert_eq!(t, [1.0; LANES]);
}

/// A tessellated wall far from the receiver: no segment slips between the triangles (method D.8).
#[test]
fn nothing_slips_between_triangles_far_away() {
    for distance in [10.0, 1e3, 1e5] {
        let mut pieces = Pieces::new();
        for (i, j) in (-8..8).flat_map(|i| (-8..8).map(move |j| (i, j))) {
            let at = |i: i32, j: i32| DVec3::new(0.37 * f64::from(i), 0.41 * f64::from(j), 0.0);
            pieces.polygon(&[at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            pieces.polygon(&[at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
        pieces.light(DVec3::Z, DVec3::X, DVec3::Y);
        let stage = Stage::new(pieces.scene());
        let origin = stage.scene.origin.as_vec3();
        let mut random = Pcg64Mcg::new(3);
        let engine = stage.engine(Leaf::Exact);
        let mut leaks = 0;
        for _ in 0..2000 {
            let from = Vec3::new(0.3, 0.2, -distance as f32) - origin;
            let mut packet = Packet::EMPTY;
            for lane in 0..LANES {
                // Through the diagonals and the edges of the cells.
                let along = 5.0 * unit(&mut random) as f32 - 2.5;
                let through = match lane % 3 {
                    0 => Vec3::new(0.37 * along, 0.41 * along, 0.0),
                    1 => Vec3::new(0.74, along, 0.0),
                    _ => Vec3::new(along, 0.82, 0.0),
                } - origin;
                let to = through + 0.5 * (through - from);
                packet.set(lane, from, to, EndRule::new(distance as f32));
            }
            let t = engine.transmittances(&packet, 1e-6, 1e-6, &mut Workspace::default());
            leaks += t.iter().filter(|&&t| t > 0.0).count();
        }
        assert_eq!(leaks, 0, "{leaks} of 32000 segments slip through at distance {distance}");
    }
}

/// Method D.5: a point on something is not shadowed by the extinction of that thing, at either end.
#[test]
fn things_do_not_shadow_their_own_surface() {
    let mut random = Pcg64Mcg::new(12);
    let mut heap = Pieces::new();
    // Two leaves' worth of triangles, the upper ones side by side: nothing lies over them.
    for i in 0..3 {
        heap.quad(DVec3::new(0.11 * f64::from(i), 0.0, 0.5), 0.1 * DVec3::X, 0.1 * DVec3::Y);
        heap.quad(DVec3::new(0.11 * f64::from(i), 0.0, 0.4), 0.1 * DVec3::X, 0.1 * DVec3::Y);
    }
    let mut block = Pieces::new();
    block.cuboid(DVec3::splat(-0.05), DVec3::splat(0.05));
    for pieces in [heap, block] {
        let mut pieces = pieces;
        pieces.object("floor").quad(DVec3::ZERO - DVec3::Z, 8.0 * DVec3::X, 8.0 * DVec3::Y);
        pieces.light(5.0 * DVec3::Z, DVec3::Y, DVec3::X);
        let stage = Stage::new(pieces.scene());
        let things = stage.scene.faces_named("things").expect("things");
        let high = things.iter().flat_map(|&t| stage.scene.corners(t)).map(|p| p.z).fold(f32::MIN, f32::max);
        let upper: Vec<u32> = things
            .into_iter()
            .filter(|&t| stage.scene.corners(t).iter().all(|p| (p.z - high).abs() < 1e-4))
            .collect();
        assert!(upper.len() >= 2 && upper.iter().all(|t| stage.hierarchy.micro.order.contains(t)));
        let engine = stage.engine(Leaf::Exact);
        let mut workspace = Workspace::default();
        for _ in 0..200 {
            let on = stage.point(&mut random, &upper);
            let (mut up, mut down) = (Packet::EMPTY, Packet::EMPTY);
            for lane in 0..LANES {
                let light = stage.point(&mut random, &stage.scene.emitters[0].triangles);
                up.set(lane, on, light, end_rule(&stage.scene));
                down.set(lane, light, on, end_rule(&stage.scene));
            }
            for (packet, s) in [&up, &down].into_iter().flat_map(|p| [1e-3, 0.1, 1.0, 100.0].map(|s| (p, s)))
            {
                for e in [0.0, 0.5, 50.0] {
                    let t = engine.transmittances(packet, e, s, &mut workspace);
                    assert_eq!(t, [1.0; LANES], "s {s}, e {e}: {packet:?}");
                }
            }
        }
    }
}

/// Parallel lines over a square that covers the scene, and the area that each stands for.
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

/// Method D.11: no cut counts a triangle twice or leaves one out.
///
/// Over parallel lines the integral of the path through a box is its volume, so that the integral of the optical
/// depth is Σ κ V = Σ sides·A / 4 for every antichain of clusters that holds all triangles, whatever s chose it. With an
/// emitter of size s the threshold is s all along, so that all lines have the same cut.
#[test]
fn optical_depth_is_the_same_for_every_cut() {
    let mut random = Pcg64Mcg::new(77);
    for (name, sheets) in [("sheets", true), ("cubes", false)] {
        let pieces = cloud(40, if sheets { 600 } else { 250 }, 0.08, DVec3::ONE, sheets);
        let stage = Stage::soft(pieces.scene());
        let area: f64 = (0..stage.scene.triangles.len() as u32)
            .map(|t| {
                let [a, b, c] = stage.scene.corners(t);
                f64::from(stage.scene.triangle_sides[t as usize]) * crate::math::triangle_area(a, b, c)
            })
            .sum();
        let engine = stage.engine(Leaf::Extinction);
        let mut workspace = Workspace::default();
        for s in [1e-6, 0.03, 0.1, 0.3, 1.0, 10.0] {
            let (packets, each) = parallel(&stage, direction(&mut random), 16, &mut random);
            let (mut fast, mut slow) = (0.0, 0.0);
            for packet in &packets {
                let t = engine.transmittances(packet, s, s, &mut workspace);
                for lane in packet.lanes() {
                    fast -= f64::from(t[lane]).ln() * each;
                    let segment = segment(packet, lane);
                    let met = walk(
                        &stage.hierarchy,
                        &stage.traits,
                        segment,
                        towards(packet),
                        (s, s),
                        Leaf::Extinction,
                        |_| false,
                    );
                    slow += met.depth * each;
                }
            }
            // The lines are a jittered grid over boxes: two per cent.
            assert!(
                (slow / (area / 4.0) - 1.0).abs() < 0.02,
                "{name}, s {s}: reference {slow}, area / 4 {}",
                area / 4.0
            );
            assert!(
                (fast / (area / 4.0) - 1.0).abs() < 0.02,
                "{name}, s {s}: engine {fast}, area / 4 {}",
                area / 4.0
            );
        }
    }
}

/// Average visibility [SD95 sec 5]: of extinction alone, so that no triangle of a cluster is ever asked.
#[test]
fn average_visibility_traces_no_rays() {
    let stage = Stage::soft(cloud(41, 6000, 0.03, DVec3::ONE, true).scene());
    let engine = stage.engine(Leaf::Extinction);
    let mut random = Pcg64Mcg::new(1);
    let mut cost = Cost::default();
    for s in [1e-6, 0.01, 0.1, 1.0] {
        let (packets, _) = parallel(&stage, direction(&mut random), 16, &mut random);
        for packet in &packets {
            let bundle = Bundle { packets: std::slice::from_ref(packet), emitter_size: 0.0 };
            cost.add(engine.answer(bundle, s, &mut Workspace::default()).cost);
        }
    }
    assert!(cost.exact_rays == 0 && cost.handed_over == 0, "{cost:?}");
}

/// Beer's law: average visibility through a Poisson cloud is exp(-κ d), and what rays measure.
#[test]
fn average_visibility_of_a_cloud_follows_beers_law() {
    let side = 4.0;
    let (count, edge) = (6000, 0.1);
    let scene = cloud(50, count, edge, DVec3::splat(side), true).scene();
    let stage = Stage::soft(scene);
    let engine = stage.engine(Leaf::Extinction);
    let kappa = count as f64 * 0.5 * edge * edge / side.powi(3);
    let (mut random, mut workspace) = (Pcg64Mcg::new(3), Workspace::default());
    let length = 2.5;
    let expect = (-kappa * length).exp();
    let origin = stage.scene.origin;
    for s in [0.05, 0.2, 0.5, 10.0] {
        let (mut model, mut rays, n) = (0.0, 0.0, 4000);
        for _ in 0..n {
            let mut packet = Packet::EMPTY;
            let view = direction(&mut random).as_dvec3();
            let middle = DVec3::splat(0.5 * side) + (in_cube(&mut random) - 0.5) * (side - length - 0.4);
            let from = (middle - 0.5 * length * view - origin).as_vec3();
            packet.set(0, from, (middle + 0.5 * length * view - origin).as_vec3(), EndRule::new(1.0));
            model += f64::from(engine.transmittances(&packet, 0.0, s, &mut workspace)[0]) / f64::from(n);
            rays += f64::from(1 - (stage.exact(&packet) & 1)) / f64::from(n);
        }
        println!("Beer, s {s}: model {model:.4}, rays {rays:.4}, exp(-κd) {expect:.4}");
        // Rays: 0.008 of sampling and as much of this one cloud. Clusters: small ones are uneven, and the mean of
        // exponentials is above the exponential of the mean (method D.26).
        assert!((rays - expect).abs() < 0.03, "rays {rays}, law {expect}");
        assert!((model - expect).abs() < 0.06, "s {s}: model {model}, law {expect}");
    }
}

// --- answers ---------------------------------------------------------------------------------------------------------

/// See `wilson_interval`.
#[test]
fn intervals_hold_their_answers() {
    for name in ["forest", "cubes", "desk-room"] {
        let stage = Stage::generated(name);
        let (engine, exact) = (stage.engine(Leaf::Exact), Exact { scene: &stage.traced, traversal: SINGLE });
        let (mut workspace, mut blocked) = (Workspace::default(), Vec::new());
        for lanes in [1, 4, 16] {
            let bundles = stage.bundles(23, 150, lanes);
            for packets in bundles.chunks(1).chain(bundles.chunks(2)) {
                let n = packets.iter().map(Packet::len).sum::<usize>() as u64;
                for s in stage.sizes() {
                    let bundle = Bundle { packets, emitter_size: 0.2 * stage.scene.emitters[0].min_width };
                    let answer = engine.answer(bundle, s, &mut workspace);
                    let truth = exact.answer(bundle, &mut blocked);
                    for Answer { transmittance, lo, hi, cost, .. } in [answer, truth] {
                        assert!(
                            0.0 <= lo && lo <= transmittance && transmittance <= hi && hi <= 1.0,
                            "{answer:?}"
                        );
                        assert!(hi > lo && cost.segments == n, "{answer:?}");
                        assert!(
                            cost.exact_rays <= n
                                && cost.aggregated <= n
                                && cost.handed_over <= cost.exact_rays
                        );
                    }
                    let mut mean = 0.0;
                    for p in packets {
                        mean += engine
                            .transmittances(p, bundle.emitter_size, s, &mut workspace)
                            .iter()
                            .sum::<f32>()
                            / n as f32;
                    }
                    // Larger bundles read optical depths off their first packet.
                    assert!(
                        packets.len() > 1 || (mean - answer.transmittance).abs() < 1e-5,
                        "{mean}: {answer:?}"
                    );
                    match answer.method {
                        Method::Clear => assert!(answer.transmittance == 1.0 && answer.cost.exact_rays == 0),
                        Method::Exact => assert!(answer.cost.aggregated == 0 && answer.cost.exact_rays > 0),
                        Method::Aggregated => {
                            assert!(answer.cost.exact_rays == 0 && answer.cost.aggregated > 0)
                        }
                        Method::Mixed => assert!(answer.cost.exact_rays > 0 && answer.cost.aggregated > 0),
                    }
                    assert_eq!(truth.method, Method::Exact);
                }
            }
        }
    }
}

/// Certificates change no answer: bundles that are asked as exact visibility does, but for those that nothing or one
/// triangle decides, agree with rays segment by segment, and no cluster is ever aggregated.
#[test]
fn certified_answers_are_exact() {
    for name in ["forest", "cubes", "desk-room"] {
        let stage = Stage::generated(name);
        let engine = stage.engine(Leaf::Exact);
        let exact = Exact { scene: &stage.traced, traversal: SINGLE };
        let (mut workspace, mut blocked) = (Workspace::default(), Vec::new());
        let packets = stage.bundles(29, 600, 16);
        let e = stage.scene.emitters[0].min_width;
        let bundles: Vec<Bundle> =
            packets.chunks(1).map(|packets| Bundle { packets, emitter_size: e }).collect();
        let (mut k, mut without_rays, mut apart) = (0, 0, 0);
        engine.certified(&bundles, &mut workspace, |answer| {
            let truth = exact.answer(bundles[k], &mut blocked);
            assert_eq!(answer.cost.aggregated, 0);
            without_rays += usize::from(answer.cost.exact_rays == 0);
            apart += usize::from((answer.transmittance - truth.transmittance).abs() > 1e-6);
            k += 1;
        });
        assert_eq!(k, bundles.len());
        // Grazing segments may differ by a rounding.
        assert!(apart <= bundles.len() / 100, "{name}: {apart} of {} differ", bundles.len());
        assert!(without_rays > 0, "{name}: no certificate in {} bundles", bundles.len());
    }
}

/// Stated intervals hold the truth as often as they say, for fields of leaves at every distance where aggregation
/// begins; and they are no wider than they must be: the claimed error is of the size of the one that is there.
#[test]
fn claimed_errors_are_those_that_are_there() {
    let mut spec = generate::Spec::new("forest");
    (spec.trees, spec.leaves) = (20, 300);
    let stage = Stage::new(generate::build(&spec).expect("forest"));
    let engine = stage.engine(Leaf::Exact).with_tolerance(0.1);
    let points = crate::bench::workload::surface_points(&stage.scene, 600, 3).expect("points");
    let workload = crate::bench::workload::Workload::new(&stage.scene, points, 3);
    let exact = Exact { scene: &stage.traced, traversal: SINGLE };
    let (mut workspace, mut blocked) = (Workspace::default(), Vec::new());
    for s in [0.1f32, 0.4] {
        let (mut inside, mut count, mut claimed, mut there, mut aggregated) = (0, 0, 0.0f64, 0.0f64, 0);
        for pair in 0..workload.pairs.len() {
            let (mut packets, mut truth) = (Vec::new(), Vec::new());
            workload.add_bundle(&stage.scene, pair, 256, 0, &mut packets);
            workload.add_bundle(&stage.scene, pair, 4096, 1, &mut truth);
            let e = workload.pairs[pair].emitter_size;
            let answer = engine.answer(Bundle { packets: &packets, emitter_size: e }, s, &mut workspace);
            if answer.cost.aggregated == 0 {
                continue;
            }
            let truth = exact.answer(Bundle { packets: &truth, emitter_size: e }, &mut blocked).transmittance;
            let Answer { transmittance, lo, hi, .. } = answer;
            count += 1;
            aggregated += usize::from(answer.method == Method::Aggregated);
            inside += u32::from(lo - 0.01 <= truth && truth <= hi + 0.01);
            claimed += f64::from((hi - lo) / 3.92).powi(2);
            there += f64::from(transmittance - truth).powi(2);
        }
        let (claimed, there) = ((claimed / f64::from(count)).sqrt(), (there / f64::from(count)).sqrt());
        assert!(count > 200 && aggregated > 20, "{count} answers, {aggregated} of them without a triangle");
        let coverage = f64::from(inside) / f64::from(count);
        assert!(coverage >= 0.93, "s {s}: {coverage} of {count} inside, claimed {claimed}, there {there}");
        assert!(claimed < 2.5 * there && there < 1.5 * claimed, "s {s}: claimed {claimed}, there {there}");
    }
}

/// Wilson's interval for 4 of 16: 0.1018 to 0.4950 (Wilson 1927, z = 1.96), and its ends.
///
/// For a mean of 1 the upper end must not be rounded to 0.99999994: the interval of a clear bundle would not hold its
/// own answer (and `interval_coverage` of an unoccluded scene would be 0).
#[test]
fn wilson_interval() {
    let (lo, hi) = wilson(0.25, 16.0);
    assert!((lo - 0.1018).abs() < 5e-4 && (hi - 0.4950).abs() < 5e-4, "{lo} {hi}");
    // None of n: z² / (n + z²).
    let (lo, hi) = wilson(0.0, 16.0);
    assert!(lo == 0.0 && (hi - 3.8416 / 19.8416).abs() < 1e-4, "{lo} {hi}");
    let (lo, hi) = wilson(1.0, 16.0);
    assert!((lo - (1.0 - 3.8416 / 19.8416)).abs() < 1e-4 && hi > 0.9999, "{lo} {hi}");
    // It holds the mean itself, also at the ends of its range: a bundle that is all clear is in its own interval.
    for n in 1..=1024 {
        for clear in 0..=n {
            let mean = clear as f32 / n as f32;
            let (lo, hi) = wilson(mean, n as f32);
            assert!(0.0 <= lo && lo <= mean && mean <= hi && hi <= 1.0, "{clear} of {n}: {lo} to {hi}");
        }
    }
}

/// Scenes at the ends of the range: one triangle, nothing but large surfaces, nothing but clusters.
#[test]
fn extreme_scenes_are_answered_as_embree_does() {
    let mut one = Pieces::new();
    one.polygon(&[DVec3::ZERO, DVec3::X, DVec3::Y]);
    let mut room = Pieces::new();
    room.cuboid(DVec3::splat(-1.0), DVec3::ONE);
    room.quad(DVec3::ZERO, DVec3::X, DVec3::Y);
    let mut two = Pieces::new();
    two.quad(DVec3::ZERO, DVec3::X, DVec3::Y).quad(50.0 * DVec3::X, 0.01 * DVec3::X, 0.01 * DVec3::Y);
    for pieces in [one, room, two] {
        let scene = pieces.scene();
        for stage in [Stage::new(scene.clone()), Stage::soft(scene)] {
            let engine = stage.engine(Leaf::Exact);
            let (mut random, mut workspace) = (Pcg64Mcg::new(30), Workspace::default());
            let brute = Brute::new(&stage.scene.positions, &stage.scene.triangles);
            let (mut clear, mut blocked) = (0, 0);
            for _ in 0..300 {
                let mut packet = Packet::EMPTY;
                let mut at = || {
                    let centre = stage.scene.bounds.center();
                    centre + (in_cube(&mut random) - 0.5).as_vec3() * 1.5 * stage.size().min(3.0)
                };
                let from = at();
                (0..LANES).for_each(|lane| packet.set(lane, from, at(), end_rule(&stage.scene)));
                let tiny = 1e-6 * stage.size();
                let fast = engine.transmittances(&packet, tiny, tiny, &mut workspace);
                let exact = stage.exact(&packet);
                for (lane, &fast) in fast.iter().enumerate() {
                    let Segment { origin, direction, near, far } = segment(&packet, lane);
                    let agree = (fast == 0.0) == (exact >> lane & 1 == 1);
                    let verdict = brute.verdict(origin, direction, near, far, 1e-5);
                    assert!(
                        agree || verdict == Verdict::Marginal,
                        "{origin} {direction}: {} {verdict:?}",
                        fast
                    );
                    *if fast == 0.0 { &mut blocked } else { &mut clear } += 1;
                }
            }
            assert!(clear > 0 && (blocked > 0 || stage.size() > 10.0), "{clear} clear, {blocked} blocked");
        }
    }
}

/// A bundle without segments and packets with gaps are no accidents.
#[test]
fn lanes_without_segments_do_not_count() {
    let stage = Stage::generated("cubes");
    let engine = stage.engine(Leaf::Exact);
    let mut workspace = Workspace::default();
    // Nothing is aggregated: that depends on the direction of the whole bundle.
    let tiny = 1e-6 * stage.size();
    let none = engine.answer(Bundle { packets: &[], emitter_size: 0.1 }, 0.1, &mut workspace);
    assert_eq!(none.cost, Cost::default());
    assert!(none.transmittance.is_finite() && none.lo.is_finite() && none.hi.is_finite(), "{none:?}");
    for packet in stage.bundles(2, 100, 16) {
        let all = engine.transmittances(&packet, 0.0, tiny, &mut workspace);
        let mut some = packet.clone();
        some.active &= 0b1010_0000_1100_0010;
        let found = engine.transmittances(&some, 0.0, tiny, &mut workspace);
        for lane in 0..LANES {
            if some.active >> lane & 1 == 0 {
                assert_eq!(found[lane], 0.0, "an unused lane passes light");
            } else {
                assert_eq!(
                    found[lane] == 0.0,
                    all[lane] == 0.0,
                    "lane {lane}: {} and {}",
                    found[lane],
                    all[lane]
                );
            }
        }
    }
}
