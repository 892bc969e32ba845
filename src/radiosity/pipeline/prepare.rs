//! Prepares Embree's tree, clusters and, for engines that average, their optics.

use super::record::{Seconds, timed};
use crate::clusters::{self, Hierarchy};
use crate::embree::{CommittedScene, Device, SceneBuilder, Traversal};
use crate::model::cache::{self, PreparedClusters};
use crate::optics::{self, ClusterOptics};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::Elements;
use crate::radiosity::links::sample_bundles;
use crate::radiosity::options::{Options, Visibility};
use crate::radiosity::progress::Progress;
use crate::ray::EndRule;
use crate::scene::Scene;
use crate::visibility::{Bundle, Exact, Leaf, MultiResolution, Workspace};
use crate::{Error, Result};

/// A scene ready for the engine that was asked for.
pub struct Prepared {
    pub device: Device,
    pub traced: CommittedScene,
    pub hierarchy: Hierarchy,
    /// Measures of the clusters, if the engine needs them.
    optics: Option<Vec<ClusterOptics>>,
    /// Where clusters came from: `off`, `made` or `hit`.
    pub origin: &'static str,
    /// What a user should know about that.
    pub note: Option<String>,
}

impl Prepared {
    /// Builds everything, or takes the clusters from the cache. Exact visibility needs no measures: it makes none and keeps
    /// none, but takes clusters that are there.
    ///
    /// # Errors
    /// Embree refuses, or the time is up before clusters are measured.
    pub fn of(
        scene: &Scene,
        options: &Options,
        seconds: &mut Seconds,
        progress: &dyn Progress,
        deadline: &Deadline,
    ) -> Result<Prepared> {
        let device = Device::new(0)?;
        let traced = timed(&mut seconds.embree, || -> Result<CommittedScene> {
            let mut builder = SceneBuilder::new(&device, Default::default())?;
            builder.add_triangles(&scene.positions, &scene.triangles, 1)?;
            builder.commit()
        })?;
        let how = cache::Options::default();
        if options.visibility == Visibility::Exact {
            let (hierarchy, origin) =
                timed(&mut seconds.hierarchy, || match cache::find(scene, &options.cache, &how) {
                    Some(table) => (table.hierarchy, cache::Origin::Hit),
                    None => (clusters::build(scene, &how.clusters), cache::Origin::Off),
                });
            return Ok(Prepared {
                device,
                traced,
                hierarchy,
                optics: None,
                origin: origin.name(),
                note: None,
            });
        }
        if deadline.late() {
            return Err(too_late(options, deadline));
        }
        let (mut built, mut looked) = (0.0, 0.0);
        let (table, origin, note) = timed(&mut looked, || {
            cache::table(scene, &options.cache, &how, || {
                let hierarchy = timed(&mut built, || clusters::build(scene, &how.clusters));
                progress.stage("measuring clusters");
                let optics = optics::measure(scene, &hierarchy.micro, &how.optics);
                PreparedClusters { hierarchy, optics }
            })
        });
        seconds.hierarchy = built;
        seconds.characterise = looked - built;
        let PreparedClusters { hierarchy, optics } = table;
        Ok(Prepared { device, traced, hierarchy, optics: Some(optics), origin: origin.name(), note })
    }

    /// Exact rays.
    pub fn exact(&self) -> Exact {
        let traversal = Traversal { width: self.device.native_width(), coherent: false };
        Exact { scene: self.traced.clone(), traversal }
    }

    /// The multi-resolution engine, if one is asked for, told by bundles between surfaces what exact rays are worth.
    pub fn engine(
        &self,
        scene: &Scene,
        elements: &Elements,
        ends: EndRule,
        options: &Options,
    ) -> Option<MultiResolution> {
        let leaf = if options.visibility == Visibility::Average { Leaf::Extinction } else { Leaf::Exact };
        let Exact { scene: traced, traversal } = self.exact();
        let engine =
            MultiResolution::new(scene, &self.hierarchy, self.optics.as_deref()?, traced, traversal, leaf);
        let sample = sample_bundles(elements, ends, SAMPLE, options.seed);
        let bundles: Vec<Bundle> = sample
            .iter()
            .map(|(packet, width)| Bundle {
                packets: std::slice::from_ref(packet),
                emitter_size: *width,
                emitter: &[],
            })
            .collect();
        Some(engine.with_budget(&bundles, &mut Workspace::default()))
    }
}

fn too_late(options: &Options, deadline: &Deadline) -> Error {
    Error::Argument(match options.max_seconds {
        Some(seconds) if !deadline.interrupted() => format!(
            "`max_seconds` {seconds}: the time was up before the clusters were measured; allow more (they are kept for the \
             next run) or take `visibility` exact"
        ),
        _ => "interrupted before the clusters were measured: there is no light yet".into(),
    })
}

/// Bundles that say what exact rays are worth.
const SAMPLE: usize = 256;
