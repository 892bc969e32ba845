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

/// Largest number of halvings of a cell: of 1,024 cells, edges are then known to a 64th of a cell.
const MAX_LEVEL: u32 = 6;
/// Rays of a point at which cells are not divided any more: leaves are edges in all cells, and 3,000 rays leave an error of 1 % there. Windows and
/// roofs need some hundreds, of a point that sees little of the sky twice as many as of leaves.
const MAX_RAYS: usize = 1 << 13;
/// Part of a cell that is known to be open or blocked only by its ray, as a standard deviation: an edge that is anywhere in two cells is found by
/// their two rays to √(1/12) = .29 of a cell.
const ERROR_OF_EDGE: f64 = 0.29;
/// The same for a difference of radiance: a place at random in the cell errs by √(1/12) of the difference over it. Cells of the undivided grid have
/// one place in each quarter: half of that for each, and half of that for their mean.
const ERROR_OF_GRADIENT: [f64; 2] = [0.29 / 4.0, 0.29];
/// Error of the light of the sky at a point, relative to all of its light, over the error asked for.
const TOLERANCE: f64 = 0.1;
/// Fewest cells that see the sky: a grid with fewer is made finer as a whole, because a window that is smaller than a cell may be missed.
const MIN_OPEN: usize = 32;
/// Cells of a grid that is not made finer as a whole any more. An opening that is seen as a thousandth of the light of an open sky has four cells then,
/// and its edges have finer ones.
const MAX_WHOLE: usize = 1 << 12;

/// Rays of a grid of the hemisphere: `size` are its columns and rows on the square that is mapped to the hemisphere (Shirley and Chiu 1997).
pub(super) struct SkyGrid {
    pub size: [usize; 2],
    /// By cell, row after row, whether its ray leaves the scene.
    pub open: Vec<bool>,
    /// Whether all rays met sides that no light reaches, as from below the ground: nothing is searched for there.
    pub is_dark: bool,
}

/// A cell of the grid or of one of its divisions.
#[derive(Clone, Copy)]
struct Cell {
    /// Column and row among the cells of its level.
    place: [u32; 2],
    /// Whether its ray leaves the scene.
    is_open: bool,
    /// Irradiance that it would give if all of it were open, over its area, W/m².
    sky: Vec3,
    /// Mean of `sky` over the channels.
    level: f32,
    /// Index of the first of its quarters in the next level; [`WHOLE`] if it is not divided.
    quarters: u32,
}

/// Index of the quarters of a cell that is not divided.
const WHOLE: u32 = u32::MAX;

impl Cell {
    /// The light that arrives.
    fn light(&self) -> DVec3 {
        if self.is_open { self.sky.as_dvec3() } else { DVec3::ZERO }
    }
}

/// Axes about the normal of a point, and columns and rows of the undivided grid.
#[derive(Clone, Copy)]
struct Hemisphere {
    frame: [Vec3; 3],
    size: [usize; 2],
}

impl Hemisphere {
    /// The direction at a place of the grid's square, given in cells of a level.
    fn direction(&self, level: u32, [u, v]: [f32; 2]) -> Vec3 {
        let [x, y, z] = self.frame;
        let scale = (1u32 << level) as f32;
        let d =
            cosine_direction(Vec3::Z, u / (scale * self.size[0] as f32), v / (scale * self.size[1] as f32));
        d.x * x + d.y * y + d.z * z
    }
}

/// A cell that may be divided, by its index in its level, and the square of its expected error.
type Uneven = (u32, f64);

impl FinalGather<'_> {
    /// Irradiance of the sky at a point whose grid of rays has found this, W/m². `frame` are the axes of the grid about the normal, `other` is the
    /// light of all else there, mean over the channels: in the sun the sky need not be known as well as in a shadow.
    pub(super) fn sky_at(
        &self,
        grid: SkyGrid,
        frame: [Vec3; 3],
        (point, other): (&GatherPoint, f64),
        tally: &mut Tally,
    ) -> DVec3 {
        let [columns, rows] = grid.size;
        let hemisphere = Hemisphere { frame, size: grid.size };
        let at = |k: usize| [(k % columns) as u32, (k / columns) as u32];
        let whole = (0..columns * rows).map(|k| self.cell(&hemisphere, 0, at(k), grid.open[k], point));
        let mut levels: Vec<Vec<Cell>> = vec![whole.collect()];
        let share = 1.0 / (columns * rows) as f64;
        let mut sum = levels[0].iter().map(Cell::light).sum::<DVec3>() * share;
        // Errors of cells that are left as they are.
        let (mut left, mut traced) = (0.0, 0);
        for level in 0..MAX_LEVEL {
            let area = share * 0.25f64.powi(level as i32);
            let cells = &levels[level as usize];
            let open = cells.iter().filter(|cell| cell.light() != DVec3::ZERO).count();
            let is_undivided = cells.len() == grid.open.len() << (2 * level) && cells.len() < MAX_WHOLE;
            let is_whole = is_undivided && open < MIN_OPEN && !grid.is_dark;
            let uneven = uneven_cells(&levels, grid.size, area);
            let tolerance = (TOLERANCE * self.error * (other + mean(sum.to_array()))).powi(2);
            let error: f64 = uneven.iter().map(|(_, e)| e).sum();
            let least = tolerance / (2 * uneven.len().max(1)) as f64;
            let mut chosen: Vec<u32> = match is_whole {
                true => (0..cells.len() as u32).collect(),
                false if left + error <= tolerance => break,
                false => uneven.iter().filter(|(_, e)| *e > least).map(|(k, _)| *k).collect(),
            };
            chosen.truncate((MAX_RAYS - traced) / 4);
            if chosen.is_empty() {
                break;
            }
            left += uneven.iter().filter(|(_, e)| *e <= least).map(|(_, e)| e).sum::<f64>();
            chosen.sort_unstable();
            traced += 4 * chosen.len();
            let cells = &mut levels[level as usize];
            for (k, &cell) in chosen.iter().enumerate() {
                let cell = &mut cells[cell as usize];
                cell.quarters = 4 * k as u32;
                sum -= cell.light() * area;
            }
            let places: Vec<[u32; 2]> = chosen.iter().map(|&k| cells[k as usize].place).collect();
            let quarters = self.quarters(&places, level + 1, &hemisphere, point);
            sum += quarters.iter().map(Cell::light).sum::<DVec3>() * (0.25 * area);
            levels.push(quarters);
        }
        (tally.segments, tally.exact_rays) =
            (tally.segments + traced as u64, tally.exact_rays + traced as u64);
        // What is added and taken away again leaves a rounding error.
        sum.max(DVec3::ZERO)
    }

    /// The quarters of cells, by one ray each.
    fn quarters(
        &self,
        cells: &[[u32; 2]],
        level: u32,
        hemisphere: &Hemisphere,
        point: &GatherPoint,
    ) -> Vec<Cell> {
        let parts: Vec<[u32; 2]> = cells
            .iter()
            .flat_map(|[i, j]| [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[a, b]| [2 * i + a, 2 * j + b]))
            .collect();
        let seed = mix(point.seed ^ u64::from(level) << 32);
        let mut packets = vec![Packet::EMPTY; parts.len().div_ceil(LANES)];
        for (k, [i, j]) in parts.iter().enumerate() {
            let [u, v, ..] = numbers(seed, k as u64);
            let direction = hemisphere.direction(level, [*i as f32 + u, *j as f32 + v]);
            let to = point.at + self.length * direction;
            packets[k / LANES].set_between(k % LANES, point.at, to, [0.0, 1.0]);
        }
        let mut hits = vec![Hits::NONE; packets.len()];
        self.traced.first_hits(self.traversal, &packets, &mut hits);
        let is_open = |k: usize| hits[k / LANES].triangle[k % LANES] == Hits::NOTHING;
        let cell = |(k, place): (usize, &[u32; 2])| self.cell(hemisphere, level, *place, is_open(k), point);
        parts.iter().enumerate().map(cell).collect()
    }

    /// A cell with the radiance of the sky at a place in it, in the undivided grid in each of its quarters.
    fn cell(
        &self,
        hemisphere: &Hemisphere,
        level: u32,
        place: [u32; 2],
        is_open: bool,
        point: &GatherPoint,
    ) -> Cell {
        let seed = mix(!point.seed ^ u64::from(level) << 32);
        let [u, v, p, q] = numbers(seed, u64::from(place[0]) << 32 | u64::from(place[1]));
        let sky_at = |[u, v]: [f32; 2]| {
            self.sky_of_ray(hemisphere.direction(level, [place[0] as f32 + u, place[1] as f32 + v]))
        };
        // Places that mirror each other in pairs, so that what is linear over the cell has no error.
        let sky = match level {
            0 => {
                let ([u, v], [p, q]) = ([0.5 * u, 0.5 * v], [0.5 * p, 0.5 * q]);
                let mirrored = [[u, v], [1.0 - u, 1.0 - v], [p, 1.0 - q], [1.0 - p, q]];
                0.25 * mirrored.into_iter().map(sky_at).sum::<Vec3>()
            }
            _ => sky_at([u, v]),
        };
        Cell { place, is_open, sky, level: sky.element_sum() / 3.0, quarters: WHOLE }
    }
}

/// The cells of the finest level whose neighbours differ from each other, with the square of their error, (W/m²)², the largest first. The ray of
/// a cell does not say whether it is divided: of cells that are open in part, those whose ray happens to be blocked would be left so. Where a
/// neighbour is not divided as often, its larger cell counts.
fn uneven_cells(levels: &[Vec<Cell>], [columns, rows]: [usize; 2], area: f64) -> Vec<Uneven> {
    let finest = levels.len() - 1;
    let size = [columns << finest, rows << finest];
    // The cell of the finest level at a place, or the smallest that is not divided there.
    let of = |[i, j]: [usize; 2]| {
        let mut cell = &levels[0][(j >> finest) * columns + (i >> finest)];
        for (depth, cells) in levels.iter().enumerate().skip(1) {
            if cell.quarters == WHOLE {
                break;
            }
            let half = |at: usize| (at >> (finest - depth)) & 1;
            cell = &cells[cell.quarters as usize + half(i) + 2 * half(j)];
        }
        cell
    };
    // Of the whole grid two rings: the ends of narrow strips of sky are thinner than a cell.
    let reach = if finest == 0 { 2 } else { 1 };
    let range =
        |at: u32, size: usize| (at as usize).saturating_sub(reach)..(at as usize + reach + 1).min(size);
    let mut found: Vec<Uneven> = Vec::new();
    for (k, cell) in levels[finest].iter().enumerate() {
        let [i, j] = cell.place;
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        let (mut open, mut blocked) = (false, false);
        for row in range(j, size[1]) {
            for column in range(i, size[0]) {
                if [column, row] != [i as usize, j as usize] {
                    let near = of([column, row]);
                    (low, high) = (low.min(near.level), high.max(near.level));
                    (open, blocked) = (open || near.is_open, blocked || !near.is_open);
                }
            }
        }
        let edge = if open && blocked { ERROR_OF_EDGE * f64::from(high) } else { 0.0 };
        // An edge is in one of the cells across it, and so is the difference between the nearest on either side.
        let across = (2 * reach + 1) as f64;
        let of_cell = if open { ERROR_OF_GRADIENT[usize::from(finest > 0)] / across } else { 0.0 };
        let gradient = of_cell * f64::from(high - low);
        let error = area * area * (edge * edge / across + gradient * gradient);
        if error > 0.0 {
            found.push((k as u32, error));
        }
    }
    found.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    found
}
