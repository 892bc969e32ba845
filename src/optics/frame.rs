//! Orthographic projections of boxes.

use crate::math::Aabb;
use glam::{UVec2, Vec2, Vec3};

/// Cosine and sine of the angle between pixel rows and the coordinate axes: 3/√10, 1/√10. Edges along the axes then
/// have slope 1/3 in pixels, so that they pass pixel centres at three different distances.
const RASTER_TURN: (f32, f32) = (0.948_683_3, 0.316_227_76);

/// Mapping between world and pixel coordinates of an orthographic projection.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    /// Direction of the view, a unit vector.
    pub(super) view: Vec3,
    pub(super) bounds: Aabb,
    /// Width of a pixel, length; zero if the box has no extent.
    pub(super) pixel: f32,
    /// Number of columns and rows.
    pub(super) size: UVec2,
    /// The pixel coordinates of point p are `(p · u, p · v) + offset`.
    pub(super) u: Vec3,
    pub(super) v: Vec3,
    pub(super) offset: Vec2,
}

impl Frame {
    /// The projection of box `bounds` along unit vector `view`, `across` pixels on its longer side.
    pub(super) fn of(bounds: Aabb, view: Vec3, across: usize) -> Frame {
        // Turned against the coordinate axes: thin axis-aligned bars at regular distances would all miss, or all hit,
        // the pixel centres (docs/method.md, Traps: thin bars).
        let (u, v) = view.any_orthonormal_pair();
        let (u, v) = (RASTER_TURN.0 * u + RASTER_TURN.1 * v, RASTER_TURN.0 * v - RASTER_TURN.1 * u);
        let half = 0.5 * bounds.extent();
        let reach = Vec2::new(half.dot(u.abs()), half.dot(v.abs()));
        let pixel = 2.0 * reach.max_element() / across as f32;
        let size = (2.0 * reach / pixel).ceil().as_uvec2().clamp(UVec2::ONE, UVec2::splat(across as u32));
        let (u, v) = (u / pixel, v / pixel);
        let centre = bounds.center();
        let offset = 0.5 * size.as_vec2() - Vec2::new(centre.dot(u), centre.dot(v));
        Frame { view, bounds, pixel, size, u, v, offset }
    }

    /// World position of a point with these pixel coordinates, in the plane through the centre of the box.
    pub(super) fn position(&self, pixel: Vec2) -> Vec3 {
        let away = pixel - 0.5 * self.size.as_vec2();
        self.bounds.center() + self.pixel * self.pixel * (away.x * self.u + away.y * self.v)
    }

    #[inline(always)]
    pub(super) fn project(self, p: Vec3) -> Vec2 {
        Vec2::new(p.dot(self.u), p.dot(self.v)) + self.offset
    }
}
