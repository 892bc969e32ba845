//! Edge-on, distant and single triangles, and unused lanes.

use super::*;
use crate::ray::{Brute, HitResult};
use crate::scene::testing::{Pieces, in_cube};
use glam::DVec3;

/// A segment in the plane of a triangle that passes beside it, together with segments that cross the plane.
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
    let t = stage.engine(LeafMode::Exact).transmittances(&packet, 1e-6, 1e-6, &mut Workspace::default());
    assert_eq!(t, [1.0; LANES]);
}

/// A tessellated wall far from the receiver: no segment passes between its triangles (docs/method.md, Traps: thin
/// walls).
#[test]
fn nothing_slips_between_triangles_far_away() {
    for distance in [10.0, 1e3, 1e5] {
        let mut pieces = Pieces::new();
        pieces.field(-8..8, |i, j| DVec3::new(0.37 * f64::from(i), 0.41 * f64::from(j), 0.0));
        pieces.light(DVec3::Z, DVec3::X, DVec3::Y);
        let stage = Stage::new(pieces.scene());
        let origin = stage.scene.origin.as_vec3();
        let mut random = Pcg64Mcg::new(3);
        let engine = stage.engine(LeafMode::Exact);
        let mut leaks = 0;
        for _ in 0..2000 {
            let from = Vec3::new(0.3, 0.2, -distance as f32) - origin;
            let mut packet = Packet::EMPTY;
            for lane in 0..LANES {
                // Aim at the diagonals and the edges of the cells.
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

/// Extreme scenes: one triangle, only large surfaces, only clusters.
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
            let engine = stage.engine(LeafMode::Exact);
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
                        agree || verdict == HitResult::Marginal,
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

/// Bundles without segments and packets with unused lanes are valid.
#[test]
fn lanes_without_segments_do_not_count() {
    let stage = Stage::generated("cubes");
    let engine = stage.engine(LeafMode::Exact);
    let mut workspace = Workspace::default();
    // Nothing is aggregated here, because aggregation depends on the direction of the whole bundle.
    let tiny = 1e-6 * stage.size();
    let none = engine.answer(Bundle { packets: &[], emitter_size: 0.1, emitter: &[] }, 0.1, &mut workspace);
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
