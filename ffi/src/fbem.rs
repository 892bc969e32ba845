//! The feature-based error metric of two images.

use super::arguments::{Span, check_apart, count_of, no_reserved, one_of, set, slice, slice_mut};
use super::entry::entry;
use super::guard::Outcome;
use super::record::record;
use mrvis::internals::memory;
use mrvis::metrics::{Fbem, FbemOptions, Features, Filter, Image, Morphology, fbem};

pub const MRV_FEATURES_BOTH: i32 = 0;
pub const MRV_FEATURES_SHADOW: i32 = 1;

pub const MRV_MORPHOLOGY_EUCLID: i32 = 0;
pub const MRV_MORPHOLOGY_PAPER8: i32 = 1;
pub const MRV_MORPHOLOGY_PAPER4: i32 = 2;

record!(80: struct mrv_fbem_images {
    struct_size: usize,
    reference: *const f32,
    approximation: *const f32,
    width: u64,
    height: u64,
    texel: f64,
    exponent: f64,
    white: f32,
    threshold: f32,
    features: i32,
    morphology: i32,
    unmasked_filter: i32,
    reserved: u32,
});

/// Bytes that the metric takes for each texel, at most: eight arrays of f64 (differences, weights, box sums and their steps) and two
/// distance transforms of both kinds of features with their orders, 16 bytes each.
const BYTES_PER_TEXEL: u64 = 8 * 8 + 4 * 16;

fn fbem_options(given: &mrv_fbem_images) -> Outcome<FbemOptions> {
    no_reserved(given.reserved, "images.reserved")?;
    let kinds = one_of!(
        "images.features",
        given.features,
        MRV_FEATURES_BOTH => Features::Both,
        MRV_FEATURES_SHADOW => Features::Shadow,
    );
    let morphology = one_of!(
        "images.morphology",
        given.morphology,
        MRV_MORPHOLOGY_EUCLID => Morphology::Euclid,
        MRV_MORPHOLOGY_PAPER8 => Morphology::Paper8,
        MRV_MORPHOLOGY_PAPER4 => Morphology::Paper4,
    );
    let mut options = FbemOptions::default();
    (options.features.features, options.features.morphology) = (kinds, morphology);
    set(&mut options.features.white, given.white);
    set(&mut options.features.threshold, given.threshold);
    if given.unmasked_filter != 0 {
        options.filter = Filter::Unmasked;
    }
    set(&mut options.exponent, given.exponent);
    Ok(options)
}

entry!(mrv_fbem(
    call, images: Record<mrv_fbem_images>, sizes: Pointer<f64>, count: usize, errors: MutPointer<f64>,
    masked: MutPointer<f64>
) {
    let options = fbem_options(&images)?;
    let (width, height) = (count_of(images.width), count_of(images.height));
    let texels = width.saturating_mul(height);
    check_apart(
        &[
            Span::of("images.reference", images.reference, texels),
            Span::of("images.approximation", images.approximation, texels),
            Span::of("sizes", sizes, count),
        ],
        &[Span::of("errors", errors, count), Span::of("masked", masked, count)],
    )?;
    // SAFETY: the caller gives images of `width * height` texels, and arrays of `count` entries.
    let (reference, approximation, sizes, errors) = unsafe {
        (
            slice(images.reference, texels, "images.reference")?,
            slice(images.approximation, texels, "images.approximation")?,
            slice(sizes, count, "sizes")?,
            slice_mut(errors, count, "errors")?,
        )
    };
    // SAFETY: as above.
    let masked = unsafe { slice_mut(masked, if masked.is_null() { 0 } else { count }, "masked") }?;
    let texel = if images.texel == 0.0 { 1.0 } else { images.texel };
    let [reference, approximation] =
        [("images.reference", reference), ("images.approximation", approximation)].map(
            |(name, texels)| Image::new(width, height, texel, texels).map_err(|error| error.of(name)),
        );
    memory::check_room(BYTES_PER_TEXEL * texels as u64, || format!("the errors of {texels} texels"))?;
    let found = fbem(&reference?, &approximation?, sizes, &options)?;
    let put =
        |out: &mut [f64], of: fn(&Fbem) -> f64| out.iter_mut().zip(&found).for_each(|(o, f)| *o = of(f));
    put(errors, |found| found.value);
    put(masked, |found| found.masked_fraction);
    Ok(())
});
