//! Brute force: every segment against every triangle in f64, the reference for tests of the fast engines.

use super::{Occluder, Packet};
use glam::{DVec3, Vec3};

/// All triangles of a scene, tested one by one.
pub struct Brute {
    corners: Vec<[DVec3; 3]>,
}

/// Result of exact arithmetic, with the cases in which f32 arithmetic may differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HitResult {
    /// No triangle blocks the segment, by more than the tolerance.
    Clear,
    /// The interior of a triangle blocks the segment, by more than the tolerance.
    Blocked,
    /// Within the tolerance of an edge, of an end of the segment or of the triangle's plane, and not clearly blocked by
    /// another triangle: f32 engines may give either result.
    Marginal,
}

impl Brute {
    /// Copies the triangles of a scene: positions in scene units, indices into them.
    pub fn new(positions: &[Vec3], triangles: &[[u32; 3]]) -> Brute {
        Brute { corners: triangles.iter().map(|t| t.map(|v| positions[v as usize].as_dvec3())).collect() }
    }

    /// Tests the segment `origin + t direction`, `near <= t <= far`. `tolerance` (dimensionless) is relative to the
    /// compared quantity: barycentric coordinates, segment parameter, sine of the angle to the plane.
    pub fn verdict(&self, origin: Vec3, direction: Vec3, near: f32, far: f32, tolerance: f64) -> HitResult {
        let (o, d) = (origin.as_dvec3(), direction.as_dvec3());
        let mut result = HitResult::Clear;
        for [a, b, c] in &self.corners {
            // Möller and Trumbore 1997, without early exits so that margins can be computed.
            let (e1, e2) = (b - a, c - a);
            let p = d.cross(e2);
            let det = e1.dot(p);
            let s = o - a;
            let q = s.cross(e1);
            let grazing = det.abs() <= tolerance * e1.cross(e2).length() * d.length();
            if grazing {
                // Nearly parallel to the plane: the result is undecided if the segment comes near the plane.
                let normal = e1.cross(e2).normalize_or_zero();
                let reach = d.length() + s.length();
                let close = normal.dot(s).abs().min(normal.dot(s + d).abs()) <= tolerance * reach;
                if close {
                    result = HitResult::Marginal;
                }
                continue;
            }
            let (u, v, t) = (s.dot(p) / det, d.dot(q) / det, e2.dot(q) / det);
            let inside = u.min(v).min(1.0 - u - v);
            // Slivers and grazing segments amplify rounding: barycentric coordinates are edge products divided by the
            // area of the triangle projected along the segment.
            let longest = e1.length().max(e2.length()).max((e2 - e1).length());
            let area = e1.cross(e2).length();
            let size = longest + s.length();
            let slack = tolerance * (1.0 + longest * size * d.length() / det.abs());
            let range = (t - f64::from(near)).min(f64::from(far) - t);
            // Error of t: a few rounding errors of the coordinates, divided by the component of the direction along
            // the normal.
            let reach = tolerance * (1.0 + size * area / det.abs());
            if inside > slack && range > reach {
                return HitResult::Blocked;
            }
            if inside >= -slack && range >= -reach {
                result = HitResult::Marginal;
            }
        }
        result
    }
}

impl Occluder for Brute {
    fn occluded(&self, packets: &[Packet], blocked: &mut [u32]) {
        assert_eq!(packets.len(), blocked.len());
        for (packet, blocked) in packets.iter().zip(blocked) {
            *blocked = packet
                .lanes()
                .filter(|&i| {
                    let [o, e] =
                        [&packet.origin, &packet.direction].map(|v| Vec3::from(v.map(|axis| axis[i])));
                    self.verdict(o, e, packet.near[i], packet.far[i], 0.0) != HitResult::Clear
                })
                .fold(0, |mask, lane| mask | 1 << lane);
        }
    }
}
