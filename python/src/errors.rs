//! Errors of the crate as exceptions of `mrvis._types`, and words of the crate as words of the package.

use pyo3::PyErrArguments;
use pyo3::prelude::*;
use pyo3::types::PyType;
use std::any::Any;

/// Names in messages of the crate, and the arguments of the package that they stand for.
const WORDS: [(&str, &str); 10] = [
    ("`Detail::Optics`", "`detail=\"optics\"`"),
    ("`Detail::Clusters`", "`detail=\"clusters\"`"),
    ("`Detail::Rays`", "`detail=\"rays\"`"),
    ("the engine `MultiResolution`", "the engine `mr`"),
    ("the engine `Average`", "the engine `average`"),
    ("`feature_sizes`[0]", "`feature_size`"),
    ("`feature_sizes`", "`feature_size`"),
    ("`emitter_sizes`", "`emitter_size`"),
    ("`face_materials`", "`material`"),
    ("`to_source`", "`source`"),
];

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
    let message = WORDS.iter().fold(error.to_string(), |text, (from, to)| text.replace(from, to));
    exception(py, class, message)
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
