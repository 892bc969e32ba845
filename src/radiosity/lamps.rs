//! Emitters as places see them: all faces for closed forms, a face by chance for one ray.

use super::field::Rgb;
use super::mean;
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::links::point_on;
use crate::scene::Scene;
use glam::{DVec3, Vec3};

/// A surface of an emitter.
pub struct Face {
    /// Counterclockwise seen from its side; a triangle repeats its third corner.
    pub corners: [Vec3; 4],
    /// The same for closed forms.
    pub polygon: [DVec3; 4],
    /// Corners that count: 3 or 4.
    pub count: usize,
    /// Unit normal.
    pub normal: Vec3,
    /// W/m².
    pub exitance: Rgb,
    /// Scene units squared.
    pub area: f32,
}

/// All that emits.
pub struct Lamps {
    /// By emitter, its lit faces and its least width.
    pub emitters: Vec<(Vec<Face>, f32)>,
    /// The least width of all.
    pub width: f32,
    /// Every lit face, as emitter and face, and the running sums of their power.
    lit: Vec<(u32, u32)>,
    powers: Vec<f32>,
}

impl Lamps {
    /// Of a scene.
    pub fn new(scene: &Scene, elements: &Elements) -> Lamps {
        let mut emitters: Vec<(Vec<Face>, f32)> =
            scene.emitters.iter().map(|e| (Vec::new(), e.min_width)).collect();
        for side in elements.sides.iter().filter(|s| s.exitance.iter().any(|&m| m > 0.0)) {
            let element = &elements.elements[side.element as usize];
            let Shape::Surface { corners, .. } = element.shape else { continue };
            let emitter = scene.triangle_emitter[side.triangles[0] as usize] as usize;
            emitters[emitter].0.push(Face {
                corners,
                polygon: corners.map(|p| p.as_dvec3()),
                count: if corners[2] == corners[3] { 3 } else { 4 },
                normal: side.normal,
                exitance: side.exitance,
                area: element.area as f32,
            });
        }
        let (mut lit, mut powers, mut power) = (Vec::new(), Vec::new(), 0.0);
        for (e, (faces, _)) in (0u32..).zip(&emitters) {
            for (k, face) in (0u32..).zip(faces) {
                power += face.area * mean(face.exitance) as f32;
                lit.push((e, k));
                powers.push(power);
            }
        }
        let width = emitters.iter().map(|(_, w)| *w).fold(f32::MAX, f32::min);
        Lamps { emitters, width, lit, powers }
    }

    /// A point on an emitter by two numbers in `[0, 1)`; faces are chosen by their power.
    pub fn pick(&self, u: f32, v: f32) -> Option<(Vec3, &Face)> {
        let target = u * *self.powers.last()?;
        let f = self.powers.partition_point(|&p| p <= target).min(self.powers.len() - 1);
        let before = if f > 0 { self.powers[f - 1] } else { 0.0 };
        let (e, k) = self.lit[f];
        let face = &self.emitters[e as usize].0[k as usize];
        let u = ((target - before) / (self.powers[f] - before)).clamp(0.0, 1.0);
        Some((point_on(&face.corners, u, v), face))
    }

    /// Density with which a cosine-weighted ray from a place finds a point of an emitter, over the density of
    /// [`Lamps::pick`]. Both find it; weighted by their densities (the balance heuristic of Veach and Guibas 1995) each
    /// contributes less than the emitter's exitance, however near it is.
    pub fn ratio(&self, from: (Vec3, Vec3), to: (Vec3, Vec3), exitance: Rgb) -> f32 {
        let d = to.0 - from.0;
        let r2 = d.length_squared().max(f32::MIN_POSITIVE);
        // Not over r⁴, which few lengths have in these numbers.
        let kernel = (from.1.dot(d).max(0.0) / r2) * ((-to.1.dot(d)).max(0.0) / r2) / std::f32::consts::PI;
        kernel * self.powers.last().copied().unwrap_or(0.0) / mean(exitance) as f32
    }
}
