//! The umbra criterion: umbra, penumbra and peak of discs, and the clusters that are aggregated.

use super::*;
use crate::optics::AxisMix;
use crate::scene::testing::Pieces;
use crate::visibility::reference::{peak_occlusion, penumbra, umbra};
use glam::{DVec2, DVec3};

/// Points of a disc of this diameter, including its rim.
fn disc(diameter: f64) -> Vec<DVec2> {
    let n = 4000;
    let inner = (0..n).map(|i| ((f64::from(i) + 0.5) / f64::from(n)).sqrt());
    inner
        .chain((0..400).map(|_| 1.0))
        .enumerate()
        .map(|(i, r)| 0.5 * diameter * r * DVec2::from_angle(i as f64 * 2.399_963_229_728_653))
        .collect()
}

/// Largest `x` in `[0, 20]` for which a condition holds that is true below and false above.
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

/// Five configurations of discs, with every emitter point traced to the blocker's plane, against the formulas of
/// docs/method.md, Umbra criterion.
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
            // Without the rim points, which have no area.
            let inside = &emitter[..4000];
            let peak = inside.iter().filter(|&&y| blocked(0.0, y)).count() as f64 / inside.len() as f64;
            let formula = peak_occlusion(e, b, d1, d2);
            assert!((peak - formula).abs() < 0.005, "{place}: peak {peak}, formula {formula}");
        }
    }
}

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
                let bundle = Bundle { packets: std::slice::from_ref(&packet), emitter_size: e, emitter: &[] };
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
