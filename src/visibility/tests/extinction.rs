//! Extinction along lines: no double counting, and Beer's law.

use super::*;
use crate::optics::AxisMix;
use crate::scene::testing::{cloud, direction, in_cube};
use crate::visibility::plain_walk::{SegmentRule, walk};
use glam::DVec3;

/// No cut counts a triangle twice or omits one (docs/method.md, Traps: double counting).
///
/// Over parallel lines the integral of the path through a box is its volume, so the integral of the optical depth is Σ
/// κ V = Σ sides·A / 4 for every antichain of clusters that contains all triangles, whatever s selects. With an
/// emitter of size s the threshold is s everywhere, so that all lines have the same cut.
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
        let engine = stage.engine(LeafMode::Average);
        let mut workspace = Workspace::default();
        for s in [1e-6, 0.03, 0.1, 0.3, 1.0, 10.0] {
            let (packets, each) = parallel(&stage, direction(&mut random), 16, &mut random);
            let (mut fast, mut slow) = (0.0, 0.0);
            for packet in &packets {
                let t = engine.transmittances(packet, s, s, &mut workspace);
                let mix = AxisMix::around(towards(packet));
                let rule = SegmentRule { e: s, s, leaf: LeafMode::Average, mix };
                for lane in packet.lanes() {
                    fast -= f64::from(t[lane]).ln() * each;
                    let segment = segment(packet, lane);
                    let walked = walk(&stage.hierarchy, &stage.optics, segment, &rule, |_| false);
                    slow += walked.depth * each;
                }
            }
            // The lines are a jittered grid over boxes: tolerance two percent.
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

/// Beer's law: average visibility through a Poisson cloud is exp(-κ d), and agrees with rays.
#[test]
fn average_visibility_of_a_cloud_follows_beers_law() {
    let side = 4.0;
    let (count, edge) = (6000, 0.1);
    let scene = cloud(50, count, edge, DVec3::splat(side), true).scene();
    let stage = Stage::soft(scene);
    let engine = stage.engine(LeafMode::Average);
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
            let (answer, lanes) = engine.answer_lanes(&packet, 0.0, s, &mut workspace);
            assert_eq!(answer.cost.exact_rays, 0, "only extinction is used [SD95 sec 5]: {answer:?}");
            model += f64::from(lanes[0]) / f64::from(n);
            rays += f64::from(1 - (stage.exact(&packet) & 1)) / f64::from(n);
        }
        println!("Beer, s {s}: model {model:.4}, rays {rays:.4}, exp(-κd) {expect:.4}");
        // Rays: 0.008 from sampling and as much from the choice of the cloud. Clusters: small ones are inhomogeneous,
        // and the mean of exponentials exceeds the exponential of the mean (docs/method.md, Traps: Jensen).
        assert!((rays - expect).abs() < 0.03, "rays {rays}, law {expect}");
        assert!((model - expect).abs() < 0.06, "s {s}: model {model}, law {expect}");
    }
}

/// A surface does not block its own light: segments that end on an emitter in a leaf pass it with average visibility, and are
/// averaged in the leaves before it.
#[test]
fn emitters_are_not_averaged() {
    let mut pieces = cloud(9, 200, 0.05, DVec3::ONE, true);
    let centre = DVec3::new(0.5, 0.5, 2.0);
    pieces.light(centre, 0.1 * DVec3::Y, 0.1 * DVec3::X);
    let stage = Stage::soft(pieces.scene());
    let engine = stage.engine(LeafMode::Average);
    for s in [1e-6, 0.1, 10.0] {
        for (below, clear) in [(0.5, true), (2.2, false)] {
            let mut packet = Packet::EMPTY;
            for lane in 0..LANES {
                let at = centre + DVec3::new(0.005 * lane as f64 - 0.0375, 0.002, 0.0);
                let [from, to] = [at - below * DVec3::Z, at].map(|p| (p - stage.scene.origin).as_vec3());
                packet.set(lane, from, to, end_rule(&stage.scene));
            }
            let through = engine.transmittances(&packet, 0.1, s, &mut Workspace::default());
            let mean = through.iter().sum::<f32>() / LANES as f32;
            assert!((mean == 1.0) == clear && mean > 0.1, "s {s}, from {below} m below: {through:?}");
        }
    }
}
