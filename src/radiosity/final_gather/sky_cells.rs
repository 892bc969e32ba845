//! Light of the sky at a point: a grid of rays, one for each cell of a hemisphere of equal cosine weight, and finer cells where neighbours
//! differ, as at the edges of a window or of a bright part of the sky.

use super::direct_light::GatherPoint;
use super::gatherer::FinalGather;
use crate::embree::Hits;
use crate::math::sampling::{cosine_direction, mix, numbers};
use crate::radiosity::links::Tally;
use crate::radiosity::rgb::mean;
use crate::ray::{LANES, Packet};
use glam::{DVec3, Vec3};
use rustc_hash::FxHashMap;

/// Largest number of halvings of a cell: of 1,024 cells, edges are then known to a 64th of a cell.
const MAX_LEVEL: u32 = 6;
/// Rays of a point at which cells are not divided any more: leaves are edges in all cells, and 3,000 rays leave an error of 1 % there. Windows and
/// roofs need some hundreds, of a point that sees little of the sky twice as many as of leaves.
const MAX_RAYS: usize = 1 << 13;
/// Part of the cell's area by which the light of a cell errs for each unit of the largest difference of its neighbours: an edge that is anywhere in
/// two cells is found by their two rays to a standard deviation of √(1/12) = .29 of a cell.
const ERROR_OF_DIFFERENCE: f64 = 0.29;
/// Error of the light of the sky at a point, relative to it, over the error asked for.
const TOLERANCE: f64 = 0.1;
/// Fewest cells that see the sky: a grid with fewer is made finer as a whole, because a window that is smaller than a cell may be missed.
const MIN_OPEN: usize = 32;
/// Largest grids that are made finer as a whole: without a cell that sees the sky, and with some.
const MAX_WHOLE: [usize; 2] = [1 << 8, 1 << 12];

/// Rays of a grid of the hemisphere: `size` are its columns and rows on the square that is mapped to the hemisphere (Shirley and Chiu 1997).
pub(super) struct SkyGrid {
    pub size: [usize; 2],
    /// By cell, row after row, the irradiance that its ray stands for, W/m².
    pub cells: Vec<Vec3>,
}

/// Cells of one level by column and row.
type Level = FxHashMap<[u32; 2], Vec3>;

/// A cell that may be divided, and the square of its expected error.
type Uneven = ([u32; 2], f64);

impl FinalGather<'_> {
    /// Irradiance of the sky at a point whose grid of rays has found this, W/m². `frame` are the axes of the grid about the normal.
    pub(super) fn sky_at(
        &self,
        grid: SkyGrid,
        frame: [Vec3; 3],
        point: &GatherPoint,
        tally: &mut Tally,
    ) -> DVec3 {
        let [columns, rows] = grid.size;
        let at = |k: usize| [(k % columns) as u32, (k / columns) as u32];
        let mut levels: Vec<Level> = vec![grid.cells.iter().enumerate().map(|(k, e)| (at(k), *e)).collect()];
        let share = 1.0 / (columns * rows) as f64;
        let mut sum: DVec3 = grid.cells.iter().map(|e| e.as_dvec3()).sum::<DVec3>() * share;
        // Errors of cells that are left as they are.
        let (mut left, mut traced) = (0.0, 0);
        for level in 0..MAX_LEVEL {
            let area = share * 0.25f64.powi(level as i32);
            let cells = &levels[level as usize];
            let open = cells.values().filter(|e| **e != Vec3::ZERO).count();
            let is_whole = cells.len() == grid.cells.len() << (2 * level)
                && open < MIN_OPEN
                && cells.len() <= MAX_WHOLE[usize::from(open > 0)];
            let uneven = uneven_cells(&levels, grid.size, area);
            let tolerance = (TOLERANCE * self.error * mean(sum.to_array())).powi(2);
            let error: f64 = uneven.iter().map(|(_, e)| e).sum();
            let least = tolerance / (2 * uneven.len().max(1)) as f64;
            let mut chosen: Vec<[u32; 2]> = match is_whole {
                true => cells.keys().copied().collect(),
                false if left + error <= tolerance => break,
                false => uneven.iter().filter(|(_, e)| *e > least).map(|(at, _)| *at).collect(),
            };
            chosen.truncate((MAX_RAYS - traced) / 4);
            if chosen.is_empty() {
                break;
            }
            left += uneven.iter().filter(|(_, e)| *e <= least).map(|(_, e)| e).sum::<f64>();
            chosen.sort_unstable();
            traced += 4 * chosen.len();
            let quarters = self.quarters(&chosen, level + 1, grid.size, frame, point);
            for cell in &chosen {
                sum -= levels[level as usize][cell].as_dvec3() * area;
            }
            // In a fixed order, so that the sum has the same bits on every run.
            sum += quarters.iter().map(|(_, e)| e.as_dvec3()).sum::<DVec3>() * (0.25 * area);
            levels.push(quarters.into_iter().collect());
        }
        (tally.segments, tally.exact_rays) =
            (tally.segments + traced as u64, tally.exact_rays + traced as u64);
        sum
    }

    /// The light of the quarters of cells, by one ray each.
    fn quarters(
        &self,
        cells: &[[u32; 2]],
        level: u32,
        [columns, rows]: [usize; 2],
        [x, y, z]: [Vec3; 3],
        point: &GatherPoint,
    ) -> Vec<([u32; 2], Vec3)> {
        let parts: Vec<[u32; 2]> = cells
            .iter()
            .flat_map(|[i, j]| [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[a, b]| [2 * i + a, 2 * j + b]))
            .collect();
        let scale = (1u32 << level) as f32;
        let seed = mix(point.seed ^ u64::from(level) << 32);
        let direction = |(k, [i, j]): (usize, &[u32; 2])| {
            let [u, v, ..] = numbers(seed, k as u64);
            let place = |at: u32, within: f32, cells: usize| (at as f32 + within) / (scale * cells as f32);
            let d = cosine_direction(Vec3::Z, place(*i, u, columns), place(*j, v, rows));
            d.x * x + d.y * y + d.z * z
        };
        let directions: Vec<Vec3> = parts.iter().enumerate().map(direction).collect();
        let mut packets = vec![Packet::EMPTY; directions.len().div_ceil(LANES)];
        for (k, direction) in directions.iter().enumerate() {
            let to = point.at + self.length * *direction;
            packets[k / LANES].set_between(k % LANES, point.at, to, [0.0, 1.0]);
        }
        let mut hits = vec![Hits::NONE; packets.len()];
        self.traced.first_hits(self.traversal, &packets, &mut hits);
        let light = |(k, direction): (usize, &Vec3)| match hits[k / LANES].triangle[k % LANES] {
            Hits::NOTHING => self.sky_of_ray(*direction),
            _ => Vec3::ZERO,
        };
        let light: Vec<Vec3> = directions.iter().enumerate().map(light).collect();
        parts.into_iter().zip(light).collect()
    }
}

/// The cells of the finest level whose neighbours differ from each other, with the square of their error, (W/m²)², the largest first. The ray of
/// a cell does not say whether it is divided: of cells that are open in part, those whose ray happens to be blocked would be left so. Where a neighbour is not divided as often, its
/// larger cell counts.
fn uneven_cells(levels: &[Level], [columns, rows]: [usize; 2], area: f64) -> Vec<Uneven> {
    let level = levels.len() - 1;
    let size = [columns << level, rows << level].map(|n| n as i64);
    let of = |[mut i, mut j]: [u32; 2]| {
        for cells in levels.iter().rev() {
            if let Some(light) = cells.get(&[i, j]) {
                return Some(*light);
            }
            (i, j) = (i / 2, j / 2);
        }
        None
    };
    let mut found: Vec<Uneven> = Vec::new();
    for &[i, j] in levels[level].keys() {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        // Of the whole grid two rings: the ends of narrow strips of sky are thinner than a cell.
        let reach = if level == 0 { 2 } else { 1 };
        let side = 2 * reach + 1;
        for k in (0..side * side).filter(|k| *k != side * side / 2) {
            let (column, row) = (i64::from(i) + k % side - reach, i64::from(j) + k / side - reach);
            if (0..size[0]).contains(&column)
                && (0..size[1]).contains(&row)
                && let Some(other) = of([column as u32, row as u32])
            {
                let light = other.element_sum() / 3.0;
                (low, high) = (low.min(light), high.max(light));
            }
        }
        let difference = high - low;
        if difference > 0.0 {
            found.push(([i, j], (area * ERROR_OF_DIFFERENCE * f64::from(difference)).powi(2)));
        }
    }
    found.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    found
}
