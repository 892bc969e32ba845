//! The mean of the estimates equals exact visibility for any averaged level and any rate of corrections.

use super::*;
use crate::optics::{Extinction, Options};
use crate::ray::LANES;
use crate::scene::testing::{Pieces, cloud, unit};
use crate::visibility::LeafMode;
use crate::visibility::reference::end_rule;
use crate::visibility::testing::{SINGLE, Stage};
use glam::{DVec3, Vec3};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

/// Position of the light in all scenes.
const LIGHT: DVec3 = DVec3::new(0.5, 0.5, 3.0);

/// Adds a light of side 1 above the pieces that faces down; all surfaces are in clusters.
fn below_a_light(mut pieces: Pieces, extinction: Extinction) -> Stage {
    pieces.light(LIGHT, DVec3::Y, DVec3::X);
    Stage::apart(pieces.scene(), &Options { extinction, ..Options::default() })
}

impl Stage {
    /// Packets of random segments from a point to the light.
    fn packets(&self, from: Vec3, count: usize, random: &mut Pcg64Mcg) -> Vec<Packet> {
        let (ends, origin) = (end_rule(&self.scene), self.scene.origin);
        let from = (from.as_dvec3() - origin).as_vec3();
        let mut packet = || {
            let mut packet = Packet::EMPTY;
            for lane in 0..LANES {
                let (x, y) = (unit(random) - 0.5, unit(random) - 0.5);
                packet.set(lane, from, (LIGHT - origin + DVec3::new(x, y, 0.0)).as_vec3(), ends);
            }
            packet
        };
        (0..count).map(|_| packet()).collect()
    }

    fn rays(&self) -> Exact {
        Exact { scene: self.traced.clone(), traversal: SINGLE }
    }
}

/// Statistics of many independent estimates of a point's visible fraction with `packets` packets each: mean, its
/// standard error, standard deviation of one estimate, and mean of the averaged level.
fn mean(stage: &Stage, from: Vec3, wanted: f32, packets: usize, runs: usize) -> (f64, f64, f64, f64) {
    let (engine, mut workspace) = (stage.engine(LeafMode::Exact), Workspace::default());
    let correction = Correction { packets: [wanted; Correction::CLASSES] };
    let unbiased = Unbiased {
        engine: &engine,
        exact: stage.rays(),
        feature_size: 10.0,
        emitter_part: 1.0,
        correction: &correction,
    };
    let mut random = Pcg64Mcg::new(5);
    let (mut sum, mut square, mut averaged) = (0.0, 0.0, 0.0);
    for _ in 0..runs {
        let all = stage.packets(from, packets, &mut random);
        let chance = random.next_u64();
        let bundle = Bundle { packets: &all, emitter_size: 1.0, emitter: &[] };
        averaged += f64::from(engine.answer(bundle, 10.0, &mut workspace).transmittance);
        unbiased.estimates(
            &[bundle],
            |_| chance,
            &mut workspace,
            |e| {
                sum += f64::from(e.visible);
                square += f64::from(e.visible).powi(2);
            },
        );
    }
    let n = runs as f64;
    let deviation = (square / n - (sum / n).powi(2)).max(0.0).sqrt();
    (sum / n, deviation / n.sqrt(), deviation, averaged / n)
}

/// Seen from below the middle, a plate at half the light's height, from x = 0 to the middle, hides exactly half of the
/// light. A large feature size averages the plate, and analytic extinction transmits light through it.
fn half_a_plate() -> Stage {
    let mut pieces = Pieces::new();
    for k in 0..40 {
        let (x, y) = (f64::from(k % 4) * 0.125, f64::from(k / 4) * 0.1);
        let centre = DVec3::new(0.0625 + x, 0.05 + y, 1.5);
        pieces.quad(centre, 0.125 * DVec3::X, 0.1 * DVec3::Y);
    }
    below_a_light(pieces, Extinction::Analytic)
}

#[test]
fn the_mean_is_the_closed_form() {
    let stage = half_a_plate();
    let from = Vec3::new(0.5, 0.5, 0.0);
    for wanted in [0.25, 1.0, 2.0] {
        let (found, error, _, averaged) = mean(&stage, from, wanted, 4, 1500);
        assert!((averaged - 0.5).abs() > 0.01, "nothing to mend: {averaged}");
        assert!(
            (found - 0.5).abs() < 4.0 * error + 1e-4,
            "{wanted}: {found} +- {error}, averaged {averaged}"
        );
    }
}

#[test]
fn the_mean_is_that_of_exact_rays_in_random_clouds() {
    for (seed, sheets) in [(1, true), (2, false)] {
        let stage =
            below_a_light(cloud(seed, 150, 0.1, DVec3::new(1.0, 1.0, 2.0), sheets), Extinction::Measured);
        let from = Vec3::new(0.4, 0.6, -0.1);
        let mut random = Pcg64Mcg::new(9);
        let all = stage.packets(from, 4000, &mut random);
        let mut blocked = vec![0; all.len()];
        stage.rays().occluded(&all, &mut blocked);
        let truth = 1.0 - blocked.iter().map(|b| f64::from(b.count_ones())).sum::<f64>() / 64_000.0;
        let noise = (truth * (1.0 - truth) / 64_000.0).sqrt();
        for wanted in [0.1, 1.0] {
            let (found, error, _, averaged) = mean(&stage, from, wanted, 8, 1200);
            assert!((averaged - truth).abs() > 4.0 * noise, "nothing to mend: {averaged}, {truth}");
            assert!(
                (found - truth).abs() < 4.0 * error.hypot(noise),
                "{wanted}: {found} +- {error}, {truth}"
            );
        }
    }
}

/// With sixteen times the segments the error falls to a quarter, although only every fourth packet is traced: the
/// estimate converges to exact visibility, the averaged level alone does not.
#[test]
fn estimates_converge() {
    let (stage, from, truth) = (half_a_plate(), Vec3::new(0.5, 0.5, 0.0), 0.5);
    // Root mean square errors of the estimates and of the averaged level alone.
    let errors = |packets: usize| {
        let (found, _, deviation, averaged) = mean(&stage, from, packets as f32 / 4.0, packets, 600);
        (deviation.hypot(found - truth), (averaged - truth).abs())
    };
    let [(few, _), (many, alone)] = [4, 64].map(errors);
    assert!(few > 0.02 && many < 0.33 * few && many > 0.18 * few, "{few} {many}");
    assert!(alone > 2.0 * many, "the averaged level is off by {alone}, corrected by {many}: nothing to mend");
    // Rare corrections are unbiased but noisy.
    let rare = mean(&stage, from, 0.1, 64, 600).2;
    assert!(rare > 1.5 * many, "{rare} {many}");
}

#[test]
fn classes_cover_all_transmittances() {
    assert_eq!((Correction::class(0.0), Correction::class(1.0)), (0, 1));
    let classes: Vec<usize> = (1..1000).map(|i| Correction::class(i as f32 / 1000.0)).collect();
    assert!(classes.iter().all(|&c| (2..Correction::CLASSES).contains(&c)));
    assert_eq!((classes[0], classes[499]), (2, Correction::CLASSES - 1));
    let correction = Correction { packets: [5.0; Correction::CLASSES] };
    assert_eq!(correction.choose(0.5, 16), (4, 1.0));
    // A number that does not divide the packets would omit some.
    assert_eq!(correction.choose(0.5, 6), (2, 1.0));
    assert_eq!(Correction { packets: [0.25; Correction::CLASSES] }.choose(0.5, 4), (1, 0.25));
}
