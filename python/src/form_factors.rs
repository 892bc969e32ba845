//! Form factors as a sparse matrix.

use crate::arguments::{arguments, not_pickled, set_keywords, word};
use mrvis::{FormFactorOptions, FormFactors, Grouping};
use numpy::{Element, PyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::PyImportError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

const GROUPINGS: [(&str, Grouping); 3] =
    [("polygon", Grouping::Polygon), ("object", Grouping::Object), ("material", Grouping::Material)];
arguments!(Grouping: |name, given| word(name, given, &GROUPINGS););

pub fn form_factor_options(options: Option<&Bound<'_, PyDict>>) -> PyResult<FormFactorOptions> {
    let mut all = FormFactorOptions::default();
    set_keywords! {
        all, "form_factors", options, grouping, rays, pair_rays, closure, max_bytes, seed
    }
    Ok(all)
}

/// Form factors F[from, to]: fraction of what the front of one polygon (object, material) sends out that arrives at the front of another.
#[pyclass(frozen, module = "mrvis", name = "FormFactors")]
pub struct PyFormFactors {
    /// Form factors in [0, 1], shape (nonzeros,), float32.
    #[pyo3(get)]
    data: Py<PyArray1<f32>>,
    /// Columns of the factors, ascending in each row, shape (nonzeros,), int32; int64 with 2**31 factors or more.
    #[pyo3(get)]
    indices: Py<PyAny>,
    /// Where rows begin and end, shape (N + 1,), of the type of `indices`.
    #[pyo3(get)]
    indptr: Py<PyAny>,
    /// Areas of the rows, shape (N,), float64, scene units squared.
    #[pyo3(get)]
    areas: Py<PyArray1<f64>>,
    /// Fraction of each row that leaves the scene, shape (N,), float32.
    #[pyo3(get)]
    escaped: Py<PyArray1<f32>>,
    /// Fraction of each row that arrives at backs of polygons, shape (N,), float32.
    #[pyo3(get)]
    lost: Py<PyArray1<f32>>,
    /// Names of the rows, objects or materials; empty for polygons.
    #[pyo3(get)]
    names: Vec<String>,
    /// Number of rays.
    #[pyo3(get)]
    rays: u64,
    /// Mean error of the row sums before closure.
    #[pyo3(get)]
    row_sum_error: f64,
}

impl PyFormFactors {
    /// Copies the matrix once, into memory that NumPy owns.
    pub fn new(py: Python<'_>, factors: &FormFactors) -> PyFormFactors {
        let (offsets, columns, values) = (&factors.offsets, &factors.columns, &factors.factors);
        // SciPy wants one type for both, and copies what has another. There are at most 2³¹ polygons.
        let (indices, indptr) = match i32::try_from(values.len()) {
            Ok(_) => {
                (array(py, columns, |&column| column as i32), array(py, offsets, |&offset| offset as i32))
            }
            Err(_) => {
                (array(py, columns, |&column| i64::from(column)), array(py, offsets, |&offset| offset as i64))
            }
        };
        PyFormFactors {
            data: PyArray1::from_slice(py, values).unbind(),
            indices,
            indptr,
            areas: PyArray1::from_slice(py, &factors.areas).unbind(),
            escaped: PyArray1::from_slice(py, &factors.escaped).unbind(),
            lost: PyArray1::from_slice(py, &factors.lost).unbind(),
            names: factors.names.clone(),
            rays: factors.rays,
            row_sum_error: factors.row_sum_error,
        }
    }
}

fn array<S, T: Element>(py: Python<'_>, numbers: &[S], of: fn(&S) -> T) -> Py<PyAny> {
    PyArray1::from_vec(py, numbers.iter().map(of).collect()).into_any().unbind()
}

#[pymethods]
impl PyFormFactors {
    /// The matrix as a `scipy.sparse.csr_array` that shares the memory of `data` and `indices`; needs SciPy.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let sparse = py.import("scipy.sparse").map_err(|error| {
            let cure = "`matrix` needs SciPy: install it, or use `data`, `indices` and `indptr`";
            let missing = PyImportError::new_err(cure);
            missing.set_cause(py, Some(error));
            missing
        })?;
        let (parts, keywords) = ((&self.data, &self.indices, &self.indptr), PyDict::new(py));
        let rows = self.areas.bind(py).len();
        keywords.set_item("shape", (rows, rows))?;
        sparse.call_method("csr_array", (parts,), Some(&keywords))
    }

    fn __len__(&self, py: Python<'_>) -> usize {
        self.areas.bind(py).len()
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let rows = self.areas.bind(py).len();
        let factors = self.data.bind(py).len();
        format!("<mrvis.FormFactors: {rows} x {rows}, {factors} factors above 0>")
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("FormFactors", "pickle `matrix`, or `data`, `indices` and `indptr`")
    }
}
