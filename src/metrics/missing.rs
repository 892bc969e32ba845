//! Features of a reference that an approximation lacks. A feature size s promises that no feature of at least that size
//! is lost [SD95 sec 3.2].

use super::Image;
use crate::Result;
use crate::raster::{BitImage, Morphology, Opener};

/// Visible fractions that bound shadows: the core of a shadow and its middle. Lit regions use 1 minus these. Part of
/// the definition of the metric.
const LEVELS: [f32; 2] = [0.25, 0.5];
/// A feature is missing if the approximation's mean over a disc of the feature size is on the wrong side of the level
/// by more than this visible fraction: half of the range between a level of 0.5 and full light. Part of the definition
/// of the metric.
const MISSING_CONTRAST: f32 = 0.25;

/// Smallest feature that is looked for, texels: features of one or two texels are noise of their rays.
const MIN_FEATURE_TEXELS: f64 = 3.0;

/// Number of features, and how many of them are missing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Missing {
    /// Connected shadows of the reference, summed over both levels.
    pub shadows: usize,
    /// Shadows that the approximation lacks.
    pub missing_shadows: usize,
    /// Connected lit regions of the reference, summed over both levels.
    pub lights: usize,
    /// Lit regions that the approximation lacks.
    pub missing_lights: usize,
}

impl Missing {
    /// Number of all features.
    pub fn features(&self) -> usize {
        self.shadows + self.lights
    }

    /// Number of all missing features.
    pub fn missing(&self) -> usize {
        self.missing_shadows + self.missing_lights
    }
}

/// Finds the features of `reference` larger than `size` (diameter of the inscribed disc, scene units; at least three
/// texels) that `approximation` lacks. Both images hold visible fractions.
///
/// A shadow is a connected region of the reference below a level (1/4 or 1/2), opened by the size: the union of all
/// discs of that size that fit. The shadow is missing if the approximation's mean over any of these discs exceeds the
/// level by more than 1/4: a large shadow that has lost a part of that size counts as missing. Lit regions are treated
/// in the same way with inverted values. Regions that touch count as one.
///
/// # Errors
/// [`crate::Error::Argument`] if the images differ in columns or rows.
pub fn missing_features(reference: &Image, approximation: &Image, size: f64) -> Result<Missing> {
    reference.check_same_sides(approximation)?;
    let (width, height) = (reference.width(), reference.height());
    let mut found = Missing::default();
    for level in LEVELS {
        let dark = BitImage::from_fn(width, height, |x, y| reference.at(x, y) < level);
        let bright = BitImage::from_fn(width, height, |x, y| reference.at(x, y) > 1.0 - level);
        for (image, is_shadow) in [(dark, true), (bright, false)] {
            let mut opener = Opener::new(image, Morphology::Euclid);
            let pixels = (size / reference.texel()).max(MIN_FEATURE_TEXELS);
            let (opened, core) = (opener.open(pixels), opener.core(pixels));
            let disc = Disc::new(pixels);
            for region in regions(opened) {
                let centres = region.iter().filter(|&&(x, y)| core.get(x, y));
                let mut means = centres.map(|&centre| disc.mean(approximation, centre));
                if is_shadow {
                    found.shadows += 1;
                    found.missing_shadows += usize::from(means.any(|mean| mean > level + MISSING_CONTRAST));
                } else {
                    found.lights += 1;
                    found.missing_lights +=
                        usize::from(means.any(|mean| mean < 1.0 - level - MISSING_CONTRAST));
                }
            }
        }
    }
    Ok(found)
}

/// A disc of texels, row by row.
struct Disc {
    /// Half width of each row, from the middle row outwards.
    reach: Vec<usize>,
}

impl Disc {
    /// A disc with a diameter in texels; at least one texel.
    fn new(diameter: f64) -> Disc {
        let squared = (0.5 * diameter.max(0.0)).powi(2);
        let rows = squared.sqrt() as usize;
        Disc { reach: (0..=rows).map(|y| (squared - (y * y) as f64).max(0.0).sqrt() as usize).collect() }
    }

    /// Mean of an image over the disc around a texel; texels outside the image are ignored.
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

/// Texels of each region of an image, connected by four neighbours.
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
            // Steps to the left of column 0 or above row 0 wrap to numbers beyond the image.
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

    /// Two shadows of 10 texels and one of 3 on a lit wall; texels of 0.5 scene units.
    fn wall(second: f32) -> Image<'static> {
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
        // At 0.4 the second shadow is fainter but present; at 0.6 and 1.0 it is missing at one and at both levels.
        assert_eq!(found(0.4, 2.0).missing_shadows, 0);
        assert_eq!(found(0.6, 2.0).missing_shadows, 1);
        assert_eq!(found(1.0, 2.0).missing_shadows, 2);
        // Features smaller than the size are not counted.
        let large = found(1.0, 6.0);
        assert_eq!((large.shadows, large.missing()), (0, 0), "{large:?}");
        assert_eq!(missing_features(&reference, &wall(0.0), 0.0).expect("shapes").shadows, 6);
    }

    /// A shadow of 40 x 30 texels that loses a part of 12 x 12, a tenth of its area: its mean hardly changes, but a
    /// feature of 6 texels is lost. Noise and a lost rim are no features.
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
