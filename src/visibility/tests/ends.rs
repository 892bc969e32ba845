//! Segment ends: what lies near an end blocks however long the segment is, and the surface at an end does not.

use super::*;
use crate::ray::{Brute, Verdict};
use crate::scene::testing::{Pieces, in_cube, rotation};
use glam::{DMat3, DVec3};

/// A packet of lifted segments between points of two faces.
fn lifted(stage: &Stage, points: impl Fn(usize) -> [(Vec3, Vec3); 2]) -> Packet {
    let ends = end_rule(&stage.scene);
    let mut packet = Packet::EMPTY;
    for lane in 0..LANES {
        let [(a, na), (b, nb)] = points(lane);
        packet.set_lifted(lane, ends.lifted_towards(a, na, b), ends.lifted_towards(b, nb, a), ends);
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
        assert_eq!(clear, verdict == Verdict::Clear, "{origin} {direction}: {verdict:?}");
        clear
    })
}

/// A plate 9 cm above the floor, under a light at 1 km and in a valley of 50 km.
#[test]
fn a_plate_near_the_floor_hides_a_distant_light() {
    for (half, height) in [(5.0, 1000.0), (25_000.0, 5000.0)] {
        let mut pieces = Pieces::new();
        pieces.quad(DVec3::ZERO, 2.0 * half * DVec3::X, 2.0 * half * DVec3::Y);
        pieces.object("plate").quad(0.09 * DVec3::Z, 2.0 * DVec3::X, 2.0 * DVec3::Y);
        pieces.light(height * DVec3::Z, 10.0 * DVec3::Y, 10.0 * DVec3::X);
        let scene = pieces.scene();
        for stage in [Stage::new(scene.clone()), Stage::soft(scene)] {
            let at = |x: f64, y: f64, z: f64| (DVec3::new(x, y, z) - stage.scene.origin).as_vec3();
            for (x, clear) in [(0.3, false), (1.5, true)] {
                let packet = lifted(&stage, |lane| {
                    let (u, v) = ((lane % 4) as f64, (lane / 4) as f64);
                    [(at(x, -0.2, 0.0), Vec3::Z), (at(2.0 * u - 3.0, 2.0 * v - 3.0, height), Vec3::Z)]
                });
                assert_eq!(agreed(&stage, &packet), [clear; LANES], "{half} {x}");
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
                [(from, Vec3::Z), (at(DVec3::new(5.2, 4.6 + 0.8 * x, 9.0)), Vec3::Z)]
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
            let ends = end_rule(&stage.scene);
            let engine = stage.engine(LeafMode::Exact);
            let mut lost = 0;
            for _ in 0..500 {
                let mut packet = Packet::EMPTY;
                let mut point = || {
                    let t = all[(in_cube(&mut random).x * all.len() as f64) as usize];
                    let [a, b, c] = stage.scene.corners(t);
                    (stage.point(&mut random, &[t]), crate::math::triangle_normal(a, b, c))
                };
                let (from, normal) = point();
                for lane in 0..LANES {
                    let (to, above) = point();
                    packet.set_lifted(lane, ends.lifted(from, normal), ends.lifted(to, above), ends);
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
