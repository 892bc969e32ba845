//! The fast engine against the reference, segment by segment.

use super::*;
use crate::optics::AxisMix;
use crate::ray::{Brute, HitResult};
use crate::scene::testing::{cloud, direction, in_cube};
use crate::visibility::plain_walk::{SegmentRule, walk};
use glam::DVec3;

/// Statistics of the differences between fast engine and reference: large ones exceed 0.01.
#[derive(Default)]
struct Differences {
    segments: usize,
    large: usize,
    sum: f64,
    /// Squared errors of the fast engine and of the reference.
    squares: [f64; 2],
}

/// The segments without 1e-4 of their length at both ends. The margins of the end rule are below the tolerance of the verdict, so that
/// the surfaces at the ends would leave it open for all segments that nothing else blocks.
fn without_ends(mut packets: Vec<Packet>) -> Vec<Packet> {
    for packet in &mut packets {
        (packet.near, packet.far) = ([1e-4; LANES], [1.0 - 1e-4; LANES]);
    }
    packets
}

/// Checks every segment, with `tolerance` for the verdict of exact arithmetic:
///
/// * what the reference blocks with a triangle, the fast engine blocks too: it never aggregates more;
/// * a segment that the fast engine blocks is blocked; a clear segment has a positive transmittance;
/// * where the reference aggregates nothing, neither does the fast engine, and the answer is 0 or 1 and correct.
///
/// The fast engine may test more triangles than the reference, so transmittances are compared in the mean.
fn compare(stage: &Stage, packets: &[Packet], e: f32, s: f32) -> Differences {
    let brute = Brute::new(&stage.scene.positions, &stage.scene.triangles);
    let single: Vec<Brute> = stage
        .scene
        .triangles
        .iter()
        .map(|t| Brute::new(&stage.scene.positions, std::slice::from_ref(t)))
        .collect();
    let engine = stage.engine(LeafMode::Exact).with_patience();
    let mut workspace = Workspace::default();
    let mut differences = Differences::default();
    for packet in packets {
        let (Answer { cost, .. }, fast) = engine.answer_lanes(packet, e, s, &mut workspace);
        assert_eq!(cost.handed_over, 0);
        let rule = SegmentRule { e, s, leaf: LeafMode::Exact, mix: AxisMix::around(towards(packet)) };
        let mut aggregated = 0;
        for lane in packet.lanes() {
            let Segment { origin, direction, near, far } = segment(packet, lane);
            let verdict = brute.verdict(origin, direction, near, far, 1e-5);
            let mut clearly = false;
            let walked = walk(&stage.hierarchy, &stage.optics, segment(packet, lane), &rule, |t| {
                let one = |tolerance| single[t as usize].verdict(origin, direction, near, far, tolerance);
                clearly |= one(1e-5) == HitResult::Blocked;
                one(0.0) != HitResult::Clear
            });
            let t = fast[lane];
            let place =
                format!("s {s}, e {e}: {t} against {walked:?}, {verdict:?}, {:?}", segment(packet, lane));
            assert!((0.0..=1.0).contains(&t), "{place}");
            assert!(!clearly || t == 0.0, "a triangle that the reference tests was not tested: {place}");
            assert!(t > 0.0 || verdict != HitResult::Clear, "blocked by nothing: {place}");
            if walked.aggregated == 0 {
                assert!(t == 0.0 || t == 1.0, "aggregated more than the reference: {place}");
                assert!(verdict != HitResult::Blocked || t == 0.0, "missed: {place}");
            }
            aggregated += u64::from(walked.aggregated > 0 && !walked.blocked);
            if verdict != HitResult::Marginal {
                differences.segments += 1;
                differences.large += usize::from((f64::from(t) - walked.transmittance()).abs() > 0.01);
                differences.sum += f64::from(t) - walked.transmittance();
                let reference = if verdict == HitResult::Clear { 1.0 } else { 0.0 };
                differences.squares[0] += (f64::from(t) - reference).powi(2);
                differences.squares[1] += (walked.transmittance() - reference).powi(2);
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
            let packets = without_ends(stage.bundles(3, count, lanes));
            for s in stage.sizes() {
                for e in [0.0, 0.5 * e] {
                    let d = compare(&stage, &packets, e, s);
                    let n = d.segments as f64;
                    let (large, mean) = (d.large as f64 / n, d.sum / n);
                    println!("{name}, {lanes} lanes, s {s:.4}, e {e:.2}: {large:.3} differ, mean {mean:+.4}");
                    // The fast engine applies the criterion to whole boxes, opens more, and is more accurate.
                    let [fast, slow] = d.squares.map(|sum| (sum / n).sqrt());
                    assert!(fast < 1.1 * slow + 0.005, "{name}, s {s}, e {e}: RMS {fast} and {slow}");
                    assert!(mean.abs() < 0.03, "{name}, s {s}, e {e}: fast - reference {mean:+.4}");
                    assert!(large < 0.1, "{name}, s {s}, e {e}: {large} of the segments differ");
                }
            }
        }
    }
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
        let packets = without_ends(stage.bundles(seed as u64, 20, 16));
        // Segments from an element instead of a point: no common end.
        let apart: Vec<Packet> = packets
            .iter()
            .map(|p| {
                let mut apart = Packet::EMPTY;
                for lane in p.lanes() {
                    let from = p.point(lane, 0.0) + 0.02 * direction(&mut random);
                    apart.set_between(lane, from, p.point(lane, 1.0), [p.near[lane], p.far[lane]]);
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
