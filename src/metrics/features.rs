//! Feature masks: texels that belong to shadows or lit regions of at least a given size [SD95 sec 2.4].

use super::Image;
use crate::Result;
use crate::raster::{BitImage, Morphology, Opener};

/// Kinds of regions that count as features.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Features {
    /// Shadows and lit regions: the error of visibility v(1 − v) is symmetric in light and shadow [SD95 sec 3.2].
    #[default]
    Both,
    /// Shadows only, as in the metric of the paper [SD95 sec 2.2, 2.4].
    Shadow,
}

options! {
    /// Definition of features: [`FeatureOptions::default`] with other values of some fields.
    #[derive(Clone, Copy, Debug, PartialEq)]
    #[non_exhaustive]
    pub struct FeatureOptions {
        /// Kinds of regions; default [`Features::Both`].
        pub features: Features = Features::Both;
        /// Measure of sizes; default [`Morphology::Euclid`].
        pub morphology: Morphology = Morphology::Euclid;
        /// Value of an unoccluded texel, in the image's units; 1 for visible fractions.
        pub white: f32 = 1.0, above 0.0, "the value of an unoccluded texel";
        /// A texel is in shadow if its value is less than (1 − threshold) · white; dimensionless. 2 % exclude the faint rim of penumbrae;
        /// unoccluded texels have visibility exactly 1, so noise does not exceed that there.
        pub threshold: f32 = 0.02, in 0.0..1.0, "a relative darkening";
    }
}

/// The features of one image, prepared for masks of many sizes.
///
/// Texels outside the image are neither shadowed nor lit: a feature at the border is measured by its visible fraction.
#[derive(Clone, Debug)]
pub struct FeatureSet {
    texel: f64,
    shadow: Opener,
    lit: Option<Opener>,
}

impl FeatureSet {
    /// Finds the shadowed and lit texels of `reference` and their distances to the region's outline.
    ///
    /// # Errors
    /// [`Error::Argument`] if an option is out of its range.
    pub fn new(reference: &Image, options: &FeatureOptions) -> Result<FeatureSet> {
        options.check_ranges()?;
        let limit = (1.0 - options.threshold) * options.white;
        let shadow =
            BitImage::from_fn(reference.width(), reference.height(), |x, y| reference.at(x, y) < limit);
        let lit = (options.features == Features::Both)
            .then(|| Opener::new(shadow.complement(), options.morphology));
        Ok(FeatureSet { texel: reference.texel(), shadow: Opener::new(shadow, options.morphology), lit })
    }

    /// Feature mask F^s of [SD95 sec 2.2]: texels of features larger than `size` (scene units). At size 0 all texels
    /// that are shadowed, or lit if lit regions count. Negative sizes and NaN count as 0.
    pub fn mask(&mut self, size: f64) -> BitImage {
        let mut mask = self.shadow.open(size / self.texel);
        if let Some(lit) = &mut self.lit {
            mask.unite(&lit.open(size / self.texel));
        }
        mask
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall with a shadow of 10 texels and one of 4; texels of 0.5 scene units.
    fn wall() -> Image<'static> {
        Image::from_fn(64, 64, 0.5, |x, y| match (x, y) {
            (10..20, 10..20) => 0.0,
            (40..44, 40..44) => 0.5,
            _ => 0.99,
        })
        .unwrap()
    }

    #[test]
    fn sizes_are_in_scene_units() {
        let shadow = FeatureOptions { features: Features::Shadow, ..Default::default() };
        let mut set = FeatureSet::new(&wall(), &shadow).unwrap();
        let count = |set: &mut FeatureSet, s| set.mask(s).count();
        assert_eq!(count(&mut set, 0.0), 116);
        assert!(count(&mut set, 1.9) > 100);
        assert!((80..=100).contains(&count(&mut set, 2.1)), "the small shadow of 2 units is gone");
        assert_eq!(count(&mut set, 5.1), 0);
    }

    #[test]
    fn lit_regions_join_the_mask() {
        let mut set = FeatureSet::new(&wall(), &FeatureOptions::default()).unwrap();
        assert_eq!(set.mask(0.0).count(), 64 * 64);
        assert!(!set.mask(2.1).get(41, 41));
        assert!(set.mask(2.1).get(60, 60));
        assert_eq!(set.mask(100.0).count(), 0);
    }

    #[test]
    fn options_are_checked() {
        for (white, threshold) in [(0.0, 0.1), (f32::NAN, 0.1), (1.0, 1.0), (1.0, -0.1), (1.0, f32::NAN)] {
            let options = FeatureOptions { white, threshold, ..Default::default() };
            assert!(FeatureSet::new(&wall(), &options).is_err());
        }
    }
}
