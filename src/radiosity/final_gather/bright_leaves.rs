//! Small bright surfaces as light sources of points: the inside of a lamp shade, the ceiling above an uplight. The rays of a point rarely meet them, and
//! a ray that does counts for all that were missed; shadow rays to them find their light without this noise.

use crate::radiosity::elements::emitter_face::EmitterFace;
use crate::radiosity::elements::emitters::Emitter;
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::refinement::LinkedScene;
use crate::radiosity::rgb::{add, mean};

/// Smallest reflected radiosity of a bright leaf over the mean irradiance. Ordinary surfaces near lamps stay below: of what they send the rays of
/// points find enough.
const BRIGHT: f64 = 16.0;
/// Largest number of elements that are sampled: a point evaluates a closed form for each, together in about 1 ms, the time of its rays. Instead of more
/// leaves their parents are sampled, and a ray to one brings the light of the leaf where it ends.
const MAX_FACES: usize = 1 << 14;

/// Leaves whose reflected light points receive by shadow rays.
#[derive(Default)]
pub(super) struct BrightLeaves {
    /// By element, whether it is one of them; empty if there are none.
    is_bright: Vec<bool>,
    /// Elements that have all of these leaves below them, as one emitter of the light that they reflect.
    pub emitter: Emitter,
    /// The sides of its faces.
    pub sides: Vec<u32>,
}

impl BrightLeaves {
    /// The leaves that would cause more noise at a point with `rays` rays than `error` of the mean irradiance, and others with the same parents. A leaf of
    /// area A in a scene of the area S is met by the part A / S of the rays on average; with the reflected radiosity B it adds the variance
    /// B² A / (S N) to the light of N rays.
    pub fn of(linked: &LinkedScene, reflected: &[[f32; 3]], (rays, error): (usize, f64)) -> BrightLeaves {
        let Elements { elements, states, .. } = &linked.elements;
        let leaves = linked.leaves();
        let area = |e: u32| elements[e as usize].area;
        let light = |e: u32| mean(reflected[e as usize].map(f64::from));
        let all: f64 = leaves.iter().map(|&e| area(e)).sum();
        let received = |e: u32| area(e) * mean(states[e as usize].irradiance);
        let level = leaves.iter().map(|&e| received(e)).sum::<f64>() / all;
        let mut chosen: Vec<u32> = leaves.iter().copied().filter(|&e| light(e) > BRIGHT * level).collect();
        let variance = chosen.iter().map(|&e| light(e).powi(2) * area(e) / all).sum::<f64>() / rays as f64;
        if chosen.is_empty() || variance <= (error * level).powi(2) {
            return BrightLeaves::default();
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
        let face = |e: &u32| {
            let element = &elements[*e as usize];
            let Shape::Surface { side, corners } = element.shape else { unreachable!("leaves are surfaces") };
            let side = &linked.elements.sides[side as usize];
            EmitterFace {
                corners,
                polygon: corners.map(|p| p.as_dvec3()),
                count: if corners[2] == corners[3] { 3 } else { 4 },
                normal: side.normal,
                end: side.end,
                exitance: sums[*e as usize].map(|sum| sum / element.area),
                area: element.area as f32,
                profile: None,
            }
        };
        let faces: Vec<EmitterFace> = chosen.iter().map(face).collect();
        let side_of = |e: &u32| match elements[*e as usize].shape {
            Shape::Surface { side, .. } => side,
            Shape::Cluster(_) => unreachable!("leaves are surfaces"),
        };
        let sides = chosen.iter().map(side_of).collect();
        let width = faces.iter().map(|face| face.area.sqrt()).fold(f32::MAX, f32::min);
        BrightLeaves { is_bright, emitter: Emitter { faces, width }, sides }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.is_bright.is_empty()
    }

    /// Whether points receive the light of a leaf by shadow rays.
    pub fn has(&self, leaf: u32) -> bool {
        self.is_bright.get(leaf as usize).copied().unwrap_or(false)
    }
}
