//! Feature-based error metric (FBEM) [SD95 sec 2.2]; docs/method.md, Feature-based error.

use super::Image;
use super::features::{FeatureOptions, FeatureSet};
use super::filter::box_filter;
use super::norms::{difference, power};
use crate::raster::BitImage;
use crate::{Error, Result};

/// Support of the box averages outside the feature mask.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Filter {
    /// The whole box, features included, as in the paper's formula. The error of a large feature then also counts,
    /// averaged, up to s/2 outside the feature.
    #[default]
    Whole,
    /// The unmasked texels of the box. (A variant of ours.)
    Unmasked,
}

options! {
    /// Options of the metric: [`FbemOptions::default`] with other values of some fields.
    #[derive(Clone, Copy, Debug, PartialEq)]
    #[non_exhaustive]
    pub struct FbemOptions {
        /// Exponent p of the norm; 2 in the paper.
        pub exponent: f64 = 2.0, in 1.0.., "the exponent of a norm";
        /// Definition of features.
        pub features: FeatureOptions = FeatureOptions::default();
        /// Support of the box averages outside the mask; default [`Filter::Whole`].
        pub filter: Filter = Filter::Whole;
    }
}

/// Result of [`fbem`]: the error of an image relative to features larger than `size`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Fbem {
    /// Feature size s, scene units.
    pub size: f64,
    /// The metric, in the units of the image values: for p = 2 a root mean square over the image.
    pub value: f64,
    /// Fraction of the image, in `[0, 1]`, inside features larger than s, where texels are compared one by one.
    pub masked_fraction: f64,
    /// Contribution of the mask to `value`^p, as a mean over the whole image.
    pub inside: f64,
    /// Contribution of the averages outside the mask to `value`^p, as a mean over the whole image.
    pub outside: f64,
}

/// [`fbem`] for one feature size, with default options.
#[cfg(feature = "reports")]
pub(crate) fn fbem_at(reference: &Image, approximation: &Image, size: f64) -> Result<Fbem> {
    Ok(fbem(reference, approximation, &[size], &FbemOptions::default())?[0])
}

/// ‖f̂ − f‖ₚˢ of [SD95 sec 2.2], divided by the area, for each feature size s of `sizes` (scene units, at least 0): texels of features
/// larger than s in the reference are compared one by one, averages over boxes of side s elsewhere. Several sizes are the error spectrum.
///
/// For s = 0 the result equals the ordinary norm bit by bit; for equal images it is 0. The result usually decreases
/// with s, but not always: the mask changes with s.
///
/// # Errors
/// [`Error::Argument`] if the images differ in columns or rows, or an option or a size is out of its range.
pub fn fbem(
    reference: &Image,
    approximation: &Image,
    sizes: &[f64],
    options: &FbemOptions,
) -> Result<Vec<Fbem>> {
    options.check_ranges()?;
    if let Some(size) = sizes.iter().find(|s| !(s.is_finite() && **s >= 0.0)) {
        return Err(Error::argument("sizes", size, "a feature size is a length of at least 0"));
    }
    let differences = difference(reference, approximation)?;
    let mut features = FeatureSet::new(reference, &options.features)?;
    let measure = |&size: &f64| {
        let mask = features.mask(size);
        let averages = averages(&differences, &mask, size / reference.texel(), options.filter);
        norm(&differences, &averages, &mask, size, options.exponent)
    };
    Ok(sizes.iter().map(measure).collect())
}

/// Feature sizes (scene units) for a spectrum of this image: 0, then `steps` sizes in geometric progression from one
/// texel to half of the shorter side.
pub fn spectrum_sizes(image: &Image, steps: usize) -> Vec<f64> {
    let largest = (image.width().min(image.height()) as f64 / 2.0).max(1.0);
    let at = |i: usize| image.texel() * largest.powf(i as f64 / (steps.max(2) - 1) as f64);
    std::iter::once(0.0).chain((0..steps).map(at)).collect()
}

/// Box averages of the differences. Filtering is linear, so the difference of two filtered images is the filtered
/// difference. `size` is in texels.
fn averages(differences: &[f64], mask: &BitImage, size: f64, filter: Filter) -> Vec<f64> {
    let width = mask.width();
    if filter == Filter::Whole || size <= 1.0 {
        return box_filter(differences, width, size);
    }
    let unmasked = |i: usize| if mask.get(i % width, i / width) { 0.0 } else { 1.0 };
    let weights: Vec<f64> = (0..differences.len()).map(unmasked).collect();
    let weighted: Vec<f64> = differences.iter().zip(&weights).map(|(d, w)| d * w).collect();
    let (sums, weights) = (box_filter(&weighted, width, size), box_filter(&weights, width, size));
    // The box around an unmasked texel contains the texel; averages at masked texels are not used.
    sums.iter().zip(&weights).map(|(s, w)| if *w > 1e-12 { s / w } else { 0.0 }).collect()
}

/// The p-norm over differences inside the mask and averages outside.
fn norm(differences: &[f64], averages: &[f64], mask: &BitImage, size: f64, p: f64) -> Fbem {
    let (mut total, mut inside) = (0.0, 0.0);
    let width = mask.width();
    for (i, (&d, &average)) in differences.iter().zip(averages).enumerate() {
        let masked = mask.get(i % width, i / width);
        let term = power(if masked { d } else { average }, p);
        // One running sum in the order of the plain norm: at s = 0 both agree to the last bit.
        total += term;
        if masked {
            inside += term;
        }
    }
    let n = differences.len() as f64;
    let mean = total / n;
    Fbem {
        size,
        value: if p == 2.0 { mean.sqrt() } else { mean.powf(1.0 / p) },
        masked_fraction: mask.count() as f64 / n,
        inside: inside / n,
        outside: (total - inside).max(0.0) / n,
    }
}

#[cfg(test)]
mod tests;
