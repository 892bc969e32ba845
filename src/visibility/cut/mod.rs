//! The distance cut: a tree over all triangles with exact triangles in its leaves, whose children are averaged by their extinction as
//! soon as they look small from the receiver (docs/method.md, Distance cut).
//!
//! A segment of a bundle of n stands for a part of the emitter, of width e/√n. The cut applies the umbra criterion with this width, and
//! follows each segment by itself: bundles as wide as a sky have nothing in common that walks could share.

mod build;
mod extinction;
mod layout;
mod near;
mod pieces;
mod pilot;
mod shells;
#[cfg(test)]
mod tests;
mod traverse;

use super::answer::{Answer, Bundle, Cost, Method, interval};
use super::cost_model::{CutUse, Route};
use crate::ray::{LANES, Occluder, Packet};
use crate::scene::Scene;
use crate::simd::{Isa, Kernel, Simd, dispatch};
use layout::{Block, Extinctions, Node};
use shells::Shell;
use traverse::{Met, STACK, Segments, Threshold, trace, transmitted};

/// Width of the part of the emitter that a segment stands for, relative to e/√n, until the pilot chooses one.
const REACH: f32 = 1.0;
/// Work of a segment, a node and a block: their times in nanoseconds on the processor that was measured (AVX-512), in units of 2.5 ns.
const WORK: [f64; 3] = [10.0, 6.0, 12.0];

/// The tree of the distance cut.
#[derive(Clone)]
pub struct Cut {
    nodes: Vec<Node>,
    extinctions: Vec<Extinctions>,
    blocks: Vec<Block>,
    /// Surfaces that are the first children of the root.
    shells: Vec<Shell>,
    isa: Isa,
    /// Width of the part of the emitter that a segment stands for, relative to e/√n.
    reach: f32,
    /// Factor of all extinctions.
    factor: f32,
    pub(super) uses: CutUse,
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

impl Cut {
    /// Builds the tree of a scene and measures its extinctions. The result does not depend on the number of threads.
    pub fn build(scene: &Scene) -> Cut {
        let pieces = pieces::Pieces::of(scene);
        let (shells, of_triangle) = shells::find(scene, &pieces);
        let draft = build::build(scene, &pieces, (shells.len() as u32, &of_triangle));
        let build::Draft { nodes, extinctions, blocks, facts } = draft;
        let mut cut = Cut {
            nodes,
            extinctions,
            blocks,
            shells,
            isa: Isa::detect(),
            reach: REACH,
            factor: 1.0,
            uses: CutUse::default(),
        };
        extinction::measure(&mut cut, &facts);
        cut
    }

    /// Fits the correction to exact segments, independent bundles of one packet each, and decides for which receivers the cut is used.
    #[must_use]
    pub fn fitted(mut self, bundles: &[Bundle], exact: &impl Occluder) -> Cut {
        pilot::fit(&mut self, bundles, exact);
        self
    }

    /// Sets the reach, for measurements.
    #[cfg(feature = "internals")]
    pub fn set(&mut self, reach: f32) {
        self.reach = reach;
    }

    /// The reach and the factor of extinctions.
    #[cfg(feature = "internals")]
    pub fn fit(&self) -> (f32, f32) {
        (self.reach, self.factor)
    }

    /// Size of all arrays in bytes.
    #[cfg(any(test, feature = "reports"))]
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice())
            + size_of_val(self.extinctions.as_slice())
            + size_of_val(self.blocks.as_slice())
    }

    /// Number of blocks of small pieces around a receiver that are tested triangle by triangle, at most `limit`, for feature size `s`
    /// and segments that stand for an angle `w`.
    fn near(&self, at: glam::Vec3, s: f32, w: f32, limit: u32) -> u32 {
        dispatch(self.isa, near::Near { cut: self, at, threshold: Threshold { s, e: w }, limit })
    }

    /// Class of the receiver of a bundle with feature size `s`.
    pub(super) fn class(&self, bundle: &Bundle, s: f32) -> usize {
        let Some(first) = bundle.packets.first().filter(|packet| !packet.is_empty()) else { return 0 };
        let lane = first.active.trailing_zeros() as usize;
        let (from, to) = (first.point(lane, 0.0), first.point(lane, 1.0));
        let w = self.width(bundle) / from.distance(to).max(f32::MIN_POSITIVE);
        Route::class(self.near(from, s, w, Route::MAX_BLOCKS))
    }

    /// Class of a receiver, and whether the cut is used for it.
    #[cfg(feature = "internals")]
    pub fn class_and_use(&self, bundle: &Bundle) -> (usize, bool) {
        (self.class(bundle, 0.0), self.takes(bundle, 0.0))
    }

    /// Whether the cut answers a bundle: its receiver is of a class where it pays, and its segments begin there.
    pub(super) fn takes(&self, bundle: &Bundle, s: f32) -> bool {
        bundle.emitter_size > 0.0
            && self.uses.classes.contains(&true)
            && bundle.packets.iter().all(|packet| packet.backwards == 0)
            && self.uses.classes[self.class(bundle, s)]
    }

    /// Width of the part of the emitter that a segment of a bundle stands for.
    fn width(&self, bundle: &Bundle) -> f32 {
        let n: usize = bundle.packets.iter().map(Packet::len).sum();
        bundle.emitter_size * (self.reach / (n.max(1) as f32).sqrt()).min(1.0)
    }

    /// Follows the segments of bundles, with feature size `s`, and passes the sums of each to `each`.
    #[cfg(feature = "internals")]
    pub fn sums(&self, bundles: &[Bundle], s: f32, mut each: impl FnMut(Sums)) {
        for bundle in bundles {
            let mut all = Sums::default();
            self.each_packet(std::slice::from_ref(bundle), Some(s), |sums, _, _| all.add(sums));
            each(all);
        }
    }

    /// Follows the segments of bundles and passes the sums of each packet, depths and segments that are not blocked to `each`. Nothing is
    /// averaged without a feature size.
    fn each_packet(&self, bundles: &[Bundle], s: Option<f32>, each: impl FnMut(Sums, &[f32; LANES], u32)) {
        dispatch(self.isa, Bundles { cut: self, bundles, s, each });
    }

    /// The answer to a bundle for feature size `s`.
    pub(super) fn answer(&self, bundle: &Bundle, s: f32) -> Answer {
        let mut sums = Sums::default();
        self.each_packet(std::slice::from_ref(bundle), Some(s), |packet, _, _| sums.add(packet));
        let n = (sums.segments as f32).max(1.0);
        let transmittance = if sums.segments == 0 { 1.0 } else { (sums.transmittance / n).min(1.0) };
        let variance = (sums.square / n - transmittance * transmittance).max(0.0);
        // Without aggregation there is no model error.
        let part = sums.aggregated as f32 / n;
        let model = (part * self.uses.model * transmittance * (1.0 - transmittance)).max(0.0).sqrt();
        let (lo, hi) = interval(transmittance, variance, n, model);
        let method = match (sums.blocks > 0, sums.aggregated > 0) {
            (_, false) => Method::Exact,
            (false, true) => Method::Aggregated,
            (true, true) => Method::Mixed,
        };
        let segments = u64::from(sums.segments);
        let cost = Cost {
            segments,
            nodes: sums.nodes.into(),
            exact_rays: if sums.blocks > 0 { segments } else { 0 },
            aggregated: sums.aggregated.into(),
            ..Cost::default()
        };
        Answer { transmittance, lo, hi, method, cost }
    }
}

/// Kernel that follows the segments of bundles.
struct Bundles<'a, F> {
    cut: &'a Cut,
    bundles: &'a [Bundle<'a>],
    s: Option<f32>,
    each: F,
}

impl<F: FnMut(Sums, &[f32; LANES], u32)> Kernel for Bundles<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        let cut = self.cut;
        let mut stack = [0; STACK];
        for bundle in self.bundles {
            let threshold = self.s.map_or(Threshold::NOTHING, |s| Threshold { s, e: cut.width(bundle) });
            let mut left_out = 0;
            for (lane, shell) in cut.shells.iter().enumerate() {
                left_out |= u32::from(shell.is_passive(simd, bundle)) << lane;
            }
            for packet in bundle.packets {
                let mut sums = Sums { segments: packet.len() as u32, ..Sums::default() };
                let (depths, open) = sums.follow(simd, (cut, left_out), packet, &threshold, &mut stack);
                (self.each)(sums, &depths, open);
            }
        }
    }
}

impl Sums {
    fn add(&mut self, other: Sums) {
        self.transmittance += other.transmittance;
        self.square += other.square;
        self.segments += other.segments;
        self.aggregated += other.aggregated;
        self.nodes += other.nodes;
        self.blocks += other.blocks;
    }

    /// Units of work.
    fn work(&self) -> f64 {
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
        packet: &Packet,
        threshold: &Threshold,
        stack: &mut [u32; STACK],
    ) -> ([f32; LANES], u32) {
        let (mut depths, mut open) = ([0.0; LANES], 0);
        let segments = Segments::of(simd, packet);
        for lane in packet.lanes() {
            let met = trace(simd, cut, (0, left_out), (&segments, lane), threshold, stack);
            let Met { depth, blocked, aggregated, nodes, blocks } = met;
            depths[lane] = depth;
            open |= u32::from(!blocked) << lane;
            self.aggregated += u32::from(aggregated);
            self.nodes += nodes;
            self.blocks += blocks;
        }
        for t in transmitted(simd, &depths, open, cut.factor) {
            self.transmittance += t;
            self.square += t * t;
        }
        (depths, open)
    }
}
