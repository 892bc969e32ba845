//! Walls that two parts share: the faces on them lie in one plane, and each is visible from one of its sides.

use super::overlap::{FaceProperties, Faces, Overlap};
use super::part_shapes::PartKind;
use crate::math::triangle_normal;
use glam::Vec3;
use std::collections::{HashMap, HashSet, hash_map::Entry};

/// Smallest fraction of the area of a facade that lies on walls of the rooms in it: most of it, as a room whose normals point out also touches
/// cupboards whose normals point in.
const MIN_FACADE_COVER: f64 = 0.5;

/// The side of a shared wall from which a triangle is visible, and its place there.
pub(super) struct WallSide {
    /// A triangle of the wall.
    pub wall: u32,
    /// One of the normals of its plane.
    pub axis: Vec3,
    /// Whether it is visible from the side to which the axis does not point: that in which its part lies, or the outside of a facade.
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
        of.part(s) != of.part(t) && normal(s).dot(normal(t)) < 0.0 && of.shape(s).may_share_wall(of.shape(t))
    };
    let shared: Vec<Overlap> = found.iter().filter(is_shared).copied().collect();
    let mut sides = WallSides::new();
    if shared.is_empty() {
        return sides;
    }
    let facades = facades(&shared, of);
    let mut neighbours = HashMap::<u32, Vec<u32>>::new();
    for &(s, t, _) in found {
        neighbours.entry(s).or_default().push(t);
        neighbours.entry(t).or_default().push(s);
    }
    for (wall, ..) in shared {
        let mut open = vec![wall];
        while let Some(t) = open.pop() {
            if let Entry::Vacant(place) = sides.entry(t) {
                // No plane of a building is parallel to this direction.
                let (normal, sign) = (normal(t), normal(t).dot(Vec3::new(0.86, 0.41, 0.31)).signum());
                let is_facade = facades.contains(&of.part(t));
                let lies_behind = of.shape(t).kind == PartKind::Solid && !is_facade;
                place.insert(WallSide {
                    wall,
                    axis: sign * normal,
                    is_beyond: (sign < 0.0) != lies_behind,
                    area: if is_facade { f64::INFINITY } else { of.shape(t).area },
                });
                open.extend(&neighbours[&t]);
            }
        }
    }
    sides
}

/// The solids that are facades: most of their area lies on walls of rooms in them.
fn facades(shared: &[Overlap], of: &FaceProperties) -> HashSet<u32> {
    let kind = |part: u32| of.shapes[part as usize].kind;
    let mut covered = HashMap::<u32, f64>::new();
    for &(s, t, area) in shared {
        for [own, other] in [[of.part(s), of.part(t)], [of.part(t), of.part(s)]] {
            if kind(own) == PartKind::Solid && kind(other) == PartKind::Room {
                *covered.entry(own).or_default() += area;
            }
        }
    }
    let is_facade = |&(part, area): &(u32, f64)| area >= MIN_FACADE_COVER * of.shapes[part as usize].area;
    covered.into_iter().filter(is_facade).map(|(part, _)| part).collect()
}
