//! Errors of the crate as exceptions of `mrvis._types`, and words of the crate as words of the package.

use pyo3::PyErrArguments;
use pyo3::prelude::*;
use pyo3::types::PyType;
use std::any::Any;

/// Names in messages of the crate, and what stands for them in the package.
const WORDS: [(&str, &str); 16] = [
    ("`Detail::Optics`", "`detail=\"optics\"`"),
    ("`Detail::Clusters`", "`detail=\"clusters\"`"),
    ("`Detail::Rays`", "`detail=\"rays\"`"),
    ("`Scene::flattened`", "`Scene.flattened()`"),
    ("the engine `MultiResolution`", "the engine `mr`"),
    ("the engine `Average`", "the engine `average`"),
    ("`feature_sizes`[0]", "`feature_size`"),
    ("`feature_sizes`", "`feature_size`"),
    ("`emitter_sizes`", "`emitter_size`"),
    ("`face_materials`", "`material`"),
    ("`to_source`", "`source`"),
    // The package has no such option.
    (", or raise option `max_memory`", ""),
    (" or raise option `max_memory`", ""),
    ("option `emitters`", "`emitters` to where the scene is made,"),
    ("option `two_sided_emission`", "`two_sided_emission=True` where the scene is made"),
    ("option `", "`"),
];

/// How messages of the crate begin that describe an argument, and how they then name it.
const BEGINNINGS: [(&str, &str); 9] = [
    ("feature size ", "`feature_sizes` "),
    ("the feature size ", "`size` "),
    ("the exponent ", "`exponent` "),
    ("the unoccluded value ", "`white` "),
    ("the shadow threshold ", "`threshold` "),
    ("the texel size ", "`texel` "),
    ("no scene is called ", "`name`: no scene is called "),
    ("receiver ", "`receivers`: "),
    ("emitter ", "`emitters`: "),
];

/// Options that the crate names by their fields in front of their values, as in `max_links 0: must lie in 1..100`.
const FIELDS: [&str; 12] = [
    "audit",
    "error",
    "feature_size",
    "max_links",
    "max_seconds",
    "min_area",
    "points",
    "rays",
    "reference_rays",
    "seed",
    "target_error",
    "threads",
];

/// A message of the crate in words of the package.
fn in_words(text: String) -> String {
    // Changes of instances are arguments of several methods; the message goes on with the number of the instance.
    let changed = text.strip_prefix("`changes`[").and_then(|rest| rest.split_once("]: "));
    let text = changed.map(|(_, what)| what.to_owned()).unwrap_or(text);
    let mut text = WORDS.iter().fold(text, |text, (from, to)| text.replace(from, to));
    let mut words = text.split([' ', ':']);
    if let (Some(field), Some(value)) = (words.next(), words.next())
        && FIELDS.contains(&field)
        && value.parse::<f64>().is_ok()
    {
        text = format!("`{field}`{}", &text[field.len()..]);
        text = text.replace("and rays ", "and `rays` ").replace("with rays ", "with `rays` ");
    }
    match BEGINNINGS.iter().find(|(from, _)| text.starts_with(from)) {
        Some((from, to)) => format!("{to}{}", &text[from.len()..]),
        None => text,
    }
}

/// An exception of `mrvis._types`.
fn exception(py: Python<'_>, class: &str, arguments: impl PyErrArguments + 'static) -> PyErr {
    let found = py.import("mrvis._types").and_then(|types| types.getattr(class));
    match found.and_then(|class| Ok(class.cast_into::<PyType>()?)) {
        Ok(class) => PyErr::from_type(class, arguments),
        Err(error) => error,
    }
}

/// An `InputError`: `what` names the argument, its value and the cure.
pub fn input(py: Python<'_>, what: impl Into<String>) -> PyErr {
    exception(py, "InputError", what.into())
}

/// An `UnsupportedError`: `what` names the reason and the cure.
pub fn unsupported(py: Python<'_>, what: &'static str) -> PyErr {
    exception(py, "UnsupportedError", what)
}

/// An error of the crate as the exception of its category.
pub fn translated(py: Python<'_>, error: &mrvis::Error) -> PyErr {
    use mrvis::ErrorCategory::{Cancelled, Device, Input, Io, OutOfMemory, Unsupported};
    if let mrvis::Error::Io { path, source } = error
        && let Some(code) = source.raw_os_error()
        && error.category() == Io
    {
        let text = source.to_string();
        let text = text.split(" (os error").next().unwrap_or_default().to_owned();
        return exception(py, "IoError", (code, text, path.clone().into_os_string()));
    }
    let class = match error.category() {
        Input => "InputError",
        Unsupported => "UnsupportedError",
        OutOfMemory => "OutOfMemoryError",
        Cancelled => "CancelledError",
        Device => "DeviceError",
        Io => "IoError",
        _ => "Error",
    };
    exception(py, class, in_words(error.to_string()))
}

/// A panic of the crate as an `Error`.
pub fn panicked(py: Python<'_>, panic: &(dyn Any + Send)) -> PyErr {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("unknown");
    exception(py, "Error", format!("internal error, please report it: {text}"))
}

/// Adds the translation of errors of the crate to its results.
pub trait Raise<T> {
    /// The value, or the exception.
    fn raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T> Raise<T> for mrvis::Result<T> {
    fn raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|error| translated(py, &error))
    }
}
