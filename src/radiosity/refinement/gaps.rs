//! Elements in gaps narrower than themselves, as inside a hollow door or between two cupboards.
//!
//! Light decays along a gap within a few times its width. An element that is larger sends out its mean light from all of its points, and
//! light would come as much deeper into the gap as elements are larger: three times too much in a hollow panel of 3 cm by elements of 12 cm.
//! These elements take no part in the exchange of light, and paths that meet them go on from there.

use super::linked_scene::LinkedScene;
use crate::radiosity::elements::{Elements, Shape, centres_of_quarters};
use crate::radiosity::rgb::mean;
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::Exact;
use rayon::prelude::*;

/// Width of a gap that counts as narrow, as a part of the radius of the element. Over an endless gap of width w, the part (w / r)² of diffuse
/// light travels farther than r: half of it.
const NARROW: f32 = std::f32::consts::FRAC_1_SQRT_2;
/// The bits of all quarters.
pub const ALL: u32 = 0xf;
/// Elements of one parallel task: each has four segments of a packet.
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

    /// The part of all light on the surfaces that elements outside the exchange reflect.
    pub fn share_reflected_apart(&self) -> f64 {
        let Elements { elements, states, sides, .. } = &self.elements;
        let (mut all, mut reflected) = (0.0, 0.0);
        for leaf in self.leaves() {
            let (element, state) = (&elements[leaf as usize], &states[leaf as usize]);
            let Shape::Surface { side, .. } = element.shape else { continue };
            let power = element.area * mean(state.irradiance);
            all += power;
            if state.is_apart() {
                let reflectance = sides[side as usize].reflectance.into_iter().fold(0.0, f32::max);
                reflected += f64::from(reflectance) * power;
            }
        }
        if all > 0.0 { reflected / all } else { 0.0 }
    }
}

/// By element, the quarters that have another surface right above their centres, a bit each.
pub fn covered_quarters(elements: &Elements, exact: &Exact, leaves: &[u32]) -> Vec<u32> {
    let of_chunk = |leaves: &[u32]| {
        let mut packet = Packet::EMPTY;
        leaves.iter().enumerate().for_each(|(k, &e)| set_normals(&mut packet, 4 * k, elements, e));
        let mut blocked = [0];
        exact.occluded(std::slice::from_ref(&packet), &mut blocked);
        (0..leaves.len()).map(move |k| blocked[0] >> (4 * k) & ALL)
    };
    leaves.par_chunks(CHUNK).with_min_len(256).flat_map_iter(of_chunk).collect()
}

/// Sets lanes from `first` on to segments from the quarters of a leaf along its normal.
fn set_normals(packet: &mut Packet, first: usize, elements: &Elements, leaf: u32) {
    let element = &elements.elements[leaf as usize];
    let Shape::Surface { side, corners } = element.shape else { return };
    let side = &elements.sides[side as usize];
    for (k, at) in centres_of_quarters(&corners).into_iter().enumerate() {
        let from = side.end.lifted(at, side.normal);
        packet.set_between(first + k, from, from + NARROW * element.radius * side.normal, [0.0, 1.0]);
    }
}
