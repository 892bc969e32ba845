//! Tessellated spheres and cylinders, and a published two-dimensional case, against closed forms.

use super::*;
use crate::scene::Scene;
use std::f64::consts::TAU;

/// A scene of objects, each a list of polygons.
fn solids(list: &[Vec<Vec<DVec3>>]) -> Scene {
    let mut pieces = Pieces::empty();
    for (i, polygons) in list.iter().enumerate() {
        pieces.grey(&format!("solid {i}"), 0.5);
        polygons.iter().for_each(|p| _ = pieces.polygon(p));
    }
    pieces.scene()
}

/// Form factors between the objects of a scene, without adjustment, by an eighth of the rays.
fn between(scene: &Scene) -> FormFactors {
    let fewer = |s: &mut Settings| {
        (s.enforce, s.rays) = (false, s.rays / 4);
        (s.bundle, s.largest_bundle) = ((s.bundle / 8).max(64), (s.largest_bundle / 8).max(256));
    };
    by_groups(run(scene, fewer).0, scene, &Facets::new(scene), Grouping::Object, &()).unwrap()
}

/// An octahedron subdivided `halved` times with its corners on a sphere; reversed if `inward`.
fn sphere(radius: f64, halved: u32, inward: bool) -> Vec<Vec<DVec3>> {
    let mut faces: Vec<[DVec3; 3]> = (0..8)
        .map(|k| {
            let sign = |bit: u32| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let [x, y, z] = [sign(0) * DVec3::X, sign(1) * DVec3::Y, sign(2) * DVec3::Z];
            if sign(0) * sign(1) * sign(2) > 0.0 { [x, y, z] } else { [y, x, z] }
        })
        .collect();
    for _ in 0..halved {
        let middle = |p: DVec3, q: DVec3| (p + q).normalize();
        faces = (faces.iter())
            .flat_map(|&[a, b, c]| {
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let turned = |[a, b, c]: [DVec3; 3]| if inward { vec![c, b, a] } else { vec![a, b, c] };
    faces.iter().map(|f| turned(f.map(|p| radius * p))).collect()
}

/// All flux from a convex inner body reaches the outer body; the other factors follow from reciprocity. The values are
/// exact for the tessellated shapes.
#[test]
fn concentric_spheres_of_facets() {
    for (inner, outer) in [(1.0, 1.5), (1.0, 2.0), (1.0, 3.0)] {
        let m = between(&solids(&[sphere(inner, 2, false), sphere(outer, 2, true)]));
        let share = m.areas[0] / m.areas[1];
        assert!((share - (inner / outer).powi(2)).abs() < 1e-6);
        assert_eq!(m.get(0, 0), 0.0, "convex");
        near(m.get(0, 1), 1.0, 1e-3, "from inside");
        near(m.get(1, 0), share, 1e-3, "from outside");
        // Partly hidden by the inner body.
        near(m.get(1, 1), 1.0 - share, 5e-3, "to itself");
    }
}

/// The side of an upright prism with the cross-section area of a cylinder, one unit high.
fn tube(radius: f64, sides: u32, inward: bool) -> Vec<Vec<DVec3>> {
    let step = TAU / f64::from(sides);
    let radius = radius * (step / step.sin()).sqrt();
    let at = |k: u32, z: f64| {
        let (sin, cos) = (step * f64::from(k)).sin_cos();
        dvec3(radius * cos, radius * sin, z)
    };
    let side = |k: u32| vec![at(k, 0.0), at(k + 1, 0.0), at(k + 1, 1.0), at(k, 1.0)];
    let turned = |mut p: Vec<DVec3>| {
        if inward {
            p.reverse();
        }
        p
    };
    (0..sides).map(|k| turned(side(k))).collect()
}

/// Prisms with the cross-section of a cylinder converge to the cylinder with the square of the angle per side.
#[test]
fn coaxial_cylinders_converge_to_published_values() {
    let published = unobstructed("coaxial-cylinders");
    assert_eq!(published.len(), 7);
    for (name, [inner, outer, ..], want) in published {
        let off = |sides: u32| {
            let m = between(&solids(&[tube(inner, sides, false), tube(outer, sides, true)]));
            near(m.get(1, 0) * outer, m.get(0, 1) * inner, 1e-5, "reciprocity");
            m.get(0, 1) / want - 1.0
        };
        let (coarse, fine) = (off(12), off(48));
        assert!(fine.abs() < 1e-3 && fine.abs() < 0.2 * coarse.abs() + 2e-4, "{name}: {coarse} {fine}");
    }
}

/// A two-dimensional case as long plates. The finite length changes factors by some thousandths: the blocked factor is
/// compared relative to the unblocked one, the others directly.
#[test]
fn a_published_case_in_two_dimensions() {
    let length = 1000.0;
    let long = length * DVec3::Z;
    let scene = quads(&[
        (DVec3::ZERO, long, 10.0 * DVec3::X),
        (5.0 * DVec3::Y, 10.0 * DVec3::X, long),
        (2.0 * DVec3::Y, long, 5.0 * DVec3::X),
    ]);
    let (m, _) = run(&scene, |s| s.enforce = false);
    let open = opposed_rectangles([10.0, length], 5.0);
    // Crossed strings without the blocker.
    let open_strings = 1.25f64.sqrt() - 0.5;
    near(m.get(0, 1) / open, obstructed("lbnl_2d_block1", "F12") / open_strings, 5e-3, "blocked");
    near(m.get(1, 2), 0.372015325, 5e-3, "above");
    near(m.get(2, 1), 0.744030651, 5e-3, "below");
    assert_eq!(m.get(0, 2), 0.0, "its back");
}
