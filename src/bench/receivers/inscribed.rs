//! The largest rectangle inside a patch: the image of a disc or of an L-shaped floor shows no texel beside it.

use super::rectangle::Rectangle;
use crate::scene::Scene;
use glam::DVec2;

/// Cells along the longer side of the rectangle around the patch: the rectangle inside is found to 2 %.
const CELLS: usize = 128;

/// The largest rectangle of covered cells, with sides parallel to those of `around`, which contains the triangles.
pub(super) fn inscribed(scene: &Scene, triangles: &[u32], around: &Rectangle) -> Option<Rectangle> {
    let cell = around.width / CELLS as f64;
    let rows = (around.height / cell).floor().max(1.0) as usize;
    let covered = covered(scene, triangles, around, (rows, cell));
    let [left, top, right, bottom] = largest(&covered, CELLS)?;
    let up = around.normal.cross(around.right);
    let (width, height) = ((right - left) as f64 * cell, (bottom - top) as f64 * cell);
    let middle = |first: usize, last: usize, n: usize| (0.5 * (first + last) as f64 - 0.5 * n as f64) * cell;
    let centre = around.centre + middle(left, right, CELLS) * around.right - middle(top, bottom, rows) * up;
    let inside = Rectangle { centre, width, height, ..*around };
    Some(match width >= height {
        true => inside,
        false => Rectangle { right: up, width: height, height: width, ..inside }.upright(),
    })
}

/// Whether a triangle covers the centre of each cell, row by row from the top left.
fn covered(scene: &Scene, triangles: &[u32], around: &Rectangle, (rows, cell): (usize, f64)) -> Vec<bool> {
    let up = around.normal.cross(around.right);
    let mut covered = vec![false; CELLS * rows];
    for &t in triangles {
        let flat = scene.corners(t).map(|p| {
            let p = p.as_dvec3() - around.centre;
            DVec2::new(p.dot(around.right), -p.dot(up)) / cell + 0.5 * DVec2::new(CELLS as f64, rows as f64)
        });
        let twice = (flat[1] - flat[0]).perp_dot(flat[2] - flat[0]);
        if twice == 0.0 {
            continue;
        }
        let (low, high) = (flat[0].min(flat[1]).min(flat[2]), flat[0].max(flat[1]).max(flat[2]));
        let span = |from: f64, to: f64, n: usize| {
            (from.floor().max(0.0) as usize).min(n)..(to.ceil().max(0.0) as usize).min(n)
        };
        for y in span(low.y, high.y, rows) {
            for x in span(low.x, high.x, CELLS) {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let share = |i: usize, j: usize| (flat[i] - p).perp_dot(flat[j] - p) / twice;
                if [share(1, 2), share(2, 0), share(0, 1)].iter().all(|&w| w >= -1e-9) {
                    covered[y * CELLS + x] = true;
                }
            }
        }
    }
    covered
}

/// The rectangle with the most cells that are all true: first column and row, one past the last column and row.
fn largest(cells: &[bool], width: usize) -> Option<[usize; 4]> {
    let mut high = vec![0usize; width];
    let mut best: Option<(usize, [usize; 4])> = None;
    for (y, row) in cells.chunks(width).enumerate() {
        for (high, &cell) in high.iter_mut().zip(row) {
            *high = if cell { *high + 1 } else { 0 };
        }
        for left in 0..width {
            let mut low = usize::MAX;
            for (right, &cells) in high.iter().enumerate().skip(left) {
                low = low.min(cells);
                if low == 0 {
                    break;
                }
                let area = low * (right + 1 - left);
                if best.is_none_or(|b| area > b.0) {
                    best = Some((area, [left, y + 1 - low, right + 1, y + 1]));
                }
            }
        }
    }
    best.map(|(_, rectangle)| rectangle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_rectangle_is_found() {
        let picture = ["..##....", ".#####..", ".#####..", ".####.#.", "........"];
        let cells: Vec<bool> = picture.iter().flat_map(|row| row.chars().map(|c| c == '#')).collect();
        assert_eq!(largest(&cells, 8), Some([1, 1, 5, 4]));
        assert_eq!(largest(&[false; 6], 3), None);
    }
}
