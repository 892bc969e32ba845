//! What geometry alone says of the space between two surfaces.

use super::*;
use crate::ray::{LANES, Packet};
use crate::scene::testing::{in_cube, rotation, unit};
use rand_pcg::Pcg64Mcg;

/// Parts of rays between the first two surfaces that get through: all, of many random ones that leave the fronts.
fn seen(meter: &Meter, ends: [u32; 2], random: &mut Pcg64Mcg) -> Vec<f32> {
    let [a, b] = ends.map(|e| match &meter.elements.elements[e as usize].shape {
        crate::element::Shape::Surface { side, corners } => {
            (*corners, meter.elements.sides[*side as usize].normal)
        }
        crate::element::Shape::Cluster(_) => unreachable!("a surface"),
    });
    let mut found = Vec::new();
    for _ in 0..40 {
        let mut packet = Packet::EMPTY;
        for lane in 0..LANES {
            let mut place = |corners| point_on(corners, unit(random) as f32, unit(random) as f32);
            let (from, to) = (place(&a.0), place(&b.0));
            if (to - from).dot(a.1) > 1e-2 && (from - to).dot(b.1) > 1e-2 {
                packet.set(lane, from, to, meter.ends);
            }
        }
        let question = Question { packet, emitter_size: 1.0, feature_size: 0.0 };
        let through = meter.sight.transmittances(&question, &mut Scratch::default());
        found.extend(question.packet.lanes().map(|lane| through[lane]));
    }
    found
}

#[test]
fn certificates_are_what_all_rays_say() {
    let mut random = Pcg64Mcg::new(5);
    let (mut nothing, mut walls, mut unsure) = (0, 0, 0);
    for _ in 0..400 {
        let mut pieces = Pieces::new();
        for name in ["low", "high"] {
            let (turn, size) = (rotation(&mut random), 0.05 + 0.4 * unit(&mut random));
            let at = 2.0 * in_cube(&mut random);
            pieces.object(name).quad(at, turn.x_axis * size, turn.y_axis * size);
        }
        for _ in 0..(3.0 * unit(&mut random)) as usize {
            let (turn, size) = (rotation(&mut random), 0.1 + 2.0 * unit(&mut random));
            let at = 2.0 * in_cube(&mut random);
            pieces.object("between").quad(at, turn.x_axis * size, turn.y_axis * size);
        }
        staged(pieces, |meter, ends| {
            let rays = seen(meter, ends, &mut random);
            let hidden = !rays.is_empty() && rays.iter().all(|&t| t == 0.0);
            let care = Care {
                worth: 1.0,
                feature_size: 1.0,
                mixed: 0.5,
                between: Between::SOMETHING,
                hidden,
                first_receives: true,
            };
            match meter.measure(ends[0], ends[1], care, &mut Scratch::default()) {
                // Nothing faces, or a wall.
                None => {
                    assert!(rays.iter().all(|&t| t == 0.0), "a wall that rays get through");
                    walls += usize::from(!rays.is_empty());
                }
                Some(link) if link.between == Between::NOTHING => {
                    assert!(rays.iter().all(|&t| t == 1.0), "rays are blocked by nothing");
                    assert_eq!((link.transmittance, link.rays, link.noise), (1.0, 0, 0.0));
                    nothing += 1;
                }
                Some(_) => unsure += 1,
            }
        });
    }
    assert!(nothing > 40 && walls > 10 && unsure > 10, "{nothing} {walls} {unsure}");
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
    let want = 0.5 * crate::form_factor::polygon_to_polygon(&[a, b, c, d], &strip);
    let (link, _) = coupling(pieces.clone(), 1e3, 1).expect("a strip of it is in front");
    assert!((f64::from(link.coupling) / want - 1.0).abs() < 1e-3, "{link:?} {want}");
    // By a few points where it matters less.
    let (link, _) = coupling(pieces, 0.1, 1).expect("a strip of it is in front");
    assert!((f64::from(link.coupling) / want - 1.0).abs() < 0.2, "{link:?} {want}");
    assert!(
        link.variation.iter().all(|&v| v >= 0.9 * link.coupling),
        "most of the floor sees nothing: {link:?}"
    );
}
