//! Exact rays against the triangles of a height field.
//!
//! Blocks of [`BLOCK`]² cells have the lowest and the highest of their heights; four blocks make one of the next level. A ray
//! descends into blocks between whose limits it passes. In a block it goes from cell to cell; over each half of a cell the height
//! above the surface is linear along the ray, so that the ray meets the surface where the sign changes: no ray passes between two
//! triangles.

use super::Grid;
use crate::{Error, Result};
use glam::DVec3;
use rayon::prelude::*;

/// Side of a block of the lowest level, cells. 4, 8 and 16: 0.99, 1.02 and 1.20 µs of processor time for a ray from rough terrain of
/// 1,000 × 1,000; with 8 the pyramid takes 1/24 of the memory of the heights, with 4 a sixth.
const BLOCK: usize = 8;

/// A level: lowest and highest heights of its blocks, row by row.
struct Level {
    columns: usize,
    limits: Vec<[f32; 2]>,
}

/// Lowest and highest heights of the blocks of a grid, for exact rays.
pub struct Pyramid<'a> {
    grid: &'a Grid,
    /// From the finest level to the one with one block.
    levels: Vec<Level>,
    /// Heights above the surface below this count as 0, m: rounding errors of positions and heights in f64.
    tolerance: f64,
}

/// No height at all: contains no ray.
const EMPTY: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

fn joined(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl<'a> Pyramid<'a> {
    /// The pyramid of a grid.
    pub fn new(grid: &'a Grid) -> Pyramid<'a> {
        let (cells_x, cells_y) = (grid.columns() - 1, grid.rows() - 1);
        let (mut columns, mut rows) = (cells_x.div_ceil(BLOCK), cells_y.div_ceil(BLOCK));
        let of_block = |b: usize| {
            let (x, y) = (b % columns * BLOCK, b / columns * BLOCK);
            let mut limits = EMPTY;
            for r in y..=(y + BLOCK).min(cells_y) {
                for c in x..=(x + BLOCK).min(cells_x) {
                    // `min` and `max` leave out holes, which are NaN.
                    let h = grid.height(c, r);
                    limits = [limits[0].min(h), limits[1].max(h)];
                }
            }
            limits
        };
        let mut levels =
            vec![Level { columns, limits: (0..columns * rows).into_par_iter().map(of_block).collect() }];
        while columns * rows > 1 {
            let below = &levels[levels.len() - 1];
            let (wide, high) = (columns.div_ceil(2), rows.div_ceil(2));
            let four = |b: usize| {
                let (x, y) = (b % wide * 2, b / wide * 2);
                let mut limits = EMPTY;
                for r in y..(y + 2).min(rows) {
                    for c in x..(x + 2).min(columns) {
                        limits = joined(limits, below.limits[r * columns + c]);
                    }
                }
                limits
            };
            let limits = (0..wide * high).map(four).collect();
            levels.push(Level { columns: wide, limits });
            (columns, rows) = (wide, high);
        }
        let [low, high] = levels[levels.len() - 1].limits[0].map(f64::from);
        let extent = grid.columns() as f64 * grid.cell()[0] + grid.rows() as f64 * grid.cell()[1];
        // A few thousand roundings of f64 (1.1e-16).
        let tolerance = 1e-12 * (low.abs().max(high.abs()) + extent);
        Pyramid { grid, levels, tolerance }
    }

    /// Whether the surface is between `origin` and `origin + max · direction`, in the frame of the room's page, m; `max` may be
    /// infinite, `direction` need not be a unit vector. An origin on the surface does not count as hit.
    ///
    /// # Errors
    /// [`Error::Argument`] if a coordinate is not finite, the direction is zero or `max` is negative or NaN.
    pub fn occluded(&self, origin: DVec3, direction: DVec3, max: f64) -> Result<bool> {
        Ok(self.first_hit(origin, direction, max)?.is_some())
    }

    /// The smallest multiple of `direction` from `origin` to the surface, up to `max`; see [`Pyramid::occluded`].
    ///
    /// # Errors
    /// As for [`Pyramid::occluded`].
    pub fn first_hit(&self, origin: DVec3, direction: DVec3, max: f64) -> Result<Option<f64>> {
        let is_ray = origin.is_finite() && direction.is_finite() && direction != DVec3::ZERO;
        if !is_ray || max.is_nan() || max < 0.0 {
            return Err(Error::arguments(format!(
                "a ray from {origin} along {direction} up to {max}: needs finite coordinates, a direction and a length"
            )));
        }
        let [dx, dy] = self.grid.cell();
        let last = (self.grid.rows() - 1) as f64;
        let ray = Ray {
            // In columns and rows.
            from: [origin.x / dx, last - origin.y / dy],
            along: [direction.x / dx, -direction.y / dy],
            height: origin.z,
            climb: direction.z,
        };
        let Some(part) = self.between_limits(&ray, max) else { return Ok(None) };
        Ok(self.descend(&ray, self.levels.len() - 1, [0, 0], part, &mut None))
    }

    /// The part of a ray up to `max` that is less than a millimetre, or more than rounding errors, above the highest or below the
    /// lowest height.
    fn between_limits(&self, ray: &Ray, max: f64) -> Option<[f64; 2]> {
        if ray.climb == 0.0 {
            return Some([0.0, max]);
        }
        let [low, high] = self.levels[self.levels.len() - 1].limits[0].map(f64::from);
        let margin = 1e-3 + 1e3 * self.tolerance;
        let (a, b) = ((low - margin - ray.height) / ray.climb, (high + margin - ray.height) / ray.climb);
        let part = [a.min(b).max(0.0), a.max(b).min(max)];
        (part[0] <= part[1]).then_some(part)
    }

    /// Looks into a block for the first hit within a part of the ray. `above`: whether the ray was above the surface last; `None`
    /// before it had a height or after a hole.
    fn descend(
        &self,
        ray: &Ray,
        level: usize,
        [x, y]: [usize; 2],
        part: [f64; 2],
        above: &mut Option<bool>,
    ) -> Option<f64> {
        let size = BLOCK << level;
        let ends =
            [(self.grid.columns() - 1).min((x + 1) * size), (self.grid.rows() - 1).min((y + 1) * size)];
        let part = ray.within([x * size, y * size], ends, part)?;
        let Level { columns, limits } = &self.levels[level];
        let [low, high] = limits[y * columns + x].map(f64::from);
        let [a, b] = part.map(|t| ray.height_at(t));
        if a.min(b) > high + self.tolerance {
            *above = (low <= high).then_some(true);
            return None;
        }
        if a.max(b) < low - self.tolerance {
            *above = (low <= high).then_some(false);
            return None;
        }
        if level == 0 {
            return self.cells(ray, [x * BLOCK, y * BLOCK], ends, part, above);
        }
        let below = &self.levels[level - 1];
        let rows = below.limits.len() / below.columns;
        // Children in the order in which the ray meets them.
        let flip = ray.along.map(|d| usize::from(d < 0.0));
        let first = ray.first_of_sides([(x * 2 + 1) * size / 2, (y * 2 + 1) * size / 2]);
        let order = if first { [[0, 0], [1, 0], [0, 1], [1, 1]] } else { [[0, 0], [0, 1], [1, 0], [1, 1]] };
        order.into_iter().find_map(|[i, j]: [usize; 2]| {
            let child = [x * 2 + (i ^ flip[0]), y * 2 + (j ^ flip[1])];
            let exists = child[0] < below.columns && child[1] < rows;
            exists.then(|| self.descend(ray, level - 1, child, part, above)).flatten()
        })
    }

    /// Goes from cell to cell through a block.
    fn cells(
        &self,
        ray: &Ray,
        low: [usize; 2],
        ends: [usize; 2],
        part: [f64; 2],
        above: &mut Option<bool>,
    ) -> Option<f64> {
        let mut t = part[0];
        let place = ray.at(t);
        // The cell at the beginning; on an edge the cell that the ray enters.
        let mut cell: [isize; 2] = std::array::from_fn(|k| {
            let x = place[k];
            let i = if ray.along[k] < 0.0 { x.ceil() as isize - 1 } else { x.floor() as isize };
            i.clamp(low[k] as isize, ends[k] as isize - 1)
        });
        loop {
            // Where the ray leaves the cell, and over which side.
            let leave = |k: usize| match ray.along[k] {
                d if d > 0.0 => ((cell[k] + 1) as f64 - ray.from[k]) / d,
                d if d < 0.0 => (cell[k] as f64 - ray.from[k]) / d,
                _ => f64::INFINITY,
            };
            let sides = [leave(0), leave(1)];
            let side = usize::from(sides[1] < sides[0]);
            let end = sides[side].clamp(t, part[1]);
            if let Some(hit) = self.cell(ray, cell.map(|i| i as usize), [t, end], above) {
                return Some(hit);
            }
            if sides[side] >= part[1] {
                return None;
            }
            cell[side] += if ray.along[side] > 0.0 { 1 } else { -1 };
            if cell[side] < low[side] as isize || cell[side] >= ends[side] as isize {
                return None;
            }
            t = end;
        }
    }

    /// The first change of sign of the ray's height above the surface within one cell.
    fn cell(
        &self,
        ray: &Ray,
        [c, r]: [usize; 2],
        [t, end]: [f64; 2],
        above: &mut Option<bool>,
    ) -> Option<f64> {
        let h = |i: usize, j: usize| f64::from(self.grid.height(c + i, r + j));
        // North-west, north-east, south-west, south-east; the diagonal is from the south-west to the north-east.
        let [nw, ne, sw, se] = [h(0, 0), h(1, 0), h(0, 1), h(1, 1)];
        let clearance = |t: f64, is_south_east: bool| {
            let [x, y] = ray.at(t);
            let (u, v) = ((x - c as f64).clamp(0.0, 1.0), (y - r as f64).clamp(0.0, 1.0));
            let surface = match is_south_east {
                false => nw + (ne - nw) * u + (sw - nw) * v,
                true => se + (sw - se) * (1.0 - u) + (ne - se) * (1.0 - v),
            };
            ray.height_at(t) - surface
        };
        let sum = |t: f64| {
            let [x, y] = ray.at(t);
            (x - c as f64) + (y - r as f64) - 1.0
        };
        let (a, b) = (sum(t), sum(end));
        let split = t + (end - t) * a / (a - b);
        let mut halves = [(a + b > 0.0, [t, end]), (false, [0.0, -1.0])];
        if a * b < 0.0 {
            halves = [(a > 0.0, [t, split]), (b > 0.0, [split, end])];
        }
        for (is_south_east, [t, end]) in halves {
            if end < t {
                continue;
            }
            let (from, to) = (clearance(t, is_south_east), clearance(end, is_south_east));
            if from.is_nan() || to.is_nan() {
                // A triangle with a corner in a hole does not exist.
                *above = None;
                continue;
            }
            for (value, at) in [(from, t), (to, end)] {
                if value.abs() <= self.tolerance {
                    continue;
                }
                let is_above = value > 0.0;
                if above.is_some_and(|was| was != is_above) {
                    return Some(if at == end && to != from {
                        t + (end - t) * from / (from - to)
                    } else {
                        at
                    });
                }
                *above = Some(is_above);
            }
        }
        None
    }
}

/// A ray with horizontal coordinates in columns and rows.
struct Ray {
    from: [f64; 2],
    along: [f64; 2],
    height: f64,
    climb: f64,
}

impl Ray {
    fn at(&self, t: f64) -> [f64; 2] {
        // An infinite ray is cut at the border before; one without horizontal part stays where it is.
        std::array::from_fn(|k| {
            if self.along[k] == 0.0 { self.from[k] } else { self.from[k] + self.along[k] * t }
        })
    }

    fn height_at(&self, t: f64) -> f64 {
        if self.climb == 0.0 { self.height } else { self.height + self.climb * t }
    }

    /// The part of the ray within a rectangle.
    fn within(&self, low: [usize; 2], high: [usize; 2], [mut start, mut end]: [f64; 2]) -> Option<[f64; 2]> {
        for k in 0..2 {
            let (from, along) = (self.from[k], self.along[k]);
            let (low, high) = (low[k] as f64, high[k] as f64);
            if along == 0.0 {
                if from < low || from > high {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - from) / along, (high - from) / along);
            start = start.max(a.min(b));
            end = end.min(a.max(b));
        }
        (start <= end).then_some([start, end])
    }

    /// Whether the ray crosses the vertical middle line of a block before the horizontal one.
    fn first_of_sides(&self, middle: [usize; 2]) -> bool {
        let time = |k: usize| match self.along[k] {
            0.0 => f64::INFINITY,
            d => (middle[k] as f64 - self.from[k]) / d,
        };
        time(0) <= time(1)
    }
}
