//! The scene as paths see it: hits to places, normals and colours.

use crate::embree::{CommittedScene, Hits, Traversal};
use crate::math::triangle_normal;
use crate::model::Model;
use crate::ray::{EndRule, Packet};
use crate::scene::Scene;
use glam::{DVec3, Vec3};

/// How packets of paths are traced: they scatter, so that single rays are fastest.
const TRAVERSAL: Traversal = Traversal { width: 1, coherent: false };

/// Traced geometry and what it looks like.
pub struct Surfaces<'a> {
    scene: &'a Scene,
    traced: CommittedScene,
    normals: Vec<Vec3>,
    /// Distance off a surface at which paths start anew: a few roundings of the largest coordinate.
    pub skin: f32,
    /// Distance off a given point at which paths start.
    pub slack: f32,
    /// Open ends of segments to emitters.
    pub ends: EndRule,
}

/// A place that a path has come to.
pub struct Place {
    /// Off the surface, on the side that was hit.
    pub position: Vec3,
    /// Unit normal of the side that was hit.
    pub normal: Vec3,
    /// Reflectance.
    pub reflectance: [f32; 3],
    /// Radiance of the front side.
    pub emission: [f32; 3],
    /// Cosine between the face's own normal and the way back, positive on the front.
    pub cosine: f32,
}

impl<'a> Surfaces<'a> {
    pub fn new(model: &'a Model) -> Surfaces<'a> {
        let (scene, magnitude) = (model.scene(), model.magnitude());
        let corners = (0..scene.triangles.len() as u32).map(|t| scene.corners(t));
        Surfaces {
            traced: model.traced().clone(),
            normals: corners.map(|[a, b, c]| triangle_normal(a, b, c)).collect(),
            skin: 2e-6 * magnitude,
            slack: 1e-5 * scene.bounds.diagonal() + 1e-6 * magnitude,
            ends: model.end_rule(),
            scene,
        }
    }

    /// A place of the file in the scene's own coordinates.
    pub fn local(&self, position: DVec3) -> Vec3 {
        (position - self.scene.origin).as_vec3()
    }

    /// Lanes whose segments are blocked.
    pub fn blocked(&self, packets: &[Packet], blocked: &mut [u32]) {
        self.traced.occluded_by(TRAVERSAL, u32::MAX, packets, blocked);
    }

    /// First hits.
    pub fn intersect(&self, packets: &[Packet], hits: &mut [Hits]) {
        self.traced.first_hits(TRAVERSAL, packets, hits);
    }

    /// Where the ray of a lane along the unit vector `direction` has arrived; nothing if it left the scene.
    pub fn place(&self, ray: &Packet, hits: &Hits, lane: usize, direction: Vec3) -> Option<Place> {
        let t = hits.triangle[lane];
        if t == Hits::NOTHING {
            return None;
        }
        let front = self.normals[t as usize];
        let cosine = -front.dot(direction);
        let normal = if cosine < 0.0 { -front } else { front };
        Some(Place {
            position: ray.point(lane, hits.t[lane]) + self.skin * normal,
            normal,
            reflectance: self.scene.triangle_reflectance[t as usize],
            emission: self.scene.materials[self.scene.triangle_material[t as usize] as usize].emission,
            cosine,
        })
    }
}
