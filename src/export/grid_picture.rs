//! Light on a regular grid as a picture: false colours, isolines and a scale.

use super::false_colours::{Bands, NO_SURFACE};
use crate::image_io::Picture;
use crate::plot::number;
use glam::DVec2;

/// Pixels of the longer side of a grid: at least those of a screen, at most those of a large print.
const SIDE: [f64; 2] = [800.0, 4000.0];
/// Pixels around the grid and between the parts of the scale.
const GAP: usize = 12;
/// Width of the colours of the scale, and smallest height of a colour, pixels.
const SWATCH: [usize; 2] = [28, 2 * LINE];
/// Largest side of the squares that isolines are straight in, pixels: bends of 8 pixels look round.
const SQUARE: f64 = 8.0;

/// Light at the middles of the cells of a rectangle.
#[derive(Clone, Debug)]
pub struct GridLight {
    /// Number of columns and rows.
    pub counts: [usize; 2],
    /// Width and height of a cell, in any unit.
    pub steps: [f64; 2],
    /// Light by cell, row by row from the bottom; `None` where nothing was measured.
    pub values: Vec<Option<f32>>,
}

impl GridLight {
    /// The light at a place, in cells from the lower left corner; `None` in cells without light.
    fn at(&self, place: DVec2) -> Option<f64> {
        self.in_cell([0, 1].map(|k| (place[k] as usize).min(self.counts[k] - 1)), place)
    }

    /// The light at a place of a cell or of its edges: linear between the middles of cells; `None` in cells without light.
    fn in_cell(&self, cell: [usize; 2], place: DVec2) -> Option<f64> {
        let [columns, _] = self.counts;
        let value = |column: usize, row: usize| self.values[row * columns + column];
        value(cell[0], cell[1])?;
        let from: [f64; 2] =
            std::array::from_fn(|k| (place[k] - 0.5).clamp(0.0, (self.counts[k] - 1) as f64));
        let (mut sum, mut weights) = (0.0, 0.0);
        for corner in 0..4 {
            let step = [corner & 1, corner >> 1];
            let near: [usize; 2] =
                std::array::from_fn(|k| (from[k] as usize + step[k]).min(self.counts[k] - 1));
            let part = |k: usize| if step[k] == 0 { 1.0 - from[k].fract() } else { from[k].fract() };
            // Cells without light count for nothing; the own cell has a weight of at least a quarter.
            if let Some(light) = value(near[0], near[1]) {
                sum += part(0) * part(1) * f64::from(light);
                weights += part(0) * part(1);
            }
        }
        Some(sum / weights)
    }

    /// Calls `found` with the index of a level and a piece of its isoline, in cells from the lower left corner, for all pieces. Each cell
    /// is divided into `parts` squares along its sides; even numbers have corners at the points.
    fn isolines(&self, levels: &[f64], parts: [usize; 2], mut found: impl FnMut(usize, Piece)) {
        let [columns, rows] = self.counts;
        let part = 1.0 / DVec2::from(parts.map(|n| n as f64));
        for cell in (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row])) {
            let place = |x: usize, y: usize| {
                DVec2::from(cell.map(|n| n as f64)) + part * DVec2::new(x as f64, y as f64)
            };
            let nodes = (0..=parts[1]).flat_map(|y| (0..=parts[0]).map(move |x| (x, y)));
            let lights: Option<Vec<f64>> = nodes.map(|(x, y)| self.in_cell(cell, place(x, y))).collect();
            let Some(lights) = lights else { continue };
            for (x, y) in (0..parts[1]).flat_map(|y| (0..parts[0]).map(move |x| (x, y))) {
                let light = |x: usize, y: usize| lights[y * (parts[0] + 1) + x];
                let corners = [light(x, y), light(x + 1, y), light(x + 1, y + 1), light(x, y + 1)];
                let [low, high] = [f64::min, f64::max].map(|of| corners.into_iter().fold(corners[0], of));
                let first = levels.partition_point(|level| *level <= low);
                for (k, level) in
                    levels.iter().enumerate().skip(first).take_while(|(_, level)| **level <= high)
                {
                    pieces(corners, *level)
                        .for_each(|piece| found(k, piece.map(|end| place(x, y) + part * end)));
                }
            }
        }
    }

    /// The picture, with isolines at the limits of the colours, and their scale in `unit` on the right.
    pub fn picture(&self, unit: &str) -> Picture {
        let bands = Bands::of(self.values.iter().flatten().copied());
        let sides = [0, 1].map(|k| self.counts[k] as f64 * self.steps[k]);
        let longest = sides[0].max(sides[1]);
        let pixels = (self.counts[0].max(self.counts[1]) as f64).clamp(SIDE[0], SIDE[1]);
        let size = sides.map(|side| (pixels * side / longest).round().max(1.0) as usize);
        let each = DVec2::from([0, 1].map(|k| size[k] as f64 / self.counts[k] as f64));
        let mut picture = with_scale(&bands, size, unit);
        for y in 0..size[1] {
            for x in 0..size[0] {
                let place = DVec2::new(x as f64 + 0.5, (size[1] - 1 - y) as f64 + 0.5) / each;
                let band = self.at(place).map(|light| bands.band(light));
                picture.pixels[(y + GAP) * picture.width + x + GAP] =
                    band.map_or(NO_SURFACE, |band| bands.colour(band));
            }
        }
        let mut strokes = [LineCoverage::new(size), LineCoverage::new(size)];
        let parts = [0, 1].map(|k| 2 * (0.5 * each[k] / SQUARE).ceil() as usize);
        self.isolines(bands.limits(), parts, |level, piece| {
            let from_top = |end: DVec2| DVec2::new(each.x * end.x, size[1] as f64 - each.y * end.y);
            strokes[usize::from(is_white(&bands, level))].add(piece.map(from_top));
        });
        for (strokes, grey) in strokes.iter().zip([0, 255]) {
            strokes.draw(&mut picture, [GAP; 2], grey);
        }
        picture
    }
}

/// Whether the isoline of a limit is white: between dark colours. Others are black.
fn is_white(bands: &Bands, limit: usize) -> bool {
    limit < bands.limits().len() / 2
}

/// A white picture with room for a grid of a size in pixels, and on its right the colours with their limits, the brightest at the top.
fn with_scale(bands: &Bands, size: [usize; 2], unit: &str) -> Picture {
    let limits = bands.limits();
    let labels: Vec<String> = limits.iter().map(|&limit| label(limit)).collect();
    let widest = labels.iter().map(|label| width(label)).max().unwrap_or(0).max(width(unit));
    let colours = limits.len() + 1;
    let each = ((size[1].saturating_sub(LINE)) / colours).clamp(SWATCH[1], 2 * SWATCH[1]);
    let left = size[0] + 2 * GAP;
    let wide = left + SWATCH[0] + GAP / 2 + widest.max(width(unit)) + GAP;
    let high = (size[1]).max(LINE + each * colours) + 2 * GAP;
    let mut picture = Picture { width: wide, height: high, pixels: vec![[255; 3]; wide * high] };
    write(&mut picture, unit, [left, GAP]);
    let top = GAP + LINE;
    for y in 0..each * colours {
        let colour = bands.colour(colours - 1 - y / each);
        let row = (top + y) * wide + left;
        picture.pixels[row..row + SWATCH[0]].fill(colour);
    }
    for (k, label) in labels.iter().enumerate() {
        let border = top + each * (colours - 1 - k);
        let line = border * wide + left;
        picture.pixels[line..line + SWATCH[0]].fill([if is_white(bands, k) { 255 } else { 0 }; 3]);
        write(&mut picture, label, [left + SWATCH[0] + GAP / 2, border - LINE / 2 + 1]);
    }
    picture
}

/// A number in the characters that pictures have.
fn label(value: f64) -> String {
    let text = number(value);
    if text.is_ascii() { text } else { format!("{value:e}") }
}

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
struct LineCoverage {
    size: [usize; 2],
    /// Covered fraction of each pixel, of 255, row by row.
    coverage: Vec<u8>,
}

impl LineCoverage {
    /// No lines yet, in a picture of this size.
    pub(super) fn new(size: [usize; 2]) -> LineCoverage {
        LineCoverage { size, coverage: vec![0; size[0] * size[1]] }
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

/// Width and height of a character, pixels, without the column after it.
const SIZE: [usize; 2] = [5, 7];
/// Pixels of a picture along the side of a character's pixel.
const SCALE: usize = 2;
/// Height of a line of text, pixels.
const LINE: usize = SCALE * (SIZE[1] + 2);

/// Rows of a character from the top; the bit of the left column is 16. Blank for characters that are not known.
fn glyph(character: char) -> [u8; SIZE[1]] {
    match character {
        '0' => [14, 17, 19, 21, 25, 17, 14],
        '1' => [4, 12, 4, 4, 4, 4, 14],
        '2' => [14, 17, 1, 2, 4, 8, 31],
        '3' => [31, 2, 4, 2, 1, 17, 14],
        '4' => [2, 6, 10, 18, 31, 2, 2],
        '5' => [31, 16, 30, 1, 1, 17, 14],
        '6' => [6, 8, 16, 30, 17, 17, 14],
        '7' => [31, 1, 2, 4, 8, 8, 8],
        '8' => [14, 17, 17, 14, 17, 17, 14],
        '9' => [14, 17, 17, 15, 1, 2, 12],
        '.' => [0, 0, 0, 0, 0, 12, 12],
        '-' => [0, 0, 0, 31, 0, 0, 0],
        '/' => [0, 1, 2, 4, 8, 16, 0],
        '²' => [12, 18, 4, 8, 30, 0, 0],
        'W' => [17, 17, 17, 21, 21, 21, 10],
        'e' => [0, 0, 14, 17, 31, 16, 14],
        'l' => [12, 4, 4, 4, 4, 4, 14],
        'm' => [0, 0, 26, 21, 21, 17, 17],
        'x' => [0, 0, 17, 10, 4, 10, 17],
        _ => [0; SIZE[1]],
    }
}

/// Width of a text, pixels.
pub(super) fn width(text: &str) -> usize {
    SCALE * (SIZE[0] + 1) * text.chars().count()
}

/// Writes black text with its upper left corner at a pixel; what lies beyond the picture is left out.
pub(super) fn write(picture: &mut Picture, text: &str, [left, top]: [usize; 2]) {
    for (k, character) in text.chars().enumerate() {
        let glyph = glyph(character);
        for (y, x) in (0..SCALE * SIZE[1]).flat_map(|y| (0..SCALE * SIZE[0]).map(move |x| (y, x))) {
            let (column, row) = (left + SCALE * k * (SIZE[0] + 1) + x, top + y);
            let is_set = glyph[y / SCALE] >> (SIZE[0] - 1 - x / SCALE) & 1 != 0;
            if is_set && column < picture.width && row < picture.height {
                picture.pixels[row * picture.width + column] = [0; 3];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light that grows by 10 a column from 0, in cells twice as wide as high, without the last cell.
    fn ramp() -> GridLight {
        let mut values: Vec<Option<f32>> = (0..40).map(|k| Some(10.0 * (k % 8) as f32)).collect();
        values[39] = None;
        GridLight { counts: [8, 5], steps: [2.0, 1.0], values }
    }

    #[test]
    fn light_is_linear_between_the_middles_of_cells() {
        let light = ramp();
        for (place, want) in [
            ([0.5, 0.5], Some(0.0)),
            ([0.0, 0.0], Some(0.0)),
            ([2.0, 2.3], Some(15.0)),
            ([7.5, 2.0], Some(70.0)),
            ([7.5, 4.5], None),
        ] {
            let found = light.at(place.into());
            assert_eq!(found.map(|v| (1e6 * v).round() / 1e6), want, "{place:?}");
        }
    }

    #[test]
    fn isolines_of_linear_light_are_exactly_straight_and_in_place() {
        // Light 3 x + 2 y in cells, without the cell at the right in the middle.
        let light_at = |x: f64, y: f64| 3.0 * x + 2.0 * y;
        let value = |k: usize| light_at((k % 6) as f64 + 0.5, (k / 6) as f64 + 0.5) as f32;
        let values = (0..30).map(|k| (k != 17).then(|| value(k))).collect();
        let light = GridLight { counts: [6, 5], steps: [1.0; 2], values };
        for parts in [[2, 2], [6, 4]] {
            let levels = [6.0, 12.0, 18.0];
            let mut lengths = [0.0; 3];
            light.isolines(&levels, parts, |level, piece| {
                // Beyond the outermost points and beside the hole the light is that of the nearest points.
                for end in piece.iter().filter(|end| end.x > 0.5 && end.x < 4.5 && end.y > 0.5 && end.y < 4.5)
                {
                    assert!((light_at(end.x, end.y) - levels[level]).abs() < 1e-5, "{end} at {level}");
                }
                lengths[level] += piece[0].distance(piece[1]);
            });
            // The first reaches from the left to the lower edge, the last from the hole to the upper edge.
            assert!(lengths.iter().all(|length| *length > 2.0), "{lengths:?}");
        }
    }

    #[test]
    fn isolines_around_a_lamp_are_round() {
        // Light of a lamp at the height of 3 cells above the middle of 21 x 21 cells, on the isoline with a radius of 5.
        let at = |radius: f64| 1e3 * (9.0 + radius * radius).powi(-2);
        let value = |k: usize| at(DVec2::new((k % 21) as f64 - 10.0, (k / 21) as f64 - 10.0).length()) as f32;
        let light = GridLight {
            counts: [21; 2],
            steps: [1.0; 2],
            values: (0..441).map(|k| Some(value(k))).collect(),
        };
        let mut length = 0.0;
        light.isolines(&[at(5.0)], [4; 2], |_, piece| {
            for end in piece {
                let radius = end.distance(DVec2::splat(10.5));
                // Linear light between points errs by up to an eighth of its curvature: 1/14 of its slope at this radius.
                assert!((radius - 5.0).abs() < 0.1, "radius {radius}");
            }
            length += piece[0].distance(piece[1]);
        });
        assert!((length / (10.0 * std::f64::consts::PI) - 1.0).abs() < 0.02, "length {length}");
    }

    #[test]
    fn isolines_are_drawn_where_the_light_has_their_value() {
        let light = ramp();
        let picture = light.picture("lx");
        let bands = Bands::of(light.values.iter().flatten().copied());
        // 800 pixels for 8 columns: the light 10 k is at 50 + 100 k.
        let row = &picture.pixels[(GAP + 100) * picture.width + GAP..][..800];
        for (k, limit) in bands.limits().iter().enumerate() {
            let middle = 50.0 + 10.0 * limit;
            let grey = if is_white(&bands, k) { 255 } else { 0 };
            let line: Vec<usize> = (0..800).filter(|&x| (x as f64 + 0.5 - middle).abs() < 0.6).collect();
            assert!(
                !line.is_empty() && line.iter().all(|&x| row[x].iter().all(|c| c.abs_diff(grey) < 60)),
                "{limit}"
            );
            // Beside it is the colour of the band.
            assert_eq!(row[middle as usize - 4], bands.colour(k));
            assert_eq!(row[middle as usize + 4], bands.colour(k + 1));
        }
        // The first row of cells is at the bottom, what was not measured is grey.
        let corner = |y: usize| picture.pixels[(GAP + y) * picture.width + GAP + 790];
        assert_eq!(corner(10), NO_SURFACE);
        assert_ne!(corner(240), NO_SURFACE);
        assert_eq!(picture.pixels.len(), picture.width * picture.height);
    }

    #[test]
    fn slim_and_fine_grids_have_pictures_of_bounded_size() {
        for counts in [[1, 1], [1, 9000], [9000, 1]] {
            let values = vec![Some(1.0); counts[0] * counts[1]];
            let picture = GridLight { counts, steps: [1.0; 2], values }.picture("W/m²");
            assert!(picture.width < 4200 && picture.height < 4200 && picture.png().is_ok());
        }
    }

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
        let mut strokes = LineCoverage::new([9, 9]);
        strokes.add([DVec2::new(4.5, -3.0), DVec2::new(4.5, 12.0)]);
        strokes.add([DVec2::new(4.5, 2.0), DVec2::new(4.5, 2.0)]);
        let mut picture = Picture { width: 11, height: 11, pixels: vec![[200; 3]; 121] };
        strokes.draw(&mut picture, [1, 1], 0);
        let row: Vec<u8> = picture.pixels[5 * 11..6 * 11].iter().map(|p| p[0]).collect();
        assert!(row[5] == 0 && row[3] == 200 && row[7] == 200, "{row:?}");
        assert!(row[4] == row[6] && (100..180).contains(&row[4]), "{row:?}");
    }
}
