//! Heights at the samples of a regular grid.

use crate::math::parallel;
use crate::{Error, Result};
use glam::DVec3;

/// Largest number of columns or rows: positions along a line of samples, in columns with fractions, are exact to 1/128 of a
/// column in f32.
pub const MAX_SIDE: usize = 1 << 17;
/// Largest absolute height, m: f32 distinguishes heights to 1/16 m there. The highest mountains of the solar system are below 3e4 m.
pub const MAX_HEIGHT: f32 = 1e6;

/// A height field. The documentation of the module defines the frame and the surface between samples.
#[derive(Clone, Debug)]
pub struct Grid {
    columns: usize,
    rows: usize,
    /// Row by row from the north, m; NaN in holes.
    heights: Vec<f32>,
    cell: [f64; 2],
    georeference: Georeference,
    /// Whether the distances of samples are not those of the file.
    is_cell_given: bool,
}

impl Grid {
    /// A grid from `columns * rows` heights, row by row from the north, m; values that are not finite are holes. `cell`: distances of
    /// neighbouring columns and rows, m.
    ///
    /// # Errors
    /// [`Error::Argument`] if the number of heights is not `columns * rows`, a side is less than 2 or more than [`MAX_SIDE`], a
    /// distance is not positive and finite, no sample has a height, or a height is beyond [`MAX_HEIGHT`].
    pub fn new(columns: usize, rows: usize, cell: [f64; 2], mut heights: Vec<f32>) -> Result<Grid> {
        check_sides(columns, rows).map_err(Error::arguments)?;
        check_cell(cell).map_err(Error::arguments)?;
        if heights.len() != columns * rows {
            let n = heights.len();
            return Err(Error::arguments(format!(
                "{n} heights do not make {columns} columns and {rows} rows"
            )));
        }
        let mut any = false;
        for h in &mut heights {
            match h.is_finite() {
                true if h.abs() > MAX_HEIGHT => {
                    return Err(Error::arguments(format!(
                        "the height {h} m is beyond {MAX_HEIGHT:e} m: state its unit, or the value of samples without data"
                    )));
                }
                true => any = true,
                false => *h = f32::NAN,
            }
        }
        match any {
            true => {
                let georeference = Georeference::local(rows, cell);
                Ok(Grid { columns, rows, heights, cell, georeference, is_cell_given: false })
            }
            false => Err(Error::arguments("no sample of the grid has a height: all are holes".into())),
        }
    }

    /// The same grid with another georeference, which outputs get.
    pub fn with_georeference(self, georeference: Georeference) -> Grid {
        Grid { georeference, ..self }
    }

    /// The same grid with distances of samples that are not those of its file.
    pub fn with_given_cell(self) -> Grid {
        Grid { is_cell_given: true, ..self }
    }

    /// Whether the distances of samples are not those of the file.
    pub fn is_cell_given(&self) -> bool {
        self.is_cell_given
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Distances of neighbouring columns and of neighbouring rows, m.
    pub fn cell(&self) -> [f64; 2] {
        self.cell
    }

    /// Heights, `columns * rows`, row by row from the north, m; NaN in holes.
    pub fn heights(&self) -> &[f32] {
        &self.heights
    }

    /// Position of the grid on the earth.
    pub fn georeference(&self) -> &Georeference {
        &self.georeference
    }

    /// Metres of a unit of the georeference along x and y.
    fn metres_of_unit(&self) -> [f64; 2] {
        [0, 1].map(|k| self.cell[k] / self.georeference.scale[k])
    }

    /// The same for a grid in degrees.
    pub fn metres_of_degree(&self) -> Option<[f64; 2]> {
        let is_geographic = self.georeference.key(MODEL_TYPE) == Some(GEOGRAPHIC);
        (is_geographic && !self.is_cell_given).then(|| self.metres_of_unit())
    }

    /// Position of a sample on the map, m: that of the georeference in metres; z is NaN in a hole. With other distances than those of the
    /// file the first sample of the last row stays where it is.
    pub fn map_position(&self, column: usize, row: usize) -> DVec3 {
        let height = self.height(column, row).into();
        if self.is_cell_given {
            let ([x, y], [dx, dy]) = (self.georeference.position(0, self.rows - 1), self.cell);
            return DVec3::new(x + column as f64 * dx, y + (self.rows - 1 - row) as f64 * dy, height);
        }
        let ([x, y], [dx, dy]) = (self.georeference.position(column, row), self.metres_of_unit());
        DVec3::new(x * dx, y * dy, height)
    }

    /// Height of a sample, m; NaN in a hole.
    pub fn height(&self, column: usize, row: usize) -> f32 {
        self.heights[row * self.columns + column]
    }

    /// Number of samples without a height.
    pub fn holes(&self) -> usize {
        self.heights.iter().filter(|h| h.is_nan()).count()
    }

    /// The grid with columns and rows exchanged, without georeference: its x axis points to the south of this grid, its rows lie
    /// from west to east.
    pub(super) fn transposed(&self) -> Result<Grid> {
        crate::memory::check_room(4 * self.heights.len() as u64, || "heights of the terrain".into())?;
        Ok(Grid {
            columns: self.rows,
            rows: self.columns,
            heights: transpose(&self.heights, self.columns),
            cell: [self.cell[1], self.cell[0]],
            georeference: Georeference::local(self.columns, [self.cell[1], self.cell[0]]),
            is_cell_given: false,
        })
    }
}

/// Slope at a sample from the heights before, at and behind it, times `scale` (1 over the distance of samples); 0 if both
/// neighbours are missing.
#[inline]
pub(super) fn slope(before: f32, here: f32, behind: f32, scale: f32) -> f32 {
    let (left, right) = (here - before, behind - here);
    let both = 0.5 * (left + right);
    let one = if left.is_nan() { right } else { left };
    let rise = if both.is_nan() { one } else { both };
    if rise.is_nan() { 0.0 } else { rise * scale }
}

/// Side of the square blocks that are transposed at once: two blocks of f32 (32 KiB) fit the first cache of a core.
const BLOCK: usize = 64;

/// The matrix with rows of `columns` values, transposed.
pub(super) fn transpose<T: Copy + Default + Send + Sync>(values: &[T], columns: usize) -> Vec<T> {
    let rows = values.len() / columns;
    let mut out = vec![T::default(); values.len()];
    parallel::for_each_chunk_mut(&mut out, BLOCK * rows, |block, out| {
        let first = block * BLOCK;
        for start in (0..rows).step_by(BLOCK) {
            for (i, line) in out.chunks_exact_mut(rows).enumerate() {
                for (r, value) in line.iter_mut().enumerate().take((start + BLOCK).min(rows)).skip(start) {
                    *value = values[r * columns + first + i];
                }
            }
        }
    });
    out
}

/// Refuses sides of a grid that are too small or too large; the error contains the remedy.
pub(super) fn check_sides(columns: usize, rows: usize) -> Result<(), String> {
    match (columns.min(rows), columns.max(rows)) {
        (0 | 1, _) => Err(format!("{columns} columns and {rows} rows: a terrain needs 2 of each or more")),
        (_, MAX_SIDE..) => Err(format!(
            "{columns} columns and {rows} rows: at most {} of each; cut it into tiles",
            MAX_SIDE - 1
        )),
        _ => Ok(()),
    }
}

/// Refuses distances of columns and rows out of range; the error contains the remedy.
pub(super) fn check_cell(cell: [f64; 2]) -> Result<(), String> {
    // Beyond these limits squares of distances overflow or vanish in f32.
    match cell.iter().all(|d| (1e-9..=1e9).contains(d)) {
        true => Ok(()),
        false => Err(format!("the cell size {} × {} m must lie in 1e-9..1e9 m", cell[0], cell[1])),
    }
}

// Where a grid is on the earth, in the terms of GeoTIFF (OGC 19-008r4).

/// Key: kind of coordinate system.
pub const MODEL_TYPE: u16 = 1024;
/// Key: unit of projected lengths.
pub const LENGTHS: u16 = 3076;
/// Value of [`MODEL_TYPE`]: longitude and latitude.
pub const GEOGRAPHIC: u16 = 2;
/// Key: whether tie points are of corners of pixels (1) or of samples (2).
const RASTER_TYPE: u16 = 1025;

/// Position, scale and coordinate system of a grid. Outputs get them unchanged.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Georeference {
    /// Column, row, 0, and the x, y and z that they lie at in the coordinate system.
    pub tie_point: [f64; 6],
    /// Lengths of a column and a row in units of the coordinate system, both positive: x grows with columns, y falls with rows;
    /// the third is 0.
    pub scale: [f64; 3],
    /// The tag GeoKeyDirectory, empty without a coordinate system.
    pub keys: Vec<u16>,
    /// The tag GeoDoubleParams.
    pub doubles: Vec<f64>,
    /// The tag GeoAsciiParams.
    pub text: String,
}

impl Georeference {
    /// The frame of a grid without a coordinate system: the sample of the first column and the last row is the origin.
    pub fn local(rows: usize, cell: [f64; 2]) -> Georeference {
        Georeference::of_samples([0.0, (rows - 1) as f64 * cell[1]], cell)
    }

    /// From the position of the first sample and the lengths of a column and a row.
    pub fn of_samples([x, y]: [f64; 2], [dx, dy]: [f64; 2]) -> Georeference {
        Georeference {
            tie_point: [0.0, 0.0, 0.0, x, y, 0.0],
            scale: [dx, dy, 0.0],
            // Version 1.1 of the directory with two keys: samples are points, lengths metres.
            keys: vec![1, 1, 0, 2, RASTER_TYPE, 0, 1, 2, LENGTHS, 0, 1, 9001],
            ..Georeference::default()
        }
    }

    /// The value of a key that is a number in the directory.
    pub fn key(&self, key: u16) -> Option<u16> {
        let entries = self.keys.get(4..)?.chunks_exact(4);
        entries.filter(|e| e[0] == key && e[1] == 0).map(|e| e[3]).next()
    }

    /// Position of the sample of a column and a row in the coordinate system.
    pub fn position(&self, column: usize, row: usize) -> [f64; 2] {
        // A pixel is an area unless the file says otherwise; the sample is its middle.
        let half = if self.key(RASTER_TYPE) == Some(2) { 0.0 } else { 0.5 };
        let [i, j, _, x, y, _] = self.tie_point;
        [x + (column as f64 + half - i) * self.scale[0], y - (row as f64 + half - j) * self.scale[1]]
    }
}
