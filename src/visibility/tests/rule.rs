//! The umbra criterion: the clusters that are aggregated, and penumbrae that stay.

use super::*;
use crate::optics::AxisMix;
use crate::scene::testing::Pieces;
use crate::visibility::reference::{peak_occlusion, umbra};
use glam::DVec3;

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
    let truth = 1.0 - hit as f32 / (64 * LANES) as f32;
    assert!((1.0 - peak_occlusion(1.0, 0.5, 3.0, 4.0) as f32 - truth).abs() < 0.05, "{truth}");
    let bundle = Bundle { packets: &packets, emitter_size: 1.0, emitter: &[] };
    for s in [0.05, 0.2, 0.4] {
        let found = stage.engine(LeafMode::Exact).answer(bundle, s, &mut workspace).transmittance;
        // An octagon covers nine tenths of its disc.
        assert!((found - truth).abs() < 0.12, "s {s}: {found} passes, {truth} should");
    }
}
