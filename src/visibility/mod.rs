//! How much of the light between two ends gets through: one question, several engines.
//!
//! The unit of work is the [`Bundle`]: segments that run from one receiver point (or element) to one emitter.
//! * [`Exact`]: Embree rays, every segment 0 or 1.
//! * [`MultiResolution`]: clusters whose shadow features would be smaller than `s` are not opened, their extinction
//!   transmittance is used instead [SD95 sec 3.2]; with [`Leaf::Extinction`] it is the paper's average visibility
//!   [SD95 sec 5].
//! * [`mod@reference`]: the same rule, one ray and one node at a time; what the fast engine is tested against.
//!
//! The feature size and the emitter size are arguments, never state. This room knows nothing of links, energy or
//! materials.

mod exact;
mod front;
mod multires;
pub mod reference;
mod shaft;
mod slabs;
pub mod steps;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod triangles;
mod unbiased;
mod walk;
mod wide;

pub use exact::{Exact, fastest_traversal};
pub use multires::{Leaf, MultiResolution, Workspace};
pub use unbiased::{Correction, Estimate, Unbiased};
pub use wide::WideTree;

use crate::ray::Packet;
use glam::Vec3;

/// Segments that share their ends: `origin` at the receiver, `origin + direction` on the emitter.
#[derive(Clone, Copy, Debug)]
pub struct Bundle<'a> {
    /// The segments, at most 16 a packet.
    pub packets: &'a [Packet],
    /// Smallest width of the emitter as seen along the bundle (method A.6: the smallest is the safe one), 0 for a
    /// point; scene units.
    pub emitter_size: f32,
    /// Points whose convex hull holds the whole emitter, not only the ends of these segments; none where nobody knows.
    /// With them an answer can be certain, and bundles that meet nothing, or that one triangle covers, cost the same
    /// however many segments they have.
    ///
    /// Of a convex polygon with four corners in turn its own pyramid is looked into, else that of extreme slopes.
    ///
    /// Who gives them promises that all segments begin at one point, end inside the hull, and are open by an
    /// [`crate::ray::EndRule`] of the scene.
    pub emitter: &'a [Vec3],
}

/// How an answer was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Nothing lies between the ends.
    Clear,
    /// A single triangle lies before the whole of the emitter's end; no segment was tested.
    Covered,
    /// Triangles were tested; nothing was aggregated.
    Exact,
    /// Clusters were aggregated; no triangle was tested.
    Aggregated,
    /// Both.
    Mixed,
}

/// What an answer cost and what it rests on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Segments asked for.
    pub segments: u64,
    /// Nodes of the wide tree that were visited, each counted once a bundle.
    pub nodes: u64,
    /// Segments of bundles for which triangles were tested (by this engine or by Embree).
    pub exact_rays: u64,
    /// Segments handed to Embree whole because the walk met too much that may not be aggregated.
    pub handed_over: u64,
    /// Segments whose answer contains an aggregated cluster.
    pub aggregated: u64,
    /// Segments of bundles whose answer is certain without a ray.
    pub certified: u64,
}

impl Cost {
    /// Adds another cost.
    pub fn add(&mut self, other: Cost) {
        self.segments += other.segments;
        self.nodes += other.nodes;
        self.exact_rays += other.exact_rays;
        self.handed_over += other.handed_over;
        self.aggregated += other.aggregated;
        self.certified += other.certified;
    }
}

/// The visible fraction of a bundle.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    /// Mean transmittance of the segments, in `[0, 1]`.
    pub transmittance: f32,
    /// Stated 95 % interval, lower end: sampling error of the segments, and that of the aggregated clusters, both within
    /// what any dependence between the clusters allows (Fréchet bounds, method D.7). The error of a cluster is the
    /// tolerance that its feature size was measured for, times that size over the width of the bundle where it passes
    /// the cluster, 1 at most: errors of independent parts average out over a wider beam.
    ///
    /// Where the answer is certain for the whole of [`Bundle::emitter`], because the space between it and the receiver
    /// end is empty or one triangle covers it, both ends of the interval are the answer.
    pub lo: f32,
    /// Upper end.
    pub hi: f32,
    /// How it was found.
    pub method: Method,
    /// What it cost.
    pub cost: Cost,
}

/// Wilson's 95 % interval for a mean of `n` (at least 1) zero-one values.
pub fn wilson(mean: f32, n: f32) -> (f32, f32) {
    interval(mean, mean * (1.0 - mean), n, 0.0)
}

/// 95 % interval for a mean of `n` values in `[0, 1]` with this variance, to which a model adds an error of its own
/// (root mean square).
///
/// Wilson's, with the values' variance where zero-one values have mean (1 - mean): what values that are all the same
/// say of those that were not sampled is the same for both.
fn interval(mean: f32, variance: f32, n: f32, model: f32) -> (f32, f32) {
    const Z: f32 = 1.96;
    let unseen = Z * Z / n;
    let scale = 1.0 / (1.0 + unseen);
    let centre = (mean + 0.5 * unseen) * scale;
    let half = Z * scale * (variance / n + 0.25 * unseen / n + (model / scale).powi(2)).max(0.0).sqrt();
    // Rounding must not leave the mean outside.
    ((centre - half).clamp(0.0, mean), (centre + half).clamp(mean, 1.0))
}
