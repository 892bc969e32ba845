//! Sides that no light reaches: the insides of boxes that stand on a floor, the rooms behind a closed door.
//!
//! Elements of a floor that lie under the edge of such a box are lit as a whole, and send light inside that is not there;
//! in closed rooms it is even made up to what their rows must be. Where paths from all lamps never arrive there is nothing
//! to compute.

use super::lamps::Lamps;
use crate::element::Elements;
use crate::embree::Hits;
use crate::link::{cosine_direction, mix, numbers, point_on};
use crate::ray::{EndRule, LANES, Packet};
use crate::scene::Scene;
use crate::visibility::{Exact, reference};
use glam::Vec3;
use rayon::prelude::*;

/// Paths from all lamps, in sixteens, and how far each is followed.
const PACKETS: usize = 1 << 9;
const BOUNCES: usize = 8;
/// Hits that a side of a scene lit evenly must be able to expect before it is called dark, and the part of them that are
/// taken for paths that slipped through an edge.
const EXPECTED: f64 = 32.0;
const SLIPPED: f64 = 1e-3;

/// Sides that paths from the lamps hit not at all, or as good as never, though they are large enough to be hit often;
/// ascending. None in scenes with clusters: there light is followed from place to place in the end.
pub(super) fn unlit(scene: &Scene, elements: &Elements, exact: Exact, ends: EndRule, seed: u64) -> Vec<u32> {
    let lamps = Lamps::new(scene, elements);
    let emitters: Vec<_> = lamps.emitters.iter().map(|(faces, _)| faces).filter(|f| !f.is_empty()).collect();
    if elements.large_from > 0 || emitters.is_empty() || emitters.len() > PACKETS {
        return Vec::new();
    }
    let length = 1.01 * scene.bounds.diagonal();
    let off = 2e-6 * reference::magnitude(scene);
    let met: Vec<Vec<u32>> = (0..PACKETS)
        .into_par_iter()
        .map(|k| {
            let seed = mix(seed ^ mix(k as u64));
            let faces = emitters[k % emitters.len()];
            let mut places: [Option<(Vec3, Vec3)>; LANES] = std::array::from_fn(|lane| {
                let [u, v, face, _] = numbers(seed, lane as u64);
                let face = &faces[(face * faces.len() as f32) as usize % faces.len()];
                Some((point_on(&face.corners, u, v), face.normal))
            });
            let mut met = Vec::new();
            for bounce in 1..=BOUNCES {
                let mut packet = Packet::EMPTY;
                for (lane, place) in places.iter().enumerate() {
                    let Some((at, normal)) = place else { continue };
                    let [u, v, ..] = numbers(mix(seed ^ bounce as u64), lane as u64);
                    let from = *at + off * *normal;
                    packet.set(lane, from, from + length * cosine_direction(*normal, u, v), ends);
                }
                packet.near = [0.0; LANES];
                let mut hits = [Hits::NONE];
                exact.scene.first_hits(exact.traversal, std::slice::from_ref(&packet), &mut hits);
                places = std::array::from_fn(|lane| {
                    let triangle = hits[0].triangle[lane];
                    if packet.active >> lane & 1 == 0 || triangle == Hits::NOTHING {
                        return None;
                    }
                    let (from, at) = (packet.point(lane, 0.0), packet.point(lane, hits[0].t[lane]));
                    let side = elements.met(triangle, at - from);
                    let normal = elements.sides.get(side as usize)?.normal;
                    met.push(side);
                    Some((at, normal))
                });
            }
            met
        })
        .collect();
    let mut counts = vec![0u32; elements.sides.len()];
    met.iter().flatten().for_each(|&side| counts[side as usize] += 1);
    let all: usize = met.iter().map(Vec::len).sum();
    let dark = |&s: &usize| {
        let side = &elements.sides[s];
        let expected = all as f64 * elements.elements[side.element as usize].area / elements.area;
        let emits = side.exitance.iter().any(|&m| m > 0.0);
        !emits && expected >= EXPECTED && f64::from(counts[s]) <= SLIPPED * expected
    };
    (0..counts.len()).filter(dark).map(|s| s as u32).collect()
}
