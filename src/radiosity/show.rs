//! The solution as plain data, with error bars.

use super::{Rows, Solver, mean};
use crate::radiosity::elements::Shape;
use crate::radiosity::solution::{Element, Solution};
use crate::scene::Scene;
use std::collections::HashMap;

impl Solver {
    /// Standard uncertainty of the irradiance of every surface element, W/m²: what each link may vary over the element
    /// and what sampling leaves, added up as independent errors, pushed down like light; later bounces add as much again
    ///
    /// After a local pass it is the standard error of the element's rays.
    pub(super) fn uncertainty(&self) -> Vec<f64> {
        if let Some(local) = &self.local {
            return local.noise.iter().map(|&n| f64::from(n)).collect();
        }
        let mut variance = vec![0.0; self.elements.len()];
        for l in &self.links {
            let mut put = |at: u32, variation: f32, other: u32| {
                let e = &self.elements.elements[at as usize];
                let brightness = f64::from(self.light[other as usize].mean);
                let spread = f64::from(self.light[other as usize].deviation);
                let coupling = f64::from(variation.hypot(l.noise));
                variance[at as usize] +=
                    ((coupling * brightness).hypot(f64::from(l.noise) * spread) / e.area).powi(2);
            };
            put(l.a, l.variation[0], l.b);
            if l.a != l.b {
                put(l.b, l.variation[1], l.a);
            }
        }
        for e in 1..self.elements.len() {
            variance[e] += variance[self.elements.elements[e].parent as usize];
        }
        // What is reflected is wrong, too. Where rows have their right sums nothing is lost or made on the way, and errors
        // from all around make up for each other after a bounce or two; else they add up with every one.
        let reflectance = f64::from(self.elements.clusters[0].reflectance);
        let carried = match self.rows {
            Rows::Sampled => 1.0 / (1.0 - reflectance).max(0.05),
            Rows::Closed | Rows::Balanced => 1.0 / (1.0 - reflectance).max(0.5),
        };
        variance.into_iter().map(|v| carried * v.sqrt()).collect()
    }

    /// Root mean square of the uncertainty over the surfaces relative to their mean irradiance.
    pub(super) fn error_estimate(&self, uncertainty: &[f64]) -> f64 {
        let (mut squares, mut sum) = (0.0, 0.0);
        for (e, element) in self.elements.elements.iter().enumerate() {
            if element.is_leaf() && !element.is_cluster() {
                squares += element.area * uncertainty[e].powi(2);
                sum += element.area * mean(self.incident[e]);
            }
        }
        if sum > 0.0 { (squares * self.elements.area).sqrt() / sum } else { 0.0 }
    }

    /// All leaves of the surfaces.
    pub(super) fn solution(&self, scene: &Scene, uncertainty: &[f64]) -> Solution {
        let mut places: HashMap<[u32; 3], u32> = HashMap::new();
        let mut solution = Solution { origin: scene.origin, unit: scene.unit.clone(), ..Solution::default() };
        let mut links = vec![0u32; self.elements.len()];
        for l in &self.links {
            links[l.a as usize] += 1;
            links[l.b as usize] += u32::from(l.a != l.b);
        }
        for (e, element) in self.elements.elements.iter().enumerate() {
            links[e] += if e > 0 { links[element.parent as usize] } else { 0 };
            let Shape::Surface { side, corners } = &element.shape else { continue };
            if !element.is_leaf() {
                continue;
            }
            let s = &self.elements.sides[*side as usize];
            let corners = corners.map(|p| {
                let next = solution.vertices.len() as u32;
                // Zero has two signs and one place.
                let key = (p + glam::Vec3::ZERO).to_array().map(f32::to_bits);
                *places.entry(key).or_insert_with(|| {
                    solution.vertices.push(p);
                    next
                })
            });
            let level = mean(self.incident[e]);
            let error = self.incident[e]
                .map(|v| if level > 0.0 { uncertainty[e] * v / level } else { uncertainty[e] });
            let t = s.triangles[0] as usize;
            solution.elements.push(Element {
                corners,
                radiosity: self.radiosity[e],
                irradiance: self.incident[e],
                error,
                albedo: s.reflectance,
                exitance: s.exitance,
                area: element.area,
                level: element.level,
                links: links[e],
                triangle: s.triangles[0],
                object: scene.triangle_object[t],
                material: scene.triangle_material[t],
                front: s.front,
            });
        }
        solution
    }
}
