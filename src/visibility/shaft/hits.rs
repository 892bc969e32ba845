//! Tests of boxes and triangles against a shaft, sixteen at a time.

use super::{BoxEnds, Shaft};
use crate::simd::Simd;
use crate::simd::vector::{self, Vector};
use crate::visibility::wide::WideNode;
use glam::Vec3;

impl Shaft {
    /// Smallest and largest t, in `[0, 1]`, at which a segment can pass points that lie between `low` and `high` along
    /// the axis, measured from the centre of the receiver ends.
    ///
    /// A segment from o to 1 + d along the axis passes a at t = (a - o) / (1 + d - o), which decreases in d and, for
    /// a < 1 + d, in o.
    #[inline(always)]
    fn parameters<S: Simd>(&self, simd: S, low: S::F, high: S::F) -> (S::F, S::F) {
        let [o, d] = self.spread;
        let (longest, shortest) = (1.0 + d - o, 1.0 - d + o);
        let first = simd.mul(simd.sub(low, simd.splat(o)), simd.splat(1.0 / longest));
        let last = simd.mul(simd.add(high, simd.splat(o)), simd.splat(1.0 / shortest));
        let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
        // Ends that overlap along the axis allow no statement.
        if d + o >= 0.9 {
            return (zero, one);
        }
        (simd.min(simd.max(first, zero), one), simd.min(simd.max(last, zero), one))
    }

    /// Approximate parameters at which segments pass the centres of a node's boxes.
    #[inline(always)]
    pub fn places<S: Simd>(&self, simd: S, node: &WideNode) -> S::F {
        let mut place = simd.splat(-self.axis.dot(self.ends[0].centre));
        for axis in 0..3 {
            let twice = simd.add(simd.load(&node.min[axis]), simd.load(&node.max[axis]));
            place = simd.fma(simd.splat(0.5 * self.axis[axis]), twice, place);
        }
        place
    }

    /// Component of a vector along the axis, as a parameter.
    #[inline(always)]
    pub fn along(&self, direction: Vec3) -> f32 {
        self.axis.dot(direction)
    }

    /// Smallest and largest position of triangles along the axis, measured from the centre of the receiver ends.
    #[inline(always)]
    pub fn reach<S: Simd>(&self, simd: S, corner: &Vector<S>, edges: [&Vector<S>; 2]) -> (S::F, S::F) {
        let axis = vector::splat(simd, self.axis);
        let from = vector::sub(simd, corner, &vector::splat(simd, self.ends[0].centre));
        let a = vector::dot(simd, &axis, &from);
        let (b, c) = (vector::dot(simd, &axis, edges[0]), vector::dot(simd, &axis, edges[1]));
        let zero = simd.splat(0.0);
        (simd.add(a, simd.min(simd.min(b, c), zero)), simd.add(a, simd.max(simd.max(b, c), zero)))
    }

    /// Whether positions between `low` and `high` along the axis lie beyond the margins at both ends of every segment.
    #[inline(always)]
    pub fn amid<S: Simd>(&self, simd: S, low: S::F, high: S::F) -> S::M {
        let (first, last) = self.parameters(simd, low, high);
        let [start, end] = self.margins.map(|margin| simd.splat(1.001 * margin + 1e-6));
        simd.and(simd.lt(start, first), simd.lt(simd.add(last, end), simd.splat(1.0)))
    }

    /// Children that may be aggregated: their feature size is below `s (1 - t) + e t` at the less favourable end of
    /// the box for every segment, and no segment ends inside (docs/method.md, Umbra criterion, and Segment ends).
    #[inline(always)]
    pub fn aggregates<S: Simd>(&self, simd: S, node: &WideNode, sizes: S::F, e: f32, s: f32) -> u32 {
        let (mut low, mut high) = (simd.splat(0.0), simd.splat(0.0));
        let from = self.ends[0];
        let mut holds = [simd.mask(0xffff); 2];
        for axis in 0..3 {
            let (min, max) = (simd.load(&node.min[axis]), simd.load(&node.max[axis]));
            let (n, centre) = (simd.splat(self.axis[axis]), simd.splat(from.centre[axis]));
            let a = simd.mul(n, simd.sub(min, centre));
            let b = simd.mul(n, simd.sub(max, centre));
            low = simd.add(low, simd.min(a, b));
            high = simd.add(high, simd.max(a, b));
            for (holds, (end, margin)) in holds.iter_mut().zip(self.ends.iter().zip(self.lengths)) {
                let upper = simd.splat(end.centre[axis] + end.half[axis] + margin);
                let lower = simd.splat(end.centre[axis] - end.half[axis] - margin);
                *holds = simd.and(*holds, simd.and(simd.le(min, upper), simd.le(lower, max)));
            }
        }
        let (first, last) = self.parameters(simd, low, high);
        let t = if e > s { first } else { last };
        let threshold = simd.fma(simd.splat(e - s), t, simd.splat(s));
        let before_emitter = simd.lt(last, simd.splat(1.0 - 1.001 * self.margins[1] - 1e-6));
        let ends_inside = simd.or(holds[0], simd.and_not(holds[1], before_emitter));
        simd.bits(simd.and_not(simd.lt(sizes, threshold), ends_inside))
    }

    /// Children of a node that may touch the shaft.
    #[inline(always)]
    pub fn touches<S: Simd>(&self, simd: S, node: &WideNode) -> u32 {
        let mut touched = simd.mask(0xffff);
        for axis in 0..3 {
            let below = simd.le(simd.load(&node.min[axis]), simd.splat(self.hi[axis]));
            let above = simd.le(simd.splat(self.lo[axis]), simd.load(&node.max[axis]));
            touched = simd.and(touched, simd.and(below, above));
        }
        for plane in 0..self.planes {
            let n = self.normals[plane];
            // The corner that lies farthest inside the plane.
            let mut depth = simd.splat(0.0);
            for axis in 0..3 {
                let corner = if n[axis] > 0.0 { &node.min[axis] } else { &node.max[axis] };
                depth = simd.fma(simd.splat(n[axis]), simd.load(corner), depth);
            }
            touched = simd.and(touched, simd.le(depth, simd.splat(self.offsets[plane])));
        }
        simd.bits(touched)
    }

    /// Lanes whose triangle lies outside at least one side plane.
    #[inline(always)]
    pub fn misses<S: Simd>(&self, simd: S, corner: &Vector<S>, edges: [&Vector<S>; 2]) -> S::M {
        let mut outside = simd.mask(0);
        for plane in 0..self.planes {
            let n = vector::splat(simd, self.normals[plane]);
            let a = simd.sub(vector::dot(simd, &n, corner), simd.splat(self.offsets[plane]));
            let (b, c) = (vector::dot(simd, &n, edges[0]), vector::dot(simd, &n, edges[1]));
            let nearest = simd.add(a, simd.min(simd.min(b, c), simd.splat(0.0)));
            outside = simd.or(outside, simd.lt(simd.splat(0.0), nearest));
        }
        outside
    }

    /// Lanes whose triangle lies outside the box of the open segments.
    #[inline(always)]
    pub fn beside<S: Simd>(&self, simd: S, corner: &Vector<S>, edges: [&Vector<S>; 2]) -> S::M {
        let (zero, mut outside) = (simd.splat(0.0), simd.mask(0));
        for axis in 0..3 {
            let (a, b) = (edges[0][axis], edges[1][axis]);
            let low = simd.add(corner[axis], simd.min(simd.min(a, b), zero));
            let high = simd.add(corner[axis], simd.max(simd.max(a, b), zero));
            outside = simd.or(outside, simd.lt(simd.splat(self.hi[axis]), low));
            outside = simd.or(outside, simd.lt(high, simd.splat(self.lo[axis])));
        }
        outside
    }

    /// Lanes whose triangle plane has all ends of the shaft on one side.
    #[inline(always)]
    pub fn on_one_side<S: Simd>(&self, simd: S, corner: &Vector<S>, normal: &Vector<S>) -> S::M {
        let size = vector::sum_abs(simd, normal);
        let (mut above, mut below) = (simd.mask(0xffff), simd.mask(0xffff));
        for (BoxEnds { centre, half }, slack) in self.ends.into_iter().zip(self.slack) {
            let to = vector::sub(simd, &vector::splat(simd, centre), corner);
            let height = vector::dot(simd, normal, &to);
            let mut reach = simd.mul(size, simd.splat(slack));
            for axis in 0..3 {
                reach = simd.sub(reach, simd.mul(simd.abs(normal[axis]), simd.splat(half[axis])));
            }
            // The lowest point is at height - (half · |n|) >= -slack: above the plane, or in the plane up to rounding.
            above = simd.and(above, simd.le(simd.sub(simd.splat(0.0), reach), height));
            below = simd.and(below, simd.le(height, reach));
        }
        simd.or(above, below)
    }
}
