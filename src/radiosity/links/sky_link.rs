//! Links that end at a part of the sky or at a sun: the irradiance of an element from this source, and its error.
//!
//! These links serve one direction only and store the irradiance itself. See `docs/method.md`, Links and refinement.

use super::Split;
use super::error_oracle::weigh;
use crate::radiosity::elements::{DIRECTIONS, Elements};
use crate::radiosity::rgb::{Rgb, mean};
use crate::ray::{LANES, Packet};
use crate::sky::Environment;
use glam::Vec3;

/// Distance, relative to the radius of the scene, at which the widths of a patch and of a receiver are compared if visibility does not
/// determine which of the two to split: blockers are between the receiver and the edge of the scene.
const BLOCKER_DISTANCE: f32 = 0.5;

/// The source at the far end of a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Deserialize, serde::Serialize)]
pub enum SkySource {
    /// A patch of the sky or of the ground around the scene.
    Patch(u32),
    /// A sun, which is not divided.
    Sun(u32),
}

impl SkySource {
    /// All sources of light beyond the scene, in the smallest possible number.
    pub fn all(environment: &Environment) -> Vec<SkySource> {
        let patches = environment.patches().roots().map(SkySource::Patch);
        let suns = (0..environment.suns().len() as u32).map(SkySource::Sun);
        patches.chain(suns).filter(|source| source.is_lit(environment)).collect()
    }

    /// Whether the source has any light.
    fn is_lit(self, environment: &Environment) -> bool {
        match self {
            SkySource::Patch(k) => mean(environment.patches().patch(k).max) > 0.0,
            SkySource::Sun(k) => mean(environment.suns()[k as usize].irradiance) > 0.0,
        }
    }

    /// Upper bound of the standard deviation of the radiance over a patch relative to its mean, mean of the channels; 0 for a sun. Values
    /// in `[a, b]` deviate by at most √((b − m)(m − a)) from their mean m (Bhatia and Davis 2000).
    pub(super) fn deviation(self, environment: &Environment) -> f32 {
        let SkySource::Patch(k) = self else { return 0.0 };
        let patch = environment.patches().patch(k);
        let bound = |c: usize| {
            let (min, mean, max) = (patch.min[c], patch.mean[c], patch.max[c]);
            ((max - mean) * (mean - min)).max(0.0).sqrt()
        };
        (mean([0, 1, 2].map(bound)) / mean(patch.mean).max(f64::MIN_POSITIVE)) as f32
    }

    /// Its parts; none if it cannot be divided.
    pub fn parts(self, environment: &Environment) -> impl Iterator<Item = SkySource> + use<> {
        let children = match self {
            SkySource::Patch(k) => environment.patches().children(k),
            SkySource::Sun(_) => 0..0,
        };
        children.map(SkySource::Patch)
    }

    /// Whether it can be divided.
    pub fn can_open(self, environment: &Environment) -> bool {
        match self {
            SkySource::Patch(k) => !environment.patches().children(k).is_empty(),
            SkySource::Sun(_) => false,
        }
    }

    /// Unit vector towards its middle.
    pub(super) fn axis(self, environment: &Environment) -> Vec3 {
        match self {
            SkySource::Patch(k) => environment.patches().patch(k).axis.as_vec3(),
            SkySource::Sun(k) => environment.suns()[k as usize].direction.as_vec3(),
        }
    }

    /// Half angle of a cone about [`SkySource::axis`] that contains it, radians.
    pub(super) fn half_angle(self, environment: &Environment) -> f32 {
        match self {
            SkySource::Patch(k) => environment.patches().patch(k).half_angle as f32,
            SkySource::Sun(k) => 0.5 * environment.suns()[k as usize].diameter as f32,
        }
    }

    /// Smallest sine of the elevation of its directions, or less.
    pub(super) fn lowest(self, environment: &Environment) -> f64 {
        match self {
            SkySource::Patch(k) => environment.patches().lowest(k),
            SkySource::Sun(k) => {
                let sun = &environment.suns()[k as usize];
                sun.direction.dot(environment.frame().up) - 0.5 * sun.diameter
            }
        }
    }

    /// Irradiance of a surface of this unit normal without blockers, W/m², exactly clipped at the surface's horizon.
    pub(super) fn irradiance(self, environment: &Environment, normal: Vec3) -> Rgb {
        let normal = normal.as_dvec3();
        match self {
            SkySource::Patch(k) => environment.patches().irradiance_of(k, normal),
            SkySource::Sun(k) => environment.suns()[k as usize].irradiance_on(normal),
        }
    }

    /// Mean over the directions of a patch of a quantity with this integral over them; 0 for a sun.
    pub(super) fn mean_over_directions(self, environment: &Environment, integral: f64) -> f64 {
        match self {
            SkySource::Patch(k) => integral / environment.patches().patch(k).solid_angle,
            SkySource::Sun(_) => 0.0,
        }
    }

    /// Irradiance of surfaces that face the six directions, W/m², mean of the channels.
    pub fn along_axes(self, environment: &Environment) -> [f64; DIRECTIONS] {
        let axis = |k: usize| Vec3::AXES[k / 2] * if k & 1 == 0 { 1.0 } else { -1.0 };
        std::array::from_fn(|k| mean(self.irradiance(environment, axis(k))))
    }

    /// A direction of it, uniform by solid angle for `u` in the unit square.
    pub(super) fn sample(self, environment: &Environment, u: [f64; 2]) -> Vec3 {
        let direction = match self {
            SkySource::Patch(k) => environment.patches().direction(k, u),
            SkySource::Sun(k) => environment.suns()[k as usize].sample(u),
        };
        direction.as_vec3()
    }

    /// Radiance in one of its directions, mean of the channels; 1 for a sun.
    pub(super) fn radiance(self, environment: &Environment, direction: Vec3) -> f32 {
        match self {
            SkySource::Patch(_) => mean(environment.radiance(direction.as_dvec3())) as f32,
            SkySource::Sun(_) => 1.0,
        }
    }
}

/// The light that an element receives from one source beyond the scene.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct SkyLink {
    /// The element.
    pub receiver: u32,
    /// Source of the light.
    pub source: SkySource,
    /// Mean irradiance of the receiver, reduced by blockers, W/m².
    pub irradiance: [f32; 3],
    /// Visible fraction of the light, in `[0, 1]`.
    pub transmittance: f32,
    /// Standard deviation of the irradiance over the receiver, W/m²; mean of the channels.
    pub variation: f32,
    /// Standard error of the irradiance from sampling, W/m²; mean of the channels.
    pub noise: f32,
    /// If all segments had the same answer, their number, with a fraction (`INHERITED`) of those of the links that this one replaces;
    /// else 0.
    pub agreed: f32,
    /// Whether geometry proves that nothing blocks the link or any part of it.
    pub is_clear: bool,
}

/// The error of a link to the sky and the end to split: [`Split::A`] is the receiver. Errors are as those of
/// [`link_error`](super::link_error). If only one end can be split, only the error that this split can reduce counts.
pub fn sky_link_error(elements: &Elements, environment: &Environment, link: &SkyLink) -> (f32, Split) {
    let element = &elements.elements[link.receiver as usize];
    let (of_receiver, of_source) = (link.variation, link.noise);
    let (receiver_opens, source_opens) =
        (elements.can_open(link.receiver), link.source.can_open(environment));
    let split = match (receiver_opens, source_opens) {
        (true, true) => {
            // If visibility favours neither end, the larger end is split first.
            let is_tie = link.agreed > 0.0 || element.is_cluster() || of_receiver == of_source;
            let width = BLOCKER_DISTANCE * elements.elements[0].radius * link.source.half_angle(environment);
            let prefers_receiver = if is_tie { element.radius > width } else { of_receiver >= of_source };
            if prefers_receiver { Split::A } else { Split::B }
        }
        (true, false) => Split::A,
        (false, true) => Split::B,
        (false, false) => Split::Neither,
    };
    let error = match (receiver_opens, source_opens) {
        (true, false) => of_receiver,
        (false, true) => of_source,
        _ => of_receiver.hypot(of_source),
    };
    let weight = elements.states[link.receiver as usize].statistics.weight;
    (weigh(error, weight, element.area, elements.area), split)
}

// A link to the sky before its visibility is measured, and the sums over the answers to its segments.

/// Fraction of a link's segments, if all had the same answer, that counts for the links that replace it: half, because some segments
/// lie in other parts of its ends.
const INHERITED: f32 = 0.5;

/// A link that is to be measured, and how accurately.
#[derive(Clone, Copy)]
pub struct SkyPair {
    /// The element.
    pub receiver: u32,
    /// Source of the light.
    pub source: SkySource,
    /// Error that 1 W/m² would cause, in units of the tolerated error.
    pub worth: f32,
    /// [`SkyLink::agreed`] of the link that this one replaces; 0 without such a link.
    pub agreed: f32,
    /// [`SkyLink::is_clear`] of the link that this one replaces.
    pub is_clear: bool,
    /// Set if the link, which is not certainly clear, is measured for the last time.
    pub last: Option<LastMeasurement>,
}

/// A last measurement, with consecutive points of a sequence that all links share: the points of neighbouring receivers' links to one
/// source then interleave, and the errors of these links cancel.
#[derive(Clone, Copy, Default)]
pub struct LastMeasurement {
    /// Number of the first point.
    pub first: u32,
    /// Number of segments.
    pub count: u32,
    /// [`SkyLink::variation`] and [`SkyLink::noise`] of the link so far, which cannot be estimated from the consecutive points of the
    /// sequence.
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
    pub(super) variation: f32,
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
        // A link that is not certainly clear but has no segments sees only a sliver of the source above its horizon. A last measurement
        // keeps the earlier values.
        let without_segments = |noise: f32| match self.pair.last {
            Some(LastMeasurement { variation, noise, transmittance, .. }) => {
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
            Some(LastMeasurement { variation, noise, .. }) => {
                SkyLink { variation, noise: noise.min(link.noise), ..link }
            }
            None => link,
        }
    }

    /// The link for these deviations of visibility, over the receiver and from sampling. The sampling error grows with the contrast of
    /// the source.
    fn with(&self, transmittance: f32, [over, noise]: [f32; 2], agreed: f32) -> SkyLink {
        let SkyPair { receiver, source, is_clear, .. } = self.pair;
        SkyLink {
            receiver,
            source,
            irradiance: self.free.map(|e| e as f32 * transmittance),
            transmittance,
            variation: self.scale * (self.variation * transmittance).hypot(over),
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
