//! The work of walks through instances.

use super::super::instances::{ENTER_BUNDLE, ENTER_PACKET};
use super::*;
use crate::model::{Detail, testing::model};
use crate::scene::Placement;
use crate::scene::testing::Pieces;
use glam::{DAffine3, DVec3};
use std::sync::Arc;

/// A bundle through the empty middle of a mesh meets few nodes, but its segments are transformed: that is counted, so that
/// bundles with many segments through many instances are handed over.
#[test]
fn entering_an_instance_is_counted() {
    let mut mesh = Pieces::new();
    for corner in [DVec3::ZERO, DVec3::splat(4.0)] {
        mesh.quad(corner, DVec3::X, DVec3::Y);
    }
    let mut pieces = Pieces::new();
    pieces.light(DVec3::new(0.0, 0.0, 50.0), DVec3::Y, DVec3::X);
    let mut scene = pieces.scene();
    scene.shared = vec![Arc::new(mesh.scene())];
    let counts = [1usize, 8];
    let [few, many] = counts.map(|count| {
        let mut scene = scene.clone();
        scene.placements = (0..count)
            .map(|k| Placement {
                mesh: 0,
                transform: DAffine3::from_translation(DVec3::new(0.0, 0.0, -10.0 * (k + 1) as f64)),
                name: format!("thing {k}"),
                material: None,
                visible: true,
            })
            .collect();
        let model = model(&scene, Detail::Optics);
        let middle = model.instances()[1].bounds(model.mesh_of(1)).center();
        let packets: Vec<Packet> = (0..16)
            .map(|_| {
                let mut packet = Packet::EMPTY;
                for lane in 0..LANES {
                    let by = 0.01 * Vec3::new((lane % 4) as f32, (lane / 4) as f32, 0.0);
                    let end = |z| Vec3::new(middle.x, middle.y, middle.z + z) + by;
                    packet.set(lane, end(-100.0), end(20.0), model.end_rule());
                }
                packet
            })
            .collect();
        let engine = model.engine(SINGLE, LeafMode::Exact).expect("optics").with_patience();
        let mut workspace = Workspace::default();
        // Emitter and feature size are so small that no shadow of the quads is smaller: nothing is averaged.
        let bundle = Bundle { packets: &packets, emitter_size: 1e-3, emitter: &[] };
        let answer = engine.answer(bundle, 1e-3, &mut workspace);
        assert!(answer.transmittance == 1.0 && answer.cost.handed_over == 0, "{answer:?}");
        // The same bundle within the usual limit.
        let limited = model.engine(SINGLE, LeafMode::Exact).expect("optics");
        let handed_over = limited.answer(bundle, 1e-3, &mut Workspace::default()).cost.handed_over > 0;
        (workspace.walked[0].work, handed_over)
    });
    let entered = ENTER_BUNDLE + 16 * ENTER_PACKET;
    assert!(few.0 >= entered && many.0 >= 8 * entered && many.0 < 12 * entered, "{few:?}, {many:?}");
    assert!(!few.1, "one instance is entered: {few:?}");
}
