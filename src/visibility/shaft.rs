//! The region that contains all segments of some bundles, and tests of boxes and triangles against it.
//!
//! A shaft is the bounding box of all ends with four side planes: through the common receiver end of one bundle (the
//! planes of Haines and Wallace 1994 for a point and an element), or along the boxes of the ends of several bundles.
//! Geometry outside the shaft blocks none of *these segments*. If the emitter is known, a shaft from a common receiver
//! end contains all segments to the whole emitter, so that its tests are certain for the emitter.
//!
//! The shaft of a whole emitter is wider by the height of lifted ends ([`EndRule::lifted`]).

mod hits;
#[cfg(test)]
mod tests;

use crate::ray::{EndRule, Packet};
use crate::simd::vector::{self, Vector};
use crate::simd::{LANES, Simd};
use glam::Vec3;

/// A box as centre and half extent, scene units.
#[derive(Clone, Copy)]
pub(super) struct BoxEnds {
    pub centre: Vec3,
    pub half: Vec3,
}

impl BoxEnds {
    fn of([lo, hi]: [Vec3; 2]) -> BoxEnds {
        BoxEnds { centre: 0.5 * (lo + hi), half: 0.5 * (hi - lo) }
    }

    /// From the smallest and largest coordinates per axis and lane.
    #[inline(always)]
    fn around<S: Simd>(simd: S, [x, y, z]: &[(S::F, S::F); 3]) -> BoxEnds {
        let lo = Vec3::new(simd.least(x.0), simd.least(y.0), simd.least(z.0));
        BoxEnds::of([lo, Vec3::new(simd.greatest(x.1), simd.greatest(y.1), simd.greatest(z.1))])
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
    pub ends: [BoxEnds; 2],
    /// Whether the shaft contains all segments between the common receiver end and the whole emitter.
    pub whole: bool,
    /// Widening of the box and of the side planes: bound on rounding errors of the scene's coordinates, scene units.
    widening: f32,
    /// Smallest bound on rounding errors at the receiver ends and at the emitter ends, scene units: what lies in front of an end by more
    /// may block.
    slack: [f32; 2],
    /// Largest margins at the receiver ends and at the emitter ends, as parameters and as lengths.
    margins: [f32; 2],
    lengths: [f32; 2],
    /// The common receiver end, if any.
    pub apex: Option<Vec3>,
    /// The pyramid around the segments, if there is a common receiver end and all segments run forward.
    pub pyramid: Option<Pyramid>,
    /// `axis · (x - receiver)` is the parameter t of a point, up to [`Shaft::spread`].
    axis: Vec3,
    /// Half width of the receiver ends and of the emitter ends along the axis, as parameters.
    spread: [f32; 2],
}

/// Smallest and largest bounds on rounding errors at the receiver ends and at the emitter ends of some packets, scene units.
#[inline(always)]
fn ends_slack(packets: &[Packet]) -> [[f32; 2]; 2] {
    [0, 1].map(|end| {
        let all = packets.iter().map(|packet| packet.slack[end]);
        let [least, most] = all.fold([f32::MAX, 0.0f32], |[a, b], [least, most]| [a.min(least), b.max(most)]);
        // Segments of which no rule is known leave out no length.
        [least.min(most), most]
    })
}

impl Shaft {
    /// The shaft of the active segments of `packets`, or of all segments to an emitter in the hull of `emitter` if
    /// that is not empty. `magnitude` is the largest absolute coordinate of the scene.
    #[inline(always)]
    pub fn of<S: Simd>(simd: S, packets: &[Packet], emitter: &[Vec3], magnitude: f32) -> Shaft {
        let some = packets.iter().find(|packet| !packet.is_empty()).unwrap_or(&packets[0]);
        let apex = some.point(some.active.trailing_zeros() as usize % LANES, 0.0);
        if !emitter.is_empty() {
            return Shaft::whole(simd, packets, emitter, apex, magnitude);
        }
        // Extremes per lane first, then once across lanes.
        let mut lanes = [[(simd.splat(f32::MAX), simd.splat(f32::MIN)); 3]; 2];
        let mut apart = simd.mask(0);
        let (mut near, mut far) = (simd.splat(0.0), simd.splat(1.0));
        for packet in packets {
            let [origin, direction] = filled(simd, packet);
            let margins = FromReceiver::of(simd, packet);
            let active = simd.mask(packet.active);
            near = simd.max(near, simd.keep(active, margins.near));
            far = simd.min(far, simd.select(active, margins.far, simd.splat(1.0)));
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
        let from = if shared { BoxEnds::of([apex, apex]) } else { BoxEnds::around(simd, &lanes[0]) };
        let to = BoxEnds::around(simd, &lanes[1]);
        let mut shaft = Shaft::between([from, to], magnitude);
        let slack = ends_slack(packets);
        shaft.slack = slack.map(|[least, _]| least);
        shaft.margins = [simd.greatest(near), 1.0 - simd.least(far)];
        shaft.lengths = shaft.lengths_left_out(slack);
        if shared {
            shaft.apex = Some(apex);
            shaft.add_pyramid(simd, packets, emitter, apex, 0.0);
        } else {
            shaft.add_planes();
        }
        shaft
    }

    /// The shaft of all segments from a point to an emitter, independent of the query's segments.
    ///
    /// Margins are the largest of any segment, for tests that need geometry to lie inside all segments.
    #[inline(always)]
    fn whole<S: Simd>(simd: S, packets: &[Packet], emitter: &[Vec3], apex: Vec3, magnitude: f32) -> Shaft {
        let slack = ends_slack(&packets[..1]);
        let rules = slack.map(|[_, most]| EndRule::of_slack(most));
        let height = rules[1].height();
        let (mut lo, mut hi) = (emitter[0], emitter[0]);
        for &p in emitter {
            (lo, hi) = (lo.min(p), hi.max(p));
        }
        let nearest = apex.clamp(lo, hi).distance(apex);
        let ends = [BoxEnds::of([apex, apex]), BoxEnds::of([lo, hi])];
        let mut shaft = Shaft::between(ends, magnitude);
        shaft.slack = slack.map(|[least, _]| least);
        shaft.margins = rules.map(|rule| rule.margin((nearest - height).max(0.0)));
        shaft.lengths = shaft.lengths_left_out(slack);
        (shaft.lo, shaft.hi) = (shaft.lo - height, shaft.hi + height);
        (shaft.whole, shaft.apex) = (true, Some(apex));
        shaft.add_pyramid(simd, packets, emitter, apex, height);
        shaft
    }

    /// The shaft that contains all of these shafts.
    ///
    /// # Panics
    /// If `shafts` is empty.
    pub fn around(shafts: &[Shaft]) -> Shaft {
        let ends = [0, 1].map(|end| {
            let boxes = shafts.iter().map(|s| s.ends[end].bounds());
            BoxEnds::of(boxes.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).expect("a shaft"))
        });
        let mut shaft = Shaft::between(ends, 0.0);
        shaft.widen(shafts.iter().map(|s| s.widening).fold(0.0, f32::max));
        for end in 0..2 {
            // Geometry that may block segments of one of the shafts must not be rejected for all.
            shaft.slack[end] = shafts.iter().map(|s| s.slack[end]).fold(f32::MAX, f32::min);
            shaft.margins[end] = shafts.iter().map(|s| s.margins[end]).fold(0.0, f32::max);
            shaft.lengths[end] = shafts.iter().map(|s| s.lengths[end]).fold(0.0, f32::max);
        }
        shaft.add_planes();
        shaft
    }

    fn widen(&mut self, by: f32) {
        (self.lo, self.hi, self.widening) = (self.lo - by, self.hi + by, self.widening + by);
    }

    /// Lengths that the longest segment leaves out at either end, with rounding; `slack` is [`ends_slack`].
    #[inline(always)]
    fn lengths_left_out(&self, slack: [[f32; 2]; 2]) -> [f32; 2] {
        let longest = self.longest();
        [0, 1].map(|end| 1.001 * self.margins[end] * longest + slack[end][1])
    }

    /// A shaft with box and axis, without side planes and margins. `magnitude` is the largest absolute coordinate of the scene.
    fn between(ends: [BoxEnds; 2], magnitude: f32) -> Shaft {
        let widening = EndRule::new(magnitude).slack();
        let along = ends[1].centre - ends[0].centre;
        // Of the directions that measure t, choose the one along which the ends spread least. For a panel parallel to
        // two coordinate axes that is the third axis, and t is exact.
        let mut axis = along / along.length_squared().max(f32::MIN_POSITIVE);
        let spread_along = |axis: Vec3| (ends[0].half + ends[1].half).dot(axis.abs());
        let mut smallest = spread_along(axis);
        for k in 0..3 {
            // For axes nearly perpendicular to the segments, rounding of coordinates would dominate.
            if along[k].abs() > 0.05 * along.length() {
                let candidate = Vec3::AXES[k] / along[k];
                if spread_along(candidate) < smallest {
                    (axis, smallest) = (candidate, spread_along(candidate));
                }
            }
        }
        let [a, b] = ends.map(BoxEnds::bounds);
        Shaft {
            lo: a[0].min(b[0]) - widening,
            hi: a[1].max(b[1]) + widening,
            normals: [Vec3::ZERO; 4],
            offsets: [0.0; 4],
            planes: 0,
            ends,
            whole: false,
            widening,
            slack: [0.0; 2],
            margins: [0.0; 2],
            lengths: [0.0; 2],
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
                + self.widening * normal.abs().element_sum();
        }
        self.planes = 4;
    }

    /// Adds side planes through the common point and the edges of the polygon or panel at the emitter end, else planes
    /// of extreme slopes relative to the mean direction. Segments end up to `lift` off the emitter.
    #[inline(always)]
    fn add_pyramid<S: Simd>(&mut self, simd: S, packets: &[Packet], emitter: &[Vec3], apex: Vec3, lift: f32) {
        let w = self.direction();
        if w == Vec3::ZERO {
            return;
        }
        let to = self.ends[1];
        let polygon = corners_of_polygon(emitter, apex);
        let corners =
            match if polygon.is_none() { corners_of_panel(to, apex, self.slack[1]) } else { polygon } {
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
            let slack = (self.widening + lift) * self.normals[k].abs().element_sum();
            self.offsets[k] = self.normals[k].dot(apex) + slack + rounding;
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
}

// Edges of the pyramid of a bundle: polygons, panels, and extreme slopes relative to the mean direction.

/// Largest ratio of lateral to forward components for which slopes are used: bounds the lengths of corners, on which
/// rounding depends, to √(1 + 2 · 10²) = 14. Wider bundles have no pyramid and reject less by their shafts.
const MAX_SLOPE: f32 = 10.0;

/// Vectors from `apex` to three or four points, if these in order are the edges of a convex pyramid.
#[inline(always)]
fn corners_of_polygon(points: &[Vec3], apex: Vec3) -> Option<[Vec3; 4]> {
    let corners = match *points {
        [a, b, c] => return Some([a - apex, b - apex, c - apex, c - apex]),
        [a, b, c, d] => [a - apex, b - apex, c - apex, d - apex],
        _ => return None,
    };
    // The other two corners lie on the same side of every side plane.
    let (mut left, mut right) = (true, true);
    for k in 0..4 {
        let side = corners[k].cross(corners[(k + 1) % 4] - corners[k]);
        let (a, b) = (side.dot(corners[(k + 2) % 4]), side.dot(corners[(k + 3) % 4]));
        left &= a > 0.0 && b > 0.0;
        right &= a < 0.0 && b < 0.0;
    }
    (left || right).then_some(corners)
}

/// Vectors from a point to the corners of a box without thickness, in order; `None` if the box is thicker than `slack`.
#[inline(always)]
fn corners_of_panel(to: BoxEnds, apex: Vec3, slack: f32) -> Option<[Vec3; 4]> {
    let flat = to.half.min_position();
    if to.half[flat] > slack {
        return None;
    }
    let (mut u, mut v) = (Vec3::ZERO, Vec3::ZERO);
    u[(flat + 1) % 3] = to.half[(flat + 1) % 3];
    v[(flat + 2) % 3] = to.half[(flat + 2) % 3];
    let middle = to.centre - apex;
    Some([middle - u - v, middle + u - v, middle + u + v, middle - u + v])
}

/// Smallest and largest slopes along u and v relative to w of the vectors from `apex` to some points.
#[inline(always)]
fn slopes_of_points(points: &[Vec3], apex: Vec3, [u, v, w]: [Vec3; 3]) -> Option<[[f32; 2]; 2]> {
    let (mut low, mut high) = ([f32::MAX; 2], [f32::MIN; 2]);
    for corner in points.iter().map(|&p| p - apex) {
        let forward = corner.dot(w);
        for (i, sideways) in [corner.dot(u), corner.dot(v)].into_iter().enumerate() {
            if sideways.abs() >= MAX_SLOPE * forward {
                return None;
            }
            let slope = sideways / forward;
            (low[i], high[i]) = (low[i].min(slope), high[i].max(slope));
        }
    }
    Some([low, high])
}

/// Smallest and largest slopes along u and v relative to w of the directions of all segments.
#[inline(always)]
fn slopes_of_segments<S: Simd>(simd: S, packets: &[Packet], [u, v, w]: [Vec3; 3]) -> Option<[[f32; 2]; 2]> {
    let mut slopes = [(simd.splat(f32::MAX), simd.splat(f32::MIN)); 2];
    for packet in packets {
        let [_, direction] = filled(simd, packet);
        let forward = vector::dot(simd, &vector::splat(simd, w), &direction);
        let steep = simd.mul(simd.splat(MAX_SLOPE), forward);
        let inverse = simd.div(simd.splat(1.0), forward);
        for (range, n) in slopes.iter_mut().zip([u, v]) {
            let sideways = vector::dot(simd, &vector::splat(simd, n), &direction);
            if simd.bits(simd.lt(simd.abs(sideways), steep)) != 0xffff {
                return None;
            }
            let slope = simd.mul(sideways, inverse);
            *range = (simd.min(range.0, slope), simd.max(range.1, slope));
        }
    }
    Some([slopes.map(|range| simd.least(range.0)), slopes.map(|range| simd.greatest(range.1))])
}

/// The segments of a packet from their receiver ends.
pub(super) struct FromReceiver<S: Simd> {
    pub origin: Vector<S>,
    pub direction: Vector<S>,
    /// Parameters between which triangles block.
    pub near: S::F,
    pub far: S::F,
}

impl<S: Simd> FromReceiver<S> {
    #[inline(always)]
    pub fn of(simd: S, packet: &Packet) -> FromReceiver<S> {
        let mut of = FromReceiver {
            origin: vector::load(simd, &packet.origin),
            direction: vector::load(simd, &packet.direction),
            near: simd.load(&packet.near),
            far: simd.load(&packet.far),
        };
        if packet.backwards != 0 {
            let back = simd.mask(packet.backwards);
            let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
            for axis in 0..3 {
                let (o, d) = (of.origin[axis], of.direction[axis]);
                of.origin[axis] = simd.select(back, simd.add(o, d), o);
                of.direction[axis] = simd.select(back, simd.sub(zero, d), d);
            }
            (of.near, of.far) = (
                simd.select(back, simd.sub(one, of.far), of.near),
                simd.select(back, simd.sub(one, of.near), of.far),
            );
        }
        of
    }
}

/// Ends of segments at the receiver, and directions from there; unused lanes repeat the first segment, so that reductions can use whole
/// registers.
#[inline(always)]
pub(super) fn filled<S: Simd>(simd: S, packet: &Packet) -> [Vector<S>; 2] {
    let FromReceiver { origin, direction, .. } = FromReceiver::of(simd, packet);
    if packet.active == 0xffff {
        return [origin, direction];
    }
    let first = packet.active.trailing_zeros() as usize % LANES;
    let active = simd.mask(packet.active);
    let start = packet.point(first, 0.0);
    let along = Vec3::from(packet.direction.map(|axis| axis[first]));
    let along = if packet.backwards >> first & 1 == 1 { -along } else { along };
    let mut filled = [origin, direction];
    for (filled, v) in filled.iter_mut().zip([start, along]) {
        for axis in 0..3 {
            filled[axis] = simd.select(active, filled[axis], simd.splat(v[axis]));
        }
    }
    filled
}
