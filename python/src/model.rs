//! Models: scenes prepared for queries.

use crate::arguments::{keywords, not_pickled, unknown, value, whole, word};
use crate::form_factors::{PyFormFactors, form_factor_options};
use crate::scene::{PyScene, affine};
use crate::solution::{PySolution, solve_options};
use crate::source::SourceAsk;
use crate::visibility::{Ask, PyVisibility};
use crate::work::{long, short};
use mrvis::{Detail, InstanceChange, Model, PrepareOptions};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

const DETAILS: [(&str, Detail); 3] =
    [("rays", Detail::Rays), ("clusters", Detail::Clusters), ("optics", Detail::Optics)];

/// Model(scene, *, detail="optics", threads=0, cache=None, progress=None)
///
/// A scene prepared for queries. Immutable; several threads may ask at once.
///
/// detail: "rays" for exact visibility and form factors, "clusters" also for `solve`, "optics" (default) also for multi-resolution and average
/// visibility. threads: of the preparation and of all queries, 0 for one a core; no result depends on it. cache: a folder that keeps measured
/// clusters for the next time. progress: called as progress(stage, fraction) on the calling thread when a stage begins and every 50 ms; if it
/// returns False, CancelledError is raised; what it raises is raised here, KeyboardInterrupt too.
#[pyclass(frozen, module = "mrvis", name = "Model")]
pub struct PyModel {
    model: Model,
    scene: Py<PyScene>,
    threads: usize,
}

#[pymethods]
impl PyModel {
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

    /// Version of the Embree library that is loaded.
    #[getter]
    fn embree_version(&self) -> String {
        self.model.embree_version()
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

    /// A model in which instances were moved, as a dict from numbers of instances (1 or larger) to matrices (3, 4) or (4, 4) from the frame of
    /// the mesh to that of the model, scene units relative to `Scene.origin`. Clusters of meshes are not measured again.
    fn moved(&self, py: Python<'_>, transforms: &Bound<'_, PyDict>) -> PyResult<PyModel> {
        let mut changes = Vec::new();
        for (instance, transform) in transforms {
            let (instance, transform) = (whole("instance", &instance)?, affine("transform", &transform)?);
            changes.push(InstanceChange::Move { instance, transform });
        }
        let model = short(py, || self.model.update(&changes))?;
        Ok(PyModel { model, scene: self.scene.clone_ref(py), threads: self.threads })
    }

    /// Transmittance of N segments in K bundles, as a `Visibility`.
    ///
    /// origins, targets: (N, 3) scene units, from receivers to emitters; (3,) for one position that all share. float32 in C order, and rows of
    /// a C-ordered float32 array (`all[:, 3:6]`, `all[::2]`), are borrowed; others are copied, float64 rounded to float32 relative to the
    /// scene's origin. bundles: number of segments a bundle (default 1), or K + 1 ascending offsets, uint64 borrowed.
    /// feature_size: a number or (K,) float32, scene units, above 0: smaller shadow features may be averaged; default: exact.
    /// emitter_size: a number or (K,) float32, the width of emitters seen from their receivers, scene units; default 0.
    /// engine: "auto" (default), "exact", "mr" (multi-resolution) or "average". relative_to: the point that positions are relative to; default
    /// zero. out: (K,) float32 that the transmittance is written into. intervals, methods, segments: whether to make these arrays of the answer.
    ///
    /// The GIL is released. The batch is not interrupted by signals: a million segments take about a second or less.
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

    /// Visible fraction of a light source from N points of surfaces, as a `Visibility`; parts below the horizon count as hidden.
    ///
    /// points: (N, 3) scene units; normals: (N, 3), or (3,) for all, of any length above 0; both are copied. source: its
    /// number in `Scene.emitter_names`, default 0. feature_size: a number or (N,), scene units, above 0; default: exact. rays: segments a
    /// point, 1 to 65,536, default 64. seed: default 1. engine, out, progress: as for `visibility` and `Model`.
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

    /// Form factors with occlusion, as `FormFactors`; needs detail "rays".
    ///
    /// grouping: "polygon" (default), "object" or "material". rays: of every polygon, 1 to 1,048,576, default 2,048 or more. pair_rays: most
    /// between two polygons, 4 to 4,194,304, default 256 or more. closure: whether rows that nothing escapes from are adjusted to the sum 1
    /// (default True). max_bytes: OutOfMemoryError beyond it, default 16 GiB. seed: default 1. progress: as for `Model`, but
    /// it stops the work only before it begins.
    #[pyo3(signature = (*, progress=None, **options))]
    fn form_factors(
        &self,
        py: Python<'_>,
        progress: Option<Py<PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyFormFactors> {
        let options = form_factor_options(options)?;
        let factors = long(py, progress, |watch| self.model.form_factors(&options, watch))?;
        Ok(PyFormFactors::new(py, &factors))
    }

    /// Computes the light by hierarchical radiosity, as a `Solution`; needs detail "clusters".
    ///
    /// error: RMS error that links are refined to, relative to the mean irradiance, default 0.02. engine: "exact" (default), "mr" or "average",
    /// which need detail "optics". feature_size: of all receivers, scene units; feature_sizes: of named objects, groups or materials, a dict.
    /// importance: names whose light matters. min_area: smallest element as a fraction of the scene's area, default 2e-5. direct_only: no
    /// reflected light at points (default False). max_seconds: time limit from the start of the preparation. max_links: default ten
    /// million. target_error: RMS error until which more rays are traced. seed: default 1.
    /// progress: as for `Model`, but if it returns False the result is what was reached: `Solution.interrupted` is True.
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
