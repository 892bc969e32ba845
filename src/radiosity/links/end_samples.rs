//! Sample points on the two ends of a link, and the kernel between two points.

use crate::math::sampling::{numbers, parallel_length, point_on};
use crate::radiosity::elements::{Elements, Shape};
use crate::ray::{EndRule, LANES};
use glam::Vec3;

/// Sixteen points on one end.
pub(super) struct EndSamples {
    pub points: [Vec3; LANES],
    pub normals: [Vec3; LANES],
    /// The sides on which the points lie.
    pub sides: [u32; LANES],
    /// End rules of the surfaces at the points.
    pub rules: [EndRule; LANES],
    /// Density with which each point was drawn, 1/area.
    pub density: [f32; LANES],
}

/// A permutation of the sixteen cells of a square: the second end uses it, so that rows and columns of the two ends are
/// uncorrelated.
const PERMUTED: [usize; LANES] = [0, 7, 13, 10, 5, 2, 8, 15, 11, 12, 6, 1, 14, 9, 3, 4];

impl EndSamples {
    /// One point in each cell of a four by four grid over the element; on clusters with a preference for sides that face
    /// `towards`. `order` is 0 for the first end of a link and 1 for the second.
    pub fn draw(elements: &Elements, element: u32, towards: Vec3, order: usize, seed: u64) -> EndSamples {
        let place = |lane: usize| {
            let cell = if order == 0 { lane } else { PERMUTED[lane] };
            let [r, s, t, q] = numbers(seed, lane as u64);
            [((cell & 3) as f32 + r) / 4.0, ((cell >> 2) as f32 + s) / 4.0, t, q]
        };
        EndSamples::at(elements, element, towards, place)
    }

    /// Points for four numbers in `[0, 1)` per lane: on a surface two numbers select the point, on a cluster two select the side and two
    /// the point on it.
    pub fn at(
        elements: &Elements,
        element: u32,
        towards: Vec3,
        place: impl Fn(usize) -> [f32; 4],
    ) -> EndSamples {
        let mut ends = EndSamples {
            points: [Vec3::ZERO; LANES],
            normals: [Vec3::ZERO; LANES],
            sides: [0; LANES],
            rules: [EndRule::of_slack(0.0); LANES],
            density: [0.0; LANES],
        };
        let e = &elements.elements[element as usize];
        for lane in 0..LANES {
            let [u, v, t, q] = place(lane);
            let (number, density) = match &e.shape {
                Shape::Surface { side, .. } => (*side, 1.0 / e.area as f32),
                Shape::Cluster(c) => {
                    let cluster = &elements.clusters[*c as usize];
                    let number = elements.samples().pick(cluster, towards, u, v);
                    let normal = elements.sides[number as usize].normal;
                    (number, elements.samples().density(cluster, towards, normal))
                }
            };
            let side = &elements.sides[number as usize];
            ends.points[lane] = match &e.shape {
                Shape::Surface { corners, .. } => point_on(corners, u, v),
                Shape::Cluster(_) => point_on(elements.corners(side), t, q),
            };
            (ends.sides[lane], ends.density[lane]) = (number, density);
            (ends.normals[lane], ends.rules[lane]) = (side.normal, side.end);
        }
        ends
    }
}

/// Four random points of a surface, one in each quarter of its parameter square.
pub(super) fn stratified_points(corners: &[Vec3; 4], seed: u64) -> [Vec3; 4] {
    std::array::from_fn(|k| {
        let [u, v, ..] = numbers(seed, k as u64);
        point_on(corners, ((k & 1) as f32 + u) / 2.0, ((k >> 1) as f32 + v) / 2.0)
    })
}

/// Points on a surface, with weights whose sum is 1.
#[derive(Clone, Copy)]
pub(super) struct Quadrature {
    pub points: [Vec3; 4],
    pub weights: [f32; 4],
}

/// Points and weights that integrate polynomials over a surface exactly: up to the third degree over
/// parallelograms (Gauss and Legendre), up to the second degree over triangles.
pub(super) fn gauss_points(c: &[Vec3; 4]) -> Quadrature {
    if c[2] == c[3] {
        let at = |i: usize, j: usize, k: usize| (4.0 * c[i] + c[j] + c[k]) / 6.0;
        return Quadrature {
            points: [at(0, 1, 2), at(1, 2, 0), at(2, 0, 1), c[0]],
            weights: [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 0.0],
        };
    }
    let (near, far) = (0.5 - 0.288_675_13, 0.5 + 0.288_675_13);
    let (mut points, mut weights) = ([Vec3::ZERO; 4], [0.0; 4]);
    for (k, (u, v)) in [(near, near), (far, near), (far, far), (near, far)].into_iter().enumerate() {
        points[k] = (1.0 - v) * ((1.0 - u) * c[0] + u * c[1]) + v * ((1.0 - u) * c[3] + u * c[2]);
        let along_u = (1.0 - v) * (c[1] - c[0]) + v * (c[2] - c[3]);
        let along_v = (1.0 - u) * (c[3] - c[0]) + u * (c[2] - c[1]);
        weights[k] = parallel_length(along_u.cross(along_v));
    }
    let sum: f32 = weights.iter().sum();
    Quadrature { points, weights: weights.map(|w| w / sum) }
}

/// The kernel `cos cos' / π r²` between two points, 0 if one is behind the other. A point without a normal has the cosine 1/4,
/// the mean over all normals. `nearest` is a lower bound of the distance.
#[inline]
pub(super) fn kernel(x: Vec3, nx: Option<Vec3>, y: Vec3, ny: Option<Vec3>, nearest: f32) -> f32 {
    let d = y - x;
    let r2 = d.length_squared().max(nearest * nearest).max(f32::MIN_POSITIVE);
    let from = nx.map_or(0.25 * r2.sqrt(), |n| n.dot(d).max(0.0));
    let to = ny.map_or(0.25 * r2.sqrt(), |n| (-n.dot(d)).max(0.0));
    // Two divisions by r²: r⁴ overflows 32 bits for most lengths.
    (from / r2) * (to / r2) / std::f32::consts::PI
}
