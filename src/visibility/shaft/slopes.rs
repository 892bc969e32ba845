//! How wide the pyramid of a bundle opens: extreme slopes of directions against the middle one.

use super::Ends;
use crate::ray::Packet;
use crate::simd::vector::{self, Vector};
use crate::simd::{LANES, Simd};
use glam::Vec3;

/// Directions that go sideways by more than this times forward have no useful slope.
const STEEP: f32 = 10.0;

/// Three or four points seen from another, in the order that makes them the edges of a convex pyramid; none if there
/// is no such order.
#[inline(always)]
pub(super) fn corners_of_polygon(points: &[Vec3], apex: Vec3) -> Option<[Vec3; 4]> {
    const ORDERS: [[usize; 4]; 3] = [[0, 1, 2, 3], [0, 1, 3, 2], [0, 2, 1, 3]];
    let points = match *points {
        [a, b, c] => return Some([a, b, c, c].map(|p| p - apex)),
        [a, b, c, d] => [a, b, c, d].map(|p| p - apex),
        _ => return None,
    };
    let [first, ..] = points;
    let in_turn = |corners: &[Vec3; 4]| {
        // Every side plane has the other two corners on the same side.
        let side = |k: usize| corners[k].cross(corners[(k + 1) % 4]);
        let inside = side(1).dot(first).signum();
        (0..4).all(|k| {
            let n = inside * side(k);
            n.dot(corners[(k + 2) % 4]) > 0.0 && n.dot(corners[(k + 3) % 4]) > 0.0
        })
    };
    ORDERS.iter().map(|order| order.map(|k| points[k])).find(in_turn)
}

/// The corners of a box without thickness, in turn, seen from a point.
#[inline(always)]
pub(super) fn corners_of_panel(to: Ends, apex: Vec3, slack: f32) -> Option<[Vec3; 4]> {
    let flat = to.half.min_position();
    if to.half[flat] > slack {
        return None;
    }
    let (u, v) = ((flat + 1) % 3, (flat + 2) % 3);
    Some([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(i, j)| {
        let mut half = Vec3::ZERO;
        (half[u], half[v]) = (i * to.half[u], j * to.half[v]);
        to.centre + half - apex
    }))
}

/// Least and greatest slope towards u and v against w of points seen from another.
#[inline(always)]
pub(super) fn slopes_of_points(points: &[Vec3], apex: Vec3, [u, v, w]: [Vec3; 3]) -> Option<[[f32; 2]; 2]> {
    let (mut low, mut high) = ([f32::MAX; 2], [f32::MIN; 2]);
    for corner in points.iter().map(|&p| p - apex) {
        let forward = corner.dot(w);
        for (i, sideways) in [corner.dot(u), corner.dot(v)].into_iter().enumerate() {
            if sideways.abs() >= STEEP * forward {
                return None;
            }
            let slope = sideways / forward;
            (low[i], high[i]) = (low[i].min(slope), high[i].max(slope));
        }
    }
    Some([low, high])
}

/// The same of every direction.
#[inline(always)]
pub(super) fn slopes_of_segments<S: Simd>(
    simd: S,
    packets: &[Packet],
    [u, v, w]: [Vec3; 3],
) -> Option<[[f32; 2]; 2]> {
    let mut slopes = [(simd.splat(f32::MAX), simd.splat(f32::MIN)); 2];
    for packet in packets {
        let (_, direction) = filled(simd, packet);
        let forward = vector::dot(simd, &vector::splat(simd, w), &direction);
        let steep = simd.mul(simd.splat(STEEP), forward);
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

/// Origins and directions; unused lanes repeat the first segment, so that whole registers can be reduced.
#[inline(always)]
pub(in super::super) fn filled<S: Simd>(simd: S, packet: &Packet) -> (Vector<S>, Vector<S>) {
    if packet.active == 0xffff {
        return (vector::load(simd, &packet.origin), vector::load(simd, &packet.direction));
    }
    let first = packet.active.trailing_zeros() as usize % LANES;
    let active = simd.mask(packet.active);
    let mut filled = [vector::load(simd, &packet.origin), vector::load(simd, &packet.direction)];
    for (filled, v) in filled.iter_mut().zip([&packet.origin, &packet.direction]) {
        for axis in 0..3 {
            filled[axis] = simd.select(active, filled[axis], simd.splat(v[axis][first]));
        }
    }
    let [origin, direction] = filled;
    (origin, direction)
}
