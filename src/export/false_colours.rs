//! Irradiance in bands of colour, with a scale.

use crate::image_io::{Picture, false_colour};
use crate::plot::number;
use maud::{Markup, html};

/// Largest number of limits between bands: more colours are hard to tell apart.
const MAX_LIMITS: usize = 9;
/// Ratio of the brightest to the darkest light above which the bands are logarithmic: of ten equal bands, the lowest would span more
/// than a factor of 2.
const LOG_RATIO: f64 = 20.0;
/// Largest fractions of the pixels that are darker than the first limit, and brighter than the last: a few pixels in corners and next
/// to lamps would otherwise stretch all bands.
const CLIPPED_FRACTIONS: [f64; 2] = [0.03, 0.005];
/// Colour of pixels without a surface.
pub(super) const NO_SURFACE: [u8; 3] = [128; 3];

/// Width of the strips of a hatching, pixels: wide enough to be seen in a picture that is shown at half its size.
const STRIP: usize = 4;

/// Colour of a pixel of a surface that emits, in column and row: black and white strips, unlike all bands.
pub(super) fn hatched([column, row]: [usize; 2]) -> [u8; 3] {
    if ((column + row) / STRIP).is_multiple_of(2) { [255; 3] } else { [40; 3] }
}

/// Bands of values between round limits.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Bands {
    /// Ascending; the first band is below the first limit, the last above the last.
    limits: Vec<f64>,
}

impl Bands {
    /// Bands for light like `values`.
    pub(super) fn of(values: impl Iterator<Item = f32>) -> Bands {
        let mut values: Vec<f64> = values.map(f64::from).filter(|v| v.is_finite() && *v > 0.0).collect();
        values.sort_by(f64::total_cmp);
        let last = values.len().saturating_sub(1);
        let at = |part: f64| values.get((part * last as f64) as usize).copied().unwrap_or(1.0);
        let [low, high] = [at(CLIPPED_FRACTIONS[0]), at(1.0 - CLIPPED_FRACTIONS[1])];
        let limits = if high > LOG_RATIO * low { logarithmic(low, high) } else { linear(low, high) };
        Bands { limits }
    }

    /// The limits between bands, ascending.
    pub(super) fn limits(&self) -> &[f64] {
        &self.limits
    }

    /// Index of the band of a value, from 0 to the number of limits.
    pub(super) fn band(&self, value: f64) -> usize {
        self.limits.partition_point(|&limit| limit <= value)
    }

    pub(super) fn colour(&self, band: usize) -> [u8; 3] {
        false_colour(band as f32 / self.limits.len().max(1) as f32)
    }

    /// The picture of values, row by row.
    pub(super) fn picture(&self, width: usize, values: &[Option<f32>]) -> Picture {
        let pixel = |value: &Option<f32>| value.map_or(NO_SURFACE, |v| self.colour(self.band(f64::from(v))));
        let pixels: Vec<[u8; 3]> = values.iter().map(pixel).collect();
        Picture { width, height: pixels.len() / width.max(1), pixels }
    }

    /// The colours with their ranges, below a heading; the hatching of emitters if they are seen.
    pub(super) fn legend(&self, heading: &str, with_emitters: bool) -> Markup {
        let range = |band: usize| {
            let limit = |k: usize| number(self.limits[k]);
            match band {
                0 => format!("below {}", limit(0)),
                k if k == self.limits.len() => format!("above {}", limit(k - 1)),
                k => format!("{} to {}", limit(k - 1), limit(k)),
            }
        };
        html! {
            p.note { (heading) }
            div.bands {
                @for band in 0..=self.limits.len() {
                    div { (swatch(self.colour(band))) span { (range(band)) } }
                }
                div { (swatch(NO_SURFACE)) span { "no surface" } }
                @if with_emitters { div { span.swatch.emitter {} span { "emits light" } } }
            }
        }
    }
}

fn swatch([r, g, b]: [u8; 3]) -> Markup {
    html! { span.swatch style=(format!("background:rgb({r},{g},{b})")) {} }
}

/// Multiples of a round step from `low` to `high`.
fn linear(low: f64, high: f64) -> Vec<f64> {
    let span = if high > low { high - low } else { high };
    let wish = span / (MAX_LIMITS - 1) as f64;
    let power = 10f64.powf(wish.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= wish).unwrap_or(wish);
    let first = (low / step).ceil().max(1.0);
    let limits =
        (0..MAX_LIMITS).map(|k| (first + k as f64) * step).take_while(|v| *v <= high.max(first * step));
    limits.collect()
}

/// 1, 2 and 5 times powers of ten from `low` to `high`; without 2 or without 2 and 5 if that is too many.
fn logarithmic(low: f64, high: f64) -> Vec<f64> {
    let powers = low.log10().floor() as i32..=high.log10().ceil() as i32;
    for mantissas in [&[1.0, 2.0, 5.0][..], &[1.0, 3.0], &[1.0]] {
        let limits = powers.clone().flat_map(|p| mantissas.iter().map(move |m| m * 10f64.powi(p)));
        let limits: Vec<f64> = limits.filter(|v| *v >= low && *v <= high).collect();
        if limits.len() <= MAX_LIMITS {
            return limits;
        }
    }
    // Many decades: the brightest of them.
    (0..MAX_LIMITS as i32).rev().map(|k| 10f64.powi(high.log10().floor() as i32 - k)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_round_and_few() {
        assert_eq!(linear(3.0, 17.0), [4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0]);
        assert_eq!(logarithmic(0.3, 40.0), [0.5, 1.0, 2.0, 5.0, 10.0, 20.0]);
        for (low, high) in [(1e-12, 1e9), (0.02, 900.0), (5.0, 5.0), (1.0, 19.9)] {
            let bands = Bands::of([low as f32, high as f32].repeat(50).into_iter());
            let limits = &bands.limits;
            assert!((1..=MAX_LIMITS).contains(&limits.len()), "{low} {high}: {limits:?}");
            assert!(limits.windows(2).all(|w| w[0] < w[1]));
        }
        assert!(!Bands::of(std::iter::empty()).limits.is_empty());
    }

    #[test]
    fn brighter_light_has_a_lighter_colour() {
        let bands = Bands::of((1..200).map(|k| k as f32));
        let picture = bands.picture(3, &[Some(1.0), Some(199.0), None]);
        let [dark, bright, nothing] = picture.pixels[..] else { panic!("three pixels") };
        assert_eq!((dark, bright, nothing), (false_colour(0.0), false_colour(1.0), NO_SURFACE));
        assert_eq!(bands.band(0.0), 0);
        assert_eq!(bands.band(1e9), bands.limits.len());
    }
}
