//! Preparation: the only place where Embree scenes of a model are committed and clusters are measured.

use super::cache::{self, CacheLocation, Origin, PreparedClusters};
use super::instance::{Instance, is_single};
use super::mesh::{Clusters, Measured, Mesh, commit};
use super::top_level::TopLevel;
use super::{Inner, Model, Source};
use crate::clusters::Builder;
use crate::embree::Device;
use crate::math::rows;
use crate::progress::{Progress, Watcher, timed};
use crate::ranks::Ranks;
use crate::scene::Scene;
use crate::threads::Threads;
use crate::visibility::WideTree;
use crate::{Error, Result, clusters, optics};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time;

/// How much of a model is prepared. Each level includes those before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Detail {
    /// Embree scenes: exact visibility, the path tracer, form factors.
    Rays,
    /// Cluster trees: hierarchical radiosity with exact visibility.
    Clusters,
    /// Cluster optics: multi-resolution and average visibility.
    #[default]
    Optics,
}

/// Options of [`Model::prepare`]: [`PrepareOptions::default`] with other values of some fields.
///
/// ```
/// use mrvis::{Detail, PrepareOptions};
///
/// let mut options = PrepareOptions::default();
/// options.detail = Detail::Clusters;
/// ```
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct PrepareOptions {
    /// How much is prepared; default [`Detail::Optics`], everything.
    pub detail: Detail,
    /// Threads of the preparation and of all that is asked of the model, at most 1024; 0 (default) for one a core.
    ///
    /// They form a pool of the model's own. Calls from inside a rayon pool use that pool instead. No result depends on the number.
    pub threads: usize,
    /// Algorithm that builds the clusters; default [`Builder::Grids`]. It changes what is averaged and how fast, not what exact visibility
    /// answers.
    pub builder: Builder,
    /// A folder for files of the measured clusters, so that the next preparation of the same scene reads them instead; default: no files.
    /// The folder is made if it is missing.
    pub cache: Option<PathBuf>,
    /// How clusters are built; the builder is that of `builder`.
    pub(crate) clusters: clusters::Options,
    /// How their optics are measured.
    pub(crate) optics: optics::Options,
    /// Progress of the preparation.
    pub(crate) watcher: Watcher,
}

impl PrepareOptions {
    /// Reports the preparation to `progress`, which can stop it. The model does not keep it: see [`Model::with_progress`].
    #[must_use]
    pub fn with_progress(mut self, progress: impl Progress + 'static) -> PrepareOptions {
        self.watcher = Watcher::new(progress);
        self
    }

    /// How clusters are built.
    pub(crate) fn clusters(&self) -> clusters::Options {
        clusters::Options { builder: self.builder, ..self.clusters }
    }

    /// Where measured clusters are kept.
    pub(crate) fn cache(&self) -> CacheLocation {
        self.cache.clone().map_or(CacheLocation::Off, CacheLocation::Folder)
    }
}

/// Seconds and bytes of a preparation, and where its clusters came from.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct PrepareReport {
    /// Seconds of building Embree's acceleration structures.
    pub embree_s: f64,
    /// Seconds of building the cluster trees, 0 if they were read.
    pub clusters_s: f64,
    /// Seconds of measuring optics, 0 if they were read.
    pub optics_s: f64,
    /// Seconds of looking for, reading and writing cache files.
    pub cache_s: f64,
    /// Bytes that Embree reports for the acceleration structures.
    pub embree_bytes: u64,
    /// Whether the clusters were read from a file instead of measured.
    pub from_cache: bool,
    /// Where the clusters came from.
    pub(crate) origin: Origin,
    /// Whether `origin` is that of a mesh already.
    origin_of_any: bool,
    /// What a user should know about the cache, one sentence.
    pub note: Option<String>,
}

impl PrepareReport {
    /// Counts another mesh: the clusters were read only if those of all meshes were.
    fn add_origin(&mut self, origin: Origin) {
        self.origin = match self.origin_of_any {
            true if self.origin != origin => Origin::Made,
            _ => origin,
        };
        self.origin_of_any = true;
        self.from_cache = self.origin == Origin::Hit;
    }
}

impl Model {
    /// Prepares a scene: commits the Embree scenes, builds the clusters and measures their optics, or takes the clusters from the cache.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if the installed Embree is too old, [`Error::OutOfMemory`] or [`Error::Embree`] if it fails,
    /// [`Error::Argument`] for too many threads, [`Error::Cancelled`] if the caller's progress stops the preparation.
    pub fn prepare(scene: impl Into<Arc<Scene>>, options: &PrepareOptions) -> Result<Model> {
        Model::prepare_watched(scene, options, options.watcher.progress())
    }

    /// [`Model::prepare`] that reports to a borrowed `progress`.
    ///
    /// # Errors
    /// As [`Model::prepare`].
    #[doc(hidden)]
    pub fn prepare_watched(
        scene: impl Into<Arc<Scene>>,
        options: &PrepareOptions,
        progress: &dyn Progress,
    ) -> Result<Model> {
        options.optics.check_ranges()?;
        let scene = scene.into();
        let threads = Arc::new(Threads::new(options.threads)?);
        let options = PrepareOptions { watcher: Watcher::default(), ..options.clone() };
        threads.run(|| prepare(scene, &options, &threads, progress))?
    }

    /// This model with at least as much prepared as `options` ask for. Embree scenes are kept; what is there already is not made again.
    ///
    /// # Errors
    /// As [`Model::prepare`].
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn prepared_to(&self, options: &PrepareOptions, progress: &dyn Progress) -> Result<Model> {
        if self.detail() >= options.detail {
            return Ok(self.clone());
        }
        let report = self.inner.report.clone();
        self.on_threads(|| self.prepared_further(options, progress, report))?
    }

    fn prepared_further(
        &self,
        options: &PrepareOptions,
        progress: &dyn Progress,
        mut report: PrepareReport,
    ) -> Result<Model> {
        let meshes = self.inner.meshes.iter().map(|mesh| {
            let clusters = clusters_of(&mesh.scene, options, progress, &mut report)?;
            Ok(Arc::new(Mesh::new(mesh.scene.clone(), mesh.traced.clone(), clusters)))
        });
        let meshes = meshes.collect::<Result<_>>()?;
        self.with_meshes(meshes, options, report)
    }

    /// The model that [`Model::prepare`] would make of the same scene with these options, which differ from those of this one in
    /// their detail at most. Nothing is made again, and the report has only what is made now.
    #[doc(hidden)]
    pub fn prepared_again(&self, options: &PrepareOptions, progress: &dyn Progress) -> Result<Model> {
        let PrepareReport { embree_bytes, origin, from_cache, .. } = self.inner.report;
        let report = PrepareReport { embree_bytes, ..PrepareReport::default() };
        if options.detail > self.detail() {
            return self.on_threads(|| self.prepared_further(options, progress, report))?;
        }
        let meshes = self.inner.meshes.iter().map(|mesh| match options.detail == self.detail() {
            true => mesh.clone(),
            false => Arc::new(reduced(mesh, options.detail)),
        });
        self.with_meshes(meshes.collect(), options, PrepareReport { origin, from_cache, ..report })
    }

    /// The model with other meshes in the places of its own.
    fn with_meshes(
        &self,
        meshes: Vec<Arc<Mesh>>,
        options: &PrepareOptions,
        report: PrepareReport,
    ) -> Result<Model> {
        let mut inner = Inner { meshes, options: options.clone(), report, ..self.inner.copied() };
        inner.top = top_level(&mut inner)?;
        Ok(Model { inner: Arc::new(inner), ranks: Ranks::default(), watcher: Watcher::default() })
    }
}

/// A mesh with no more than `detail`.
fn reduced(mesh: &Mesh, detail: Detail) -> Mesh {
    let trees = |clusters: &Arc<Clusters>| {
        let hierarchy = clusters.hierarchy.clone();
        Arc::new(Clusters { hierarchy, measured: None })
    };
    let clusters = match detail {
        Detail::Rays => None,
        Detail::Clusters => mesh.clusters.as_ref().map(trees),
        Detail::Optics => mesh.clusters.clone(),
    };
    Mesh::new(mesh.scene.clone(), mesh.traced.clone(), clusters)
}

/// See [`Model::prepare`]; on the threads of the caller.
fn prepare(
    scene: Arc<Scene>,
    options: &PrepareOptions,
    threads: &Arc<Threads>,
    progress: &dyn Progress,
) -> Result<Model> {
    let mut report = PrepareReport::default();
    progress.stage("building Embree's tree", 0);
    let stop = StopCheck::of(progress);
    let stopped = || stop.asked();
    let scenes: Vec<&Arc<Scene>> = std::iter::once(&scene).chain(&scene.shared).collect();
    let device = Device::for_triangles(scenes.iter().map(|scene| scene.triangles.len()).sum())?;
    let traced = timed(&mut report.embree_s, || {
        scenes.iter().map(|scene| commit(&device, scene, &stopped)).collect::<Result<Vec<_>>>()
    })?;
    let mut meshes = Vec::with_capacity(scenes.len());
    for (scene, traced) in scenes.into_iter().zip(traced) {
        let clusters = clusters_of(scene, options, progress, &mut report)?;
        meshes.push(Arc::new(Mesh::new(scene.clone(), traced, clusters)));
    }
    let instances = instances_of(&scene)?;
    let sources = (0..scene.emitters.len() as u32).map(|emitter| Source::Surface { emitter }).collect();
    let mut inner = Inner {
        device,
        meshes,
        instances,
        top: None,
        sources,
        revision: 0,
        options: options.clone(),
        report,
        scene,
        threads: threads.clone(),
        engines: Default::default(),
    };
    inner.top = top_level(&mut inner)?;
    inner.report.embree_bytes = inner.device.bytes() as u64;
    Ok(Model { inner: Arc::new(inner), ranks: Ranks::default(), watcher: Watcher::default() })
}

/// The instances of a scene: its own triangles, then its placements.
fn instances_of(scene: &Scene) -> Result<Vec<Instance>> {
    let own = Instance::own(scene.path.display().to_string());
    let placed = scene.placements.iter().map(|p| Instance {
        mesh: p.mesh + 1,
        transform: rows(&p.transform),
        material: p.material,
        name: p.name.as_str().into(),
        visible: p.visible,
        removed: false,
    });
    let instances: Vec<Instance> = std::iter::once(own).chain(placed).collect();
    for (i, instance) in instances.iter().enumerate().skip(1) {
        let mesh = if instance.mesh == 0 { scene } else { &scene.shared[instance.mesh as usize - 1] };
        instance.check(i, mesh, &scene.materials)?;
    }
    Ok(instances)
}

/// Embree scene and groups of the instances, if rays see any besides the scene's own triangles; its time counts as Embree's.
fn top_level(inner: &mut Inner) -> Result<Option<TopLevel>> {
    if is_single(&inner.instances) {
        return Ok(None);
    }
    let start = time::Instant::now();
    let top = TopLevel::build(&inner.device, &inner.meshes, &inner.instances, &inner.options.optics, None)?;
    let seconds = start.elapsed().as_secs_f64() - top.groups_s;
    inner.report.embree_s += seconds;
    inner.report.optics_s += top.groups_s;
    Ok(Some(top))
}

/// Check for cancellation of a preparation: once the caller has stopped it, the caller is not called again.
struct StopCheck<'a> {
    progress: &'a dyn Progress,
    asked: AtomicBool,
}

impl StopCheck<'_> {
    fn of(progress: &dyn Progress) -> StopCheck<'_> {
        StopCheck { progress, asked: AtomicBool::new(false) }
    }

    fn asked(&self) -> bool {
        if !self.asked.load(Ordering::Relaxed) && self.progress.stopped() {
            self.asked.store(true, Ordering::Relaxed);
        }
        self.asked.load(Ordering::Relaxed)
    }
}

/// The clusters of a mesh: built, or from the cache.
fn clusters_of(
    scene: &Scene,
    options: &PrepareOptions,
    progress: &dyn Progress,
    report: &mut PrepareReport,
) -> Result<Option<Arc<Clusters>>> {
    let how = cache::Options { clusters: options.clusters(), optics: options.optics };
    let start = time::Instant::now();
    let (mut clusters_s, mut optics_s) = (0.0, 0.0);
    let stop = StopCheck::of(progress);
    let stopped = || stop.asked();
    let cancelled = || Error::Cancelled("stopped before the clusters were measured".into());
    // No optics are measured on the coarse faces of fine ground: averaged visibility refuses it.
    let detail = if scene.fine_ground.is_some() { Detail::Clusters } else { Detail::Optics };
    let prepared = match options.detail.min(detail) {
        Detail::Rays => return Ok(None),
        // Exact visibility needs no optics: none are measured, but clusters that are kept are used.
        Detail::Clusters => {
            let (hierarchy, origin) = match cache::find(scene, &options.cache(), &how) {
                Some(kept) => (kept.hierarchy, Origin::Hit),
                None => {
                    progress.stage("building clusters", 0);
                    let build = || clusters::build_unless(scene, &how.clusters, &stopped);
                    let made = timed(&mut clusters_s, build);
                    (made.ok_or_else(cancelled)?, Origin::Off)
                }
            };
            report.add_origin(origin);
            Clusters { hierarchy: Arc::new(hierarchy), measured: None }
        }
        Detail::Optics => {
            if stopped() {
                return Err(cancelled());
            }
            progress.stage("looking for measured clusters", 0);
            let made = cache::load_or_make(scene, &options.cache(), &how, || {
                progress.stage("building clusters", 0);
                let build = || clusters::build_unless(scene, &how.clusters, &stopped);
                let hierarchy = timed(&mut clusters_s, build)?;
                progress.stage("measuring clusters", 0);
                let measure = || optics::measure_unless(scene, &hierarchy.micro, &how.optics, &stopped);
                let optics = timed(&mut optics_s, measure)?;
                Some(PreparedClusters { hierarchy, optics })
            });
            let (kept, origin, note) = made.ok_or_else(cancelled)?;
            report.add_origin(origin);
            report.note = report.note.take().or(note);
            let PreparedClusters { hierarchy, optics } = kept;
            let tree = Arc::new(timed(&mut optics_s, || WideTree::build(scene, &hierarchy, &optics)));
            let parts = optics::groups::parts(&hierarchy, &optics);
            Clusters { hierarchy: Arc::new(hierarchy), measured: Some(Measured { optics, tree, parts }) }
        }
    };
    report.clusters_s += clusters_s;
    report.optics_s += optics_s;
    report.cache_s += start.elapsed().as_secs_f64() - clusters_s - optics_s;
    Ok(Some(Arc::new(prepared)))
}
