//! Sides that no light reaches: the insides of boxes that stand on a floor, the rooms behind a closed door.
//!
//! Elements of a floor that lie under the edge of such a box are lit as a whole, and send light inside that is not there;
//! in closed rooms it is even made up to what their rows must be. Where paths from all lamps never arrive there is nothing
//! to compute.

use super::lamps::Lamps;
use super::probe::OFF;
use crate::embree::Hits;
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::links::{cosine_direction, mix, numbers, point_on};
use crate::ray::{EndRule, LANES, Packet};
use crate::scene::Scene;
use crate::visibility::Exact;
use glam::Vec3;
use rayon::prelude::*;

/// Paths from all lamps, in sixteens, and how far each is followed.
const PACKETS: usize = 1 << 9;
const BOUNCES: usize = 8;
/// Hits that a side of a scene lit evenly must be able to expect before it is called dark, for none of them.
const EXPECTED: f64 = 32.0;
/// Sides hit less often than this part of what they can expect are dim: what they see is a room that little light gets into,
/// and by chance none to some of its sides.
const DIM: f64 = 0.1;
/// Rays by which sides that may be dark look around, in sixteens.
const LOOKS: usize = 4;

/// Sides that paths from the lamps do not hit, though they are large enough to be hit often, and that see no dim ones and none
/// that do; ascending. None in scenes with clusters: there light is followed from place to place in the end.
pub(super) fn unlit(scene: &Scene, elements: &Elements, exact: &Exact, ends: EndRule, seed: u64) -> Vec<u32> {
    let lamps = Lamps::new(scene, elements);
    let emitters: Vec<_> = lamps.emitters.iter().map(|(faces, _)| faces).filter(|f| !f.is_empty()).collect();
    if elements.large_from > 0 || emitters.is_empty() || emitters.len() > PACKETS {
        return Vec::new();
    }
    let length = 1.01 * scene.bounds.diagonal();
    let off = OFF * ends.slack();
    // One ray from each place, to the side that it meets and the place there.
    let step = |places: &[Option<(Vec3, Vec3)>; LANES], seed: u64| {
        let mut packet = Packet::EMPTY;
        for (lane, place) in places.iter().enumerate() {
            let Some((at, normal)) = place else { continue };
            let [u, v, ..] = numbers(seed, lane as u64);
            let from = *at + off * *normal;
            packet.set(lane, from, from + length * cosine_direction(*normal, u, v), ends);
        }
        packet.near = [0.0; LANES];
        let mut hits = [Hits::NONE];
        exact.scene.first_hits(exact.traversal, std::slice::from_ref(&packet), &mut hits);
        std::array::from_fn::<_, LANES, _>(|lane| {
            let triangle = hits[0].triangle[lane];
            if packet.active >> lane & 1 == 0 || triangle == Hits::NOTHING {
                return None;
            }
            let (from, at) = (packet.point(lane, 0.0), packet.point(lane, hits[0].t[lane]));
            let side = elements.met(triangle, at - from);
            Some((side, at, elements.sides.get(side as usize)?.normal))
        })
    };
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
                let next = step(&places, mix(seed ^ bounce as u64));
                met.extend(next.iter().flatten().map(|(side, ..)| *side));
                places = next.map(|place| place.map(|(_, at, normal)| (at, normal)));
            }
            met
        })
        .collect();
    let mut counts = vec![0u32; elements.sides.len()];
    met.iter().flatten().for_each(|&side| counts[side as usize] += 1);
    let all: usize = met.iter().map(Vec::len).sum();
    let expected = |s: usize| {
        let element = elements.sides[s].element as usize;
        all as f64 * elements.elements[element].area / elements.area
    };
    let emits = |s: usize| elements.sides[s].exitance.iter().any(|&m| m > 0.0);
    let mut dark: Vec<bool> =
        (0..counts.len()).map(|s| counts[s] == 0 && expected(s) >= EXPECTED && !emits(s)).collect();
    let candidates: Vec<usize> = (0..counts.len()).filter(|&s| dark[s]).collect();
    let around = |&s: &usize| {
        let side = &elements.sides[s];
        let Shape::Surface { corners, .. } = elements.elements[side.element as usize].shape else {
            return Vec::new();
        };
        let mut seen = Vec::new();
        for k in 0..LOOKS {
            let places = std::array::from_fn(|lane| {
                let [u, v, ..] = numbers(mix(!seed ^ s as u64), (k * LANES + lane) as u64);
                Some((point_on(&corners, u, v), side.normal))
            });
            let next = step(&places, mix(seed ^ mix((s * LOOKS + k) as u64)));
            seen.extend(next.into_iter().flatten().map(|(side, ..)| side as usize));
        }
        seen
    };
    let seen: Vec<Vec<usize>> = candidates.par_iter().map(around).collect();
    let dim = |s: usize| f64::from(counts[s]) < DIM * expected(s);
    loop {
        let kept: Vec<usize> = (candidates.iter().zip(&seen))
            .filter(|(s, seen)| dark[**s] && seen.iter().any(|&t| !dark[t] && dim(t)))
            .map(|(s, _)| *s)
            .collect();
        if kept.is_empty() {
            break;
        }
        kept.into_iter().for_each(|s| dark[s] = false);
    }
    (0..counts.len()).filter(|&s| dark[s]).map(|s| s as u32).collect()
}
