//! Multi-resolution visibility [SD95 sec 3.2]: the engine over walks, fronts and what it hands to Embree.

use super::front::Front;
use super::reference;
use super::shaft::Shaft;
use super::steps::Steps;
use super::walk::{Buffers, FETCH, Rule, Walked, walk};
use super::wide::WideTree;
use super::{Answer, Bundle, Cost, Exact, Method, interval, wilson};
use crate::clusters::Hierarchy;
use crate::embree::{CommittedScene, Traversal};
use crate::optics::{self, ClusterOptics};
use crate::ray::Packet;
use crate::scene::Scene;
use crate::simd::{Isa, Kernel, LANES, Simd, dispatch};
use std::ops::Range;
use std::sync::Arc;

/// What happens in a leaf that the criterion opens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Leaf {
    /// Its triangles are tested.
    #[default]
    Exact,
    /// It is answered by extinction all the same: the paper's average visibility [SD95 sec 5].
    Extinction,
}

/// Work that exact rays are worth before [`MultiResolution::with_budget`] knows the scene; a packet.
const BUDGET: u64 = 200;
/// What Embree needs for a packet in units of this engine's work, over the root of the work that testing every
/// triangle in the shaft would be: measured between 3 (Sponza) and 20 (a forest of six million triangles), 5 to 7 in
/// furnished rooms and a park.
const EMBREE_WORK: f64 = 6.0;
/// The engine pays where its work is less than this part of what exact rays are worth: their worth is an estimate, and
/// losing is worse than not winning. (Rows at 0.84 in a kitchen and at 0.92 before a bookshelf lost 14 % and 30 %; at 0.79
/// and less in a garden they won.)
const SURELY: f64 = 0.8;
/// A walk gives up after so many times the work that exact rays are worth: many end soon after.
const PATIENCE: u64 = 2;
/// Work of a bundle before it meets anything: its shaft and its answer.
const BUNDLE: u64 = 30;
/// Bytes that caches near a core hold, about.
const NEAR: usize = 64 << 20;
/// Part of the distance between Fréchet's bounds that counts as error: clusters are neither independent nor do they
/// ever hide each other wholly. Measured in forests and a park.
const DEPENDENCE: f32 = 0.1;
/// Bundles that share a front, at most.
const GROUP: usize = 64;
/// How far the receiver ends of a group may lie apart, as part of the distance to the emitter.
const GROUP_WIDTH: f32 = 0.5;

/// The multi-resolution engine: the wide tree and the exact scene it falls back on.
#[derive(Clone)]
pub struct MultiResolution {
    tree: Arc<WideTree>,
    exact: CommittedScene,
    traversal: Traversal,
    magnitude: f32,
    leaf: Leaf,
    isa: Isa,
    /// Work a packet that exact rays are worth.
    budget: u64,
    /// Whether the tree is larger than the caches near a core.
    far: bool,
    /// Error of transmission that feature sizes were measured for.
    tolerance: f32,
}

/// Buffers of a thread, kept between calls.
#[derive(Default)]
pub struct Workspace {
    buffers: Buffers,
    front: Front,
    shafts: Vec<Shaft>,
    walked: Vec<Walked>,
    /// Transmittance of each segment of the first packet of each bundle, where it is kept.
    lanes: Vec<[f32; LANES]>,
}

impl Workspace {
    /// Transmittance of each packet's segments, summed up, of all bundles of the last call of
    /// [`MultiResolution::answers`] or [`MultiResolution::certified`], one after the other; zeros for bundles that were
    /// handed over, or that met nothing.
    pub fn sums(&self) -> &[f32] {
        &self.buffers.sums
    }
}

impl MultiResolution {
    /// Lays out a hierarchy for traversal.
    ///
    /// `optics` are those of `hierarchy.micro`; `exact` is the whole scene, traced as `traversal` says when a
    /// packet is handed over.
    pub fn new(
        scene: &Scene,
        hierarchy: &Hierarchy,
        optics: &[ClusterOptics],
        exact: CommittedScene,
        traversal: Traversal,
        leaf: Leaf,
    ) -> MultiResolution {
        let tree = Arc::new(WideTree::build(scene, hierarchy, optics));
        MultiResolution {
            far: tree.bytes() > NEAR,
            tree,
            exact,
            traversal,
            magnitude: reference::magnitude(scene),
            leaf,
            isa: Isa::detect(),
            budget: BUDGET,
            tolerance: optics::Options::default().tolerance,
        }
    }

    /// Says that the optics were measured with another [`optics::Options::tolerance`]; stated intervals rest
    /// on it.
    #[must_use]
    pub fn with_tolerance(mut self, tolerance: f32) -> Self {
        self.tolerance = tolerance;
        self
    }

    /// Uses another instruction set; one that the machine lacks is replaced by plain code.
    #[must_use]
    pub fn with_isa(mut self, isa: Isa) -> Self {
        self.isa = if isa.available() { isa } else { Isa::Portable };
        self
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// The steps of a walk for a bundle's packets, one at a time.
    pub fn steps<'s>(&'s self, packets: &'s [Packet]) -> Steps<'s> {
        Steps::new(&self.tree, self.magnitude, self.isa, packets)
    }

    /// Bytes of the traversal structure.
    pub fn bytes(&self) -> usize {
        self.tree.bytes()
    }

    /// The visible fraction of a bundle for feature size `s` (scene units, on the receiver; finite, positive).
    pub fn answer(&self, bundle: Bundle, s: f32, workspace: &mut Workspace) -> Answer {
        let mut answer = None;
        self.answers(&[bundle], s, workspace, |a| answer = Some(a));
        answer.expect("one bundle, one answer")
    }

    /// The visible fractions of several bundles, in their order.
    ///
    /// Bundles that follow each other and whose ends lie close together share the upper part of the traversal. Each
    /// decides for itself what it aggregates: the answers are those of [`MultiResolution::answer`] up to rounding, but
    /// for bundles that one way gives up on and the other does not.
    pub fn answers(
        &self,
        bundles: &[Bundle],
        s: f32,
        workspace: &mut Workspace,
        mut each: impl FnMut(Answer),
    ) {
        // Without rays a walk goes on whatever it takes.
        self.walk_all(bundles, Sizes::All(s), self.leaf == Leaf::Exact, workspace);
        for (k, bundle) in bundles.iter().enumerate() {
            each(self.finish(*bundle, k, workspace));
        }
    }

    /// The visible fractions of several bundles, in their order, with nothing aggregated: exact visibility that asks
    /// for certificates first.
    ///
    /// A shaft that meets nothing is clear and one that a single triangle covers is blocked without any ray (method
    /// E.6); what few triangles the rest may meet are tested against all segments at once, and where they are many
    /// Embree is asked.
    pub fn certified(&self, bundles: &[Bundle], workspace: &mut Workspace, mut each: impl FnMut(Answer)) {
        self.walk_all(bundles, Sizes::Nothing, true, workspace);
        for (k, bundle) in bundles.iter().enumerate() {
            each(self.finish(*bundle, k, workspace));
        }
    }

    /// The visible fraction of a bundle by exact rays: for bundles where [`MultiResolution::pays`] says no.
    pub fn hand_over(&self, bundle: Bundle, workspace: &mut Workspace) -> Answer {
        let mut answer = self.exact().answer(bundle, &mut workspace.buffers.blocked);
        answer.cost.handed_over = answer.cost.segments;
        answer
    }

    /// Estimates what exact rays cost for bundles like these; what takes more work is handed to Embree.
    ///
    /// Counts work instead of measuring time, so that the same question has the same answer on every run. Embree's
    /// work grows with about the root of what an engine does that has to look at everything in the shaft.
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
            self.budget = (EMBREE_WORK * work / count) as u64;
        }
        self
    }

    /// Whether this engine is likely to take less time than exact rays for bundles like these, in runs as they are
    /// asked. Counts work, as [`MultiResolution::with_budget`] does.
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
        (own as f64) < SURELY * exact as f64
    }

    /// [`MultiResolution::pays`] for one run of bundles with feature sizes of their own.
    pub fn pays_each(&self, run: &[Bundle], sizes: &[f32], workspace: &mut Workspace) -> bool {
        let (own, exact) = self.worth(run, Sizes::Each(sizes), workspace);
        own < exact
    }

    /// Work for a run of bundles by this engine, and by exact rays.
    fn worth(&self, run: &[Bundle], sizes: Sizes, workspace: &mut Workspace) -> (u64, u64) {
        let (mut own, mut exact) = (0, 0);
        self.walk_all(run, sizes, true, workspace);
        for (bundle, walked) in run.iter().zip(&workspace.walked) {
            let (rays, limit) = (self.exact_work(bundle), self.limit(bundle));
            own += BUNDLE + if walked.gave_up || walked.work > limit { limit + rays } else { walked.work };
            exact += rays;
        }
        (own, exact)
    }

    /// Never hands over, so that its own answers can be looked at.
    #[cfg(test)]
    pub(super) fn with_patience(mut self) -> Self {
        self.budget = 1 << 40;
        self
    }

    /// Work after which a walk gives up.
    fn limit(&self, bundle: &Bundle) -> u64 {
        PATIENCE * self.exact_work(bundle)
    }

    /// Work that exact rays are worth: by their number, but no packet is less than a quarter of a full one.
    fn exact_work(&self, bundle: &Bundle) -> u64 {
        let lanes: usize = bundle.packets.iter().map(|p| p.len().max(LANES / 4)).sum();
        self.budget * lanes as u64 / LANES as u64
    }

    fn walk_all(&self, bundles: &[Bundle], sizes: Sizes, bounded: bool, workspace: &mut Workspace) {
        dispatch(self.isa, Ask { engine: self, bundles, sizes, bounded, workspace });
    }

    /// The answer that a walk found, or Embree's where it gave up.
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
        // Nothing blocks a bundle without segments either.
        let clear = walked.clear || segments == 0;
        let mean = |sum: f32| if clear { 1.0 } else { (sum / n).min(1.0) };
        let [transmittance, square, least, greatest] =
            [walked.transmittance, walked.square, walked.lo, walked.hi].map(mean);
        if certain {
            return Answer { transmittance, lo: transmittance, hi: transmittance, method, cost };
        }
        let variance = (square - transmittance * transmittance).max(0.0);
        let dependence = DEPENDENCE * (greatest - least).max(0.0);
        let model = (walked.model * walked.model + dependence * dependence).sqrt();
        let (lo, hi) = interval(transmittance, variance, n, model);
        // Whatever the dependence between the clusters, their own errors aside, the mean lies between Fréchet's
        // bounds (method D.7), of which only samples are known.
        let lo = lo.max(wilson(least, n).0 - 2.0 * model).clamp(0.0, transmittance);
        let hi = hi.min(wilson(greatest, n).1 + 2.0 * model).clamp(transmittance, 1.0);
        Answer { transmittance, lo, hi, method, cost }
    }

    /// Transmittance of each segment of one packet; 0 in unused lanes.
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

    /// The answers for bundles of one packet each, with feature sizes of their own, and the transmittance of each segment,
    /// 0 in unused lanes; see [`MultiResolution::answers`]. `each` is told which bundle is meant.
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
        self.walk_all(bundles, Sizes::Each(sizes), self.leaf == Leaf::Exact, workspace);
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

    /// The rays that it hands over to.
    pub fn exact(&self) -> Exact {
        Exact { scene: self.exact.clone(), traversal: self.traversal }
    }

    /// What happens in leaves.
    pub fn leaf(&self) -> Leaf {
        self.leaf
    }
}

/// Feature sizes of bundles.
#[derive(Clone, Copy)]
enum Sizes<'a> {
    /// Nothing may be averaged.
    Nothing,
    /// One for all.
    All(f32),
    /// One for each; the transmittance of each segment is kept.
    Each(&'a [f32]),
}

impl Sizes<'_> {
    /// No feature size is below zero.
    fn of(self, k: usize) -> f32 {
        match self {
            Sizes::Nothing => 0.0,
            Sizes::All(s) => s,
            Sizes::Each(sizes) => sizes[k],
        }
    }
}

/// Walks for all bundles, in groups.
struct Ask<'a> {
    engine: &'a MultiResolution,
    bundles: &'a [Bundle<'a>],
    sizes: Sizes<'a>,
    /// Whether walks give up at their limit.
    bounded: bool,
    workspace: &'a mut Workspace,
}

impl Kernel for Ask<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Ask { engine, bundles, sizes, bounded, workspace } = self;
        let Workspace { buffers, front, shafts, walked, lanes } = workspace;
        let averages = !matches!(sizes, Sizes::Nothing);
        let soft = engine.leaf == Leaf::Extinction && averages;
        let size = |bundle: &Bundle| if averages { bundle.emitter_size } else { 0.0 };
        // Embree's work is estimated in steps, not in time: only a walk that is asked for pays for what it waits for.
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
            let group = group(bundles, shafts, first);
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
                let mut found = walk(simd, &engine.tree, shared, (packets, &shafts[k]), &rule, buffers);
                // Walks that end early say nothing of their packets: all are blocked, or Embree is asked.
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

/// The bundles from `first` on whose ends lie close together.
fn group(bundles: &[Bundle], shafts: &[Shaft], first: usize) -> Range<usize> {
    let limit = (first + GROUP).min(bundles.len());
    let distance = shafts[first].direction().length();
    let [from, to] = shafts[first].ends.map(|e| e.bounds());
    let (mut from, mut to) = (from, to);
    let widest = (to[1] - to[0]).length() + 0.05 * distance;
    let mut end = first + 1;
    while end < limit && !bundles[end].packets.is_empty() {
        let [a, b] = shafts[end].ends.map(|e| e.bounds());
        from = [from[0].min(a[0]), from[1].max(a[1])];
        to = [to[0].min(b[0]), to[1].max(b[1])];
        if (from[1] - from[0]).length() > GROUP_WIDTH * distance || (to[1] - to[0]).length() > 1.25 * widest {
            break;
        }
        end += 1;
    }
    first..end
}
