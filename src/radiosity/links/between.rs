//! What stands between two surfaces, told without a ray: nothing, one surface that hides all, or something.
//!
//! The hull of two polygons is a shaft [Haines and Wallace 1994]: their own planes, their common box, and the planes
//! through an edge of one and a corner of the other that leave both on one side. What lies outside of it blocks no segment
//! between them; if nothing lies inside they see each other wholly, and so do all their parts. A convex polygon that the
//! segments between all pairs of corners cross inside is crossed by all segments: where one meets it is a weighted mean
//! of where those do.

use super::Between;
use crate::math::Aabb;
use crate::radiosity::elements::{Elements, Shape};
use crate::ray::EndRule;
use glam::Vec3;

/// Clusters and surfaces looked at for one pair; beyond, something is taken to be in between.
const LOOKS: usize = 96;
/// A crossing that hides must keep this part of the polygon's size from its edges, and twice the margin of rays from both
/// ends.
const INSIDE: f32 = 1e-4;

/// The hull of two surfaces that face each other.
struct Shaft {
    bounds: Aabb,
    /// Inside is `normal · x < offset`.
    planes: [(Vec3, f32); MOST],
    count: usize,
    corners: [[Vec3; 4]; 2],
    slack: f32,
}

/// Two own planes, and one through every edge.
const MOST: usize = 10;

impl Shaft {
    fn new(corners: [&[Vec3; 4]; 2], normals: [Vec3; 2], slack: f32) -> Shaft {
        let mut shaft = Shaft {
            bounds: Aabb::of(corners.into_iter().flatten().copied()),
            planes: [(Vec3::ZERO, 0.0); MOST],
            count: 0,
            corners: corners.map(|c| *c),
            slack,
        };
        for (corners, normal) in corners.into_iter().zip(normals) {
            // What is behind a surface or in its plane hides nothing in front of it; one that is bent a little may hide
            // itself.
            let height = corners.iter().map(|c| normal.dot(*c)).fold(f32::MAX, f32::min);
            shaft.add(-normal, -height);
        }
        for (own, other) in [(corners[0], corners[1]), (corners[1], corners[0])] {
            for k in 0..4 {
                let (start, edge) = (own[k], own[(k + 1) & 3] - own[k]);
                if edge != Vec3::ZERO {
                    shaft.add_side(start, edge, own, other);
                }
            }
        }
        shaft
    }

    /// Plane and offset, moved inwards by the slack.
    fn add(&mut self, normal: Vec3, offset: f32) {
        self.planes[self.count] = (normal, offset - self.slack);
        self.count += 1;
    }

    /// The plane through an edge of one end and a corner of the other with both on one side, if there is one.
    fn add_side(&mut self, start: Vec3, edge: Vec3, own: &[Vec3; 4], other: &[Vec3; 4]) {
        for corner in other {
            let normal = edge.cross(*corner - start).normalize_or_zero();
            if normal == Vec3::ZERO {
                continue;
            }
            let (mut least, mut most) = (0.0f32, 0.0f32);
            for p in own.iter().chain(other) {
                let height = normal.dot(*p - start);
                (least, most) = (least.min(height), most.max(height));
            }
            let outward = if most <= self.slack { 1.0 } else { -1.0 };
            if most.min(-least) <= self.slack && most.max(-least) > self.slack {
                self.add(outward * normal, outward * normal.dot(start));
                return;
            }
        }
    }

    fn meets_box(&self, b: &Aabb) -> bool {
        b.min.cmple(self.bounds.max).all()
            && b.max.cmpge(self.bounds.min).all()
            && self.planes[..self.count]
                .iter()
                .all(|(n, offset)| n.dot(Vec3::select(n.cmplt(Vec3::ZERO), b.max, b.min)) < *offset)
    }

    fn meets(&self, polygon: &[Vec3; 4], normal: Vec3) -> bool {
        let inside =
            self.planes[..self.count].iter().all(|(n, offset)| polygon.iter().any(|p| n.dot(*p) < *offset));
        if !inside {
            return false;
        }
        let height = |p: &Vec3| normal.dot(*p - polygon[0]);
        let heights = self.corners.as_flattened().iter().map(height);
        let (least, most) = heights.fold((f32::MAX, f32::MIN), |(l, m), h| (l.min(h), m.max(h)));
        let flat = self.slack - bend(polygon, normal);
        least < -flat && most > flat
    }

    /// Whether every segment between the ends crosses a convex polygon, well inside and away from the ends.
    fn covered_by(&self, polygon: &[Vec3; 4], normal: Vec3, ends: EndRule) -> bool {
        if bend(polygon, normal) > self.slack {
            return false;
        }
        let size = (polygon[2] - polygon[0]).length().max((polygon[3] - polygon[1]).length());
        let rim = (INSIDE * size).max(2.0 * self.slack);
        let mut edges = [(Vec3::ZERO, 0.0); 4];
        for k in 0..4 {
            let inward = normal.cross(polygon[(k + 1) & 3] - polygon[k]).normalize_or_zero();
            edges[k] = (inward, inward.dot(polygon[k]) + rim);
        }
        self.corners[0].iter().all(|a| {
            self.corners[1].iter().all(|b| {
                let d = *b - *a;
                let (from, to) = (normal.dot(polygon[0] - *a), normal.dot(polygon[0] - *b));
                let t = from / (from - to);
                let margin = 2.0 * ends.margin(d.length());
                let at = *a + t * d;
                // A comparison with NaN says no.
                t > margin
                    && t < 1.0 - margin
                    && edges.iter().all(|(n, offset)| *n == Vec3::ZERO || n.dot(at) > *offset)
            })
        })
    }
}

/// How far a quad's corners are off its plane.
fn bend(polygon: &[Vec3; 4], normal: Vec3) -> f32 {
    polygon.iter().map(|p| normal.dot(*p - polygon[0]).abs()).fold(0.0, f32::max)
}

/// What is known about the space between two surfaces that face each other, `before` that of surfaces they are parts of.
///
/// `hidden` says that rays have found no way between those: then a surface that hides all is looked for.
pub(super) fn between(
    elements: &Elements,
    corners: [&[Vec3; 4]; 2],
    normals: [Vec3; 2],
    ends: EndRule,
    before: Between,
    hidden: bool,
) -> Between {
    if matches!(before, Between::NOTHING | Between::WALL) {
        return before;
    }
    let shaft = Shaft::new(corners, normals, ends.slack());
    let look = |side: u32| -> Option<Between> {
        let s = &elements.sides[side as usize];
        let Shape::Surface { corners, .. } = &elements.elements[s.element as usize].shape else {
            return None;
        };
        if !shaft.meets(corners, s.normal) {
            return None;
        }
        Some(if shaft.covered_by(corners, s.normal, ends) { Between::WALL } else { Between::by(side) })
    };
    let mut found = Between::NOTHING;
    if let Some(side) = before.side() {
        match look(side) {
            Some(Between::WALL) => return Between::WALL,
            Some(other) if !hidden => return other,
            Some(other) => found = other,
            None => {}
        }
    }
    let mut stack = [0u32; LOOKS + 1];
    let (mut height, mut looks) = (1, 0);
    while height > 0 {
        height -= 1;
        let element = &elements.elements[stack[height] as usize];
        for child in element.child_range() {
            looks += 1;
            if looks > LOOKS {
                return if found == Between::NOTHING { Between::SOMETHING } else { found };
            }
            match elements.elements[child].shape {
                Shape::Cluster(c) => {
                    // One push a look: there is room.
                    if shaft.meets_box(&elements.clusters[c as usize].bounds) {
                        stack[height] = child as u32;
                        height += 1;
                    }
                }
                Shape::Surface { side, .. } => match look(side) {
                    Some(Between::WALL) => return Between::WALL,
                    Some(other) if !hidden => return other,
                    Some(other) => found = other,
                    None => {}
                },
            }
        }
    }
    found
}
