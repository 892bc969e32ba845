//! Couplings against closed forms, blocked and free.

use super::*;
use crate::element::Elements;
use crate::embree::{Device, SceneBuilder, Traversal};
use crate::hierarchy;
use crate::scene::testing::Pieces;
use crate::visibility::{Exact, reference};
use glam::DVec3;

/// Links of the first and the second surface of a scene, both ways, by `sides` that face each other.
fn coupling(pieces: Pieces, worth: f32, seed: u64) -> Option<(Link, f64)> {
    let scene = pieces.scene();
    let elements = Elements::build(&scene, &hierarchy::build(&scene, &Default::default()), 1e-4, &[]);
    let mut builder =
        SceneBuilder::new(&Device::new(1).expect("Embree"), Default::default()).expect("a scene");
    builder.add_triangles(&scene.positions, &scene.triangles, 1).expect("triangles");
    let traced = builder.commit().expect("committed");
    let meter = Meter {
        elements: &elements,
        sight: Sight::Exact(Exact { scene: &traced, traversal: Traversal { width: 1, coherent: false } }),
        ends: reference::end_rule(&scene),
        seed,
        inside: Inside::default(),
    };
    let of = |object: u32| {
        let own =
            |s: &&crate::element::Side| scene.triangle_object[s.triangles[0] as usize] == object && s.front;
        elements.sides.iter().find(own).expect("a side").element
    };
    let (a, b) = (of(0), of(1));
    let care = Care { worth, feature_size: 1.0, mixed: 0.5, first_receives: true };
    let link = meter.measure(a, b, care, &mut Scratch::default())?;
    let back = meter.measure(b, a, care, &mut Scratch::default()).expect("both ways or none");
    assert!(link.coupling == back.coupling, "{link:?} {back:?}");
    Some((link, elements.elements[a as usize].area))
}

/// Squares of edge 1 that face each other at a distance.
fn opposed(distance: f64) -> Pieces {
    let mut pieces = Pieces::new();
    pieces.object("low").quad(DVec3::ZERO, DVec3::X, DVec3::Y);
    pieces.object("high").quad(DVec3::Z * distance, DVec3::Y, DVec3::X);
    pieces
}

#[test]
fn free_couplings_are_those_of_the_closed_forms() {
    for distance in [0.5, 1.0, 2.0, 5.0, 20.0] {
        let (link, area) = coupling(opposed(distance), 1e3, 1).expect("they face each other");
        let factor = f64::from(link.coupling) / area;
        let want = crate::form_factor::parallel_rectangles([[0.0, 1.0]; 2], [[0.0, 1.0]; 2], distance);
        assert!((factor / want - 1.0).abs() < 2e-3, "{distance}: {factor} {want}");
        assert_eq!(link.transmittance, 1.0);
    }
    // Unit squares with a common edge.
    let mut pieces = Pieces::new();
    pieces.object("floor").quad(DVec3::new(0.5, 0.5, 0.0), DVec3::X, DVec3::Y);
    pieces.object("wall").quad(DVec3::new(0.0, 0.5, 0.5), DVec3::Y, DVec3::Z);
    let (link, area) = coupling(pieces, 1e3, 1).expect("they face each other");
    assert!((f64::from(link.coupling) / area - 0.200044).abs() < 2e-5, "{link:?}");
}

#[test]
fn what_stands_between_counts() {
    let mut pieces = opposed(1.0);
    pieces.object("screen").quad(DVec3::Z * 0.5, DVec3::X * 3.0, DVec3::Y * 3.0);
    let (link, _) = coupling(pieces, 1e3, 1).expect("they face each other");
    assert_eq!((link.transmittance, link.coupling), (0.0, 0.0));
    assert!(link.variation[0] > 0.0, "what is hidden from every sample may be seen elsewhere");
    // A screen over one half, close to the lower square: half of it sees nothing but through the side.
    let (mut sum, n) = (0.0, 256);
    for seed in 0..n {
        let mut pieces = opposed(1.0);
        pieces.object("screen").quad(DVec3::new(0.5, 0.0, 1e-2), DVec3::X, DVec3::Y * 3.0);
        sum += coupling(pieces, 1e3, seed).expect("they face each other").0.transmittance;
    }
    assert!((sum / n as f32 - 0.5).abs() < 0.04, "{}", sum / n as f32);
}

#[test]
fn what_lies_behind_has_no_link() {
    let mut pieces = Pieces::new();
    pieces.object("low").quad(DVec3::ZERO, DVec3::X, DVec3::Y);
    pieces.object("high, turned away").quad(DVec3::Z, DVec3::X, DVec3::Y);
    assert!(coupling(pieces, 1e3, 1).is_none());
}
