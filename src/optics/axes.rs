//! The 13 axes of directional cluster optics: the 26 neighbours of a cell, opposite ones merged (docs/method.md,
//! Directions).

use glam::Vec3;

/// Number of axes.
pub const AXIS_COUNT: usize = 13;

/// Components of unit vectors through the middle of a cube's edges, 1/√2, and through its corners, 1/√3.
const EDGE: f32 = std::f32::consts::FRAC_1_SQRT_2;
const CORNER: f32 = 0.577_350_26;

/// Unit vectors of the axes; each also represents its opposite. Order: 3 faces, 6 edges, 4 corners of the cube.
pub const AXES: [Vec3; AXIS_COUNT] = [
    Vec3::X,
    Vec3::Y,
    Vec3::Z,
    Vec3::new(EDGE, EDGE, 0.0),
    Vec3::new(EDGE, -EDGE, 0.0),
    Vec3::new(EDGE, 0.0, EDGE),
    Vec3::new(EDGE, 0.0, -EDGE),
    Vec3::new(0.0, EDGE, EDGE),
    Vec3::new(0.0, EDGE, -EDGE),
    Vec3::new(CORNER, CORNER, CORNER),
    Vec3::new(CORNER, CORNER, -CORNER),
    Vec3::new(CORNER, -CORNER, CORNER),
    Vec3::new(CORNER, -CORNER, -CORNER),
];

/// Number of probe directions: measured but not fitted, to determine [`super::ClusterOptics::error`].
pub(super) const PROBE_COUNT: usize = 3;

/// Unit vectors of the probes, (3, 2, 1)/√14 and permutations with signs: barycentric weights 1/3 for each of the three
/// surrounding axes, and nearly orthogonal to each other.
pub(super) const PROBES: [Vec3; PROBE_COUNT] = [
    Vec3::new(0.801_783_7, 0.534_522_5, 0.267_261_24),
    Vec3::new(0.267_261_24, -0.801_783_7, 0.534_522_5),
    Vec3::new(0.534_522_5, -0.267_261_24, -0.801_783_7),
];

/// Direction `k` of axes followed by probes, `k < AXIS_COUNT + PROBE_COUNT`.
pub(super) fn view(k: usize) -> Vec3 {
    if k < AXIS_COUNT { AXES[k] } else { PROBES[k - AXIS_COUNT] }
}

/// Components from the largest to the smallest, by whether |x| >= |y|, |y| >= |z| and |x| >= |z| (bits 0 to 2).
const ORDERS: [[usize; 3]; 8] =
    [[2, 1, 0], [2, 0, 1], [1, 2, 0], [0, 1, 2], [2, 1, 0], [0, 2, 1], [1, 0, 2], [0, 1, 2]];

/// Indices into [`AXES`] of the face, the edge and the corner around a direction, by the order of its components (bits as in `ORDERS`)
/// and by whether y and z, x and z, x and y have opposite signs (bits 0 to 2).
#[inline(always)]
pub fn axes_around(order: usize, opposite: usize) -> [usize; 3] {
    let [face, _, third] = ORDERS[order & 7];
    // The edge lies in the plane of the two largest components.
    let edge = 7 - 2 * third + (opposite >> third & 1);
    let corner = 9 + 2 * (opposite >> 2 & 1) + (opposite >> 1 & 1);
    [face, edge, corner]
}

/// The three axes around a direction and their barycentric weights.
///
/// With |components| a >= b >= c the direction is (a-b)·face + (b-c)·edge + c·corner with the unnormalised face
/// (1,0,0), edge (1,1,0) and corner (1,1,1) of its octant; division by a makes the weights sum to 1.
#[derive(Clone, Copy, Debug)]
pub struct AxisMix {
    /// Indices into [`AXES`]: a face, an edge and a corner of the cube.
    pub axes: [usize; 3],
    /// Weights of the axes, in `[0, 1]`; their sum is 1.
    pub weights: [f32; 3],
}

impl AxisMix {
    /// The axes around a direction of any length; the zero vector counts as +x.
    #[inline]
    pub fn around(d: Vec3) -> AxisMix {
        let d = if d == Vec3::ZERO { Vec3::X } else { d };
        let a = d.abs();
        let order = usize::from(a.x >= a.y) | usize::from(a.y >= a.z) << 1 | usize::from(a.x >= a.z) << 2;
        let opposite = [d.y * d.z, d.x * d.z, d.x * d.y].map(|product| usize::from(product < 0.0));
        let [face, second, third] = ORDERS[order];
        let axes = axes_around(order, opposite[0] | opposite[1] << 1 | opposite[2] << 2);
        let largest = a[face].max(f32::MIN_POSITIVE);
        AxisMix {
            axes,
            weights: [(a[face] - a[second]) / largest, (a[second] - a[third]) / largest, a[third] / largest],
        }
    }

    /// Interpolates a quantity given per axis: `values(k)` is its value along `AXES[k]`.
    pub fn mix(&self, values: impl Fn(usize) -> f32) -> f32 {
        self.axes.iter().zip(self.weights).map(|(&axis, w)| w * values(axis)).sum()
    }
}
