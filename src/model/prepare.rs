//! Preparation: the only place where Embree scenes of a model are committed and clusters are measured.

use super::cache::{self, Origin, Place, PreparedClusters};
use super::mesh::{Clusters, Measured, Mesh};
use super::source::Source;
use super::{Inner, Model};
use crate::embree::{CommittedScene, Device, SceneBuilder};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::visibility::WideTree;
use crate::{Error, Result, clusters, optics};
use std::sync::Arc;
use std::time::Instant;

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

/// Options of [`Model::prepare`].
#[derive(Clone, Debug, Default)]
pub struct PrepareOptions {
    /// How much is prepared.
    pub detail: Detail,
    /// How clusters are built.
    pub clusters: clusters::Options,
    /// How their optics are measured.
    pub optics: optics::Options,
    /// Where measured clusters are kept for the next run.
    pub cache: Place,
}

/// Seconds and bytes of a preparation, and where its clusters came from.
#[derive(Clone, Debug, Default, PartialEq)]
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
    /// Where the clusters came from.
    pub origin: Origin,
    /// What a user should know about the cache, one sentence.
    pub note: Option<String>,
}

impl PrepareReport {
    /// Seconds of the whole preparation.
    pub fn seconds(&self) -> f64 {
        self.embree_s + self.clusters_s + self.optics_s + self.cache_s
    }
}

impl Model {
    /// Prepares a scene: commits the Embree scenes, builds the clusters and measures their optics, or takes the clusters from
    /// the cache.
    ///
    /// # Errors
    /// Embree refuses; [`Error::Cancelled`] if `progress` stops the preparation before optics are measured.
    pub fn prepare(
        scene: impl Into<Arc<Scene>>,
        options: &PrepareOptions,
        progress: &dyn Progress,
    ) -> Result<Model> {
        let scene = scene.into();
        let mut report = PrepareReport::default();
        let device = Device::new(0)?;
        progress.stage("building Embree's tree", 0);
        let traced = timed(&mut report.embree_s, || commit(&device, &scene))?;
        report.embree_bytes = device.bytes() as u64;
        let clusters = clusters_of(&scene, options, progress, &mut report)?;
        let sources = (0..scene.emitters.len() as u32).map(|emitter| Source::Surface { emitter }).collect();
        let meshes = vec![Arc::new(Mesh { scene: scene.clone(), traced, clusters })];
        Ok(Model { inner: Arc::new(Inner { scene, device, meshes, sources, revision: 0, report }) })
    }

    /// This model with at least as much prepared as `options` ask for. Embree scenes are kept; what is there already is not
    /// made again.
    ///
    /// # Errors
    /// As [`Model::prepare`].
    pub fn prepared_to(&self, options: &PrepareOptions, progress: &dyn Progress) -> Result<Model> {
        if self.detail() >= options.detail {
            return Ok(self.clone());
        }
        let mut report = self.inner.report.clone();
        let meshes = self.inner.meshes.iter().map(|mesh| {
            let clusters = clusters_of(&mesh.scene, options, progress, &mut report)?;
            Ok(Arc::new(Mesh { scene: mesh.scene.clone(), traced: mesh.traced.clone(), clusters }))
        });
        let meshes = meshes.collect::<Result<_>>()?;
        let Inner { scene, device, sources, revision, .. } = &*self.inner;
        Ok(Model {
            inner: Arc::new(Inner {
                scene: scene.clone(),
                device: device.clone(),
                meshes,
                sources: sources.clone(),
                revision: *revision,
                report,
            }),
        })
    }
}

/// The Embree scene of the triangles of a mesh.
fn commit(device: &Device, scene: &Scene) -> Result<CommittedScene> {
    let mut builder = SceneBuilder::new(device, Default::default())?;
    builder.add_triangles(&scene.positions, &scene.triangles, 1)?;
    builder.commit()
}

/// The clusters of a mesh: built, or from the cache.
fn clusters_of(
    scene: &Scene,
    options: &PrepareOptions,
    progress: &dyn Progress,
    report: &mut PrepareReport,
) -> Result<Option<Arc<Clusters>>> {
    let how = cache::Options { clusters: options.clusters, optics: options.optics };
    let start = Instant::now();
    let (mut clusters_s, mut optics_s) = (0.0, 0.0);
    let prepared = match options.detail {
        Detail::Rays => return Ok(None),
        // Exact visibility needs no optics: none are measured, but clusters that are kept are used.
        Detail::Clusters => {
            let (hierarchy, origin) = match cache::find(scene, &options.cache, &how) {
                Some(kept) => (kept.hierarchy, Origin::Hit),
                None => {
                    let made = timed(&mut clusters_s, || clusters::build(scene, &how.clusters));
                    (made, Origin::Off)
                }
            };
            report.origin = origin;
            Clusters { hierarchy: Arc::new(hierarchy), measured: None }
        }
        Detail::Optics => {
            if progress.stopped() {
                return Err(Error::Cancelled("stopped before the clusters were measured".into()));
            }
            progress.stage("looking for measured clusters", 0);
            let (kept, origin, note) = cache::table(scene, &options.cache, &how, || {
                progress.stage("building clusters", 0);
                let hierarchy = timed(&mut clusters_s, || clusters::build(scene, &how.clusters));
                progress.stage("measuring clusters", 0);
                let optics = timed(&mut optics_s, || optics::measure(scene, &hierarchy.micro, &how.optics));
                PreparedClusters { hierarchy, optics }
            });
            (report.origin, report.note) = (origin, note);
            let PreparedClusters { hierarchy, optics } = kept;
            let tree = Arc::new(timed(&mut optics_s, || WideTree::build(scene, &hierarchy, &optics)));
            Clusters { hierarchy: Arc::new(hierarchy), measured: Some(Measured { optics, tree }) }
        }
    };
    report.clusters_s += clusters_s;
    report.optics_s += optics_s;
    report.cache_s += start.elapsed().as_secs_f64() - clusters_s - optics_s;
    Ok(Some(Arc::new(prepared)))
}

/// The result of `make`; its seconds are added to `seconds`.
fn timed<R>(seconds: &mut f64, make: impl FnOnce() -> R) -> R {
    let start = Instant::now();
    let result = make();
    *seconds += start.elapsed().as_secs_f64();
    result
}
