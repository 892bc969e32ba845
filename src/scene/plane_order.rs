//! Order of overlapping faces of one plane: which of them is visible from which side.
//!
//! Overlapping faces are of these kinds:
//! * *Walls of rooms* are visible from inside; smaller faces lie before larger ones.
//! * *Faces of bodies*, such as furniture, are visible from outside where nothing covers them: every other face lies before them, except
//!   walls of rooms inside them.
//! * *Sheets* lie on the side of what they cover: rugs and posters inside of rooms. A ground on which a room stands, or below which it
//!   lies, is outside of the room. Sheets on each other are visible from the front of the largest.
//! * Lamps, facades, and the two sides of one sheet are visible from their fronts.

mod boards;

use super::continuations::{Continued, continuations};
use super::overlap::{FaceProperties, Faces, Overlap};
use super::part_shapes::PartKind;
use crate::math::{triangle_area, triangle_normal};
use glam::Vec3;
use rustc_hash::{FxHashMap, FxHashSet};
use std::cmp::{Ordering, Reverse};
use std::collections::BTreeMap;

/// Smallest fraction of the area of a facade that lies on walls of the rooms in it: most of it, as a room whose normals point out also
/// touches cupboards whose normals point in.
const MIN_FACADE_COVER: f64 = 0.5;

/// Smallest fraction of the area of sheets turned away from each other that overlaps if they are the two sides of one sheet. Borders that
/// were rounded or drawn by hand leave less than a hundredth.
const MIN_SHEET_COVER: f64 = 0.99;

/// Smallest fraction of the area of a covering that lies on bodies, and largest fraction of the area of each body that it covers: more than
/// half, as the bottom and two sides of a crate that stands in a corner of another one are three faces of five.
const MIN_COVERING: f64 = 0.6;

/// Bits by which areas are compared: equal surfaces that are divided into different triangles differ by rounding.
const AREA_BITS: u32 = 16;

/// Relative difference of areas that is larger than rounding.
const AREA_STEP: f64 = 4.0 / (1 << AREA_BITS) as f64;

/// An area without the bits that rounding changes.
fn rounded(area: f64) -> f64 {
    let dropped = f64::MANTISSA_DIGITS - AREA_BITS;
    f64::from_bits((area.to_bits() + (1 << (dropped - 1))) >> dropped << dropped)
}

/// Place of a face among those that it is connected with by overlaps. Places of one plane are ordered along its axis, from the front.
pub(super) struct Place {
    /// The first triangle of the plane.
    pub plane: u32,
    /// The normal of the plane.
    pub axis: Vec3,
    pub rank: Rank,
    /// Areas by which faces are sorted, one after the other, scene units squared. Infinity for facades: these lie behind all faces of
    /// rooms. 0. The larger one of: the area of the largest room that the face is outside of, the area of its surface with those that
    /// continue it. 1. The area of its surface. 2. The area of its part if walls stand on its surface, otherwise 0.
    areas: [f64; 3],
    /// Whether walls of rooms lie in the plane.
    has_walls: bool,
    /// Whether the face belongs to an open body: of two boxes in each other, the smaller one is the inner one.
    is_open_body: bool,
    is_sheet: bool,
    /// Whether the front is not the side on which it is visible.
    is_turned: bool,
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
    /// Order of the faces at two places of one plane: by rank; then smaller faces lie nearer to the viewer, of open bodies larger ones;
    /// then later faces of the file.
    pub fn compare(&self, index: u32, other: &Place, index_of_other: u32) -> Ordering {
        let signed = |of: &Place| of.areas.map(|area| if of.is_open_body { -area } else { area });
        let [a, b] = [signed(self), signed(other)];
        let by_area = other.is_open_body.cmp(&self.is_open_body);
        let by_area = (0..3).fold(by_area, |order, k| order.then(a[k].total_cmp(&b[k])));
        let by_area = by_area.then(index_of_other.cmp(&index));
        let is_reversed = matches!(self.rank, Rank::BodyBefore | Rank::Back);
        self.rank.cmp(&other.rank).then(if is_reversed { by_area.reverse() } else { by_area })
    }
}

/// The places of all triangles that overlap with others.
pub(super) type PlaneOrder = FxHashMap<u32, Place>;

/// Whether an overlap of two triangles, `alike` if they face the same way, is worth a message: they are visible from the same side, so that
/// one hides the other, or a sheet is visible from its back.
pub(super) fn may_hide(order: &PlaneOrder, s: u32, t: u32, alike: bool) -> bool {
    let [s, t] = [&order[&s], &order[&t]];
    let are_visible = s.rank == t.rank || !s.has_walls && (s.rank.is_of_body() || t.rank.is_of_body());
    are_visible && (alike || [s, t].iter().any(|of| of.is_sheet && of.is_turned))
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
        return PlaneOrder::default();
    }
    let planes = Planes::new(found, faces);
    let kinds = planes.kinds();
    let mut order = PlaneOrder::default();
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
    neighbours: FxHashMap<u32, Vec<u32>>,
    facades: FxHashSet<u32>,
    /// See [`Planes::coverings`].
    coverings: FxHashSet<u32>,
    /// See [`Planes::furnished`].
    furnished: FxHashSet<u32>,
    /// How the surfaces of open parts continue, by triangle.
    continued: FxHashMap<u32, Continued>,
    /// See [`Planes::areas_of_boards`].
    areas_of_boards: FxHashMap<u32, f64>,
    /// See [`Planes::areas_under`].
    areas_under: FxHashMap<[u32; 2], f64>,
    /// See [`Planes::sheets_of_pieces`].
    sheets_of_pieces: BTreeMap<u32, boards::SheetOfPieces>,
}

impl<'a> Planes<'a> {
    fn new(found: &'a [Overlap], faces: &'a Faces<'a>) -> Self {
        let mut neighbours = FxHashMap::<u32, Vec<u32>>::default();
        for &(s, t, _) in found {
            neighbours.entry(s).or_default().push(t);
            neighbours.entry(t).or_default().push(s);
        }
        let mut planes = Planes {
            found,
            faces,
            of: faces.properties,
            neighbours,
            facades: FxHashSet::default(),
            coverings: FxHashSet::default(),
            furnished: FxHashSet::default(),
            continued: FxHashMap::default(),
            areas_of_boards: FxHashMap::default(),
            areas_under: FxHashMap::default(),
            sheets_of_pieces: BTreeMap::new(),
        };
        planes.facades = planes.facades();
        planes.coverings = planes.coverings();
        planes.furnished = planes.furnished();
        planes.areas_under = planes.areas_under();
        planes.continued = continuations(&planes.uncertain(), faces);
        planes.sheets_of_pieces = planes.sheets_of_pieces();
        planes.areas_of_boards = planes.areas_of_boards();
        planes
    }

    fn normal(&self, t: u32) -> Vec3 {
        let [a, b, c] = self.faces.triangles[t as usize].map(|v| self.faces.positions[v as usize]);
        triangle_normal(a, b, c)
    }

    fn area_of(&self, t: u32) -> f64 {
        let [a, b, c] = self.faces.triangles[t as usize].map(|v| self.faces.positions[v as usize]);
        triangle_area(a, b, c)
    }

    /// The overlaps of faces turned away from each other.
    fn turned_away(&self) -> impl Iterator<Item = &Overlap> {
        self.found.iter().filter(|&&(s, t, _)| self.normal(s).dot(self.normal(t)) < 0.0)
    }

    /// The parts that are facades: most of their area lies on walls of rooms in them.
    fn facades(&self) -> FxHashSet<u32> {
        let is_facade_of = |facade: u32, room: u32, is_away: bool| {
            let [facade, room] = [facade, room].map(|t| self.of.shape(t));
            let is_room_of = match (facade.kind, room.kind) {
                (PartKind::Solid, PartKind::Room) => is_away,
                // Where the normals of rooms point out: of boxes of one size, the one with fewer faces.
                (PartKind::Solid, PartKind::Solid) => {
                    let is_larger = !room.encloses(facade) || room.area > facade.area;
                    !is_away && room.is_lit_inside && is_larger
                }
                // Where all normals are reversed.
                (PartKind::Room, PartKind::Solid) => is_away && room.is_lit_inside && !room.encloses(facade),
                _ => false,
            };
            is_room_of && facade.encloses(room)
        };
        let mut covered = FxHashMap::<u32, f64>::default();
        for &(s, t, area) in self.found {
            let is_away = self.normal(s).dot(self.normal(t)) < 0.0;
            for (facade, _) in [(s, t), (t, s)].into_iter().filter(|&(s, t)| is_facade_of(s, t, is_away)) {
                *covered.entry(self.of.part(facade)).or_default() += area;
            }
        }
        let is_facade =
            |&(part, area): &(u32, f64)| area >= MIN_FACADE_COVER * self.of.shapes[part as usize].area;
        covered.into_iter().filter(is_facade).map(|(part, _)| part).collect()
    }

    /// Open parts most of whose area lies on bodies that face as these parts do and of which they cover no more than a part, as the runner
    /// on a stair and its landing.
    fn coverings(&self) -> FxHashSet<u32> {
        let alike = self.found.iter().filter(|&&(s, t, _)| self.normal(s).dot(self.normal(t)) > 0.0);
        let mut on_body = BTreeMap::<[u32; 2], f64>::new();
        for &(s, t, area) in alike {
            for (open, body) in [(s, t), (t, s)] {
                if self.of.is_two_sided(open) && self.of.shape(body).kind != PartKind::Sheet {
                    *on_body.entry([open, body].map(|t| self.of.part(t))).or_default() += area;
                }
            }
        }
        let area_of = |part: u32| self.of.shapes[part as usize].area;
        let mut covered = FxHashMap::<u32, f64>::default();
        for ([part, body], area) in on_body {
            if area <= MIN_COVERING * area_of(body) {
                *covered.entry(part).or_default() += area;
            }
        }
        covered.retain(|&part, area| *area > MIN_COVERING * area_of(part));
        covered.into_keys().collect()
    }

    /// By two parts, the area of the triangles of the second one that overlap with the first one, scene units squared.
    fn areas_under(&self) -> FxHashMap<[u32; 2], f64> {
        let pairs = self.found.iter().flat_map(|&(s, t, _)| [(self.of.part(s), t), (self.of.part(t), s)]);
        let mut pairs: Vec<(u32, u32)> = pairs.collect();
        pairs.sort_unstable();
        pairs.dedup();
        let mut areas = FxHashMap::default();
        for (part, t) in pairs {
            *areas.entry([part, self.of.part(t)]).or_default() += self.area_of(t);
        }
        areas
    }

    /// The faces whose sides do not follow from the kind of their part: those of open parts, and of parts that touch themselves.
    fn uncertain(&self) -> FxHashSet<u32> {
        let is_open = |t: &u32| self.of.is_two_sided(*t) || self.of.shape(*t).kind == PartKind::Sheet;
        let is_of_one_part = |&&(s, t, _): &&Overlap| self.of.part(s) == self.of.part(t);
        let mut uncertain: FxHashSet<u32> = self.neighbours.keys().copied().filter(is_open).collect();
        uncertain.extend(self.turned_away().filter(is_of_one_part).flat_map(|&(s, t, _)| [s, t]));
        uncertain
    }

    /// How the surface of a face of an open part continues.
    fn continued_open(&self, t: u32) -> Option<&Continued> {
        self.continued.get(&t).filter(|_| self.of.is_two_sided(t))
    }

    /// The area of the part of a face, or of its surface if that is a flap or belongs to a covering; scene units squared. First with all
    /// surfaces that continue it without a sharp edge, or that of the boards that lie on it, then its own.
    fn areas(&self, t: u32) -> [f64; 2] {
        let below = self.areas_of_boards.get(&t).copied().unwrap_or(0.0);
        let [joined, own] = match self.continued_open(t).filter(|_| self.is_counted_alone(t)) {
            Some(of) => [of.joined_area, of.area],
            None => [self.of.shape(t).area; 2],
        };
        [joined.max(below), own]
    }

    /// Whether the area of the surface of a face counts, not that of its part.
    fn is_counted_alone(&self, t: u32) -> bool {
        self.continued_open(t).is_some_and(|of| of.is_flap || self.coverings.contains(&self.of.part(t)))
    }

    /// Whether walls stand on the borders of the surface of a face of an open part.
    fn is_floor(&self, t: u32) -> bool {
        self.continued_open(t).is_some_and(|of| of.length > 0.0)
    }

    /// The kind of a face by its own part and how it continues.
    fn kind(&self, t: u32) -> Kind {
        let normal = self.normal(t);
        let shape = self.of.shape(t);
        if self.of.emitter[t as usize] != u32::MAX {
            return Kind::Fixed(normal);
        }
        if self.facades.contains(&self.of.part(t)) {
            return Kind::Fixed(if shape.kind == PartKind::Room { -normal } else { normal });
        }
        // Open parts may be several rooms of different winding.
        let is_before = match self.continued_open(t) {
            Some(of) if of.length_of_walls() > 0.0 => true,
            _ if self.coverings.contains(&self.of.part(t)) => return Kind::Sheet,
            Some(of) if of.length_of_walls() < 0.0 => false,
            Some(of) if of.is_flap => return Kind::Sheet,
            _ if shape.kind == PartKind::Sheet => return Kind::Sheet,
            _ => shape.kind == PartKind::Room,
        };
        let is_room = || shape.is_lit_inside || self.furnished.contains(&self.of.part(t));
        match is_before {
            true => Kind::Wall(normal),
            false if is_room() => Kind::Wall(-normal),
            false => Kind::Body(-normal),
        }
    }

    /// The kind of each overlapping face.
    fn kinds(&self) -> FxHashMap<u32, Kind> {
        let mut kinds: FxHashMap<u32, Kind> = self.neighbours.keys().map(|&t| (t, self.kind(t))).collect();
        for t in self.grounds_by_edges(&kinds) {
            kinds.insert(t, Kind::Sheet);
        }
        for t in self.standing_glowing_boxes(&kinds) {
            kinds.insert(t, Kind::Body(-self.normal(t)));
        }
        let fixed = self.sides_of_sheets(&kinds).into_iter().chain(self.bodies_around_rooms(&kinds));
        fixed.collect::<Vec<_>>().into_iter().for_each(|t| {
            kinds.insert(t, Kind::Fixed(self.normal(t)));
        });
        kinds
    }

    /// The open solids that are rooms whose normals point out: on their faces lie sheets inside of them that face inwards.
    fn furnished(&self) -> FxHashSet<u32> {
        let holds = |&(solid, sheet): &(u32, u32)| {
            let [part, held] = [solid, sheet].map(|t| self.of.shape(t));
            let kinds = part.kind == PartKind::Solid && held.kind == PartKind::Sheet;
            kinds && self.of.is_two_sided(solid) && held.area < part.area && part.encloses(held)
        };
        let pairs = self.turned_away().flat_map(|&(s, t, _)| [(s, t), (t, s)]);
        pairs.filter(holds).map(|(solid, _)| self.of.part(solid)).collect()
    }

    /// The faces that are sides of a sheet: they overlap with faces that are turned away and belong to the same part, unless both continue
    /// to opposite sides as walls of two rooms do, or to another sheet that covers theirs and is covered by it.
    fn sides_of_sheets(&self, kinds: &FxHashMap<u32, Kind>) -> FxHashSet<u32> {
        let mut covered = FxHashMap::<u32, f64>::default();
        for &(s, t, area) in self.turned_away() {
            [s, t].into_iter().for_each(|t| *covered.entry(self.of.part(t)).or_default() += area);
        }
        let is_covered_sheet = |t: u32| {
            let area = self.of.shape(t).area;
            matches!(kinds[&t], Kind::Sheet) && covered[&self.of.part(t)] >= MIN_SHEET_COVER * area
        };
        let is_sheet = |&&(s, t, _): &&Overlap| match self.of.part(s) == self.of.part(t) {
            true => self.continued[&s].length_of_walls() * self.continued[&t].length_of_walls() <= 0.0,
            false => is_covered_sheet(s) && is_covered_sheet(t),
        };
        self.turned_away().filter(is_sheet).flat_map(|&(s, t, _)| [s, t]).collect()
    }

    /// The sheets that continue as a wall does, but lie outside of a room that has a wall of its own there: slabs between storeys.
    fn grounds_by_edges(&self, kinds: &FxHashMap<u32, Kind>) -> Vec<u32> {
        let is_beside = |sheet: u32, wall: u32| match (kinds[&sheet], kinds[&wall]) {
            (Kind::Wall(side), Kind::Wall(inside)) => {
                side.dot(inside) > 0.0 && self.is_ground_of(sheet, wall)
            }
            _ => false,
        };
        let sheets = self.neighbours.iter().filter(|(t, _)| self.of.shape(**t).kind == PartKind::Sheet);
        let grounds = sheets.filter(|(sheet, beside)| beside.iter().any(|&wall| is_beside(**sheet, wall)));
        grounds.map(|(&sheet, _)| sheet).collect()
    }

    /// The faces of closed boxes that glow on all sides and stand on a sheet or touch a wall of their own room, such as a lamp on a table.
    /// A box behind a wall, or on a sheet that faces the same way, is recessed and not among them.
    fn standing_glowing_boxes(&self, kinds: &FxHashMap<u32, Kind>) -> Vec<u32> {
        let glows = |t: u32| self.of.emitter[t as usize] != u32::MAX;
        let stands = |t: &u32| {
            let inwards = -self.normal(*t);
            let walls = || self.neighbours[t].iter().filter(|u| matches!(kinds[*u], Kind::Wall(_)));
            let is_in_room = |u: &u32| matches!(kinds[u], Kind::Wall(inside) if inside.dot(inwards) > 0.0);
            let is_on = |u: &u32| !matches!(kinds[u], Kind::Fixed(_)) && self.normal(*u).dot(inwards) > 0.0;
            let is_box = glows(*t) && !self.of.is_two_sided(*t);
            is_box
                && if walls().next().is_some() {
                    walls().all(is_in_room)
                } else {
                    self.neighbours[t].iter().all(is_on)
                }
        };
        let mut standing: Vec<u32> = self.neighbours.keys().copied().filter(stands).collect();
        if !standing.is_empty() {
            let dark = (0..self.faces.triangles.len() as u32).filter(|&t| !glows(t));
            let dark: FxHashSet<u32> = dark.map(|t| self.of.part(t)).collect();
            standing.retain(|&t| !dark.contains(&self.of.part(t)));
        }
        standing
    }

    /// The faces of solids beyond walls of rooms in these solids.
    fn bodies_around_rooms(&self, kinds: &FxHashMap<u32, Kind>) -> Vec<u32> {
        let is_around = |body: u32, wall: u32| match (kinds[&body], kinds[&wall]) {
            (Kind::Body(around), Kind::Wall(inside)) => {
                let [body, room] = [body, wall].map(|t| self.of.shape(t));
                around.dot(inside) > 0.0 && body.kind == PartKind::Solid && body.encloses(room)
            }
            _ => false,
        };
        let pairs = self.found.iter().flat_map(|&(s, t, _)| [(s, t), (t, s)]);
        pairs.filter(|&(body, wall)| is_around(body, wall)).map(|(body, _)| body).collect()
    }

    /// The side from which a sheet is visible, by the walls, facades and lamps that it overlaps with; `None` if it overlaps with none.
    fn side_of_sheet(&self, t: u32, kinds: &FxHashMap<u32, Kind>) -> Option<Vec3> {
        let neighbours = || self.neighbours[&t].iter();
        let is_facade = |u: &u32| self.facades.contains(&self.of.part(*u));
        // A mat on the terrace above a room faces away from the room.
        let is_on_ground = |wall: u32, inside: Vec3| {
            let is_ground = |u: &&u32| {
                matches!(kinds[*u], Kind::Sheet)
                    && self.normal(**u).dot(inside) < 0.0
                    && self.is_ground_of(**u, wall)
            };
            self.normal(t).dot(inside) < 0.0 && neighbours().any(|u| is_ground(&u))
        };
        let by_wall = |u: &u32| match kinds[u] {
            Kind::Wall(inside) if !self.is_ground_of(t, *u) && !is_on_ground(*u, inside) => Some(inside),
            _ => None,
        };
        let by_fixed = |u: &u32| match kinds[u] {
            Kind::Fixed(side) => Some(side),
            _ => None,
        };
        let agreed = |side: &dyn Fn(&u32) -> Option<Vec3>| {
            let mut sides = neighbours().filter_map(side);
            let first = sides.next()?;
            // Between walls of two rooms it lies on its own side.
            Some(if sides.all(|side| side.dot(first) > 0.0) { first } else { self.normal(t) })
        };
        let is_ground = || neighbours().any(|u| matches!(kinds[u], Kind::Wall(_)));
        agreed(&by_wall)
            .or_else(|| is_ground().then(|| self.normal(t)))
            .or_else(|| agreed(&|u| by_fixed(u).filter(|_| is_facade(u))))
            .or_else(|| agreed(&by_fixed))
    }

    /// A little more than the area of the largest room whose wall overlaps with a sheet that is visible from `side`, faces this side as
    /// well and has the sheet on its outside; scene units squared.
    fn area_inside(&self, t: u32, side: Vec3, kinds: &FxHashMap<u32, Kind>) -> f64 {
        let is_inside = |u: &&u32| match kinds[*u] {
            Kind::Wall(inside) => inside.dot(side) > 0.0 && self.is_ground_of(t, **u),
            _ => false,
        };
        let beyond = |&u: &u32| self.of.shape(u).area * (1.0 + AREA_STEP);
        let areas = self.neighbours[&t].iter().filter(is_inside).map(beyond);
        areas.fold(0.0, f64::max)
    }

    /// Whether a sheet is outside of the room of a wall: it is larger than the faces of the room that it overlaps with, and extends beyond
    /// the room. See [`Planes::is_ground_of_pieces`] for sheets of more than one surface.
    fn is_ground_of(&self, sheet: u32, wall: u32) -> bool {
        if let Some(is_ground) = self.is_ground_of_pieces(sheet, wall) {
            return is_ground;
        }
        let [sheet_part, wall_part] = [sheet, wall].map(|t| self.of.part(t));
        let [sheet, room] = [sheet, wall].map(|t| self.of.shape(t));
        let is_larger = || sheet.area > self.areas_under[&[sheet_part, wall_part]];
        room.kind != PartKind::Sheet && !room.encloses(sheet) && is_larger()
    }

    /// Adds the places of the faces that are connected with one by overlaps.
    fn order_plane(&self, start: u32, kinds: &FxHashMap<u32, Kind>, order: &mut PlaneOrder) {
        let (mut members, mut known, mut next) = (vec![start], FxHashSet::from_iter([start]), 0);
        while let Some(t) = members.get(next) {
            members.extend(self.neighbours[t].iter().filter(|t| known.insert(**t)));
            next += 1;
        }
        let areas = |t: u32| match self.facades.contains(&self.of.part(t)) {
            true => [f64::INFINITY; 2],
            false => self.areas(t),
        };
        // Bits of positive numbers are in the order of these.
        members.sort_by_cached_key(|&t| (areas(t).map(|area| rounded(area).to_bits()), Reverse(t)));
        let is_sheet = |t: &&u32| matches!(kinds[*t], Kind::Sheet);
        let default = members
            .iter()
            .rfind(is_sheet)
            .map(|&largest| self.side_of_sheet(largest, kinds).unwrap_or_else(|| self.normal(largest)));
        /// A face and the side on which it is visible or its body lies.
        struct Member {
            t: u32,
            side: Vec3,
            is_body: bool,
        }
        let member = |&t: &u32| match kinds[&t] {
            Kind::Wall(side) | Kind::Fixed(side) => Member { t, side, is_body: false },
            Kind::Body(side) => Member { t, side, is_body: true },
            Kind::Sheet => {
                let side = self.side_of_sheet(t, kinds).or(default).unwrap_or_else(|| self.normal(t));
                Member { t, side, is_body: false }
            }
        };
        let has_walls = members.iter().any(|t| matches!(kinds[t], Kind::Wall(_)));
        let members: Vec<Member> = members.iter().map(member).collect();
        // The front is where the smallest face is visible.
        let visible = members.iter().find(|of| !of.is_body);
        let axis = visible.map_or(-members[0].side, |of| of.side);
        for Member { t, side, is_body } in members {
            let rank = match (is_body, side.dot(axis) > 0.0) {
                (true, true) => Rank::BodyBefore,
                (false, true) => Rank::Front,
                (false, false) => Rank::Back,
                (true, false) => Rank::BodyBehind,
            };
            let place = Place {
                plane: start,
                axis,
                rank,
                areas: [
                    areas(t)[0].max(if is_sheet(&&t) { self.area_inside(t, side, kinds) } else { 0.0 }),
                    areas(t)[1],
                    if self.is_floor(t) { self.of.shape(t).area } else { 0.0 },
                ]
                .map(rounded),
                has_walls,
                is_open_body: is_body && self.of.is_two_sided(t),
                is_sheet: is_sheet(&&t),
                is_turned: self.normal(t).dot(side) < 0.0,
            };
            order.insert(t, place);
        }
    }
}
