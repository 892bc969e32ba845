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

/// 128 x 128 texels with square shadows of one size at random places; a quarter of the area or a little more is
/// covered.
fn shadows(side: usize) -> Image<'static> {
    let mut state = 7 + side as u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % below
    };
    let mut shadow = BitImage::new(128, 128);
    while shadow.count() < 128 * 128 / 4 {
        let (left, top) = (random(128 - side), random(128 - side));
        // Adjacent shadows are kept apart: they would join to larger features.
        let reach = |v: usize| v.saturating_sub(1)..(v + side + 1).min(128);
        let mut candidate = shadow.clone();
        let free = side > 20 || reach(top).all(|y| reach(left).all(|x| !shadow.get(x, y)));
        if free {
            (top..top + side).for_each(|y| candidate.set_span(y, left, left + side));
            shadow = candidate;
        }
    }
    Image::from_fn(128, 128, 1.0, |x, y| f32::from(!shadow.get(x, y))).unwrap()
}

/// The image on a mesh of 4 x 4 elements, each with its mean value.
fn coarse(image: &Image) -> Image<'static> {
    let cell = 32;
    let mean = |cx: usize, cy: usize| {
        let texels = (0..cell * cell).map(|i| image.at(cx * cell + i % cell, cy * cell + i / cell));
        texels.sum::<f32>() / (cell * cell) as f32
    };
    Image::from_fn(128, 128, 1.0, |x, y| mean(x / cell, y / cell)).unwrap()
}

/// A small version of [SD95 sec 2.3, table 1]: the order by cube size and the decrease, not the numbers.
#[test]
fn table_1_orders_by_cube_size_and_falls_off() {
    let sizes = [5.0, 16.0, 24.0, 30.0, 40.0];
    for morphology in MORPHOLOGIES {
        let features = FeatureOptions { morphology, features: Features::Shadow, ..Default::default() };
        let options = FbemOptions { features, ..Default::default() };
        let group = |side: usize| -> Vec<f64> {
            let reference = shadows(side);
            let rows = fbem(&reference, &coarse(&reference), &sizes, &options).unwrap();
            rows.iter().map(|row| 100.0 * row.value).collect()
        };
        let table = [4, 8, 15, 30].map(group);
        let report = || format!("{morphology:?} {table:.1?}");
        // From feature size 16 on, larger cubes have larger errors.
        for row in 1..sizes.len() {
            assert!(table.windows(2).all(|pair| pair[0][row] < pair[1][row] + 1.0), "{}", report());
        }
        for group in &table {
            assert!(group.windows(2).all(|pair| pair[1] < pair[0] + 0.5), "{}", report());
            assert!(group[4] < 0.55 * group[0], "{}", report());
        }
        // Small cubes decrease first: at 16 the smallest have lost half of their error, the largest hardly any.
        assert!(table[0][1] < 0.5 * table[3][1] && table[3][1] > 0.8 * table[3][0], "{}", report());
    }
}
