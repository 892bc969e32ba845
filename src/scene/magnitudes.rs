//! Magnitudes of coordinates: the scales of rounding errors.

use super::Scene;
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
