//! The cells of a point's grid of rays, divided where neighbours differ, with the sums of their light.

use super::uneven_cells::{Cell, WHOLE};
use glam::DVec3;

/// Smallest error of the light of the sky in a cell, relative to that light: places in the cell that agree by chance have one as well. It matters only where all
/// agree.
const MIN_CELL_ERROR: f64 = 0.01;

/// A grid of cells whose levels are those of the quarters of cells of the level before.
pub(super) struct DividedGrid {
    levels: Vec<Vec<Cell>>,
    /// Number of cells of the undivided grid.
    whole: usize,
    /// Light of all cells that are not divided, W/m².
    light: DVec3,
    sky: SkyLight,
}

impl DividedGrid {
    /// The undivided grid.
    pub fn new(cells: Vec<Cell>) -> DividedGrid {
        let whole = cells.len();
        let mut grid =
            DividedGrid { levels: Vec::new(), whole, light: DVec3::ZERO, sky: SkyLight::default() };
        grid.add(0, cells);
        grid
    }

    pub fn levels(&self) -> &[Vec<Cell>] {
        &self.levels
    }

    /// Irradiance by all cells, W/m².
    pub fn light(&self) -> DVec3 {
        self.light
    }

    /// Part of the hemisphere that a cell of a level is.
    pub fn area(&self, level: usize) -> f64 {
        0.25f64.powi(level as i32) / self.whole as f64
    }

    /// Takes away the light of cells of a level, whose quarters are to be added next in this order; returns their places.
    pub fn divide(&mut self, level: usize, cells: impl Iterator<Item = u32>) -> Vec<[u32; 2]> {
        let (area, first) = (self.area(level), self.levels.get(level + 1).map_or(0, Vec::len) as u32);
        let mut places = Vec::new();
        for k in cells {
            let cell = &mut self.levels[level][k as usize];
            cell.quarters = first + 4 * places.len() as u32;
            places.push(cell.place);
            self.light -= cell.light.as_dvec3() * area;
            self.sky.add(cell, area, -1.0);
        }
        places
    }

    /// Adds cells to a level.
    pub fn add(&mut self, level: usize, cells: Vec<Cell>) {
        let area = self.area(level);
        for cell in &cells {
            self.light += cell.light.as_dvec3() * area;
            self.sky.add(cell, area, 1.0);
        }
        match self.levels.get_mut(level) {
            Some(others) => others.extend(cells),
            None => self.levels.push(cells),
        }
    }

    /// The cells of a level of cells of one size, so many columns and rows, that are not divided and not known to be uneven, but whose own neighbours differ
    /// if quarters count: a strip of sky that is thinner than a cell goes on there, or one of what hides it.
    pub fn along_strips(&self, level: usize, [columns, rows]: [usize; 2], is_uneven: &[bool]) -> Vec<u32> {
        let cells = &self.levels[level];
        // Whether a place has an open part, and a blocked one.
        let mut parts = vec![[false; 2]; columns * rows];
        for cell in cells {
            let own = match cell.quarters {
                WHOLE => std::slice::from_ref(cell),
                first => &self.levels[level + 1][first as usize..first as usize + 4],
            };
            let parts = &mut parts[cell.place[1] as usize * columns + cell.place[0] as usize];
            own.iter().for_each(|part| parts[usize::from(part.is_open)] = true);
        }
        let differ_around = |[i, j]: [usize; 2]| {
            let mut around = [false; 2];
            for row in j.saturating_sub(1)..=(j + 1).min(rows - 1) {
                for column in (i.saturating_sub(1)..=(i + 1).min(columns - 1)).filter(|c| [*c, row] != [i, j])
                {
                    let [blocked, open] = parts[row * columns + column];
                    around = [around[0] | blocked, around[1] | open];
                }
            }
            around == [true; 2]
        };
        let found = (0u32..).zip(cells).filter(|(k, cell)| {
            cell.quarters == WHOLE
                && cell.sky > 0.0
                && !is_uneven[*k as usize]
                && differ_around(cell.place.map(|at| at as usize))
        });
        found.map(|(k, _)| k).collect()
    }

    /// What must be added to the light of the cells, as the light of the open sky is known, W/m²: the error of all cells times the part of its variance that
    /// cells through which the sky is seen have.
    pub fn compared_with(&self, open: DVec3) -> DVec3 {
        let part = (self.sky.errors[0] / self.sky.errors[1]).clamp(0.0, 1.0);
        let known = self.sky.seen.max_element() > 0.0 && part.is_finite();
        if known { part * (open - self.sky.all) } else { DVec3::ZERO }
    }
}

/// The light of the sky in the cells of a point.
#[derive(Clone, Copy, Default)]
struct SkyLight {
    /// That of cells through which the sky is seen, W/m².
    seen: DVec3,
    /// That of all cells if nothing hid it, W/m².
    all: DVec3,
    /// Squared errors of both, mean over the channels, (W/m²)².
    errors: [f64; 2],
}

impl SkyLight {
    /// Adds a cell that is this part of the hemisphere, or takes it away.
    fn add(&mut self, cell: &Cell, area: f64, sign: f64) {
        let (sky, error) = (f64::from(cell.sky), f64::from(cell.error));
        let error = sign * area * area * (error + (MIN_CELL_ERROR * sky).powi(2));
        self.all += sign * area * cell.unblocked.as_dvec3();
        self.errors[1] += error;
        if cell.is_open {
            self.seen += sign * area * cell.light.as_dvec3();
            self.errors[0] += error;
        }
    }
}
