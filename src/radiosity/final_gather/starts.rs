//! Where the rays of a given point start.

use super::gatherer::FinalGather;
use crate::embree::Hits;
use crate::math::triangle_normal;
use crate::ray::Packet;
use glam::Vec3;

/// Largest number of surfaces that are tested around a point: bounds the time where many sheets lie on each other.
const MAX_SURFACES: usize = 64;
/// Smallest cosine between the normals of a point and of its surface, that of 60°: files hold smoothed normals.
const MIN_COSINE: f32 = 0.5;

impl FinalGather<'_> {
    /// The start of the rays of a given point: above the surface that the point lies on. That is the surface nearest to the point
    /// along its normal within the slack, if both are about parallel. A point without one is taken as it is, lifted all the same:
    /// its surface may end beside it.
    pub(super) fn start(&self, at: Vec3, normal: Vec3) -> Vec3 {
        let ends = self.linked.ends;
        let (from, to) = (at + self.slack * normal, at - self.slack * normal);
        let mut packet = Packet::EMPTY;
        packet.set_between(0, from, to, [0.0, 1.0]);
        let mut found = at;
        let mut nearest = f32::INFINITY;
        // Surfaces nearer to each other than rounding count as one.
        let step = ends.slack() / (2.0 * self.slack);
        for _ in 0..MAX_SURFACES {
            let mut hits = [Hits::NONE];
            self.traced.first_hits(self.traversal, std::slice::from_ref(&packet), &mut hits);
            let (triangle, t) = (hits[0].triangle[0], hits[0].t[0]);
            // Half the length is the point itself; beyond it surfaces are ever farther away.
            if triangle == Hits::NOTHING || t - 0.5 >= nearest {
                break;
            }
            let [a, b, c] = self.scene.corners(triangle);
            let parallel = triangle_normal(a, b, c).dot(normal).abs() >= MIN_COSINE;
            if parallel && (t - 0.5).abs() < nearest {
                (found, nearest) = (packet.point(0, t), (t - 0.5).abs());
            }
            packet.near[0] = t + step;
        }
        ends.lifted(found, normal)
    }
}
