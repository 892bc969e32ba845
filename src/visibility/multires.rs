//! Multi-resolution visibility [SD95 sec 3.2]: the engine above walks, fronts and the hand-over to Embree.

use super::front::Front;
use super::instances::{InstanceBuffers, InstanceTree, walk_instances};
use super::shaft::Shaft;
use super::steps::Steps;
use super::walk::{Buffers, FETCH, Rule, Walked, walk};
use super::wide::WideTree;
use super::{Answer, Bundle, Cost, Exact, Method, interval, wilson};
use crate::embree::{CommittedScene, Traversal};
use crate::optics;
use crate::ray::Packet;
use crate::simd::{Isa, Kernel, LANES, Simd, dispatch};
use std::ops::Range;
use std::sync::Arc;

/// Treatment of leaves that the umbra criterion opens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LeafMode {
    /// Its triangles are tested.
    #[default]
    Exact,
    /// The leaf transmits according to its extinction: the paper's average visibility [SD95 sec 5].
    Average,
}

/// Work of exact rays per packet before [`MultiResolution::with_budget`] measures it. Chosen.
const DEFAULT_RAY_WORK: u64 = 200;
/// Embree's work per packet in units of this engine's work, divided by the square root of the work of testing every
/// triangle in the shaft. Measured once between 3 (Sponza) and 20 (a forest of six million triangles), 5 to 7 in
/// furnished rooms and a park; no command repeats the measurement.
const EMBREE_WORK_FACTOR: f64 = 6.0;
/// Largest ratio of the engine's work to that of exact rays at which the engine is used: the work of exact rays is an
/// estimate, so a margin is kept. Measured once: bench rows at 0.84 in a kitchen and 0.92 before a bookshelf were 14 %
/// and 30 % slower than exact rays; rows up to 0.79 in a garden were faster.
const MAX_WORK_RATIO: f64 = 0.8;
/// A walk is abandoned at this multiple of the estimated work of exact rays. Chosen.
const GIVE_UP_FACTOR: u64 = 2;
/// Work per bundle for its shaft and answer, independent of geometry. Chosen.
const BUNDLE_WORK: u64 = 30;
/// Approximate size of the caches near a core, bytes. Chosen.
const CACHE_BYTES: usize = 64 << 20;
/// Fraction of the distance between Fréchet's bounds that counts as model error: clusters are neither independent nor
/// perfectly correlated. Measured once in forests and a park; no command repeats the measurement.
const DEPENDENCE_FRACTION: f32 = 0.1;
/// Largest number of bundles that share a front. Chosen.
const MAX_GROUP_BUNDLES: usize = 64;
/// Largest distance between the receiver ends of a group, relative to the distance to the emitter. Chosen.
const MAX_GROUP_WIDTH: f32 = 0.5;

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
    /// Estimated work of exact rays per packet.
    budget: u64,
    /// Whether the tree is larger than the caches near a core.
    far: bool,
    /// Tolerance of the transmittance that feature sizes were measured for.
    tolerance: f32,
}

/// Working memory of a thread, kept between calls.
#[derive(Default)]
pub struct Workspace {
    buffers: Buffers,
    placed: InstanceBuffers,
    front: Front,
    shafts: Vec<Shaft>,
    walked: Vec<Walked>,
    /// Transmittance of each segment of the first packet of each bundle, if kept.
    lanes: Vec<[f32; LANES]>,
}

impl Workspace {
    /// Sum of the transmittances of each packet's segments, for all bundles of the last call of
    /// [`MultiResolution::answers`] or [`MultiResolution::certified`] in order; zeros for bundles that were handed
    /// over or met nothing.
    pub fn sums(&self) -> &[f32] {
        &self.buffers.sums
    }
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
            budget: DEFAULT_RAY_WORK,
            tolerance: optics::Options::default().tolerance,
        }
    }

    /// Adds placed meshes to the model's own triangles; `magnitude` is the largest coordinate magnitude of both.
    #[must_use]
    pub fn with_instances(mut self, instances: Arc<InstanceTree>, magnitude: f32) -> Self {
        (self.instances, self.magnitude) = (Some(instances), magnitude);
        self
    }

    /// Sets the [`optics::Options::tolerance`] that the optics were measured with, which determines stated intervals.
    #[must_use]
    pub fn with_tolerance(mut self, tolerance: f32) -> Self {
        self.tolerance = tolerance;
        self
    }

    /// Selects another instruction set; unavailable ones are replaced by portable code.
    #[must_use]
    pub fn with_isa(mut self, isa: Isa) -> Self {
        self.isa = if isa.available() { isa } else { Isa::Portable };
        self
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Single steps of a walk for a bundle's packets, for benchmarks.
    pub fn steps<'s>(&'s self, packets: &'s [Packet]) -> Steps<'s> {
        Steps::new(&self.tree, self.magnitude, self.isa, packets)
    }

    /// Size of the traversal structure in bytes.
    pub fn bytes(&self) -> usize {
        self.tree.bytes()
    }

    /// The visible fraction of a bundle for feature size `s` on the receiver (scene units, finite, positive).
    pub fn answer(&self, bundle: Bundle, s: f32, workspace: &mut Workspace) -> Answer {
        let mut answer = None;
        self.answers(&[bundle], s, workspace, |a| answer = Some(a));
        answer.expect("one bundle, one answer")
    }

    /// The visible fractions of several bundles, passed to `each` in order.
    ///
    /// Consecutive bundles with close ends share the upper part of the traversal; each applies the umbra criterion by
    /// itself. Answers equal those of [`MultiResolution::answer`] up to rounding, except for bundles that only one of
    /// the two ways hands over.
    pub fn answers(
        &self,
        bundles: &[Bundle],
        s: f32,
        workspace: &mut Workspace,
        mut each: impl FnMut(Answer),
    ) {
        // Without exact rays walks have no limit.
        self.walk_all(bundles, Sizes::All(s), self.leaf == LeafMode::Exact, workspace);
        for (k, bundle) in bundles.iter().enumerate() {
            each(self.finish(*bundle, k, workspace));
        }
    }

    /// The visible fractions of several bundles without aggregation: exact visibility with certificates.
    ///
    /// A bundle whose shaft is empty is clear, one whose shaft a single triangle covers is blocked, both without rays
    /// (docs/method.md, Certificates and intervals). Of the rest, few triangles are tested against all segments at
    /// once; with many, Embree traces the bundle.
    pub fn certified(&self, bundles: &[Bundle], workspace: &mut Workspace, mut each: impl FnMut(Answer)) {
        self.walk_all(bundles, Sizes::Nothing, true, workspace);
        for (k, bundle) in bundles.iter().enumerate() {
            each(self.finish(*bundle, k, workspace));
        }
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
        let (mut work, mut count) = (0.0, 0.0);
        for bundle in sample.iter().filter(|b| !b.packets.is_empty()) {
            let one = Bundle { packets: &bundle.packets[..1], ..*bundle };
            self.walk_all(&[one], Sizes::Nothing, false, workspace);
            work += (workspace.walked[0].work as f64).sqrt();
            count += 1.0;
        }
        if count > 0.0 {
            self.budget = (EMBREE_WORK_FACTOR * work / count) as u64;
        }
        self
    }

    /// Whether this engine probably takes less time than exact rays for runs of bundles like `sample`. Counts work, as
    /// [`MultiResolution::with_budget`] does.
    pub fn pays<'b>(
        &self,
        sample: impl IntoIterator<Item = &'b [Bundle<'b>]>,
        s: f32,
        workspace: &mut Workspace,
    ) -> bool {
        let (mut own, mut exact) = (0, 0);
        for run in sample {
            let (o, e) = self.worth(run, Sizes::All(s), workspace);
            (own, exact) = (own + o, exact + e);
        }
        (own as f64) < MAX_WORK_RATIO * exact as f64
    }

    /// Whether this engine probably does less work than exact rays for one run of bundles with individual feature
    /// sizes.
    pub fn pays_each(&self, run: &[Bundle], sizes: &[f32], workspace: &mut Workspace) -> bool {
        let (own, exact) = self.worth(run, Sizes::Each(sizes), workspace);
        own < exact
    }

    /// Work for a run of bundles by this engine and by exact rays.
    fn worth(&self, run: &[Bundle], sizes: Sizes, workspace: &mut Workspace) -> (u64, u64) {
        let (mut own, mut exact) = (0, 0);
        self.walk_all(run, sizes, true, workspace);
        for (bundle, walked) in run.iter().zip(&workspace.walked) {
            let (rays, limit) = (self.exact_work(bundle), self.limit(bundle));
            own +=
                BUNDLE_WORK + if walked.gave_up || walked.work > limit { limit + rays } else { walked.work };
            exact += rays;
        }
        (own, exact)
    }

    /// Never hands bundles over, for tests of the engine's own answers.
    #[cfg(test)]
    pub(super) fn with_patience(mut self) -> Self {
        self.budget = 1 << 40;
        self
    }

    /// Work at which a walk is abandoned.
    fn limit(&self, bundle: &Bundle) -> u64 {
        GIVE_UP_FACTOR * self.exact_work(bundle)
    }

    /// Work of exact rays for a bundle; each packet counts as at least a quarter full.
    fn exact_work(&self, bundle: &Bundle) -> u64 {
        let lanes: usize = bundle.packets.iter().map(|p| p.len().max(LANES / 4)).sum();
        self.budget * lanes as u64 / LANES as u64
    }

    fn walk_all(&self, bundles: &[Bundle], sizes: Sizes, bounded: bool, workspace: &mut Workspace) {
        dispatch(self.isa, Ask { engine: self, bundles, sizes, bounded, workspace });
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
        let method = match (walked.tested, walked.aggregated > 0) {
            _ if walked.covered => Method::Covered,
            (false, false) => Method::Clear,
            (true, false) => Method::Exact,
            (false, true) => Method::Aggregated,
            (true, true) => Method::Mixed,
        };
        // A bundle without segments is unoccluded.
        let clear = walked.clear || segments == 0;
        let mean = |sum: f32| if clear { 1.0 } else { (sum / n).min(1.0) };
        let [transmittance, square, least, greatest] =
            [walked.transmittance, walked.square, walked.lo, walked.hi].map(mean);
        if certain {
            return Answer { transmittance, lo: transmittance, hi: transmittance, method, cost };
        }
        let variance = (square - transmittance * transmittance).max(0.0);
        let dependence = DEPENDENCE_FRACTION * (greatest - least).max(0.0);
        let model = (walked.model * walked.model + dependence * dependence).sqrt();
        let (lo, hi) = interval(transmittance, variance, n, model);
        // Whatever the dependence between clusters, the mean lies between Fréchet's bounds, apart from the clusters'
        // own errors; the bounds are known from samples only.
        let lo = lo.max(wilson(least, n).0 - 2.0 * model).clamp(0.0, transmittance);
        let hi = hi.min(wilson(greatest, n).1 + 2.0 * model).clamp(transmittance, 1.0);
        Answer { transmittance, lo, hi, method, cost }
    }

    /// Transmittance of each segment of one packet; 0 in unused lanes. `e` and `s`: emitter and feature size.
    pub fn transmittances(&self, packet: &Packet, e: f32, s: f32, workspace: &mut Workspace) -> [f32; LANES] {
        self.answer_lanes(packet, e, s, workspace).1
    }

    /// The answer for one packet and the transmittance of each segment, 0 in unused lanes.
    pub fn answer_lanes(
        &self,
        packet: &Packet,
        e: f32,
        s: f32,
        workspace: &mut Workspace,
    ) -> (Answer, [f32; LANES]) {
        let bundle = Bundle { packets: std::slice::from_ref(packet), emitter_size: e, emitter: &[] };
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
        self.walk_all(bundles, Sizes::Each(sizes), self.leaf == LeafMode::Exact, workspace);
        for (k, bundle) in bundles.iter().enumerate() {
            let answer = self.finish(*bundle, k, workspace);
            let mut lanes = workspace.lanes[k];
            if answer.cost.handed_over > 0 {
                let clear = bundle.packets[0].active & !workspace.buffers.blocked[0];
                lanes = std::array::from_fn(|i| (clear >> i & 1) as f32);
            }
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

/// Feature sizes of bundles.
#[derive(Clone, Copy)]
enum Sizes<'a> {
    /// No aggregation.
    Nothing,
    /// One feature size for all bundles.
    All(f32),
    /// One feature size per bundle; the transmittance of each segment is kept.
    Each(&'a [f32]),
}

impl Sizes<'_> {
    /// Feature size of bundle `k`; 0 without aggregation.
    fn of(self, k: usize) -> f32 {
        match self {
            Sizes::Nothing => 0.0,
            Sizes::All(s) => s,
            Sizes::Each(sizes) => sizes[k],
        }
    }
}

/// Kernel that walks for all bundles, in groups.
struct Ask<'a> {
    engine: &'a MultiResolution,
    bundles: &'a [Bundle<'a>],
    sizes: Sizes<'a>,
    /// Whether walks are abandoned at their limit.
    bounded: bool,
    workspace: &'a mut Workspace,
}

impl Kernel for Ask<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Ask { engine, bundles, sizes, bounded, workspace } = self;
        let Workspace { buffers, placed, front, shafts, walked, lanes } = workspace;
        let averages = !matches!(sizes, Sizes::Nothing);
        let soft = engine.leaf == LeafMode::Average && averages;
        let size = |bundle: &Bundle| if averages { bundle.emitter_size } else { 0.0 };
        // Exact work is estimated without the cost of cache misses; only walks for answers include it.
        let fetch = if engine.far && averages { FETCH } else { 0 };
        lanes.clear();
        shafts.clear();
        for bundle in bundles {
            let nothing = &[Packet::EMPTY][..];
            let packets = if bundle.packets.is_empty() { nothing } else { bundle.packets };
            shafts.push(Shaft::of(simd, packets, bundle.emitter, engine.magnitude));
        }
        walked.clear();
        buffers.sums.clear();
        let mut packets_before = 0;
        let mut first = 0;
        while first < bundles.len() {
            let group = match engine.instances {
                None => group(bundles, shafts, first),
                Some(_) => first..first + 1,
            };
            let (mut shared, mut opened) = (None, (0, 0));
            if group.len() > 1 {
                let around = Shaft::around(&shafts[group.clone()]);
                let range = |(a, b): (f32, f32), v: f32| (a.min(v), b.max(v));
                let emitters = bundles[group.clone()].iter().map(size).fold((f32::MAX, 0.0), range);
                let features = group.clone().map(|k| sizes.of(k)).fold((f32::MAX, 0.0), range);
                opened = front.open(simd, &engine.tree, &around, emitters, features, soft);
                shared = Some(&*front);
            }
            for k in group.clone() {
                let packets = bundles[k].packets;
                if packets.is_empty() {
                    walked.push(Walked::default());
                    lanes.push([0.0; LANES]);
                    continue;
                }
                let s = sizes.of(k);
                let limit = if bounded { engine.limit(&bundles[k]) } else { u64::MAX };
                let rule = Rule { e: size(&bundles[k]), s, soft, limit, fetch, tolerance: engine.tolerance };
                let mut found = match &engine.instances {
                    None => walk(simd, &engine.tree, shared, (packets, &shafts[k]), &rule, buffers),
                    Some(instances) => {
                        let trees = (&*engine.tree, &**instances);
                        walk_instances(simd, trees, (&bundles[k], &shafts[k]), &rule, buffers, placed)
                    }
                };
                // Walks that end early add no sums: all segments are blocked, or Embree traces the bundle.
                packets_before += packets.len();
                buffers.sums.resize(packets_before, 0.0);
                let (nodes, work) = std::mem::take(&mut opened);
                (found.nodes, found.work) = (found.nodes + nodes, found.work + work);
                walked.push(found);
                if let Sizes::Each(_) = sizes {
                    lanes.push(buffers.transmittance);
                }
            }
            first = group.end;
        }
    }
}

/// Range of bundles starting at `first` whose ends are close together.
fn group(bundles: &[Bundle], shafts: &[Shaft], first: usize) -> Range<usize> {
    let limit = (first + MAX_GROUP_BUNDLES).min(bundles.len());
    let distance = shafts[first].direction().length();
    let [from, to] = shafts[first].ends.map(|e| e.bounds());
    let (mut from, mut to) = (from, to);
    let widest = (to[1] - to[0]).length() + 0.05 * distance;
    let mut end = first + 1;
    while end < limit && !bundles[end].packets.is_empty() {
        let [a, b] = shafts[end].ends.map(|e| e.bounds());
        from = [from[0].min(a[0]), from[1].max(a[1])];
        to = [to[0].min(b[0]), to[1].max(b[1])];
        if (from[1] - from[0]).length() > MAX_GROUP_WIDTH * distance
            || (to[1] - to[0]).length() > 1.25 * widest
        {
            break;
        }
        end += 1;
    }
    first..end
}
