//! Walls that two parts share: the faces on them lie in one plane, and each is visible from one of its sides.

use super::overlap::{FaceProperties, Faces, Overlap};
use super::part_shapes::PartKind;
use crate::math::triangle_normal;
use glam::Vec3;
use std::collections::{HashMap, HashSet};

/// Smallest fraction of the area of a facade that lies on walls of the rooms in it: most of it, as a room whose normals point out also touches
/// cupboards whose normals point in.
const MIN_FACADE_COVER: f64 = 0.5;

/// The side of a shared wall from which a triangle is visible, and its place there.
pub(super) struct WallSide {
    /// A triangle of the wall.
    pub wall: u32,
    /// Normal of its plane on the side from which the smallest face on it is visible.
    pub axis: Vec3,
    /// Whether the triangle is visible from the other side. Faces are visible from the side on which their part lies, those of a facade from outside, and lamps from their front.
    pub is_beyond: bool,
    /// Area of its part, scene units squared; that of a facade, which lies behind all faces of rooms, is infinite.
    pub area: f64,
}

/// The triangles on shared walls.
pub(super) type WallSides = HashMap<u32, WallSide>;

/// Whether two triangles are visible from different sides of a shared wall.
pub(super) fn are_opposite(sides: &WallSides, s: u32, t: u32) -> bool {
    sides.get(&s).zip(sides.get(&t)).is_some_and(|(a, b)| a.is_beyond != b.is_beyond)
}

/// The triangles in the walls that two parts share, and those that overlap with them.
pub(super) fn wall_sides(found: &[Overlap], faces: &Faces) -> WallSides {
    let of = faces.properties;
    let normal = |t: u32| {
        let [a, b, c] = faces.triangles[t as usize].map(|v| faces.positions[v as usize]);
        triangle_normal(a, b, c)
    };
    let is_shared = |&&(s, t, _): &&Overlap| {
        of.part(s) != of.part(t) && of.shape(s).share_wall(of.shape(t), normal(s).dot(normal(t)) > 0.0)
    };
    let shared: Vec<Overlap> = found.iter().filter(is_shared).copied().collect();
    let mut sides = WallSides::new();
    if shared.is_empty() {
        return sides;
    }
    let facades = facades(&shared, of, &normal);
    let is_facade = |t: u32| facades.contains(&of.part(t));
    // The normal of the side from which a face is visible: the front of a lamp, that of a solid from its inside.
    let visible = |t: u32| {
        let is_lamp = of.emitter[t as usize] != u32::MAX;
        match of.shape(t).kind == PartKind::Solid && !is_facade(t) && !is_lamp {
            true => -normal(t),
            false => normal(t),
        }
    };
    let area = |t: u32| if is_facade(t) { f64::INFINITY } else { of.shape(t).area };
    let mut neighbours = HashMap::<u32, Vec<u32>>::new();
    for &(s, t, _) in found {
        neighbours.entry(s).or_default().push(t);
        neighbours.entry(t).or_default().push(s);
    }
    for (wall, ..) in shared {
        if sides.contains_key(&wall) {
            continue;
        }
        let (mut members, mut known, mut next) = (vec![wall], HashSet::from([wall]), 0);
        while let Some(t) = members.get(next) {
            members.extend(neighbours[t].iter().filter(|t| known.insert(**t)));
            next += 1;
        }
        // The smallest face stays in its place.
        let smallest = members.iter().min_by(|s, t| area(**s).total_cmp(&area(**t)).then(s.cmp(t)));
        let axis = visible(*smallest.unwrap_or(&wall));
        let side = |t| WallSide { wall, axis, is_beyond: visible(t).dot(axis) < 0.0, area: area(t) };
        sides.extend(members.into_iter().map(|t| (t, side(t))));
    }
    sides
}

/// The solids that are facades: most of their area lies on walls of rooms in them.
fn facades(shared: &[Overlap], of: &FaceProperties, normal: &dyn Fn(u32) -> Vec3) -> HashSet<u32> {
    let is_facade_of = |solid: u32, room: u32| {
        let [solid, room] = [solid, room].map(|t| of.shape(t));
        solid.kind == PartKind::Solid && room.kind == PartKind::Room && solid.encloses(room)
    };
    let mut covered = HashMap::<u32, f64>::new();
    for &(s, t, area) in shared.iter().filter(|&&(s, t, _)| normal(s).dot(normal(t)) < 0.0) {
        for (solid, _) in [(s, t), (t, s)].into_iter().filter(|&(solid, room)| is_facade_of(solid, room)) {
            *covered.entry(of.part(solid)).or_default() += area;
        }
    }
    let is_facade = |&(part, area): &(u32, f64)| area >= MIN_FACADE_COVER * of.shapes[part as usize].area;
    covered.into_iter().filter(is_facade).map(|(part, _)| part).collect()
}
