//! Sums over the segments of bundles that the cut follows.

use super::Cut;
use super::traverse::{Met, OPAQUE_DEPTH, Rule, STACK, Segments, trace};
use crate::ray::{LANES, Packet};
use crate::simd::{Kernel, Simd, decay};
use crate::visibility::answer::Bundle;

/// Work of a segment, a node and a block: their times in nanoseconds on the processor that was measured (AVX-512), in units of 2.5 ns.
const WORK: [f64; 3] = [10.0, 6.0, 12.0];

/// What segments average: those of an answer, or none.
#[derive(Clone, Copy, Debug)]
pub(super) struct How {
    /// Width of the part of the emitter that a segment stands for, relative to that of the emitter; 0 averages nothing.
    pub width: f32,
    /// Factor of all extinctions.
    pub factor: f32,
    /// Whether shells that a bundle cannot meet are tested nevertheless.
    pub shells: bool,
}

impl How {
    /// As Embree does: nothing is averaged, nothing is left out.
    pub const EXACT: How = How { width: 0.0, factor: 1.0, shells: true };
}

/// Sums over the segments of a bundle.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// Sum of the transmittances.
    pub transmittance: f32,
    /// Sum of their squares.
    pub square: f32,
    /// Number of segments.
    pub segments: u32,
    /// Segments that met an aggregated child.
    pub aggregated: u32,
    /// Nodes that were tested.
    pub nodes: u32,
    /// Blocks of triangles that were tested.
    pub blocks: u32,
}

/// Kernel that follows the segments of bundles, and passes sums, optical depths and open segments of each packet to `each`.
pub(super) struct Bundles<'a, F> {
    pub cut: &'a Cut,
    pub bundles: &'a [Bundle<'a>],
    pub how: How,
    pub each: F,
}

impl<F: FnMut(Sums, &[f32; LANES], u32)> Kernel for Bundles<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        let (cut, How { width, factor, shells }) = (self.cut, self.how);
        let mut stack = [0; STACK];
        for bundle in self.bundles {
            let rule = match width > 0.0 {
                true => Rule { width: width * bundle.emitter_size, opaque: OPAQUE_DEPTH / factor },
                false => Rule::NOTHING,
            };
            let mut left_out = 0;
            for (lane, shell) in cut.shells.iter().enumerate() {
                left_out |= u32::from(!shells && shell.is_passive(simd, bundle)) << lane;
            }
            for packet in bundle.packets {
                let mut sums = Sums { segments: packet.len() as u32, ..Sums::default() };
                let (depths, open) = sums.follow(simd, (cut, left_out), (packet, factor), &rule, &mut stack);
                (self.each)(sums, &depths, open);
            }
        }
    }
}

impl Sums {
    pub(super) fn add(&mut self, other: Sums) {
        self.transmittance += other.transmittance;
        self.square += other.square;
        self.segments += other.segments;
        self.aggregated += other.aggregated;
        self.nodes += other.nodes;
        self.blocks += other.blocks;
    }

    /// Units of work.
    pub(in crate::visibility) fn work(&self) -> f64 {
        WORK[0] * f64::from(self.segments)
            + WORK[1] * f64::from(self.nodes)
            + WORK[2] * f64::from(self.blocks)
    }

    /// Follows the segments of a packet; optical depths, and the segments that are not blocked.
    #[inline(always)]
    fn follow<S: Simd>(
        &mut self,
        simd: S,
        (cut, left_out): (&Cut, u32),
        (packet, factor): (&Packet, f32),
        rule: &Rule,
        stack: &mut [u32; STACK],
    ) -> ([f32; LANES], u32) {
        let (mut depths, mut open) = ([0.0; LANES], 0);
        let segments = Segments::of(simd, packet);
        for lane in packet.lanes() {
            let met = trace(simd, cut, (0, left_out), (&segments, lane), rule, stack);
            let Met { depth, blocked, aggregated, nodes, blocks } = met;
            depths[lane] = depth;
            open |= u32::from(!blocked) << lane;
            self.aggregated += u32::from(aggregated);
            self.nodes += nodes;
            self.blocks += blocks;
        }
        let mut lanes = [0.0; LANES];
        let depth = simd.mul(simd.load(&depths), simd.splat(factor));
        simd.store(simd.keep(simd.mask(open), decay(simd, depth)), &mut lanes);
        for t in lanes {
            self.transmittance += t;
            self.square += t * t;
        }
        (depths, open)
    }
}
