//! Features that an approximation does not show at all: the promise of a feature size is that there are none of at
//! least that size [SD95 sec 3.2], method E.8.

use super::Image;
use crate::Result;
use crate::raster::{BitImage, Morphology, Opener};

/// Visible fractions below which there is shadow: deep and half. Lights mirror them.
const LEVELS: [f32; 2] = [0.25, 0.5];
/// A feature is missing where the approximation's mean over a disc of the size lies on the wrong side of its level by
/// more than this.
const CONTRAST: f32 = 0.25;

/// Texels across the smallest feature that an image can show: what one or two of them say is the noise of their rays.
const LEAST: f64 = 3.0;

/// How many features there are, and how many of them are missing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Missing {
    /// Connected shadows of the reference, at two levels of darkness.
    pub shadows: usize,
    /// Of these, those that the approximation lacks.
    pub missing_shadows: usize,
    /// Connected lit regions of the reference, at two levels.
    pub lights: usize,
    /// Of these, those that the approximation lacks.
    pub missing_lights: usize,
}

impl Missing {
    /// All features.
    pub fn features(&self) -> usize {
        self.shadows + self.lights
    }

    /// All missing features.
    pub fn missing(&self) -> usize {
        self.missing_shadows + self.missing_lights
    }
}

/// Looks for the features of `reference` of more than `size` (scene units, inscribed disc; three texels at least) in an
/// approximation. Both images hold visible fractions.
///
/// A shadow is a connected region, opened by the size, where the reference is below a level (1/4, 1/2): the union of all
/// discs of that size that fit. It is missing if over any of these discs the approximation's mean is more than 1/4 above
/// that level: a large shadow that has lost a part as large as the size lacks a feature, however much of it is left.
/// Lights likewise, the other way round. Regions that only touch a larger one count with it.
///
/// # Errors
/// [`crate::Error::Argument`] when the images differ in shape.
pub fn missing_features(reference: &Image, approximation: &Image, size: f64) -> Result<Missing> {
    reference.check_same_sides(approximation)?;
    let (width, height) = (reference.width(), reference.height());
    let mut found = Missing::default();
    for level in LEVELS {
        let dark = BitImage::from_fn(width, height, |x, y| reference.at(x, y) < level);
        let bright = BitImage::from_fn(width, height, |x, y| reference.at(x, y) > 1.0 - level);
        for (image, is_shadow) in [(dark, true), (bright, false)] {
            let mut opener = Opener::new(image, Morphology::Euclid);
            let pixels = (size / reference.texel()).max(LEAST);
            let (opened, core) = (opener.open(pixels), opener.core(pixels));
            let disc = Disc::new(pixels);
            for region in regions(opened) {
                let centres = region.iter().filter(|&&(x, y)| core.get(x, y));
                let mut means = centres.map(|&centre| disc.mean(approximation, centre));
                if is_shadow {
                    found.shadows += 1;
                    found.missing_shadows += usize::from(means.any(|mean| mean > level + CONTRAST));
                } else {
                    found.lights += 1;
                    found.missing_lights += usize::from(means.any(|mean| mean < 1.0 - level - CONTRAST));
                }
            }
        }
    }
    Ok(found)
}

/// A disc of texels, row by row.
struct Disc {
    /// How far each row reaches to either side, from the middle row downwards and upwards.
    reach: Vec<usize>,
}

impl Disc {
    /// Of a diameter in texels; of one texel at least.
    fn new(diameter: f64) -> Disc {
        let squared = (0.5 * diameter.max(0.0)).powi(2);
        let rows = squared.sqrt() as usize;
        Disc { reach: (0..=rows).map(|y| (squared - (y * y) as f64).max(0.0).sqrt() as usize).collect() }
    }

    /// The mean of an image over the disc around a texel; what lies outside the image does not count.
    fn mean(&self, image: &Image, (x, y): (usize, usize)) -> f32 {
        let (mut sum, mut count) = (0.0f64, 0);
        let last = self.reach.len() - 1;
        for row in y.saturating_sub(last)..(y + last + 1).min(image.height()) {
            let reach = self.reach[row.abs_diff(y)];
            for column in x.saturating_sub(reach)..(x + reach + 1).min(image.width()) {
                sum += f64::from(image.at(column, row));
                count += 1;
            }
        }
        (sum / f64::from(count)) as f32
    }
}

/// The texels of each connected region (of four neighbours) of an image.
fn regions(mut left: BitImage) -> Vec<Vec<(usize, usize)>> {
    let (width, height) = (left.width(), left.height());
    let mut regions = Vec::new();
    for start in (0..width * height).map(|i| (i % width, i / width)) {
        if !left.get(start.0, start.1) {
            continue;
        }
        left.set(start.0, start.1, false);
        let mut region = vec![start];
        let mut next = 0;
        while let Some(&(x, y)) = region.get(next) {
            next += 1;
            // Steps off the image wrap to numbers beyond it.
            for (x, y) in [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)] {
                if x < width && y < height && left.get(x, y) {
                    left.set(x, y, false);
                    region.push((x, y));
                }
            }
        }
        regions.push(region);
    }
    regions
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two shadows of 10 texels, one of 3, in the light; texels of 0.5.
    fn wall(second: f32) -> Image {
        Image::from_fn(64, 48, 0.5, |x, y| match (x, y) {
            (10..20, 10..20) => 0.0,
            (30..40, 10..20) => second,
            (50..53, 30..33) => 0.0,
            _ => 1.0,
        })
        .expect("image")
    }

    #[test]
    fn a_shadow_that_is_averaged_away_is_missed() {
        let reference = wall(0.0);
        let found = |second, size| missing_features(&reference, &wall(second), size).expect("shapes");
        assert_eq!(found(0.0, 2.0), Missing { shadows: 4, lights: 2, ..Missing::default() });
        // Fainter than the quarter and the half, but there; gone at last.
        assert_eq!(found(0.4, 2.0).missing_shadows, 0);
        assert_eq!(found(0.6, 2.0).missing_shadows, 1);
        assert_eq!(found(1.0, 2.0).missing_shadows, 2);
        // The promise is about features larger than the size.
        let large = found(1.0, 6.0);
        assert_eq!((large.shadows, large.missing()), (0, 0), "{large:?}");
        assert_eq!(missing_features(&reference, &wall(0.0), 0.0).expect("shapes").shadows, 6);
    }

    /// A shadow of 40 by 30 texels that loses a part of 12 by 12, a tenth: its mean hardly changes, but a feature of 6
    /// texels is gone. Noise and a rim that is lost all around are no features.
    #[test]
    fn a_part_of_a_large_shadow_that_is_lost_is_missed() {
        let shadow = |lost: &dyn Fn(usize, usize) -> f32| {
            Image::from_fn(64, 48, 1.0, |x, y| match (x, y) {
                (10..50, 10..40) => lost(x, y),
                _ => 1.0,
            })
            .expect("image")
        };
        let reference = shadow(&|_, _| 0.0);
        let found = |lost: &dyn Fn(usize, usize) -> f32, size| {
            missing_features(&reference, &shadow(lost), size).expect("shapes").missing_shadows
        };
        let part = |x, y| if (20..32).contains(&x) && (20..32).contains(&y) { 1.0 } else { 0.0 };
        assert_eq!((found(&part, 6.0), found(&part, 20.0)), (2, 0));
        let noise = |x, y| if (7 * x + 5 * y) % 4 == 0 { 1.0 } else { 0.0 };
        assert_eq!(found(&noise, 6.0), 0);
        let rim = |x: usize, y: usize| if x < 12 || y < 12 || x > 47 || y > 37 { 1.0 } else { 0.0 };
        assert_eq!(found(&rim, 8.0), 0);
    }

    #[test]
    fn discs_have_the_texels_of_the_opening() {
        let disc = Disc::new(6.0);
        assert_eq!(disc.reach, [3, 2, 2, 0]);
        let ramp = Image::from_fn(9, 9, 1.0, |x, y| (x + y) as f32).expect("image");
        assert_eq!(disc.mean(&ramp, (4, 4)), 8.0);
        assert_eq!((Disc::new(0.0).mean(&ramp, (0, 8)), Disc::new(f64::NAN).mean(&ramp, (2, 1))), (8.0, 3.0));
    }

    #[test]
    fn a_gap_that_is_closed_is_missed() {
        let gap = |v: f32| {
            Image::from_fn(40, 40, 1.0, |x, _| if (18..24).contains(&x) { v } else { 0.0 }).expect("image")
        };
        let found = missing_features(&gap(1.0), &gap(0.1), 4.0).expect("shapes");
        assert_eq!((found.lights, found.missing_lights), (2, 2), "{found:?}");
        assert_eq!(missing_features(&gap(1.0), &gap(1.0), 4.0).expect("shapes").missing(), 0);
    }

    #[test]
    fn images_of_other_shapes_are_errors() {
        let other = Image::from_fn(4, 4, 1.0, |_, _| 0.0).expect("image");
        assert!(missing_features(&wall(0.0), &other, 1.0).is_err());
    }
}
