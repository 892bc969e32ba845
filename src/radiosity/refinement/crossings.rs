//! Elements that other surfaces cross, such as a floor element with the foot of a thin wall in its middle, and elements that other surfaces
//! partly cover, such as an element of the wall one centimetre behind a cupboard.
//!
//! The irradiance differs between the two sides of such a line, so that the mean over the element is wrong on both. These elements are
//! split a few times along the line; the remaining ones do not exchange light, and paths that hit them continue from the hit point.

use super::linked_scene::LinkedScene;
use crate::math::Aabb;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::{Elements, Shape, Side, centres_of_quarters};
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::Exact;
use glam::Vec3;
use rayon::prelude::*;

/// Distance of the test segments from the edges and the plane of their element, as a fraction of its diameter: a surface nearer to an edge
/// leaves less than this fraction of the element on its other side.
const INSET: f32 = 1.0 / 128.0;
/// The same fraction for segments that find surfaces ending above the element, such as a sheet a few millimetres above the floor: the two
/// sides of the element have different light if the gap is narrower. With 1/8 or 1/2, light 2 cm behind a lit sheet with a gap of 3 mm is
/// 23 % or 56 % too bright (`cargo test the_bright_foot`).
const INSET_CLEAR: f32 = 1.0 / 4.0;
/// Largest number of times that an element of the size of the local pass is split: its parts are then an eighth as wide. Four times
/// adds twice as many elements, a tenth of those of the Cornell box.
const MAX_SPLITS: i32 = 3;
/// Largest number of elements added by these splits, relative to the number of all elements: time and memory of the local pass at most
/// double. If there are more crossed elements, the largest are split.
const MAX_ADDED_RATIO: f64 = 1.0;
/// Number of elements that may be added to a scene of any size: at 1.4 kB and 40 µs for each (see
/// [`FineGround::MAX_TRIANGLES`](crate::scene::FineGround::MAX_TRIANGLES)) they take 11 MB and 0.3 s.
const ALWAYS_ADDED: usize = 1 << 13;

impl LinkedScene {
    /// Splits the parts of surfaces that other surfaces cross, and marks the remaining ones
    /// ([`ElementState::crossed`](crate::radiosity::elements::ElementState::crossed)).
    pub fn split_at_crossings(&mut self, exact: &Exact, deadline: &Deadline) {
        self.elements.states.iter_mut().for_each(|state| state.crossed = false);
        if deadline.late() {
            return;
        }
        let leaves = self.leaves();
        // Repeated passes do not split elements of the smallest size again.
        let smallest = self.elements.min_area / 4f64.powi(MAX_SPLITS - 1);
        let mut remaining = ((MAX_ADDED_RATIO * leaves.len() as f64) as usize).max(ALWAYS_ADDED);
        let mut found = crossed(&self.elements, exact, &leaves);
        loop {
            let large = |e: &&u32| area(&self.elements, **e) > smallest;
            let mut to_split: Vec<u32> = found.iter().filter(large).copied().collect();
            // If there is no room for all of them, the largest are split.
            to_split.sort_by(|&a, &b| {
                area(&self.elements, b).total_cmp(&area(&self.elements, a)).then(a.cmp(&b))
            });
            to_split.truncate(remaining / 4);
            if to_split.is_empty() || deadline.late() {
                break;
            }
            remaining -= 4 * to_split.len();
            let first = self.elements.len() as u32;
            to_split.iter().for_each(|&e| self.split(e));
            if self.elements.len() as u32 == first {
                break;
            }
            let made: Vec<u32> = (first..self.elements.len() as u32).collect();
            let whole = found.into_iter().filter(|&e| self.elements.elements[e as usize].is_leaf());
            found = whole.chain(crossed(&self.elements, exact, &made)).collect();
        }
        found.into_iter().for_each(|e| self.elements.states[e as usize].crossed = true);
    }

    /// For each leaf, a bit mask of the edges along which other surfaces stand (segments across their middles are blocked); 0 for
    /// undivided surfaces.
    pub fn walls_along(&self, exact: &Exact, leaves: &[u32]) -> Vec<u8> {
        let parts = divided(&self.elements, leaves);
        let mut walls =
            parts.iter().copied().zip(blocked(&self.elements, exact, &parts, set_across)).peekable();
        let of = |leaf: &u32| walls.next_if(|(part, _)| part == leaf).map_or(0, |(_, edges)| edges as u8);
        leaves.iter().map(of).collect()
    }

    /// The number of parts of surfaces that other surfaces cross or partly cover.
    pub fn count_crossed(&self, exact: &Exact) -> usize {
        crossed(&self.elements, exact, &self.leaves()).len()
    }
}

/// Area of an element, scene units squared.
fn area(elements: &Elements, e: u32) -> f64 {
    elements.elements[e as usize].area
}

/// The parts of surfaces among some leaves that other surfaces cross (segments along the edges of the part are blocked) or partly cover.
fn crossed(elements: &Elements, exact: &Exact, leaves: &[u32]) -> Vec<u32> {
    let parts = divided(elements, leaves);
    let [crossed, clear] = [INSET, INSET_CLEAR].map(|inset| {
        blocked(elements, exact, &parts, |packet, first, corners, side| {
            set_edges(packet, first, corners, side, inset)
        })
    });
    let covered = covered_quarters(elements, exact, &parts);
    let in_part = |quarters: u32| quarters != 0 && quarters != ALL;
    let edges = crossed.into_iter().zip(clear).map(|(low, high)| low | high);
    let found = parts.into_iter().zip(edges.zip(covered));
    found.filter(|(_, (edges, quarters))| *edges != 0 || in_part(*quarters)).map(|(e, _)| e).collect()
}

/// The leaves among these that are parts of surfaces. Surfaces that are too small to be divided are left out: to test them takes a tenth
/// to a third more time, and the light of a room changes by less than its error.
fn divided(elements: &Elements, leaves: &[u32]) -> Vec<u32> {
    leaves.iter().filter(|e| elements.elements[**e as usize].level > 0).copied().collect()
}

/// Sets lanes from `first` on to segments above the edges of an element, within it by this fraction of its diameter and as far above it:
/// faces that rise from its edges by up to 135° do not meet them.
fn set_edges(packet: &mut Packet, first: usize, corners: &[Vec3; 4], side: &Side, inset: f32) {
    let (count, middle, above) = frame(corners, side, inset);
    let inner = |k: usize| middle + above + (1.0 - 2.0 * inset) * (corners[k % count] - middle);
    for k in 0..count {
        packet.set_between(first + k, inner(k), inner(k + 1), [0.0, 1.0]);
    }
}

/// Sets lanes from `first` on to segments across the middles of the edges of an element, which begin and end twice as far from the edges
/// as those of [`set_edges`]: a wall that crosses neither element lies between. The next face of a bowl counts as a wall from an angle of
/// about 30° on.
fn set_across(packet: &mut Packet, first: usize, corners: &[Vec3; 4], side: &Side) {
    let (count, middle, above) = frame(corners, side, INSET);
    for k in 0..count {
        let edge = 0.5 * (corners[k] + corners[(k + 1) % count]);
        let inwards = 4.0 * INSET * (middle - edge);
        packet.set_between(first + k, edge + above + inwards, edge + above - inwards, [0.0, 1.0]);
    }
}

/// The number of corners of an element, their mean, and the offset of segments from its plane for this fraction of its diameter.
fn frame(corners: &[Vec3; 4], side: &Side, part: f32) -> (usize, Vec3, Vec3) {
    let count = if corners[2] == corners[3] { 3 } else { 4 };
    let middle = corners[..count].iter().sum::<Vec3>() / count as f32;
    let diameter = 2.0 * corners.iter().map(|c| (*c - middle).length()).fold(0.0, f32::max);
    (count, middle, side.end.height().max(part * diameter) * side.normal)
}

// Elements in gaps narrower than themselves, as inside a hollow door or between two cupboards.
//
// Light decays along a gap within a few times its width. A larger element emits its mean light from all of its points, so that light would
// reach deeper into the gap in proportion to the element's size: three times too much in a hollow panel of 3 cm with elements of 12 cm.
// These elements do not exchange light, and paths that hit them continue from the hit point.

/// Width of a gap that counts as narrow, as a fraction of the radius of the element. Over an endless gap of width w, the fraction (w /
/// r)² of diffuse light travels farther than r: half of it.
const MAX_NARROW_GAP: f32 = std::f32::consts::FRAC_1_SQRT_2;
/// The bits of all quarters.
pub const ALL: u32 = 0xf;
/// Elements of one parallel task: each has up to four segments of a packet.
const CHUNK: usize = LANES / 4;

impl LinkedScene {
    /// Marks the leaves that have another surface right above all of their quarters
    /// ([`ElementState::narrow`](crate::radiosity::elements::ElementState::narrow)).
    pub fn mark_gaps(&mut self, exact: &Exact) {
        let leaves = self.leaves();
        let covered = covered_quarters(&self.elements, exact, &leaves);
        self.elements.states.iter_mut().for_each(|state| state.narrow = false);
        for (leaf, _) in leaves.into_iter().zip(covered).filter(|(_, quarters)| *quarters == ALL) {
            self.elements.states[leaf as usize].narrow = true;
        }
    }
}

/// For each leaf, a bit mask of the quarters that have another surface right above their centres.
pub fn covered_quarters(elements: &Elements, exact: &Exact, leaves: &[u32]) -> Vec<u32> {
    blocked(elements, exact, leaves, |packet, first, corners, side| {
        let radius = 0.5 * Aabb::of(*corners).diagonal();
        for (k, at) in centres_of_quarters(corners).into_iter().enumerate() {
            let from = side.end.lifted(at, side.normal);
            packet.set_between(first + k, from, from + MAX_NARROW_GAP * radius * side.normal, [0.0, 1.0]);
        }
    })
}

/// For each leaf, a bit mask of the blocked segments; `set` writes up to four segments into a packet, from a given lane on.
pub fn blocked(
    elements: &Elements,
    exact: &Exact,
    leaves: &[u32],
    set: impl Fn(&mut Packet, usize, &[Vec3; 4], &Side) + Sync,
) -> Vec<u32> {
    let of_chunk = |leaves: &[u32]| {
        let mut packet = Packet::EMPTY;
        for (k, &e) in leaves.iter().enumerate() {
            let Shape::Surface { side, corners } = elements.elements[e as usize].shape else { continue };
            set(&mut packet, 4 * k, &corners, &elements.sides[side as usize]);
        }
        let mut blocked = [0];
        exact.occluded(std::slice::from_ref(&packet), &mut blocked);
        (0..leaves.len()).map(move |k| blocked[0] >> (4 * k) & ALL)
    };
    leaves.par_chunks(CHUNK).with_min_len(256).flat_map_iter(of_chunk).collect()
}
