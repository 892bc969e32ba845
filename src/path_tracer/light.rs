//! Sampling of points on emitters, proportional to power. The oracle has a sampler of its own, so that an error in that of the solver
//! ([`crate::radiosity`]) or of the bench does not hide in both.

use super::surfaces::skin;
use crate::math::{triangle_area, triangle_normal};
use crate::scene::{Profile, Scene};
use glam::Vec3;
use std::sync::Arc;

/// The emissive faces with their probabilities.
pub struct PowerSampler {
    faces: Vec<Face>,
    /// Cumulative probabilities of the faces; the last is 1.
    chances: Vec<f64>,
    two_sided: bool,
}

struct Face {
    corners: [Vec3; 3],
    normal: Vec3,
    radiance: [f32; 3],
    /// Directions in which the front emits; none for a diffuse face.
    profile: Option<Arc<Profile>>,
    /// Probability density per area of a point on this face, 1/length².
    density: f32,
    /// Distance of ends of shadow rays from the face, scene units.
    skin: f32,
}

/// A sampled point on an emitter, seen from a receiver point.
pub struct EmitterSample {
    /// The end of the shadow ray, slightly above the face on the side that is seen; scene units.
    pub end: Vec3,
    /// Its distance from the face, scene units.
    pub skin: f32,
    /// Unit direction from the receiver to the point.
    pub direction: Vec3,
    /// Emitted radiance, W/(m² sr), RGB.
    pub radiance: [f32; 3],
    /// Probability density of the direction per solid angle, 1/sr.
    pub density: f32,
}

impl PowerSampler {
    /// The emitters of a scene; `None` if nothing emits.
    pub fn new(scene: &Scene) -> Option<PowerSampler> {
        let mut chances = Vec::new();
        let mut faces = Vec::new();
        let mut total = 0.0;
        for &t in scene.emitters.iter().flat_map(|e| &e.triangles) {
            let [a, b, c] = scene.corners(t);
            let material = &scene.materials[scene.triangle_material[t as usize] as usize];
            let radiance = material.emission;
            let strength = f64::from(radiance.iter().sum::<f32>());
            total += triangle_area(a, b, c) * strength;
            chances.push(total);
            faces.push(Face {
                corners: [a, b, c],
                normal: triangle_normal(a, b, c),
                radiance,
                profile: material.profile.clone(),
                density: strength as f32,
                skin: skin([a, b, c]),
            });
        }
        faces.iter_mut().for_each(|f| f.density = (f64::from(f.density) / total) as f32);
        chances.iter_mut().for_each(|c| *c /= total);
        (!faces.is_empty()).then_some(PowerSampler { faces, chances, two_sided: scene.two_sided_emission })
    }

    /// Maps three numbers in `[0, 1)` to a point on the emitters, seen from `from`; `None` if the side that faces
    /// `from` does not emit.
    pub fn sample(&self, from: Vec3, [pick, s, t]: [f32; 3]) -> Option<EmitterSample> {
        let chosen = self.chances.partition_point(|&c| c <= f64::from(pick)).min(self.faces.len() - 1);
        let face = &self.faces[chosen];
        // Uniform on the triangle (Turk 1990).
        let (root, [a, b, c]) = (s.sqrt(), face.corners);
        let point = a * (1.0 - root) + b * (root * (1.0 - t)) + c * (root * t);
        let to = point - from;
        let squared = to.length_squared();
        if squared == 0.0 {
            return None;
        }
        let direction = to / squared.sqrt();
        let profile = face.profile.as_deref();
        let cosine = self.facing(-face.normal.dot(direction), profile.is_some())?;
        let gain = profile.map_or(1.0, |p| p.gain(-direction, cosine));
        Some(EmitterSample {
            end: point - face.skin.copysign(face.normal.dot(direction)) * face.normal,
            skin: face.skin,
            direction,
            radiance: face.radiance.map(|l| l * gain),
            density: face.density * squared / cosine,
        })
    }

    /// Probability density per solid angle (1/sr) of [`PowerSampler::sample`] for a point of a face that emits
    /// `radiance`, at `distance` (scene units) and with cosine `cosine` at the emitter.
    pub fn density(&self, radiance: [f32; 3], distance: f32, cosine: f32) -> f32 {
        // Faces are chosen by power, so the density per area is proportional to the radiance.
        let face = &self.faces[0];
        let per_radiance = face.density / face.radiance.iter().sum::<f32>();
        radiance.iter().sum::<f32>() * per_radiance * distance * distance / cosine
    }

    /// The cosine at a side that emits; `None` if the side does not emit. Faces with a profile emit from the front only.
    pub fn facing(&self, cosine: f32, profiled: bool) -> Option<f32> {
        let cosine = if self.two_sided && !profiled { cosine.abs() } else { cosine };
        (cosine > 0.0).then_some(cosine)
    }
}
