//! Bundles of segments, and answers to them.

use crate::math;
use crate::ray::Packet;
use glam::Vec3;

/// [`math::NORMAL_95`] in single precision.
const NORMAL_95: f32 = math::NORMAL_95 as f32;

/// Segments of one visibility query: from `origin` at the receiver to `origin + direction` on the emitter.
#[derive(Clone, Copy, Debug)]
pub struct Bundle<'a> {
    /// The segments, up to 16 per packet.
    pub packets: &'a [Packet],
    /// Smallest width of the emitter seen along the bundle, 0 for a point; scene units. A smaller value is conservative
    /// (docs/method.md, Umbra criterion).
    pub emitter_size: f32,
    /// Points whose convex hull contains the whole emitter, not only the ends of these segments; empty if unknown. With
    /// these points an answer can be certain, and bundles that meet nothing, or that one triangle covers, have a cost
    /// independent of their number of segments.
    ///
    /// A convex polygon of three or four corners in order gives an exact pyramid; other points one of extreme slopes.
    ///
    /// The caller guarantees that all segments start at one point, end inside the hull, and have the margins of an
    /// `crate::ray::EndRule`; and calls [`Packet::share_slack`].
    pub emitter: &'a [Vec3],
}

impl<'a> Bundle<'a> {
    /// The segments of one packet, which may start anywhere.
    pub fn of_packet(packet: &'a Packet, emitter_size: f32) -> Bundle<'a> {
        Bundle { packets: std::slice::from_ref(packet), emitter_size, emitter: &[] }
    }
}

/// Method by which an answer was found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Method {
    /// No geometry lies between the ends.
    #[default]
    Clear,
    /// A single triangle covers the whole emitter end, or the emitter turns away from the point; no segment was tested.
    Covered,
    /// Triangles were tested; nothing was aggregated.
    Exact,
    /// Clusters were aggregated; no triangle was tested.
    Aggregated,
    /// Clusters were aggregated and triangles were tested.
    Mixed,
}

impl Method {
    /// The method of segments of which triangles were tested or not, and clusters aggregated or not.
    pub(super) fn of(tested: bool, aggregated: bool) -> Method {
        match (tested, aggregated) {
            (false, false) => Method::Clear,
            (true, false) => Method::Exact,
            (false, true) => Method::Aggregated,
            (true, true) => Method::Mixed,
        }
    }
}

/// Cost of an answer, and the numbers of segments by method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Cost {
    /// Number of segments.
    pub segments: u64,
    /// Number of visited nodes of the wide tree, each counted once per bundle.
    pub nodes: u64,
    /// Segments of bundles for which triangles were tested (by this engine or by Embree).
    pub exact_rays: u64,
    /// Segments handed to Embree because the walk met too many clusters that may not be aggregated.
    pub handed_over: u64,
    /// Segments whose answer contains an aggregated cluster.
    pub aggregated: u64,
    /// Segments of bundles whose answer is certain without rays.
    pub certified: u64,
}

impl Cost {
    /// Adds another cost.
    pub(crate) fn add(&mut self, other: Cost) {
        self.segments += other.segments;
        self.nodes += other.nodes;
        self.exact_rays += other.exact_rays;
        self.handed_over += other.handed_over;
        self.aggregated += other.aggregated;
        self.certified += other.certified;
    }
}

/// Visible fraction of a bundle with its interval and cost.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Answer {
    /// Mean transmittance of the segments, in `[0, 1]`.
    pub transmittance: f32,
    /// Lower end of the stated 95 % interval: sampling error of the segments and model error of aggregated clusters,
    /// both within Fréchet's bounds for any dependence between clusters (docs/method.md, Certificates and intervals).
    /// The model error of a cluster is the tolerance of its feature size, times that size divided by the width of the
    /// beam at the cluster, at most 1: errors of independent parts average out over wider beams.
    ///
    /// If the answer is certain for the whole emitter (empty shaft, or one triangle covers it), both ends equal the
    /// transmittance.
    pub lo: f32,
    /// Upper end of the interval.
    pub hi: f32,
    /// Method by which the answer was found.
    pub method: Method,
    /// Cost of the answer.
    pub cost: Cost,
}

/// Wilson's 95 % score interval (Wilson 1927) for a mean of `n >= 1` zero-one values.
pub fn wilson(mean: f32, n: f32) -> (f32, f32) {
    interval(mean, mean * (1.0 - mean), n, 0.0)
}

/// 95 % interval for a mean of `n` values in `[0, 1]` with this variance and an additional model error (root mean
/// square).
///
/// Wilson's interval with the variance of the values in place of mean (1 - mean); the allowance for unseen values is
/// the same.
pub(super) fn interval(mean: f32, variance: f32, n: f32, model: f32) -> (f32, f32) {
    let unseen = NORMAL_95 * NORMAL_95 / n;
    let scale = 1.0 / (1.0 + unseen);
    let centre = (mean + 0.5 * unseen) * scale;
    let half =
        NORMAL_95 * scale * (variance / n + 0.25 * unseen / n + (model / scale).powi(2)).max(0.0).sqrt();
    // Rounding must not exclude the mean.
    ((centre - half).clamp(0.0, mean), (centre + half).clamp(mean, 1.0))
}
