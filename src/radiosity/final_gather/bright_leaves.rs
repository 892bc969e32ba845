//! Small bright surfaces as light sources: the inside of a lamp shade, the ceiling above an uplight. The rays of a point or an element rarely meet them,
//! and a ray that does counts for all that were missed; shadow rays to them find their light without this noise.

use crate::radiosity::elements::emitter_face::EmitterFace;
use crate::radiosity::elements::emitters::{Emitter, Emitters};
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::refinement::LinkedScene;
use crate::radiosity::rgb::{Rgb, add, mean};

/// Smallest reflected radiosity of a bright leaf over the mean irradiance, for points. Ordinary surfaces near lamps stay below: of what they send the rays
/// of points find enough.
pub(super) const BRIGHT: f64 = 16.0;
/// The same for elements, which have fewer rays: those of the floor of a room that a lamp in a cove lights have noise of 26 % with 16, 8.5 % with 4 and
/// 7.8 % with 2.
pub(super) const BRIGHT_FOR_ELEMENTS: f64 = 4.0;
/// Largest number of elements that are sampled: a point evaluates a closed form for each, together in about 1 ms, the time of its rays. Instead of more
/// leaves their parents are sampled, and a ray to one brings the light of the leaf where it ends.
const MAX_FACES: usize = 1 << 14;

/// Leaves whose reflected light is received by shadow rays.
pub(super) struct BrightLeaves {
    /// By element, the face that it is, or is a part of; [`Elements::NONE`] for others.
    face_of: Vec<u32>,
    /// Elements that have all of these leaves below them, as one emitter of the light that they reflect, with the numbers of its faces.
    pub emitters: Emitters,
    /// The sides of its faces.
    pub sides: Vec<u32>,
}

impl BrightLeaves {
    /// The leaves of more than `bright` times the mean irradiance, and others with the same parents, if they would cause more noise at a point with
    /// `rays` rays than `error` of the mean irradiance. A leaf of area A in a scene of the area S is met by the part A / S of the rays on average; with the
    /// reflected radiosity B it adds the variance B² A / (S N) to the light of N rays.
    pub fn of(
        linked: &LinkedScene,
        reflected: &[[f32; 3]],
        bright: f64,
        (rays, error): (usize, f64),
    ) -> Option<BrightLeaves> {
        let Elements { elements, states, .. } = &linked.elements;
        let leaves = linked.leaves();
        let area = |e: u32| elements[e as usize].area;
        let light = |e: u32| mean(reflected[e as usize].map(f64::from));
        let all: f64 = leaves.iter().map(|&e| area(e)).sum();
        let received = |e: u32| area(e) * mean(states[e as usize].irradiance);
        let level = leaves.iter().map(|&e| received(e)).sum::<f64>() / all;
        let mut chosen: Vec<u32> = leaves.iter().copied().filter(|&e| light(e) > bright * level).collect();
        let variance = chosen.iter().map(|&e| light(e).powi(2) * area(e) / all).sum::<f64>() / rays as f64;
        if chosen.is_empty() || variance <= (error * level).powi(2) {
            return None;
        }
        while chosen.len() > MAX_FACES {
            let parent = |&e: &u32| match elements[elements[e as usize].parent as usize].is_cluster() {
                true => e,
                false => elements[e as usize].parent,
            };
            let mut parents: Vec<u32> = chosen.iter().map(parent).collect();
            parents.sort_unstable();
            parents.dedup();
            if parents == chosen {
                break;
            }
            chosen = parents;
        }
        // Parents come before their children.
        let mut is_bright = vec![false; elements.len()];
        chosen.iter().for_each(|&e| is_bright[e as usize] = true);
        for e in 1..elements.len() {
            is_bright[e] |= is_bright[elements[e].parent as usize];
        }
        chosen.retain(|&e| !is_bright[elements[e as usize].parent as usize]);
        let mut face_of = vec![Elements::NONE; elements.len()];
        (0..).zip(&chosen).for_each(|(face, &e)| face_of[e as usize] = face);
        for e in 1..elements.len() {
            if face_of[e] == Elements::NONE {
                face_of[e] = face_of[elements[e].parent as usize];
            }
        }
        let mut sums = vec![[0.0; 3]; elements.len()];
        for &leaf in leaves.iter().filter(|&&leaf| is_bright[leaf as usize]) {
            add(&mut sums[leaf as usize], area(leaf), reflected[leaf as usize].map(f64::from));
        }
        for e in (1..elements.len()).rev().filter(|&e| is_bright[e]) {
            let (own, parent) = (sums[e], elements[e].parent as usize);
            if is_bright[parent] {
                add(&mut sums[parent], 1.0, own);
            }
        }
        let (sides, faces): (Vec<u32>, Vec<EmitterFace>) =
            chosen.iter().map(|&e| face(&linked.elements, e, sums[e as usize])).unzip();
        let width = faces.iter().map(|face| face.area.sqrt()).fold(f32::MAX, f32::min);
        let numbered = (0..faces.len() as u32).map(|k| (0, k, k)).collect();
        let emitters = Emitters::of(vec![Emitter { faces, width }], numbered, sides.len());
        Some(BrightLeaves { face_of, emitters, sides })
    }

    /// The face of which a leaf is a part, if its light is received by shadow rays.
    pub fn face_of(&self, leaf: u32) -> Option<u32> {
        Some(self.face_of[leaf as usize]).filter(|face| *face != Elements::NONE)
    }

    /// The emitter of all leaves.
    pub fn emitter(&self) -> &Emitter {
        &self.emitters.emitters[0]
    }
}

/// The side of an element, and the element as a face that emits this power, W.
fn face(elements: &Elements, e: u32, power: Rgb) -> (u32, EmitterFace) {
    let element = &elements.elements[e as usize];
    let Shape::Surface { side: number, corners } = element.shape else { unreachable!("leaves are surfaces") };
    let side = &elements.sides[number as usize];
    let face = EmitterFace {
        corners,
        polygon: corners.map(|p| p.as_dvec3()),
        count: if corners[2] == corners[3] { 3 } else { 4 },
        normal: side.normal,
        end: side.end,
        exitance: power.map(|power| power / element.area),
        area: element.area as f32,
        profile: None,
    };
    (number, face)
}
