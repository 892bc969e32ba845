//! Points on emitters, chosen by power.

use crate::math::{triangle_area, triangle_normal};
use crate::scene::Scene;
use glam::Vec3;

/// The emissive faces and how often each is chosen.
pub struct Lights {
    faces: Vec<Face>,
    /// Sums of the chances of faces up to and with each, the last is 1.
    chances: Vec<f64>,
    two_sided: bool,
}

struct Face {
    corners: [Vec3; 3],
    normal: Vec3,
    radiance: [f32; 3],
    /// Density by area of a point on this face.
    density: f32,
}

/// A point on an emitter as a receiver sees it.
pub struct Sight {
    /// The point.
    pub point: Vec3,
    /// Unit direction to it.
    pub direction: Vec3,
    /// Emitted radiance.
    pub radiance: [f32; 3],
    /// Density of the direction by solid angle.
    pub density: f32,
}

impl Lights {
    /// Nothing if the scene emits nothing.
    pub fn new(scene: &Scene) -> Option<Lights> {
        let mut chances = Vec::new();
        let mut faces = Vec::new();
        let mut total = 0.0;
        for &t in scene.emitters.iter().flat_map(|e| &e.triangles) {
            let [a, b, c] = scene.corners(t);
            let radiance = scene.materials[scene.triangle_material[t as usize] as usize].emission;
            let strength = f64::from(radiance.iter().sum::<f32>());
            total += triangle_area(a, b, c) * strength;
            chances.push(total);
            faces.push(Face {
                corners: [a, b, c],
                normal: triangle_normal(a, b, c),
                radiance,
                density: strength as f32,
            });
        }
        faces.iter_mut().for_each(|f| f.density = (f64::from(f.density) / total) as f32);
        chances.iter_mut().for_each(|c| *c /= total);
        (!faces.is_empty()).then_some(Lights { faces, chances, two_sided: scene.two_sided_emission })
    }

    /// The point of the emitters for three numbers in `[0, 1)`, seen from `from`; nothing if that is its dark side.
    pub fn sample(&self, from: Vec3, [pick, s, t]: [f32; 3]) -> Option<Sight> {
        let chosen = self.chances.partition_point(|&c| c <= f64::from(pick)).min(self.faces.len() - 1);
        let face = &self.faces[chosen];
        // Uniform over the triangle (Turk 1990).
        let (root, [a, b, c]) = (s.sqrt(), face.corners);
        let point = a * (1.0 - root) + b * (root * (1.0 - t)) + c * (root * t);
        let to = point - from;
        let squared = to.length_squared();
        if squared == 0.0 {
            return None;
        }
        let direction = to / squared.sqrt();
        let cosine = self.facing(-face.normal.dot(direction))?;
        Some(Sight { point, direction, radiance: face.radiance, density: face.density * squared / cosine })
    }

    /// Density by solid angle with which [`Lights::sample`] finds a point of a face that emits `radiance`, seen at
    /// `distance` under the cosine `cosine`.
    pub fn density(&self, radiance: [f32; 3], distance: f32, cosine: f32) -> f32 {
        // Faces are chosen by power, so that the density by area depends on the radiance alone.
        let face = &self.faces[0];
        let per_radiance = face.density / face.radiance.iter().sum::<f32>();
        radiance.iter().sum::<f32>() * per_radiance * distance * distance / cosine
    }

    /// The cosine at an emitting side, nothing on a dark side.
    pub fn facing(&self, cosine: f32) -> Option<f32> {
        let cosine = if self.two_sided { cosine.abs() } else { cosine };
        (cosine > 0.0).then_some(cosine)
    }
}
