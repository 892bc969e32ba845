//! Blocker certificates against random rays.

use super::*;
use crate::ray::{LANES, Packet};
use crate::scene::testing::{in_cube, rotation, unit};
use rand_pcg::Pcg64Mcg;

/// Fractions of rays between the first two surfaces that get through: all, of many random ones that leave the fronts.
fn seen(estimator: &LinkEstimator, ends: [u32; 2], random: &mut Pcg64Mcg) -> Vec<f32> {
    let [a, b] = ends.map(|e| match &estimator.elements.elements[e as usize].shape {
        crate::radiosity::elements::Shape::Surface { side, corners } => {
            let side = &estimator.elements.sides[*side as usize];
            (*corners, side.normal, side.end)
        }
        crate::radiosity::elements::Shape::Cluster(_) => unreachable!("a surface"),
    });
    let mut found = Vec::new();
    for _ in 0..40 {
        let mut packet = Packet::EMPTY;
        for lane in 0..LANES {
            let mut place = |corners| point_on(corners, unit(random) as f32, unit(random) as f32);
            let (from, to) = (place(&a.0), place(&b.0));
            if (to - from).dot(a.1) > 1e-2 && (from - to).dot(b.1) > 1e-2 {
                let rules = [a.2, b.2.seen_from(a.2)];
                packet.set_lifted(lane, rules[0].lifted(from, a.1), rules[1].lifted(to, b.1), rules);
            }
        }
        let query = VisibilityQuery { packet, emitter_size: 1.0, feature_size: 0.0 };
        let through = estimator.engine.transmittances(&query, &mut Scratch::default());
        found.extend(query.packet.lanes().map(|lane| through[lane]));
    }
    found
}

/// A parallelogram or half of one, somewhere in a cube of edge 2.
fn surface(pieces: &mut Pieces, name: &str, random: &mut Pcg64Mcg, size: f64) {
    let (turn, at) = (rotation(random), 2.0 * in_cube(random));
    let (u, v) = (turn.x_axis * size, turn.y_axis * size);
    pieces.object(name);
    if unit(random) < 0.5 {
        pieces.quad(at, u, v);
    } else {
        pieces.polygon(&[at, at + u, at + unit(random) * u + v]);
    }
}

/// Two small surfaces and up to two larger ones, quads and triangles.
fn some(random: &mut Pcg64Mcg) -> Pieces {
    let mut pieces = Pieces::new();
    for name in ["low", "high"] {
        let size = 0.05 + 0.4 * unit(random);
        surface(&mut pieces, name, random, size);
    }
    for _ in 0..(3.0 * unit(random)) as usize {
        let size = 0.1 + 2.0 * unit(random);
        surface(&mut pieces, "between", random, size);
    }
    pieces
}

/// What is known of two elements, by what was known of what they are parts of: nothing, a wall, or neither (`None`), held
/// against random rays. The second result is what their parts are told; none if they have no link.
fn certified(
    estimator: &LinkEstimator,
    ends: [u32; 2],
    before: BlockerCertificate,
    random: &mut Pcg64Mcg,
) -> (Option<BlockerCertificate>, Option<BlockerCertificate>) {
    let rays = seen(estimator, ends, random);
    let blocked = !rays.is_empty() && rays.iter().all(|&t| t == 0.0);
    let accuracy = Accuracy { certificate: before, blocked, ..Accuracy::unknown(1.0) };
    match estimator.measure(ends[0], ends[1], accuracy, &mut Scratch::default()) {
        // Nothing faces, or a wall.
        None => {
            assert!(rays.iter().all(|&t| t == 0.0), "a wall that rays get through");
            ((!rays.is_empty()).then_some(BlockerCertificate::BLOCKED), None)
        }
        Some(link) if link.certificate == BlockerCertificate::CLEAR => {
            assert!(rays.iter().all(|&t| t == 1.0), "rays are blocked by nothing");
            assert_eq!((link.transmittance, link.rays, link.noise), (1.0, 0, 0.0));
            (Some(BlockerCertificate::CLEAR), Some(BlockerCertificate::CLEAR))
        }
        Some(link) => (None, Some(link.certificate)),
    }
}

/// Certificates are what all rays say. That of a link holds for the links of its parts, which inherit it: down two levels of both ends.
#[test]
fn certificates_are_true_and_hold_for_parts() {
    let mut random = Pcg64Mcg::new(6);
    let (mut nothing, mut walls, mut by, mut decided) = (0, 0, 0, 0);
    for _ in 0..1500 {
        staged(some(&mut random), |estimator, mut ends| {
            let mut before = BlockerCertificate::UNKNOWN;
            for level in 0..=2 {
                let (certain, next) = certified(estimator, ends, before, &mut random);
                walls += usize::from(certain == Some(BlockerCertificate::BLOCKED));
                if level > 0 {
                    nothing += usize::from(before == BlockerCertificate::CLEAR);
                    by += usize::from(before.side().is_some());
                    decided += usize::from(before.side().is_some() && certain.is_some());
                }
                let Some(next) = next else { break };
                before = next;
                ends = ends.map(|e| {
                    let parts = estimator.elements.elements[e as usize].child_range();
                    let k = (unit(&mut random) * parts.len() as f64) as usize;
                    parts.clone().nth(k).map_or(e, |part| part as u32)
                });
            }
        });
    }
    assert!(nothing > 200 && walls > 4 && by > 20 && decided > 5, "{nothing} {walls} {by} {decided}");
}

#[test]
fn a_floor_under_the_edge_of_a_block_sees_its_side() {
    // A tenth of the floor lies in front of the wall that stands on it.
    let mut pieces = Pieces::new();
    let corners = |z: f64| [DVec3::new(0.9, 0.0, z), DVec3::new(0.9, 1.0, z)];
    let ([a, b], [d, c]) = (corners(0.0), corners(0.5));
    pieces.object("wall").polygon(&[a, b, c, d]);
    pieces.object("floor").quad(DVec3::new(0.5, 0.5, 0.0), DVec3::X, DVec3::Y);
    let strip = [
        DVec3::new(0.9, 0.0, 0.0),
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(1.0, 1.0, 0.0),
        DVec3::new(0.9, 1.0, 0.0),
    ];
    let want = 0.5 * crate::form_factors::analytic::polygon_to_polygon(&[a, b, c, d], &strip);
    let (link, _) = exchange_area(pieces.clone(), 1e3, 1).expect("a strip of it is in front");
    assert!((f64::from(link.exchange_area) / want - 1.0).abs() < 1e-3, "{link:?} {want}");
    // By a few points where it matters less.
    let (link, _) = exchange_area(pieces, 0.1, 1).expect("a strip of it is in front");
    assert!((f64::from(link.exchange_area) / want - 1.0).abs() < 0.2, "{link:?} {want}");
    assert!(
        link.variation.iter().all(|&v| v >= 0.9 * link.exchange_area),
        "most of the floor sees nothing: {link:?}"
    );
}
