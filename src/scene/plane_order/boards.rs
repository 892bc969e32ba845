//! Sheets of several surfaces that continue each other, such as boards on a floor and the slabs of a ground.

use super::{AREA_STEP, Continued, PartKind, Planes, rounded};
use rustc_hash::{FxHashMap, FxHashSet};
use std::collections::{BTreeMap, BTreeSet};

/// Smallest part of the area of boards that the floors below them have: boards that reach 2 cm below the walls around a room of 1.2 m have
/// 6 % more than its floor.
const MIN_FLOORS: f64 = 0.9;

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
    /// The overlapping faces of rooms and bodies, and those with walls around them: those that face the other way, and those that face as
    /// the sheet does.
    covered: [BTreeSet<u32>; 2],
    /// Areas of `covered`, scene units squared.
    covered_areas: [f64; 2],
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
                let is_alike = self.normal(t).dot(self.normal(u)) > 0.0;
                let of = self.continued_open(u);
                sheet.overlaps_itself |= of.is_some_and(|of| of.joined == joined);
                let of = of.filter(|of| of.joined != joined);
                let is_floor = of.is_some_and(|of| of.has_walls_around);
                if is_alike && is_floor {
                    sheet.floors.insert(u);
                }
                let is_of_room = of.is_some_and(|of| of.length_of_walls() != 0.0);
                if is_floor || is_of_room || self.of.shape(u).kind != PartKind::Sheet {
                    sheet.covered[usize::from(is_alike)].insert(u);
                }
            }
        }
        for sheet in sheets.values_mut() {
            let area = |faces: &BTreeSet<u32>| faces.iter().map(|&t| self.area_of(t)).sum();
            sheet.covered_areas = sheet.covered.each_ref().map(area);
        }
        sheets
    }

    /// Areas that floors count for at least, as boards lie on them, by triangle; scene units squared. Boards may reach below the walls
    /// around one or more floors. They lie on these where the floors have [`MIN_FLOORS`] of their area.
    pub(super) fn areas_of_boards(&self) -> FxHashMap<u32, f64> {
        let mut areas = FxHashMap::<u32, f64>::default();
        for boards in self.sheets_of_pieces.values() {
            let floors = self.without_mats(&boards.floors);
            let surfaces = floors.iter().map(|t| &self.continued[t]).map(|of| (of.surface, of.area));
            let area: f64 = surfaces.collect::<BTreeMap<u32, f64>>().into_values().sum();
            if area >= MIN_FLOORS * boards.area {
                for t in floors {
                    let area = areas.entry(t).or_default();
                    *area = area.max(boards.area * (1.0 + AREA_STEP));
                }
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
        let rooms = pieces.covered_areas[usize::from(self.normal(sheet).dot(self.normal(wall)) > 0.0)];
        let is_beyond = |&part: &u32| !room.encloses(&self.of.shapes[part as usize]);
        let is_larger = rooms < MIN_FLOORS * pieces.area;
        Some(room.kind != PartKind::Sheet && is_larger && pieces.parts.iter().any(is_beyond))
    }
}
