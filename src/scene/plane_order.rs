//! Order of overlapping faces of one plane: which of them is visible from which side.
//!
//! Overlapping faces are of these kinds:
//! * *Walls of rooms* are visible from inside; smaller faces lie before larger ones.
//! * *Faces of bodies*, such as furniture, are visible from outside where nothing covers them: every other face lies before them.
//! * *Sheets* lie on the side of what they cover: rugs and posters inside of rooms and outside of bodies. A ground on which a room stands, or below which it lies,
//!   is outside of the room.
//! * Lamps, facades, and the two sides of one sheet are visible from their fronts.

use super::continuations::lengths_before;
use super::overlap::{FaceProperties, Faces, Overlap};
use super::part_shapes::PartKind;
use crate::math::triangle_normal;
use glam::Vec3;
use std::cmp::Ordering;
use std::collections::{HashMap, HashSet};

/// Smallest fraction of the area of a facade that lies on walls of the rooms in it: most of it, as a room whose normals point out also touches
/// cupboards whose normals point in.
const MIN_FACADE_COVER: f64 = 0.5;

/// Smallest fraction of the area of sheets turned away from each other that overlaps if they are the two sides of one sheet. Borders that
/// were rounded or drawn by hand leave less than a hundredth.
const MIN_SHEET_COVER: f64 = 0.99;

/// Smallest area of a ground relative to that of a room: no face of a closed room has more than half of its area.
const MIN_GROUND_AREA: f64 = 0.5;

/// Place of a face among those that it is connected with by overlaps. Places of one plane are ordered along its axis, from the front.
pub(super) struct Place {
    /// The first triangle of the plane.
    pub plane: u32,
    /// The normal of the plane.
    pub axis: Vec3,
    pub rank: Rank,
    /// Area of the face's part, scene units squared; that of a facade, which lies behind all faces of rooms, is infinite.
    area: f64,
    /// Whether walls of rooms lie in the plane.
    has_walls: bool,
    is_sheet: bool,
}

/// Faces of lower ranks lie before those of higher ones.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Rank {
    /// Of a body that lies before the plane.
    BodyBefore,
    /// Visible from the front.
    Front,
    /// Visible from the back.
    Back,
    /// Of a body that lies behind the plane.
    BodyBehind,
}

impl Rank {
    pub fn is_of_body(self) -> bool {
        matches!(self, Rank::BodyBefore | Rank::BodyBehind)
    }
}

impl Place {
    /// Order of the faces at two places of one plane: by rank, then the smaller ones towards those who see them; of equal ones the later in the file.
    pub fn compare(&self, index: u32, other: &Place, index_of_other: u32) -> Ordering {
        let by_area = self.area.total_cmp(&other.area).then(index_of_other.cmp(&index));
        let is_reversed = matches!(self.rank, Rank::BodyBefore | Rank::Back);
        self.rank.cmp(&other.rank).then(if is_reversed { by_area.reverse() } else { by_area })
    }
}

/// The places of all triangles that overlap with others.
pub(super) type PlaneOrder = HashMap<u32, Place>;

/// Whether one of two overlapping triangles, `alike` if they face the same way, may hide the other unnoticed: they face the same way and are visible from one side,
/// or belong to a body that touches no wall; or they are sheets of which the order of their plane turns one over.
pub(super) fn may_hide(order: &PlaneOrder, s: u32, t: u32, alike: bool) -> bool {
    let [s, t] = [&order[&s], &order[&t]];
    let are_visible = s.rank == t.rank || !s.has_walls && (s.rank.is_of_body() || t.rank.is_of_body());
    are_visible && (alike || s.is_sheet && t.is_sheet)
}

/// Kind of a face in a plane, with the normal of the side on which it is visible or, for bodies, on which the body lies.
#[derive(Clone, Copy)]
enum Kind {
    Wall(Vec3),
    Body(Vec3),
    Fixed(Vec3),
    Sheet,
}

/// Finds the order of overlapping faces.
pub(super) fn plane_order(found: &[Overlap], faces: &Faces) -> PlaneOrder {
    if found.is_empty() {
        return PlaneOrder::new();
    }
    let planes = Planes::new(found, faces);
    let kinds = planes.kinds();
    let mut order = PlaneOrder::new();
    for &(start, ..) in found {
        if !order.contains_key(&start) {
            planes.order_plane(start, &kinds, &mut order);
        }
    }
    order
}

struct Planes<'a> {
    found: &'a [Overlap],
    faces: &'a Faces<'a>,
    of: &'a FaceProperties<'a>,
    /// By triangle, those that overlap with it.
    neighbours: HashMap<u32, Vec<u32>>,
    facades: HashSet<u32>,
}

impl<'a> Planes<'a> {
    fn new(found: &'a [Overlap], faces: &'a Faces<'a>) -> Self {
        let mut neighbours = HashMap::<u32, Vec<u32>>::new();
        for &(s, t, _) in found {
            neighbours.entry(s).or_default().push(t);
            neighbours.entry(t).or_default().push(s);
        }
        let mut planes = Planes { found, faces, of: faces.properties, neighbours, facades: HashSet::new() };
        planes.facades = planes.facades();
        planes
    }

    fn normal(&self, t: u32) -> Vec3 {
        let [a, b, c] = self.faces.triangles[t as usize].map(|v| self.faces.positions[v as usize]);
        triangle_normal(a, b, c)
    }

    /// The overlaps of faces turned away from each other.
    fn turned_away(&self) -> impl Iterator<Item = &Overlap> {
        self.found.iter().filter(|&&(s, t, _)| self.normal(s).dot(self.normal(t)) < 0.0)
    }

    /// The parts that are facades: most of their area lies on walls of rooms in them.
    fn facades(&self) -> HashSet<u32> {
        let is_facade_of = |facade: u32, room: u32| {
            let [facade, room] = [facade, room].map(|t| self.of.shape(t));
            let are_opposite = match facade.kind {
                PartKind::Solid => room.kind == PartKind::Room,
                // Where all normals are reversed.
                PartKind::Room => room.is_lit_inside && !room.encloses(facade),
                PartKind::Sheet => false,
            };
            are_opposite && facade.encloses(room)
        };
        let mut covered = HashMap::<u32, f64>::new();
        for &(s, t, area) in self.turned_away() {
            for (facade, _) in [(s, t), (t, s)].into_iter().filter(|&(s, t)| is_facade_of(s, t)) {
                *covered.entry(self.of.part(facade)).or_default() += area;
            }
        }
        let is_facade =
            |&(part, area): &(u32, f64)| area >= MIN_FACADE_COVER * self.of.shapes[part as usize].area;
        covered.into_iter().filter(is_facade).map(|(part, _)| part).collect()
    }

    /// The kind of each overlapping face.
    fn kinds(&self) -> HashMap<u32, Kind> {
        let is_flat = |t: &u32| self.of.shape(*t).kind == PartKind::Sheet;
        let is_of_one_part = |&&(s, t, _): &&Overlap| self.of.part(s) == self.of.part(t);
        let mut uncertain: HashSet<u32> = self.neighbours.keys().copied().filter(is_flat).collect();
        uncertain.extend(self.turned_away().filter(is_of_one_part).flat_map(|&(s, t, _)| [s, t]));
        let before = lengths_before(&uncertain, self.faces);
        let kind = |t: u32| {
            let normal = self.normal(t);
            let shape = self.of.shape(t);
            if self.of.emitter[t as usize] != u32::MAX {
                return Kind::Fixed(normal);
            }
            if self.facades.contains(&self.of.part(t)) {
                return Kind::Fixed(if shape.kind == PartKind::Room { -normal } else { normal });
            }
            match (shape.kind, before.get(&t)) {
                (PartKind::Room, _) => Kind::Wall(normal),
                (PartKind::Solid, _) if shape.is_lit_inside => Kind::Wall(-normal),
                (PartKind::Solid, _) => Kind::Body(-normal),
                (PartKind::Sheet, Some(&length)) if length > 0.0 => Kind::Wall(normal),
                (PartKind::Sheet, Some(&length)) if length < 0.0 => Kind::Body(-normal),
                (PartKind::Sheet, _) => Kind::Sheet,
            }
        };
        let mut kinds: HashMap<u32, Kind> = self.neighbours.keys().map(|&t| (t, kind(t))).collect();
        for t in self.sides_of_sheets(&kinds, &before) {
            kinds.insert(t, Kind::Fixed(self.normal(t)));
        }
        kinds
    }

    /// The faces that are sides of a sheet: they overlap with faces that are turned away and belong to the same part, unless both continue to opposite sides as
    /// walls of two rooms do, or to another sheet that covers theirs and is covered by it.
    fn sides_of_sheets(&self, kinds: &HashMap<u32, Kind>, before: &HashMap<u32, f32>) -> HashSet<u32> {
        let mut covered = HashMap::<u32, f64>::new();
        for &(s, t, area) in self.turned_away() {
            [s, t].into_iter().for_each(|t| *covered.entry(self.of.part(t)).or_default() += area);
        }
        let is_covered_sheet = |t: u32| {
            let area = self.of.shape(t).area;
            matches!(kinds[&t], Kind::Sheet) && covered[&self.of.part(t)] >= MIN_SHEET_COVER * area
        };
        let is_sheet = |&&(s, t, _): &&Overlap| match self.of.part(s) == self.of.part(t) {
            true => before[&s] * before[&t] <= 0.0,
            false => is_covered_sheet(s) && is_covered_sheet(t),
        };
        self.turned_away().filter(is_sheet).flat_map(|&(s, t, _)| [s, t]).collect()
    }

    /// The side from which a sheet is visible, by the walls and bodies that it overlaps with; `None` if it overlaps with none.
    fn side_of_sheet(&self, t: u32, kinds: &HashMap<u32, Kind>) -> Option<Vec3> {
        let neighbours = || self.neighbours[&t].iter();
        let by_wall = |u: &u32| match kinds[u] {
            Kind::Wall(inside) if self.is_ground_of(t, *u) => Some(-inside),
            Kind::Wall(inside) => Some(inside),
            _ => None,
        };
        let by_body = |u: &u32| match kinds[u] {
            Kind::Body(inside) => Some(-inside),
            Kind::Fixed(normal) if self.facades.contains(&self.of.part(*u)) => Some(normal),
            _ => None,
        };
        let by_lamp = |u: &u32| match kinds[u] {
            Kind::Fixed(normal) => Some(normal),
            _ => None,
        };
        let normal = self.normal(t);
        let faces_alike = |u: &u32| self.normal(*u).dot(normal) > 0.0;
        // Of walls of two rooms it lies on the one that faces the same way.
        let agreed = |side: &dyn Fn(&u32) -> Option<Vec3>| {
            let sides = || neighbours().filter_map(|u| Some((u, side(u)?)));
            let (_, first) = sides().next()?;
            let differ = sides().any(|(_, side)| side.dot(first) < 0.0);
            let alike = || sides().find(|(u, _)| faces_alike(u)).map_or(normal, |(_, side)| side);
            Some(if differ { alike() } else { first })
        };
        agreed(&by_wall).or_else(|| agreed(&by_body)).or_else(|| agreed(&by_lamp))
    }

    /// Whether a sheet is outside of the room of a wall: it is larger than the wall and extends beyond the room.
    fn is_ground_of(&self, sheet: u32, wall: u32) -> bool {
        let [sheet, room] = [sheet, wall].map(|t| self.of.shape(t));
        room.kind != PartKind::Sheet && sheet.area > MIN_GROUND_AREA * room.area && !room.encloses(sheet)
    }

    /// Adds the places of the faces that are connected with one by overlaps.
    fn order_plane(&self, start: u32, kinds: &HashMap<u32, Kind>, order: &mut PlaneOrder) {
        let (mut members, mut known, mut next) = (vec![start], HashSet::from([start]), 0);
        while let Some(t) = members.get(next) {
            members.extend(self.neighbours[t].iter().filter(|t| known.insert(**t)));
            next += 1;
        }
        let area = |t: u32| match self.facades.contains(&self.of.part(t)) {
            true => f64::INFINITY,
            false => self.of.shape(t).area,
        };
        members.sort_by(|&s, &t| area(s).total_cmp(&area(t)).then(t.cmp(&s)));
        let is_sheet = |t: &&u32| matches!(kinds[*t], Kind::Sheet);
        let default = members
            .iter()
            .rfind(is_sheet)
            .map(|&largest| self.side_of_sheet(largest, kinds).unwrap_or_else(|| self.normal(largest)));
        let side = |t: u32| match kinds[&t] {
            Kind::Wall(side) | Kind::Fixed(side) => (side, false),
            Kind::Body(inside) => (inside, true),
            Kind::Sheet => {
                (self.side_of_sheet(t, kinds).or(default).unwrap_or_else(|| self.normal(t)), false)
            }
        };
        let has_walls = members.iter().any(|t| matches!(kinds[t], Kind::Wall(_)));
        let sides: Vec<(u32, (Vec3, bool))> = members.iter().map(|&t| (t, side(t))).collect();
        // The front is where the smallest face is visible.
        let visible = sides.iter().find(|(_, (_, is_body))| !is_body);
        let axis = visible.map_or(-sides[0].1.0, |(_, (side, _))| *side);
        for (t, (side, is_body)) in sides {
            let rank = match (is_body, side.dot(axis) > 0.0) {
                (true, true) => Rank::BodyBefore,
                (false, true) => Rank::Front,
                (false, false) => Rank::Back,
                (true, false) => Rank::BodyBehind,
            };
            order.insert(
                t,
                Place { plane: start, axis, rank, area: area(t), has_walls, is_sheet: is_sheet(&&t) },
            );
        }
    }
}
