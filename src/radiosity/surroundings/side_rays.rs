//! Rays from surface to surface, and the sides that they meet.

use crate::embree::Hits;
use crate::radiosity::elements::Elements;
use crate::ray::{EndRule, LANES, Packet};
use crate::visibility::Exact;
use glam::Vec3;

/// A point on a surface with the unit normal and the end rule of the surface.
pub type SurfacePoint = (Vec3, Vec3, EndRule);

/// Index in place of a side for a ray that leaves the scene.
pub const ESCAPED: u32 = u32::MAX - 1;

/// The hit of a ray.
pub struct SideHit {
    /// The side, [`ESCAPED`], or [`Elements::NONE`] for a side without an element.
    pub side: u32,
    /// The face, or [`Hits::NO_HIT`].
    pub triangle: u32,
    /// Origin of the ray, in front of its surface.
    pub from: Vec3,
    /// Where it met the face.
    pub at: Vec3,
}

/// Traces rays that start on surfaces.
pub struct SideRays<'a> {
    pub elements: &'a Elements,
    pub exact: &'a Exact,
    /// Length of rays, more than the diagonal of the scene; scene units.
    pub length: f32,
}

impl SideRays<'_> {
    /// Traces rays from points in unit directions, and calls `each` with the hit of each ray, in their order. `packets` is scratch space.
    pub fn trace(
        &self,
        rays: impl Iterator<Item = (SurfacePoint, Vec3)>,
        packets: &mut Vec<Packet>,
        mut each: impl FnMut(SideHit),
    ) {
        packets.clear();
        let mut count = 0;
        for (i, ((at, normal, end), direction)) in rays.enumerate() {
            if i % LANES == 0 {
                packets.push(Packet::EMPTY);
            }
            let from = end.lifted(at, normal);
            packets[i / LANES].set_between(i % LANES, from, from + self.length * direction, [0.0, 1.0]);
            count = i + 1;
        }
        let mut hits = vec![Hits::NONE; packets.len()];
        self.exact.scene.first_hits(self.exact.traversal, packets, &mut hits);
        for i in 0..count {
            let (packet, lane) = (&packets[i / LANES], i % LANES);
            let (triangle, t) = (hits[i / LANES].triangle[lane], hits[i / LANES].t[lane]);
            let from = packet.point(lane, 0.0);
            let side = match triangle {
                Hits::NO_HIT => ESCAPED,
                triangle => self.elements.met(triangle, packet.point(lane, 1.0) - from),
            };
            each(SideHit { side, triangle, from, at: packet.point(lane, t) });
        }
    }
}
