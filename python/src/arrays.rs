//! NumPy arrays as slices: borrowed where their layout allows, else copied once.
//!
//! A borrow is registered with rust-numpy, which refuses to write into the same memory through `out=` meanwhile. Python code in other
//! threads is not kept from writing: callers must not change arrays during a call.

use crate::arguments::{arguments, largest};
use crate::errors::input;
use numpy::{
    Element, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArray1, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt::Display;

/// The object as an array; lists and numbers become one.
fn array<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyUntypedArray>> {
    let py = value.py();
    if let Ok(array) = value.cast::<PyUntypedArray>() {
        return Ok(array.clone());
    }
    let made = py.import("numpy")?.call_method1("asarray", (value,));
    let made = made.map_err(|error| input(py, format!("`{name}`: is no array: {}", error.value(py))))?;
    Ok(made.cast_into()?)
}

/// The kind of numbers of an array, as NumPy calls it: `f`, `i`, `u`, …
fn kind(array: &Bound<'_, PyUntypedArray>) -> PyResult<char> {
    array.dtype().getattr("kind")?.extract()
}

fn converted<'py, T: Element>(array: &Bound<'py, PyUntypedArray>) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let arguments = PyDict::new(array.py());
    arguments.set_item("order", "C")?;
    let copy = array.call_method("astype", (T::get_dtype(array.py()),), Some(&arguments))?;
    Ok(copy.cast_into()?)
}

fn wrong(array: &Bound<'_, PyUntypedArray>, name: &str, must: &str) -> PyErr {
    let dtype = array.dtype().str().map(|d| d.to_string()).unwrap_or_default();
    let shape = array.getattr("shape").and_then(|s| s.str()).map(|s| s.to_string()).unwrap_or_default();
    input(array.py(), format!("`{name}` has shape {shape} and dtype {dtype}: must {must}"))
}

/// Positions or vectors, x, y, z in rows of an array; borrowed.
pub struct Rows<'py, T: Element> {
    array: PyReadonlyArrayDyn<'py, T>,
    first: usize,
    stride: usize,
    count: usize,
}

impl<'py, T: Element + Copy> Rows<'py, T> {
    /// Borrows C-contiguous rows, and rows of three adjacent numbers in a C-contiguous array; copies others.
    fn new(array: &Bound<'py, PyArrayDyn<T>>) -> PyResult<Rows<'py, T>> {
        let count = array.shape()[0];
        if let Ok(whole) = array.try_readonly()
            && whole.is_c_contiguous()
            && whole.as_slice().is_ok()
        {
            return Ok(Rows { array: whole, first: 0, stride: 3, count });
        }
        if let Some(rows) = Rows::within(array, count)? {
            return Ok(rows);
        }
        let array = converted::<T>(array.as_untyped())?;
        Ok(Rows { array: readonly(&array)?, first: 0, stride: 3, count })
    }

    /// Rows that are a part of a C-contiguous array, such as `all[:, 3:6]` or `all[::2]`.
    fn within(array: &Bound<'py, PyArrayDyn<T>>, count: usize) -> PyResult<Option<Rows<'py, T>>> {
        let size = size_of::<T>();
        let [rows, numbers] = *array.strides() else { return Ok(None) };
        let stride = usize::try_from(rows).unwrap_or(0);
        if numbers != size as isize || !stride.is_multiple_of(size) || stride < 3 * size {
            return Ok(None);
        }
        let base = array.getattr("base")?;
        let Ok(base) = base.cast::<PyArrayDyn<T>>() else { return Ok(None) };
        let Ok(base) = base.try_readonly() else { return Ok(None) };
        let Ok(data) = base.as_slice() else { return Ok(None) };
        let begin = data.as_ptr() as usize;
        let Some(bytes) = (array.data() as usize).checked_sub(begin) else { return Ok(None) };
        let (first, stride) = (bytes / size, stride / size);
        let end = count.checked_sub(1).map_or(0, |last| first + last * stride + 3);
        if !bytes.is_multiple_of(size) || end > data.len() {
            return Ok(None);
        }
        Ok(Some(Rows { array: base, first, stride, count }))
    }

    /// The numbers from the first one on, and the distance between rows.
    fn data(&self) -> (&[T], usize) {
        let all = self.array.as_slice().unwrap_or_default();
        (all.get(self.first..).unwrap_or_default(), self.stride)
    }

    /// Borrowed for the crate.
    pub fn strided(&self) -> mrvis::Result<mrvis::Strided<'_, T>> {
        let (data, stride) = self.data();
        mrvis::Strided::new(data, stride, self.count)
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.count
    }

    /// The numbers of a row.
    pub fn row(&self, index: usize) -> [T; 3] {
        let (data, stride) = self.data();
        let row = &data[index * stride..][..3];
        [row[0], row[1], row[2]]
    }
}

fn readonly<'py, T: Element>(array: &Bound<'py, PyArrayDyn<T>>) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    let borrowed = array.try_readonly();
    borrowed
        .map_err(|_| input(array.py(), "an array is read and written (`out`) at once: give another `out`"))
}

/// Positions in single or double precision.
pub enum Points<'py> {
    F32(Rows<'py, f32>),
    F64(Rows<'py, f64>),
}

/// The array as positions of shape (N, 3): float32 and float64 as they are, other real numbers as float64.
pub fn points<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Points<'py>> {
    let array = array(name, value)?;
    let must = "be (N, 3), float32 or float64";
    if array.ndim() != 2 || array.shape()[1] != 3 || !"fiu".contains(kind(&array)?) {
        return Err(wrong(&array, name, must));
    }
    if let Ok(array) = array.cast::<PyArrayDyn<f32>>() {
        return Rows::new(array).map(Points::F32);
    }
    if let Ok(array) = array.cast::<PyArrayDyn<f64>>() {
        return Rows::new(array).map(Points::F64);
    }
    Rows::new(&converted(&array)?).map(Points::F64)
}

/// The array as positions in double precision; others are copied.
pub fn points_f64<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Rows<'py, f64>> {
    match points(name, value)? {
        Points::F64(rows) => Ok(rows),
        Points::F32(_) => Rows::new(&converted(&array(name, value)?)?),
    }
}

/// Whole numbers, borrowed or copied.
pub enum Numbers<'py, T: Element> {
    Borrowed(PyReadonlyArrayDyn<'py, T>),
    Owned(Vec<T>),
}

impl<T: Element> Numbers<'_, T> {
    /// All numbers, row by row.
    pub fn slice(&self) -> &[T] {
        match self {
            Numbers::Borrowed(array) => array.as_slice().unwrap_or_default(),
            Numbers::Owned(values) => values,
        }
    }
}

/// The array as whole numbers that are not negative, with its shape: those of type `T` in C order are borrowed, others checked and copied.
pub fn numbers<'py, T: Element + TryFrom<i64> + TryFrom<u64>>(
    name: &str,
    value: &Bound<'py, PyAny>,
) -> PyResult<(Numbers<'py, T>, Vec<usize>)> {
    let array = array(name, value)?;
    let shape = array.shape().to_vec();
    if let Ok(same) = array.cast::<PyArrayDyn<T>>() {
        let same = readonly(same)?;
        if same.is_c_contiguous() && same.as_slice().is_ok() {
            return Ok((Numbers::Borrowed(same), shape));
        }
    }
    if !"iu".contains(kind(&array)?) && !array.is_empty() {
        return Err(wrong(&array, name, "hold whole numbers (int32, uint32, int64 or uint64)"));
    }
    let all = match kind(&array)? {
        'u' => checked::<u64, T>(name, &array),
        _ => checked::<i64, T>(name, &array),
    }?;
    Ok((Numbers::Owned(all), shape))
}

/// Numbers of the wide type `W`, copied as `T`.
fn checked<W: Element + Copy + Display, T: TryFrom<W>>(
    name: &str,
    array: &Bound<'_, PyUntypedArray>,
) -> PyResult<Vec<T>> {
    let copy = readonly(&converted::<W>(array)?)?;
    let one = |(i, &number): (usize, &W)| {
        let what = format!("`{name}`[{i}] {number}: must be a whole number from 0 to {}", largest::<T>());
        T::try_from(number).map_err(|_| input(array.py(), what))
    };
    copy.as_slice()?.iter().enumerate().map(one).collect()
}

/// A number, or an array of real numbers as float32.
pub enum Floats<'py> {
    All(f32),
    Each(PyReadonlyArrayDyn<'py, f32>),
}

impl Floats<'_> {
    /// Refuses an array of another number of entries than `of` has.
    pub fn check(&self, py: Python<'_>, name: &str, count: usize, of: &str) -> PyResult<()> {
        match self {
            Floats::Each(each) if each.len() != count => {
                let entries = each.len();
                let what = format!("`{name}` has {entries} entries for {count} {of}: give one each, or one");
                Err(input(py, what))
            }
            _ => Ok(()),
        }
    }
}

arguments!(Floats<'py>: floats;);

/// One number, or an array of shape (N,): C-contiguous float32 is borrowed, others are copied.
fn floats<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Floats<'py>> {
    let is_array = value.cast::<PyUntypedArray>().is_ok_and(|array| array.ndim() > 0);
    if !is_array && let Ok(value) = value.extract::<f64>() {
        return Ok(Floats::All(value as f32));
    }
    let array = array(name, value)?;
    if array.ndim() != 1 || !"fiu".contains(kind(&array)?) {
        return Err(wrong(&array, name, "be a number or have shape (N,), float32"));
    }
    if let Ok(same) = array.cast::<PyArrayDyn<f32>>() {
        let same = readonly(same)?;
        if same.as_slice().is_ok() {
            return Ok(Floats::Each(same));
        }
    }
    Ok(Floats::Each(readonly(&converted(&array)?)?))
}

/// An array that answers are written into: the caller's or a new one, with `count` entries.
pub fn output<'py>(
    py: Python<'py>,
    name: &str,
    given: Option<&Bound<'py, PyAny>>,
    count: usize,
) -> PyResult<PyReadwriteArray1<'py, f32>> {
    let Some(given) = given else {
        return Ok(PyArray1::from_vec(py, vec![0.0f32; count]).readwrite());
    };
    let must = format!("be a writable, C-contiguous float32 array of shape ({count},)");
    let Ok(array) = given.cast::<PyArray1<f32>>() else {
        return Err(input(py, format!("`{name}`: must {must}")));
    };
    if !array.is_c_contiguous() || array.len() != count {
        return Err(wrong(array.as_untyped(), name, &must));
    }
    array.try_readwrite().map_err(|error| input(py, format!("`{name}`: must {must}; {error}")))
}

/// `Vec<[T; 3]>` as an array of shape (N, 3) that owns the memory.
pub fn rows_out<T: Element>(py: Python<'_>, rows: Vec<[T; 3]>) -> PyResult<Bound<'_, numpy::PyArray2<T>>> {
    let count = rows.len();
    PyArray1::from_vec(py, rows.into_flattened()).reshape([count, 3])
}

/// The array as an image of shape (rows, columns): its columns, rows and values, copied.
pub fn image(name: &str, value: &Bound<'_, PyAny>) -> PyResult<(usize, usize, Vec<f32>)> {
    let array = array(name, value)?;
    if array.ndim() != 2 || !"fiu".contains(kind(&array)?) {
        return Err(wrong(&array, name, "be (rows, columns) of real numbers"));
    }
    let [rows, columns] = [array.shape()[0], array.shape()[1]];
    Ok((columns, rows, converted::<f32>(&array)?.to_vec()?))
}

/// The object as three numbers if it is a list or an array of three.
pub fn single(value: &Bound<'_, PyAny>) -> Option<[f64; 3]> {
    let is_table = value.cast::<PyUntypedArray>().is_ok_and(|array| array.ndim() != 1);
    if is_table { None } else { value.extract().ok() }
}
