//! Automatic camera.

use super::camera::{Camera, Stage, render};
use super::tone::luminance;
use crate::math::Aabb;
use crate::radiosity::mesh::RadiosityMesh;
use glam::Vec3;
use std::collections::HashSet;

/// Columns and rows of the pictures that views are compared by: limit the time to 3,072 rays per view.
const PREVIEW_PIXELS: [usize; 2] = [64, 48];

/// The best of several views of the scene: from outside in all directions at three heights, and from inside the
/// corners.
///
/// A good view is mostly lit, has little close to the camera, and shows many surfaces. Emitters do not count for the
/// size of the scene: the sun is far away.
pub fn best_view(stage: &Stage, solution: &RadiosityMesh, up: Vec3) -> Camera {
    let bounds = bounds(stage, solution);
    let (x, y) = up.any_orthonormal_pair();
    let (centre, radius) = (bounds.center(), 0.5 * bounds.diagonal());
    let turns = (0..8).map(|k| std::f32::consts::TAU * (k as f32) / 8.0);
    let mut cameras = Vec::new();
    for side in turns.map(|turn| x * turn.cos() + y * turn.sin()) {
        for rise in [0.0f32, 0.35, 0.8] {
            let back = (side * rise.cos() + up * rise.sin()).normalize();
            cameras.push(camera(centre + back * (2.4 * radius), centre, up, 0.8));
        }
        // Inside: near the wall in that direction, at two thirds of the height.
        let reach = 0.46 * bounds.extent();
        let far = (reach / side.abs().max(Vec3::splat(1e-6))).min_element();
        let height = 0.17 * bounds.extent().dot(up.abs());
        let eye = centre + side * far + up * height;
        cameras.push(camera(eye, centre - up * (0.5 * height), up, 1.1));
    }
    // The first view always exists.
    let mut best = (f32::NEG_INFINITY, 0);
    for (i, camera) in cameras.iter().enumerate() {
        let score = judge(stage, solution, camera, radius);
        if score > best.0 {
            best = (score, i);
        }
    }
    cameras.swap_remove(best.1)
}

fn camera(eye: Vec3, at: Vec3, up: Vec3, angle: f32) -> Camera {
    let forward = (at - eye).normalize();
    Camera { name: "view".into(), eye, forward, up, angle }
}

/// The box around what does not emit, or around everything if all emits.
fn bounds(stage: &Stage, solution: &RadiosityMesh) -> Aabb {
    let mesh = stage.mesh;
    let dark = |t: &usize| solution.elements[mesh.element[*t] as usize].exitance == [0.0; 3];
    let corners = (0..mesh.triangles.len()).filter(dark).flat_map(|t| mesh.corners(t));
    let bounds = Aabb::of(corners);
    if bounds.diagonal() > 0.0 { bounds } else { Aabb::of(mesh.positions.iter().copied()) }
}

fn judge(stage: &Stage, solution: &RadiosityMesh, camera: &Camera, radius: f32) -> f32 {
    let frame = render(stage, camera, PREVIEW_PIXELS[0], PREVIEW_PIXELS[1], 1);
    let mut lights: Vec<f32> = frame.radiance.iter().map(|&r| luminance(r)).collect();
    lights.sort_by(f32::total_cmp);
    let dim = 0.02 * lights[lights.len() * 9 / 10];
    let lit = frame.radiance.iter().filter(|&&r| luminance(r) > dim).count() as f32;
    let near = frame.first.iter().flatten().filter(|f| f.distance < 0.08 * radius).count() as f32;
    let surfaces: HashSet<(u32, bool)> = frame
        .first
        .iter()
        .flatten()
        .map(|f| &solution.elements[f.element as usize])
        .map(|e| (e.triangle, e.front))
        .collect();
    let all = frame.radiance.len() as f32;
    lit / all * (1.0 - near / all) * (1.0 + surfaces.len() as f32).ln()
}
