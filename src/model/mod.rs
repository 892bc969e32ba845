//! The prepared model: meshes, sources and everything that is computed once for a scene and shared by all queries.
//!
//! A [`Model`] is made from a [`Scene`] by [`Model::prepare`], is immutable, and is cheap to clone and to send between threads: clones
//! share their parts by reference counts. Visibility, the radiosity solver, the path tracer and form factors all take a `&Model`.

pub mod cache;
mod cut;
mod emitter_notes;
mod engines;
mod instance;
mod mesh;
mod places;
mod precision_notes;
mod prepare;
pub mod summary;
#[cfg(test)]
pub mod testing;
#[cfg(test)]
mod tests;
mod top_level;
mod update;

use crate::embree::{CommittedScene, Device, Hits, Traversal};
use crate::math::Aabb;
use crate::progress::{Progress, Watcher};
use crate::ranks::Ranks;
use crate::ray::{EndRule, Packet};
use crate::scene::{FineGround, Scene, magnitude};
use crate::threads::Threads;
use crate::visibility::{Engine, LeafMode, MultiResolution};
use crate::{Error, Result};
use engines::Engines;
use glam::Vec3;
pub use instance::{Instance, InstanceChange};
pub use mesh::Mesh;
pub(crate) use mesh::face_magnitudes;
pub(crate) use places::SurfaceSearch;
pub use prepare::{Detail, PrepareOptions, PrepareReport};
use std::sync::Arc;
use top_level::TopLevel;

/// Version of the installed Embree, `4.a.b`.
///
/// # Errors
/// It does not suit this program, or fails.
pub fn embree_version() -> Result<String> {
    Ok(Device::new(1)?.version())
}

/// A scene prepared for queries.
#[derive(Clone)]
pub struct Model {
    inner: Arc<Inner>,
    ranks: Ranks,
    /// Progress of the calls of this handle.
    watcher: Watcher,
}

struct Inner {
    scene: Arc<Scene>,
    device: Device,
    /// The first mesh holds the scene's own triangles.
    meshes: Vec<Arc<Mesh>>,
    /// The first instance places the first mesh as it is.
    instances: Vec<Instance>,
    /// Embree scene and groups of the instances; none if rays see only the first instance.
    top: Option<TopLevel>,
    sources: Vec<Source>,
    revision: u64,
    options: PrepareOptions,
    report: PrepareReport,
    threads: Arc<Threads>,
    engines: Engines,
}

impl Inner {
    /// A copy for changes: engines that are kept between queries are made again.
    fn copied(&self) -> Inner {
        Inner {
            scene: self.scene.clone(),
            device: self.device.clone(),
            meshes: self.meshes.clone(),
            instances: self.instances.clone(),
            top: None,
            sources: self.sources.clone(),
            revision: self.revision,
            options: self.options.clone(),
            report: self.report.clone(),
            threads: self.threads.clone(),
            engines: Engines::default(),
        }
    }
}

impl Model {
    /// The scene that was prepared.
    pub fn scene(&self) -> &Scene {
        &self.inner.scene
    }

    /// The scene that was prepared, shared.
    #[doc(hidden)]
    pub fn shared_scene(&self) -> Arc<Scene> {
        self.inner.scene.clone()
    }

    /// The meshes; the first holds the scene's own triangles.
    pub(crate) fn meshes(&self) -> &[Arc<Mesh>] {
        &self.inner.meshes
    }

    /// The mesh of the scene's own triangles.
    #[doc(hidden)]
    pub fn base(&self) -> &Mesh {
        &self.inner.meshes[0]
    }

    /// The processes that share queries of this model; one alone unless [`Model::on_ranks`] says otherwise.
    pub(crate) fn ranks(&self) -> &Ranks {
        &self.ranks
    }

    /// The same model, of which each of these processes has prepared an equal one: they share its queries.
    #[doc(hidden)]
    pub fn on_ranks(self, ranks: Ranks) -> Model {
        Model { ranks, ..self }
    }

    /// The same model, whose calls report to `progress` and can be stopped by it: `model.with_progress(bar).solve(&options)`.
    /// Clones and [`Model::visibility`] keep it; models, solutions and form factors that are computed do not.
    #[must_use]
    pub fn with_progress(&self, progress: impl Progress + 'static) -> Model {
        Model { watcher: Watcher::new(progress), ..self.clone() }
    }

    /// The same model without progress.
    pub(crate) fn unwatched(&self) -> Model {
        Model { watcher: Watcher::default(), ..self.clone() }
    }

    /// The progress that computations report to.
    pub(crate) fn progress(&self) -> &dyn Progress {
        self.watcher.progress()
    }

    /// Light sources.
    pub fn sources(&self) -> &[Source] {
        &self.inner.sources
    }

    /// Counts updates: 0 after [`Model::prepare`].
    pub fn revision(&self) -> u64 {
        self.inner.revision
    }

    /// Seconds, bytes and cache of the preparation.
    pub fn report(&self) -> &PrepareReport {
        &self.inner.report
    }

    /// How the optics of clusters were measured.
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn optics_options(&self) -> crate::optics::Options {
        self.inner.options.optics
    }

    /// How clusters were built.
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn cluster_options(&self) -> crate::clusters::Options {
        self.inner.options.clusters()
    }

    /// Whether the model has one thread, so that work runs on the calling thread.
    pub(crate) fn has_one_thread(&self) -> bool {
        self.inner.threads.count() == 1
    }

    /// Does `work` on the threads of [`PrepareOptions::threads`], or of the rayon pool that the caller is in: many single queries
    /// in parallel, for example. All clones and updates of a model share one pool, which is built when it is first needed.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] if the threads cannot be started.
    pub fn on_threads<R: Send>(&self, work: impl FnOnce() -> R + Send) -> Result<R> {
        self.inner.threads.run(work)
    }

    /// Level of detail that is prepared.
    pub fn detail(&self) -> Detail {
        match &self.base().clusters {
            None => Detail::Rays,
            Some(clusters) if clusters.measured.is_none() => Detail::Clusters,
            Some(_) => Detail::Optics,
        }
    }

    /// The instances. The first places the scene's own triangles; indices do not change when others are removed.
    pub fn instances(&self) -> &[Instance] {
        &self.inner.instances
    }

    /// The geometry and materials that an instance places, in the frame of its mesh.
    pub(crate) fn mesh_of(&self, instance: u32) -> &Scene {
        &self.inner.meshes[self.inner.instances[instance as usize].mesh as usize].scene
    }

    /// Number of triangles that rays see, each as often as it is placed.
    pub(crate) fn visible_triangles(&self) -> u64 {
        let present =
            (0..self.inner.instances.len() as u32).filter(|&i| self.instances()[i as usize].is_present());
        present.map(|i| self.mesh_of(i).triangles.len() as u64).sum()
    }

    /// Bytes of the boxes that groups of instances are measured on; 0 without placed meshes.
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn group_bytes(&self) -> usize {
        let groups = self.inner.top.as_ref().and_then(|top| top.groups.as_ref());
        let parts =
            self.meshes().iter().filter_map(|mesh| mesh.measured()).map(|measured| measured.part_bytes());
        groups.map_or(0, |_| parts.sum())
    }

    /// Memory of what was prepared, bytes; the scene is not in it.
    #[doc(hidden)]
    pub fn bytes(&self) -> u64 {
        let clusters: usize = self.meshes().iter().map(|mesh| mesh.cluster_bytes()).sum();
        self.report().embree_bytes + clusters as u64
    }

    /// The Embree scene that holds all geometry.
    pub(crate) fn traced(&self) -> &CommittedScene {
        self.inner.top.as_ref().map_or(&self.base().traced, |top| &top.traced)
    }

    /// A multi-resolution engine over all instances, if optics were prepared. What it hands over is traced by `traversal`.
    #[doc(hidden)]
    pub fn engine(&self, traversal: Traversal, leaf: LeafMode) -> Option<MultiResolution> {
        let tree = self.base().measured()?.tree.clone();
        let groups = self.inner.top.as_ref().and_then(|top| top.groups.as_ref());
        let engine = MultiResolution::new(tree, self.traced().clone(), traversal, leaf)
            .with_tolerance(self.inner.options.optics.tolerance);
        Some(engine.with_instances(groups.cloned(), self.magnitude()))
    }

    /// Refuses models in which rays see placed meshes: `what` needs triangles, not instances.
    ///
    /// # Errors
    /// [`Error::Scene`] that names the cure.
    pub(crate) fn check_single(&self, what: &str) -> Result<()> {
        match self.instances().iter().skip(1).filter(|instance| instance.is_present()).count() {
            0 => Ok(()),
            n => Err(Error::Scene(format!(
                "{what} does not work on placed meshes, and ⟨model⟩ has {n}: prepare ⟨Scene::flattened⟩",
            ))),
        }
    }

    /// Refuses models with a terrain that rays meet more finely than its faces: `what` needs the faces themselves, or clusters of them.
    ///
    /// # Errors
    /// [`Error::Scene`] that names the cure.
    pub(crate) fn check_clusters(&self, what: &str) -> Result<()> {
        match &self.scene().fine_ground {
            None => Ok(()),
            Some(ground) => Err(Error::Scene(format!(
                "{what} takes terrains of up to {} samples, and this one has {}: make its grid coarser, or solve it with exact visibility",
                FineGround::MAX_TRIANGLES / 2,
                ground.samples.len()
            ))),
        }
    }

    /// Resolves [`Engine::Automatic`]; returns other engines unchanged. `sized`: whether a feature size is given.
    pub(crate) fn chosen(&self, engine: Engine, sized: bool) -> Engine {
        let averages = || self.detail() == Detail::Optics && self.scene().fine_ground.is_none();
        match engine {
            Engine::Automatic if sized && averages() => Engine::MultiResolution,
            Engine::Automatic => Engine::Exact,
            engine => engine,
        }
    }

    /// Box around everything that rays see, relative to `Scene::origin`.
    pub(crate) fn bounds(&self) -> Aabb {
        self.inner.top.as_ref().map_or(self.scene().bounds, |top| top.bounds)
    }

    /// Incoherent packets of the widest kind that Embree traces natively on this machine.
    #[doc(hidden)]
    pub fn widest_packets(&self) -> Traversal {
        Traversal { width: self.native_width(), coherent: false }
    }

    /// Rays in the widest packet that Embree traces natively on this machine: 16, 8, 4 or 1.
    pub(crate) fn native_width(&self) -> usize {
        self.inner.device.native_width()
    }

    /// The Embree library's version, `4.a.b`.
    pub fn embree_version(&self) -> String {
        self.inner.device.version()
    }

    /// Largest coordinate magnitude, scene units: the scale of rounding errors.
    #[doc(hidden)]
    pub fn magnitude(&self) -> f32 {
        self.bounds().magnitude()
    }

    /// The rule of an end on a face of an instance.
    pub(crate) fn end_on(&self, instance: u32, triangle: u32) -> EndRule {
        let placed = &self.inner.instances[instance as usize];
        EndRule::new(placed.magnitude_of(&self.inner.meshes[placed.mesh as usize], triangle))
    }

    /// See [`Scene::stack_distance`]; scene units.
    pub(crate) fn stack_distance(&self, instance: u32, triangle: u32) -> f32 {
        let placed = &self.inner.instances[instance as usize];
        placed.scale() * self.inner.meshes[placed.mesh as usize].scene().stack_distance(triangle)
    }

    /// The largest of these distances of all instances, scene units.
    pub(crate) fn largest_stack_distance(&self) -> f32 {
        let of_mesh: Vec<f32> =
            self.inner.meshes.iter().map(|mesh| mesh.scene().largest_stack_distance()).collect();
        let scaled = |placed: &Instance| placed.scale() * of_mesh[placed.mesh as usize];
        self.inner.instances.iter().map(scaled).fold(0.0, f32::max)
    }

    /// The rule of an end at a given point of a surface that is not known: that of the faces which a line through the point meets so
    /// near to it that a segment would leave them out, and of the point's own coordinates. Where these are no less than a sixteenth of
    /// the scene's largest, the rule of the whole scene.
    pub(crate) fn end_at(&self, at: Vec3, along: Vec3) -> EndRule {
        let (whole, own) = (self.end_rule(), EndRule::new(magnitude([at])));
        if own.is_close_to(whole) {
            return whole;
        }
        let faces = [1.0f32, -1.0].into_iter().filter_map(|side| {
            let mut packet = Packet::EMPTY;
            packet.set_ray(0, at, side * along);
            packet.far[0] = whole.left_out();
            let mut hits = [Hits::NONE];
            self.traced().first_hits(self.widest_packets(), &[packet], &mut hits);
            let [Hits { triangle, instance, t }] = hits;
            let face = (triangle[0] != Hits::NO_HIT).then(|| self.end_on(instance[0], triangle[0]));
            face.filter(|rule| t[0] <= rule.left_out())
        });
        faces.fold(own, |all, rule| if rule.slack() > all.slack() { rule } else { all })
    }

    /// An end rule that holds on all faces.
    #[doc(hidden)]
    pub fn end_rule(&self) -> EndRule {
        EndRule::new(self.magnitude())
    }
}

/// A source of light.
///
/// Sky and sun will be variants of their own: they have no area and lie at infinity, so that code which matches must not assume a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Source {
    /// An emissive surface of the scene's own triangles.
    Surface {
        /// Index into [`Scene::emitter_names`](crate::Scene::emitter_names).
        emitter: u32,
    },
}
