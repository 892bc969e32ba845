//! What must stand before the engines can be asked: Embree's tree, the clusters, their measures.

use super::options::Options;
use super::progress::Progress;
use super::record::{Build, BytesPerTriangle};
use super::rows::Bench;
use super::sample::Sample;
use super::workload::Workload;
use crate::Result;
use crate::clusters;
use crate::embree::{CommittedScene, Device, SceneBuilder};
use crate::model::cache::{self, PreparedClusters};
use crate::optics;
use crate::scene::Scene;
use crate::visibility::{Leaf, MultiResolution, Workspace};
use std::time::Instant;

/// A scene ready for both engines.
pub(super) struct Prepared {
    pub device: Device,
    pub traced: CommittedScene,
    pub table: PreparedClusters,
    /// Times and sizes of all this.
    pub build: Build,
}

impl Prepared {
    /// Builds everything, or takes the clusters from the cache.
    ///
    /// # Errors
    /// Embree refuses.
    pub fn of(scene: &Scene, options: &Options, progress: &dyn Progress) -> Result<Prepared> {
        let mut build = Build::default();
        let device = Device::new(0)?;
        progress.stage("Embree's tree", 0);
        let traced = timed(&mut build.embree_s, || -> Result<CommittedScene> {
            let mut builder = SceneBuilder::new(&device, Default::default())?;
            builder.add_triangles(&scene.positions, &scene.triangles, 1)?;
            builder.commit()
        })?;
        build.embree_bytes = device.bytes() as u64;
        let table = table(scene, options, &mut build, progress);
        Ok(Prepared { device, traced, table, build })
    }
}

/// Clusters and their measures: made, or from the cache.
fn table(scene: &Scene, options: &Options, build: &mut Build, progress: &dyn Progress) -> PreparedClusters {
    let how = cache::Options { optics: options.clusters, ..Default::default() };
    let start = Instant::now();
    progress.stage("looking for measured clusters", 0);
    let (table, origin, note) = cache::table(scene, &options.cache, &how, || {
        progress.stage("hierarchy", 0);
        let hierarchy = timed(&mut build.hierarchy_s, || clusters::build(scene, &how.clusters));
        progress.stage("measuring clusters", 0);
        let optics =
            timed(&mut build.characterise_s, || optics::measure(scene, &hierarchy.micro, &how.optics));
        PreparedClusters { hierarchy, optics }
    });
    build.cache_s = start.elapsed().as_secs_f64() - build.hierarchy_s - build.characterise_s;
    (build.cache, build.cache_note) = (origin.name().into(), note);
    table
}

impl Bench<'_> {
    /// What is decided on for a workload, large enough for every row.
    pub fn sample(&self, workload: &Workload) -> Sample {
        Sample::of(self.scene, workload, &self.mr_rays())
    }

    /// The multi-resolution engine for a workload; notes its times and sizes.
    pub fn engine(
        &self,
        table: &PreparedClusters,
        workload: &Workload,
        sample: &Sample,
        build: &mut Build,
    ) -> MultiResolution {
        let Bench { scene, options, traced, .. } = self;
        let PreparedClusters { hierarchy, optics } = table;
        let traversal = timed(&mut build.budget_s, || self.traversal(workload, options.rays));
        let engine =
            MultiResolution::new(scene, hierarchy, optics, (*traced).clone(), traversal, Leaf::Exact)
                .with_tolerance(options.clusters.tolerance);
        let engine = timed(&mut build.budget_s, || {
            engine.with_budget(&sample.bundles(1).concat(), &mut Workspace::default())
        });
        let clusters = hierarchy.micro.bytes() + hierarchy.large.bytes();
        let [optics, wide] = [size_of_val(optics.as_slice()), engine.bytes()];
        build.hierarchy_bytes = (clusters + optics + wide) as u64;
        build.bytes_per_triangle = BytesPerTriangle::of(
            scene.triangles.len(),
            [scene.bytes(), clusters, optics, wide, build.embree_bytes as usize],
        );
        engine
    }
}

/// The result and, added up, the seconds it took.
pub(super) fn timed<R>(seconds: &mut f64, make: impl FnOnce() -> R) -> R {
    let start = Instant::now();
    let result = make();
    *seconds += start.elapsed().as_secs_f64();
    result
}
