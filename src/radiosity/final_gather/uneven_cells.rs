//! Selects the cells of a point's grid of rays to divide: those that differ from their neighbours.

use super::cells_around::{NeighbourRanges, RayCell, Surroundings};
use glam::Vec3;

/// Standard deviation of the open fraction of a cell that only its ray determines: two rays locate an edge at a random place in their two
/// cells to √(1/12) = .29 of a cell.
const ERROR_OF_EDGE: f64 = 0.29;
/// The same for a gradient of radiance: a random sample in a cell deviates by √(1/12) of the difference over the cell. Cells of the
/// undivided grid have two samples that mirror each other, which leave a quarter of this deviation where the gradient is not uniform.
/// Smaller cells may contain the horizon or the edge of a bright part of the sky.
const ERROR_OF_GRADIENT: f64 = ERROR_OF_EDGE / 4.0;
/// The error asked for by default, relative to the mean irradiance: that of [`Options::error`](crate::radiosity::Options::error).
pub(super) const DEFAULT_ERROR: f64 = 0.02;
/// Tolerated error of the light of the sky at a point, relative to all light of the point, as a fraction of the error asked for. It
/// adds √(1 + 0.1²) − 1 = 0.5 % to the error that the other light may have.
pub(super) const TOLERANCE: f64 = 0.1;
/// Weight of squared errors of the light of surfaces, whose error may be about the error asked for instead of a tenth of it.
const WEIGHT_OF_SURFACES: f64 = TOLERANCE * TOLERANCE;

/// Fraction of the tolerated squared error of the sky's light down to which cells are divided further where it is cheap: half of the
/// error.
const CHEAP_TOLERANCE: f64 = 0.25;
/// Division is cheap where the next level has at most this many times the rays so far. Edges along lines, as of roofs and windows, need
/// about as many rays again to reduce the error to a third. Edges in all cells, as of foliage, need three times as many to halve it.
const CHEAP_RAYS: usize = 2;

/// A cell that may be divided, by its index in its level.
pub(super) struct UnevenCell {
    pub cell: u32,
    /// Squares of the expected errors of the light of sky and surfaces, (W/m²)², that of surfaces times [`WEIGHT_OF_SURFACES`].
    pub errors: [f64; 2],
}

impl UnevenCell {
    pub fn error(&self) -> f64 {
        self.errors[0] + self.errors[1]
    }
}

impl Surroundings<'_> {
    /// The cells of the finest level, each of `area`, whose neighbours differ from each other, and the cells whose neighbours are all
    /// open. The ray of a cell itself does not decide whether it is divided: otherwise partly open cells whose ray happens to be blocked
    /// would stay undivided. A neighbour at a coarser level counts as its larger cell. A cell at the rim of the hemisphere is also
    /// compared with all others of the finest level at the rim. At `openings`, points of the grid's unit square, the sky is visible:
    /// cells there and beside them count as neighbours of an open cell.
    pub fn uneven(&self, area: f64, openings: &[[f32; 2]]) -> (Vec<UnevenCell>, Vec<u32>) {
        let finest = self.levels.len() - 1;
        let (beside_openings, whole) = (self.beside(openings), self.in_whole_grid());
        let rim = self.rim();
        let (mut found, mut inner) = (Vec::new(), Vec::new());
        for (k, cell) in self.levels[finest].iter().enumerate() {
            let near = self.near(cell.place, &whole);
            let NeighbourRanges { sky, surfaces, blocked, .. } = near;
            let open = near.open || beside_openings.binary_search(&cell.place).is_ok();
            if near.open && !blocked {
                inner.push(k as u32);
            }
            let edge = if open && blocked { ERROR_OF_EDGE * f64::from(sky[1]) } else { 0.0 };
            let strip = self.variance_at_rim(cell, rim) * f64::from(sky[1]).powi(2);
            let between = if blocked { ERROR_OF_EDGE * f64::from(surfaces[1] - surfaces[0]) } else { 0.0 };
            // Of the cells in a line across an edge, one contains the edge, or the difference between the nearest cells on either side.
            let across = (2 * self.reach + 1) as f64;
            let of_cell =
                if finest == 0 { ERROR_OF_GRADIENT / across } else { ERROR_OF_EDGE / across.sqrt() };
            let gradient = if open { of_cell * f64::from(sky[1] - sky[0]) } else { 0.0 };
            // Mirrored samples do not reduce the error at the sharp edge of a bright part of the sky, which lies in one of two cells.
            let step = match finest {
                0 => ERROR_OF_EDGE * step_at(&self.levels[0], k, self.columns),
                _ => 0.0,
            };
            let of_sky = (edge * edge / across).max(strip) + gradient * gradient + 0.5 * step * step;
            let errors = [of_sky, WEIGHT_OF_SURFACES * between * between / across];
            let of = UnevenCell { cell: k as u32, errors: errors.map(|e| area * area * e) };
            if of.error() > 0.0 {
                found.push(of);
            }
        }
        (found, inner)
    }

    /// Whether a place of the finest level lies at the rim of the hemisphere, which is that of the grid.
    fn is_at_rim(&self, [i, j]: [u32; 2]) -> bool {
        let is_end = |at: u32, axis: usize| at == 0 || at as usize + 1 == self.size[axis];
        is_end(i, 0) || is_end(j, 1)
    }

    /// Numbers of blocked and of open cells of the finest level at the rim.
    fn rim(&self) -> [f64; 2] {
        let mut counts = [0.0; 2];
        let cells = self.levels[self.levels.len() - 1].iter().filter(|cell| self.is_at_rim(cell.place));
        cells.for_each(|cell| counts[usize::from(cell.is_open)] += 1.0);
        counts
    }

    /// Variance of the visibility of a cell at the rim of the hemisphere, 0 inside. Objects a little above the plane of a point, and the
    /// sky at the foot of a wall, are strips along the rim thinner than a cell: the other cells of the rim give the probability that one
    /// crosses this cell. Where little of the rim is open, as in rooms, the edges of openings matter more: the variance is multiplied by
    /// the open fraction.
    fn variance_at_rim(&self, cell: &RayCell, rim: [f64; 2]) -> f64 {
        if !self.is_at_rim(cell.place) {
            return 0.0;
        }
        let own = f64::from(u8::from(cell.is_open));
        let [blocked, open] = [rim[0] - (1.0 - own), rim[1] - own];
        let part = open / (blocked + open).max(1.0);
        (part * (1.0 - part)).min(ERROR_OF_EDGE * ERROR_OF_EDGE) * part
    }

    /// The places of the finest level at openings and around them, in order.
    fn beside(&self, openings: &[[f32; 2]]) -> Vec<[u32; 2]> {
        let mut beside: Vec<[u32; 2]> = openings
            .iter()
            .flat_map(|&[u, v]| {
                let [i, j] = [(u, 0), (v, 1)].map(|(at, axis)| (at * self.size[axis] as f32) as u32);
                self.range(j, 1)
                    .flat_map(move |row| self.range(i, 0).map(move |column| [column as u32, row as u32]))
            })
            .collect();
        beside.sort_unstable();
        beside.dedup();
        beside
    }
}

/// An upper bound of the sum of the squared errors of [`Surroundings::uneven`] for an undivided grid of `count` cells below a dark sky,
/// (W/m²)². The range is that of the light of surfaces in blocked cells, W/m²; `rings` of neighbours are compared.
pub(super) fn bound_of_errors(count: usize, [low, high]: [f32; 2], rings: usize) -> f64 {
    let between = ERROR_OF_EDGE * f64::from((high - low).max(0.0));
    WEIGHT_OF_SURFACES * between * between / (count * (2 * rings + 1)) as f64
}

/// Abrupt change of the sky at a cell of the undivided grid, W/m²: the larger of the second differences along a row and along a column,
/// which is the step itself for both cells at a step. At the rim of the grid, or beside blocked cells, it is the difference from the only
/// neighbour.
fn step_at(cells: &[RayCell], k: usize, columns: usize) -> f64 {
    let open = |k: usize| cells.get(k).filter(|cell| cell.is_open).map(|cell| f64::from(cell.sky));
    let own = f64::from(cells[k].sky);
    let bend =
        |before: Option<usize>, after: Option<usize>| match (before.and_then(open), after.and_then(open)) {
            (Some(before), Some(after)) => (before + after - 2.0 * own).abs(),
            (Some(only), None) | (None, Some(only)) => (only - own).abs(),
            (None, None) => 0.0,
        };
    let column = k % columns;
    let across = bend((column > 0).then(|| k - 1), (column + 1 < columns).then_some(k + 1));
    across.max(bend(k.checked_sub(columns), Some(k + columns)))
}

/// A cell to divide, with the light of the surfaces around it where errors of surface light matter little, as at the edges of leaves
/// before the sky: then one quarter of four is evaluated for all.
pub(super) type CellToDivide = (u32, Option<Vec3>);

fn to_divide(of: &UnevenCell, surroundings: &Surroundings, min_error: f64) -> CellToDivide {
    (of.cell, (of.errors[1] <= min_error).then(|| surroundings.surfaces_around(of.cell)))
}

/// The tolerated sum of squared errors for the next division, after `rays` rays; `left` is that of the cells that stay undivided. `None`
/// if no cell is to be divided. If the errors are within `tolerance`, only cells whose error is mainly that of the sky are kept.
pub(super) fn next_tolerance(
    uneven: &mut Vec<UnevenCell>,
    left: f64,
    tolerance: f64,
    rays: usize,
) -> Option<f64> {
    let error: f64 = uneven.iter().map(UnevenCell::error).sum();
    if left + error > tolerance {
        return Some(tolerance);
    }
    uneven.retain(|of| of.errors[0] > of.errors[1]);
    let of_sky: f64 = uneven.iter().map(|of| of.errors[0]).sum();
    let finer = CHEAP_TOLERANCE * tolerance;
    (of_sky > finer && 4 * uneven.len() <= CHEAP_RAYS * rays).then_some(finer)
}

/// All cells of the finest level.
pub(super) fn all_cells(
    cells: &[RayCell],
    surroundings: &Surroundings,
    uneven: &[UnevenCell],
    min_error: f64,
) -> Vec<CellToDivide> {
    let even = |(k, of): (u32, &RayCell)| (k, (!of.is_open).then_some(of.surfaces));
    let mut all: Vec<CellToDivide> = (0..).zip(cells).map(even).collect();
    uneven.iter().for_each(|of| all[of.cell as usize] = to_divide(of, surroundings, min_error));
    all
}

/// The cells with errors above `min_error`, the largest first. Cells divided mainly for surfaces are limited to `max_rays` rays in all.
pub(super) fn largest_errors(
    surroundings: &Surroundings,
    uneven: &[UnevenCell],
    min_error: f64,
    for_surfaces: &mut usize,
    max_rays: usize,
) -> Vec<CellToDivide> {
    let mut chosen: Vec<&UnevenCell> = uneven.iter().filter(|of| of.error() > min_error).collect();
    chosen.sort_unstable_by(|a, b| b.error().total_cmp(&a.error()).then(a.cell.cmp(&b.cell)));
    chosen.retain(|of| {
        let by_surfaces = of.errors[1] > of.errors[0];
        *for_surfaces += if by_surfaces { 4 } else { 0 };
        !by_surfaces || *for_surfaces <= max_rays
    });
    chosen.into_iter().map(|of| to_divide(of, surroundings, min_error)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::cells_around::{RINGS, UNDIVIDED};
    use super::*;
    use crate::math::sampling::{mix, numbers};

    /// Cells of a level whose light is random, in the order of quarters.
    fn level(places: impl Iterator<Item = [u32; 2]>, level: u64, sky: f32) -> Vec<RayCell> {
        let cell = |place: [u32; 2]| {
            let [u, v, ..] = numbers(mix(level), u64::from(place[0]) << 32 | u64::from(place[1]));
            let surfaces = Vec3::splat(if u < 0.4 { 0.0 } else { v });
            RayCell {
                place,
                is_open: u < 0.4,
                light: surfaces,
                surfaces,
                sky: sky * v,
                unblocked: Vec3::ZERO,
                at_ray: Vec3::ZERO,
                error: 0.0,
                quarters: UNDIVIDED,
            }
        };
        places.map(cell).collect()
    }

    fn whole() -> impl Iterator<Item = [u32; 2]> {
        (0..8).flat_map(|j| (0..12).map(move |i| [i, j]))
    }

    #[test]
    fn errors_of_surfaces_have_a_bound() {
        let levels = [level(whole(), 0, 0.0)];
        let errors: f64 = Surroundings::new(&levels, [12, 8], RINGS)
            .uneven(1.0 / 96.0, &[])
            .0
            .iter()
            .map(UnevenCell::error)
            .sum();
        let mut all = NeighbourRanges::EMPTY;
        levels[0].iter().for_each(|cell| all.add(cell));
        let range = all.surfaces;
        assert!(
            errors > 0.0
                && errors <= bound_of_errors(96, range, RINGS)
                && bound_of_errors(96, range, RINGS) < 2.0 * errors
        );
    }

    #[test]
    fn cells_of_one_size_are_found_by_row_as_by_descent() {
        let mut first = level(whole(), 0, 1.0);
        (0u32..).zip(&mut first).for_each(|(k, cell)| cell.quarters = 4 * k);
        let quarters =
            |[i, j]: [u32; 2]| [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[a, b]| [2 * i + a, 2 * j + b]);
        let levels = [first, level(whole().flat_map(quarters), 1, 1.0)];
        let by_row = Surroundings::new(&levels, [12, 8], RINGS);
        let by_descent = Surroundings { in_rows: Vec::new(), ..Surroundings::new(&levels, [12, 8], RINGS) };
        let found = |of: &Surroundings| -> Vec<(u32, [f64; 2])> {
            of.uneven(1.0, &[[0.3, 0.3]]).0.iter().map(|of| (of.cell, of.errors)).collect()
        };
        assert!(by_row.in_rows.len() == 384 && !found(&by_row).is_empty());
        assert_eq!(found(&by_row), found(&by_descent));
        assert_eq!(by_row.surfaces_around(77), by_descent.surfaces_around(77));
    }
}
