//! The distance cut: a tree over all triangles with exact triangles in its leaves, whose children are averaged by their extinction as
//! soon as they look small from the receiver (docs/method.md, Distance cut).
//!
//! A segment stands for a part of the emitter. The cut applies the umbra criterion with the width of that part and a feature size of 0,
//! and follows each segment by itself: bundles as wide as a sky have nothing in common that walks could share. What it averages depends
//! neither on the feature size of a query nor on its number of segments, so that the pilot that measures its errors holds for all.

mod build;
mod extinction;
mod layout;
mod modes;
mod near;
mod pieces;
mod pilot;
mod shells;
mod sums;
#[cfg(test)]
mod tests;
mod traverse;

use super::answer::{Answer, Bundle, Cost, Method, interval, wilson};
use crate::ray::{LANES, Packet};
use crate::scene::Scene;
use crate::simd::{Isa, dispatch};
use layout::{Block, Extinctions, Node};
pub use modes::Mode;
use modes::Plan;
pub(super) use modes::over_embree;
use near::Found;
pub use pilot::Candidate;
use shells::Shell;
pub use sums::Sums;
use sums::{Bundles, How};

/// Width of what a segment stands for, relative to the emitter's, by which receivers are classed: the largest of a mode, with which the
/// least must be counted. With a quarter of it a class takes longer in a forest than sixteen segments do.
const CLASS_WIDTH: f32 = 1.0;

/// The tree of the distance cut.
#[derive(Clone)]
pub struct Cut {
    nodes: Vec<Node>,
    extinctions: Vec<Extinctions>,
    blocks: Vec<Block>,
    /// Surfaces that are the first children of the root.
    shells: Vec<Shell>,
    isa: Isa,
    plan: Plan,
}

impl Cut {
    /// Builds the tree of a scene and measures its extinctions; it answers nothing until it is [fitted](Cut::fitted). The result does not
    /// depend on the number of threads.
    pub fn build(scene: &Scene) -> Cut {
        let pieces = pieces::Pieces::of(scene);
        let (shells, of_triangle) = shells::find(scene, &pieces);
        let draft = build::build(scene, &pieces, (shells.len() as u32, &of_triangle));
        let build::Draft { nodes, extinctions, blocks, facts } = draft;
        let mut cut = Cut { nodes, extinctions, blocks, shells, isa: Isa::detect(), plan: Plan::default() };
        extinction::measure(&mut cut, &facts);
        cut
    }

    /// Size of all arrays in bytes.
    #[cfg(any(test, feature = "reports"))]
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice())
            + size_of_val(self.extinctions.as_slice())
            + size_of_val(self.blocks.as_slice())
    }

    /// Blocks of small pieces around the receiver of a bundle that cannot be averaged, at most `limit`.
    fn near(&self, bundle: &Bundle, limit: u32) -> Found {
        let Some(first) = bundle.packets.first().filter(|packet| !packet.is_empty()) else {
            return Found::default();
        };
        let lane = first.active.trailing_zeros() as usize;
        let (at, to) = (first.point(lane, 0.0), first.point(lane, 1.0));
        let angle = CLASS_WIDTH * bundle.emitter_size / at.distance(to).max(f32::MIN_POSITIVE);
        dispatch(self.isa, near::Near { cut: self, at, angle, limit })
    }

    /// How the cut answers a bundle, if it does: its receiver is of a class where that pays for so many segments, and its segments begin
    /// there. And the work of finding out.
    pub(super) fn mode(&self, bundle: &Bundle) -> (Option<Mode>, f64) {
        if bundle.emitter_size <= 0.0 || bundle.packets.iter().any(|packet| packet.backwards != 0) {
            return (None, 0.0);
        }
        let modes = self.plan.of_number(bundle.packets.iter().map(Packet::len).sum());
        let Some(last) = modes.iter().rposition(Option::is_some) else { return (None, 0.0) };
        let found = self.near(bundle, modes::limit(last));
        (modes[modes::class(found)], found.work())
    }

    /// Class of the receiver of a bundle.
    #[cfg(feature = "internals")]
    pub fn class(&self, bundle: &Bundle) -> usize {
        modes::class(self.near(bundle, u32::MAX))
    }

    /// The answer to a bundle, if the cut answers it.
    #[cfg(feature = "internals")]
    pub fn planned_answer(&self, bundle: &Bundle) -> Option<Answer> {
        self.mode(bundle).0.map(|mode| self.answer(bundle, &mode).0)
    }

    /// The mode of each class for n segments.
    #[cfg(feature = "internals")]
    pub fn planned(&self, n: usize) -> Vec<Option<Mode>> {
        self.plan.of_number(n).to_vec()
    }

    /// Follows the segments of a bundle with a width, relative to that of the emitter, and a factor of all extinctions.
    #[cfg(feature = "internals")]
    pub fn sums(&self, bundle: &Bundle, width: f32, factor: f32) -> Sums {
        self.sum(bundle, How { width, factor, shells: width == 0.0 })
    }

    /// Work of exact segments through the tree.
    pub(super) fn exact_work(&self, bundle: &Bundle) -> f64 {
        self.sum(bundle, How::EXACT).work()
    }

    fn sum(&self, bundle: &Bundle, how: How) -> Sums {
        let mut all = Sums::default();
        self.each_packet(std::slice::from_ref(bundle), how, |sums, _, _| all.add(sums));
        all
    }

    /// Follows the segments of bundles and passes the sums of each packet, depths and segments that are not blocked to `each`.
    fn each_packet(&self, bundles: &[Bundle], how: How, each: impl FnMut(Sums, &[f32; LANES], u32)) {
        dispatch(self.isa, Bundles { cut: self, bundles, how, each });
    }

    /// The answer to a bundle in a mode.
    pub(super) fn answer(&self, bundle: &Bundle, mode: &Mode) -> (Answer, Sums) {
        let sums = self.sum(bundle, How::of(mode));
        let n = (sums.segments as f32).max(1.0);
        let transmittance = if sums.segments == 0 { 1.0 } else { (sums.transmittance / n).min(1.0) };
        let (lo, hi) = match sums.aggregated {
            0 => wilson(transmittance, n),
            _ => stated(transmittance, sums.square / n, n, mode),
        };
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
        (Answer { transmittance, lo, hi, method, cost }, sums)
    }
}

impl How {
    fn of(mode: &Mode) -> How {
        How { width: mode.width, factor: mode.factor, shells: false }
    }
}

/// Factor of the model's mean square error in intervals: its errors have heavier tails than a normal distribution. With 1 intervals of 16
/// segments hold 92 % on the ground of a forest (`cargo bench --bench distance_cut`).
const TAILS: f32 = 1.5;
/// Segments that the pilot counts for in the estimate of an answer's variance: as many as those of an answer of sixteen.
const PRIOR: f32 = 16.0;

/// The stated interval of a mean T of n transmittances with this mean square. A mean of variance v holds as much as T (1 - T) / v values
/// of 0 or 1; the interval is Wilson's for so many, with the error of the model.
fn stated(mean: f32, square: f32, n: f32, mode: &Mode) -> (f32, f32) {
    let binary = mean * (1.0 - mean);
    if binary <= 0.0 {
        return wilson(mean, n);
    }
    let own = ((square - mean * mean) * n / (n - 1.0).max(1.0) / binary).clamp(0.0, 1.0);
    let single = (n * own + PRIOR * mode.single.min(1.0)) / (n + PRIOR);
    let variance = single * mode.averaged(n);
    interval(mean, binary, 1.0 / variance.max(f32::MIN_POSITIVE), (TAILS * mode.model * binary).sqrt())
}
