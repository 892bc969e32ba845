//! Elements in gaps narrower than themselves, as inside a hollow door or between two cupboards.
//!
//! Light decays along a gap within a few times its width. A larger element emits its mean light from all of its points, so that light would
//! reach deeper into the gap in proportion to the element's size: three times too much in a hollow panel of 3 cm with elements of 12 cm.
//! These elements do not exchange light, and paths that hit them continue from the hit point.

use super::linked_scene::LinkedScene;
use crate::math::Aabb;
use crate::radiosity::elements::{Elements, Shape, Side, centres_of_quarters};
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::Exact;
use glam::Vec3;
use rayon::prelude::*;

/// Width of a gap that counts as narrow, as a part of the radius of the element. Over an endless gap of width w, the part (w / r)² of diffuse
/// light travels farther than r: half of it.
const NARROW: f32 = std::f32::consts::FRAC_1_SQRT_2;
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
            packet.set_between(first + k, from, from + NARROW * radius * side.normal, [0.0, 1.0]);
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
