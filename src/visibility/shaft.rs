//! The region that contains all segments of some bundles, and tests of boxes and triangles against it.
//!
//! A shaft is the bounding box of all ends with four side planes: through the common receiver end of one bundle (the
//! planes of Haines and Wallace 1994 for a point and an element), or along the boxes of the ends of several bundles.
//! Geometry outside the shaft blocks none of *these segments*. If the emitter is known, a shaft from a common receiver
//! end contains all segments to the whole emitter, so that its tests are certain for the emitter.
//!
//! Segments leave out margins of at least [`EndRule::MIN_MARGIN`] at their ends, and so does that shaft: a frame that
//! starts at the emitter's edge is outside unless it hides a part of the emitter.

mod slopes;

use super::wide::Node;
use crate::ray::{EndRule, Packet};
use crate::simd::vector::{self, Vector};
use crate::simd::{LANES, Simd};
use glam::Vec3;
pub(super) use slopes::filled;
use slopes::{corners_of_panel, corners_of_polygon, slopes_of_points, slopes_of_segments};

/// A box as centre and half extent, scene units.
#[derive(Clone, Copy)]
pub(super) struct Ends {
    pub centre: Vec3,
    pub half: Vec3,
}

impl Ends {
    fn of([lo, hi]: [Vec3; 2]) -> Ends {
        Ends { centre: 0.5 * (lo + hi), half: 0.5 * (hi - lo) }
    }

    /// From the smallest and largest coordinates per axis and lane.
    #[inline(always)]
    fn around<S: Simd>(simd: S, [x, y, z]: &[(S::F, S::F); 3]) -> Ends {
        let lo = Vec3::new(simd.least(x.0), simd.least(y.0), simd.least(z.0));
        Ends::of([lo, Vec3::new(simd.greatest(x.1), simd.greatest(y.1), simd.greatest(z.1))])
    }

    pub fn bounds(self) -> [Vec3; 2] {
        [self.centre - self.half, self.centre + self.half]
    }

    /// Largest `n · x` over the points of the box.
    fn reach(self, n: Vec3) -> f32 {
        self.centre.dot(n) + self.half.dot(n.abs())
    }
}

/// The pyramid around a bundle whose segments share their receiver end.
#[derive(Clone, Copy)]
pub(super) struct Pyramid {
    pub apex: Vec3,
    /// Vectors from the apex along its four edges.
    pub corners: [Vec3; 4],
    /// Length of the longest of them.
    pub longest: f32,
}

#[derive(Clone)]
pub(super) struct Shaft {
    lo: Vec3,
    hi: Vec3,
    /// Inside is `normal · x <= offset` for the first `planes` planes.
    pub normals: [Vec3; 4],
    offsets: [f32; 4],
    pub planes: usize,
    /// Boxes of the receiver ends and of the emitter ends.
    pub ends: [Ends; 2],
    /// Whether the shaft contains all segments between the common receiver end and the whole emitter.
    pub whole: bool,
    /// Bound on rounding errors of the scene's coordinates, scene units.
    pub slack: f32,
    /// Largest `near` of the segments.
    near: f32,
    /// The common receiver end, if any.
    pub apex: Option<Vec3>,
    /// The pyramid around the segments, if there is a common receiver end and all segments run forward.
    pub pyramid: Option<Pyramid>,
    /// `axis · (x - receiver)` is the parameter t of a point, up to [`Shaft::spread`].
    axis: Vec3,
    /// Half width of the receiver ends and of the emitter ends along the axis, as parameters.
    spread: [f32; 2],
}

impl Shaft {
    /// The shaft of the active segments of `packets`, or of all segments to an emitter in the hull of `emitter` if
    /// that is not empty. `magnitude` is the largest absolute coordinate of the scene.
    #[inline(always)]
    pub fn of<S: Simd>(simd: S, packets: &[Packet], emitter: &[Vec3], magnitude: f32) -> Shaft {
        let some = packets.iter().find(|packet| !packet.is_empty()).unwrap_or(&packets[0]);
        let apex = some.point(some.active.trailing_zeros() as usize % LANES, 0.0);
        let slack = 4e-7 * magnitude;
        if !emitter.is_empty() {
            return Shaft::whole(simd, packets, emitter, apex, slack);
        }
        // Extremes per lane first, then once across lanes.
        let mut lanes = [[(simd.splat(f32::MAX), simd.splat(f32::MIN)); 3]; 2];
        let mut apart = simd.mask(0);
        let mut near = simd.splat(0.0);
        for packet in packets {
            let (origin, direction) = filled(simd, packet);
            near = simd.max(near, simd.load(&packet.near));
            for axis in 0..3 {
                let o = origin[axis];
                let differs = simd.abs(simd.sub(o, simd.splat(apex[axis])));
                apart = simd.or(apart, simd.lt(simd.splat(0.0), differs));
                for (end, v) in lanes.iter_mut().zip([o, simd.add(o, direction[axis])]) {
                    let (lo, hi) = &mut end[axis];
                    (*lo, *hi) = (simd.min(*lo, v), simd.max(*hi, v));
                }
            }
        }
        let shared = simd.bits(apart) == 0;
        let from = if shared { Ends::of([apex, apex]) } else { Ends::around(simd, &lanes[0]) };
        let to = Ends::around(simd, &lanes[1]);
        let mut shaft = Shaft::between([from, to], slack, simd.greatest(near));
        if shared {
            shaft.apex = Some(apex);
            shaft.add_pyramid(simd, packets, emitter, apex);
        } else {
            shaft.add_planes();
        }
        shaft
    }

    /// The shaft of all segments from a point to an emitter, independent of the query's segments.
    ///
    /// The shaft leaves out the smallest margin of the [`EndRule`]; `near` is the margin of the shortest segment, for
    /// tests that need geometry to lie inside all segments.
    #[inline(always)]
    fn whole<S: Simd>(simd: S, packets: &[Packet], emitter: &[Vec3], apex: Vec3, slack: f32) -> Shaft {
        let (mut lo, mut hi) = (emitter[0], emitter[0]);
        for &p in emitter {
            (lo, hi) = (lo.min(p), hi.max(p));
        }
        let nearest = apex.clamp(lo, hi).distance(apex);
        let near = EndRule::MAX_MARGIN.min(EndRule::MIN_MARGIN + slack / nearest);
        let mut shaft = Shaft::between([Ends::of([apex, apex]), Ends::of([lo, hi])], slack, near);
        // Half of the margin allows for rounding in this function.
        let open = 0.5 * EndRule::MIN_MARGIN;
        let (to_lo, to_hi) = (lo - apex, hi - apex);
        shaft.lo = (apex + open * to_lo).min(apex + (1.0 - open) * to_lo) - slack;
        shaft.hi = (apex + open * to_hi).max(apex + (1.0 - open) * to_hi) + slack;
        (shaft.whole, shaft.apex) = (true, Some(apex));
        shaft.add_pyramid(simd, packets, emitter, apex);
        shaft
    }

    /// The shaft that contains all of these shafts.
    ///
    /// # Panics
    /// If `shafts` is empty.
    pub fn around(shafts: &[Shaft]) -> Shaft {
        let ends = [0, 1].map(|end| {
            let boxes = shafts.iter().map(|s| s.ends[end].bounds());
            Ends::of(boxes.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).expect("a shaft"))
        });
        let near = shafts.iter().map(|s| s.near).fold(0.0, f32::max);
        let mut shaft = Shaft::between(ends, shafts[0].slack, near);
        shaft.add_planes();
        shaft
    }

    /// A shaft with box and axis, without side planes.
    fn between(ends: [Ends; 2], slack: f32, near: f32) -> Shaft {
        let along = ends[1].centre - ends[0].centre;
        // Of the directions that measure t, choose the one along which the ends spread least. For a panel parallel to
        // two coordinate axes that is the third axis, and t is exact.
        let mut axis = along / along.length_squared().max(f32::MIN_POSITIVE);
        let spread_along = |axis: Vec3| (ends[0].half + ends[1].half).dot(axis.abs());
        let mut least = spread_along(axis);
        for k in 0..3 {
            // For axes nearly perpendicular to the segments, rounding of coordinates would dominate.
            if along[k].abs() > 0.05 * along.length() {
                let candidate = Vec3::AXES[k] / along[k];
                if spread_along(candidate) < least {
                    (axis, least) = (candidate, spread_along(candidate));
                }
            }
        }
        let [a, b] = ends.map(Ends::bounds);
        Shaft {
            lo: a[0].min(b[0]) - slack,
            hi: a[1].max(b[1]) + slack,
            normals: [Vec3::ZERO; 4],
            offsets: [0.0; 4],
            planes: 0,
            ends,
            whole: false,
            slack,
            near,
            apex: None,
            pyramid: None,
            axis,
            spread: ends.map(|end| end.half.dot(axis.abs())),
        }
    }

    /// Adds side planes along the boxes of the ends. Any slope is conservative, because the offset is that of the
    /// outermost corner; this slope touches both boxes.
    fn add_planes(&mut self) {
        let along = self.ends[1].centre - self.ends[0].centre;
        let w = along.normalize_or_zero();
        if w == Vec3::ZERO {
            return;
        }
        let (u, v) = w.any_orthonormal_pair();
        let width = |end: usize, n: Vec3| self.ends[end].half.dot(n.abs());
        for (k, n) in [u, -u, v, -v].into_iter().enumerate() {
            let slope = (width(1, n) - width(0, n)) / along.length();
            let normal = n - slope * w;
            self.normals[k] = normal;
            self.offsets[k] = self.ends[0].reach(normal).max(self.ends[1].reach(normal))
                + self.slack * normal.abs().element_sum();
        }
        self.planes = 4;
    }

    /// Adds side planes through the common point and the edges of the polygon or panel at the emitter end, else planes
    /// of extreme slopes relative to the mean direction.
    #[inline(always)]
    fn add_pyramid<S: Simd>(&mut self, simd: S, packets: &[Packet], emitter: &[Vec3], apex: Vec3) {
        let w = self.direction();
        if w == Vec3::ZERO {
            return;
        }
        let to = self.ends[1];
        let polygon = corners_of_polygon(emitter, apex);
        let corners = match if polygon.is_none() { corners_of_panel(to, apex, self.slack) } else { polygon } {
            Some(corners) => corners,
            None => {
                let w = w.normalize();
                let (u, v) = w.any_orthonormal_pair();
                let slopes = match self.whole {
                    true => slopes_of_points(emitter, apex, [u, v, w]),
                    false => slopes_of_segments(simd, packets, [u, v, w]),
                };
                let Some([low, high]) = slopes else { return };
                let ([left, right], [down, up]) = ([low[0] * u, high[0] * u], [low[1] * v, high[1] * v]);
                [w + left + down, w + right + down, w + right + up, w + left + up]
            }
        };
        let [a, b, c, d] = corners;
        let longest =
            a.length_squared().max(b.length_squared()).max(c.length_squared()).max(d.length_squared()).sqrt();
        for k in 0..4 {
            // The product of two long, nearly equal vectors would lose digits; the difference keeps them.
            let (corner, edge) = (corners[k], corners[(k + 1) % 4] - corners[k]);
            let n = corner.cross(edge);
            let rounding =
                4.0 * f32::EPSILON * corner.abs().element_sum() * edge.abs().element_sum() * longest;
            // The other corners lie inside; a plane for which rounding decides is dropped.
            let inside = n.dot(corners[(k + 2) % 4] + corners[(k + 3) % 4]);
            let sign = if inside.abs() <= 2.0 * rounding { 0.0 } else { -inside.signum() };
            self.normals[k] = sign * n;
            self.offsets[k] =
                self.normals[k].dot(apex) + self.slack * self.normals[k].abs().element_sum() + rounding;
        }
        self.planes = 4;
        self.pyramid = Some(Pyramid { apex, corners, longest });
    }

    /// Vector from the centre of the receiver ends to the centre of the emitter ends, scene units.
    pub fn direction(&self) -> Vec3 {
        self.ends[1].centre - self.ends[0].centre
    }

    /// Upper bound of the segments' lengths, scene units.
    #[inline(always)]
    pub fn longest(&self) -> f32 {
        self.direction().length() + (self.ends[0].half + self.ends[1].half).length()
    }

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
    pub fn places<S: Simd>(&self, simd: S, node: &Node) -> S::F {
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
        let margin = simd.splat(1.001 * self.near + 1e-6);
        simd.and(simd.lt(margin, first), simd.lt(simd.add(last, margin), simd.splat(1.0)))
    }

    /// Children that may be aggregated: their feature size is below `s (1 - t) + e t` at the less favourable end of
    /// the box for every segment, and no segment ends inside (docs/method.md, Umbra criterion, and Segment ends).
    #[inline(always)]
    pub fn aggregates<S: Simd>(&self, simd: S, node: &Node, sizes: S::F, e: f32, s: f32) -> u32 {
        let (mut low, mut high) = (simd.splat(0.0), simd.splat(0.0));
        let from = self.ends[0];
        // The margin of the end rule as a length, for the longest segment.
        let margin = 1.001 * self.near * self.longest() + self.slack;
        let mut holds = [simd.mask(0xffff); 2];
        for axis in 0..3 {
            let (min, max) = (simd.load(&node.min[axis]), simd.load(&node.max[axis]));
            let (n, centre) = (simd.splat(self.axis[axis]), simd.splat(from.centre[axis]));
            let a = simd.mul(n, simd.sub(min, centre));
            let b = simd.mul(n, simd.sub(max, centre));
            low = simd.add(low, simd.min(a, b));
            high = simd.add(high, simd.max(a, b));
            for (holds, end) in holds.iter_mut().zip(&self.ends) {
                let upper = simd.splat(end.centre[axis] + end.half[axis] + margin);
                let lower = simd.splat(end.centre[axis] - end.half[axis] - margin);
                *holds = simd.and(*holds, simd.and(simd.le(min, upper), simd.le(lower, max)));
            }
        }
        let (first, last) = self.parameters(simd, low, high);
        let t = if e > s { first } else { last };
        let threshold = simd.fma(simd.splat(e - s), t, simd.splat(s));
        let before_emitter = simd.lt(last, simd.splat(1.0 - 1.001 * self.near - 1e-6));
        let ends_inside = simd.or(holds[0], simd.and_not(holds[1], before_emitter));
        simd.bits(simd.and_not(simd.lt(sizes, threshold), ends_inside))
    }

    /// Children of a node that may touch the shaft.
    #[inline(always)]
    pub fn touches<S: Simd>(&self, simd: S, node: &Node) -> u32 {
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
        let slack = simd.mul(vector::sum_abs(simd, normal), simd.splat(self.slack));
        let (mut above, mut below) = (simd.mask(0xffff), simd.mask(0xffff));
        for Ends { centre, half } in self.ends {
            let to = vector::sub(simd, &vector::splat(simd, centre), corner);
            let height = vector::dot(simd, normal, &to);
            let mut reach = slack;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Isa, Kernel, dispatch};

    struct Make<'a>(&'a [Packet], &'a [Vec3]);

    impl Kernel for Make<'_> {
        type Output = Shaft;

        fn run<S: Simd>(self, simd: S) -> Shaft {
            Shaft::of(simd, self.0, self.1, 60.0)
        }
    }

    /// Emitters that are small relative to their distance, off all axes, as polygons, panels and unordered points.
    #[test]
    fn small_lamps_far_away_are_held_whole() {
        let apex = Vec3::new(0.1, 0.2, 0.3);
        for width in [1.0f32, 0.1, 0.03, 0.01] {
            for (u, v) in [(Vec3::X, Vec3::Y), (Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.48, 0.8, 0.36))] {
                for centre in
                    [Vec3::new(33.3, 31.7, 35.1), Vec3::new(-50.0, 3.0, 1.0), Vec3::new(0.3, -7.0, 40.0)]
                {
                    let (u, v) = (0.5 * width * u, 0.5 * width * v);
                    let quad = [centre - u - v, centre + u - v, centre + u + v, centre - u + v];
                    let twice = [quad, quad.map(|p| p + 0.3 * (u + v))].concat();
                    for emitter in [&quad[..], &quad[..3], &twice[..]] {
                        let mut packet = Packet::EMPTY;
                        packet.set(0, apex, emitter[0], EndRule::new(60.0));
                        let shaft = dispatch(Isa::Portable, Make(&[packet], emitter));
                        for (normal, offset) in shaft.normals.iter().zip(shaft.offsets).take(shaft.planes) {
                            for &p in emitter {
                                let beyond = normal.as_dvec3().dot(p.as_dvec3()) - f64::from(offset);
                                assert!(
                                    beyond <= 0.0,
                                    "{width} {centre}: {p} is {beyond} outside of {normal}"
                                );
                            }
                        }
                    }
                }
            }
        }
    }
}
