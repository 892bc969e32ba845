//! Pieces of a scene: sizes of connected parts, and large surfaces, which are never aggregated.

use crate::scene::Scene;
use glam::Vec3;
use rayon::prelude::*;

/// Smallest cosine between the normals of neighbouring faces of one smooth surface: 26°, below the 60° between the sides of a
/// branch of six and above those of terrain.
const SMOOTH_COSINE: f32 = 0.9;
/// Smallest width (root of the area) of a large surface, relative to the diagonal of the scene: blockers of 1/64 of a scene cast shadows
/// that its images show. The value changes time and error, which the pilot measures, but not correctness.
pub const SURFACE_PART: f32 = 1.0 / 64.0;

/// Properties of each triangle that the tree needs.
pub(super) struct Pieces {
    /// Size of the connected part that the triangle belongs to: root of its area; length.
    pub size: Vec<f32>,
    /// The smooth surface that it belongs to, and the width of that: root of its area; length.
    pub region: Vec<u32>,
    pub width: Vec<f32>,
    /// Whether the triangle is never averaged: its surface is large, or it emits. Facets of a lamp lie before each other at grazing angles,
    /// where an extinction would make the lamp shade itself.
    pub surface: Vec<bool>,
}

impl Pieces {
    pub fn of(scene: &Scene) -> Pieces {
        let areas = areas(scene);
        let smallest = SURFACE_PART * scene.near_bounds().diagonal();
        let region = smooth_surfaces(scene);
        let width = widths(&region, &areas);
        let emits = scene.triangle_emitter.iter().map(|&emitter| emitter != u32::MAX);
        let surface = width.iter().zip(emits).map(|(&width, emits)| emits || width >= smallest).collect();
        Pieces { region, width, surface, size: widths(&scene.triangle_component, &areas) }
    }
}

/// The width of the smooth surface that each triangle belongs to: root of its area; length.
#[cfg(any(test, feature = "reports"))]
pub fn surface_widths(scene: &Scene) -> Vec<f32> {
    widths(&smooth_surfaces(scene), &areas(scene))
}

/// The area of each triangle.
fn areas(scene: &Scene) -> Vec<f64> {
    (0..scene.triangles.len() as u32).into_par_iter().map(|t| scene.face_area(t)).collect()
}

/// Root of the area of the group that each triangle belongs to.
fn widths(groups: &[u32], areas: &[f64]) -> Vec<f32> {
    let mut sums = vec![0.0; groups.iter().max().map_or(0, |&g| g as usize + 1)];
    groups.iter().zip(areas).for_each(|(&group, area)| sums[group as usize] += area);
    groups.iter().map(|&group| sums[group as usize].sqrt() as f32).collect()
}

/// The smooth surface of each triangle: faces that meet at an edge with similar planes.
fn smooth_surfaces(scene: &Scene) -> Vec<u32> {
    let triangles: Vec<u32> = (0..scene.triangles.len() as u32).collect();
    let normals: Vec<Vec3> = triangles.par_iter().map(|&t| scene.face_normal(t)).collect();
    scene.joined_across_edges(&triangles, |[i, j], _| {
        normals[i as usize].dot(normals[j as usize]).abs() > SMOOTH_COSINE
    })
}
