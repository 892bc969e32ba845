//! Sums over the segments of bundles that the cut follows.

use super::DistanceCut;
use super::modes::{Mode, class};
use super::traverse::{AveragingRule, EMPTY_STACK, OPAQUE_DEPTH, PacketTrace, trace};
use crate::ray::{LANES, Packet};
use crate::simd::{Kernel, Simd, decay};
use crate::visibility::answer::Bundle;

/// Work of a segment, of decoding a node or block, and of tests of a segment against a node and a block, in units of 2.5 ns on the
/// processor that was measured (AVX-512): work and times agreed to a third in garden, park, forest. The benchmark is no longer in the
/// repository (`git show 2d559b4:benches/distance_cut.rs`).
const WORK: [f64; 5] = [6.0, 6.0, 3.0, 4.5, 6.0];
/// [`WORK`] of single rays of Embree, which share nothing.
const EMBREE_WORK: [f64; 5] = [10.0, 0.0, 0.0, 6.0, 12.0];
/// Work of packets of Embree for a segment, and for a node or block: for packets all of whose segments meet it, and what is added as none
/// does, because Embree's nodes are smaller. With these the work in rooms is 16 to 22 units for 40 ns, and outdoors that of single rays
/// is less.
const PACKETS: [f64; 3] = [5.0, 10.0, 35.0];

/// How the segments of a bundle are traced.
#[derive(Clone, Copy)]
pub(super) enum Tracing<'a> {
    /// Nothing is averaged; `shells` states whether shells that the bundle cannot meet are tested nevertheless.
    Exact { shells: bool },
    /// A mode.
    Mode(&'a Mode),
    /// A mode; for bundles of several packets only if the mode pays in the class of the first packet.
    IfItPays(&'a Mode),
}

impl<'a> Tracing<'a> {
    /// The mode, if anything is averaged.
    pub fn mode(self) -> Option<&'a Mode> {
        match self {
            Tracing::Exact { .. } => None,
            Tracing::Mode(mode) | Tracing::IfItPays(mode) => Some(mode),
        }
    }

    /// Whether all packets of a bundle are followed, as one of `count` with `segments` in the class of the first.
    #[inline(always)]
    fn goes_on(self, class: usize, count: usize, segments: usize) -> bool {
        match self {
            Tracing::IfItPays(mode) if count > 1 => mode.fits[class].gain_of(segments as f32) > 1.0,
            _ => true,
        }
    }
}

/// Sums over the segments of a bundle.
#[derive(Clone, Copy, Debug, Default)]
pub struct BundleSums {
    /// Sum of the transmittances.
    pub transmittance: f32,
    /// Sum of their squares.
    pub square: f32,
    pub segments: u32,
    /// Segments that met an aggregated child.
    pub aggregated: u32,
    /// Nodes that were decoded.
    pub nodes: u32,
    /// Blocks of triangles that were decoded.
    pub blocks: u32,
    /// Tests of a segment against a node.
    pub node_tests: u32,
    /// Tests of a segment against a block.
    pub block_tests: u32,
    /// Sums over the segments of their packet's [`Fit::averaged`](super::modes::Fit::averaged), and of the model's error.
    pub(super) variance: f32,
    pub(super) model: f32,
    /// Sum of the variance of single segments of the class, relative to T (1 - T), over the segments.
    pub(super) single: f32,
    /// Whether only the first packet was followed, because exact rays take less time to an error in its class.
    pub left: bool,
}

/// Kernel that follows the segments of bundles, and passes the results and transmittances of each packet, and its class, to `each`.
pub(super) struct Bundles<'a> {
    pub cut: &'a DistanceCut,
    pub bundles: &'a [Bundle<'a>],
    pub tracing: Tracing<'a>,
    /// Optical depth, before its correction, at which a segment counts as blocked.
    pub opaque: f32,
    pub each: &'a mut dyn FnMut(usize, PacketResult),
}

impl Kernel for Bundles<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let cut = self.cut;
        let mut stack = EMPTY_STACK;
        for (k, bundle) in self.bundles.iter().enumerate() {
            let width = self.tracing.mode().map_or(0.0, |mode| mode.width * bundle.emitter_size);
            let shells = matches!(self.tracing, Tracing::Exact { shells: true });
            let rule = AveragingRule { width, opaque: self.opaque };
            let mut left_out = 0;
            for (lane, shell) in cut.shells.iter().enumerate() {
                left_out |= u32::from(!shells && shell.is_passive(simd, bundle)) << lane;
            }
            for (number, packet) in bundle.packets.iter().enumerate() {
                let trace = trace(simd, cut, 0, left_out, packet, &rule, &mut stack);
                let segments = packet.len() as u32;
                let class = class(&trace, segments);
                let factor = self.tracing.mode().map_or(1.0, |mode| mode.fits[class].factor);
                let lanes = transmittances(simd, &trace, factor);
                let left = number == 0 && {
                    let all = bundle.packets.iter().map(Packet::len).sum();
                    !self.tracing.goes_on(class, bundle.packets.len(), all)
                };
                (self.each)(k, PacketResult { trace: &trace, segments, class, lanes: &lanes, left });
                if left {
                    break;
                }
            }
        }
    }
}

/// The results and transmittances of the segments of a packet.
pub(super) struct PacketResult<'a> {
    pub trace: &'a PacketTrace,
    pub segments: u32,
    pub class: usize,
    pub lanes: &'a [f32; LANES],
    /// See [`BundleSums::left`].
    pub left: bool,
}

/// The transmittances of the segments of a packet with a factor of all extinctions.
#[inline(always)]
fn transmittances<S: Simd>(simd: S, trace: &PacketTrace, factor: f32) -> [f32; LANES] {
    let depth = simd.mul(simd.load(&trace.depths), simd.splat(factor));
    let passes = simd.bits(simd.le(depth, simd.splat(OPAQUE_DEPTH))) & trace.open;
    let mut lanes = [0.0; LANES];
    simd.store(simd.keep(simd.mask(passes), decay(simd, depth)), &mut lanes);
    lanes
}

impl BundleSums {
    /// Numbers of tests of a packet.
    pub(super) fn counted(trace: &PacketTrace, segments: u32) -> BundleSums {
        let PacketTrace { nodes, blocks, node_tests, block_tests, .. } = *trace;
        let aggregated = trace.aggregated.count_ones();
        BundleSums { segments, aggregated, nodes, blocks, node_tests, block_tests, ..BundleSums::default() }
    }

    /// Sums of a packet of a bundle of n segments.
    pub(super) fn of(packet: &PacketResult, tracing: Tracing, n: f32) -> BundleSums {
        let mut sums = BundleSums::counted(packet.trace, packet.segments);
        sums.left = packet.left;
        for t in packet.lanes {
            sums.transmittance += t;
            sums.square += t * t;
        }
        if let Some(mode) = tracing.mode() {
            let fit = &mode.fits[packet.class];
            sums.variance = fit.averaged(n) * packet.segments as f32;
            sums.model = fit.model * packet.segments as f32;
            sums.single = fit.single * packet.segments as f32;
        }
        sums
    }

    /// Adds another packet or bundle.
    pub fn add(&mut self, other: BundleSums) {
        self.transmittance += other.transmittance;
        self.square += other.square;
        self.segments += other.segments;
        self.aggregated += other.aggregated;
        self.nodes += other.nodes;
        self.blocks += other.blocks;
        self.node_tests += other.node_tests;
        self.block_tests += other.block_tests;
        self.variance += other.variance;
        self.model += other.model;
        self.single += other.single;
        self.left |= other.left;
    }

    /// Units of work of these tests.
    pub fn work(&self) -> f64 {
        self.weighed(&WORK)
    }

    /// Units of work that Embree takes for the same segments, if nothing was averaged, by single rays or by packets.
    pub fn embree_work(&self) -> f64 {
        let decoded = f64::from(self.nodes + self.blocks);
        let shared = f64::from(self.node_tests) / (LANES as f64 * f64::from(self.nodes.max(1)));
        let [segment, together, apart] = PACKETS;
        let packets =
            segment * f64::from(self.segments) + decoded * (together + apart * (1.0 - shared).max(0.0));
        self.weighed(&EMBREE_WORK).min(packets)
    }

    fn weighed(&self, work: &[f64; 5]) -> f64 {
        let counts = [self.segments, self.nodes, self.blocks, self.node_tests, self.block_tests];
        counts.iter().zip(work).map(|(&count, work)| f64::from(count) * work).sum()
    }
}

impl DistanceCut {
    /// Follows the segments of bundles, and passes the number of each bundle and its sums to `each`, in order.
    pub(super) fn each_sum(
        &self,
        bundles: &[Bundle],
        tracing: Tracing,
        mut each: impl FnMut(usize, BundleSums),
    ) {
        let segments = |bundle: &Bundle| bundle.packets.iter().map(Packet::len).sum::<usize>() as f32;
        let (mut at, mut all) = (0, BundleSums::default());
        let mut n = bundles.first().map_or(0.0, segments);
        self.each_packet(bundles, tracing, &mut |k, packet| {
            while at < k {
                each(at, std::mem::take(&mut all));
                at += 1;
                n = segments(&bundles[at]);
            }
            all.add(BundleSums::of(&packet, tracing, n));
        });
        while at < bundles.len() {
            each(at, std::mem::take(&mut all));
            at += 1;
        }
    }

    /// Follows the segments of a bundle.
    pub(super) fn sum(&self, bundle: &Bundle, tracing: Tracing) -> BundleSums {
        let mut all = BundleSums::default();
        self.each_sum(std::slice::from_ref(bundle), tracing, |_, sums| all = sums);
        all
    }
}
