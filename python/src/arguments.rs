//! Arguments other than arrays: numbers, words and keyword arguments, with their names in messages.

use crate::errors::input;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Keyword arguments; those that are `None` have their defaults.
pub fn keywords<'py>(
    options: Option<&Bound<'py, PyDict>>,
) -> impl Iterator<Item = (String, Bound<'py, PyAny>)> {
    let all: Vec<_> = options.into_iter().flat_map(|options| options.iter()).collect();
    all.into_iter().filter(|(_, value)| !value.is_none()).map(|(name, value)| (name.to_string(), value))
}

/// Sets the fields of `options` that keyword arguments of a function name. `as` states the type that a keyword is read as, by default
/// that of the field ([`Argument`]); `=>` states the field to set, by default that of the same name.
macro_rules! set_keywords {
    ($options:ident, $function:expr, $given:expr, $($name:ident $(as $read:path)? $(=> $place:expr)?),+ $(,)?) => {
        for (name, given) in $crate::arguments::keywords($given) {
            match name.as_str() {
                $(stringify!($name) => {
                    set_keywords!(@place $options $name $($place)?) = set_keywords!(@read $($read)?)(&name, &given)?;
                })+
                _ => return $crate::arguments::unknown($function, &name),
            }
        }
    };
    (@place $options:ident $name:ident) => { $options.$name };
    (@place $options:ident $name:ident $place:expr) => { $place };
    (@read) => { $crate::arguments::Argument::read };
    (@read $read:path) => { $read };
}
pub(crate) use set_keywords;

/// A type that a keyword argument can be read as.
pub trait Argument<'py>: Sized {
    /// The argument.
    fn read(name: &str, given: &Bound<'py, PyAny>) -> PyResult<Self>;
}

/// Implements [`Argument`] for types.
macro_rules! arguments {
    ($($kind:ty: $read:expr;)+) => {
        $(impl<'py> $crate::arguments::Argument<'py> for $kind {
            fn read(name: &str, given: &Bound<'py, PyAny>) -> PyResult<Self> {
                $read(name, given)
            }
        })+
    };
}
pub(crate) use arguments;

arguments! {
    bool: value;
    f32: value;
    f64: value;
    String: value;
    PathBuf: value;
    Vec<String>: value;
    u32: whole;
    u64: whole;
    usize: whole;
    [f64; 3]: vector;
}

impl<'py, T: Argument<'py>> Argument<'py> for Option<T> {
    fn read(name: &str, given: &Bound<'py, PyAny>) -> PyResult<Self> {
        T::read(name, given).map(Some)
    }
}

/// The error of a keyword argument that does not exist.
pub fn unknown<T>(function: &str, name: &str) -> PyResult<T> {
    Err(PyTypeError::new_err(format!("{function}() got an unexpected keyword argument '{name}'")))
}

/// A value of a type.
pub fn value<'py, T: FromPyObjectOwned<'py>>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<T> {
    let extracted = value.extract::<T>().map_err(Into::<PyErr>::into);
    extracted.map_err(|error| PyTypeError::new_err(format!("`{name}`: {}", error.value(value.py()))))
}

/// Whether it is a whole number, of Python or NumPy.
pub fn is_whole(given: &Bound<'_, PyAny>) -> bool {
    given.call_method0("__index__").is_ok()
}

/// A whole number that is not negative: any that the type holds.
pub fn whole<T: TryFrom<u64>>(name: &str, given: &Bound<'_, PyAny>) -> PyResult<T> {
    let number = given.call_method0("__index__").map_err(|_| {
        let class = given.get_type().name().map(|name| name.to_string()).unwrap_or_default();
        PyTypeError::new_err(format!("`{name}`: must be a whole number, not {class}"))
    })?;
    let found = number.extract::<u64>().ok().and_then(|number| T::try_from(number).ok());
    found.ok_or_else(|| {
        // Python refuses to write numbers of thousands of digits.
        let shown = number.str().map_or_else(|_| "(of thousands of digits)".into(), |text| text.to_string());
        input(given.py(), format!("`{name}` {shown}: must be a whole number from 0 to {}", largest::<T>()))
    })
}

/// Largest value of an unsigned type.
pub fn largest<T>() -> u64 {
    u64::MAX >> (64 - 8 * size_of::<T>())
}

/// One of several words.
pub fn word<T: Copy>(name: &str, given: &Bound<'_, PyAny>, words: &[(&str, T)]) -> PyResult<T> {
    let text: String = value(name, given)?;
    if let Some((_, found)) = words.iter().find(|(word, _)| *word == text) {
        return Ok(*found);
    }
    let known: Vec<String> = words.iter().map(|(word, _)| format!("{word:?}")).collect();
    Err(input(given.py(), format!("`{name}` {text:?}: must be {}", known.join(", "))))
}

/// Three numbers.
pub fn vector(name: &str, given: &Bound<'_, PyAny>) -> PyResult<[f64; 3]> {
    given.extract().map_err(|_| input(given.py(), format!("`{name}`: must be three numbers (x, y, z)")))
}

/// The answer to an attempt to pickle or copy.
pub fn not_pickled<T>(class: &str, cure: &str) -> PyResult<T> {
    Err(PyTypeError::new_err(format!("mrvis.{class} cannot be pickled or copied: {cure}")))
}
