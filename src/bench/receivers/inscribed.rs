//! The largest rectangle inside a patch: the image of a disc or of an L-shaped floor shows no texel beside it.

use super::rectangle::Rectangle;
use super::relief::highest;
use crate::scene::Scene;

/// Cells along the longer side of the rectangle around the patch: the rectangle inside is found to 2 %.
const CELLS: usize = 128;

/// The largest rectangle of covered cells, with sides parallel to those of `around`, which contains the triangles.
pub(super) fn inscribed(scene: &Scene, triangles: &[u32], around: &Rectangle) -> Option<Rectangle> {
    let cell = around.width / CELLS as f64;
    let rows = (around.height / cell).floor().max(1.0) as usize;
    let highest = highest(scene, triangles, around, (CELLS, rows, cell));
    let covered: Vec<bool> = highest.iter().map(Option::is_some).collect();
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
