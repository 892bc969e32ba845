//! Segment ends: what lies near an end blocks however long the segment is, and the surface at an end does not.

use super::*;
use crate::bench::workload::{ReceiverPoint, Workload};
use crate::ray::{Brute, HitResult};
use crate::scene::testing::{Pieces, in_cube, rotation};
use glam::{DMat3, DVec3};

/// A point on a face: position, unit normal, triangle.
type OnFace = (Vec3, Vec3, u32);

/// A packet of lifted segments between points of two faces.
fn lifted(stage: &Stage, points: impl Fn(usize) -> [OnFace; 2]) -> Packet {
    let magnitudes = stage.scene.face_magnitudes();
    let mut packet = Packet::EMPTY;
    for lane in 0..LANES {
        let [(a, na, s), (b, nb, t)] = points(lane);
        let [here, there] = [s, t].map(|t| EndRule::new(magnitudes[t as usize]));
        let rules = [here, there.seen_from(here)];
        let [from, to] = [rules[0].lifted_towards(a, na, b), rules[1].lifted_towards(b, nb, a)];
        packet.set_lifted(lane, from, to, rules);
    }
    packet
}

/// Transmittances by Embree, by the multi-resolution engine and by brute force agree; gives them.
fn agreed(stage: &Stage, packet: &Packet) -> [bool; LANES] {
    let exact = stage.exact(packet);
    let tiny = 1e-7 * stage.size();
    let engine = stage.engine(LeafMode::Exact);
    let fast = engine.transmittances(packet, tiny, tiny, &mut Workspace::default());
    let brute = Brute::new(&stage.scene.positions, &stage.scene.triangles);
    std::array::from_fn(|lane| {
        let clear = exact >> lane & 1 == 0;
        let Segment { origin, direction, near, far } = segment(packet, lane);
        assert_eq!(clear, fast[lane] > 0.0, "{origin} {direction}");
        let verdict = brute.verdict(origin, direction, near, far, 0.0);
        assert_eq!(clear, verdict == HitResult::Clear, "{origin} {direction}: {verdict:?}");
        clear
    })
}

/// A floor of half a width, a plate of 2 x 2 m above it, and a lamp of 10 x 10 m at a height. The floor's triangles are 0 and 1, those of
/// the plate 2 and 3, those of the lamp 4 and 5.
fn plate(half: f64, gap: f64, height: f64, turn: DMat3) -> Scene {
    let mut pieces = Pieces::new();
    pieces.quad(DVec3::ZERO, 2.0 * half * turn.x_axis, 2.0 * half * turn.y_axis);
    pieces.object("plate").quad(gap * turn.z_axis, 2.0 * turn.x_axis, 2.0 * turn.y_axis);
    pieces.light(height * turn.z_axis, 10.0 * turn.y_axis, 10.0 * turn.x_axis);
    pieces.scene()
}

/// Half a width of the floor, height of the plate above it, and height of the lamp: 9 cm in a valley of 50 km, and lamps so far away
/// that the plate is nearer to the floor than rounding of the whole scene.
const PLATES: [(f64, f64, f64); 6] = [
    (5.0, 0.09, 1e3),
    (25e3, 0.09, 5e3),
    (5.0, 0.09, 5e4),
    (5.0, 0.01, 5e3),
    (5.0, 0.005, 5e3),
    (5.0, 0.002, 5e4),
];

/// The plate hides the lamp from the floor and the floor from the lamp, for segments in both directions.
#[test]
fn a_plate_near_the_floor_hides_a_distant_light() {
    let mut random = Pcg64Mcg::new(29);
    for (half, gap, height) in PLATES {
        for turn in [DMat3::IDENTITY, rotation(&mut random)] {
            // Rounding of the corners of a floor of 50 km turns it by more than the plate's height, unless it lies level.
            if half > 5.0 && turn != DMat3::IDENTITY {
                continue;
            }
            let scene = plate(half, gap, height, turn);
            for stage in [Stage::new(scene.clone()), Stage::soft(scene)] {
                let at = |x: f64, y: f64, z: f64| (turn * DVec3::new(x, y, z) - stage.scene.origin).as_vec3();
                for (x, clear) in [(0.3, false), (1.5, true)] {
                    let up = turn.z_axis.as_vec3();
                    let ends = |lane: usize| {
                        let (u, v) = ((lane % 4) as f64, (lane / 4) as f64);
                        let on_floor = (at(x, -0.2, 0.0), up, 0);
                        [on_floor, (at(2.0 * u - 3.0, 2.0 * v - 3.0, height), up, 4)]
                    };
                    let packet = lifted(&stage, ends);
                    assert_eq!(agreed(&stage, &packet), [clear; LANES], "{half} {gap} {height} {x}");
                    let packet = lifted(&stage, |lane| {
                        let [floor, lamp] = ends(lane);
                        [lamp, floor]
                    });
                    assert_eq!(packet.backwards, if half > 5.0 { 0 } else { 0xffff });
                    assert_eq!(agreed(&stage, &packet), [clear; LANES], "down: {half} {gap} {height} {x}");
                }
            }
        }
    }
}

/// The rows of a benchmark: exact rays, multi-resolution visibility with a feature size below the plate's width, and certificates.
#[test]
fn benchmarks_see_the_plate() {
    for (half, gap, height) in PLATES {
        let scene = plate(half, gap, height, DMat3::IDENTITY);
        let stage = Stage::new(scene);
        let model = crate::model::testing::model(&stage.scene, crate::model::Detail::Optics);
        let at = |x: f64, y: f64| (DVec3::new(x, y, 0.0) - stage.scene.origin).as_vec3();
        let magnitude = stage.scene.magnitude_of(&[0, 1]);
        let point = |&(x, y): &(f64, f64)| ReceiverPoint { position: at(x, y), normal: Vec3::Z, magnitude };
        let points = [(0.3, -0.2), (-0.4, 0.1), (1.5, 0.0), (-2.0, 1.7)];
        let workload = Workload::new(&model, points.iter().map(point).collect(), 7);
        assert_eq!(workload.pairs.len(), points.len());
        let engine = stage.engine(LeafMode::Exact);
        for (pair, visible) in [0.0, 0.0, 1.0, 1.0].into_iter().enumerate() {
            let mut packets = Vec::new();
            workload.add_bundle(&stage.scene, pair, 64, 0, &mut packets);
            let of = |emitter| Bundle { packets: &packets, emitter_size: 10.0, emitter };
            let exact = Exact { scene: stage.traced.clone(), traversal: SINGLE };
            assert_eq!(exact.answer(of(&[]), &mut Vec::new()).transmittance, visible, "{gap} {height}");
            for hull in [&[][..], workload.hull_of_surface(pair)] {
                let answer = engine.answer(of(hull), 0.5, &mut Workspace::default());
                assert_eq!(answer.transmittance, visible, "{gap} {height}: {answer:?}");
            }
        }
    }
}

/// Sheets of paper on each other, each 1e-5 of the scene's diagonal above the other: only the top of the stack is lit.
#[test]
fn stacked_sheets_hide_each_other() {
    let gap = 1e-5 * 300f64.sqrt();
    let mut pieces = Pieces::new();
    pieces.cuboid(DVec3::ZERO, DVec3::splat(10.0));
    for k in 0..6 {
        let centre = DVec3::new(5.0, 5.0, 1.0 + gap * f64::from(k));
        pieces.object(&format!("sheet {k}")).quad(centre, DVec3::X, DVec3::Y);
    }
    pieces.light(DVec3::new(5.0, 5.0, 9.0), DVec3::Y, DVec3::X);
    let scene = pieces.scene();
    for stage in [Stage::new(scene.clone()), Stage::soft(scene)] {
        let at = |p: DVec3| (p - stage.scene.origin).as_vec3();
        for k in 0..6 {
            let z = 1.0 + gap * f64::from(k);
            let packet = lifted(&stage, |lane| {
                let x = lane as f64 / 16.0;
                let from = at(DVec3::new(4.6 + 0.8 * x, 5.2, z));
                // The triangles of the cuboid come first, those of the lamp last.
                let lamp = stage.scene.triangles.len() as u32 - 1;
                [(from, Vec3::Z, 12 + 2 * k), (at(DVec3::new(5.2, 4.6 + 0.8 * x, 9.0)), Vec3::Z, lamp)]
            });
            assert_eq!(agreed(&stage, &packet), [k == 5; LANES], "sheet {k}");
        }
    }
}

/// Every point of a bowl sees every other: segments along its bottom do not hit the faces at their ends.
#[test]
fn grazing_segments_do_not_hit_their_own_surface() {
    let mut random = Pcg64Mcg::new(13);
    for depth in [0.0, 1e-3, 0.3] {
        let turn = if depth == 0.3 { DMat3::IDENTITY } else { rotation(&mut random) };
        let n = 24;
        let place = |i: u32, j: u32| {
            let (x, y) = (f64::from(i) / f64::from(n) - 0.5, f64::from(j) / f64::from(n) - 0.5);
            turn * DVec3::new(x, y, depth * (x * x + y * y))
        };
        let mut pieces = Pieces::new();
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            pieces.polygon(&[place(i, j), place(i + 1, j), place(i + 1, j + 1)]);
            pieces.polygon(&[place(i, j), place(i + 1, j + 1), place(i, j + 1)]);
        }
        let scene = pieces.scene();
        for stage in [Stage::new(scene.clone()), Stage::soft(scene)] {
            let all: Vec<u32> = (0..stage.scene.triangles.len() as u32).collect();
            let magnitudes = stage.scene.face_magnitudes();
            let engine = stage.engine(LeafMode::Exact);
            let mut lost = 0;
            for _ in 0..500 {
                let mut packet = Packet::EMPTY;
                let mut point = || {
                    let t = all[(in_cube(&mut random).x * all.len() as f64) as usize];
                    let [a, b, c] = stage.scene.corners(t);
                    let end = EndRule::new(magnitudes[t as usize]);
                    (stage.point(&mut random, &[t]), crate::math::triangle_normal(a, b, c), end)
                };
                let (from, normal, here) = point();
                for lane in 0..LANES {
                    let (to, above, there) = point();
                    let rules = [here, there.seen_from(here)];
                    let [from, to] = [rules[0].lifted(from, normal), rules[1].lifted(to, above)];
                    packet.set_lifted(lane, from, to, rules);
                }
                let tiny = 1e-7 * stage.size();
                let fast = engine.transmittances(&packet, tiny, tiny, &mut Workspace::default());
                lost += stage.exact(&packet).count_ones();
                lost += fast.iter().map(|&t| u32::from(t == 0.0)).sum::<u32>();
            }
            assert_eq!(lost, 0, "depth {depth}: {lost} of 16,000 answers");
        }
    }
}

/// A wall of 2 x 2 m stands on a floor at x = 0.3. Points of the floor up to a few roundings behind it, from 0.3 r to 10 r, see nothing
/// before it.
#[test]
fn walls_block_points_at_their_foot() {
    let mut pieces = Pieces::new();
    pieces.quad(DVec3::ZERO, 8.0 * DVec3::X, 8.0 * DVec3::Y);
    pieces.object("wall").quad(DVec3::new(0.3, 0.0, 1.0), 2.0 * DVec3::Y, 2.0 * DVec3::Z);
    let stage = Stage::new(pieces.scene());
    let rule = EndRule::new(4.0);
    let foot = stage.scene.positions.iter().map(|p| p.x).find(|x| (x - 0.3).abs() < 1e-3).expect("the wall");
    let mut packet = Packet::EMPTY;
    for (lane, part) in [0.3, 0.5, 0.9, 1.1, 2.0, 10.0].into_iter().enumerate() {
        let place = Vec3::new(foot + part * rule.slack(), 0.02 * lane as f32, 0.0);
        let from = rule.lifted(place, Vec3::Z);
        packet.set_blocked_from_start(lane, from, Vec3::new(-1.5, 0.1, 0.8), [rule; 2]);
        packet.set_blocked_from_start(8 + lane, from, Vec3::new(1.5, 0.1, 0.8), [rule; 2]);
    }
    assert_eq!(stage.exact(&packet), 0b11_1111, "the wall blocks what is before it alone");
}
