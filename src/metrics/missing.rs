//! Features that an approximation does not show at all: the promise of a feature size is that there are none of at
//! least that size [SD95 sec 3.2], method E.8.

use super::Image;
use crate::Result;
use crate::raster::{BitImage, Morphology, Opener};

/// Visible fractions below which there is shadow: deep and half. Lights mirror them.
const LEVELS: [f32; 2] = [0.25, 0.5];
/// A feature is missing if the approximation's mean over it lies on the wrong side of its level by more than this.
const CONTRAST: f32 = 0.25;

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

/// Looks for the features of `reference` of more than `size` (scene units, inscribed disc) in an approximation. Both
/// images hold visible fractions.
///
/// A shadow is a connected region, opened by the size, where the reference is below a level (1/4, 1/2); it is missing if
/// the approximation's mean over it is more than 1/4 above that level. Lights likewise, the other way round. Regions
/// that only touch a larger one count with it.
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
            let opened = Opener::new(image, Morphology::Euclid).open(size / reference.texel());
            for region in regions(opened) {
                let sum: f64 = region.iter().map(|&(x, y)| f64::from(approximation.at(x, y))).sum();
                let mean = (sum / region.len() as f64) as f32;
                if is_shadow {
                    found.shadows += 1;
                    found.missing_shadows += usize::from(mean > level + CONTRAST);
                } else {
                    found.lights += 1;
                    found.missing_lights += usize::from(mean < 1.0 - level - CONTRAST);
                }
            }
        }
    }
    Ok(found)
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
