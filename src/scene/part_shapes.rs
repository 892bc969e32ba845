//! Sizes and kinds of parts (connected faces): rooms, solids and sheets.

use super::{
    connect::Parts,
    magnitudes::{GAP, largest_distance},
};
use crate::math::parallel;
use crate::math::{Aabb, winding_number};
use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// Shape of a part.
pub(super) struct PartShape {
    /// Scene units squared.
    pub area: f64,
    pub kind: PartKind,
    pub bounds: Aabb,
    /// Whether an emitter is in a solid: it is a room whose normals point out.
    pub is_lit_inside: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum PartKind {
    /// A closed part with its normals inwards.
    Room,
    /// A closed part with its normals outwards.
    Solid,
    /// A sheet without volume.
    Sheet,
}

impl PartShape {
    /// Whether two faces of parts of these shapes in one plane, `alike` if they face the same way, are the sides of a wall. They are for
    /// two rooms, a room and the facade around it, and a room and a cupboard in it, whatever their normals. They are not for two boxes
    /// without a lamp in one of them: the gap between these would be refined in vain.
    pub fn share_wall(&self, other: &PartShape, alike: bool) -> bool {
        match (self.kind, other.kind) {
            (PartKind::Sheet, _) | (_, PartKind::Sheet) => false,
            (PartKind::Room, PartKind::Room) => !alike,
            (PartKind::Solid, PartKind::Solid) => {
                let size = self.bounds.diagonal().min(other.bounds.diagonal());
                let gap = GAP * self.bounds.union(other.bounds).magnitude();
                !alike && (self.is_lit_inside || other.is_lit_inside) && gap <= MAX_GAP * size
            }
            (PartKind::Solid, PartKind::Room) => self.is_lit_inside || !alike,
            (PartKind::Room, PartKind::Solid) => other.share_wall(self, alike),
        }
    }

    /// Extent of the bounds along a unit vector, scene units.
    pub fn thickness(&self, along: Vec3) -> f32 {
        self.bounds.extent().dot(along.abs())
    }

    /// Whether the bounds of this part contain those of another one.
    pub fn encloses(&self, other: &PartShape) -> bool {
        let distance = Vec3::splat(largest_distance(&self.bounds) as f32);
        self.bounds.min.cmple(other.bounds.min + distance).all()
            && self.bounds.max.cmpge(other.bounds.max - distance).all()
    }
}

/// Smallest volume of a room or a solid relative to the sum of the areas of its triangles times their distances from its centre: a corridor
/// a thousand times as long as wide has more, the rounding of flat sheets leaves 1e-6.
const MIN_VOLUME: f64 = 1e-3;

/// Largest distance between the faces of adjacent rooms whose normals point out, relative to the smaller one: it changes the light by about
/// as much.
const MAX_GAP: f32 = 1e-2;

/// Largest number of places before emitters whose winding numbers are computed for a part: limits the time where many lamps stand on a
/// ground with hills.
const MAX_TESTED_EMITTERS: usize = 32;

/// Area and kind of each part, by the sign of its volume; `lamps` has a place in front of each emitter.
pub(super) fn shapes_of_parts(
    parts: &Parts,
    polygon: &[u32],
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    lamps: &[Vec3],
) -> Vec<PartShape> {
    let part = |t: usize| parts.part[polygon[t] as usize];
    // Areas, and sums of middles times areas.
    let mut sums = vec![(0.0, DVec3::ZERO); parts.closed.len()];
    for (t, corners) in triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|v| positions[v as usize].as_dvec3());
        let of_triangle = 0.5 * (b - a).cross(c - a).length();
        let (area, middle) = &mut sums[part(t) as usize];
        *area += of_triangle;
        *middle += of_triangle / 3.0 * (a + b + c);
    }
    // The volume of an open part is that about its centre.
    let mut volumes = vec![(0.0, 0.0, Aabb::EMPTY); parts.closed.len()];
    for (t, corners) in triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|v| positions[v as usize].as_dvec3());
        let (area, middle) = sums[part(t) as usize];
        let (volume, limit, bounds) = &mut volumes[part(t) as usize];
        let (from, normal) = (a - middle / area.max(f64::MIN_POSITIVE), (b - a).cross(c - a));
        *volume += from.dot(normal);
        *limit += from.length() * normal.length();
        *bounds = bounds.union(Aabb::of(corners.map(|v| positions[v as usize])));
    }
    let shape = |((area, _), (volume, limit, bounds)): ((f64, DVec3), (f64, f64, Aabb))| {
        let kind = match volume.abs() > MIN_VOLUME * limit {
            true if volume < 0.0 => PartKind::Room,
            true => PartKind::Solid,
            false => PartKind::Sheet,
        };
        PartShape { area, kind, bounds, is_lit_inside: false }
    };
    let mut shapes: Vec<PartShape> = sums.into_iter().zip(volumes).map(shape).collect();
    let mut lit: HashMap<u32, (Vec<Vec3>, Vec<[Vec3; 3]>)> = parallel::flat_map(0..shapes.len(), |part| {
        let near = lamps_in(&shapes[part], lamps);
        (!near.is_empty()).then_some((part as u32, (near, Vec::new())))
    })
    .into_iter()
    .collect();
    for (t, corners) in triangles.iter().enumerate() {
        if let Some((_, faces)) = lit.get_mut(&part(t)) {
            faces.push(corners.map(|v| positions[v as usize]));
        }
    }
    for (part, (lamps, faces)) in lit {
        // A room with a door surrounds most directions.
        let is_in = |lamp: &Vec3| winding_number(faces.iter().copied(), *lamp) > 0.5;
        shapes[part as usize].is_lit_inside = lamps.iter().any(is_in);
    }
    shapes
}

/// Lamps in the bounds of a solid, evenly spread in the order of the file.
fn lamps_in(shape: &PartShape, lamps: &[Vec3]) -> Vec<Vec3> {
    let Aabb { min, max } = shape.bounds;
    let is_in = |p: &&Vec3| p.cmpge(min).all() && p.cmple(max).all();
    if shape.kind != PartKind::Solid {
        return Vec::new();
    }
    let found: Vec<Vec3> = lamps.iter().filter(is_in).copied().collect();
    let step = found.len().div_ceil(MAX_TESTED_EMITTERS).max(1);
    found.into_iter().step_by(step).collect()
}
