//! Triangulation of a polygon in its best-fit plane.
//!
//! Convex polygons become fans; others are triangulated by ear clipping. The sum of the triangles' areas must equal
//! the polygon's area; otherwise the polygon is non-planar ([`bent`]) or intersects itself.

use super::bent;
use earcut::Earcut;
use glam::{DVec2, DVec3};

/// Shape of a polygon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// All corners are collinear (relative to the size of the polygon).
    NoArea,
    /// All corners turn the same way.
    Convex,
    /// Some corner turns the other way, or the polygon is not planar.
    Concave,
    /// The polygon intersects itself: no triangulation has its area.
    Broken,
}

/// Smallest area relative to the squared size: below, the height is under the f32 resolution.
pub(super) const MIN_RELATIVE_AREA: f64 = 1e-7;
/// Largest relative difference of the triangles' areas and the polygon's: 17 roundings of f32 coordinates (2⁻²⁴).
const MAX_AREA_DIFFERENCE: f64 = 1e-6;
/// Number of corners from which self-intersections are searched first: ear clipping of such polygons takes cubic time,
/// 256³ = 17 million steps at most below.
const CHECKED_CORNERS: usize = 256;
/// Largest number of tested pairs of edges: limits the time for any polygon to 20 million tests; polygons that need
/// more count as crossing themselves.
const MAX_PAIRS: usize = 20_000_000;

/// Triangulates polygons and reuses its buffers.
pub(super) struct Triangulator {
    earcut: Earcut<f64>,
    flat: Vec<[f64; 2]>,
    clipped: Vec<u32>,
    /// Triangles of the last polygon as corner numbers, with the polygon's orientation.
    pub triangles: Vec<[u32; 3]>,
}

impl Triangulator {
    pub fn new() -> Self {
        Triangulator { earcut: Earcut::new(), flat: Vec::new(), clipped: Vec::new(), triangles: Vec::new() }
    }

    /// Triangulates the polygon `p` (at least three corners, no two consecutive ones equal).
    pub fn polygon(&mut self, p: &[DVec3]) -> Shape {
        self.triangles.clear();
        let normal = newell(p);
        let size = p.iter().map(|q| q.distance_squared(p[0])).fold(0.0, f64::max);
        let doubled = normal.length();
        if doubled <= MIN_RELATIVE_AREA * size {
            // A polygon shaped like a bow tie has no net area, but its corners are not collinear.
            let flat = p.windows(2).all(|e| {
                (e[0] - p[0]).cross(e[1] - p[0]).length() <= MIN_RELATIVE_AREA * size.max(f64::MIN_POSITIVE)
            });
            return if flat { Shape::NoArea } else { self.bent(p) };
        }
        if p.len() == 3 {
            self.triangles.push([0, 1, 2]);
            return Shape::Convex;
        }
        let (u, v) = (normal / doubled).any_orthonormal_pair();
        self.flat.clear();
        self.flat.extend(p.iter().map(|q| [(q - p[0]).dot(u), (q - p[0]).dot(v)]));
        // The orientation of (u, v, normal) is arbitrary: the area is made positive.
        let area = 0.5 * signed_area(&self.flat);
        if area < 0.0 {
            self.flat.iter_mut().for_each(|q| q[1] = -q[1]);
        }
        let area = area.abs();
        // Corners were rounded to f32: smaller turns the wrong way are rounding.
        if is_convex(&self.flat, 2.0 * f64::from(f32::EPSILON) * size.sqrt()) {
            self.triangles.extend((1..p.len() as u32 - 1).map(|i| [0, i, i + 1]));
            return Shape::Convex;
        }
        if p.len() > CHECKED_CORNERS && crosses_itself(&self.flat) {
            return Shape::Broken;
        }
        self.earcut.earcut_slice(&self.flat, &[], &mut self.clipped);
        let mut sum = 0.0;
        for t in self.clipped.chunks_exact(3) {
            let doubled = cross(&self.flat, t[0], t[1], t[2]);
            sum += 0.5 * doubled.abs();
            self.triangles.push(if doubled < 0.0 { [t[0], t[2], t[1]] } else { [t[0], t[1], t[2]] });
        }
        if (sum - area).abs() > MAX_AREA_DIFFERENCE * area {
            self.triangles.clear();
            return self.bent(p);
        }
        Shape::Concave
    }

    /// A polygon without a triangulation in its plane may be a non-planar surface.
    fn bent(&mut self, p: &[DVec3]) -> Shape {
        match bent::triangulate(p) {
            Some(triangles) => {
                self.triangles = triangles;
                Shape::Concave
            }
            None => Shape::Broken,
        }
    }
}

/// Twice the vector area (Newell's method) about the first corner, which avoids cancellation far from zero.
pub(super) fn newell(p: &[DVec3]) -> DVec3 {
    p.windows(2).map(|e| (e[0] - p[0]).cross(e[1] - p[0])).sum()
}

fn signed_area(p: &[[f64; 2]]) -> f64 {
    (0..p.len())
        .map(|i| {
            let (a, b) = (p[i], p[(i + 1) % p.len()]);
            a[0] * b[1] - a[1] * b[0]
        })
        .sum()
}

/// Twice the signed area of the triangle of three corners.
fn cross(p: &[[f64; 2]], a: u32, b: u32, c: u32) -> f64 {
    let [a, b, c] = [a, b, c].map(|i| DVec2::from_array(p[i as usize]));
    (b - a).perp_dot(c - a)
}

/// Whether there is no right turn and the corners wind once around the first one, within `slack`.
fn is_convex(p: &[[f64; 2]], slack: f64) -> bool {
    let n = p.len() as u32;
    let left = |a: u32, b: u32, c: u32| {
        let reach = DVec2::from_array(p[a as usize]).distance(DVec2::from_array(p[c as usize]));
        cross(p, a, b, c) >= -slack * reach
    };
    (0..n).all(|i| left(i, (i + 1) % n, (i + 2) % n)) && (1..n - 1).all(|i| left(0, i, i + 1))
}

/// Whether two edges properly intersect (contact is allowed: holes are often joined by a double edge). Also true if
/// the search would take too long.
fn crosses_itself(p: &[[f64; 2]]) -> bool {
    let n = p.len();
    let edge = |i: usize| (DVec2::from_array(p[i]), DVec2::from_array(p[(i + 1) % n]));
    let mut order: Vec<(f64, f64, u32)> = (0..n)
        .map(|i| {
            let (a, b) = edge(i);
            (a.x.min(b.x), a.x.max(b.x), i as u32)
        })
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut pairs = 0;
    for (k, &(_, right, i)) in order.iter().enumerate() {
        let (a, b) = edge(i as usize);
        for &(left, _, j) in &order[k + 1..] {
            if left > right {
                break;
            }
            pairs += 1;
            let (c, d) = edge(j as usize);
            let side = |p: DVec2, q: DVec2, r: DVec2| (q - p).perp_dot(r - p);
            if side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0 {
                return true;
            }
        }
        if pairs > MAX_PAIRS {
            return true;
        }
    }
    false
}
