//! Error bars of the solution.

use super::solved::{FinalLight, Solved};
use crate::math::parallel;
use crate::math::weld::weld;
use crate::radiosity::elements::{Element as ElementNode, Elements, Shape, Side, surface_area};
use crate::radiosity::mesh::{Element, PlacedElement, RadiosityMesh};
use crate::radiosity::options::RowNormalisation;
use crate::radiosity::refinement::LinkedScene;
use crate::radiosity::rgb::mean;
use crate::scene::Scene;
use glam::Vec3;

/// Lower bound of the fraction of the light that is lost at every bounce, without row normalisation: errors add up over at most
/// 1 / 0.05 = 20 bounces. Affects error bars only, which the audit rescales.
const MIN_LOSS: f64 = 0.05;
/// The same with row normalisation: correct row sums create and lose no light, and errors from all around cancel, so
/// that they add up over at most 1 / 0.5 = 2 bounces.
const MIN_LOSS_NORMALISED: f64 = 0.5;

/// Standard uncertainty of the irradiance of every surface element along links, W/m²: variation and sampling noise of each link
/// as independent errors, pushed down the tree like light, times the geometric series of later bounces.
pub fn link_uncertainty(linked: &LinkedScene) -> Vec<f64> {
    let elements = &linked.elements;
    let mut variance = vec![0.0; elements.len()];
    for l in &linked.links {
        let mut put = |at: u32, variation: f32, other: u32| {
            let e = &elements.elements[at as usize];
            let light = elements.states[other as usize].statistics;
            let (mean, deviation) = (f64::from(light.mean), f64::from(light.deviation));
            let error_area = f64::from(variation.hypot(l.noise));
            variance[at as usize] +=
                ((error_area * mean).hypot(f64::from(l.noise) * deviation) / e.area).powi(2);
        };
        put(l.a, l.variation[0], l.b);
        if l.a != l.b {
            put(l.b, l.variation[1], l.a);
        }
    }
    for l in &linked.sky_links {
        variance[l.receiver as usize] += f64::from(l.variation).powi(2) + f64::from(l.noise).powi(2);
    }
    for e in 1..elements.len() {
        variance[e] += variance[elements.elements[e].parent as usize];
    }
    let loss = 1.0 - f64::from(elements.clusters[0].reflectance);
    let carried = match linked.settings.row_sums {
        RowNormalisation::Sampled => 1.0 / loss.max(MIN_LOSS),
        RowNormalisation::Balanced => 1.0 / loss.max(MIN_LOSS_NORMALISED),
    };
    variance.into_iter().map(|v| carried * v.sqrt()).collect()
}

/// Root mean square of the uncertainty over the sides that [count](LinkedScene::lit_sides), relative to their mean irradiance.
pub fn error_estimate(linked: &LinkedScene, uncertainty: &[f64]) -> f64 {
    let elements = &linked.elements;
    let (mut squares, mut sum, mut all) = (0.0, 0.0, 0.0);
    for e in linked.lit_leaves() {
        let area = elements.elements[e as usize].area;
        all += area;
        squares += area * uncertainty[e as usize].powi(2);
        sum += area * mean(elements.states[e as usize].irradiance);
    }
    (squares * all).sqrt() / sum.max(f64::MIN_POSITIVE)
}

impl Solved {
    /// Standard uncertainty of the irradiance of every surface element, W/m²: along links [`link_uncertainty`], after a local pass
    /// the standard error of the element's rays.
    pub fn uncertainty(&self) -> Vec<f64> {
        match &self.closing {
            FinalLight::Rays(local) => local.results.iter().map(|r| f64::from(r.noise)).collect(),
            FinalLight::Links(_) => link_uncertainty(&self.linked),
            FinalLight::Nothing => vec![0.0; self.linked.elements.len()],
        }
    }

    /// The leaves of all surfaces and the dark sides as plain data, with their uncertainties.
    pub fn mesh(&self, scene: &Scene, uncertainty: &[f64]) -> RadiosityMesh {
        let elements = &self.linked.elements;
        let leaf = |(e, element): (usize, &ElementNode)| match &element.shape {
            Shape::Surface { side, corners } if element.is_leaf() => Some((e, *side, *corners)),
            _ => None,
        };
        let leaves: Vec<_> = elements.elements.iter().enumerate().filter_map(leaf).collect();
        // Ids of placed meshes are ids of elements; dark sides have no elements.
        let dark = if elements.instance_count() < 2 { &elements.dark[..] } else { &[] };
        let mut corners: Vec<Vec3> = parallel::flat_map(&leaves, |(.., corners)| *corners);
        corners.extend(dark.iter().flat_map(|(_, corners)| *corners));
        let (number, vertices) = weld(&corners);
        let (number, number_of_dark) = number.split_at(4 * leaves.len());
        let (light, links) = (self.shown_irradiance(), links_at(&self.linked));
        // Part of each channel in all light: where an element has little light of a channel, or 0 because noise made it negative, its error
        // is not smaller.
        let sums = leaves.iter().fold([0.0; 3], |sums: [f64; 3], (e, ..)| {
            let area = elements.elements[*e].area;
            std::array::from_fn(|c| sums[c] + area * light[*e][c])
        });
        let parts = sums.map(|sum| sum / mean(sums).max(f64::MIN_POSITIVE));
        let of_side = |s: &Side, corners: &[u32], area: f64| Element {
            corners: std::array::from_fn(|k| corners[k]),
            radiosity: [0.0; 3],
            irradiance: [0.0; 3],
            error: [0.0; 3],
            albedo: s.reflectance,
            exitance: s.exitance,
            area,
            level: 0,
            links: 0,
            triangle: s.triangles[0],
            object: scene.triangle_object[s.triangles[0] as usize],
            material: scene.triangle_material[s.triangles[0] as usize],
            front: s.front,
            crossed: false,
            narrow: false,
            walls: 0,
        };
        let one = |k: usize| {
            let ((e, side, _), corners) = (leaves[k], &number[4 * k..][..4]);
            let (element, state) = (&elements.elements[e], &elements.states[e]);
            let (side, irradiance) = (&elements.sides[side as usize], light[e]);
            let level = mean(irradiance);
            let part = |c: usize| if level > 0.0 { parts[c].max(irradiance[c] / level) } else { parts[c] };
            let error = std::array::from_fn(|c| uncertainty[e] * part(c));
            Element {
                radiosity: side.radiosity(irradiance),
                irradiance,
                error,
                level: element.level,
                links: links[e],
                crossed: state.crossed,
                narrow: state.narrow,
                ..of_side(side, corners, element.area)
            }
        };
        let instance_of_side = instances_of_sides(elements);
        let placed = |&(e, side, _): &(usize, u32, [Vec3; 4])| {
            let instance = *instance_of_side.get(side as usize)?;
            Some(PlacedElement { instance, id: elements.surface_id(instance, e as u32).expect("a surface") })
        };
        let mut all: Vec<Element> = parallel::map(0..leaves.len(), one);
        let numbers: Vec<u32> = leaves.iter().map(|(e, ..)| *e as u32).collect();
        let walls = self.linked.walls_along(&self.linked.engine.exact(), &numbers);
        all.iter_mut().zip(walls).for_each(|(element, walls)| element.walls = walls);
        all.extend(
            dark.iter()
                .zip(number_of_dark.chunks_exact(4))
                .map(|((side, of), corners)| of_side(side, corners, surface_area(of))),
        );
        let instances = parallel::flat_map(&leaves, placed);
        RadiosityMesh { origin: scene.origin, elements: all, dark: dark.len(), instances, vertices }
    }
}

/// The number of links at each element and its ancestors.
fn links_at(linked: &LinkedScene) -> Vec<u32> {
    let elements = &linked.elements;
    let mut links = vec![0u32; elements.len()];
    for l in &linked.links {
        links[l.a as usize] += 1;
        links[l.b as usize] += u32::from(l.a != l.b);
    }
    linked.sky_links.iter().for_each(|l| links[l.receiver as usize] += 1);
    for e in 1..elements.len() {
        links[e] += links[elements.elements[e].parent as usize];
    }
    links
}

/// The instance of each side; empty if there is only one.
fn instances_of_sides(elements: &Elements) -> Vec<u32> {
    if elements.instance_count() < 2 {
        return Vec::new();
    }
    let mut instances = vec![0; elements.sides.len()];
    for instance in 0..elements.instance_count() {
        for root in elements.of_instance(instance) {
            if let Shape::Surface { side, .. } = elements.elements[root as usize].shape {
                instances[side as usize] = instance;
            }
        }
    }
    instances
}
