//! Segments in packets, the one rule for their ends, and the question whether something lies in between.

mod brute;

pub use brute::{Brute, Verdict};

use glam::Vec3;

/// Segments a packet holds: one AVX-512 register of f32.
pub const LANES: usize = 16;

/// Up to 16 segments, one a lane. The point of lane `i` at parameter `t` is `origin + t * direction`, so that
/// `t = 0` and `t = 1` are the ends; what blocks at `near <= t <= far` counts.
///
/// Field order and layout are those of `mrvis_packet` in `ffi/embree/shim.h`.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Packet {
    /// Start points by axis, scene units.
    pub origin: [[f32; LANES]; 3],
    /// End minus start by axis, scene units.
    pub direction: [[f32; LANES]; 3],
    /// Where the open segment begins.
    pub near: [f32; LANES],
    /// Where the open segment ends.
    pub far: [f32; LANES],
    /// Bit `i`: lane `i` holds a segment. Unused lanes hold zeros.
    pub active: u32,
}

impl Packet {
    /// A packet without segments.
    pub const EMPTY: Packet = Packet {
        origin: [[0.0; LANES]; 3],
        direction: [[0.0; LANES]; 3],
        near: [0.0; LANES],
        far: [0.0; LANES],
        active: 0,
    };

    /// Puts the segment from `a` to `b` into a lane.
    #[inline]
    pub fn set(&mut self, lane: usize, a: Vec3, b: Vec3, ends: EndRule) {
        let d = b - a;
        for (axis, (o, v)) in a.to_array().into_iter().zip(d.to_array()).enumerate() {
            self.origin[axis][lane] = o;
            self.direction[axis][lane] = v;
        }
        let margin = ends.margin(d.length());
        self.near[lane] = margin;
        self.far[lane] = 1.0 - margin;
        self.active |= 1 << lane;
    }

    /// Puts the ray from `origin` along the unit vector `direction`, without end, into a lane: parameters are lengths.
    #[inline]
    pub fn set_ray(&mut self, lane: usize, origin: Vec3, direction: Vec3) {
        for (axis, (o, d)) in origin.to_array().into_iter().zip(direction.to_array()).enumerate() {
            self.origin[axis][lane] = o;
            self.direction[axis][lane] = d;
        }
        self.near[lane] = 0.0;
        self.far[lane] = f32::INFINITY;
        self.active |= 1 << lane;
    }

    /// The point of a lane at parameter `t`.
    #[inline]
    pub fn point(&self, lane: usize, t: f32) -> Vec3 {
        let o = Vec3::new(self.origin[0][lane], self.origin[1][lane], self.origin[2][lane]);
        let d = Vec3::new(self.direction[0][lane], self.direction[1][lane], self.direction[2][lane]);
        o + t * d
    }

    /// Number of segments.
    #[inline]
    pub fn len(&self) -> usize {
        self.active.count_ones() as usize
    }

    /// Whether there is no segment.
    pub fn is_empty(&self) -> bool {
        self.active == 0
    }

    /// Lanes that hold a segment, ascending.
    #[inline]
    pub fn lanes(&self) -> Lanes {
        Lanes(self.active)
    }
}

/// Orders points so that each run of [`LANES`] of them lies close together, and within it each run of four and of two: halves along
/// the longer side of their box, again and again. Segments from one place to these, in this order, make packets that meet
/// the same things.
pub fn gather_neighbours(points: &mut [Vec3]) {
    let run = if points.len() > LANES { LANES } else { 2 };
    let runs = points.len().div_ceil(run);
    if runs < 2 {
        return;
    }
    let (lo, hi) = points.iter().fold((points[0], points[0]), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    let axis = (hi - lo).max_position();
    let half = runs / 2 * run;
    points.select_nth_unstable_by(half, |a, b| a[axis].total_cmp(&b[axis]));
    let (near, far) = points.split_at_mut(half);
    gather_neighbours(near);
    gather_neighbours(far);
}

/// The set bits of a lane mask, ascending.
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

/// The one rule that keeps the end points' own surfaces out, shared by every engine (method D.21).
///
/// A segment of length `L` is open by the margin `1e-4 + 4e-7 M / L` (in parameters) at both ends, at most 0.05,
/// where `M` is the largest coordinate magnitude of the scene: the first term is the measured break-even of false
/// self-hits and lost blockers, the second is a few roundings of the coordinates themselves.
#[derive(Clone, Copy, Debug)]
pub struct EndRule {
    magnitude: f32,
}

impl EndRule {
    /// No segment is open by less than this at either end, and none by more than [`EndRule::MAX_MARGIN`]; parameters.
    pub const MIN_MARGIN: f32 = 1e-4;
    /// See [`EndRule::MIN_MARGIN`].
    pub const MAX_MARGIN: f32 = 0.05;

    /// The rule for a scene whose coordinates do not exceed `magnitude`.
    pub fn new(magnitude: f32) -> EndRule {
        EndRule { magnitude }
    }

    /// A few roundings of the scene's coordinates, scene units.
    pub fn slack(self) -> f32 {
        4e-7 * self.magnitude
    }

    /// Margin at either end of a segment of this length, a parameter in `(0, 0.05]`.
    #[inline]
    pub fn margin(self, length: f32) -> f32 {
        // `min` also mends the NaN of a segment without length.
        (Self::MIN_MARGIN + self.slack() / length).min(Self::MAX_MARGIN)
    }
}

/// Something that can block segments.
pub trait Occluder: Sync {
    /// For each packet the lanes that are blocked. Inactive lanes are reported clear.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn occluded(&self, packets: &[Packet], blocked: &mut [u32]);
}
