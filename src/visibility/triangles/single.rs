//! One triangle against segments that share no end.

use crate::ray::Packet;
use crate::simd::{LANES, Simd, vector};
use crate::visibility::wide::Block;
use glam::Vec3;

/// Widening of edges relative to the determinant, so that no segment passes between adjacent triangles. An edge
/// function rounds at most 6 times (difference 1, cross product 2, dot product 3) by 2⁻²⁴ = 6e-8, which is 3.6e-7; the
/// value leaves a factor of nearly 3.
const EDGE_WIDENING: f32 = 1e-6;

/// A triangle for tests against segments without a common end.
pub(super) struct Triangle {
    corner: Vec3,
    edge1: Vec3,
    edge2: Vec3,
    /// e2 × e1.
    normal: Vec3,
}

impl Triangle {
    #[inline(always)]
    pub fn of(block: &Block, k: usize) -> Triangle {
        let pick = |v: &[[f32; LANES]; 3]| Vec3::new(v[0][k], v[1][k], v[2][k]);
        let (corner, edge1, edge2) = (pick(&block.corner), pick(&block.edge1), pick(&block.edge2));
        Triangle { corner, edge1, edge2, normal: edge2.cross(edge1) }
    }

    /// Lanes that the triangle blocks.
    #[inline(always)]
    pub fn blocks<S: Simd>(&self, simd: S, packet: &Packet) -> u32 {
        let (e1, e2) = (vector::splat(simd, self.edge1), vector::splat(simd, self.edge2));
        let d = vector::load(simd, &packet.direction);
        let v = vector::sub(simd, &vector::load(simd, &packet.origin), &vector::splat(simd, self.corner));
        let (p, q) = (vector::cross(simd, &e2, &v), vector::cross(simd, &v, &e1));
        let det = vector::dot(simd, &d, &vector::splat(simd, self.normal));
        // All volumes are multiplied by the sign of the determinant.
        let zero = simd.splat(0.0);
        let back = simd.lt(det, zero);
        let sign = simd.select(back, simd.splat(-1.0), simd.splat(1.0));
        let a = simd.mul(sign, vector::dot(simd, &d, &p));
        let b = simd.mul(sign, vector::dot(simd, &d, &q));
        let t = simd.mul(sign, vector::dot(simd, &e2, &q));
        let det = simd.mul(sign, det);
        let slack = simd.mul(det, simd.splat(-EDGE_WIDENING));
        let inside = simd.and(simd.le(slack, a), simd.le(slack, b));
        let inside = simd.and(inside, simd.le(simd.add(simd.add(a, b), slack), det));
        let reach = simd.and(
            simd.le(simd.mul(simd.load(&packet.near), det), t),
            simd.le(t, simd.mul(simd.load(&packet.far), det)),
        );
        simd.bits(simd.and(simd.and(inside, reach), simd.lt(zero, det)))
    }
}
