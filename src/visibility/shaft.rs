//! The space that holds all segments of a packet, and what cannot touch it.
//!
//! The union box of all ends, and where the segments share their receiver end also the four side planes of the
//! pyramid around them (the planes of Haines' shaft for a point and an element). A statement about *these
//! segments*: what lies outside blocks none of them.

use super::wide::{Block, Node};
use crate::ray::Packet;
use crate::simd::{LANES, Simd};
use glam::Vec3;

pub(super) struct Shaft {
    lo: Vec3,
    hi: Vec3,
    /// Inside is `normal · x <= offset` for the first `planes` of them.
    normals: [Vec3; 4],
    offsets: [f32; 4],
    planes: usize,
    /// Boxes of the receiver ends and of the emitter ends: centre and half extent.
    ends: [(Vec3, Vec3); 2],
    /// A few roundings of the scene's coordinates.
    slack: f32,
    /// The common receiver end, if there is one.
    apex: Option<Vec3>,
    /// From receiver to emitter, divided by the squared distance: `axis · (x - receiver)` is the parameter t.
    axis: Vec3,
}

impl Shaft {
    /// The shaft of the active segments of some packets in a scene of this coordinate magnitude.
    #[inline(always)]
    pub fn of<S: Simd>(simd: S, packets: &[Packet], magnitude: f32) -> Shaft {
        let apex = packets[0].point(packets[0].active.trailing_zeros() as usize % LANES, 0.0);
        // Extremes lane by lane first, across lanes once.
        let mut lanes = [[(simd.splat(f32::MAX), simd.splat(f32::MIN)); 3]; 2];
        let mut apart = simd.mask(0);
        for packet in packets {
            let (origin, direction) = filled(simd, packet);
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
        let corners = |ends: [(S::F, S::F); 3]| {
            [
                Vec3::from(ends.map(|(lo, _)| simd.least(lo))),
                Vec3::from(ends.map(|(_, hi)| simd.greatest(hi))),
            ]
        };
        let bounds = [if shared { [apex, apex] } else { corners(lanes[0]) }, corners(lanes[1])];
        let slack = 4e-7 * magnitude;
        let ends = bounds.map(|[lo, hi]| (0.5 * (lo + hi), 0.5 * (hi - lo)));
        let along = ends[1].0 - ends[0].0;
        let mut shaft = Shaft {
            lo: bounds[0][0].min(bounds[1][0]) - slack,
            hi: bounds[0][1].max(bounds[1][1]) + slack,
            normals: [Vec3::ZERO; 4],
            offsets: [0.0; 4],
            planes: 0,
            ends,
            slack,
            apex: shared.then_some(apex),
            axis: along / along.length_squared().max(f32::MIN_POSITIVE),
        };
        if shared {
            shaft.add_pyramid(simd, packets, apex);
        }
        shaft
    }

    /// Side planes through the common point: extreme slopes of the directions against the axis.
    #[inline(always)]
    fn add_pyramid<S: Simd>(&mut self, simd: S, packets: &[Packet], apex: Vec3) {
        let w = self.axis.normalize_or_zero();
        if w == Vec3::ZERO {
            return;
        }
        let (u, v) = w.any_orthonormal_pair();
        let mut slopes = [(simd.splat(f32::MAX), simd.splat(f32::MIN)); 2];
        for packet in packets {
            let (_, direction) = filled(simd, packet);
            let along = |n: Vec3| {
                let xy = simd
                    .add(simd.mul(simd.splat(n.x), direction[0]), simd.mul(simd.splat(n.y), direction[1]));
                simd.add(xy, simd.mul(simd.splat(n.z), direction[2]))
            };
            let forward = along(w);
            let steep = simd.mul(simd.splat(10.0), forward);
            let inverse = simd.div(simd.splat(1.0), forward);
            for ((low, high), n) in slopes.iter_mut().map(|(l, h)| (l, h)).zip([u, v]) {
                let sideways = along(n);
                // Directions that hardly go forward have no useful slope.
                if simd.bits(simd.lt(simd.abs(sideways), steep)) != 0xffff {
                    return;
                }
                let slope = simd.mul(sideways, inverse);
                (*low, *high) = (simd.min(*low, slope), simd.max(*high, slope));
            }
        }
        let low = slopes.map(|(low, _)| simd.least(low));
        let high = slopes.map(|(_, high)| simd.greatest(high));
        self.normals = [u - high[0] * w, low[0] * w - u, v - high[1] * w, low[1] * w - v];
        for (offset, n) in self.offsets.iter_mut().zip(&self.normals) {
            *offset = n.dot(apex) + self.slack * n.abs().element_sum();
        }
        self.planes = 4;
    }

    /// Children whose feature size could be below the threshold `s (1 - t) + e t` at their place along the axis.
    ///
    /// A guess for the whole bundle, judged at the centre of each box: what it leaves out is opened, which is
    /// always allowed; what it lets through is decided segment by segment.
    #[inline(always)]
    pub fn maybe_small<S: Simd>(&self, simd: S, node: &Node, sizes: S::F, e: f32, s: f32) -> u32 {
        let mut t = simd.splat(0.0);
        let mut holds_end = [simd.mask(0xffff); 2];
        for axis in 0..3 {
            let (min, max) = (simd.load(&node.min[axis]), simd.load(&node.max[axis]));
            let middle = simd.mul(simd.splat(0.5), simd.add(min, max));
            let from_receiver = simd.sub(middle, simd.splat(self.ends[0].0[axis]));
            t = simd.add(t, simd.mul(from_receiver, simd.splat(self.axis[axis])));
            for (holds, end) in holds_end.iter_mut().zip(&self.ends) {
                let p = simd.splat(end.0[axis]);
                *holds = simd.and(*holds, simd.and(simd.le(min, p), simd.le(p, max)));
            }
        }
        let threshold = simd.add(simd.splat(s), simd.mul(simd.splat(e - s), t));
        let small = simd.lt(sizes, threshold);
        simd.bits(simd.and_not(small, simd.or(holds_end[0], holds_end[1])))
    }

    /// The receiver end that all segments share, if they do.
    pub fn apex(&self) -> Option<Vec3> {
        self.apex
    }

    /// From the middle of the receiver ends to the middle of the emitter ends, not normalised.
    pub fn direction(&self) -> Vec3 {
        self.ends[1].0 - self.ends[0].0
    }

    /// Children of a node that may touch the shaft.
    #[inline(always)]
    pub fn touches<S: Simd>(&self, simd: S, node: &Node) -> u32 {
        let overlap = |axis: usize| {
            let below = simd.le(simd.load(&node.min[axis]), simd.splat(self.hi[axis]));
            let above = simd.le(simd.splat(self.lo[axis]), simd.load(&node.max[axis]));
            simd.and(below, above)
        };
        let mut touched = simd.and(simd.and(overlap(0), overlap(1)), overlap(2));
        for plane in 0..self.planes {
            let n = self.normals[plane];
            // The corner that lies deepest inside the plane.
            let part = |axis: usize| {
                let corner = if n[axis] > 0.0 { &node.min[axis] } else { &node.max[axis] };
                simd.mul(simd.splat(n[axis]), simd.load(corner))
            };
            let depth = simd.add(simd.add(part(0), part(1)), part(2));
            touched = simd.and(touched, simd.le(depth, simd.splat(self.offsets[plane])));
        }
        simd.bits(touched)
    }

    /// Triangles of a block that may block a segment: not outside a side plane, and with ends on both sides.
    #[inline(always)]
    pub fn candidates<S: Simd>(&self, simd: S, block: &Block) -> u32 {
        let load = |v: &[[f32; LANES]; 3]| [simd.load(&v[0]), simd.load(&v[1]), simd.load(&v[2])];
        let (corner, edge1, edge2) = (load(&block.corner), load(&block.edge1), load(&block.edge2));
        let along = |n: Vec3, v: &[S::F; 3]| {
            let xy = simd.add(simd.mul(simd.splat(n.x), v[0]), simd.mul(simd.splat(n.y), v[1]));
            simd.add(xy, simd.mul(simd.splat(n.z), v[2]))
        };
        let mut outside = simd.mask(0);
        for plane in 0..self.planes {
            let n = self.normals[plane];
            let a = simd.sub(along(n, &corner), simd.splat(self.offsets[plane]));
            let nearest =
                simd.add(a, simd.min(simd.min(along(n, &edge1), along(n, &edge2)), simd.splat(0.0)));
            outside = simd.or(outside, simd.lt(simd.splat(0.0), nearest));
        }
        // Both boxes of ends against the triangle's plane, its normal not normalised.
        let cross = |i: usize, j: usize| simd.sub(simd.mul(edge1[i], edge2[j]), simd.mul(edge1[j], edge2[i]));
        let n = [cross(1, 2), cross(2, 0), cross(0, 1)];
        let size = simd.add(simd.add(simd.abs(n[0]), simd.abs(n[1])), simd.abs(n[2]));
        let slack = simd.mul(size, simd.splat(self.slack));
        let (mut above, mut below) = (simd.mask(0xffff), simd.mask(0xffff));
        for (centre, half) in self.ends {
            let mut height = simd.splat(0.0);
            let mut reach = slack;
            for axis in 0..3 {
                let to = simd.sub(simd.splat(centre[axis]), corner[axis]);
                height = simd.add(height, simd.mul(n[axis], to));
                reach = simd.sub(reach, simd.mul(simd.abs(n[axis]), simd.splat(half[axis])));
            }
            // Lowest point at height - (half · |n|) >= -slack: above, or in the plane up to rounding.
            above = simd.and(above, simd.le(simd.sub(simd.splat(0.0), reach), height));
            below = simd.and(below, simd.le(height, reach));
        }
        let harmless = simd.or(outside, simd.or(above, below));
        block.used & !simd.bits(harmless)
    }
}

/// Origins and directions; unused lanes repeat the first segment, so that whole registers can be reduced.
#[inline(always)]
fn filled<S: Simd>(simd: S, packet: &Packet) -> ([S::F; 3], [S::F; 3]) {
    let first = packet.active.trailing_zeros() as usize % LANES;
    let active = simd.mask(packet.active);
    let fill = |v: &[f32; LANES]| simd.select(active, simd.load(v), simd.splat(v[first]));
    ([0, 1, 2].map(|a| fill(&packet.origin[a])), [0, 1, 2].map(|a| fill(&packet.direction[a])))
}
