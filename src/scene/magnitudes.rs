//! Magnitudes of coordinates: the scales of rounding errors.

use super::Scene;
use crate::math::Aabb;
use glam::Vec3;

impl Scene {
    /// See [`face_magnitudes`].
    pub(crate) fn face_magnitudes(&self) -> Vec<f32> {
        face_magnitudes(&self.positions, &self.triangles)
    }

    /// Largest absolute coordinate of the corners of some triangles, scene units.
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn magnitude_of(&self, triangles: &[u32]) -> f32 {
        triangles.iter().map(|&t| magnitude(self.corners(t))).fold(0.0, f32::max)
    }
}

/// Largest absolute coordinate of some points.
pub(crate) fn magnitude(points: impl IntoIterator<Item = Vec3>) -> f32 {
    points.into_iter().fold(Vec3::ZERO, |most, p| most.max(p.abs())).max_element()
}

/// For each triangle, the largest absolute coordinate of its corners and of those of the triangles that share a vertex with it: the
/// scale of rounding errors on it, independent of what lies elsewhere in the scene.
pub(super) fn face_magnitudes(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<f32> {
    let mut of_vertex = vec![0f32; positions.len()];
    for corners in triangles {
        let own = magnitude(corners.map(|v| positions[v as usize]));
        corners.iter().for_each(|&v| of_vertex[v as usize] = of_vertex[v as usize].max(own));
    }
    triangles
        .iter()
        .map(|corners| corners.iter().map(|&v| of_vertex[v as usize]).fold(0.0, f32::max))
        .collect()
}

/// Largest distance of planes that count as one, in units of f32 spacing (2⁻²³) of the coordinates: 16 roundings of half a spacing each, as
/// of two transforms by 3 × 4 matrices (6 each) and of a file between them.
const MAX_ROUNDINGS: f64 = 8.0;

/// Largest distance of the planes of overlapping faces inside a box, scene units.
pub(super) fn largest_distance(bounds: &Aabb) -> f64 {
    MAX_ROUNDINGS * f64::from(f32::EPSILON) * f64::from(bounds.magnitude().max(bounds.diagonal()))
}

/// Distance between stacked faces beyond that of the faces themselves, relative to their largest coordinate: more than what segments
/// leave out at their ends (16 × 4e-7, see the end rule of rays), so that rays of the lower face meet the upper one. Of a shared mesh
/// the coordinates are its own: in a model that is much larger than the mesh, rays may start above both faces.
pub(super) const GAP: f32 = 8e-6;
