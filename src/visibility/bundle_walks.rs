//! Walks for runs of bundles: neighbours share a frontier, and each is walked under its own rule.

use super::answer::Bundle;
use super::cost_model::CostModel;
use super::frontier::Frontier;
use super::instance_tree::InstanceTree;
use super::instances::{ENTER_BUNDLE, ENTER_PACKET, InstanceBuffers, ModelTrees, walk_instances};
use super::shaft::Shaft;
use super::walk::{Buffers, WalkResult, WalkRule, walk};
use super::wide::{FETCH_WORK, WideTree};
use crate::ray::Packet;
use crate::simd::{Kernel, LANES, Simd};
use std::ops::Range;

/// Largest number of bundles that share a frontier. Any value from 16 to 256 changes the error of a forest by less than
/// 0.5 % of itself (`constants.py bench`).
const MAX_GROUP_BUNDLES: usize = 64;
/// Largest distance between the receiver ends of a group, relative to the distance to the emitter. Any value from 0.25
/// to 1 changes the error of a forest by less than 0.5 % of itself (`constants.py bench`).
const MAX_GROUP_WIDTH: f32 = 0.5;
/// Largest box around the emitter ends of a group, relative to those of its first bundle. Any value from 1 to 4
/// changes the error of a forest by less than 0.1 % of itself (`constants.py bench`).
const MAX_TARGET_GROWTH: f32 = 1.25;
/// Emitter ends of the first bundle count as at least this wide, relative to their distance, so that bundles towards points form
/// groups. Any value from 0.01 to 0.2 changes the error of a forest by less than 0.1 % of itself (`constants.py bench`).
const MIN_TARGET_WIDTH: f32 = 0.05;

/// Working memory of a thread, kept between calls.
#[derive(Default)]
pub struct Workspace {
    pub(super) buffers: Buffers,
    placed: InstanceBuffers,
    frontier: Frontier,
    pub(super) shafts: Vec<Shaft>,
    pub(super) walked: Vec<WalkResult>,
    /// Transmittance of each segment of the first packet of each bundle, if kept.
    pub(super) lanes: Vec<[f32; LANES]>,
    /// Buffers of the caller for a chunk of a batch. Taken out during calls of the engine.
    pub batch: BatchBuffers,
}

/// Buffers of a chunk of a batch.
#[derive(Default)]
pub struct BatchBuffers {
    /// Packets of all bundles.
    pub packets: Vec<Packet>,
    /// First packet of each bundle, and the number of packets.
    pub starts: Vec<usize>,
    /// Segments of each packet that are blocked, a bit for each.
    pub blocked: Vec<u32>,
    /// Feature size of each queried part of a bundle, scene units.
    pub sizes: Vec<f32>,
    /// Bundle of each part.
    pub bundle_of: Vec<usize>,
}

impl Workspace {
    /// Sum of the transmittances of each packet's segments, for all bundles of the last call of
    /// `MultiResolution::answers` or `MultiResolution::certified` in order; zeros for bundles that were handed
    /// over or met nothing.
    #[cfg(test)]
    pub fn sums(&self) -> &[f32] {
        &self.buffers.sums
    }

    /// 1 for each segment of a bundle of one packet that is open in the last trace of exact rays, 0 for the others.
    pub(super) fn open_lanes(&self, bundle: &Bundle) -> [f32; LANES] {
        let open = bundle.packets[0].active & !self.buffers.blocked[0];
        std::array::from_fn(|i| (open >> i & 1) as f32)
    }
}

/// Properties of the engine that walks need.
#[derive(Clone, Copy)]
pub(super) struct Walker<'a> {
    pub tree: &'a WideTree,
    /// Placed meshes beside the model's own triangles.
    pub instances: Option<&'a InstanceTree>,
    /// Largest coordinate magnitude, scene units.
    pub magnitude: f32,
    /// Whether leaves are answered by their extinction.
    pub average: bool,
    /// Factor of all extinctions.
    pub factor: f32,
    /// Whether all trees together are larger than the caches near a core.
    pub far: bool,
    /// Tolerance of the transmittance that feature sizes were measured for.
    pub tolerance: f32,
    pub cost: CostModel,
}

/// Feature sizes of bundles.
#[derive(Clone, Copy)]
pub(super) enum Sizes<'a> {
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
pub(super) struct BundleWalks<'a> {
    pub engine: Walker<'a>,
    pub bundles: &'a [Bundle<'a>],
    pub sizes: Sizes<'a>,
    /// Whether walks are abandoned at their limit.
    pub bounded: bool,
    pub workspace: &'a mut Workspace,
}

impl Kernel for BundleWalks<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let BundleWalks { engine, bundles, sizes, bounded, workspace } = self;
        let Workspace { buffers, placed, frontier, shafts, walked, lanes, batch: _ } = workspace;
        let averages = !matches!(sizes, Sizes::Nothing);
        let soft = engine.average && averages;
        let size = |bundle: &Bundle| if averages { bundle.emitter_size } else { 0.0 };
        // Exact work is estimated without the cost of cache misses and of entering instances; only walks for answers include it.
        let fetch = if engine.far && averages { FETCH_WORK } else { 0 };
        let enter = if averages || bounded { [ENTER_BUNDLE, ENTER_PACKET] } else { [0; 2] };
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
                opened = frontier.open(simd, engine.tree, &around, emitters, features, soft);
                shared = Some(&*frontier);
            }
            for k in group.clone() {
                let packets = bundles[k].packets;
                if packets.is_empty() {
                    walked.push(WalkResult::default());
                    lanes.push([0.0; LANES]);
                    continue;
                }
                let s = sizes.of(k);
                let limit = if bounded { engine.cost.limit(&bundles[k]) } else { u64::MAX };
                let (e, factor, tolerance) = (size(&bundles[k]), engine.factor, engine.tolerance);
                let rule = WalkRule { e, s, factor, soft, limit, fetch, enter, tolerance };
                let mut found = match engine.instances {
                    None => walk(simd, engine.tree, shared, packets, &shafts[k], &rule, buffers),
                    Some(instances) => {
                        let trees = ModelTrees { base: engine.tree, instances };
                        walk_instances(simd, trees, &bundles[k], &shafts[k], &rule, buffers, placed)
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
    let widest = (to[1] - to[0]).length() + MIN_TARGET_WIDTH * distance;
    let mut end = first + 1;
    while end < limit && !bundles[end].packets.is_empty() {
        let [a, b] = shafts[end].ends.map(|e| e.bounds());
        from = [from[0].min(a[0]), from[1].max(a[1])];
        to = [to[0].min(b[0]), to[1].max(b[1])];
        if (from[1] - from[0]).length() > MAX_GROUP_WIDTH * distance
            || (to[1] - to[0]).length() > MAX_TARGET_GROWTH * widest
        {
            break;
        }
        end += 1;
    }
    first..end
}
