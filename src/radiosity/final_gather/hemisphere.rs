//! Grids of rays on the hemisphere about the normal of a point.

use crate::math::sampling::{cosine_direction, numbers};
use crate::ray::LANES;
use glam::Vec3;

/// A grid on the hemisphere about the normal of a point: axes, and columns and rows of the undivided grid on the square that is mapped to
/// the hemisphere (Shirley and Chiu 1997).
#[derive(Clone, Copy)]
pub(super) struct Hemisphere {
    pub frame: [Vec3; 3],
    pub size: [usize; 2],
    /// Length of rays, scene units.
    pub reach: f32,
}

impl Hemisphere {
    /// The cells of the undivided grid, row after row.
    pub fn places(&self) -> Vec<[u32; 2]> {
        let [columns, rows] = self.size.map(|n| n as u32);
        (0..rows).flat_map(|j| (0..columns).map(move |i| [i, j])).collect()
    }

    /// The rays of the undivided grid row after row, from rays in blocks of 4 by 4 cells.
    pub fn in_rows<T: Copy>(&self, blocks: &[T]) -> Vec<T> {
        let [columns, rows] = self.size;
        let place = |k: usize| {
            let (i, j) = (k % columns, k / columns);
            LANES * (j / 4 * (columns / 4) + i / 4) + 4 * (j % 4) + i % 4
        };
        (0..columns * rows).map(|k| blocks[place(k)]).collect()
    }

    /// The direction at a place of the grid's square, given in cells of a level.
    pub fn direction(&self, level: u32, [u, v]: [f32; 2]) -> Vec3 {
        let [x, y, z] = self.frame;
        let scale = (1u32 << level) as f32;
        let d =
            cosine_direction(Vec3::Z, u / (scale * self.size[0] as f32), v / (scale * self.size[1] as f32));
        d.x * x + d.y * y + d.z * z
    }
}

/// Columns and rows of the blocks of 4 by 4 cells of a grid of at least `count` cells.
pub(super) fn grid_of(count: usize) -> [usize; 2] {
    let blocks = count.div_ceil(LANES);
    let across = (blocks as f64).sqrt().ceil() as usize;
    [across, blocks.div_ceil(across)]
}

/// At least `count` directions about +z with the density cos/π: one in each cell of a grid, in blocks of 4 by 4.
pub(super) fn hemisphere(count: usize, seed: u64) -> Vec<Vec3> {
    let [across, down] = grid_of(count);
    (0..across * down * LANES)
        .map(|k| {
            let (block, lane) = (k / LANES, k % LANES);
            let (i, j) = (block % across * 4 + lane % 4, block / across * 4 + lane / 4);
            let [r, s, ..] = numbers(seed, k as u64);
            let place =
                |cell: usize, within: f32, blocks: usize| (cell as f32 + within) / (4 * blocks) as f32;
            cosine_direction(Vec3::Z, place(i, r, across), place(j, s, down))
        })
        .collect()
}
