//! Triangulation of one polygon in its best-fit plane.
//!
//! Convex polygons become fans; the rest goes to ear clipping. The triangles' areas must add up to the
//! polygon's, otherwise it crosses itself and there is no right answer.

use earcut::Earcut;
use glam::{DVec2, DVec3};

/// What a polygon turned out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// All corners on a line (relative to the size of the polygon).
    NoArea,
    /// Every corner turns the same way.
    Convex,
    /// Some corner turns the other way.
    Concave,
    /// It crosses itself: no triangulation has the area of the polygon.
    Broken,
}

/// Area below this fraction of the squared size counts as none: the height is beneath f32 resolution.
pub(super) const RELATIVE_AREA: f64 = 1e-7;
/// Triangles may miss the polygon's area by this fraction.
const AREA_AGREES: f64 = 1e-6;
/// Corners from which on crossings are looked for first: ear clipping's last resort takes cubic time.
const LARGE: usize = 256;
/// Edge pairs after which the search gives up, so that no file can make it hang.
const MAX_PAIRS: usize = 20_000_000;

/// Triangulates polygons one after the other and reuses its buffers.
pub(super) struct Triangulator {
    earcut: Earcut<f64>,
    flat: Vec<[f64; 2]>,
    clipped: Vec<u32>,
    /// Triangles of the last polygon as corner numbers, wound like the polygon.
    pub triangles: Vec<[u32; 3]>,
}

impl Triangulator {
    pub fn new() -> Self {
        Triangulator { earcut: Earcut::new(), flat: Vec::new(), clipped: Vec::new(), triangles: Vec::new() }
    }

    /// Triangulates the polygon `p` (three corners or more, no two consecutive ones equal).
    pub fn polygon(&mut self, p: &[DVec3]) -> Shape {
        self.triangles.clear();
        let normal = newell(p);
        let size = p.iter().map(|q| q.distance_squared(p[0])).fold(0.0, f64::max);
        let doubled = normal.length();
        if doubled <= RELATIVE_AREA * size {
            // A bow tie has no net area either, but its corners are not on a line.
            let flat = p.windows(2).all(|e| {
                (e[0] - p[0]).cross(e[1] - p[0]).length() <= RELATIVE_AREA * size.max(f64::MIN_POSITIVE)
            });
            return if flat { Shape::NoArea } else { Shape::Broken };
        }
        if p.len() == 3 {
            self.triangles.push([0, 1, 2]);
            return Shape::Convex;
        }
        let (u, v) = (normal / doubled).any_orthonormal_pair();
        self.flat.clear();
        self.flat.extend(p.iter().map(|q| [(q - p[0]).dot(u), (q - p[0]).dot(v)]));
        // The pair (u, v, normal) is right-handed or not, depending on the helper: make the area positive.
        let area = 0.5 * signed_area(&self.flat);
        if area < 0.0 {
            self.flat.iter_mut().for_each(|q| q[1] = -q[1]);
        }
        let area = area.abs();
        let slack = 1e-12 * size;
        if is_convex(&self.flat, slack) {
            self.triangles.extend((1..p.len() as u32 - 1).map(|i| [0, i, i + 1]));
            return Shape::Convex;
        }
        if p.len() > LARGE && crosses_itself(&self.flat) {
            return Shape::Broken;
        }
        self.earcut.earcut_slice(&self.flat, &[], &mut self.clipped);
        let mut sum = 0.0;
        for t in self.clipped.chunks_exact(3) {
            let doubled = cross(&self.flat, t[0], t[1], t[2]);
            sum += 0.5 * doubled.abs();
            self.triangles.push(if doubled < 0.0 { [t[0], t[2], t[1]] } else { [t[0], t[1], t[2]] });
        }
        if (sum - area).abs() > AREA_AGREES * area {
            self.triangles.clear();
            return Shape::Broken;
        }
        Shape::Concave
    }
}

/// Twice the vector area (Newell), taken about the first corner to keep digits far from zero.
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

/// No right turn, and seen from the first corner the others go round once.
fn is_convex(p: &[[f64; 2]], slack: f64) -> bool {
    let n = p.len() as u32;
    (0..n).all(|i| cross(p, i, (i + 1) % n, (i + 2) % n) >= -slack)
        && (1..n - 1).all(|i| cross(p, 0, i, i + 1) >= -slack)
}

/// Whether two edges properly cross (touching is allowed: holes are often bridged by a double edge).
/// Also true if the search would take too long.
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
