//! The feature-based error metric.

use crate::arguments::{arguments, set_keywords, word};
use crate::arrays::image;
use crate::errors::Raise;
use crate::solution::class;
use crate::work::long;
use mrvis::metrics::{FbemOptions, Features, Filter, Image, Morphology};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

const FEATURES: [(&str, Features); 2] = [("both", Features::Both), ("shadow", Features::Shadow)];
const FILTERS: [(&str, Filter); 2] = [("whole", Filter::Whole), ("unmasked", Filter::Unmasked)];
const MORPHOLOGIES: [(&str, Morphology); 3] =
    [("euclid", Morphology::Euclid), ("paper8", Morphology::Paper8), ("paper4", Morphology::Paper4)];

arguments! {
    Features: |name, given| word(name, given, &FEATURES);
    Filter: |name, given| word(name, given, &FILTERS);
    Morphology: |name, given| word(name, given, &MORPHOLOGIES);
}

struct Options {
    fbem: FbemOptions,
    texel: f64,
}

fn options(function: &str, given: Option<&Bound<'_, PyDict>>) -> PyResult<Options> {
    let (mut fbem, mut texel) = (FbemOptions::default(), 1.0);
    set_keywords! {
        fbem, function, given, texel => texel, exponent, filter, features => fbem.features.features,
        morphology => fbem.features.morphology, white => fbem.features.white,
        threshold => fbem.features.threshold
    }
    Ok(Options { fbem, texel })
}

/// Errors of the approximation for each size.
fn measured<'py>(
    reference: &Bound<'py, PyAny>,
    approximation: &Bound<'py, PyAny>,
    sizes: &[f64],
    options: Options,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let py = reference.py();
    let images = [("reference", reference), ("approximation", approximation)];
    let mut pixels = Vec::new();
    for (name, given) in images {
        let (width, height, data) = image(name, given)?;
        let checked = Image::new(width, height, options.texel, data);
        pixels.push(checked.map_err(|error| error.of(name)).raise(py)?);
    }
    let sizes = sizes.to_vec();
    let found = long(py, None, move |_| mrvis::metrics::fbem(&pixels[0], &pixels[1], &sizes, &options.fbem))?;
    let class = class(py, "Fbem")?;
    let made = found.iter().map(|f| class.call1((f.size, f.value, f.masked_fraction, f.inside, f.outside)));
    made.collect()
}

/// The feature-based error of an image (Sillion and Drettakis 1995), as an `Fbem`: features larger than `size` (scene units) are compared
/// texel by texel, averages over boxes of that side elsewhere.
///
/// reference, approximation: (rows, columns), copied as float32, finite. texel: side of a texel, scene units, default 1. exponent: of the
/// norm, at least 1, default 2. features: "both" (default) or "shadow". filter: "whole" (default) or "unmasked". morphology: "euclid"
/// (default), "paper8" or "paper4". white: value of an unoccluded texel, default 1. threshold: darkening that counts as shadow, default
/// 0.02.
#[pyfunction]
#[pyo3(signature = (reference, approximation, size=0.0, **options))]
pub fn fbem<'py>(
    reference: &Bound<'py, PyAny>,
    approximation: &Bound<'py, PyAny>,
    size: f64,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let options = self::options("fbem", options)?;
    Ok(measured(reference, approximation, &[size], options)?.remove(0))
}

/// `fbem` for each of `sizes` (scene units), as a list of `Fbem`: the error by feature size. Options are those of `fbem`.
#[pyfunction]
#[pyo3(signature = (reference, approximation, sizes, **options))]
pub fn fbem_spectrum<'py>(
    reference: &Bound<'py, PyAny>,
    approximation: &Bound<'py, PyAny>,
    sizes: Vec<f64>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyList>> {
    let options = self::options("fbem_spectrum", options)?;
    PyList::new(reference.py(), measured(reference, approximation, &sizes, options)?)
}
