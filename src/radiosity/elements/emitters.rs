//! Emitting faces: closed forms use all faces of an emitter, single rays use one face drawn at random.

use super::profiles::profile_factor;
use super::{Elements, Shape};
use crate::form_factors::analytic::point_to_polygon;
use crate::radiosity::rgb::{Rgb, mean};
use crate::radiosity::sampling::{pick, point_on};
use crate::scene::{Profile, Scene};
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// One emitting face.
pub struct EmitterFace {
    /// Counterclockwise seen from its side; a triangle repeats its third corner.
    pub corners: [Vec3; 4],
    /// The same corners in double precision, for closed forms.
    pub polygon: [DVec3; 4],
    /// Number of distinct corners: 3 or 4.
    pub count: usize,
    /// Unit normal.
    pub normal: Vec3,
    /// Exitance, W/m².
    pub exitance: Rgb,
    /// Area, scene units squared.
    pub area: f32,
    /// Directions in which the face emits; none for diffuse emission.
    pub profile: Option<Arc<Profile>>,
}

impl EmitterFace {
    /// Form factor from a point (position, unit normal) to the face: of a diffuse face in closed form, of one with a profile
    /// with its radiance relative to a diffuse face as weight.
    pub fn factor(&self, at: DVec3, normal: DVec3) -> f64 {
        match &self.profile {
            None => point_to_polygon(at, normal, &self.polygon[..self.count]).max(0.0),
            Some(profile) => profile_factor(profile, (at, normal), &self.polygon[..self.count]),
        }
    }
}

/// One emitter of the scene.
pub struct Emitter {
    /// Its lit faces.
    pub faces: Vec<EmitterFace>,
    /// Its smallest width, scene units.
    pub width: f32,
}

/// All emitters of a scene.
pub struct Emitters {
    /// In the order of the scene.
    pub emitters: Vec<Emitter>,
    /// The smallest width of all, scene units.
    pub width: f32,
    /// Every lit face as (emitter, face), with the running sums of the faces' power.
    lit: Vec<(u32, u32)>,
    powers: Vec<f32>,
}

impl Emitters {
    /// The emitters of a scene, with the lit sides of their faces.
    pub fn new(scene: &Scene, elements: &Elements) -> Emitters {
        let mut emitters: Vec<Emitter> =
            scene.emitters.iter().map(|e| Emitter { faces: Vec::new(), width: e.min_width }).collect();
        for side in elements.sides.iter().filter(|s| s.exitance.iter().any(|&m| m > 0.0)) {
            let element = &elements.elements[side.element as usize];
            let Shape::Surface { corners, .. } = element.shape else { continue };
            let emitter = scene.triangle_emitter[side.triangles[0] as usize] as usize;
            emitters[emitter].faces.push(EmitterFace {
                corners,
                polygon: corners.map(|p| p.as_dvec3()),
                count: if corners[2] == corners[3] { 3 } else { 4 },
                normal: side.normal,
                exitance: side.exitance,
                area: element.area as f32,
                profile: side.profile.clone(),
            });
        }
        let (mut lit, mut powers, mut power) = (Vec::new(), Vec::new(), 0.0);
        for (e, emitter) in (0u32..).zip(&emitters) {
            for (k, face) in (0u32..).zip(&emitter.faces) {
                power += face.area * mean(face.exitance) as f32;
                lit.push((e, k));
                powers.push(power);
            }
        }
        let width = emitters.iter().map(|e| e.width).fold(f32::MAX, f32::min);
        Emitters { emitters, width, lit, powers }
    }

    /// A point on an emitter for two numbers in `[0, 1)`. Faces are drawn with a probability proportional to their power.
    pub fn sample(&self, u: f32, v: f32) -> Option<(Vec3, &EmitterFace)> {
        if self.powers.is_empty() {
            return None;
        }
        let (f, u, _) = pick(&self.powers, u);
        let (e, k) = self.lit[f];
        let face = &self.emitters[e as usize].faces[k as usize];
        Some((point_on(&face.corners, u, v), face))
    }

    /// The density with which a cosine-weighted ray from `from` finds the point `to` of an emitter, divided by the density of
    /// [`Emitters::sample`]; both are (position, unit normal). Both strategies find the point. Weighted by their densities
    /// (balance heuristic, Veach and Guibas 1995) each contributes less than the emitter's exitance at any distance.
    pub fn density_ratio(&self, from: (Vec3, Vec3), to: (Vec3, Vec3), exitance: Rgb) -> f32 {
        let d = to.0 - from.0;
        let r2 = d.length_squared().max(f32::MIN_POSITIVE);
        // Two divisions by r²: r⁴ overflows 32 bits for most lengths.
        let kernel = (from.1.dot(d).max(0.0) / r2) * ((-to.1.dot(d)).max(0.0) / r2) / std::f32::consts::PI;
        kernel * self.powers.last().copied().unwrap_or(0.0) / mean(exitance) as f32
    }
}
