//! The size of a scene, to which other lengths are relative.

use super::Scene;
use crate::math::Aabb;
use glam::{DVec3, Vec3};

/// Ratio of the whole scene to what does not emit, above which emitters do not count: rooms with their lamps and terrains
/// under their skies are below 3, distant lights of glTF files above 20.
const FAR_EMITTER_RATIO: f32 = 8.0;

impl Scene {
    /// Box around the own triangles, without emitters that are much farther away than the rest is wide, as the sun is.
    pub(crate) fn near_bounds(&self) -> Aabb {
        let dark =
            (0..self.triangles.len() as u32).filter(|&t| self.triangle_emitter[t as usize] == u32::MAX);
        let dark = Aabb::of(dark.flat_map(|t| self.corners(t)));
        if dark.diagonal() > 0.0 && self.bounds.diagonal() > FAR_EMITTER_RATIO * dark.diagonal() {
            dark
        } else {
            self.bounds
        }
    }

    /// Diagonal of the box around these and the visible placements.
    #[doc(hidden)]
    pub fn size(&self) -> f32 {
        self.placed_bounds(self.near_bounds()).diagonal()
    }
}

/// Smallest and largest coordinates of points; infinite without any.
pub(super) fn ends(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}

pub(super) fn twice_area([a, b, c]: [Vec3; 3]) -> f64 {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    (b - a).cross(c - a).length()
}

/// Areas of triangles, scene units squared.
pub(super) fn areas(triangles: &[[u32; 3]], positions: &[Vec3]) -> Vec<f64> {
    triangles.iter().map(|t| twice_area(t.map(|v| positions[v as usize])) / 2.0).collect()
}
