//! Identities of the metric, and the shape of the paper's table 1.

use super::*;
use crate::metrics::{Features, norms};
use crate::raster::Morphology;
use proptest::prelude::*;

const MORPHOLOGIES: [Morphology; 3] = [Morphology::Euclid, Morphology::Paper8, Morphology::Paper4];

/// All combinations of the metric's options.
fn all_options() -> impl Iterator<Item = FbemOptions> {
    MORPHOLOGIES.into_iter().flat_map(|morphology| {
        [Features::Both, Features::Shadow].into_iter().flat_map(move |features| {
            [Filter::Whole, Filter::Unmasked].into_iter().map(move |filter| FbemOptions {
                filter,
                features: FeatureOptions { features, morphology, ..Default::default() },
                ..Default::default()
            })
        })
    })
}

fn image(w: usize, h: usize, seed: u64) -> Image<'static> {
    let value = |x: usize, y: usize| {
        let hash = (seed ^ ((x / 3 * 131 + y / 3 * 17) as u64)).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40;
        ((hash as f32) / (1 << 23) as f32).min(1.0)
    };
    Image::from_fn(w, h, 0.25, value).unwrap()
}

proptest! {
    #[test]
    fn size_zero_is_the_plain_norm_and_equal_images_have_no_error(
        w in 1usize..40, h in 1usize..40, seed: u64, other: u64, size in 0.0f64..5.0,
    ) {
        let (f, g) = (image(w, h, seed), image(w, h, other));
        for options in all_options() {
            prop_assert_eq!(fbem(&f, &g, &[0.0], &options).unwrap()[0].value, norms(&f, &g).unwrap().l2);
            prop_assert_eq!(fbem(&f, &f, &[size], &options).unwrap()[0].value, 0.0);
            let l1 = fbem(&f, &g, &[0.0], &FbemOptions { exponent: 1.0, ..options }).unwrap()[0].value;
            prop_assert!((l1 - norms(&f, &g).unwrap().l1).abs() < 1e-12);
        }
    }
}

#[test]
fn bad_arguments_are_refused() {
    let (f, g) = (image(8, 8, 1), image(8, 9, 1));
    assert!(fbem(&f, &g, &[0.0], &FbemOptions::default()).is_err());
    for size in [-1.0, f64::NAN, f64::INFINITY] {
        assert!(fbem(&f, &f, &[size], &Default::default()).is_err());
    }
    for exponent in [0.5, f64::NAN, f64::INFINITY] {
        assert!(fbem(&f, &f, &[0.0], &FbemOptions { exponent, ..Default::default() }).is_err());
    }
}

/// With `Filter::Unmasked` a wrong masked feature has no effect outside its mask.
#[test]
fn the_unmasked_filter_does_not_bleed() {
    let shadow = Image::from_fn(60, 60, 1.0, |x, y| if x < 30 && y < 30 { 0.0 } else { 1.0 }).unwrap();
    let nothing = Image::from_fn(60, 60, 1.0, |_, _| 1.0).unwrap();
    let features = FeatureOptions { features: Features::Shadow, ..Default::default() };
    let options = FbemOptions { features, ..Default::default() };
    let whole = fbem(&shadow, &nothing, &[10.0], &options).unwrap()[0];
    let unmasked =
        fbem(&shadow, &nothing, &[10.0], &FbemOptions { filter: Filter::Unmasked, ..options }).unwrap()[0];
    // The remaining error comes from the corners that the opening rounds off.
    assert!(unmasked.outside < 0.5 * whole.outside && unmasked.inside == whole.inside);
    assert!((whole.inside + whole.outside - whole.value.powi(2)).abs() < 1e-12);
}
