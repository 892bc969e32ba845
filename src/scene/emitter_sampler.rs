//! Points on an emitter, its size as seen from a point, and points whose hull holds it.

use super::{Emitter, Profile, Scene};
use crate::math::Aabb;
use crate::math::sampling::{Site, on_triangle, pick};
use glam::Vec3;
use std::{borrow::Cow, sync::Arc};

/// Draws points on an emitter.
#[derive(Clone, Debug)]
pub struct EmitterSampler {
    triangles: Vec<u32>,
    /// Normals of the faces.
    normals: Vec<Vec3>,
    /// A corner of each face.
    corners: Vec<Vec3>,
    /// [`Scene::face_magnitudes`] of each face.
    magnitudes: Vec<f32>,
    hull: Vec<Vec3>,
    /// Running sums of the areas.
    sums: Vec<f32>,
    centre: Vec3,
    normal: Vec3,
    planar: bool,
    area: f32,
    width: f32,
    radiance: f32,
    /// Directions in which it emits; none for diffuse emission.
    profile: Option<Arc<Profile>>,
}

impl EmitterSampler {
    /// The sampler of one of the scene's emitters; `magnitudes` are [`Scene::face_magnitudes`].
    pub fn new(scene: &Scene, emitter: &Emitter, magnitudes: &[f32]) -> EmitterSampler {
        let (mut sum, mut centre) = (0.0f64, glam::DVec3::ZERO);
        let (mut normals, mut sums, mut corners) = (Vec::new(), Vec::new(), Vec::new());
        for &t in &emitter.triangles {
            let [a, b, c] = scene.corners(t);
            let area = crate::math::triangle_area(a, b, c);
            centre += area * ((a + b + c) / 3.0).as_dvec3();
            sum += area;
            normals.push(crate::math::triangle_normal(a, b, c));
            corners.push(a);
            sums.push(sum as f32);
        }
        EmitterSampler {
            hull: hull(emitter.triangles.iter().flat_map(|&t| scene.corners(t))),
            triangles: emitter.triangles.clone(),
            normals,
            corners,
            magnitudes: emitter.triangles.iter().map(|&t| magnitudes[t as usize]).collect(),
            sums,
            centre: (centre / sum).as_vec3(),
            normal: emitter.normal.normalize_or_zero(),
            planar: emitter.normal.length() > 0.999,
            area: emitter.area as f32,
            width: emitter.min_width,
            radiance: emitter.emission.iter().sum::<f32>() / 3.0,
            profile: scene.materials[scene.triangle_material[emitter.triangles[0] as usize] as usize]
                .profile
                .clone(),
        }
    }

    /// All corners or, of a many-cornered emitter, those of the box around them: their hull holds it. Relative to the scene's
    /// origin, scene units.
    pub fn hull(&self) -> &[Vec3] {
        &self.hull
    }

    /// Whether the front of any face faces a point.
    pub fn faces(&self, position: Vec3) -> bool {
        self.normals.iter().zip(&self.corners).any(|(n, &corner)| n.dot(position - corner) > 0.0)
    }

    /// Cosine at a planar emitter of the direction to a point, not below 0; 1 for others.
    fn cosine(&self, to: Vec3, distance: f32) -> f32 {
        if self.planar { (-self.normal.dot(to) / distance).max(0.0) } else { 1.0 }
    }

    /// Smallest width of the emitter across the direction to a point that its front or, if it emits there, its back looks at;
    /// scene units.
    pub fn size_from(&self, position: Vec3) -> f32 {
        let to = self.centre - position;
        let distance = to.length();
        self.width * self.cosine(to, distance).max(self.cosine(-to, distance))
    }

    /// Size of the emitter from a point and weight of its unoccluded irradiance; none if no face of it can send light there.
    pub fn size_and_weight(&self, position: Vec3, normal: Vec3) -> Option<(f32, f32)> {
        // The centre decides: a point whose horizon cuts the emitter still counts if more than half is above.
        let to = self.centre - position;
        let distance = to.length();
        let cosine = normal.dot(to) / distance;
        if !self.faces(position) || cosine.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            return None;
        }
        let facing = self.cosine(to, distance);
        let emitted = self.profile.as_ref().map_or(facing, |p| p.projected(-to / distance));
        let weight = self.radiance * self.area * cosine * emitted / (distance * distance);
        Some((self.width * facing, weight))
    }

    /// Distance of its centre from a point, scene units.
    pub fn distance(&self, position: Vec3) -> f32 {
        self.centre.distance(position)
    }

    /// The faces that face a point, with their areas summed up; all faces if it is planar.
    pub fn facing<'a>(&'a self, scene: &Scene, position: Vec3) -> Facing<'a> {
        if self.planar {
            return self.all();
        }
        let mut sum = 0.0;
        let sums = self
            .triangles
            .iter()
            .enumerate()
            .map(|(i, &t)| {
                if self.normals[i].dot(position - scene.corners(t)[0]) > 0.0 {
                    sum += self.sums[i] - if i > 0 { self.sums[i - 1] } else { 0.0 };
                }
                sum
            })
            .collect();
        Facing { sampler: self, sums: Cow::Owned(sums) }
    }

    pub fn all(&self) -> Facing<'_> {
        Facing { sampler: self, sums: Cow::Borrowed(&self.sums) }
    }
}

/// Some faces of an emitter.
pub struct Facing<'a> {
    sampler: &'a EmitterSampler,
    sums: Cow<'a, [f32]>,
}

impl Facing<'_> {
    /// Area-uniform point from two numbers in `[0, 1)`: the first number picks the face and is used again inside it.
    pub fn sample(&self, scene: &Scene, u: f32, v: f32) -> Site {
        let (i, u, _) = pick(&self.sums, u);
        let EmitterSampler { triangles, normals, magnitudes, .. } = self.sampler;
        let position = on_triangle(scene.corners(triangles[i]), u, v);
        Site { position, normal: normals[i], magnitude: magnitudes[i] }
    }
}

/// The corners of a convex polygon in turn; as they are if there is no such order.
fn in_turn(points: [Vec3; 4]) -> [Vec3; 4] {
    let [a, b, c, d] = points;
    let orders = [points, [a, b, d, c], [a, c, b, d]];
    let convex = |p: &[Vec3; 4]| {
        let edge = |k: usize| p[(k + 1) % 4] - p[k % 4];
        let turn = |k: usize| edge(k).cross(edge(k + 1));
        (1..4).all(|k| turn(0).dot(turn(k)) > 0.0)
    };
    orders.into_iter().find(convex).unwrap_or(points)
}

/// Largest number of points of a hull that is kept as it is: as many as the box has corners that replaces larger ones.
const MAX_HULL_POINTS: usize = 8;

/// The points, each once, if there are few, or the corners of the box around them.
fn hull(points: impl Iterator<Item = Vec3> + Clone) -> Vec<Vec3> {
    let mut distinct: Vec<Vec3> = Vec::new();
    for p in points.clone() {
        if distinct.len() <= MAX_HULL_POINTS && !distinct.contains(&p) {
            distinct.push(p);
        }
    }
    if let [a, b, c, d] = distinct[..] {
        return in_turn([a, b, c, d]).to_vec();
    }
    if distinct.len() <= MAX_HULL_POINTS {
        return distinct;
    }
    Aabb::of(points).corners().to_vec()
}
