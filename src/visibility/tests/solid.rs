//! Invariants under the feature size: walls stay opaque, and nothing shadows itself.

use super::*;
use crate::scene::testing::{Pieces, cloud, direction, in_cube};
use glam::DVec3;

/// Two rooms of clutter separated by a thin wall, all one object: no light passes the wall (docs/method.md, Traps: thin
/// walls).
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
        for leaf in [LeafMode::Exact, LeafMode::Average] {
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
                // The end rule leaves out up to a thousandth of the segment.
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

/// Touching bricks are opaque together, whatever the size of each (docs/method.md, Traps: joint features). With sizes
/// of isolated bricks and κ = ΣA/4V the wall would transmit exp(-1.5) = 22 %; the limit here is a twentieth, until
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
    let engine = stage.engine(LeafMode::Exact);
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

/// A point on an object is not shadowed by the extinction of that object, at either end (docs/method.md, Segment ends).
#[test]
fn things_do_not_shadow_their_own_surface() {
    let mut random = Pcg64Mcg::new(12);
    let mut heap = Pieces::new();
    // Two leaf clusters of triangles, the upper ones side by side, with nothing above them.
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
        let engine = stage.engine(LeafMode::Exact);
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
