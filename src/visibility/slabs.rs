//! Aggregated clusters: boxes with extinction, and the segments that pass through them.

use super::wide::Node;
use crate::ray::Packet;
use crate::simd::vector::{self, Vector};
use crate::simd::{LANES, Simd, decay};
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
    /// Root mean square error of its transmittance for the bundle's beam, in `[0, 1]`.
    pub error: f32,
}

impl Slab {
    /// The box in a lane of a node, seen from a point.
    #[inline(always)]
    pub fn of(node: &Node, lane: usize, extinction: f32, from: Vec3) -> Slab {
        let (min, max) = (pick(&node.min, lane) - from, pick(&node.max, lane) - from);
        let slope = pick(&node.slope, lane);
        Slab { min, max, extinction, slope, density: 1.0 - 0.5 * slope.dot(min + max), error: 1.0 }
    }

    /// Its middle, from where it is seen.
    #[inline(always)]
    pub fn centre(&self) -> Vec3 {
        0.5 * (self.min + self.max)
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
    /// Squares of them.
    pub square: f32,
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

/// Segments of a packet, made ready for boxes.
struct Beam<S: Simd> {
    /// Where they begin, if not at one place.
    origin: Option<Vector<S>>,
    half: Vector<S>,
    inverse: Vector<S>,
    length: S::F,
}

impl<S: Simd> Beam<S> {
    #[inline(always)]
    fn of(simd: S, packet: &Packet, shared: bool) -> Beam<S> {
        let direction = vector::load(simd, &packet.direction);
        let inverse =
            [reciprocal(simd, direction[0]), reciprocal(simd, direction[1]), reciprocal(simd, direction[2])];
        Beam {
            origin: (!shared).then_some(vector::load(simd, &packet.origin)),
            half: vector::scaled(simd, simd.splat(0.5), &direction),
            inverse,
            length: simd.root(vector::dot(simd, &direction, &direction)),
        }
    }

    /// Optical depth of each segment in a box, over the segment's length.
    #[inline(always)]
    fn depth(&self, simd: S, slab: &Slab) -> S::F {
        let zero = simd.splat(0.0);
        let (mut enter, mut leave) = (zero, simd.splat(1.0));
        for axis in 0..3 {
            let (mut a, mut b) = (simd.splat(slab.min[axis]), simd.splat(slab.max[axis]));
            if let Some(origin) = &self.origin {
                (a, b) = (simd.sub(a, origin[axis]), simd.sub(b, origin[axis]));
            }
            (a, b) = (simd.mul(a, self.inverse[axis]), simd.mul(b, self.inverse[axis]));
            enter = simd.max(simd.min(a, b), enter);
            leave = simd.min(simd.max(a, b), leave);
        }
        let path = simd.max(simd.sub(leave, enter), zero);
        let twice = simd.add(enter, leave);
        let climb = vector::dot(simd, &vector::splat(simd, slab.slope), &self.half);
        let mut at_origin = simd.splat(slab.density);
        if let Some(origin) = &self.origin {
            at_origin = simd.add(at_origin, vector::dot(simd, &vector::splat(simd, slab.slope), origin));
        }
        // No more than 2 in any box, and finite for boxes that are missed by far.
        let density = simd.min(simd.max(simd.fma(climb, twice, at_origin), zero), simd.splat(2.0));
        simd.mul(simd.mul(path, simd.splat(slab.extinction)), density)
    }
}

/// Root mean square error of the mean transmittance of a packet's segments that the boxes' own errors make, taken as
/// independent: T² Σ (ε_i / T_i)², with ε_i² no more than T_i (1 - T_i), the variance of a box that passes all or
/// nothing (method A.9).
#[inline(always)]
pub(super) fn spread<S: Simd>(simd: S, slabs: &[Slab], packet: &Packet, clear: u32, shared: bool) -> f32 {
    let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
    let beam = Beam::of(simd, packet, shared);
    let (mut depth, mut sum) = (zero, zero);
    for slab in slabs {
        let d = simd.mul(beam.depth(simd, slab), beam.length);
        depth = simd.add(depth, d);
        // 1/T_i = e^d >= 1 + d + d²/2; past that T is small anyway.
        let inverse = simd.fma(d, simd.fma(d, simd.splat(0.5), one), one);
        let error = simd.mul(simd.splat(slab.error), inverse);
        sum = simd.add(sum, simd.min(simd.mul(error, error), simd.sub(inverse, one)));
    }
    let errors = simd.mul(decay(simd, depth), simd.root(sum));
    simd.sum(simd.keep(simd.mask(clear), errors)) / (packet.len() as f32).max(1.0)
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
    let beam = Beam::of(simd, packet, shared);
    let (mut depth, mut deepest) = (zero, zero);
    for slab in slabs {
        let d = beam.depth(simd, slab);
        depth = simd.add(depth, d);
        deepest = simd.max(deepest, d);
    }
    let seen = simd.mask(clear);
    let depth = simd.mul(depth, beam.length);
    let transmittance = simd.keep(seen, decay(simd, depth));
    if let Some(each) = each {
        simd.store(transmittance, each);
    }
    let lo = simd.keep(seen, simd.max(simd.sub(simd.splat(1.0), depth), zero));
    let hi = simd.keep(seen, decay(simd, simd.mul(deepest, beam.length)));
    Passed {
        transmittance: simd.sum(transmittance),
        square: simd.sum(simd.mul(transmittance, transmittance)),
        lo: simd.sum(lo),
        hi: simd.sum(hi),
        met: simd.bits(simd.lt(zero, depth)) & packet.active,
    }
}
