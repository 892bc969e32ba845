//! A link to the sky before its visibility is measured, and the sums over the answers to its segments.

use super::{SkyLink, SkySource};
use crate::radiosity::rgb::Rgb;
use crate::ray::{LANES, Packet};

/// Fraction of a link's segments, if all had the same answer, that counts for the links that replace it: some segments lie in other parts of its ends.
const INHERITED: f32 = 0.5;

/// A link that is to be measured, and how accurately.
#[derive(Clone, Copy)]
pub struct SkyPair {
    /// The element.
    pub receiver: u32,
    /// Where its light comes from.
    pub source: SkySource,
    /// Error that 1 W/m² would cause, in units of the tolerated error.
    pub worth: f32,
    /// [`SkyLink::agreed`] of the link that this one replaces; 0 without such a link.
    pub agreed: f32,
    /// [`SkyLink::is_clear`] of the link that this one replaces.
    pub is_clear: bool,
    /// Set if the link, which is not certainly clear, is measured for the last time.
    pub last: Option<Last>,
}

/// A last measurement, with consecutive points of a sequence that all links share: the points of neighbouring receivers' links to one source then
/// interleave, and the errors of these links cancel.
#[derive(Clone, Copy, Default)]
pub struct Last {
    /// Number of the first point.
    pub first: u32,
    /// Number of segments.
    pub count: u32,
    /// [`SkyLink::variation`] and [`SkyLink::noise`] of the link so far, which cannot be estimated from the consecutive points of the sequence.
    pub variation: f32,
    pub noise: f32,
    /// [`SkyLink::transmittance`] so far.
    pub transmittance: f32,
}

/// A link before its visibility is measured.
pub struct SkyDraft {
    pub(super) pair: SkyPair,
    /// Irradiance without blockers, W/m².
    pub(super) free: Rgb,
    /// The irradiance that deviations are relative to, W/m²: a model without the noise of samples, mean of the channels.
    pub(super) scale: f32,
    /// Standard deviation of the irradiance without blockers over the receiver, relative to `scale`.
    pub(super) uneven: f32,
    /// Standard deviation of the radiance over the source relative to its mean.
    pub(super) contrast: f32,
    /// Weight of each segment of the first packet.
    pub(super) weights: [f32; LANES],
    /// Mean of the weights of all directions of the source, 0 if it is not known.
    pub(super) mean_weight: f32,
    /// Whether its segment 4 j + i goes from point i to part j of the source.
    pub(super) is_grid: bool,
    pub(super) answers: Answers,
}

/// Sums over the answers to the segments of a link.
#[derive(Clone, Copy, Default)]
pub(super) struct Answers {
    /// Number of segments.
    count: f32,
    /// Sums of the weights, of the weighted transmittances, and of the weighted squares of the transmittances.
    sum: f32,
    visible: f32,
    squares: f32,
    /// Smallest and largest transmittance; none before the first segment.
    range: Option<[f32; 2]>,
    /// Transmittances of a packet with a segment in each lane.
    table: Option<[f32; LANES]>,
}

impl Answers {
    /// Adds the answers to a packet with the weights of its segments.
    pub(super) fn add(&mut self, packet: &Packet, weights: &[f32; LANES], transmittances: &[f32; LANES]) {
        for lane in packet.lanes() {
            let (weight, t) = (weights[lane], transmittances[lane]);
            self.count += 1.0;
            self.sum += weight;
            self.visible += weight * t;
            self.squares += weight * t * t;
            let [min, max] = self.range.unwrap_or([t, t]);
            self.range = Some([min.min(t), max.max(t)]);
        }
        if packet.len() == LANES {
            self.table = Some(*transmittances);
        }
    }
}

/// Standard deviation of the visibility of a segment after this number of equal answers, from two additional segments, one visible and one
/// blocked (Agresti and Coull 1998).
pub(super) fn agreement(answers: f32) -> f32 {
    (answers + 1.0).sqrt() / (answers + 2.0)
}

impl SkyDraft {
    /// The link, given the answers of its segments. Without segments the link counts as clear.
    pub(super) fn link(&self) -> SkyLink {
        let Answers { count, sum, visible, squares, range, table } = self.answers;
        // A link that is not certainly clear but has no segments sees only a sliver of the source above its horizon. A last measurement keeps the
        // earlier values.
        let without_segments = |noise: f32| match self.pair.last {
            Some(Last { variation, noise, transmittance, .. }) => {
                SkyLink { variation, noise, ..self.with(transmittance, [0.0; 2], 0.0) }
            }
            None => self.with(1.0, [noise; 2], 0.0),
        };
        let Some([min, max]) = range else {
            return without_segments(if self.pair.is_clear { 0.0 } else { 0.5 });
        };
        if sum <= 0.0 {
            return without_segments(0.0);
        }
        let transmittance = match self.pair.last {
            // The ratio of the two sums is too large where the hidden directions are the bright ones: by .4 % at walls of a street.
            Some(last) if min < max && self.mean_weight > 0.0 => {
                let more = visible - last.transmittance * sum;
                (last.transmittance + more / (last.count as f32 * self.mean_weight)).clamp(0.0, 1.0)
            }
            _ => visible / sum,
        };
        let found = (squares / sum - transmittance * transmittance).max(0.0).sqrt();
        let agreed = if min == max { count + INHERITED * self.pair.agreed } else { 0.0 };
        let deviation = found.max(agreement(agreed.max(count)));
        // The mean over the four directions of a receiver point has half the deviation of a single segment.
        let mut parts = [0.5 * deviation, deviation / count.sqrt()];
        if let (true, true, Some(table)) = (self.is_grid, min < max, &table) {
            let found = two_ways(table);
            parts = [parts[0].min(found[0]), parts[1].min(found[1])];
        }
        let link = self.with(transmittance, parts, agreed);
        match self.pair.last {
            Some(Last { variation, noise, .. }) => {
                SkyLink { variation, noise: noise.min(link.noise), ..link }
            }
            None => link,
        }
    }

    /// The link for these deviations of visibility, over the receiver and from sampling. The more uneven the source, the larger the sampling error.
    fn with(&self, transmittance: f32, [over, noise]: [f32; 2], agreed: f32) -> SkyLink {
        let SkyPair { receiver, source, is_clear, .. } = self.pair;
        SkyLink {
            receiver,
            source,
            irradiance: self.free.map(|e| e as f32 * transmittance),
            transmittance,
            variation: self.scale * (self.uneven * transmittance).hypot(over),
            noise: self.scale * noise * self.contrast.hypot(1.0),
            agreed,
            is_clear,
        }
    }
}

/// Standard deviation of visibility over four points, and standard error of its mean over four parts of the source, of values in a table of
/// parts by points (two-way analysis of variance).
fn two_ways(values: &[f32; LANES]) -> [f32; 2] {
    let mean = values.iter().sum::<f32>() / LANES as f32;
    let square = |v: f32| (v - mean) * (v - mean);
    let all: f32 = values.iter().map(|v| square(*v)).sum();
    let points: f32 = (0..4).map(|i| square((0..4).map(|j| values[4 * j + i]).sum::<f32>() / 4.0)).sum();
    let parts: f32 = (0..4).map(|j| square(values[4 * j..4 * j + 4].iter().sum::<f32>() / 4.0)).sum();
    // Mean squares of three and of nine degrees of freedom.
    let rest = (all - 4.0 * (points + parts)).max(0.0) / 9.0;
    let excess = |squares: f32| (squares / 3.0 - rest / 4.0).max(0.0);
    let [of_points, of_parts] = [points, parts].map(excess);
    // The residual variance may belong to the points or to the parts, so that both include it.
    [(of_points + rest / 16.0).sqrt(), (of_parts / 4.0 + rest / 16.0).sqrt()]
}
