//! Directions drawn in proportion to radiance.

use super::cosine::Extent;
use super::frame::{azimuth, spherical};
use glam::DVec3;
use std::f64::consts::TAU;

/// Rows of cells of a hemisphere, of equal height and so of equal solid angle. With 512 columns a cell is as large as a square of 0.6°:
/// next to the sun of the clearest Perez sky the radiance changes by 8 % over that.
const ROWS: usize = 128;
/// Columns of cells: four for each row, so that cells halfway up the sky are about as wide as high.
const COLUMNS: usize = 512;
/// Least density of directions relative to that of uniform directions. Radiance that falls between the samples of a dark cell then
/// still gets rays. It takes a thousandth of all rays; with a smaller value, the few rays that meet such radiance would weigh more.
const MIN_RELATIVE_DENSITY: f64 = 1e-3;

/// Share of the largest sample in the weight of a cell, which is added to the mean. Radiance over density is then at most ten times the
/// integral of these weights, also where one bright texel at the edge of a cell hardly changes its mean. A larger share would draw more
/// rays to the dark part of such cells.
const SHARE_OF_LARGEST: f64 = 0.1;
/// Smallest number of samples along the side of a cell. Skies without a map change by at most 8 % over a cell, and the weights of cells
/// affect noise, not the mean.
const MIN_SAMPLES: usize = 2;
/// Most samples along the side of a cell. A cell at the zenith, 7° high, has every second texel of a map of 1,600 columns, another one
/// that of one of 20,000.
const MAX_SAMPLES: usize = 64;

/// Radiance below the horizon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum GroundRadiance {
    /// Nothing.
    Black,
    /// The same radiance everywhere.
    Uniform,
    /// A map.
    Detailed,
}

/// Running sums of radiance over a grid of cells, by rows and by columns of each row.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    /// Rows of the lower and the upper half.
    lower_rows: usize,
    /// Running sums of the rows, from the lowest row.
    rows: Vec<f64>,
    /// Running sums in each row.
    columns: Vec<f64>,
}

impl Cells {
    /// Tabulates `value`, at least 0, of local unit directions by samples of each cell; `detail` is the angle between texels of a map.
    pub fn new(lower: GroundRadiance, detail: Option<f64>, value: impl Fn(DVec3) -> f64) -> Cells {
        let lower_rows = match lower {
            GroundRadiance::Black => 0,
            GroundRadiance::Uniform => 1,
            GroundRadiance::Detailed => ROWS,
        };
        let mut cells = Cells { lower_rows, rows: Vec::new(), columns: Vec::new() };
        let count = lower_rows + ROWS;
        let mut weights = Vec::with_capacity(count * COLUMNS);
        for cell in 0..count * COLUMNS {
            let extent = cells.extent(cell);
            // The ground has one value.
            let [n, m] = if lower_rows == 1 && cell < COLUMNS { [1; 2] } else { samples(&extent, detail) };
            let part = |k: usize, n: usize| (k as f64 + 0.5) / n as f64;
            let (mut sum, mut max) = (0.0, 0.0f64);
            for k in 0..n * m {
                let value = value(extent.at(part(k / m, n), part(k % m, m)));
                sum += value;
                max = max.max(value);
            }
            weights.push((sum / (n * m) as f64 + SHARE_OF_LARGEST * max) * extent.solid_angle());
        }
        let full = TAU * if lower_rows == 0 { 1.0 } else { 2.0 };
        let total: f64 = weights.iter().sum();
        // Without any light all directions are equally likely.
        let least = if total > 0.0 { MIN_RELATIVE_DENSITY * total / full } else { 1.0 };
        let mut sum = 0.0;
        for row in 0..count {
            let mut along = 0.0;
            for (column, weight) in weights[row * COLUMNS..(row + 1) * COLUMNS].iter().enumerate() {
                along += weight + least * cells.extent(row * COLUMNS + column).solid_angle();
                cells.columns.push(along);
            }
            sum += along;
            cells.rows.push(sum);
        }
        cells
    }

    /// Ranges of a cell.
    fn extent(&self, cell: usize) -> Extent {
        let (row, column) = (cell / COLUMNS, cell % COLUMNS);
        let z = match row.checked_sub(self.lower_rows) {
            Some(row) => [row, row + 1].map(|k| k as f64 / ROWS as f64),
            None => [row, row + 1].map(|k| k as f64 / self.lower_rows as f64 - 1.0),
        };
        Extent { z, v: [column, column + 1].map(|k| TAU * k as f64 / COLUMNS as f64) }
    }

    /// The cell of a local unit direction.
    fn cell(&self, local: DVec3) -> Option<usize> {
        let row = if local.z > 0.0 {
            self.lower_rows + ((local.z * ROWS as f64) as usize).min(ROWS - 1)
        } else if self.lower_rows > 0 {
            (((1.0 + local.z) * self.lower_rows as f64).max(0.0) as usize).min(self.lower_rows - 1)
        } else {
            return None;
        };
        let column = (azimuth(local) / TAU * COLUMNS as f64) as usize;
        Some(row * COLUMNS + column.min(COLUMNS - 1))
    }

    /// Density of a cell, 1/sr.
    fn density(&self, cell: usize) -> f64 {
        let along = self.row(cell / COLUMNS);
        let column = cell % COLUMNS;
        let before = if column > 0 { along[column - 1] } else { 0.0 };
        (along[column] - before) / (self.rows[self.rows.len() - 1] * self.extent(cell).solid_angle())
    }

    fn row(&self, row: usize) -> &[f64] {
        &self.columns[row * COLUMNS..(row + 1) * COLUMNS]
    }

    /// Density of directions at a local unit direction, 1/sr.
    pub fn pdf(&self, local: DVec3) -> f64 {
        self.cell(local).map_or(0.0, |cell| self.density(cell))
    }

    /// A local unit direction for `u` in the unit square, and its density, 1/sr. Neighbours in the square are mostly neighbours in the sky.
    pub fn sample(&self, u: [f64; 2]) -> (DVec3, f64) {
        let (row, s) = pick(&self.rows, u[0]);
        let (column, t) = pick(self.row(row), u[1]);
        let cell = row * COLUMNS + column;
        let Extent { z, v } = self.extent(cell);
        // At height 0 a direction of the upper half would be taken for one of the lower.
        let height = (z[0] + s * (z[1] - z[0])).max(z[0].next_up());
        (spherical(height, v[0] + t * (v[1] - v[0])), self.density(cell))
    }
}

/// Samples along the height and the azimuths of a cell: two for each texel of a map, which is interpolated between texels.
fn samples(extent: &Extent, detail: Option<f64>) -> [usize; 2] {
    let Some(step) = detail else { return [MIN_SAMPLES; 2] };
    let width = extent.turn() * (1.0 - extent.z[0].abs().min(extent.z[1].abs()).powi(2)).sqrt();
    let height = extent.z[1].asin() - extent.z[0].asin();
    [height, width].map(|side| ((2.0 * side / step).ceil() as usize).clamp(MIN_SAMPLES, MAX_SAMPLES))
}

/// The entry of a table of increasing sums that `u` in `[0, 1)` selects, and where in the entry, in `[0, 1]`.
fn pick(sums: &[f64], u: f64) -> (usize, f64) {
    let target = u * sums[sums.len() - 1];
    let k = sums.partition_point(|s| *s <= target).min(sums.len() - 1);
    let before = if k > 0 { sums[k - 1] } else { 0.0 };
    (k, ((target - before) / (sums[k] - before)).clamp(0.0, 1.0))
}
