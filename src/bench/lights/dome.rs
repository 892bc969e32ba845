//! Luminous domes, divided like a sky into patches of bounded angle.

use super::MAX_HALF_ANGLE;
use crate::math::Aabb;
use crate::scene::{Emitter, Scene};
use glam::Vec3;

/// A part of a dome.
pub struct Part {
    pub emitter: Emitter,
    /// Half angle of the cone around it from the middle of the scene, radians.
    pub half_angle: f64,
}

/// The emitters that are domes, with their parts: emissive surfaces that are not plane, whose faces all look at the middle of the other surfaces, and that
/// are wider from there than a patch may be. A part that is one face may be wider too.
pub fn domes(scene: &Scene) -> Vec<(usize, Vec<Part>)> {
    let count = scene.triangles.len() as u32;
    let others = (0..count).filter(|&t| scene.triangle_emitter[t as usize] == u32::MAX);
    let bounds = Aabb::of(others.flat_map(|t| scene.corners(t)));
    if !bounds.center().is_finite() {
        return Vec::new();
    }
    let middle = bounds.center();
    let looks_inwards = |t: &u32| {
        let [a, b, c] = scene.corners(*t);
        (b - a).cross(c - a).dot(middle - a) > 0.0
    };
    let parts_of = |emitter: &Emitter| {
        let is_plane = emitter.normal.length() > MAX_HALF_ANGLE.cos() as f32;
        if is_plane || !emitter.triangles.iter().all(looks_inwards) {
            return None;
        }
        let faces: Vec<Face> = emitter.triangles.iter().map(|&t| Face::new(scene, t, middle)).collect();
        let groups = divided(faces);
        let part = |faces: Vec<Face>| {
            let triangles = faces.iter().map(|face| face.triangle).collect();
            Part { emitter: emitter.part(scene, triangles), half_angle: half_angle(&faces) }
        };
        (groups.len() > 1).then(|| groups.into_iter().map(part).collect())
    };
    scene.emitters.iter().enumerate().filter_map(|(k, emitter)| Some((k, parts_of(emitter)?))).collect()
}

/// A face with the directions of its corners from the middle of the scene.
struct Face {
    triangle: u32,
    corners: [Vec3; 3],
    centre: Vec3,
}

impl Face {
    fn new(scene: &Scene, triangle: u32, from: Vec3) -> Face {
        let corners = scene.corners(triangle).map(|corner| (corner - from).normalize_or_zero());
        Face { triangle, corners, centre: corners.iter().sum::<Vec3>().normalize_or_zero() }
    }
}

/// Half angle of a cone around the directions of all corners.
fn half_angle(faces: &[Face]) -> f64 {
    let axis = faces.iter().map(|face| face.centre).sum::<Vec3>().normalize_or_zero();
    let cosines = faces.iter().flat_map(|face| &face.corners).map(|corner| axis.dot(*corner));
    f64::from(cosines.fold(1.0f32, f32::min)).clamp(-1.0, 1.0).acos()
}

/// Groups of faces, halved across their largest extent until each is no wider than a patch of the sky may be.
fn divided(faces: Vec<Face>) -> Vec<Vec<Face>> {
    let (mut found, mut open) = (Vec::new(), vec![faces]);
    while let Some(mut faces) = open.pop() {
        if faces.len() == 1 || half_angle(&faces) <= MAX_HALF_ANGLE {
            found.push(faces);
            continue;
        }
        let extent = Aabb::of(faces.iter().map(|face| face.centre)).extent();
        let axis = extent.max_position();
        faces.sort_by(|a, b| a.centre[axis].total_cmp(&b.centre[axis]).then(a.triangle.cmp(&b.triangle)));
        let rest = faces.split_off(faces.len() / 2);
        open.extend([rest, faces]);
    }
    found
}
