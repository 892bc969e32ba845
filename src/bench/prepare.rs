//! The MR engine of a benchmark, and times and sizes of the preparation.

use super::context::Bench;
use super::options::BenchOptions;
use super::record::{Build, BytesPerTriangle};
use super::sample::{Extent, Sample};
use super::workload::{Workload, surface_points};
use crate::model::{Detail, PrepareOptions};
use crate::model::{Mesh, Model};
use crate::progress::timed;
use crate::ray::LANES;
use crate::visibility::{Candidate, DistanceCut, LeafMode, MultiResolution, Workspace};
use std::sync::Arc;

impl BenchOptions {
    /// Options of [`Model::prepare`] for a benchmark with these options.
    #[doc(hidden)]
    pub fn prepare(&self) -> PrepareOptions {
        PrepareOptions {
            detail: Detail::Optics,
            builder: self.builder,
            optics: self.clusters,
            cache: self.cache.folder(),
            ..PrepareOptions::default()
        }
    }
}

/// Times and sizes of the preparation of a model.
pub(super) fn build_of(model: &Model) -> Build {
    let report = model.report();
    Build {
        embree_s: report.embree_s,
        builder: model.cluster_options().builder.name().into(),
        hierarchy_s: report.clusters_s,
        characterise_s: report.optics_s,
        cache_s: report.cache_s,
        cache: report.origin.name().into(),
        cache_note: report.note.clone(),
        embree_bytes: report.embree_bytes,
        ..Build::default()
    }
}

/// Points of the workload on which the cut of a scene under a sky is fitted: more than the receivers of its pilot.
const CUT_POINTS: usize = 1 << 14;
/// Step between the pairs of receivers with successive numbers, a prime near to a golden section of their number, so that any of them are
/// spread over the scene.
const RECEIVER_STRIDE: usize = 40_487;
/// Sample sets of these receivers: others use 0 to 11.
const CUT_STREAMS: [u64; 2] = [12, 13];

impl Bench<'_> {
    /// The distance cut, fitted on segments to suns and patches of the sky, too; none where the cut does not pay. Unlike [`Model::cut`] it
    /// may exist in a scene without emitters.
    fn cut_under_a_sky(&self) -> Option<Arc<DistanceCut>> {
        if self.model.instances().len() > 1 {
            return None;
        }
        let points = surface_points(self.model, CUT_POINTS, self.options.seed ^ 0x63_7574).ok()?;
        let workload = Workload::new(self.model, points, self.options.seed);
        let hulls: Vec<_> = (0..workload.pairs.len()).map(|pair| workload.hull(pair)).collect();
        let candidate = |k: u32| {
            let pair = (k as usize).wrapping_mul(RECEIVER_STRIDE) % workload.pairs.len().max(1);
            let emitter_size = workload.pairs.get(pair)?.emitter_size;
            let packets = CUT_STREAMS.map(|stream| {
                let mut packets = Vec::with_capacity(1);
                workload.add_bundle(self.scene, pair, LANES, stream, &mut packets);
                packets.swap_remove(0)
            });
            let forwards = packets.iter().all(|packet| packet.backwards == 0);
            forwards.then(|| Candidate { packets, emitter_size, emitter: &hulls[pair] })
        };
        DistanceCut::fitted(self.scene, candidate, &self.model.exact()).map(Arc::new)
    }

    /// Sample of the workload for the decisions of all rows.
    pub fn sample(&self, workload: &Workload) -> Sample {
        let exact = self.model.exact();
        let sample = Sample::of(self.scene, workload, &self.mr_rays(), Extent::POINTS, &exact);
        sample.with_mean(self.scene, workload, &exact)
    }

    /// The MR engine for a workload. Writes its times and sizes to `build`.
    pub fn engine(&self, workload: &Workload, sample: &Sample, build: &mut Build) -> MultiResolution {
        let Bench { model, options, .. } = self;
        let traversal = timed(&mut build.budget_s, || self.traversal(workload, options.rays));
        let engine = model.engine(traversal, LeafMode::Exact).expect("a benchmark prepares optics");
        let engine = timed(&mut build.budget_s, || {
            engine.with_budget(&sample.bundles(1).concat(), &mut Workspace::default())
        });
        let cut = timed(&mut build.characterise_s, || match workload.is_under_a_sky() {
            true => self.cut_under_a_sky(),
            false => model.cut(),
        });
        let engine = engine.with_cut(cut);
        let all = |of: &dyn Fn(&Mesh) -> usize| model.meshes().iter().map(|mesh| of(mesh)).sum::<usize>();
        let clusters = all(&|mesh| mesh.hierarchy().micro.bytes() + mesh.hierarchy().large.bytes());
        let optics = all(&|mesh| mesh.measured().map_or(0, |m| size_of_val(m.optics.as_slice())));
        let (optics, wide) = (optics + model.group_bytes(), engine.bytes() + engine.cut_bytes());
        build.hierarchy_bytes = (clusters + optics + wide) as u64;
        build.bytes_per_triangle = BytesPerTriangle::of(
            all(&|mesh| mesh.scene().triangles.len()),
            [model.scene().bytes(), clusters, optics, wide, build.embree_bytes as usize],
        );
        engine
    }
}
