//! Packets of segments, the rule for segment ends, and the interface of occlusion queries.

#[cfg(test)]
mod brute;

#[cfg(test)]
pub use brute::{Brute, HitResult};

use crate::math::sampling::Site;
use glam::Vec3;

/// Number of segments of a packet: one AVX-512 register of f32.
pub const LANES: usize = 16;

/// Up to 16 segments, one per lane, as rays: the ray of lane `i` is `origin + t * direction`, its ends are
/// `t = 0` and `t = 1`. Triangles at `near <= t <= far` block.
///
/// A ray is most exact where it starts, so a segment with smaller rounding errors at its emitter end runs from there to the receiver: its
/// lane is one of `backwards`.
///
/// Field order and layout equal those of `mrvis_packet` in `src/embree/shim.h`.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Packet {
    /// Start points by axis and lane, scene units.
    pub origin: [[f32; LANES]; 3],
    /// End minus start by axis and lane, scene units.
    pub direction: [[f32; LANES]; 3],
    /// Smallest parameter at which a triangle blocks.
    pub near: [f32; LANES],
    /// Largest parameter at which a triangle blocks.
    pub far: [f32; LANES],
    /// Mask of used lanes: bit `i` is set if lane `i` holds a segment. Unused lanes hold zeros.
    pub active: u32,
    /// Mask of lanes whose rays run from the emitter end to the receiver end.
    pub backwards: u32,
    /// Smallest and largest `EndRule::slack` at the receiver ends and at the emitter ends, scene units.
    pub slack: [[f32; 2]; 2],
}

impl Packet {
    /// A packet without segments.
    pub const EMPTY: Packet = Packet {
        origin: [[0.0; LANES]; 3],
        direction: [[0.0; LANES]; 3],
        near: [0.0; LANES],
        far: [0.0; LANES],
        active: 0,
        backwards: 0,
        slack: [[f32::MAX, 0.0]; 2],
    };

    /// Stores the segment from `a` to `b` in a lane. The surfaces at the ends are unknown; `rule` holds for both.
    #[inline]
    pub fn set(&mut self, lane: usize, a: Vec3, b: Vec3, rule: EndRule) {
        self.set_unknown(lane, a, b, [rule; 2]);
    }

    /// Stores the segment from `a` to `b` in a lane. The surfaces at the ends have no known normals. The second rule is
    /// [`EndRule::seen_from`] the first.
    #[inline]
    pub fn set_unknown(&mut self, lane: usize, a: Vec3, b: Vec3, rules: [EndRule; 2]) {
        self.set_from_better_end(lane, [a, b], rules, EndRule::margin);
        self.widen(rules);
    }

    /// Stores the segment from `a` to `b` in a lane, both from [`EndRule::lifted`] with these rules, the second of which is
    /// [`EndRule::seen_from`] the first.
    #[inline]
    pub fn set_lifted(&mut self, lane: usize, a: Vec3, b: Vec3, rules: [EndRule; 2]) {
        self.set_from_better_end(lane, [a, b], rules, EndRule::rounding);
        self.widen(rules);
    }

    /// As [`Packet::set_lifted`], but nothing is left out at the start `a`, so that a wall closer to it than r blocks the segment. `a`
    /// must lie on no edge between surfaces, where the wall would block both sides: it is a point drawn on an element or the end of
    /// another ray. If the ray starts from `b`, r is left out at `a` all the same.
    #[inline]
    pub fn set_blocked_from_start(&mut self, lane: usize, a: Vec3, b: Vec3, rules: [EndRule; 2]) {
        self.set_lifted(lane, a, b, rules);
        if self.backwards >> lane & 1 == 0 {
            self.near[lane] = 0.0;
        }
    }

    /// Stores the segment from `a` to `b` in a lane, with the parameters between which triangles block.
    #[inline]
    pub fn set_between(&mut self, lane: usize, a: Vec3, b: Vec3, [near, far]: [f32; 2]) {
        let d = b - a;
        for axis in 0..3 {
            self.origin[axis][lane] = a[axis];
            self.direction[axis][lane] = d[axis];
        }
        (self.near[lane], self.far[lane]) = (near, far);
        self.active |= 1 << lane;
        self.backwards &= !(1 << lane);
    }

    #[inline]
    fn set_from_better_end(
        &mut self,
        lane: usize,
        [a, b]: [Vec3; 2],
        rules: [EndRule; 2],
        margin: fn(EndRule, f32) -> f32,
    ) {
        let length = a.distance(b);
        let [first, last] = rules.map(|rule| margin(rule, length));
        if rules[1].reach < rules[0].reach {
            self.set_between(lane, b, a, [last, 1.0 - first]);
            self.backwards |= 1 << lane;
        } else {
            self.set_between(lane, a, b, [first, 1.0 - last]);
        }
    }

    /// Widens the range of [`EndRule::slack`] of the first packet to that of all of them.
    pub fn share_slack(packets: &mut [Packet]) {
        if let Some((first, rest)) = packets.split_first_mut() {
            for packet in rest {
                for ([least, most], [own_least, own_most]) in first.slack.iter_mut().zip(packet.slack) {
                    (*least, *most) = (least.min(own_least), most.max(own_most));
                }
            }
        }
    }

    #[inline]
    fn widen(&mut self, rules: [EndRule; 2]) {
        for ([least, most], rule) in self.slack.iter_mut().zip(rules) {
            (*least, *most) = (least.min(rule.slack()), most.max(rule.slack()));
        }
    }

    /// Stores the infinite ray from `origin` along the unit vector `direction` in a lane; parameters are lengths.
    #[inline]
    pub fn set_ray(&mut self, lane: usize, origin: Vec3, direction: Vec3) {
        for (axis, (o, d)) in origin.to_array().into_iter().zip(direction.to_array()).enumerate() {
            self.origin[axis][lane] = o;
            self.direction[axis][lane] = d;
        }
        self.near[lane] = 0.0;
        self.far[lane] = f32::INFINITY;
        self.active |= 1 << lane;
        self.backwards &= !(1 << lane);
    }

    /// The point of a lane at parameter `t` from the receiver end, 0, to the emitter end, 1.
    #[inline]
    pub fn point(&self, lane: usize, t: f32) -> Vec3 {
        let t = if self.backwards >> lane & 1 == 1 { 1.0 - t } else { t };
        let o = Vec3::new(self.origin[0][lane], self.origin[1][lane], self.origin[2][lane]);
        let d = Vec3::new(self.direction[0][lane], self.direction[1][lane], self.direction[2][lane]);
        o + t * d
    }

    /// Number of segments, 0 to 16.
    #[inline]
    pub fn len(&self) -> usize {
        self.active.count_ones() as usize
    }

    /// Whether no lane is used.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.active == 0
    }

    /// Used lanes in ascending order.
    #[inline]
    pub fn lanes(&self) -> Lanes {
        Lanes(self.active)
    }
}

/// Sorts points so that each run of [`LANES`] points is compact, and within the run each group of four and of two, by
/// repeated median splits along the longest side of the bounding box. Segments from one point to the points of a run
/// then form coherent packets. Each point has its end rule.
pub fn gather_neighbours(points: &mut [(Vec3, EndRule)]) {
    let run = if points.len() > LANES { LANES } else { 2 };
    let runs = points.len().div_ceil(run);
    if runs < 2 {
        return;
    }
    let (lo, hi) = points.iter().fold((points[0].0, points[0].0), |(lo, hi), &(p, _)| (lo.min(p), hi.max(p)));
    let axis = (hi - lo).max_position();
    let half = runs / 2 * run;
    points.select_nth_unstable_by(half, |a, b| a.0[axis].total_cmp(&b.0[axis]));
    let (near, far) = points.split_at_mut(half);
    gather_neighbours(near);
    gather_neighbours(far);
}

/// Iterator over the set bits of a lane mask, ascending.
#[derive(Clone, Copy, Debug)]
pub struct Lanes(pub u32);

impl Iterator for Lanes {
    type Item = usize;

    #[inline]
    fn next(&mut self) -> Option<usize> {
        (self.0 != 0).then(|| {
            let lane = self.0.trailing_zeros() as usize;
            self.0 &= self.0 - 1;
            lane
        })
    }
}

/// The rule for an end of a segment, shared by all engines: keeps the surface at the end from blocking (docs/method.md, Segment ends).
///
/// It follows from the faces at the ends alone: not from the length of the segment, nor from the size of the scene. `M` is the largest
/// coordinate magnitude of the face at the end and of the faces that share a vertex with it, and r = 4e-7 M, a bound on rounding
/// errors: 6.7 units of 2⁻²⁴ M, for the coordinates of a point and of three corners.
///
/// Ends on surfaces with known normals are lifted by 5 r along their normals, and the segment leaves out a length of r at both
/// ends, none at a start by [`Packet::set_blocked_from_start`]. Of other segments a length of 16 r is left out: the surface at an end does
/// not block them if their angle with it exceeds asin(1/16) = 3.6°, even if the end lies r off the surface.
///
/// Rounding of a ray grows with the distance from its start, to that of the coordinates of both ends. So a ray starts at the end with
/// the smaller M; its other end has the rounding errors of its own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EndRule {
    /// r, scene units.
    reach: f32,
}

impl EndRule {
    /// Largest margin, as a parameter of the segment: segments shorter than 20 margins keep 90 % of their length.
    pub const MAX_MARGIN: f32 = 0.05;
    /// r over the magnitude of coordinates.
    const ROUNDING: f32 = 4e-7;
    /// Height of lifted ends in units of r: intersections with triangles as large as their coordinates err by up to 3 r (4 roundings of
    /// products of coordinates up to 2 √3 M), points on surfaces by r.
    const LIFT: f32 = 5.0;
    /// Length left out at ends of unknown surfaces in units of r; see [`EndRule`].
    const UNKNOWN: f32 = 16.0;
    /// Largest ratio of the r of both ends with which a segment is tested from its first end all the same, so that the rays of a bundle
    /// keep their common start: in a room of 8 m, where r is up to 3 µm, this holds for all faces that reach further than .5 m from
    /// the origin.
    const MAX_RATIO: f32 = 16.0;

    /// The rule of an end at faces whose coordinates do not exceed `magnitude`, scene units.
    pub fn new(magnitude: f32) -> EndRule {
        EndRule { reach: Self::ROUNDING * magnitude }
    }

    /// The magnitude of coordinates at which ends are lifted by this height, scene units.
    pub fn magnitude_of_height(height: f32) -> f32 {
        height / (Self::LIFT * Self::ROUNDING)
    }

    /// The rule with a known r, scene units.
    #[inline]
    pub fn of_slack(slack: f32) -> EndRule {
        EndRule { reach: slack }
    }

    /// The rule of this end for a segment that begins at an end with the rule `from`: r is no less than there, unless it is less by more
    /// than a factor of 16 and the segment is tested from this end.
    #[inline]
    pub fn seen_from(self, from: EndRule) -> EndRule {
        EndRule { reach: if self.is_close_to(from) { self.reach.max(from.reach) } else { self.reach } }
    }

    /// r, the bound on rounding errors of the coordinates at the end, scene units.
    #[inline]
    pub fn slack(self) -> f32 {
        self.reach
    }

    /// Height of lifted ends above their surfaces, scene units.
    #[inline]
    pub fn height(self) -> f32 {
        Self::LIFT * self.slack()
    }

    /// Height above the plane of one of two surfaces, with the other's rule, up to which a point of the other may lie in that plane:
    /// both points err by up to r.
    #[inline]
    pub fn rounding_of_heights(self, other: EndRule) -> f32 {
        2.0 * self.reach.max(other.reach)
    }

    /// A point of a surface, lifted on the side of the unit vector `normal`.
    #[inline]
    pub fn lifted(self, at: Vec3, normal: Vec3) -> Vec3 {
        at + self.height() * normal
    }

    /// A point of a surface, lifted on the side that `from` lies on.
    #[inline]
    pub fn lifted_towards(self, at: Vec3, normal: Vec3, from: Vec3) -> Vec3 {
        at + self.height().copysign(normal.dot(from - at)) * normal
    }

    /// The other end of a segment from `from`, a lifted point with this rule, at a point of a surface, with its own rule.
    #[inline]
    pub fn other_end(self, from: Vec3, Site { position, normal, magnitude }: Site) -> (Vec3, EndRule) {
        let there = EndRule::new(magnitude).seen_from(self);
        (there.lifted_towards(position, normal, from), there)
    }

    /// Length that segments leave out at an end on an unknown surface, scene units.
    pub fn left_out(self) -> f32 {
        Self::UNKNOWN * self.slack()
    }

    /// Whether r is no less than that of another rule by more than a factor of 16, the ratio up to which ends share the larger one.
    pub fn is_close_to(self, larger: EndRule) -> bool {
        larger.reach <= Self::MAX_RATIO * self.reach
    }

    /// Margin at the end of a segment of this length (scene units) at an unknown surface, a parameter in `(0, 0.05]`.
    #[inline]
    pub fn margin(self, length: f32) -> f32 {
        // `min` also replaces the NaN of a segment of length 0.
        (self.left_out() / length).min(Self::MAX_MARGIN)
    }

    /// Part of a segment of this length that is left out at a lifted end.
    #[inline]
    pub fn rounding(self, length: f32) -> f32 {
        (self.slack() / length).min(Self::MAX_MARGIN)
    }
}

/// An engine that answers occlusion queries.
pub trait Occluder: Sync {
    /// Sets `blocked[k]` to the mask of blocked lanes of `packets[k]`. Unused lanes are reported as not blocked.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn occluded(&self, packets: &[Packet], blocked: &mut [u32]);
}
