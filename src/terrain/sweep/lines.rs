//! Lines over the grid: profiles of heights, and horizons of the samples on both sides of each line.

use super::taps::Taps;
use super::{Pass, Row, SweepOptions};
use crate::math::parallel;
use crate::terrain::Grid;
use crate::{Result, memory};
use rayon::prelude::*;
use std::ops::Range;

/// Lines of one pass with the horizons that they give.
pub struct Lines {
    /// Towards decreasing and towards increasing columns: for each place and column the tangents of the horizons of the samples
    /// above and below the line there.
    tangents: [Vec<[f32; 2]>; 2],
    rows: Rows,
}

/// Position of a line between rows: line `k` is between rows `k + first + whole` and the next one of a column, nearer to the next one by
/// `rest`.
///
/// Each column has a line above its first sample and one below each sample. Of lines whose numbers differ by that number at most
/// one is on the grid in a column, so that they have one place in memory.
#[derive(Default)]
struct Rows {
    first: isize,
    whole: Vec<isize>,
    rest: Vec<f32>,
}

/// Working memory of a thread for one line.
#[derive(Default)]
struct Scratch {
    hull: Hull,
    profile: Profile,
}

/// Heights along a line, relative to a plane that touches the curved earth.
#[derive(Default)]
struct Profile {
    /// By column of the grid: heights of the sample above the line, of the sample below it, and of the line, m.
    heights: Vec<[f32; 3]>,
    /// By column: place at which the line crosses a row before the next column, in columns, and its height there; NaN if there is
    /// none.
    crossings: Vec<[f32; 2]>,
}

impl Lines {
    /// Lines over a grid and the transposed grid, without horizons.
    pub fn new(grid: &Grid) -> Result<Lines> {
        let places = (grid.columns() + 1) * (grid.rows() + 1);
        let size = 2 * std::mem::size_of::<[f32; 2]>() * places;
        memory::check_room(size as u64, || "horizons of the terrain".into())?;
        Ok(Lines { tangents: [Vec::new(), Vec::new()], rows: Rows::default() })
    }

    /// Finds the horizons of one pass.
    pub fn sweep(&mut self, grid: &Grid, pass: &Pass, options: &SweepOptions) {
        let columns = grid.columns();
        let risen = |c: usize| pass.rise * c as f64;
        let whole: Vec<isize> = (0..columns).map(|c| risen(c).floor() as isize).collect();
        let rest = (0..columns).map(|c| (risen(c) - risen(c).floor()) as f32).collect();
        let last = whole[columns - 1];
        self.rows = Rows { first: -1 - last.max(0), whole, rest };
        let places = grid.rows() + 1;
        let lines = places + last.unsigned_abs();
        self.tangents.iter_mut().for_each(|t| t.resize(places * columns, [0.0; 2]));
        let line = Line { grid, pass, rows: &self.rows, bend: options.bend() };
        let [before, behind] = &mut self.tangents;
        before.par_chunks_mut(columns).zip(behind.par_chunks_mut(columns)).enumerate().for_each_init(
            Scratch::default,
            |scratch, (place, (before, behind))| {
                for k in (place..lines).step_by(places) {
                    let range = line.profile(k, &mut scratch.profile);
                    line.forward(range.clone(), scratch, before);
                    line.backward(range, scratch, behind);
                }
            },
        );
    }
}

/// Horizons of one pass towards one end of the lines.
pub struct Side<'a> {
    pub lines: &'a Lines,
    /// The grid, transposed if the pass is steep.
    pub grid: &'a Grid,
    pub pass: &'a Pass,
    pub options: &'a SweepOptions,
    /// 0 towards decreasing columns, 1 towards increasing ones.
    pub end: usize,
    /// Index of the azimuth.
    pub azimuth: usize,
}

impl Side<'_> {
    /// Calls `add` with the horizons of each row of samples and the row of `sums`.
    pub fn rows(&self, sums: &mut [f32], add: &(impl Fn(Row, &mut [f32]) + Sync)) {
        let Side { grid, pass, azimuth, .. } = *self;
        let columns = grid.columns();
        let places = grid.rows() + 1;
        let Rows { first, whole, rest } = &self.lines.rows;
        let tangents = &self.lines.tangents[self.end];
        let sign = if self.end == 0 { -1.0 } else { 1.0 };
        let direction = pass.direction.map(|d| (sign * d) as f32);
        let taps = Taps::new(pass, sign, pass.reach, self.options.bend());
        // By column: place of the line below the sample of row 0.
        let start = |w: &isize| (-w - first).rem_euclid(places as isize) as usize;
        let starts: Vec<usize> = whole.iter().map(start).collect();
        parallel::for_each_chunk_mut_with(
            sums,
            columns,
            || vec![0.0f32; columns],
            |line, row, sums| {
                for (c, (tangent, start)) in line.iter_mut().zip(&starts).enumerate() {
                    let place = start + row;
                    let below = if place >= places { place - places } else { place };
                    let above = if below == 0 { places - 1 } else { below - 1 };
                    let (below, above) = (tangents[below * columns + c][0], tangents[above * columns + c][1]);
                    *tangent = below + (above - below) * rest[c];
                }
                taps.raise(grid, row, line);
                add(Row { azimuth, direction, grid, row, tangents: line }, sums);
            },
        );
    }
}

/// Data that all lines of a pass share.
struct Line<'a> {
    grid: &'a Grid,
    pass: &'a Pass,
    rows: &'a Rows,
    /// 1 over the radius of the earth, 1/m; 0 for a flat one.
    bend: f64,
}

impl Line<'_> {
    /// Heights along line `k`; returns the columns in which it is on the grid or less than a row outside.
    fn profile(&self, k: usize, profile: &mut Profile) -> Range<usize> {
        let Rows { first, whole, rest } = self.rows;
        let (columns, rows) = (self.grid.columns(), self.grid.rows() as isize);
        let row = k as isize + first;
        let range = match self.pass.rise >= 0.0 {
            true => whole.partition_point(|w| row + w < -1)..whole.partition_point(|w| row + w < rows),
            false => whole.partition_point(|w| row + w >= rows)..whole.partition_point(|w| row + w >= -1),
        };
        profile.heights.resize(columns, [f32::NAN; 3]);
        profile.crossings.resize(columns, [f32::NAN; 2]);
        for c in range.clone() {
            let above = row + whole[c];
            // A line outside the grid has the heights of the first or last row.
            let high = self.grid.height(c, above.max(0) as usize);
            let low = self.grid.height(c, (above + 1).min(rows - 1) as usize);
            profile.heights[c] = [high, low, high + (low - high) * rest[c]];
        }
        for c in range.start..range.end.saturating_sub(1) {
            profile.crossings[c] = self.crossing(c, &profile.heights);
        }
        if let Some(last) = range.clone().last() {
            profile.crossings[last] = [f32::NAN; 2];
        }
        if self.bend != 0.0 {
            for c in range.clone() {
                let sink = self.sink(c as f64);
                profile.heights[c].iter_mut().for_each(|h| *h -= sink);
                let [x, height] = &mut profile.crossings[c];
                *height -= self.sink(f64::from(*x));
            }
        }
        range
    }

    /// Where the line crosses a row between a column and the next, and the height there.
    fn crossing(&self, c: usize, heights: &[[f32; 3]]) -> [f32; 2] {
        let Rows { whole, rest, .. } = self.rows;
        let ([high, low, _], [next_high, next_low, _]) = (heights[c], heights[c + 1]);
        let (part, from, to) = match whole[c + 1] - whole[c] {
            1 => ((1.0 - rest[c]) / self.pass.rise as f32, low, next_high),
            -1 => (rest[c] / -self.pass.rise as f32, high, next_low),
            _ => return [f32::NAN; 2],
        };
        // At the ends the crossing is a sample.
        if part > 0.0 && part < 1.0 { [c as f32 + part, from + (to - from) * part] } else { [f32::NAN; 2] }
    }

    /// Depth of the curved earth below the plane that touches it in the middle of the line, m, at a place in columns.
    fn sink(&self, x: f64) -> f32 {
        let distance = self.off_middle(x);
        (0.5 * distance * distance * self.bend) as f32
    }

    /// Distance from the middle of the line, m.
    fn off_middle(&self, x: f64) -> f64 {
        (x - 0.5 * self.grid.columns() as f64) * self.pass.step
    }

    /// Horizons towards decreasing columns.
    fn forward(&self, range: Range<usize>, scratch: &mut Scratch, out: &mut [[f32; 2]]) {
        let Scratch { hull, profile } = scratch;
        hull.clear();
        let scale = 1.0 / self.pass.step as f32;
        let start = range.start;
        for c in range {
            if let Some(far) = c.checked_sub(self.pass.reach).filter(|far| *far >= start) {
                if far > start {
                    let [x, height] = profile.crossings[far - 1];
                    hull.push(x, height);
                }
                hull.push(far as f32, profile.heights[far][2]);
            }
            let [high, low, _] = profile.heights[c];
            let tilt = -(self.off_middle(c as f64) * self.bend) as f32;
            out[c] = [high, low].map(|z| (hull.slope(c as f32, z) * scale + tilt).max(0.0));
        }
    }

    /// Horizons towards increasing columns.
    fn backward(&self, range: Range<usize>, scratch: &mut Scratch, out: &mut [[f32; 2]]) {
        let Scratch { hull, profile } = scratch;
        hull.clear();
        let scale = 1.0 / self.pass.step as f32;
        let end = range.end;
        for c in range.rev() {
            let far = c + self.pass.reach;
            if far < end {
                let [x, height] = profile.crossings[far];
                hull.push(-x, height);
                hull.push(-(far as f32), profile.heights[far][2]);
            }
            let [high, low, _] = profile.heights[c];
            // Seen from x, heights at x' sink by (x' − x)²/2R = x'²/2R − x²/2R − (x' − x) x/R: the last term tilts the profile.
            let tilt = (self.off_middle(c as f64) * self.bend) as f32;
            out[c] = [high, low].map(|z| (hull.slope(-(c as f32), z) * scale + tilt).max(0.0));
        }
    }
}

/// Upper convex hull. Positions in columns, counted away from where the sweep began, so that they increase.
#[derive(Default)]
struct Hull {
    points: Vec<[f32; 2]>,
}

impl Hull {
    /// Removes all points.
    pub fn clear(&mut self) {
        self.points.clear();
    }

    /// Adds a point behind all others. Heights that are not numbers are left out.
    #[inline]
    pub fn push(&mut self, x: f32, height: f32) {
        if height.is_nan() {
            return;
        }
        while let [.., a, b] = self.points[..] {
            // Whether b is above the chord from a to the new point.
            if (b[1] - a[1]) * (x - a[0]) > (height - a[1]) * (b[0] - a[0]) {
                break;
            }
            self.points.pop();
        }
        self.points.push([x, height]);
    }

    /// Largest slope, height per column, from a place behind all points to a point; −∞ without points.
    ///
    /// Slopes along the hull have one maximum. The search starts at the last point: most horizons are near.
    #[inline]
    pub fn slope(&self, x: f32, height: f32) -> f32 {
        let Some((&last, rest)) = self.points.split_last() else { return f32::NEG_INFINITY };
        let (mut rise, mut distance) = (last[1] - height, x - last[0]);
        for point in rest.iter().rev() {
            let (r, d) = (point[1] - height, x - point[0]);
            if r * distance < rise * d {
                break;
            }
            (rise, distance) = (r, d);
        }
        rise / distance
    }
}
