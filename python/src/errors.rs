//! Errors of the crate as exceptions of `mrvis._types`, and words of the crate as words of the package.

use mrvis::internals::error::{own_word, parts_of, worded};
use pyo3::PyErrArguments;
use pyo3::prelude::*;
use pyo3::types::PyType;
use std::any::Any;

/// Names of the crate, and their names in the package.
const WORDS: [(&str, &str); 11] = [
    ("Detail::Optics", "`detail=\"optics\"`"),
    ("Detail::Clusters", "`detail=\"clusters\"`"),
    ("Detail::Rays", "`detail=\"rays\"`"),
    ("Engine::MultiResolution", "`mr`"),
    ("Engine::Average", "`average`"),
    ("Scene::flattened", "`Scene.flattened()`"),
    ("face_materials", "`material`"),
    ("to_source", "`source`"),
    ("sizes", "`size`"),
    // The package has no such option.
    ("max_memory", "the free memory"),
    ("LoadOptions::max_memory", "the free memory"),
];

/// Name in the package of an option or argument of the crate.
fn word(name: &str) -> String {
    let (base, entry) = parts_of(name);
    let own = WORDS.iter().find(|(own, _)| *own == base).map(|(_, word)| format!("{word}{entry}"));
    own.unwrap_or_else(|| match base {
        // One size or an array of them is the same argument; sizes by name are not.
        "feature_sizes" | "emitter_sizes" if !entry.is_empty() => {
            format!("`{}`{entry}", base.trim_end_matches('s'))
        }
        // Changes of instances are arguments of several methods; the number of the instance follows.
        "changes" => entry.rsplit("].").next().map(own_word).unwrap_or_default(),
        _ => match base.strip_prefix("LoadOptions::") {
            Some(option) => format!("`{option}` where the scene is made"),
            None => own_word(name),
        },
    })
}

/// Notes of the crate in words of the package.
pub fn notes(all: &[String]) -> Vec<String> {
    all.iter().map(|note| worded(note, word)).collect()
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
    exception(py, class, error.worded(word))
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
