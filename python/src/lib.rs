//! The extension module of the Python package `mrvis`: translates arguments, arrays, errors and progress; the crate does the rest.

mod arguments;
mod arrays;
mod errors;
mod form_factors;
mod metrics;
mod model;
mod scene;
mod solution;
mod source;
mod visibility;
mod work;

use pyo3::prelude::*;

/// Visibility and radiosity in scenes full of small detail.
#[pymodule]
mod _mrvis {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::form_factors::PyFormFactors;
    #[pymodule_export]
    use super::metrics::{fbem, fbem_spectrum};
    #[pymodule_export]
    use super::model::PyModel;
    #[pymodule_export]
    use super::scene::{PyScene, PySceneBuilder};
    #[pymodule_export]
    use super::solution::PySolution;
    #[pymodule_export]
    use super::visibility::PyVisibility;

    /// Work that was left behind ends before the libraries that it uses.
    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        let stop = wrap_pyfunction!(crate::work::stop_all, module)?;
        module.py().import("atexit")?.call_method1("register", (stop,)).map(drop)
    }

    #[expect(non_upper_case_globals, reason = "the name that Python users look for")]
    #[pymodule_export]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
