//! Edges of the pyramid of a bundle: polygons, panels, and extreme slopes relative to the mean direction.

use super::Ends;
use crate::ray::Packet;
use crate::simd::vector::{self, Vector};
use crate::simd::{LANES, Simd};
use glam::Vec3;

/// Largest ratio of lateral to forward components for which slopes are used: bounds the lengths of corners, on which
/// rounding depends, to √(1 + 2 · 10²) = 14. Wider bundles have no pyramid and reject less by their shafts.
const MAX_SLOPE: f32 = 10.0;

/// Vectors from `apex` to three or four points, if these in order are the edges of a convex pyramid.
#[inline(always)]
pub(super) fn corners_of_polygon(points: &[Vec3], apex: Vec3) -> Option<[Vec3; 4]> {
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
pub(super) fn corners_of_panel(to: Ends, apex: Vec3, slack: f32) -> Option<[Vec3; 4]> {
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
pub(super) fn slopes_of_points(points: &[Vec3], apex: Vec3, [u, v, w]: [Vec3; 3]) -> Option<[[f32; 2]; 2]> {
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
pub(super) fn slopes_of_segments<S: Simd>(
    simd: S,
    packets: &[Packet],
    [u, v, w]: [Vec3; 3],
) -> Option<[[f32; 2]; 2]> {
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
pub(in super::super) struct FromReceiver<S: Simd> {
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
pub(in super::super) fn filled<S: Simd>(simd: S, packet: &Packet) -> [Vector<S>; 2] {
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
