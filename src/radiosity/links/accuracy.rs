//! Required accuracy of a link's measurement, and a link before its visibility is measured.

use super::{BlockerCertificate, Link, VisibilityQuery};
use crate::ray::{EndRule, LANES, Packet};
use glam::Vec3;

/// Four segments replace sixteen where the expected deviation of visibility makes the error of an exchange area less
/// than this fraction of the tolerated error: four segments have twice the standard error of sixteen, which is then
/// still below half of the tolerated error.
pub(super) const FEW_SEGMENTS_ERROR: f32 = 0.25;
/// Number of segments of such links: a quarter of a packet.
const FEW_SEGMENTS: usize = 4;

/// How accurately a link is to be measured.
#[derive(Clone, Copy, Debug)]
pub struct Accuracy {
    /// Error that one square unit of exchange area would cause, in units of the tolerated error.
    pub worth: f32,
    /// Shadow features smaller than this on the receiving end need not be resolved, scene units.
    pub feature_size: f32,
    /// Expected standard deviation of the transmittance of a segment, in `[0, 1/2]`. Where it is small, few segments are
    /// as good as many.
    pub deviation: f32,
    /// Certificate of the link between the elements that contain the ends.
    pub certificate: BlockerCertificate,
    /// Whether all segments between those elements were blocked: the certificate search then continues for a single blocker of all
    /// segments.
    pub blocked: bool,
    /// Whether the first end is the receiver, at which an error has more weight. The feature size applies to shadows on the receiver.
    pub first_receives: bool,
}

impl Accuracy {
    /// The accuracy for a pair without an earlier measurement, with features of one scene unit.
    #[cfg(test)]
    pub fn unknown(worth: f32) -> Accuracy {
        let certificate = BlockerCertificate::UNKNOWN;
        Accuracy {
            worth,
            feature_size: 1.0,
            deviation: 0.5,
            certificate,
            blocked: false,
            first_receives: true,
        }
    }

    /// The query for segments between ends of these widths (scene units).
    pub(super) fn query(&self, packet: Packet, [a, b]: [f32; 2]) -> VisibilityQuery {
        let emitter_size = if self.first_receives { b } else { a };
        VisibilityQuery { packet, emitter_size, feature_size: self.feature_size }
    }

    /// The segments between sixteen pairs of points with positive weight, or between four of them; they start at the receiving
    /// end. The points are lifted towards each other. `points` returns the points of both ends with their normals and end rules.
    pub(super) fn segments(
        &self,
        few: bool,
        weights: &[f32; LANES],
        seed: u64,
        points: impl Fn(usize) -> [(Vec3, Vec3, EndRule); 2],
    ) -> Packet {
        let mut packet = Packet::EMPTY;
        let count = if few { FEW_SEGMENTS } else { LANES };
        for lane in lane_order(seed).filter(|&l| weights[l] > 0.0).take(count) {
            let [a, b] = points(lane);
            let (from, to) = if self.first_receives { (a, b) } else { (b, a) };
            let rules = [from.2, to.2.seen_from(from.2)];
            let [start, end] =
                [rules[0].lifted_towards(from.0, from.1, to.0), rules[1].lifted_towards(to.0, to.1, from.0)];
            packet.set_lifted(lane, start, end, rules);
        }
        packet
    }
}

/// All lanes in an order in which every four consecutive ones use each row and each column of the sample grids of both ends
/// once (between surfaces: each of the four points). The seed rotates the order, so that all pairs of points are equally
/// likely where few are used.
fn lane_order(seed: u64) -> impl Iterator<Item = usize> {
    let turn = (seed >> 32) as usize & 3;
    (0..LANES).map(move |k| 4 * (k & 3) + ([0, 3, 2, 1][k & 3] ^ (k >> 2) ^ turn))
}

/// A link before its visibility is measured.
pub struct LinkDraft {
    pub(super) ids: [u32; 2],
    /// Whether the ends were exchanged.
    pub(super) swapped: bool,
    /// Unoccluded exchange area, scene units squared.
    pub(super) free: f32,
    /// The exchange area that the deviation of visibility is relative to, scene units squared.
    pub(super) scale: f32,
    /// Standard deviation of the unoccluded exchange over each end, scene units squared.
    pub(super) deviation: [f32; 2],
    /// Kernel of each segment.
    pub(super) weights: [f32; LANES],
    pub(super) certificate: BlockerCertificate,
}

impl LinkDraft {
    /// The link, given the transmittances of its segments. Without segments the link counts as clear.
    pub(super) fn link(&self, packet: &Packet, transmittances: &[f32; LANES]) -> Link {
        if packet.is_empty() {
            // Without a certificate only slivers of the ends face each other.
            let noise = if self.certificate == BlockerCertificate::CLEAR { 0.0 } else { self.free };
            return self.with(1.0, self.deviation, noise, 0);
        }
        let (mut sum, mut visible, mut squares) = (0.0, 0.0, 0.0);
        for l in packet.lanes() {
            let (weight, t) = (self.weights[l], transmittances[l]);
            sum += weight;
            visible += weight * t;
            squares += weight * t * t;
        }
        let transmittance = visible / sum;
        let n = packet.len() as f32;
        // √(T (1 - T)) for binary visibility, and no less than the Agresti-Coull deviation √(n + 1) / (n + 2) that n equal
        // answers allow. The bound is the same for visible and blocked links, so that unrefined links err to either side.
        let deviation = (squares / sum - transmittance * transmittance).max(0.0).sqrt();
        let shadow = self.scale * deviation.max((n + 1.0).sqrt() / (n + 2.0));
        let noise = shadow / n.sqrt();
        let variation = self.deviation.map(|d| (d * transmittance).hypot(shadow));
        self.with(transmittance, variation, noise, packet.len() as u32)
    }

    fn with(&self, transmittance: f32, [of_a, of_b]: [f32; 2], noise: f32, rays: u32) -> Link {
        let [a, b] = self.ids;
        let (a, b, variation) = if self.swapped { (b, a, [of_b, of_a]) } else { (a, b, [of_a, of_b]) };
        let exchange_area = self.free * transmittance;
        Link { a, b, exchange_area, transmittance, variation, noise, rays, certificate: self.certificate }
    }
}
