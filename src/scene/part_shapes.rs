//! Sizes and kinds of parts (connected faces): rooms, solids and sheets.

use super::{connect::Parts, magnitudes::largest_distance};
use crate::math::Aabb;
use glam::Vec3;

/// Shape of a part.
pub(super) struct PartShape {
    /// Scene units squared.
    pub area: f64,
    pub kind: PartKind,
    pub bounds: Aabb,
    /// Whether there may be light behind the faces of a solid, as in a room whose normals point out: it is open, or its bounds contain an
    /// emitter.
    pub may_be_lit_inside: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum PartKind {
    /// Its normals point into it.
    Room,
    /// Its normals point out of it.
    Solid,
    /// A sheet without volume.
    Sheet,
}

impl PartShape {
    /// Whether two faces of parts of these shapes, turned away from each other in one plane, may be the sides of a wall: of adjacent rooms (also
    /// if their normals point out), or of a room and the facade around it. The back of a cupboard and the wall that it touches are not, nor are
    /// two boxes on each other, which no light enters: gaps between them would be refined in vain.
    pub fn may_share_wall(&self, other: &PartShape) -> bool {
        match (self.kind, other.kind) {
            (PartKind::Sheet, _) | (_, PartKind::Sheet) => false,
            (PartKind::Solid, PartKind::Room) => self.encloses(other),
            (PartKind::Room, PartKind::Solid) => other.encloses(self),
            (PartKind::Solid, PartKind::Solid) => self.may_be_lit_inside || other.may_be_lit_inside,
            (PartKind::Room, PartKind::Room) => true,
        }
    }

    /// Whether the bounds of this part contain those of another one.
    fn encloses(&self, other: &PartShape) -> bool {
        let distance = Vec3::splat(largest_distance(&self.bounds) as f32);
        self.bounds.min.cmple(other.bounds.min + distance).all()
            && self.bounds.max.cmpge(other.bounds.max - distance).all()
    }
}

/// Smallest volume of a room or a solid relative to the sum of the areas of its triangles times their distances from one of its corners: a corridor a thousand times
/// as long as wide has more, the rounding of flat sheets leaves 1e-6.
const MIN_VOLUME: f64 = 1e-3;

/// Largest number of emitters that are tested for a part: beyond it the part counts as lit inside, which costs time alone. Bounds the time where
/// many parts overlap with many emitters along an axis.
const MAX_TESTED_EMITTERS: usize = 1024;

/// Area and kind of each part, by the sign of its volume; `lamps` has a place on each emitter.
pub(super) fn shapes_of_parts(
    parts: &Parts,
    polygon: &[u32],
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    mut lamps: Vec<Vec3>,
) -> Vec<PartShape> {
    lamps.sort_by(|a, b| a.x.total_cmp(&b.x));
    let mut sums = vec![(None, 0.0, 0.0, 0.0, Aabb::EMPTY); parts.closed.len()];
    for (t, corners) in triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|v| positions[v as usize].as_dvec3());
        let (corner, area, volume, limit, bounds) = &mut sums[parts.part[polygon[t] as usize] as usize];
        let (from, normal) = (a - *corner.get_or_insert(a), (b - a).cross(c - a));
        *area += 0.5 * normal.length();
        *volume += from.dot(normal);
        *limit += from.length() * normal.length();
        *bounds = bounds.union(Aabb::of(corners.map(|v| positions[v as usize])));
    }
    let shape = |((_, area, volume, limit, bounds), is_closed): ((_, f64, f64, f64, Aabb), &bool)| {
        let kind = match volume.abs() > MIN_VOLUME * limit {
            true if volume < 0.0 => PartKind::Room,
            true => PartKind::Solid,
            false => PartKind::Sheet,
        };
        let may_be_lit_inside = !is_closed || contains_any(&bounds, &lamps);
        PartShape { area, kind, bounds, may_be_lit_inside }
    };
    sums.into_iter().zip(&parts.closed).map(shape).collect()
}

/// Whether a box contains one of these places, which are sorted along x, or may do so.
fn contains_any(bounds: &Aabb, places: &[Vec3]) -> bool {
    let distance = Vec3::splat(largest_distance(bounds) as f32);
    let (min, max) = (bounds.min - distance, bounds.max + distance);
    let first = places.partition_point(|p| p.x < min.x);
    let near: Vec<&Vec3> =
        places[first..].iter().take_while(|p| p.x <= max.x).take(MAX_TESTED_EMITTERS).collect();
    near.len() == MAX_TESTED_EMITTERS || near.iter().any(|p| p.cmpge(min).all() && p.cmple(max).all())
}
