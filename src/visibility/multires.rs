//! Multi-resolution visibility [SD95 sec 3.2]: the engine, which combines walks, frontiers and exact rays by Embree.

use super::answer::{Answer, Bundle, Cost, Method, interval, wilson};
use super::bundle_walks::{BundleWalks, Sizes, Walker, Workspace};
use super::cost_model::{CostModel, Work};
use super::cut::DistanceCut;
use super::exact::Exact;
use super::instance_tree::InstanceTree;
use super::wide::WideTree;
use crate::embree::{CommittedScene, Traversal};
use crate::optics;
#[cfg(test)]
use crate::ray::Packet;
use crate::simd::{Isa, LANES, dispatch};
use std::sync::Arc;

/// How a batch of bundles is answered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Route {
    /// Exact rays.
    Exact,
    /// Exact rays, and no rays for bundles whose answer is certain: their shaft is empty, or a single triangle covers it.
    Certified,
    /// Walks of the clusters by bundles.
    Walks {
        /// Factor of all extinctions: clusters along a segment are not independent, so that products of their transmittances have a
        /// biased mean.
        factor: f32,
    },
    /// The distance cut in one of its modes, by number, and exact rays for bundles that it does not take.
    Cut(usize),
}

impl Route {
    /// Walks with the extinctions of the clusters.
    pub const WALKS: Route = Route::Walks { factor: 1.0 };

    /// Factor of all extinctions of walks.
    pub(super) fn factor(self) -> f32 {
        match self {
            Route::Walks { factor } => factor,
            Route::Exact | Route::Certified | Route::Cut(_) => 1.0,
        }
    }
}

/// Treatment of leaves that the umbra criterion opens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LeafMode {
    /// Its triangles are tested.
    #[default]
    Exact,
    /// The leaf transmits according to its extinction: the paper's average visibility [SD95 sec 5]. Leaves that hold faces of
    /// emitters are tested: segments end on these, and a surface does not block its own light.
    Average,
}

/// Trees larger than this count [`super::wide::FETCH_WORK`] for every node, bytes: twice the 32 MiB last-level cache of the
/// processor that was measured (an AMD EPYC; `lscpu`). Not read from the machine: choices of engines must not depend on
/// it.
const CACHE_BYTES: usize = 64 << 20;
/// Fraction of the distance between Fréchet's bounds that counts as model error: clusters are neither independent nor
/// perfectly correlated. With 0, 0.1, 0.3 and 1 the stated intervals hold 98.7 %, 99.2 %, 99.4 % and 99.8 % of the
/// exact fractions in a forest at a feature size of 1 m (`constants.py bench`).
const DEPENDENCE_FRACTION: f32 = 0.1;
/// The multi-resolution engine: the wide tree, and the scene in Embree for bundles handed over.
#[derive(Clone)]
pub struct MultiResolution {
    tree: Arc<WideTree>,
    /// Placed meshes beside the model's own triangles.
    instances: Option<Arc<InstanceTree>>,
    exact: CommittedScene,
    traversal: Traversal,
    magnitude: f32,
    leaf: LeafMode,
    isa: Isa,
    cost: CostModel,
    /// Whether all trees together are larger than the caches near a core.
    far: bool,
    /// Tolerance of the transmittance that feature sizes were measured for.
    tolerance: f32,
    /// The distance cut, if the model has one.
    pub(super) cut: Option<Arc<DistanceCut>>,
    /// How bundles are answered.
    pub(super) route: Route,
}

impl MultiResolution {
    /// The engine over the clusters of a scene. `exact` is the whole scene in Embree, traced with `traversal` for
    /// bundles that are handed over.
    pub fn new(
        tree: Arc<WideTree>,
        exact: CommittedScene,
        traversal: Traversal,
        leaf: LeafMode,
    ) -> MultiResolution {
        MultiResolution {
            far: tree.bytes() > CACHE_BYTES,
            magnitude: tree.magnitude,
            tree,
            instances: None,
            exact,
            traversal,
            leaf,
            isa: Isa::detect(),
            cost: CostModel::UNCALIBRATED,
            tolerance: optics::Options::default().tolerance,
            cut: None,
            route: Route::WALKS,
        }
    }

    /// Adds placed meshes, if there are any, to the model's own triangles; `magnitude` is the largest coordinate magnitude of both.
    #[must_use]
    pub fn with_instances(mut self, instances: Option<Arc<InstanceTree>>, magnitude: f32) -> Self {
        (self.instances, self.magnitude) = (instances, magnitude);
        self.far = self.bytes() > CACHE_BYTES;
        self
    }

    /// Sets the [`optics::Options::tolerance`] that the optics were measured with, which determines stated intervals.
    #[must_use]
    pub fn with_tolerance(mut self, tolerance: f32) -> Self {
        self.tolerance = tolerance;
        self
    }

    /// Selects another instruction set; unavailable ones are replaced by portable code.
    #[cfg(test)]
    #[must_use]
    pub fn with_isa(mut self, isa: Isa) -> Self {
        self.isa = if isa.available() { isa } else { Isa::Portable };
        self
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Size of the traversal structure in bytes: the trees of all meshes, each once, and the groups of instances.
    pub fn bytes(&self) -> usize {
        let placed =
            self.instances.as_ref().map_or(0, |instances| instances.bytes() + instances.mesh_bytes());
        self.tree.bytes() + placed
    }

    /// The visible fraction of a bundle for feature size `s` on the receiver (scene units, finite, positive).
    pub fn answer(&self, bundle: Bundle, s: f32, workspace: &mut Workspace) -> Answer {
        let mut answer = None;
        self.answers(&[bundle], s, workspace, |a| answer = Some(a));
        answer.expect("one bundle, one answer")
    }

    /// The visible fractions of several bundles by walks alone, passed to `each` in order; see [`MultiResolution::answers`].
    pub fn walked_answers(
        &self,
        bundles: &[Bundle],
        s: f32,
        workspace: &mut Workspace,
        each: impl FnMut(Answer),
    ) {
        // Without exact rays walks have no limit.
        self.walk_all(bundles, Sizes::All(s), self.leaf == LeafMode::Exact, workspace);
        self.finish_all(bundles, workspace, each);
    }

    /// The visible fractions of several bundles without aggregation: exact visibility with certificates.
    ///
    /// A bundle whose shaft is empty is clear, one whose shaft a single triangle covers is blocked, both without rays
    /// (docs/method.md, Certificates and intervals). Of the rest, few triangles are tested against all segments at
    /// once; with many, Embree traces the bundle.
    pub fn certified(&self, bundles: &[Bundle], workspace: &mut Workspace, each: impl FnMut(Answer)) {
        self.walk_all(bundles, Sizes::Nothing, true, workspace);
        self.finish_all(bundles, workspace, each);
    }

    /// The answers of walks, or those of Embree where walks were abandoned.
    fn finish_all(&self, bundles: &[Bundle], workspace: &mut Workspace, mut each: impl FnMut(Answer)) {
        bundles.iter().enumerate().for_each(|(k, bundle)| each(self.finish(*bundle, k, workspace)));
    }

    /// The visible fraction of a bundle by exact rays; for bundles for which [`MultiResolution::pays`] is false.
    pub fn hand_over(&self, bundle: Bundle, workspace: &mut Workspace) -> Answer {
        let mut answer = self.exact().answer(bundle, &mut workspace.buffers.blocked);
        answer.cost.handed_over = answer.cost.segments;
        answer
    }

    /// Estimates the work of exact rays for bundles like `sample`; walks with more work are handed to Embree.
    ///
    /// Counts work instead of time, so that results do not vary between runs. Embree's work is about proportional to
    /// the square root of the work of testing everything in the shaft.
    #[must_use]
    pub fn with_budget(mut self, sample: &[Bundle], workspace: &mut Workspace) -> Self {
        let everything = sample.iter().filter(|b| !b.packets.is_empty()).map(|bundle| {
            let one = Bundle { packets: &bundle.packets[..1], ..*bundle };
            self.walk_all(&[one], Sizes::Nothing, false, workspace);
            workspace.walked[0].work
        });
        self.cost = self.cost.calibrated(everything);
        self
    }

    /// Work for a run of bundles with individual feature sizes, by this engine and by exact rays. The sum over some runs decides
    /// between the engines, [`Work::is_clearly_less`].
    pub fn work(&self, run: &[Bundle], sizes: &[f32], workspace: &mut Workspace) -> Work {
        self.walk_all(run, Sizes::Each(sizes), true, workspace);
        self.walked_work(run, workspace)
    }

    /// The same for [`MultiResolution::certified`].
    pub fn certified_work(&self, run: &[Bundle], workspace: &mut Workspace) -> Work {
        self.walk_all(run, Sizes::Nothing, true, workspace);
        self.walked_work(run, workspace)
    }

    /// Estimated work of exact rays for a bundle, in units of work of walks.
    pub(super) fn rays_of(&self, bundle: &Bundle) -> u64 {
        self.cost.rays(bundle)
    }

    fn walked_work(&self, run: &[Bundle], workspace: &Workspace) -> Work {
        let mut work = Work::default();
        for (bundle, walked) in run.iter().zip(&workspace.walked) {
            work.add(self.cost.of(bundle, walked));
        }
        work
    }

    /// Never hands bundles over, for tests of the engine's own answers.
    #[cfg(test)]
    pub(super) fn with_patience(mut self) -> Self {
        self.cost = CostModel::UNLIMITED;
        self
    }

    fn walk_all(&self, bundles: &[Bundle], sizes: Sizes, bounded: bool, workspace: &mut Workspace) {
        let engine = Walker {
            tree: &self.tree,
            instances: self.instances.as_deref(),
            magnitude: self.magnitude,
            average: self.leaf == LeafMode::Average,
            factor: self.route.factor(),
            far: self.far,
            tolerance: self.tolerance,
            cost: self.cost,
        };
        dispatch(self.isa, BundleWalks { engine, bundles, sizes, bounded, workspace });
    }

    /// The answer of a walk, or that of Embree if the walk was abandoned.
    fn finish(&self, bundle: Bundle, k: usize, workspace: &mut Workspace) -> Answer {
        let walked = workspace.walked[k];
        if walked.gave_up {
            let mut answer = self.hand_over(bundle, workspace);
            answer.cost.nodes = walked.nodes.into();
            return answer;
        }
        let segments: u64 = bundle.packets.iter().map(|p| p.len() as u64).sum();
        let certain = workspace.shafts[k].whole && (walked.clear || walked.covered);
        let cost = Cost {
            segments,
            nodes: walked.nodes.into(),
            exact_rays: if walked.tested && !walked.covered { segments } else { 0 },
            handed_over: 0,
            aggregated: walked.aggregated.into(),
            certified: if certain { segments } else { 0 },
        };
        let n = (segments as f32).max(1.0);
        let method = match walked.covered {
            true => Method::Covered,
            false => Method::of(walked.tested, walked.aggregated > 0),
        };
        // A bundle without segments is unoccluded.
        let clear = walked.clear || segments == 0;
        let mean = |sum: f32| if clear { 1.0 } else { (sum / n).min(1.0) };
        let [transmittance, square, smallest, greatest] =
            [walked.transmittance, walked.square, walked.lo, walked.hi].map(mean);
        if certain {
            return Answer { transmittance, lo: transmittance, hi: transmittance, method, cost };
        }
        let variance = (square - transmittance * transmittance).max(0.0);
        let dependence = DEPENDENCE_FRACTION * (greatest - smallest).max(0.0);
        let model = (walked.model * walked.model + dependence * dependence).sqrt();
        let (lo, hi) = interval(transmittance, variance, n, model);
        // Whatever the dependence between clusters, the mean lies between Fréchet's bounds, apart from the clusters'
        // own errors; the bounds are known from samples only.
        let lo = lo.max(wilson(smallest, n).0 - 2.0 * model).clamp(0.0, transmittance);
        let hi = hi.min(wilson(greatest, n).1 + 2.0 * model).clamp(transmittance, 1.0);
        Answer { transmittance, lo, hi, method, cost }
    }

    /// Transmittance of each segment of one packet; 0 in unused lanes. `e` and `s`: emitter and feature size.
    #[cfg(test)]
    pub fn transmittances(&self, packet: &Packet, e: f32, s: f32, workspace: &mut Workspace) -> [f32; LANES] {
        self.answer_lanes(packet, e, s, workspace).1
    }

    /// The answer for one packet and the transmittance of each segment, 0 in unused lanes.
    #[cfg(test)]
    pub fn answer_lanes(
        &self,
        packet: &Packet,
        e: f32,
        s: f32,
        workspace: &mut Workspace,
    ) -> (Answer, [f32; LANES]) {
        let bundle = Bundle::of_packet(packet, e);
        let mut found = None;
        self.answers_lanes(&[bundle], &[s], workspace, |_, answer, lanes| found = Some((answer, *lanes)));
        found.expect("one bundle, one answer")
    }

    /// Answers for bundles of one packet each with individual feature sizes, and the transmittance of each segment, 0
    /// in unused lanes; see [`MultiResolution::answers`]. `each` receives the index of the bundle first.
    ///
    /// # Panics
    /// If there are fewer sizes than bundles.
    pub fn answers_lanes(
        &self,
        bundles: &[Bundle],
        sizes: &[f32],
        workspace: &mut Workspace,
        mut each: impl FnMut(usize, Answer, &[f32; LANES]),
    ) {
        if let Route::Cut(_) = self.route {
            return self.lanes_by_cut(bundles, workspace, each);
        }
        self.walk_all(bundles, Sizes::Each(sizes), self.leaf == LeafMode::Exact, workspace);
        for (k, bundle) in bundles.iter().enumerate() {
            let answer = self.finish(*bundle, k, workspace);
            let handed_over = answer.cost.handed_over > 0;
            let lanes = if handed_over { workspace.open_lanes(bundle) } else { workspace.lanes[k] };
            each(k, answer, &lanes);
        }
    }

    /// The exact engine that bundles are handed to.
    pub fn exact(&self) -> Exact {
        Exact { scene: self.exact.clone(), traversal: self.traversal }
    }

    /// Treatment of leaves.
    pub fn leaf(&self) -> LeafMode {
        self.leaf
    }
}
