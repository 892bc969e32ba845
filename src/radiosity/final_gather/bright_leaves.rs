//! Small bright surfaces as light sources: the inside of a lamp shade, the ceiling above an uplight. The rays of a point or an element
//! rarely hit them, and a ray that does stands for all that miss, which causes noise. Shadow rays to these surfaces find their light
//! without this noise.

use super::reflected::Reflected;
use crate::radiosity::elements::emitters::{Emitter, EmitterFace, Emitters, NumberedFace};
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::refinement::LinkedScene;
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::ray::LANES;

/// Smallest number of shadow rays of a point and an emitter: two packets, whose difference shows whether more rays are
/// needed. 16 or 64 rays instead change irradiance by less than 0.08 % (`constants.py solve`).
pub(super) const MIN_SHADOW_RAYS: usize = 2 * LANES;
/// Allowed standard error of the light of one emitter, as a fraction of the error asked for: with four equal emitters the errors add up
/// to all of it.
pub(super) const FRACTION_OF_ERROR: f64 = 0.5;
/// Time of the closed form of a face, relative to the time of a ray from a point: both are computed for every point. It only decides
/// how many faces are chosen, which changes noise and time, not the mean.
const COST_OF_FACE: f64 = 0.25;
/// Largest number of faces that are chosen: limits the time of their closed forms at a point to that of [`COST_OF_FACE`] · 16,384 =
/// 4,096 rays.
const MAX_FACES: usize = 1 << 14;
/// Largest ratio between the radiosities of leaves that are sampled as one face, their parent. A shadow ray carries the light of the leaf
/// where it ends. The differences between leaves add a variance of at most 1/8 of the square of the light, half of the variance by
/// visibility.
const MAX_RANGE: f64 = 2.0;

/// Leaves whose reflected light is received by shadow rays.
pub(super) struct BrightLeaves {
    /// By element, the number of its face, for the chosen elements and the elements below them; [`Elements::NONE`] for others.
    face_of: Vec<u32>,
    /// The chosen elements as numbered faces of one emitter, which emits the light that the leaves below them reflect.
    pub emitters: Emitters,
    /// The side of each of these faces.
    pub sides: Vec<u32>,
}

impl BrightLeaves {
    /// The elements that [`Brightest::of`] chooses; `None` if it chooses none.
    pub fn of(
        linked: &LinkedScene,
        reflected: &[Reflected],
        rays: usize,
        shadow_rays: usize,
        error: f64,
    ) -> Option<BrightLeaves> {
        let Elements { elements, states, .. } = &linked.elements;
        let leaves = linked.leaves();
        let area = |e: u32| elements[e as usize].area;
        let light = |e: u32| mean(reflected[e as usize].light.map(f64::from));
        let received: f64 = leaves.iter().map(|&e| area(e) * mean(states[e as usize].irradiance)).sum();
        let lit: Vec<(u32, f64)> = leaves.iter().map(|&e| (e, light(e))).collect();
        let Brightest { chosen, face_of } =
            Brightest::of(&linked.elements, &lit, rays, shadow_rays, error * received);
        if chosen.is_empty() {
            return None;
        }
        let mut sums = vec![[0.0; 3]; chosen.len()];
        for &leaf in leaves.iter().filter(|&&leaf| face_of[leaf as usize] != Elements::NONE) {
            let sum = &mut sums[face_of[leaf as usize] as usize];
            add(sum, area(leaf), reflected[leaf as usize].light.map(f64::from));
        }
        let (sides, faces): (Vec<u32>, Vec<EmitterFace>) =
            chosen.iter().zip(&sums).map(|(&e, &sum)| face(&linked.elements, e, sum)).unzip();
        let width = faces.iter().map(|face| face.area.sqrt()).fold(f32::MAX, f32::min);
        let numbered =
            (0..faces.len() as u32).map(|k| NumberedFace { emitter: 0, face: k, number: k }).collect();
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

/// For a square that covers k cells of a grid of rays: the variance of the fraction of the rays that hit the square, over the variance
/// with as many random rays, times √k. The edges of the square cross 4 √k cells; a fraction p of each is covered, and p (1 - p) has the
/// mean 1/6. The factor .3 is measured: cells at edges are divided, which removes the rest. At the points of a Cornell box
/// (`scenes/cornell.py`) the factors 1 and .1 leave 1.2 and 1.5 times the error.
const UNEVEN_CELLS: f64 = 0.3 * 4.0 / 6.0;

/// Elements that should be sampled by shadow rays.
pub(super) struct Brightest {
    /// Numbers of the elements.
    pub chosen: Vec<u32>,
    /// By element, the index in `chosen` of the element itself or of its chosen ancestor; [`Elements::NONE`] for others.
    pub face_of: Vec<u32>,
}

/// Areas and light of the leaves below an element.
#[derive(Clone, Copy)]
struct SubtreeLight {
    /// Smallest and largest radiosity, W/m².
    range: [f64; 2],
    area: f64,
    /// Sum of radiosity times area, W/m² times scene units squared.
    power: f64,
}

impl Brightest {
    /// Chooses the elements that minimise the variance of the light at a point times its computing time. `leaves` are all leaves with
    /// their radiosities, W/m². It chooses none if the rays of a point alone leave less noise than the irradiance by `tolerated_power`,
    /// W, spread over all leaves. A candidate is the largest element of about even radiosity; a leaf is no candidate if a wall across it
    /// separates different light.
    ///
    /// One of the `rays` of a point hits a surface of area A with the mean probability A / S, where S is the area of all surfaces. With
    /// the radiosity B of the surface and the mean B̄ of all, the surface adds (B - B̄)² A / S to the variance of a ray, less if it
    /// covers whole cells of the grid of rays ([`UNEVEN_CELLS`]). Each shadow ray leaves the variance p (1 - p) L² ≤ L² / 4, where p is
    /// the visible fraction of the light L of the chosen surfaces. A point traces as many shadow rays, at most `shadow_rays`, as leave
    /// [`FRACTION_OF_ERROR`] of the error asked for. The time is that of both kinds of rays and of the closed forms of the faces.
    pub fn of(
        Elements { elements, states, .. }: &Elements,
        leaves: &[(u32, f64)],
        rays: usize,
        shadow_rays: usize,
        tolerated_power: f64,
    ) -> Brightest {
        let nothing = SubtreeLight { range: [f64::INFINITY, 0.0], area: 0.0, power: 0.0 };
        let mut below = vec![nothing; elements.len()];
        for &(leaf, light) in leaves {
            let area = elements[leaf as usize].area;
            let range = if states[leaf as usize].is_excluded() { [0.0, f64::INFINITY] } else { [light; 2] };
            below[leaf as usize] = SubtreeLight { range, area, power: area * light };
        }
        // Parents come before their children.
        for e in (1..elements.len()).rev() {
            let (own, of) = (below[e], &mut below[elements[e].parent as usize]);
            of.range = [of.range[0].min(own.range[0]), of.range[1].max(own.range[1])];
            (of.area, of.power) = (of.area + own.area, of.power + own.power);
        }
        let is_even = |e: usize| {
            let SubtreeLight { range: [low, high], area, .. } = below[e];
            !elements[e].is_cluster() && area > 0.0 && high <= MAX_RANGE * low
        };
        let mut is_part = vec![false; elements.len()];
        let mut surfaces = Vec::new();
        for e in 1..elements.len() {
            is_part[e] = is_part[elements[e].parent as usize];
            if !is_part[e] && is_even(e) {
                is_part[e] = true;
                surfaces.push(e as u32);
            }
        }
        let all = below[0].area;
        let mean_radiosity = below[0].power / all;
        let light = |e: u32| below[e as usize].power / below[e as usize].area;
        let (of_rays, most) = (rays as f64, shadow_rays as f64);
        let allowed = (FRACTION_OF_ERROR * tolerated_power / all).powi(2);
        let variance_by = |e: u32| {
            let part = below[e as usize].area / all;
            (light(e) - mean_radiosity).powi(2) * part * (UNEVEN_CELLS / (of_rays * part).sqrt()).min(1.0)
        };
        let mut variance_left: f64 = surfaces.iter().map(|&e| variance_by(e)).sum();
        let mut chosen = Vec::new();
        if variance_left > of_rays * (tolerated_power / all).powi(2) {
            chosen = surfaces.into_iter().filter(|&e| light(e) > mean_radiosity).collect();
            chosen.sort_by(|&a, &b| variance_by(b).total_cmp(&variance_by(a)));
            let (mut best, mut count, mut mean_sent) = (variance_left, 0, 0.0);
            for (faces, &e) in (1..=MAX_FACES).zip(&chosen) {
                variance_left -= variance_by(e);
                mean_sent += below[e as usize].power / all;
                let of_one = 0.25 * mean_sent * mean_sent;
                let of_shadow_rays = (of_one / allowed).max(MIN_SHADOW_RAYS as f64).min(most);
                let variance = variance_left / of_rays + of_one / of_shadow_rays;
                let product = variance * (of_rays + of_shadow_rays + COST_OF_FACE * faces as f64);
                if product < best {
                    (best, count) = (product, faces);
                }
            }
            chosen.truncate(count);
        }
        let mut face_of = vec![Elements::NONE; elements.len()];
        (0..).zip(&chosen).for_each(|(face, &e)| face_of[e as usize] = face);
        for e in 1..elements.len() {
            if face_of[e] == Elements::NONE {
                face_of[e] = face_of[elements[e].parent as usize];
            }
        }
        Brightest { chosen, face_of }
    }
}

/// The side of an element, and the element as a face that emits this power, W.
fn face(elements: &Elements, e: u32, power: Rgb) -> (u32, EmitterFace) {
    let element = &elements.elements[e as usize];
    let Shape::Surface { side: number, corners } = element.shape else { unreachable!("leaves are surfaces") };
    let side = &elements.sides[number as usize];
    let exitance = power.map(|power| power / element.area);
    let face = EmitterFace::new(corners, side, exitance, element.area as f32);
    (number, face)
}
