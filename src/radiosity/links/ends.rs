//! Sample points on the two ends of a link, and the kernel between them.

use crate::radiosity::elements::{Elements, Shape};
use crate::ray::LANES;
use glam::Vec3;

/// Sixteen points on one end.
pub(super) struct Ends {
    pub points: [Vec3; LANES],
    pub normals: [Vec3; LANES],
    /// Density with which each was drawn, 1/area.
    pub density: [f32; LANES],
}

/// `(i, j)` of the sixteen cells of a square that each number of a permuted order stands for: samples of the two ends
/// with the same number share no row and column pattern.
const PERMUTED: [usize; LANES] = [0, 7, 13, 10, 5, 2, 8, 15, 11, 12, 6, 1, 14, 9, 3, 4];

impl Ends {
    /// One point in each cell of a four by four grid over the element; on clusters, sides that face `towards` are
    /// preferred. `order` 0 and 1 for the two ends of a link.
    pub fn draw(elements: &Elements, element: u32, towards: Vec3, order: usize, seed: u64) -> Ends {
        let mut ends =
            Ends { points: [Vec3::ZERO; LANES], normals: [Vec3::ZERO; LANES], density: [0.0; LANES] };
        let e = &elements.elements[element as usize];
        for (lane, permuted) in PERMUTED.into_iter().enumerate() {
            let cell = if order == 0 { lane } else { permuted };
            let [r, s, t, q] = numbers(seed, lane as u64);
            let (u, v) = (((cell & 3) as f32 + r) / 4.0, ((cell >> 2) as f32 + s) / 4.0);
            (ends.points[lane], ends.normals[lane], ends.density[lane]) = match &e.shape {
                Shape::Surface { side, corners } => {
                    (point_on(corners, u, v), elements.sides[*side as usize].normal, 1.0 / e.area as f32)
                }
                Shape::Cluster(c) => {
                    let cluster = &elements.clusters[*c as usize];
                    let side = &elements.sides[elements.samples().pick(cluster, towards, u, v) as usize];
                    let corners = match &elements.elements[side.element as usize].shape {
                        Shape::Surface { corners, .. } => *corners,
                        Shape::Cluster(_) => [e.centre; 4],
                    };
                    let density = elements.samples().density(cluster, towards, side.normal);
                    (point_on(&corners, t, q), side.normal, density)
                }
            };
        }
        ends
    }
}

/// Four points of a surface, one in each quarter of its parameters.
pub(super) fn four(corners: &[Vec3; 4], seed: u64) -> [Vec3; 4] {
    std::array::from_fn(|k| {
        let [u, v, ..] = numbers(seed, k as u64);
        point_on(corners, ((k & 1) as f32 + u) / 2.0, ((k >> 1) as f32 + v) / 2.0)
    })
}

/// Points and weights (their sum is 1) that integrate polynomials over a surface: to the third degree over parallelograms
/// (Gauss and Legendre), the second over triangles.
pub(super) fn gauss(c: &[Vec3; 4]) -> ([Vec3; 4], [f32; 4]) {
    if c[2] == c[3] {
        let at = |i: usize, j: usize, k: usize| (4.0 * c[i] + c[j] + c[k]) / 6.0;
        return ([at(0, 1, 2), at(1, 2, 0), at(2, 0, 1), c[0]], [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 0.0]);
    }
    let (near, far) = (0.5 - 0.288_675_13, 0.5 + 0.288_675_13);
    let (mut points, mut weights) = ([Vec3::ZERO; 4], [0.0; 4]);
    for (k, (u, v)) in [(near, near), (far, near), (far, far), (near, far)].into_iter().enumerate() {
        points[k] = (1.0 - v) * ((1.0 - u) * c[0] + u * c[1]) + v * ((1.0 - u) * c[3] + u * c[2]);
        let along_u = (1.0 - v) * (c[1] - c[0]) + v * (c[2] - c[3]);
        let along_v = (1.0 - u) * (c[3] - c[0]) + u * (c[2] - c[1]);
        weights[k] = size(along_u.cross(along_v));
    }
    let sum: f32 = weights.iter().sum();
    (points, weights.map(|w| w / sum))
}

/// `cos cos' / π r²` between two places, 0 if one is behind the other; 1/4 for the cosine of a place without a normal, its
/// mean over all of them. `nearest` bounds the distance from below.
#[inline]
pub(super) fn kernel(x: Vec3, nx: Option<Vec3>, y: Vec3, ny: Option<Vec3>, nearest: f32) -> f32 {
    let d = y - x;
    let r2 = d.length_squared().max(nearest * nearest).max(f32::MIN_POSITIVE);
    let from = nx.map_or(0.25 * r2.sqrt(), |n| n.dot(d).max(0.0));
    let to = ny.map_or(0.25 * r2.sqrt(), |n| (-n.dot(d)).max(0.0));
    // Not over r⁴, which few lengths have in these numbers.
    (from / r2) * (to / r2) / std::f32::consts::PI
}

/// The place of a triangle or convex quad that stands for `(u, v)` in the unit square: equal areas for equal areas.
pub fn point_on(corners: &[Vec3; 4], u: f32, v: f32) -> Vec3 {
    let [a, b, c, d] = *corners;
    if c == d {
        return on_triangle([a, b, c], u, v);
    }
    let (first, second) = (size((b - a).cross(c - a)), size((c - a).cross(d - a)));
    let share = first / (first + second);
    if u < share {
        on_triangle([a, b, c], u / share, v)
    } else {
        on_triangle([a, c, d], ((u - share) / (1.0 - share)).min(1.0), v)
    }
}

/// What compares vectors along one line as their lengths do, without squares: these are areas already, and few areas have
/// squares in these numbers.
fn size(v: Vec3) -> f32 {
    v.abs().element_sum()
}

fn on_triangle([a, b, c]: [Vec3; 3], u: f32, v: f32) -> Vec3 {
    // Bands parallel to the edge bc (of equal area for equal u), uniform along each.
    let root = u.sqrt();
    a + root * ((1.0 - v) * (b - a) + v * (c - a))
}

/// Four numbers in `[0, 1)` for an item and a seed (SplitMix64, Steele et al. 2014).
pub fn numbers(seed: u64, item: u64) -> [f32; 4] {
    let first = mix(seed ^ item.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let second = mix(first);
    let unit = |v: u64| (v >> 40) as f32 / (1u64 << 24) as f32;
    [unit(first), unit(first << 24), unit(second), unit(second << 24)]
}

/// A well-mixed number.
pub fn mix(v: u64) -> u64 {
    let v = v.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let v = (v ^ v >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let v = (v ^ v >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    v ^ v >> 31
}

/// A direction about a unit normal, with the density cos/π, for a place in the unit square: squares around its middle
/// become circles around the normal (Shirley and Chiu 1997), so that neighbours stay neighbours.
pub fn cosine_direction(normal: Vec3, u: f32, v: f32) -> Vec3 {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let (radius, angle) = if a.abs() > b.abs() {
        (a, std::f32::consts::FRAC_PI_4 * b / a)
    } else {
        (b, std::f32::consts::FRAC_PI_2 - std::f32::consts::FRAC_PI_4 * if b == 0.0 { 0.0 } else { a / b })
    };
    let (x, y) = normal.any_orthonormal_pair();
    let (sin, cos) = angle.sin_cos();
    (radius * cos * x + radius * sin * y + (1.0 - radius * radius).max(0.0).sqrt() * normal).normalize()
}
