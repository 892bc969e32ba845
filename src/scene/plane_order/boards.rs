//! Sheets of several surfaces that continue each other, such as boards on a floor and the slabs of a ground.

use super::{AREA_STEP, Continued, Kind, PartKind, Planes, rounded};
use glam::Vec3;
use rustc_hash::{FxHashMap, FxHashSet};
use std::collections::{BTreeMap, BTreeSet};

/// Smallest part of the area of boards that the floors below them have. Boards that reach 5 cm below the walls around a room of 2 m by
/// 1.5 m: 0.89; a slab that reaches half a metre beyond a house of 10 m by 8 m: 0.81.
const MIN_FLOORS: f64 = 0.85;

/// Surfaces that continue each other.
#[derive(Default)]
pub(super) struct SheetOfPieces {
    /// Scene units squared.
    area: f64,
    parts: BTreeSet<u32>,
    /// Whether pieces overlap each other: mats in a doorway continue the floors of both rooms.
    overlaps_itself: bool,
    /// The overlapping faces of other open surfaces that face as the sheet does and have walls around them.
    floors: BTreeSet<u32>,
    /// By overlapping face of rooms that do not enclose the sheet, the area that overlaps, scene units squared: of faces visible from the
    /// back of the sheet, and of those visible from its front.
    of_rooms: [BTreeMap<u32, f64>; 2],
}

impl SheetOfPieces {
    /// Whether [`MIN_FLOORS`] of it overlaps with faces of rooms, those visible from its back (0) or front (1).
    fn is_on_rooms(&self, side: usize) -> bool {
        self.of_rooms[side].values().sum::<f64>() >= MIN_FLOORS * self.area
    }
}

impl Planes<'_> {
    /// By [`Continued::joined`], the sheets of more than one surface.
    pub(super) fn sheets_of_pieces(&self) -> BTreeMap<u32, SheetOfPieces> {
        let mut sheets = BTreeMap::<u32, SheetOfPieces>::new();
        for (&t, neighbours) in self.neighbours.iter().filter(|(t, _)| self.is_counted_alone(**t)) {
            let Continued { joined, area, joined_area, .. } = self.continued[&t];
            if joined_area == area {
                continue;
            }
            let sheet = sheets.entry(joined).or_default();
            sheet.area = joined_area;
            sheet.parts.insert(self.of.part(t));
            for &u in neighbours {
                let of = self.continued_open(u);
                sheet.overlaps_itself |= of.is_some_and(|of| of.joined == joined);
                let is_floor = of.is_some_and(|of| of.has_walls_around && of.joined != joined);
                if is_floor && self.normal(t).dot(self.normal(u)) > 0.0 {
                    sheet.floors.insert(u);
                }
            }
        }
        let joined = |t: u32| self.continued.get(&t).map(|of| of.joined);
        let mut in_rooms = FxHashMap::default();
        for (t, u, area) in self.found.iter().flat_map(|&(s, t, area)| [(s, t, area), (t, s, area)]) {
            let Some(sheet) = joined(t).and_then(|of| sheets.get_mut(&of)) else { continue };
            let Some(inside) = self.inside(u).filter(|_| joined(u) != joined(t)) else { continue };
            let is_enclosed = |&part: &u32| self.of.shape(u).encloses(&self.of.shapes[part as usize]);
            let is_in_room = || sheet.parts.iter().all(is_enclosed);
            if !*in_rooms.entry((joined(t), self.of.part(u))).or_insert_with(is_in_room) {
                *sheet.of_rooms[usize::from(inside.dot(self.normal(t)) > 0.0)].entry(u).or_default() += area;
            }
        }
        for rooms in sheets.values_mut().flat_map(|sheet| &mut sheet.of_rooms) {
            self.remove_inner(rooms);
        }
        sheets
    }

    /// Removes the faces of rooms that lie in others, as in the shell of a house.
    fn remove_inner(&self, faces: &mut BTreeMap<u32, f64>) {
        let parts: BTreeSet<u32> = faces.keys().map(|&t| self.of.part(t)).collect();
        let shape = |part: u32| &self.of.shapes[part as usize];
        let lies_in = |p: u32, q: u32| shape(q).encloses(shape(p)) && shape(q).area > shape(p).area;
        let is_inner = |p: &u32| parts.iter().any(|&q| lies_in(*p, q));
        let inner: FxHashSet<u32> = parts.iter().copied().filter(is_inner).collect();
        faces.retain(|&t, _| !inner.contains(&self.of.part(t)));
    }

    /// The side on which the room of a wall or floor lies.
    fn inside(&self, t: u32) -> Option<Vec3> {
        match self.kind(t) {
            Kind::Wall(inside) => Some(inside),
            Kind::Body(_) => None,
            Kind::Sheet | Kind::Fixed(_) => {
                self.continued_open(t).is_some_and(|of| of.has_walls_around).then(|| self.normal(t))
            }
        }
    }

    /// Areas that floors count for at least, as boards lie on them, by triangle; scene units squared. Boards may reach below the walls
    /// around one or more floors. They lie on these where the floors have [`MIN_FLOORS`] of their area.
    pub(super) fn areas_of_boards(&self) -> FxHashMap<u32, f64> {
        let mut areas = FxHashMap::<u32, f64>::default();
        for boards in self.sheets_of_pieces.values() {
            let floors = self.without_mats(&boards.floors);
            let surfaces = floors.iter().map(|t| &self.continued[t]).map(|of| (of.surface, of.area));
            let area: f64 = surfaces.collect::<BTreeMap<u32, f64>>().into_values().sum();
            let mut raised = if area >= MIN_FLOORS * boards.area { floors } else { Vec::new() };
            // Boards may be larger than all faces of a closed room together.
            if !boards.overlaps_itself && boards.is_on_rooms(1) {
                let is_wall = |t: &u32| matches!(self.kind(*t), Kind::Wall(_));
                raised.extend(boards.of_rooms[1].keys().copied().filter(is_wall));
            }
            for t in raised {
                let area = areas.entry(t).or_default();
                *area = area.max(boards.area * (1.0 + AREA_STEP));
            }
        }
        areas
    }

    /// These faces without the surfaces that lie on larger ones of them, such as a mat in the corner of a floor.
    fn without_mats(&self, faces: &BTreeSet<u32>) -> Vec<u32> {
        let surface = |t: u32| self.continued[&t].surface;
        let area = |t: u32| rounded(self.continued[&t].area);
        let lies_on = |t: u32, u: u32| area(t) < area(u);
        let lies_on_any =
            |t: &&u32| self.neighbours[*t].iter().any(|u| faces.contains(u) && lies_on(**t, *u));
        let mats: FxHashSet<u32> = faces.iter().filter(lies_on_any).map(|&t| surface(t)).collect();
        faces.iter().copied().filter(|&t| !mats.contains(&surface(t))).collect()
    }

    /// Whether a sheet of more than one surface is outside of the room of a wall; `None` if the sheet is one surface or overlaps itself. It
    /// is a ground, and not boards, if it extends beyond the room and the faces of rooms that it overlaps with have less than
    /// [`MIN_FLOORS`] of its area.
    pub(super) fn is_ground_of_pieces(&self, sheet: u32, wall: u32) -> Option<bool> {
        let of = self.continued_open(sheet).filter(|_| self.is_counted_alone(sheet))?;
        let pieces = self.sheets_of_pieces.get(&of.joined).filter(|pieces| !pieces.overlaps_itself)?;
        let room = self.of.shape(wall);
        let inside = self.inside(wall).unwrap_or_else(|| self.normal(wall));
        let is_beyond = |&part: &u32| !room.encloses(&self.of.shapes[part as usize]);
        let is_on_rooms = pieces.is_on_rooms(usize::from(inside.dot(self.normal(sheet)) > 0.0));
        Some(room.kind != PartKind::Sheet && !is_on_rooms && pieces.parts.iter().any(is_beyond))
    }
}
