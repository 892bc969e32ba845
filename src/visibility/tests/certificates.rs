//! Certificates: answers that are certain for the whole emitter, without rays (docs/method.md, Certificates and
//! intervals).

use super::*;
use crate::bench::workload::{Workload, surface_points};
use crate::scene::testing::{Pieces, direction};
use glam::DVec3;

/// Corners of a square light of side 1 at height 2.
const LIGHT: [DVec3; 4] = [
    DVec3::new(-0.5, -0.5, 2.0),
    DVec3::new(0.5, -0.5, 2.0),
    DVec3::new(0.5, 0.5, 2.0),
    DVec3::new(-0.5, 0.5, 2.0),
];

/// A light, a floor, and occluders between them.
fn room(add: impl FnOnce(&mut Pieces)) -> Stage {
    let mut pieces = Pieces::new();
    pieces.object("floor").quad(DVec3::ZERO, 8.0 * DVec3::X, 8.0 * DVec3::Y);
    pieces.light(2.0 * DVec3::Z, DVec3::Y, DVec3::X);
    add(pieces.object("things"));
    Stage::new(pieces.scene())
}

/// A packet from a point to a 4 x 4 grid of positions within `part` of the light's side, and the light's corners.
fn packet(stage: &Stage, from: DVec3, part: f64) -> (Packet, Vec<Vec3>) {
    let at = |p: DVec3| (p - stage.scene.origin).as_vec3();
    let mut packet = Packet::EMPTY;
    for lane in 0..LANES {
        let step = |k: usize| part * ((k as f64 + 0.5) / 4.0 - 0.5);
        packet.set(
            lane,
            at(from),
            at(DVec3::new(step(lane % 4), step(lane / 4), 2.0)),
            end_rule(&stage.scene),
        );
    }
    (packet, LIGHT.map(at).to_vec())
}

/// The answers with and without the emitter's corners.
fn answers(stage: &Stage, from: DVec3, part: f64) -> [Answer; 2] {
    let (packet, corners) = packet(stage, from, part);
    let (engine, mut workspace) = (stage.engine(LeafMode::Exact), Workspace::default());
    [&corners[..], &[]].map(|emitter| {
        let bundle = Bundle { packets: std::slice::from_ref(&packet), emitter_size: 1.0, emitter };
        engine.answer(bundle, 0.05, &mut workspace)
    })
}

/// A light in a frame that hangs down around it: from below the light is certainly visible entirely.
#[test]
fn an_empty_shaft_is_certain() {
    let stage = room(|things| {
        for (x, y) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
            let (out, along) = (DVec3::new(x, y, 0.0), DVec3::new(-y, x, 0.0));
            things.quad(0.5 * out + 1.9 * DVec3::Z, along, 0.2 * DVec3::Z);
            things.quad(0.6 * out + 1.8 * DVec3::Z, 0.2 * out, along);
        }
    });
    for from in [DVec3::ZERO, DVec3::new(0.2, -0.3, 0.0), DVec3::new(0.4, 0.4, 0.0)] {
        let [known, unknown] = answers(&stage, from, 1.0);
        assert_eq!((known.transmittance, known.lo, known.hi), (1.0, 1.0, 1.0), "{from}: {known:?}");
        assert_eq!((known.method, known.cost.exact_rays, known.cost.certified), (Method::Clear, 0, 16));
        // Without the emitter's corners only the samples are known.
        assert!(unknown.transmittance == 1.0 && unknown.lo < 0.9 && unknown.cost.certified == 0);
    }
    // From the side the frame hides a part of the light.
    let [known, _] = answers(&stage, DVec3::new(3.0, 0.0, 0.0), 1.0);
    assert!(known.transmittance < 1.0 && known.lo < known.hi && known.cost.certified == 0, "{known:?}");
}

/// A leaf before the light's corner that no sample meets: the shaft of the samples is empty, that of the light is not.
#[test]
fn what_no_sample_meets_is_not_certain() {
    let stage = room(|things| {
        things.quad(DVec3::new(0.23, 0.23, 1.0), 0.02 * DVec3::X, 0.02 * DVec3::Y);
    });
    let [known, unknown] = answers(&stage, DVec3::ZERO, 0.7);
    assert_eq!((unknown.method, unknown.transmittance), (Method::Clear, 1.0), "{unknown:?}");
    assert!(known.lo < 1.0 && known.cost.certified == 0, "{known:?}");
}

/// A board in front of the whole light, and one in front of all samples but not of the whole light.
#[test]
fn one_triangle_that_covers_the_light_is_certain() {
    for (side, certain) in [(1.2, true), (0.48, false)] {
        let stage = room(|things| {
            let corner = |x: f64, y: f64| DVec3::new(side * x, side * y, 1.0);
            // One triangle that contains a square of that side; the light is visible beside the square.
            things.polygon(&[corner(-0.5, -0.5), corner(1.5, -0.5), corner(-0.5, 1.5)]);
        });
        let [known, unknown] = answers(&stage, DVec3::ZERO, 0.7);
        assert_eq!((known.transmittance, unknown.transmittance), (0.0, 0.0), "{side}: {known:?} {unknown:?}");
        assert_eq!((unknown.method, unknown.cost.exact_rays), (Method::Covered, 0), "{side}: {unknown:?}");
        assert!(unknown.hi > 0.05, "{unknown:?}");
        assert_eq!(known.cost.certified, if certain { 16 } else { 0 }, "{side}: {known:?}");
        if certain {
            assert_eq!((known.method, known.hi, known.cost.exact_rays), (Method::Covered, 0.0, 0));
        } else {
            assert!(known.hi > 0.05, "{known:?}");
        }
    }
}

/// Certain answers agree with thousands of rays to the whole emitter; and certain answers are not rare.
#[test]
fn certificates_hold_for_the_whole_emitter() {
    for (name, often) in [("forest", 0.02), ("desk-room", 0.2), ("cubes", 0.02)] {
        let stage = Stage::generated(name);
        let model = crate::model::testing::model(&stage.scene, crate::model::Detail::Rays);
        let points = surface_points(&model, 500, 7).expect("points");
        let workload = Workload::new(&model, points, 7);
        let exact = Exact { scene: stage.traced.clone(), traversal: SINGLE };
        let engine = stage.engine(LeafMode::Exact);
        let (mut workspace, mut blocked) = (Workspace::default(), Vec::new());
        let mut certain = [0usize; 2];
        for pair in 0..workload.pairs.len() {
            let mut packets = Vec::new();
            workload.add_bundle(&stage.scene, pair, 16, 0, &mut packets);
            let (emitter_size, emitter) = (workload.pairs[pair].emitter_size, workload.hull_of_surface(pair));
            let bundle = Bundle { packets: &packets, emitter_size, emitter };
            let mut found = vec![engine.answer(bundle, 0.1, &mut workspace)];
            engine.certified(&[bundle], &mut workspace, |answer| found.push(answer));
            for answer in found.into_iter().filter(|a| a.cost.certified > 0) {
                let mut rays = Vec::new();
                workload.add_bundle(&stage.scene, pair, 1024, 1, &mut rays);
                let reference = exact.answer(Bundle { packets: &rays, ..bundle }, &mut blocked).transmittance;
                assert_eq!(answer.transmittance, reference, "{name}, pair {pair}: {answer:?}");
                assert_eq!((answer.lo, answer.hi), (reference, reference), "{name}, pair {pair}: {answer:?}");
                certain[reference as usize] += 1;
            }
        }
        println!("{name}: {certain:?} certificates of {} pairs, asked twice", workload.pairs.len());
        let part = certain.iter().sum::<usize>() as f64 / (2 * workload.pairs.len()) as f64;
        assert!(part > often, "{name}: {certain:?} of {}", workload.pairs.len());
    }
}

/// The shaft of an emitter contains all segments to it, at any orientation.
#[test]
fn tilted_emitters_are_held_whole() {
    let mut random = Pcg64Mcg::new(3);
    for _ in 0..200 {
        // A tilted light, and a leaf on the way to one of its corners.
        let u = 0.5 * direction(&mut random).as_dvec3();
        let v = 0.4 * u.cross(direction(&mut random).as_dvec3()).normalize();
        let centre = 3.0 * direction(&mut random).as_dvec3();
        if u.cross(v).normalize().dot(centre.normalize()).abs() < 0.2 {
            continue;
        }
        let leaf = 0.4 * (centre + 0.49 * (u + v));
        let mut pieces = Pieces::new();
        pieces.quad(leaf, 0.01 * u.normalize(), 0.01 * v.normalize());
        pieces.light(centre, u, v);
        let stage = Stage::new(pieces.scene());
        let at = |p: DVec3| (p - stage.scene.origin).as_vec3();
        let mut packet = Packet::EMPTY;
        for lane in 0..LANES {
            let end = centre + 0.6 * ((unit(&mut random) - 0.5) * u + (unit(&mut random) - 0.5) * v);
            packet.set(lane, at(DVec3::ZERO), at(end), end_rule(&stage.scene));
        }
        let corners =
            [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(a, b)| at(centre + a * u + b * v));
        let bundle = Bundle { packets: std::slice::from_ref(&packet), emitter_size: 0.1, emitter: &corners };
        let answer = stage.engine(LeafMode::Exact).answer(bundle, 1e-3, &mut Workspace::default());
        assert_eq!(answer.cost.certified, 0, "{answer:?}");
    }
}
