//! Rectangles around and inside triangles of a plane.

use crate::scene::Scene;
use glam::{DVec2, DVec3, Vec3};

/// Number of longest outer edges that are tried: limits the time for finely tessellated outlines to 64 rectangles.
const DIRECTIONS: usize = 64;

/// A rectangle in space; `width` is at least `height`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rectangle {
    pub(super) centre: DVec3,
    /// Unit vectors. `normal × right` points upwards in the image.
    pub(super) right: DVec3,
    pub(super) normal: DVec3,
    pub(super) width: f64,
    pub(super) height: f64,
    /// Largest height of the surface above the rectangle towards `normal`, and towards the other side, scene units.
    pub(super) rise: [f64; 2],
}

impl Rectangle {
    /// The rectangle seen from the other side.
    pub(super) fn turned(self) -> Rectangle {
        let [front, back] = self.rise;
        Rectangle { normal: -self.normal, right: -self.right, rise: [back, front], ..self }.upright()
    }

    /// The centre, raised so that the surface is nowhere above the rectangle.
    pub(super) fn lifted(self) -> DVec3 {
        self.centre + self.rise[0] * self.normal
    }

    /// Turns the rectangle by 180° in its plane if that points the image upwards.
    pub(super) fn upright(self) -> Rectangle {
        let up = self.normal.cross(self.right);
        let largest =
            [up.x, up.y, up.z].into_iter().fold(0.0f64, |m, v| if v.abs() > m.abs() { v } else { m });
        if largest < 0.0 { Rectangle { right: -self.right, ..self } } else { self }
    }
}

/// The smallest rectangle around the triangles in their plane with a side along one of their outer edges. (The
/// smallest of all rectangles has a side along the convex hull.) `None` if it has no area.
pub(super) fn fit(scene: &Scene, triangles: &[u32], normal: DVec3) -> Option<Rectangle> {
    let (u, v) = normal.any_orthonormal_pair();
    let flat = |p: Vec3| DVec2::new(p.as_dvec3().dot(u), p.as_dvec3().dot(v));
    let mut outer: Vec<DVec2> = scene
        .edges_of(triangles)
        .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
        .filter(|run| run.len() == 1)
        .map(|run| flat(scene.positions[run[0].1 as usize]) - flat(scene.positions[run[0].0 as usize]))
        .collect();
    outer.sort_by(|a, b| b.length_squared().total_cmp(&a.length_squared()));
    outer.truncate(DIRECTIONS);
    let points: Vec<DVec2> = triangles.iter().flat_map(|&t| scene.corners(t)).map(flat).collect();
    let mut best: Option<(f64, DVec2, DVec2, DVec2)> = None;
    for along in outer.into_iter().filter_map(DVec2::try_normalize) {
        let across = along.perp();
        let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
        for p in &points {
            let q = DVec2::new(p.dot(along), p.dot(across));
            (low, high) = (low.min(q), high.max(q));
        }
        let span = high - low;
        let area = span.x * span.y;
        // A later rectangle must be smaller by more than rounding, so that rounding does not decide.
        if area > 0.0 && best.is_none_or(|b| area < b.0 * (1.0 - 1e-6)) {
            best = Some((area, along, span, 0.5 * (low + high)));
        }
    }
    let (_, along, span, middle) = best?;
    let across = along.perp();
    let height = scene.corners(triangles[0])[0].as_dvec3().dot(normal);
    let space = |p: DVec2| p.x * u + p.y * v;
    let centre = space(middle.x * along + middle.y * across) + height * normal;
    let (right, width, height) =
        if span.x >= span.y { (space(along), span.x, span.y) } else { (space(across), span.y, span.x) };
    let off = triangles.iter().flat_map(|&t| scene.corners(t)).map(|p| (p.as_dvec3() - centre).dot(normal));
    let rise = off.fold([0.0f64; 2], |[front, back], d| [front.max(d), back.max(-d)]);
    Some(Rectangle { centre, right, normal, width, height, rise }.upright())
}
