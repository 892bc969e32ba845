//! Aggregated clusters: boxes with extinction, and the segments that pass through them.

use super::wide::Node;
use crate::ray::Packet;
use crate::simd::{LANES, Simd, decay, vector};
use glam::Vec3;

/// A box that is answered by its extinction, as seen from the common receiver end or from the scene's origin.
pub(super) struct Slab {
    min: Vec3,
    max: Vec3,
    /// Extinction in its middle.
    extinction: f32,
    /// Extinction elsewhere is `density + slope · x` times that, or 0.
    slope: Vec3,
    density: f32,
}

impl Slab {
    /// The box in a lane of a node, seen from a point.
    #[inline(always)]
    pub fn of(node: &Node, lane: usize, extinction: f32, from: Vec3) -> Slab {
        let (min, max) = (pick(&node.min, lane) - from, pick(&node.max, lane) - from);
        let slope = pick(&node.slope, lane);
        Slab { min, max, extinction, slope, density: 1.0 - 0.5 * slope.dot(min + max) }
    }
}

#[inline(always)]
fn pick(v: &[[f32; LANES]; 3], lane: usize) -> Vec3 {
    Vec3::new(v[0][lane], v[1][lane], v[2][lane])
}

/// What passes through, summed over the clear segments of a packet.
#[derive(Clone, Copy, Default)]
pub(super) struct Passed {
    /// Product of the boxes' transmittances [SD95 sec 3.1].
    pub transmittance: f32,
    /// Fréchet's lower bound of it, 1 - Σ(1 - T), from Σ κ l >= Σ (1 - T) (method D.7).
    pub lo: f32,
    /// Fréchet's upper bound, the least of the factors.
    pub hi: f32,
    /// Segments that meet a box.
    pub met: u32,
}

/// 1/d, finite even for zero, so that 0 · 1/d is never NaN.
#[inline(always)]
fn reciprocal<S: Simd>(simd: S, d: S::F) -> S::F {
    let tiny = simd.lt(simd.abs(d), simd.splat(1e-30));
    simd.div(simd.splat(1.0), simd.select(tiny, simd.splat(1e-30), d))
}

/// Sends the clear segments of a packet through the boxes. `each` gets the transmittances, 0 in other lanes.
#[inline(always)]
pub(super) fn pass<S: Simd>(
    simd: S,
    slabs: &[Slab],
    packet: &Packet,
    clear: u32,
    shared: bool,
    each: Option<&mut [f32; LANES]>,
) -> Passed {
    let zero = simd.splat(0.0);
    let direction = vector::load(simd, &packet.direction);
    let half = vector::scaled(simd, simd.splat(0.5), &direction);
    let inverse =
        [reciprocal(simd, direction[0]), reciprocal(simd, direction[1]), reciprocal(simd, direction[2])];
    let origin = vector::load(simd, &packet.origin);
    let (mut depth, mut deepest) = (zero, zero);
    for slab in slabs {
        let (mut enter, mut leave) = (zero, simd.splat(1.0));
        for axis in 0..3 {
            let (mut a, mut b) = (simd.splat(slab.min[axis]), simd.splat(slab.max[axis]));
            if !shared {
                (a, b) = (simd.sub(a, origin[axis]), simd.sub(b, origin[axis]));
            }
            (a, b) = (simd.mul(a, inverse[axis]), simd.mul(b, inverse[axis]));
            enter = simd.max(simd.min(a, b), enter);
            leave = simd.min(simd.max(a, b), leave);
        }
        let path = simd.max(simd.sub(leave, enter), zero);
        let twice = simd.add(enter, leave);
        let climb = vector::dot(simd, &vector::splat(simd, slab.slope), &half);
        let mut at_origin = simd.splat(slab.density);
        if !shared {
            at_origin = simd.add(at_origin, vector::dot(simd, &vector::splat(simd, slab.slope), &origin));
        }
        // No more than 2 in any box, and finite for boxes that are missed by far.
        let density = simd.min(simd.max(simd.fma(climb, twice, at_origin), zero), simd.splat(2.0));
        let d = simd.mul(simd.mul(path, simd.splat(slab.extinction)), density);
        depth = simd.add(depth, d);
        deepest = simd.max(deepest, d);
    }
    let length = simd.root(vector::dot(simd, &direction, &direction));
    let seen = simd.mask(clear);
    let depth = simd.mul(depth, length);
    let transmittance = simd.keep(seen, decay(simd, depth));
    if let Some(each) = each {
        simd.store(transmittance, each);
    }
    let lo = simd.keep(seen, simd.max(simd.sub(simd.splat(1.0), depth), zero));
    let hi = simd.keep(seen, decay(simd, simd.mul(deepest, length)));
    Passed {
        transmittance: simd.sum(transmittance),
        lo: simd.sum(lo),
        hi: simd.sum(hi),
        met: simd.bits(simd.lt(zero, depth)) & packet.active,
    }
}
