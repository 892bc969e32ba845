//! Models: scenes prepared for queries.

use crate::arguments::{keywords, not_pickled, unknown, value, whole, word};
use crate::errors::Raise;
use crate::form_factors::{PyFormFactors, form_factor_options};
use crate::scene::{PyScene, affine};
use crate::solution::{PySolution, solve_options};
use crate::visibility::{Ask, PyVisibility, SourceAsk};
use crate::work::{long, short};
use mrvis::{Detail, InstanceChange, Model, PrepareOptions};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

const DETAILS: [(&str, Detail); 3] =
    [("rays", Detail::Rays), ("clusters", Detail::Clusters), ("optics", Detail::Optics)];

/// A scene prepared for queries. Immutable; several threads may ask at once.
#[pyclass(frozen, module = "mrvis", name = "Model")]
pub struct PyModel {
    model: Model,
    scene: Py<PyScene>,
    threads: usize,
}

#[pymethods]
impl PyModel {
    /// Prepares a scene: Embree scenes ("rays"), cluster trees too ("clusters"), their optics too ("optics", the default).
    #[new]
    #[pyo3(signature = (scene, *, progress=None, **options))]
    fn new(
        py: Python<'_>,
        scene: Py<PyScene>,
        progress: Option<Py<PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyModel> {
        let (mut prepare, mut threads) = (PrepareOptions::default(), 0);
        for (name, given) in keywords(options) {
            prepare = match name.as_str() {
                "detail" => prepare.with_detail(word(&name, &given, &DETAILS)?),
                "threads" => {
                    threads = whole(&name, &given)?;
                    prepare.with_threads(threads)
                }
                "cache" => prepare.with_cache(value::<PathBuf>(&name, &given)?),
                _ => return unknown("Model", &name),
            };
        }
        let shared = scene.get().scene.clone();
        let model = long(py, progress, |watch| Model::prepare(shared, &prepare, watch))?;
        Ok(PyModel { model, scene, threads })
    }

    /// The scene that was prepared.
    #[getter]
    fn scene(&self, py: Python<'_>) -> Py<PyScene> {
        self.scene.clone_ref(py)
    }

    /// "rays", "clusters" or "optics".
    #[getter]
    fn detail(&self) -> &'static str {
        let found = DETAILS.iter().find(|(_, detail)| *detail == self.model.detail());
        found.map_or("", |(name, _)| name)
    }

    /// Number of light sources: those of `Scene.emitter_names`.
    #[getter]
    fn source_count(&self) -> usize {
        self.model.sources().len()
    }

    /// Seconds and bytes of the preparation.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (report, all) = (self.model.report(), PyDict::new(py));
        for (name, seconds) in [
            ("seconds", report.seconds()),
            ("embree_s", report.embree_s),
            ("clusters_s", report.clusters_s),
            ("optics_s", report.optics_s),
            ("cache_s", report.cache_s),
        ] {
            all.set_item(name, seconds)?;
        }
        all.set_item("embree_bytes", report.embree_bytes)?;
        all.set_item("from_cache", report.from_cache())?;
        Ok(all)
    }

    /// Names of the instances; the first holds the scene's own triangles.
    #[getter]
    fn instance_names(&self) -> Vec<String> {
        self.model.instances().iter().map(|instance| instance.name.to_string()).collect()
    }

    /// A model in which instances were moved: a matrix (3, 4) or (4, 4) for each number of an instance.
    fn moved(&self, py: Python<'_>, transforms: &Bound<'_, PyDict>) -> PyResult<PyModel> {
        let mut changes = Vec::new();
        for (instance, transform) in transforms {
            let (instance, transform) = (whole("instance", &instance)?, affine("transform", &transform)?);
            changes.push(InstanceChange::Move { instance, transform });
        }
        let model = short(py, || self.model.update(&changes))?;
        Ok(PyModel { model, scene: self.scene.clone_ref(py), threads: self.threads })
    }

    /// Transmittance of segments, in bundles.
    #[pyo3(signature = (origins, targets, *, bundles=None, out=None, **options))]
    fn visibility<'py>(
        &self,
        origins: &Bound<'py, PyAny>,
        targets: &Bound<'py, PyAny>,
        bundles: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<PyVisibility> {
        Ask::new(origins, targets, bundles, options)?.answer(&self.model, out)
    }

    /// Visible fraction of a source from points of surfaces.
    #[pyo3(signature = (points, normals, source=None, *, out=None, progress=None, **options))]
    fn source_visibility<'py>(
        &self,
        points: &Bound<'py, PyAny>,
        normals: &Bound<'py, PyAny>,
        source: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
        progress: Option<Py<PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<PyVisibility> {
        SourceAsk::new(points, normals, source, options)?.answer(&self.model, self.threads, out, progress)
    }

    /// Form factors between polygons, objects or materials.
    #[pyo3(signature = (*, progress=None, **options))]
    fn form_factors(
        &self,
        py: Python<'_>,
        progress: Option<Py<PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyFormFactors> {
        let options = form_factor_options(options)?;
        let factors = long(py, progress, |watch| self.model.form_factors(&options, watch))?;
        PyFormFactors::new(py, factors)
    }

    /// Computes the light.
    #[pyo3(signature = (*, progress=None, **options))]
    fn solve(
        &self,
        py: Python<'_>,
        progress: Option<Py<PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PySolution> {
        let options = solve_options(options)?;
        let solution = long(py, progress, |watch| self.model.solve(&options, watch))?;
        Ok(PySolution::new(solution))
    }

    fn __repr__(&self) -> String {
        let (detail, triangles) = (self.detail(), self.model.scene().triangle_count());
        format!("<mrvis.Model: {triangles} triangles, {} sources, detail {detail:?}>", self.source_count())
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("Model", "prepare the model in the other process")
    }
}

/// The version of the Embree library that is loaded.
#[pyfunction]
pub fn embree_version(py: Python<'_>) -> PyResult<String> {
    short(py, mrvis::embree_version)
}
