//! Sums over the segments of bundles that the cut follows.

use super::Cut;
use super::modes::{Mode, class};
use super::traverse::{EMPTY_STACK, Met, OPAQUE_DEPTH, Rule, trace};
use crate::ray::{LANES, Packet};
use crate::simd::{Kernel, Simd, decay};
use crate::visibility::answer::Bundle;

/// Work of a segment, of decoding a node or block, and of tests of a segment against a node and a block, in units of 2.5 ns on the
/// processor that was measured (AVX-512; `benches/distance_cut.rs` of commit 2d559b4: work and times agree to a third in garden,
/// park, forest).
const WORK: [f64; 5] = [6.0, 6.0, 3.0, 4.5, 6.0];
/// The same for single rays of Embree, which share nothing.
const EMBREE_WORK: [f64; 5] = [10.0, 0.0, 0.0, 6.0, 12.0];
/// Work of packets of Embree for a segment, and for a node or block: for packets all of whose segments meet it, and what is added as none
/// does, because Embree's nodes are smaller. With these the work in rooms is 16 to 22 units for 40 ns, and outdoors that of single rays
/// is less.
const PACKETS: [f64; 3] = [5.0, 10.0, 35.0];

/// How the segments of a bundle are traced.
#[derive(Clone, Copy)]
pub(super) enum How<'a> {
    /// Nothing is averaged; `shells` states whether shells that the bundle cannot meet are tested nevertheless.
    Exact { shells: bool },
    /// A mode.
    Mode(&'a Mode),
    /// A mode; for bundles of several packets only if the mode pays in the class of the first packet.
    IfItPays(&'a Mode),
}

impl<'a> How<'a> {
    /// The mode, if anything is averaged.
    pub fn mode(self) -> Option<&'a Mode> {
        match self {
            How::Exact { .. } => None,
            How::Mode(mode) | How::IfItPays(mode) => Some(mode),
        }
    }

    /// Whether all packets of a bundle are followed, as one of `count` with `segments` in the class of the first.
    #[inline(always)]
    fn goes_on(self, class: usize, [count, segments]: [usize; 2]) -> bool {
        match self {
            How::IfItPays(mode) if count > 1 => mode.fits[class].gain_of(segments as f32) > 1.0,
            _ => true,
        }
    }
}

/// Sums over the segments of a bundle.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
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
    pub cut: &'a Cut,
    pub bundles: &'a [Bundle<'a>],
    pub how: How<'a>,
    /// Optical depth, before its correction, at which a segment counts as blocked.
    pub opaque: f32,
    pub each: &'a mut dyn FnMut(usize, Packeted),
}

impl Kernel for Bundles<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let cut = self.cut;
        let mut stack = EMPTY_STACK;
        for (k, bundle) in self.bundles.iter().enumerate() {
            let width = self.how.mode().map_or(0.0, |mode| mode.width * bundle.emitter_size);
            let shells = matches!(self.how, How::Exact { shells: true });
            let rule = Rule { width, opaque: self.opaque };
            let mut left_out = 0;
            for (lane, shell) in cut.shells.iter().enumerate() {
                left_out |= u32::from(!shells && shell.is_passive(simd, bundle)) << lane;
            }
            for (number, packet) in bundle.packets.iter().enumerate() {
                let met = trace(simd, cut, (0, left_out), packet, &rule, &mut stack);
                let segments = packet.len() as u32;
                let class = class(&met, segments);
                let factor = self.how.mode().map_or(1.0, |mode| mode.fits[class].factor);
                let lanes = transmittances(simd, &met, factor);
                let left = number == 0 && {
                    let all = bundle.packets.iter().map(Packet::len).sum();
                    !self.how.goes_on(class, [bundle.packets.len(), all])
                };
                (self.each)(k, Packeted { met: &met, segments, class, lanes: &lanes, left });
                if left {
                    break;
                }
            }
        }
    }
}

/// The results and transmittances of the segments of a packet.
pub(super) struct Packeted<'a> {
    pub met: &'a Met,
    pub segments: u32,
    pub class: usize,
    pub lanes: &'a [f32; LANES],
    /// See [`Sums::left`].
    pub left: bool,
}

/// The transmittances of the segments of a packet with a factor of all extinctions.
#[inline(always)]
fn transmittances<S: Simd>(simd: S, met: &Met, factor: f32) -> [f32; LANES] {
    let depth = simd.mul(simd.load(&met.depths), simd.splat(factor));
    let passes = simd.bits(simd.le(depth, simd.splat(OPAQUE_DEPTH))) & met.open;
    let mut lanes = [0.0; LANES];
    simd.store(simd.keep(simd.mask(passes), decay(simd, depth)), &mut lanes);
    lanes
}

impl Sums {
    /// Numbers of tests of a packet.
    pub(super) fn counted(met: &Met, segments: u32) -> Sums {
        let Met { nodes, blocks, node_tests, block_tests, .. } = *met;
        let aggregated = met.aggregated.count_ones();
        Sums { segments, aggregated, nodes, blocks, node_tests, block_tests, ..Sums::default() }
    }

    /// Sums of a packet of a bundle of n segments.
    pub(super) fn of(packet: &Packeted, how: How, n: f32) -> Sums {
        let mut sums = Sums::counted(packet.met, packet.segments);
        sums.left = packet.left;
        for t in packet.lanes {
            sums.transmittance += t;
            sums.square += t * t;
        }
        if let Some(mode) = how.mode() {
            let fit = &mode.fits[packet.class];
            sums.variance = fit.averaged(n) * packet.segments as f32;
            sums.model = fit.model * packet.segments as f32;
            sums.single = fit.single * packet.segments as f32;
        }
        sums
    }

    /// Adds another packet or bundle.
    pub fn add(&mut self, other: Sums) {
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
        let met = f64::from(self.node_tests) / (LANES as f64 * f64::from(self.nodes.max(1)));
        let [segment, together, apart] = PACKETS;
        let packets =
            segment * f64::from(self.segments) + decoded * (together + apart * (1.0 - met).max(0.0));
        self.weighed(&EMBREE_WORK).min(packets)
    }

    fn weighed(&self, work: &[f64; 5]) -> f64 {
        let counts = [self.segments, self.nodes, self.blocks, self.node_tests, self.block_tests];
        counts.iter().zip(work).map(|(&count, work)| f64::from(count) * work).sum()
    }
}

impl Cut {
    /// Follows the segments of bundles, and passes the number of each bundle and its sums to `each`, in order.
    pub(super) fn each_sum(&self, bundles: &[Bundle], how: How, mut each: impl FnMut(usize, Sums)) {
        let segments = |bundle: &Bundle| bundle.packets.iter().map(Packet::len).sum::<usize>() as f32;
        let (mut at, mut all) = (0, Sums::default());
        let mut n = bundles.first().map_or(0.0, segments);
        self.each_packet(bundles, how, &mut |k, packet| {
            while at < k {
                each(at, std::mem::take(&mut all));
                at += 1;
                n = segments(&bundles[at]);
            }
            all.add(Sums::of(&packet, how, n));
        });
        while at < bundles.len() {
            each(at, std::mem::take(&mut all));
            at += 1;
        }
    }

    /// Follows the segments of a bundle.
    pub(super) fn sum(&self, bundle: &Bundle, how: How) -> Sums {
        let mut all = Sums::default();
        self.each_sum(std::slice::from_ref(bundle), how, |_, sums| all = sums);
        all
    }
}
