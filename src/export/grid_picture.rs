//! Light on a regular grid as a picture: false colours, isolines and a scale.

use super::false_colours::{Bands, NOTHING};
use super::lettering::{LINE, width, write};
use crate::image_io::Picture;
use crate::plot::number;

/// Pixels of the longer side of a grid: at least those of a screen, at most those of a large print.
const SIDE: [f64; 2] = [800.0, 4000.0];
/// Pixels around the grid and between the parts of the scale.
const GAP: usize = 12;
/// Width of the scale's colours, and least height of one, pixels.
const SWATCH: [usize; 2] = [28, 2 * LINE];

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
    /// The light at a place, in cells from the lower left corner: linear between the middles of cells; `None` in cells without light.
    fn at(&self, place: [f64; 2]) -> Option<f64> {
        let [columns, _] = self.counts;
        let value = |column: usize, row: usize| self.values[row * columns + column];
        let cell: [usize; 2] = std::array::from_fn(|k| (place[k] as usize).min(self.counts[k] - 1));
        value(cell[0], cell[1])?;
        let from: [f64; 2] =
            std::array::from_fn(|k| (place[k] - 0.5).clamp(0.0, (self.counts[k] - 1) as f64));
        let (mut sum, mut weights) = (0.0, 0.0);
        for corner in 0..4 {
            let step = [corner & 1, corner >> 1];
            let near: [usize; 2] =
                std::array::from_fn(|k| (from[k] as usize + step[k]).min(self.counts[k] - 1));
            let part = |k: usize| if step[k] == 0 { 1.0 - from[k].fract() } else { from[k].fract() };
            // Cells without light count for nothing; the own cell has a part of at least a quarter.
            if let Some(light) = value(near[0], near[1]) {
                sum += part(0) * part(1) * f64::from(light);
                weights += part(0) * part(1);
            }
        }
        Some(sum / weights)
    }

    /// The picture, with isolines at the limits of the colours, and their scale in `unit` on the right.
    pub fn picture(&self, unit: &str) -> Picture {
        let bands = Bands::of(self.values.iter().flatten().copied());
        let sides = [0, 1].map(|k| self.counts[k] as f64 * self.steps[k]);
        let longest = sides[0].max(sides[1]);
        let pixels = (self.counts[0].max(self.counts[1]) as f64).clamp(SIDE[0], SIDE[1]);
        let size = sides.map(|side| (pixels * side / longest).round().max(1.0) as usize);
        let band = |x: usize, y: usize| {
            let place = |at: usize, k: usize| (at as f64 + 0.5) / size[k] as f64 * self.counts[k] as f64;
            self.at([place(x, 0), place(size[1] - 1 - y, 1)]).map(|light| bands.band(light))
        };
        let mut picture = with_scale(&bands, size, unit);
        for y in 0..size[1] {
            let mut next: Vec<Option<usize>> = Vec::with_capacity(size[0]);
            next.extend((0..size[0]).map(|x| band(x, y)));
            for x in 0..size[0] {
                let beside = [next.get(x + 1).copied(), (y + 1 < size[1]).then(|| band(x, y + 1))];
                let is_line =
                    next[x].is_some_and(|own| beside.iter().flatten().flatten().any(|other| *other != own));
                let colour = match next[x] {
                    // White lines between dark colours, black ones between light ones.
                    Some(own) if is_line => [if own < bands.limits().len() / 2 { 255 } else { 0 }; 3],
                    Some(own) => bands.colour(own),
                    None => NOTHING,
                };
                picture.pixels[(y + GAP) * picture.width + x + GAP] = colour;
            }
        }
        picture
    }
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
        write(&mut picture, label, [left + SWATCH[0] + GAP / 2, border - LINE / 2 + 1]);
    }
    picture
}

/// A number in the characters that pictures have.
fn label(value: f64) -> String {
    let text = number(value);
    if text.is_ascii() { text } else { format!("{value:e}") }
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
            let found = light.at(place);
            assert_eq!(found.map(|v| (1e6 * v).round() / 1e6), want, "{place:?}");
        }
    }

    #[test]
    fn isolines_lie_where_the_light_has_their_value() {
        let light = ramp();
        let picture = light.picture("lx");
        let bands = Bands::of(light.values.iter().flatten().copied());
        // 800 pixels for 8 columns: the light 10 k is at 50 + 100 k.
        let row = &picture.pixels[(GAP + 100) * picture.width + GAP..][..800];
        let lines: Vec<usize> = (0..800).filter(|&x| row[x] == [0; 3] || row[x] == [255; 3]).collect();
        let want: Vec<f64> = bands.limits().iter().map(|limit| 50.0 + 10.0 * limit).collect();
        assert_eq!(lines.len(), want.len(), "{lines:?}");
        for (line, want) in lines.iter().zip(want) {
            assert!((*line as f64 - want).abs() < 1.5, "a line at {line} instead of {want}");
        }
        // The first row of cells is at the bottom, what was not measured is grey.
        let corner = |y: usize| picture.pixels[(GAP + y) * picture.width + GAP + 790];
        assert_eq!(corner(10), NOTHING);
        assert_ne!(corner(240), NOTHING);
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
}
