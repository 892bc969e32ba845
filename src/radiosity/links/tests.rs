//! Couplings against closed forms, blocked and free.

use super::*;
use crate::clusters;
use crate::embree::{Traversal, committed};
use crate::math::sampling::*;
use crate::radiosity::elements::Elements;
use crate::radiosity::options::Inside;
use crate::scene::testing::Pieces;
use crate::visibility::Exact;
use glam::DVec3;

/// Links of the first and the second surface of a scene, both ways, by `sides` that face each other.
fn exchange_area(pieces: Pieces, worth: f32, seed: u64) -> Option<(Link, f64)> {
    staged_with(pieces, seed, |estimator, [a, b]| {
        let accuracy = Accuracy::unknown(worth);
        let link = estimator.measure(a, b, accuracy, &mut Scratch::default())?;
        let back = estimator.measure(b, a, accuracy, &mut Scratch::default()).expect("both ways or none");
        assert!(link.exchange_area == back.exchange_area, "{link:?} {back:?}");
        Some((link, estimator.elements.elements[a as usize].area))
    })
}

fn staged(pieces: Pieces, see: impl FnOnce(&LinkEstimator, [u32; 2])) {
    staged_with(pieces, 1, see);
}

/// A estimator for a scene, and its first and second surface.
fn staged_with<R>(pieces: Pieces, seed: u64, see: impl FnOnce(&LinkEstimator, [u32; 2]) -> R) -> R {
    let scene = pieces.scene();
    let mut elements = Elements::build(&scene, &clusters::build(&scene, &Default::default()), 1e-4, &[]);
    // Two levels of parts, for those who ask for them.
    let mut next = 0;
    while next < elements.len() as u32 {
        if elements.elements[next as usize].level < 2 && elements.can_open(next) {
            elements.split(next);
        }
        next += 1;
    }
    let traced = committed(&scene.positions, &scene.triangles);
    let estimator = LinkEstimator {
        elements: &elements,
        engine: &VisibilityEngine::Exact(Exact {
            scene: traced,
            traversal: Traversal { width: 1, coherent: false },
        }),
        seed,
        inside: Inside::default(),
    };
    let of = |object: u32| {
        let own = |s: &&crate::radiosity::elements::Side| {
            scene.triangle_object[s.triangles[0] as usize] == object && s.front
        };
        elements.sides.iter().find(own).expect("a side").element
    };
    see(&estimator, [of(0), of(1)])
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
        let (link, area) = exchange_area(opposed(distance), 1e3, 1).expect("they face each other");
        let factor = f64::from(link.exchange_area) / area;
        let want = crate::form_factors::testing::opposed_rectangles([1.0; 2], distance);
        assert!((factor / want - 1.0).abs() < 2e-3, "{distance}: {factor} {want}");
        assert_eq!(link.transmittance, 1.0);
    }
    // Unit squares with a common edge.
    let mut pieces = Pieces::new();
    pieces.object("floor").quad(DVec3::new(0.5, 0.5, 0.0), DVec3::X, DVec3::Y);
    pieces.object("wall").quad(DVec3::new(0.0, 0.5, 0.5), DVec3::Y, DVec3::Z);
    let (link, area) = exchange_area(pieces, 1e3, 1).expect("they face each other");
    assert!((f64::from(link.exchange_area) / area - 0.200044).abs() < 2e-5, "{link:?}");
}

#[test]
fn what_stands_between_counts() {
    let mut pieces = opposed(1.0);
    pieces.object("screen").quad(DVec3::Z * 0.5, DVec3::X * 3.0, DVec3::Y * 3.0);
    assert!(exchange_area(pieces, 1e3, 1).is_none(), "all segments meet the screen");
    // Two screens that meet: neither hides all, and what is hidden from every sample may be seen elsewhere.
    let mut pieces = opposed(1.0);
    for side in [-1.0, 1.0] {
        pieces.object("screen").quad(DVec3::new(0.9 * side + 0.05, 0.0, 0.5), DVec3::X * 2.0, DVec3::Y * 3.0);
    }
    let (link, _) = exchange_area(pieces, 1e3, 1).expect("they face each other");
    assert_eq!((link.transmittance, link.exchange_area), (0.0, 0.0));
    assert!(link.variation[0] > 0.0);
    // A screen over one half, close to the lower square: half of it sees nothing but through the side.
    let (mut sum, n) = (0.0, 256);
    for seed in 0..n {
        let mut pieces = opposed(1.0);
        pieces.object("screen").quad(DVec3::new(0.5, 0.0, 1e-2), DVec3::X, DVec3::Y * 3.0);
        sum += exchange_area(pieces, 1e3, seed).expect("they face each other").0.transmittance;
    }
    assert!((sum / n as f32 - 0.5).abs() < 0.04, "{}", sum / n as f32);
}

#[test]
fn what_lies_behind_has_no_link() {
    let mut pieces = Pieces::new();
    pieces.object("low").quad(DVec3::ZERO, DVec3::X, DVec3::Y);
    pieces.object("high, turned away").quad(DVec3::Z, DVec3::X, DVec3::Y);
    assert!(exchange_area(pieces, 1e3, 1).is_none());
}

/// Opposed squares, the upper one three times as large.
fn unequal() -> Pieces {
    let mut pieces = Pieces::new();
    pieces.object("low").quad(DVec3::ZERO, DVec3::X, DVec3::Y);
    pieces.object("high").quad(DVec3::Z, DVec3::Y * 3.0, DVec3::X * 3.0);
    pieces
}

#[test]
fn features_are_those_of_the_end_that_receives() {
    staged(unequal(), |estimator, [low, high]| {
        for (a, b) in [(low, high), (high, low)] {
            for first_receives in [true, false] {
                let accuracy = Accuracy { feature_size: 0.3, first_receives, ..Accuracy::unknown(1e3) };
                let (_, query) = estimator.draft(a, b, accuracy).expect("they face each other");
                let receiver = if first_receives { a } else { b };
                // Segments start at the receiver; the other end is the emitter, and its width counts.
                let (from, width) = if receiver == low { (0.0, 3.0) } else { (1.0, 1.0) };
                for lane in query.packet.lanes() {
                    assert_eq!(query.packet.point(lane, 0.0).z, from);
                }
                assert!((query.emitter_size - width).abs() < 1e-6 && query.feature_size == 0.3);
            }
        }
    });
}

#[test]
fn few_segments_where_visibility_is_certain() {
    // Something is in between, but hides next to nothing: nobody is certain before rays are asked.
    let mut pieces = opposed(1.0);
    pieces.object("mote").quad(DVec3::new(0.011, 0.017, 0.5), DVec3::X * 1e-4, DVec3::Y * 1e-4);
    staged(pieces, |estimator, [low, high]| {
        let rays = |worth: f32, deviation: f32| {
            let accuracy = Accuracy { deviation, ..Accuracy::unknown(worth) };
            let link = estimator.measure(low, high, accuracy, &mut Scratch::default());
            link.expect("they face each other").rays
        };
        // The exchange area times a factor of 1 to 5, times the deviation of the visibility.
        assert_eq!([rays(5.0, 0.5), rays(5.0, 0.05), rays(1e3, 0.05), rays(0.1, 0.5)], [16, 4, 16, 4]);
    });
    let link = |transmittance: f32, rays: u32| Link {
        a: 0,
        b: 1,
        exchange_area: 1.0,
        transmittance,
        variation: [0.0; 2],
        noise: 0.0,
        rays,
        certificate: BlockerCertificate::UNKNOWN,
    };
    assert!((link(0.5, 16).transmittance_deviation() - 0.5).abs() < 1e-6);
    // Sixteen that agree say more than four, and none say nothing.
    let certain = [16, 4, 0].map(|rays| link(1.0, rays).transmittance_deviation());
    assert!(certain[0] > 0.0 && certain[0] < certain[1] && certain[1] < certain[2], "{certain:?}");
    assert!(certain[2] == 0.5 && (certain[0] - link(0.0, 16).transmittance_deviation()).abs() < 1e-6);
}

mod certificates;
