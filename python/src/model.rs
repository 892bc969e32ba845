//! Models: scenes prepared for queries.

use crate::arguments::{arguments, not_pickled, set_keywords, value, whole, word};
use crate::arrays::rows_out;
use crate::form_factors::{PyFormFactors, form_factor_options};
use crate::scene::{PyScene, affine};
use crate::solution::{PySolution, class, solve_options, surface_points};
use crate::source::SourceAsk;
use crate::visibility::{PyVisibility, SegmentBatch};
use crate::work::long;
use mrvis::{BenchOptions, Builder, Detail, Instance, InstanceChange, Model, PrepareOptions};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

const DETAILS: [(&str, Detail); 3] =
    [("rays", Detail::Rays), ("clusters", Detail::Clusters), ("optics", Detail::Optics)];

const BUILDERS: [(&str, Builder); 4] = [
    ("grids", Builder::Grids),
    ("kdtree", Builder::KdTree),
    ("goldsmith-salmon", Builder::GoldsmithSalmon),
    ("sah", Builder::Sah),
];

arguments! {
    Detail: |name, given| word(name, given, &DETAILS);
    Builder: |name, given| word(name, given, &BUILDERS);
}

/// Model(scene, *, detail="optics", threads=0, cache=None, builder="grids", progress=None)
///
/// A scene prepared for queries. Immutable; several threads may ask at once.
///
/// detail: "rays" for exact visibility and form factors, "clusters" also for `solve`, "optics" (default) also for multi-resolution and
/// average visibility. threads: of the preparation and of all queries, 0 for one a core; no result depends on it. cache: a folder that
/// keeps measured clusters for the next time. builder: how clusters are built: "grids" (default, a hierarchy of uniform grids), "kdtree",
/// "goldsmith-salmon" or "sah"; exact visibility does not depend on it. progress: called as progress(stage, fraction) on the calling
/// thread when a stage begins and every 50 ms; if it returns False, CancelledError is raised; what it raises is raised here,
/// KeyboardInterrupt too.
#[pyclass(frozen, module = "mrvis", name = "Model")]
pub struct PyModel {
    pub model: Model,
    scene: Py<PyScene>,
}

impl PyModel {
    /// The model after changes of its instances.
    fn changed(&self, py: Python<'_>, changes: Vec<InstanceChange>) -> PyResult<PyModel> {
        let model = self.model.clone();
        let model = long(py, None, move |_| model.update(&changes))?;
        Ok(PyModel { model, scene: self.scene.clone_ref(py) })
    }
}

fn bench_options(options: Option<&Bound<'_, PyDict>>) -> PyResult<BenchOptions> {
    let mut all = BenchOptions::default();
    let sizes = |name: &str, given: &Bound<'_, PyAny>| {
        given.extract::<f64>().map_or_else(|_| value(name, given), |size| Ok(vec![size]))
    };
    set_keywords! {
        all, "bench", options, points, rays, feature_size as sizes => all.feature_sizes, receivers,
        reference_rays, threads, audit, seed
    }
    Ok(all)
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
        let mut prepare = PrepareOptions::default();
        set_keywords! {
            prepare, "Model", options, detail, threads, cache, builder
        }
        let shared = scene.get().scene.clone();
        let model = long(py, progress, move |watch| Model::prepare(shared, &prepare.with_progress(watch)))?;
        Ok(PyModel { model, scene })
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
            ("seconds", report.embree_s + report.clusters_s + report.optics_s + report.cache_s),
            ("embree_s", report.embree_s),
            ("clusters_s", report.clusters_s),
            ("optics_s", report.optics_s),
            ("cache_s", report.cache_s),
        ] {
            all.set_item(name, seconds)?;
        }
        all.set_item("embree_bytes", report.embree_bytes)?;
        all.set_item("from_cache", report.from_cache)?;
        Ok(all)
    }

    /// Names of the instances; the first holds the scene's own triangles.
    #[getter]
    fn instance_names(&self) -> Vec<String> {
        self.model.instances().iter().map(|instance| instance.name.to_string()).collect()
    }

    /// The instances as a list of `Instance`, removed ones included: the number of an instance is its place and never changes. The first
    /// holds the scene's own triangles.
    #[getter]
    fn instances<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let class = class(py, "Instance")?;
        let all = self.model.instances().iter();
        let one = |instance: &Instance| {
            let transform = PyArray1::from_slice(py, instance.transform.as_flattened()).reshape([3, 4])?;
            let (visible, removed) = (instance.visible, instance.removed);
            class.call1((&*instance.name, instance.mesh, transform, instance.material, visible, removed))
        };
        all.map(one).collect()
    }

    /// A model in which instances were moved, as a dict from numbers of instances (1 or larger) to matrices (3, 4) or (4, 4) from the
    /// frame of the mesh to that of the model, scene units relative to `Scene.origin`: rotation, reflection, uniform scale and
    /// translation. Clusters of meshes are not measured again; this model stays as it is. InputError for instances that do not exist, and
    /// for instance 0.
    fn moved(&self, py: Python<'_>, transforms: &Bound<'_, PyDict>) -> PyResult<PyModel> {
        let mut changes = Vec::new();
        for (instance, transform) in transforms {
            let (instance, transform) = (whole("transforms", &instance)?, affine("transforms", &transform)?);
            changes.push(InstanceChange::Move { instance, transform });
        }
        self.changed(py, changes)
    }

    /// A model with one more instance, after all others, of a mesh that an instance has already (`Instance.mesh`, 1 or larger).
    /// transform: as for `moved`. material: a number in `Scene.material_names` that replaces those of the mesh and does not emit.
    #[pyo3(signature = (mesh, name, transform, *, material=None))]
    fn with_instance(
        &self,
        py: Python<'_>,
        mesh: &Bound<'_, PyAny>,
        name: &str,
        transform: &Bound<'_, PyAny>,
        material: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyModel> {
        let added = Instance {
            mesh: whole("mesh", mesh)?,
            transform: affine("transform", transform)?,
            material: material.map(|material| whole("material", material)).transpose()?,
            name: name.into(),
            visible: true,
            removed: false,
        };
        self.changed(py, vec![InstanceChange::Add(added)])
    }

    /// A model without some instances, given by their numbers (1 or larger); those of others do not change.
    fn without_instances(&self, py: Python<'_>, instances: Vec<Bound<'_, PyAny>>) -> PyResult<PyModel> {
        let removed = |instance: &Bound<'_, PyAny>| {
            Ok(InstanceChange::Remove { instance: whole("instances", instance)? })
        };
        let changes = instances.iter().map(removed).collect::<PyResult<_>>()?;
        self.changed(py, changes)
    }

    /// A model in which instances are shown or hidden, as a dict from their numbers (1 or larger) to True or False.
    fn shown(&self, py: Python<'_>, visible: &Bound<'_, PyDict>) -> PyResult<PyModel> {
        let mut changes = Vec::new();
        for (instance, shown) in visible {
            let (instance, visible) = (whole("visible", &instance)?, value("visible", &shown)?);
            changes.push(InstanceChange::Show { instance, visible });
        }
        self.changed(py, changes)
    }

    /// Transmittance of N segments in K bundles, as a `Visibility`.
    ///
    /// origins, targets: (N, 3) scene units, from receivers to emitters; (3,) for one position that all share. float32 in C order, and
    /// rows of a C-ordered float32 array (`all[:, 3:6]`, `all[::2]`), are borrowed; others are copied, float64 rounded to float32
    /// relative to the scene's origin. bundles: number of segments a bundle (default 1), or K + 1 ascending offsets, uint64 borrowed.
    /// feature_size: a number or (K,) float32, scene units, above 0: smaller shadow features may be averaged; default: exact.
    /// emitter_size: a number or (K,) float32, the width of emitters seen from their receivers, scene units; default 0. engine: "auto"
    /// (default), "exact", "mr" (multi-resolution) or "average". relative_to: the point that positions are relative to; default zero.
    /// out: (K,) float32 that the transmittance is written into. intervals, methods, segments: whether to make these arrays of the
    /// answer.
    ///
    /// progress: as for `Model`; after an interruption some of `out` is written.
    #[pyo3(signature = (origins, targets, *, bundles=None, out=None, progress=None, **options))]
    fn visibility<'py>(
        &self,
        origins: &Bound<'py, PyAny>,
        targets: &Bound<'py, PyAny>,
        bundles: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
        progress: Option<Py<PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<PyVisibility> {
        SegmentBatch::new(origins, targets, bundles, options)?.answer(&self.model, out, progress)
    }

    /// Visible fraction of a light source from N points of surfaces, as a `Visibility`; parts below the horizon count as hidden.
    ///
    /// points: (N, 3) scene units; normals: (N, 3), or (3,) for all, of any length above 0; both are copied. source: its
    /// number in `Scene.emitter_names`, default 0. feature_size: a number or (N,), scene units, above 0; default: exact. rays: segments a
    /// point, 1 to 65,536, default 64. seed: 0 to 2**64 - 1, default 1. engine, out, progress: as for `visibility` and `Model`.
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
        SourceAsk::new(points, normals, source, options)?.answer(&self.model, out, progress)
    }

    /// Form factors with occlusion, as `FormFactors`; needs detail "rays".
    ///
    /// grouping: "polygon" (default), "object" or "material". rays: of every polygon, 1 to 1,048,576, default 2,048 or more. pair_rays:
    /// most between two polygons, 4 to 4,194,304, default 256 or more. closure: whether rows that nothing escapes from are adjusted to
    /// the sum 1 (default True). max_bytes: OutOfMemoryError beyond it, default four fifths of what is available. seed: 0 to 2**64 - 1,
    /// default 1. progress: as for `Model`.
    #[pyo3(signature = (*, progress=None, **options))]
    fn form_factors(
        &self,
        py: Python<'_>,
        progress: Option<Py<PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyFormFactors> {
        let options = form_factor_options(options)?;
        let model = self.model.clone();
        let factors = long(py, progress, move |watch| model.with_progress(watch).form_factors(&options))?;
        Ok(PyFormFactors::new(py, &factors))
    }

    /// Computes the light by hierarchical radiosity, as a `Solution`; needs detail "clusters".
    ///
    /// error: RMS error that links are refined to, relative to the mean irradiance, default 0.02. engine: "exact" (default), "mr" or
    /// "average", which need detail "optics", or "auto": "mr" with a feature size and that detail. feature_size: of all receivers, scene
    /// units; feature_sizes: of named objects, groups or materials, a dict. importance: names whose light matters. min_area: smallest
    /// element as a fraction of the scene's area, default 2e-5. direct_only: no reflected light at points (default False). max_seconds:
    /// time limit of this call. max_links: default ten million. target_error: RMS error until which more rays are traced. audit: number
    /// of elements whose error bars independent paths check, default 200. light_rays, gather_rays: rays from a point to a partly visible
    /// emitter, and for reflected light; default: from the error. seed: 0 to 2**64 - 1, default 1. progress: as for `Model`, but if it
    /// returns False the result is what was reached: `Solution.interrupted` is True.
    #[pyo3(signature = (*, progress=None, **options))]
    fn solve(
        this: &Bound<'_, Self>,
        py: Python<'_>,
        progress: Option<Py<PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PySolution> {
        let options = solve_options(options)?;
        let model = this.get().model.clone();
        let solution = long(py, progress, move |watch| model.with_progress(watch).solve(&options))?;
        Ok(PySolution { solution, model: this.clone().into_any().unbind() })
    }

    /// Irradiance by path tracing with all reflections, as a `Reference`: independent of clusters, elements and form factors; slow.
    ///
    /// points: (N, 3) scene units; normals: (N, 3), or (3,) for all, of any length above 0; both are copied. A point means the nearest
    /// surface along its normal that is about parallel, within 1e-5 of the scene's diagonal. samples: paths a point, 2 to 2**32 - 1, best
    /// 8 times a power of two, default 1,024. seed: 0 to 2**64 - 1, default 1. progress: as for `Model`.
    #[pyo3(signature = (points, normals, *, samples=None, seed=None, progress=None))]
    fn reference<'py>(
        &self,
        points: &Bound<'py, PyAny>,
        normals: &Bound<'py, PyAny>,
        samples: Option<&Bound<'py, PyAny>>,
        seed: Option<&Bound<'py, PyAny>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (py, points) = (points.py(), surface_points(points, normals)?);
        let samples = samples.map_or(Ok(1024), |samples| whole("samples", samples))?;
        let seed = seed.map_or(Ok(1), |seed| whole("seed", seed))?;
        let model = self.model.clone();
        let found =
            long(py, progress, move |watch| model.with_progress(watch).reference(&points, samples, seed))?;
        let (values, errors) = (rows_out(py, found.irradiance)?, rows_out(py, found.standard_errors)?);
        class(py, "Reference")?.call1((values, errors))
    }

    /// Time and error of exact and of multi-resolution visibility on the same segments, as a `Bench`: what `mrvis bench` measures. Needs
    /// detail "optics". Takes seconds to minutes; nothing else should run on the machine meanwhile.
    ///
    /// points: receivers, uniform over all surfaces that do not emit, 1 to 100 million, default 20,000. rays: segments from a point to an
    /// emitter, 1 to 65,536, default 16; 4 and 16 times as many are measured as well. feature_size: a number or several, scene units,
    /// above 0, default four from two texels of the shadow images to a fifth of the largest. receivers: names of objects, groups or
    /// materials for shadow images, default the largest flat surfaces. reference_rays: from a point to an emitter in the reference, 1 to
    /// 65,536, default 1,024. threads: of the timed sections, 1 to 1,024, default 1. audit: part of the bundles, 0 to 1, on which exact
    /// rays check the intervals, default 0.05. seed: 0 to 2**64 - 1, default 1. progress: as for `Model`; it stops the work between
    /// stages.
    #[pyo3(signature = (*, progress=None, **options))]
    fn bench<'py>(
        &self,
        py: Python<'py>,
        progress: Option<Py<PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let options = bench_options(options)?;
        let model = self.model.clone();
        let report = long(py, progress, move |watch| model.with_progress(watch).bench(&options))?;
        let record = py.import("json")?.call_method1("loads", (report.json,))?;
        class(py, "Bench")?.call1((record, report.page))
    }

    fn __repr__(&self) -> String {
        let (detail, triangles) = (self.detail(), self.model.scene().triangle_count());
        format!("<mrvis.Model: {triangles} triangles, {} sources, detail {detail:?}>", self.source_count())
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("Model", "prepare the model in the other process")
    }
}
