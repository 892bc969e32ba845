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
}

impl Shaft {
    /// The shaft of the active segments of a packet in a scene of this coordinate magnitude.
    #[inline(always)]
    pub fn of(packet: &Packet, magnitude: f32) -> Shaft {
        let first = packet.active.trailing_zeros() as usize % LANES;
        let o = packet.point(first, 0.0);
        let (mut o_lo, mut o_hi) = (o, o);
        let (mut e_lo, mut e_hi) = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
        let mut axis = Vec3::ZERO;
        for i in packet.lanes() {
            let a = Vec3::new(packet.origin[0][i], packet.origin[1][i], packet.origin[2][i]);
            let d = Vec3::new(packet.direction[0][i], packet.direction[1][i], packet.direction[2][i]);
            o_lo = o_lo.min(a);
            o_hi = o_hi.max(a);
            e_lo = e_lo.min(a + d);
            e_hi = e_hi.max(a + d);
            axis += d;
        }
        let slack = 4e-7 * magnitude;
        let mut shaft = Shaft {
            lo: o_lo.min(e_lo) - slack,
            hi: o_hi.max(e_hi) + slack,
            normals: [Vec3::ZERO; 4],
            offsets: [0.0; 4],
            planes: 0,
            ends: [(0.5 * (o_lo + o_hi), 0.5 * (o_hi - o_lo)), (0.5 * (e_lo + e_hi), 0.5 * (e_hi - e_lo))],
            slack,
        };
        if o_lo == o_hi {
            shaft.add_pyramid(packet, o, axis);
        }
        shaft
    }

    /// Side planes through the common point: extreme slopes of the directions against their mean.
    #[inline(always)]
    fn add_pyramid(&mut self, packet: &Packet, apex: Vec3, axis: Vec3) {
        let w = axis.normalize_or_zero();
        if w == Vec3::ZERO {
            return;
        }
        let (u, v) = w.any_orthonormal_pair();
        let (mut u_lo, mut u_hi, mut v_lo, mut v_hi) = (f32::MAX, f32::MIN, f32::MAX, f32::MIN);
        for i in packet.lanes() {
            let d = Vec3::new(packet.direction[0][i], packet.direction[1][i], packet.direction[2][i]);
            let forward = d.dot(w);
            if forward <= 0.1 * d.length() {
                return;
            }
            let (a, b) = (d.dot(u) / forward, d.dot(v) / forward);
            (u_lo, u_hi) = (u_lo.min(a), u_hi.max(a));
            (v_lo, v_hi) = (v_lo.min(b), v_hi.max(b));
        }
        self.normals = [u - u_hi * w, u_lo * w - u, v - v_hi * w, v_lo * w - v];
        for (offset, n) in self.offsets.iter_mut().zip(&self.normals) {
            *offset = n.dot(apex) + self.slack * n.abs().element_sum();
        }
        self.planes = 4;
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
            let nearest = simd.add(a, simd.min(simd.min(along(n, &edge1), along(n, &edge2)), simd.splat(0.0)));
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
