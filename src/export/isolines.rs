//! Isolines by marching squares, and their strokes in pictures.

use crate::image_io::Picture;
use glam::DVec2;

/// Half of the width of lines, pixels.
const HALF_WIDTH: f64 = 0.8;

/// Both ends of a straight piece of an isoline.
pub(super) type Piece = [DVec2; 2];

/// The pieces of the isoline of `level` in the unit square. Values are given at its corners, counterclockwise from the origin, and are
/// linear along its edges; values equal to the level count as above it.
pub(super) fn pieces(corners: [f64; 4], level: f64) -> impl Iterator<Item = Piece> {
    const PLACES: [DVec2; 4] = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
    let crossing = |edge: usize| {
        let [k, next] = [edge, (edge + 1) % 4];
        let [a, b] = [corners[k], corners[next]];
        let crosses = (a >= level) != (b >= level);
        crosses.then(|| PLACES[k].lerp(PLACES[next], (level - a) / (b - a)))
    };
    let found = [0, 1, 2, 3].map(crossing);
    let pieces = match found {
        [Some(a), Some(b), Some(c), Some(d)] => {
            // A saddle: the middle decides which opposite corners are connected.
            let middle = 0.25 * corners.iter().sum::<f64>();
            let connects_origin = (middle >= level) == (corners[0] >= level);
            if connects_origin { [Some([a, b]), Some([c, d])] } else { [Some([d, a]), Some([b, c])] }
        }
        _ => {
            let mut ends = found.into_iter().flatten();
            [ends.next().zip(ends.next()).map(|(a, b)| [a, b]), None]
        }
    };
    pieces.into_iter().flatten()
}

/// Lines of one colour, with smooth edges.
pub(super) struct Strokes {
    size: [usize; 2],
    /// Part of each pixel that is covered, of 255, row by row.
    coverage: Vec<u8>,
}

impl Strokes {
    /// No lines yet, in a picture of this size.
    pub(super) fn new(size: [usize; 2]) -> Strokes {
        Strokes { size, coverage: vec![0; size[0] * size[1]] }
    }

    /// Adds a straight line; coordinates in pixels from the upper left corner.
    pub(super) fn add(&mut self, [from, to]: Piece) {
        let reach = DVec2::splat(HALF_WIDTH + 0.5);
        let [low, high] = [from.min(to) - reach, from.max(to) + reach];
        let range = |k: usize| low[k].max(0.0) as usize..(high[k].ceil().max(0.0) as usize).min(self.size[k]);
        let along = to - from;
        for y in range(1) {
            for x in range(0) {
                let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - from;
                let part = (at.dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                let covered = (reach.x - at.distance(part * along)).clamp(0.0, 1.0);
                let old = &mut self.coverage[y * self.size[0] + x];
                // The largest part, so that common ends of pieces are not darker.
                *old = (*old).max((255.0 * covered).round() as u8);
            }
        }
    }

    /// Draws the lines in a grey from 0 to 255; `corner`: place of their upper left corner in the picture.
    pub(super) fn draw(&self, picture: &mut Picture, corner: [usize; 2], grey: u8) {
        for (k, &covered) in self.coverage.iter().enumerate().filter(|(_, covered)| **covered > 0) {
            let [x, y] = [k % self.size[0] + corner[0], k / self.size[0] + corner[1]];
            let pixel = &mut picture.pixels[y * picture.width + x];
            let [part, grey] = [u32::from(covered), u32::from(grey)];
            *pixel = pixel.map(|old| ((u32::from(old) * (255 - part) + grey * part + 127) / 255) as u8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_join_the_crossings_of_edges() {
        let found = |corners, level| pieces(corners, level).collect::<Vec<Piece>>();
        assert!(found([1.0; 4], 1.0).is_empty() && found([1.0; 4], 2.0).is_empty());
        // Light 4 x + 2 y is 3 at x = 0.75, y = 0 and at x = 0.25, y = 1.
        let line = found([0.0, 4.0, 6.0, 2.0], 3.0);
        assert_eq!(line, [[DVec2::new(0.75, 0.0), DVec2::new(0.25, 1.0)]]);
        // Saddles: both corners above are connected if the middle is above, otherwise each is cut off.
        for (level, want) in [(0.4, 0.4 / 1.0), (0.6, 0.6)] {
            let lines = found([1.0, 0.0, 1.0, 0.0], level);
            assert_eq!(lines.len(), 2, "level {level}");
            let cut_off = if level < 0.5 { DVec2::X } else { DVec2::ZERO };
            let distance = if level < 0.5 { want } else { 1.0 - want };
            assert!(lines[0].iter().all(|end| (end.distance(cut_off) - distance).abs() < 1e-12), "{lines:?}");
        }
    }

    #[test]
    fn strokes_cover_parts_of_pixels_near_the_line() {
        let mut strokes = Strokes::new([9, 9]);
        strokes.add([DVec2::new(4.5, -3.0), DVec2::new(4.5, 12.0)]);
        strokes.add([DVec2::new(4.5, 2.0), DVec2::new(4.5, 2.0)]);
        let mut picture = Picture { width: 11, height: 11, pixels: vec![[200; 3]; 121] };
        strokes.draw(&mut picture, [1, 1], 0);
        let row: Vec<u8> = picture.pixels[5 * 11..6 * 11].iter().map(|p| p[0]).collect();
        assert!(row[5] == 0 && row[3] == 200 && row[7] == 200, "{row:?}");
        assert!(row[4] == row[6] && (100..180).contains(&row[4]), "{row:?}");
    }
}
