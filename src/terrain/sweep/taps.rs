//! Horizons by the terrain near a sample: exact, at the places where a ray in the azimuth crosses the edges of triangles.

use super::Pass;
use crate::terrain::Grid;

/// Places where a ray from a sample crosses the edges of triangles within a distance. They are the same for all samples of a grid.
pub struct Taps(Vec<Tap>);

/// Distance in columns up to which edges between columns count: 48 places within it at most, and one more for each column beyond it.
const MAX_CROSSED: usize = 12;

/// A place on the edge between two samples.
struct Tap {
    /// Columns and rows from the sample of the horizon to the two ends of the edge.
    ends: [[isize; 2]; 2],
    /// Weight of the second end.
    weight: f32,
    /// 1 over the distance, 1/m.
    nearness: f32,
    /// Drop of the curved earth over the distance, divided by it.
    sink: f32,
}

impl Taps {
    /// The places within `reach` columns in the direction of decreasing (`sign` −1) or increasing columns (1). `bend`: 1 over the
    /// radius of the earth, 1/m.
    pub fn new(pass: &Pass, sign: f64, reach: usize, bend: f64) -> Taps {
        let rise = pass.rise;
        let mut taps = Vec::new();
        // A place x columns away has a whole number of columns, of rows, or of both in sum (the diagonals of cells).
        for (rate, edge) in [(1.0, [0, 1]), (rise, [1, 0]), (1.0 + rise, [1, -1])] {
            let mut count = 1.0;
            // Far away a place between two columns differs little from those on them.
            let reach = if edge == [0, 1] { reach } else { reach.min(MAX_CROSSED) };
            while rate != 0.0 && count <= reach as f64 * f64::abs(rate) {
                let x = count / f64::abs(rate);
                let (column, row) = (sign * x, sign * x * rise);
                count += 1.0;
                let sum = (column + row).round();
                // The end with the smaller column, or row on an edge of constant column.
                let (base, weight) = match edge {
                    [0, 1] => ([column.round(), row.floor()], row - row.floor()),
                    [1, 0] => ([column.floor(), row.round()], column - column.floor()),
                    _ => ([column.floor(), sum - column.floor()], column - column.floor()),
                };
                let base = base.map(|v| v as isize);
                let mut ends = [base, [base[0] + edge[0], base[1] + edge[1]]];
                // At a sample the other end of the edge may be a hole or outside. Rounding in f64 moves places by 1e-12 of an edge.
                if weight < 1e-9 {
                    ends[1] = ends[0];
                }
                let distance = x * pass.step;
                let sink = (0.5 * distance * bend) as f32;
                taps.push(Tap { ends, weight: weight as f32, nearness: (1.0 / distance) as f32, sink });
            }
        }
        Taps(taps)
    }

    /// Raises the tangents of a row of samples to those of the terrain near them. Places outside the grid and edges that end
    /// in a hole are left out.
    pub fn raise(&self, grid: &Grid, row: usize, tangents: &mut [f32]) {
        let columns = grid.columns() as isize;
        let line = |r: usize| &grid.heights()[r * grid.columns()..(r + 1) * grid.columns()];
        let here = line(row);
        for Tap { ends, weight, nearness, sink } in &self.0 {
            let rows = ends.map(|[_, r]| row as isize + r);
            if rows.iter().any(|r| !(0..grid.rows() as isize).contains(r)) {
                continue;
            }
            let [a, b] = rows.map(|r| line(r as usize));
            let shift = ends.map(|[c, _]| c);
            let start = (-shift[0].min(shift[1])).max(0);
            let end = (columns - shift[0].max(shift[1])).min(columns);
            if start >= end {
                continue;
            }
            let (start, end) = (start as usize, end as usize);
            let cut = |s: isize| start.wrapping_add_signed(s)..end.wrapping_add_signed(s);
            let (a, b) = (&a[cut(shift[0])], &b[cut(shift[1])]);
            let places = a.iter().zip(b).zip(&here[start..end]);
            for (tangent, ((a, b), z)) in tangents[start..end].iter_mut().zip(places) {
                let t = (a + (b - a) * weight - z) * nearness - sink;
                // `t` is NaN beside holes.
                *tangent = if t > *tangent { t } else { *tangent };
            }
        }
    }
}
