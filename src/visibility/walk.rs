//! Traversal of the tree for all packets of a bundle, from the root or from a group's frontier.
//!
//! The bundle's shaft rejects children of a node that no segment can touch. A child is aggregated if its feature size
//! b is below the threshold
//!
//! ```text
//! b*(t) = s (1 - t) + e t          t = 0 at the receiver, 1 at the emitter
//! ```
//!
//! at the less favourable end of its box, and no segment ends inside. This is the umbra criterion u = b + (b - e)
//! d2/d1 < s solved for b (docs/method.md, Umbra criterion). Other children are opened; in opened leaves the triangles
//! are tested. Umbrae are measured perpendicular to the segments, as in the paper; on tilted receivers they are
//! longer.

use super::frontier::Frontier;
use super::shaft::Shaft;
use super::slabs::{BoxSums, Slabs, pass};
use super::triangles::{self, Tiles};
use super::wide::{AxisOptics, BLOCK_WORK, LEAF, NODE_WORK, WideNode, WideTree, mixed};
use crate::optics::{AXIS_COUNT, AxisMix};
use crate::ray::{Lanes, Packet};
use crate::simd::{LANES, Simd};
use glam::Vec3;

/// Parameters of a walk.
pub(super) struct WalkRule {
    /// Emitter size and feature size, scene units.
    pub e: f32,
    pub s: f32,
    /// Factor of all extinctions.
    pub factor: f32,
    /// Whether leaves always transmit according to their extinction.
    pub soft: bool,
    /// Work at which the walk is abandoned.
    pub limit: u64,
    /// Work that accounts for the cache miss of a node.
    pub fetch: u64,
    /// Work of entering an instance, per bundle and per packet.
    pub enter: [u64; 2],
    /// Tolerance of the transmittance that feature sizes were measured for.
    pub tolerance: f32,
}

/// Result of a walk.
#[derive(Clone, Copy, Default)]
pub(super) struct WalkResult {
    /// Sums over all segments: transmittances, their squares, and Fréchet's bounds.
    pub transmittance: f32,
    pub square: f32,
    pub lo: f32,
    pub hi: f32,
    /// Root mean square error of the mean transmittance due to the aggregated clusters' own errors.
    pub model: f32,
    /// Number of segments that met an aggregated cluster.
    pub aggregated: u32,
    /// Whether triangles were tested segment by segment.
    pub tested: bool,
    /// Whether the shaft is empty, and whether a single triangle covers it.
    pub clear: bool,
    pub covered: bool,
    /// Number of visited nodes.
    pub nodes: u32,
    /// Work in units of about one test of a box or triangle against a packet.
    pub work: u64,
    /// Whether the walk was abandoned at its limit.
    pub gave_up: bool,
}

/// Walks for one bundle: finds what its shaft meets, then passes its segments through the aggregated clusters.
#[inline(always)]
pub(super) fn walk<S: Simd>(
    simd: S,
    tree: &WideTree,
    frontier: Option<&Frontier>,
    packets: &[Packet],
    shaft: &Shaft,
    rule: &WalkRule,
    buffers: &mut Buffers,
) -> WalkResult {
    buffers.blocked.clear();
    buffers.blocked.resize(packets.len(), 0);
    let (mut walked, all) = gather(simd, tree, frontier, packets, shaft, rule, buffers);
    if walked.gave_up {
        return walked;
    }
    let Buffers { slabs, blocked, transmittance, sums, .. } = buffers;
    if all {
        *transmittance = [0.0; LANES];
        return walked;
    }
    walked.clear = !walked.tested && slabs.is_empty();
    if walked.clear {
        let active = packets[0].active;
        *transmittance = std::array::from_fn(|i| (active >> i & 1) as f32);
        return walked;
    }
    if slabs.is_empty() {
        for (packet, blocked) in packets.iter().zip(&*blocked) {
            sums.push((packet.active & !blocked).count_ones() as f32);
        }
        let clear = packets[0].active & !blocked[0];
        *transmittance = std::array::from_fn(|i| (clear >> i & 1) as f32);
        let n: f32 = sums[sums.len() - packets.len()..].iter().sum();
        (walked.transmittance, walked.square, walked.lo, walked.hi) = (n, n, n, n);
        return walked;
    }
    let passed = pass(simd, slabs, packets, blocked, shaft, sums, transmittance);
    walked.work += slabs.len() as u64 * (1 + passed.times);
    walked.take(&passed, packets);
    walked
}

/// Finds what the shaft of a bundle meets in one tree: adds aggregated clusters to `buffers.slabs` and blocked segments to
/// `buffers.blocked`. Returns counts, and whether all segments are blocked.
#[inline(always)]
pub(super) fn gather<S: Simd>(
    simd: S,
    tree: &WideTree,
    frontier: Option<&Frontier>,
    packets: &[Packet],
    shaft: &Shaft,
    rule: &WalkRule,
    buffers: &mut Buffers,
) -> (WalkResult, bool) {
    let Buffers { queue, slabs, tiles, blocked, .. } = buffers;
    let mut walked = WalkResult::default();
    let mix = AxisMix::around(shaft.direction());
    slabs.clear();
    tiles.clear();
    queue.clear();
    let push = |queue: &mut Vec<u32>, address: u32| {
        // The cache lines arrive while earlier nodes are processed.
        if address & LEAF != 0 {
            simd.prefetch(&tree.blocks[(address & !LEAF) as usize]);
        } else {
            simd.prefetch(&tree.nodes[address as usize]);
            for axis in mix.axes {
                simd.prefetch(&tree.optics[address as usize][axis]);
            }
        }
        queue.push(address);
    };
    let mut all = false;
    match frontier {
        None => queue.push(0),
        Some(frontier) => {
            for block in &frontier.blocks {
                let tested = triangles::block_all(simd, shaft, block, packets, tiles, blocked);
                all = walked.tested_block(&tested);
                if all {
                    break;
                }
            }
            for row in frontier.rows.iter().take(if all { 0 } else { usize::MAX }) {
                walked.work += NODE_WORK;
                let opened = visit(simd, &row.node, &row.optics, shaft, rule, &mix, slabs);
                Lanes(opened).for_each(|lane| push(queue, row.node.child[lane]));
            }
        }
    }
    let mut next = 0;
    while let Some(&address) = queue.get(next) {
        next += 1;
        if all {
            break;
        }
        if address & LEAF != 0 {
            let block = &tree.blocks[(address & !LEAF) as usize];
            let tested = triangles::block_all(simd, shaft, block, packets, tiles, blocked);
            all = walked.tested_block(&tested);
        } else {
            let at = address as usize;
            walked.nodes += 1;
            walked.work += NODE_WORK + rule.fetch;
            let node = &tree.nodes[at];
            let opened = visit(simd, node, &tree.optics[at], shaft, rule, &mix, slabs);
            Lanes(opened).for_each(|lane| push(queue, node.child[lane]));
        }
        if walked.work > rule.limit {
            walked.gave_up = true;
            return (walked, false);
        }
    }
    (walked, all)
}

impl WalkResult {
    /// Counts a tested block of triangles; returns whether all segments are blocked.
    fn tested_block(&mut self, tested: &triangles::BlockTests) -> bool {
        self.work += BLOCK_WORK + tested.work;
        self.tested |= tested.any;
        self.covered |= tested.all && !tested.any;
        tested.all
    }

    /// Takes over the sums of segments that passed through aggregated clusters.
    pub fn take(&mut self, passed: &BoxSums, packets: &[Packet]) {
        let segments: usize = packets.iter().map(Packet::len).sum();
        self.transmittance = passed.transmittance;
        self.square = passed.square;
        (self.lo, self.hi) = (passed.lo, passed.hi);
        self.model = passed.error / (segments as f32).max(1.0);
        self.aggregated = passed.met as u32;
    }
}

/// Tests the children of a node: aggregates some and returns the lanes of those to be opened.
#[inline(always)]
pub(super) fn visit<S: Simd>(
    simd: S,
    node: &WideNode,
    optics: &[AxisOptics; AXIS_COUNT],
    shaft: &Shaft,
    rule: &WalkRule,
    mix: &AxisMix,
    slabs: &mut Slabs,
) -> u32 {
    let touched = shaft.touches(simd, node);
    if touched == 0 {
        return 0;
    }
    let soft = if rule.soft { node.soft_leaves } else { 0 };
    let mut small = 0;
    if node.smallest < rule.s.max(rule.e) || soft != 0 {
        let (sizes, extinctions) = mixed(simd, optics, mix);
        small = touched & (shaft.aggregates(simd, node, sizes, rule.e, rule.s) | soft);
        if small != 0 {
            // The tolerance applies to a beam as wide as the feature size; errors of independent parts average out over
            // wider beams. Seen from a point, the beam through the cluster has the width e t.
            let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
            let place = simd.min(simd.max(shaft.places(simd, node), zero), one);
            let beam = simd.max(simd.mul(simd.splat(rule.e), place), simd.splat(f32::MIN_POSITIVE));
            let error = simd.div(simd.mul(simd.splat(rule.tolerance), sizes), beam);
            let extinctions = simd.mul(simd.splat(rule.factor), extinctions);
            let from = shaft.apex.unwrap_or(Vec3::ZERO);
            slabs.add(simd, node, small, from, extinctions, simd.min(error, one));
        }
    }
    touched & !small
}

/// Working memory of walks, kept between walks.
#[derive(Default)]
pub(super) struct Buffers {
    queue: Vec<u32>,
    pub slabs: Slabs,
    tiles: Tiles,
    /// Blocked segments of each packet of the bundle.
    pub blocked: Vec<u32>,
    /// Transmittance of each segment of a bundle of one packet.
    pub transmittance: [f32; LANES],
    /// Sum of the transmittances of each packet's segments, for all walks since the last clear.
    pub sums: Vec<f32>,
}
