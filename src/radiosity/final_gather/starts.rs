//! Start of the rays of a given point, and the feature size of its surface.

use super::gather_point::GatherPoint;
use super::gatherer::FinalGather;
use crate::embree::Hits;
use crate::math::{on_plane, triangle_normal};
use crate::model::SurfaceSearch;
use crate::radiosity::elements::Elements;
use crate::ray::{EndRule, Packet};
use crate::scene::magnitude;
use glam::Vec3;

/// Largest number of surfaces that are tested around a point: bounds the time where many sheets lie on each other.
const MAX_SURFACES: usize = 64;
/// Height above a surface up to which a point lies on it, in roundings of its coordinates: the height at which rays start.
const MAX_SURFACE_HEIGHT: f32 = 5.0;

impl FinalGather<'_> {
    /// A given point, with its seed, and the start of its rays above the surface on which it lies: the surface nearest to the point along
    /// its normal, if both are about parallel. It is above the point within the slack, because files contain few digits, or below it
    /// within rounding. A point that lies higher receives the light at its place in space. A point without a surface is not moved onto
    /// one, but is lifted too: its surface may end beside it. On an edge or in a corner the light is the limit from inside the surface.
    pub(super) fn gather_point(&self, at: Vec3, normal: Vec3, seed: u64) -> GatherPoint {
        let near = |place, search| self.surface_near(place, normal, search);
        let found = self.model.find_around(at, normal, self.slack, near);
        let in_ground = || {
            let (at, face) = self.model.ground_above(at, normal)?;
            Some((at, EndRule::new(magnitude([at])), self.feature_size_at(face, at, normal)))
        };
        let unknown = || (at, EndRule::new(magnitude([at])), self.feature_size);
        let (on_surface, end, feature_size) = found.or_else(in_ground).unwrap_or_else(unknown);
        GatherPoint { on_surface, at: end.lifted(on_surface, normal), normal, end, feature_size, seed }
    }

    /// The place on the surface nearest to a point along its normal, with at least this cosine between their normals, the end rule there
    /// and the feature size of its side.
    fn surface_near(&self, at: Vec3, normal: Vec3, search: SurfaceSearch) -> Option<(Vec3, EndRule, f32)> {
        let (from, to) = (at + self.reach * normal, at - self.reach * normal);
        let mut packet = Packet::EMPTY;
        packet.set_between(0, from, to, [0.0, 1.0]);
        let mut found = None;
        let mut nearest = f32::INFINITY;
        for _ in 0..MAX_SURFACES {
            let mut hits = [Hits::NONE];
            self.traced.first_hits(self.traversal, std::slice::from_ref(&packet), &mut hits);
            let (triangle, t) = (hits[0].triangle[0], hits[0].t[0]);
            // t = 0.5 is the point itself; beyond it the distances of further surfaces only grow.
            if triangle == Hits::NO_HIT || t - 0.5 >= nearest {
                break;
            }
            let corners @ [a, b, c] = self.scene.corners(triangle);
            let is_fine = self.scene.fine_ground.as_ref().is_some_and(|ground| ground.replaces(triangle));
            let end = if is_fine { EndRule::new(magnitude(corners)) } else { self.end_of(triangle) };
            let cosine = triangle_normal(a, b, c).dot(normal);
            let parallel = cosine.abs() >= search.min_cosine;
            // Of coplanar faces that were moved apart, the first one found is that of this side of the plane.
            let stack_distance = self.scene.stack_distance(triangle);
            let moved = (2.0 * stack_distance + end.slack()) / (2.0 * self.reach);
            let is_nearer = (t - 0.5).abs() + moved < nearest;
            let depth = 2.0 * (t - 0.5) * self.reach;
            let rounding = end.slack().max(EndRule::new(magnitude([at])).slack());
            // Stacked faces were moved either way.
            let stack = 2.0 * stack_distance;
            let near = MAX_SURFACE_HEIGHT * rounding;
            let above = if search.is_near { near } else { self.slack };
            let is_on = depth <= near.max(stack) && -depth <= above.max(stack);
            if parallel && is_on && is_nearer {
                let mut at = packet.point(0, t);
                // The coarse face that fine ground replaces has neither the height nor the edges of the fine ground.
                if !is_fine {
                    // Rays start in the plane of the file: from a face that was moved below it, the edge of a carpet hides light.
                    let at_point = on_plane(corners, at) + depth.clamp(0.0, stack) * normal;
                    at = self.model.off_edges(corners, at_point, normal, end);
                }
                found = Some((at, end, self.feature_size_at(triangle, at, normal)));
                nearest = (t - 0.5).abs();
            }
            // Surfaces nearer to each other than rounding count as one.
            packet.near[0] = (t + end.slack() / (2.0 * self.reach)).max(t.next_up());
        }
        found
    }

    /// The feature size of the side of a face that a normal leaves, at a place on it.
    fn feature_size_at(&self, triangle: u32, at: Vec3, normal: Vec3) -> f32 {
        match self.linked.elements.met(triangle, -normal) {
            Elements::NONE => self.feature_size,
            side => self.feature_size_of(self.lookup.leaf(side, at)),
        }
    }

    /// The end rule on a face of the scene, also on one that no light reaches.
    fn end_of(&self, triangle: u32) -> EndRule {
        let elements = &self.linked.elements;
        let side =
            elements.sides_of_triangle[triangle as usize].into_iter().find(|&side| side != Elements::NONE);
        side.map_or_else(
            || EndRule::new(magnitude(self.scene.corners(triangle))),
            |side| elements.sides[side as usize].end,
        )
    }
}
