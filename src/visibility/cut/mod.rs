//! The distance cut: a tree over all triangles with exact triangles in its leaves, whose children are averaged by their extinction as
//! soon as they look small from the receiver (docs/method.md, Distance cut).
//!
//! A segment represents a part of the emitter. The cut applies the umbra criterion with the width of that part and a feature size of 0.
//! The averaged children depend neither on the feature size of a query nor on its number of segments, so that the errors measured by
//! the pilot apply to all queries.

mod ball;
mod build;
mod extinction;
mod layout;
mod modes;
mod pilot;
mod shells;
mod sums;
#[cfg(test)]
mod tests;
mod traverse;

use super::answer::{Answer, Bundle, Cost, Method, interval, wilson};
use crate::ray::{LANES, Occluder};
use crate::scene::Scene;
use crate::simd::{Isa, dispatch};
pub(super) use ball::HalfBall;
use layout::{CutBlock, CutNode, Extinctions};
pub use modes::{Mode, rays_for};
pub use pilot::Candidate;
use shells::Shell;
#[cfg(any(test, feature = "reports"))]
pub use shells::{MIN_LARGE_SURFACE, surface_widths};
pub use sums::BundleSums;
use sums::{Bundles, PacketResult, Tracing};
use traverse::OPAQUE_DEPTH;

/// The tree of the distance cut.
#[derive(Clone)]
pub struct DistanceCut {
    nodes: Vec<CutNode>,
    extinctions: Vec<Extinctions>,
    blocks: Vec<CutBlock>,
    /// Surfaces that are the first children of the root.
    shells: Vec<Shell>,
    isa: Isa,
    modes: Vec<Mode>,
}

impl DistanceCut {
    /// The tree of a scene, measured and fitted on a pilot: independent receivers by number, with exact visibility. None if the cut gains
    /// for no receiver. The result does not depend on the number of threads.
    pub fn fitted<'a>(
        scene: &Scene,
        candidate: impl Fn(u32) -> Option<Candidate<'a>> + Sync,
        exact: &impl Occluder,
    ) -> Option<DistanceCut> {
        let (mut cut, facts) = DistanceCut::draft(scene);
        if !cut.averages_enough(&candidate) {
            return None;
        }
        extinction::measure(&mut cut, &facts);
        cut.fit(candidate, exact)
    }

    /// The tree of a scene with its extinctions, without modes.
    #[cfg(test)]
    pub fn build(scene: &Scene) -> DistanceCut {
        let (mut cut, facts) = DistanceCut::draft(scene);
        extinction::measure(&mut cut, &facts);
        cut
    }

    /// The tree without extinctions, and the properties of children from which these are measured.
    fn draft(scene: &Scene) -> (DistanceCut, Vec<build::NodeProperties>) {
        let pieces = shells::Pieces::of(scene);
        let (shells, of_triangle) = shells::find(scene, &pieces);
        let draft = build::build(scene, &pieces, shells.len() as u32, &of_triangle);
        let build::Draft { mut nodes, extinctions, blocks, facts } = draft;
        nodes.iter_mut().zip(extinction::stops(&facts)).for_each(|(node, stop)| node.stop = stop);
        (DistanceCut { nodes, extinctions, blocks, shells, isa: Isa::detect(), modes: Vec::new() }, facts)
    }

    /// Size of all arrays in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice())
            + size_of_val(self.extinctions.as_slice())
            + size_of_val(self.blocks.as_slice())
    }

    /// The modes that the pilot has measured.
    pub fn modes(&self) -> &[Mode] {
        &self.modes
    }

    /// Whether the cut may answer a bundle: all segments lead from the receiver to an emitter that has a width.
    pub(super) fn takes(&self, bundle: &Bundle) -> bool {
        bundle.emitter_size > 0.0 && bundle.packets.iter().all(|packet| packet.backwards == 0)
    }

    /// Work that Embree takes for a bundle.
    pub(super) fn embree_work(&self, bundle: &Bundle) -> f64 {
        self.sum(bundle, Tracing::Exact { shells: true }).embree_work()
    }

    /// Follows the segments of bundles and passes the number of the bundle and the results of each packet to `each`, which is not a
    /// type parameter: the compiler would compile the traversal for three instruction sets again for each caller.
    fn each_packet(&self, bundles: &[Bundle], tracing: Tracing, each: &mut dyn FnMut(usize, PacketResult)) {
        let opaque = OPAQUE_DEPTH / tracing.mode().map_or(1.0, Mode::smallest_factor);
        dispatch(self.isa, Bundles { cut: self, bundles, tracing, opaque, each });
    }

    /// Whether no triangle touches a half ball.
    pub(super) fn is_empty(&self, ball: HalfBall) -> bool {
        dispatch(self.isa, ball::EmptyHalfBall { cut: self, ball })
    }

    /// The answers to bundles in a mode with their sums, passed to `each` in order; no answers to bundles of several packets for which the
    /// mode does not pay (see [`BundleSums::left`]).
    pub(super) fn answers_that_pay(
        &self,
        bundles: &[Bundle],
        mode: &Mode,
        mut each: impl FnMut(Option<Answer>, BundleSums),
    ) {
        self.each_sum(bundles, Tracing::IfItPays(mode), |_, sums| {
            each((!sums.left).then(|| sums.answer()), sums)
        });
    }

    /// The answers to bundles of one packet each in a mode, with the transmittance of each segment, 0 in unused lanes.
    pub(super) fn lanes(&self, bundles: &[Bundle], mode: &Mode, mut each: impl FnMut(Answer, &[f32; LANES])) {
        let tracing = Tracing::Mode(mode);
        self.each_packet(bundles, tracing, &mut |_, packet| {
            each(BundleSums::of(&packet, tracing, packet.segments as f32).answer(), packet.lanes);
        });
    }
}

impl BundleSums {
    fn answer(&self) -> Answer {
        let sums = self;
        let n = (sums.segments as f32).max(1.0);
        let transmittance = if sums.segments == 0 { 1.0 } else { (sums.transmittance / n).min(1.0) };
        let (lo, hi) = match sums.aggregated {
            0 => wilson(transmittance, n),
            _ => {
                stated(transmittance, sums.square / n, n, sums.variance / n, sums.single / n, sums.model / n)
            }
        };
        let segments = u64::from(sums.segments);
        let cost = Cost {
            segments,
            nodes: sums.nodes.into(),
            exact_rays: if sums.blocks > 0 { segments } else { 0 },
            aggregated: sums.aggregated.into(),
            ..Cost::default()
        };
        let method = Method::of(sums.blocks > 0, sums.aggregated > 0);
        Answer { transmittance, lo, hi, method, cost }
    }
}

/// The stated interval of a mean T of n transmittances with this mean square. `averaged` is the variance of such a mean over that of a
/// single transmittance, `usual` the variance of a single one in the class and `model` the mean square of the error of the model, both
/// relative to T (1 - T). A mean of variance v is equivalent to that of T (1 - T) / v values of 0 or 1; the interval is Wilson's for this
/// number, with the error of the model.
fn stated(mean: f32, square: f32, n: f32, averaged: f32, usual: f32, model: f32) -> (f32, f32) {
    let binary = mean * (1.0 - mean);
    if binary <= 0.0 {
        return wilson(mean, n);
    }
    let own = ((square - mean * mean) * n / (n - 1.0).max(1.0) / binary).clamp(0.0, 1.0);
    let single = (n * own + PRIOR_SEGMENTS * usual.min(1.0)) / (n + PRIOR_SEGMENTS);
    let variance = (single * averaged).min(1.0);
    interval(mean, binary, 1.0 / variance.max(f32::MIN_POSITIVE), (model * binary).sqrt())
}

/// Weight, in segments, of the usual variance of the class in the estimate of an answer's own variance: that of an answer of
/// sixteen segments.
const PRIOR_SEGMENTS: f32 = 16.0;
