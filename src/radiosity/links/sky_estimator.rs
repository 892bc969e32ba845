//! Measures links to the sky: the light without blockers first, then visibility for all links together.

use super::accuracy::FEW_SEGMENTS_ERROR;
use super::cluster_pair::{CLUSTER_DEVIATION, shorten_to_box};
use super::end_samples::{EndSamples, stratified_points};
use super::estimator::is_behind;
use super::{Scratch, SkyLink, SkySource, VisibilityEngine, VisibilityQuery};
use crate::math::sampling::{mix, numbers};
use crate::radiosity::elements::{Element, Elements, Shape};
use crate::radiosity::options::Inside;
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::ray::{LANES, Packet};
use crate::sky::Environment;
use glam::Vec3;

/// Clusters and surfaces that are looked at for one link; if more may be in the way, the link is traced. As many as between two surfaces.
const MAX_TESTS: usize = 96;
/// Largest half angle of a patch that its width at the far end of segments is computed with, radians: beyond it, widths say nothing.
const MAX_HALF_ANGLE: f32 = 1.0;
/// Part of the segments of a link that count for the links that replace it, if all had the same answer: they lie in other parts of its ends.
const INHERITED: f32 = 0.5;
/// Draws of a direction above the surface's horizon.
const MAX_DRAWS: u64 = 4;

/// Measures links to the sky.
#[derive(Clone, Copy)]
pub struct SkyEstimator<'a> {
    /// The elements.
    pub elements: &'a Elements,
    /// Where the light comes from.
    pub environment: &'a Environment,
    /// The visibility engine.
    pub engine: &'a VisibilityEngine,
    /// Length of segments, more than the scene's diagonal; scene units.
    pub length: f32,
    /// Seed of all samples.
    pub seed: u64,
    /// What light does inside clusters.
    pub inside: Inside,
}

/// A link that is to be measured, and how accurately.
#[derive(Clone, Copy)]
pub struct SkyPair {
    /// The element.
    pub receiver: u32,
    /// Where its light comes from.
    pub source: SkySource,
    /// Error that 1 W/m² would cause, in units of the tolerated error.
    pub worth: f32,
    /// What is known from the link that this one replaces: segments if all had the same answer, else 0.
    pub agreed: f32,
    /// Whether that link is certainly clear.
    pub is_clear: bool,
}

/// A link before visibility is known.
pub struct SkyDraft {
    pair: SkyPair,
    /// Irradiance without blockers, W/m².
    free: Rgb,
    /// The irradiance that deviations are relative to, W/m²: a model without the noise of samples, mean of the channels.
    scale: f32,
    /// Standard deviation of the irradiance without blockers over the receiver, relative to `scale`.
    uneven: f32,
    /// Standard deviation of the radiance over the source relative to its mean.
    contrast: f32,
    /// Weight of each segment.
    weights: [f32; LANES],
    /// Whether segment 4 j + i goes from point i to part j of the source.
    is_grid: bool,
}

impl SkyEstimator<'_> {
    /// The links of pairs, in their order, without those whose sources are below the horizon of all surfaces.
    pub fn measure_all(&self, pairs: &[SkyPair], scratch: &mut Scratch) -> Vec<SkyLink> {
        let mut links = Vec::with_capacity(pairs.len());
        let (mut drafts, mut queries) = (Vec::with_capacity(pairs.len()), Vec::with_capacity(pairs.len()));
        for pair in pairs {
            let Some((draft, query)) = self.draft(*pair) else { continue };
            links.push(draft.link(&Packet::EMPTY, &[0.0; LANES]));
            if !query.packet.is_empty() {
                drafts.push((links.len() - 1, draft));
                queries.push(query);
            } else if draft.pair.is_clear {
                scratch.tally.clear += 1;
            }
        }
        self.engine.answer_all(&queries, scratch, |k, transmittances| {
            let (place, draft) = &drafts[k];
            links[*place] = draft.link(&queries[k].packet, transmittances);
        });
        links
    }

    /// A link without visibility, and the query for its visibility; none if no light can arrive.
    pub fn draft(&self, pair: SkyPair) -> Option<(SkyDraft, VisibilityQuery)> {
        let element = &self.elements.elements[pair.receiver as usize];
        if element.area <= 0.0 {
            return None;
        }
        let tag = match pair.source {
            SkySource::Patch(k) => u64::from(k) << 1,
            SkySource::Sun(k) => u64::from(k) << 1 | 1,
        };
        let seed = mix(self.seed ^ mix(element.ids[0]) ^ mix(!tag).rotate_left(17));
        let (draft, packet) = match &element.shape {
            Shape::Surface { side, corners } => self.at_surface(pair, element, (*side, corners), seed)?,
            Shape::Cluster(_) => self.at_cluster(pair, element, seed)?,
        };
        let half = pair.source.half_angle(self.environment).min(MAX_HALF_ANGLE);
        let feature_size = self.elements.states[pair.receiver as usize].feature_size;
        let query = VisibilityQuery { packet, emitter_size: 2.0 * self.length * half.tan(), feature_size };
        Some((draft, query))
    }

    fn at_surface(
        &self,
        mut pair: SkyPair,
        element: &Element,
        (side, corners): (u32, &[Vec3; 4]),
        seed: u64,
    ) -> Option<(SkyDraft, Packet)> {
        let side = &self.elements.sides[side as usize];
        let (source, environment) = (pair.source, self.environment);
        let free = source.irradiance(environment, side.normal);
        if mean(free) <= 0.0 {
            return None;
        }
        pair.is_clear = pair.is_clear || self.is_clear(element, corners, source);
        let mut draft = SkyDraft {
            pair,
            free,
            scale: mean(free) as f32,
            uneven: 0.0,
            contrast: source.deviation(environment),
            weights: [0.0; LANES],
            is_grid: true,
        };
        let mut packet = Packet::EMPTY;
        if !pair.is_clear {
            let points = stratified_points(corners, seed);
            let few = self.few(&draft);
            for lane in lanes(few, seed) {
                let direction = (0..MAX_DRAWS)
                    .map(|draw| self.direction(source, lane, draw, seed))
                    .find(|direction| direction.dot(side.normal) > 0.0);
                let Some(direction) = direction else { continue };
                draft.weights[lane] = direction.dot(side.normal) * source.radiance(environment, direction);
                let from = side.end.lifted(points[lane & 3], side.normal);
                packet.set_lifted(lane, from, from + self.length * direction, [side.end; 2]);
            }
        }
        Some((draft, packet))
    }

    fn at_cluster(&self, pair: SkyPair, element: &Element, seed: u64) -> Option<(SkyDraft, Packet)> {
        let Shape::Cluster(c) = element.shape else { return None };
        let cluster = &self.elements.clusters[c as usize];
        let (source, environment) = (pair.source, self.environment);
        let axis = source.axis(environment);
        let from = EndSamples::draw(self.elements, pair.receiver, axis, 0, seed);
        let along = source.along_axes(environment);
        let model: f64 = along.iter().zip(cluster.projected).map(|(e, p)| e * p).sum();
        if model <= 0.0 {
            return None;
        }
        let mut free = [0.0; 3];
        for lane in 0..LANES {
            let share = 1.0 / (f64::from(from.density[lane]) * LANES as f64 * element.area);
            add(&mut free, share, source.irradiance(environment, from.normals[lane]));
        }
        let mut draft = SkyDraft {
            pair,
            free,
            scale: (model / element.area) as f32,
            uneven: CLUSTER_DEVIATION,
            contrast: source.deviation(environment),
            weights: [0.0; LANES],
            is_grid: false,
        };
        let few = self.few(&draft);
        let mut packet = Packet::EMPTY;
        for lane in lanes(few, seed) {
            let direction = self.direction(source, lane, 0, seed);
            let (normal, rule) = (from.normals[lane], from.rules[lane]);
            let cosine = direction.dot(normal);
            if cosine > 0.0 {
                draft.weights[lane] = cosine * source.radiance(environment, direction) / from.density[lane];
                let start = rule.lifted(from.points[lane], normal);
                packet.set_lifted(lane, start, start + self.length * direction, [rule; 2]);
            }
        }
        if self.inside != Inside::Visible {
            shorten_to_box(&cluster.bounds, &mut packet, 0);
        }
        Some((draft, packet))
    }

    /// Whether four segments are enough.
    fn few(&self, draft: &SkyDraft) -> bool {
        let deviation = agreement(draft.pair.agreed);
        draft.pair.worth * draft.scale * deviation < FEW_SEGMENTS_ERROR
    }

    /// The direction of a segment. The source has four parts, one for each row of four lanes, and each part four parts, one for each point; those
    /// change from row to row. Another draw takes any direction.
    fn direction(&self, source: SkySource, lane: usize, draw: u64, seed: u64) -> Vec3 {
        let (i, j) = (lane & 3, lane >> 2);
        let inner = i ^ (seed >> (2 * j)) as usize & 3;
        let [u, v, ..] = numbers(mix(seed ^ draw), lane as u64);
        let place = |outer: usize, inner: usize, u: f32| {
            if draw > 0 { u.into() } else { ((2 * (outer & 1) + (inner & 1)) as f64 + f64::from(u)) / 4.0 }
        };
        source.sample(self.environment, [place(j, inner, u), place(j >> 1, inner >> 1, v)])
    }

    /// Whether geometry proves that nothing is between a surface and a source: no cluster and no surface is both in front of the receiver and in the
    /// cone of its view of the source.
    fn is_clear(&self, receiver: &Element, corners: &[Vec3; 4], source: SkySource) -> bool {
        let up = self.environment.frame().up.as_vec3();
        let (axis, half) = (source.axis(self.environment), source.half_angle(self.environment));
        let is_above = source.lowest(self.environment) >= 0.0;
        let foot = corners.iter().map(|c| up.dot(*c)).fold(f32::MAX, f32::min);
        let rows = &self.elements.elements;
        let (mut open, mut count, mut tests) = ([0u32; MAX_TESTS + 1], 1, 0);
        while count > 0 {
            count -= 1;
            let e = open[count] as usize;
            let element = &rows[e];
            tests += 1;
            if is_above && self.top(element, up) <= foot
                || !meets_cone(receiver, element, axis, half)
                || is_behind(self.elements, receiver, element)
            {
                continue;
            }
            if !element.is_cluster() || tests + count + usize::from(element.children) > MAX_TESTS {
                return false;
            }
            for child in element.child_range() {
                open[count] = child as u32;
                count += 1;
            }
        }
        true
    }

    /// Height of the top of an element.
    fn top(&self, element: &Element, up: Vec3) -> f32 {
        match &element.shape {
            Shape::Surface { corners, .. } => corners.iter().map(|c| up.dot(*c)).fold(f32::MIN, f32::max),
            Shape::Cluster(c) => {
                let bounds = self.elements.clusters[*c as usize].bounds;
                up.dot(Vec3::select(up.cmpgt(Vec3::ZERO), bounds.max, bounds.min))
            }
        }
    }
}

/// Whether rays from points of a receiver into a cone of directions may meet an element, by the spheres around both.
fn meets_cone(receiver: &Element, element: &Element, axis: Vec3, half: f32) -> bool {
    let away = element.centre - receiver.centre;
    let (distance, radii) = (away.length(), receiver.radius + element.radius);
    if distance <= radii {
        return true;
    }
    let angle = (axis.dot(away) / distance).clamp(-1.0, 1.0).acos();
    angle <= half + (radii / distance).asin()
}

/// All segments, or four that use each point and each part of the source once.
fn lanes(few: bool, seed: u64) -> impl Iterator<Item = usize> {
    let turn = (seed >> 32) as usize & 3;
    (0..LANES).filter(move |lane| !few || lane & 3 == (lane >> 2) ^ turn)
}

/// Standard deviation of the visibility of a segment that so many equal answers allow: that of two more segments, one visible and one blocked
/// (Agresti and Coull 1998).
fn agreement(answers: f32) -> f32 {
    (answers + 1.0).sqrt() / (answers + 2.0)
}

impl SkyDraft {
    /// The link, given the transmittances of its segments. Without segments the link counts as clear.
    fn link(&self, packet: &Packet, transmittances: &[f32; LANES]) -> SkyLink {
        if packet.is_empty() {
            // Without a proof only a sliver of the source is above the receiver's horizon.
            let noise = if self.pair.is_clear { 0.0 } else { 0.5 };
            return self.with(1.0, [noise, noise], 0.0);
        }
        let (mut sum, mut visible, mut squares) = (0.0, 0.0, 0.0);
        for lane in packet.lanes() {
            let (weight, t) = (self.weights[lane], transmittances[lane]);
            sum += weight;
            visible += weight * t;
            squares += weight * t * t;
        }
        if sum <= 0.0 {
            return self.with(1.0, [0.0, 0.0], 0.0);
        }
        let transmittance = visible / sum;
        let n = packet.len() as f32;
        let found = (squares / sum - transmittance * transmittance).max(0.0).sqrt();
        let agree = packet
            .lanes()
            .all(|l| transmittances[l] == transmittances[packet.active.trailing_zeros() as usize]);
        let agreed = if agree { n + INHERITED * self.pair.agreed } else { 0.0 };
        let deviation = found.max(agreement(agreed.max(n)));
        // Over the receiver the four directions of each point leave an error of half the deviation.
        let mut parts = [0.5 * deviation, deviation / n.sqrt()];
        if !agree && self.is_grid && n as usize == LANES {
            let found = two_ways(transmittances);
            parts = [parts[0].min(found[0]), parts[1].min(found[1])];
        }
        self.with(transmittance, parts, agreed)
    }

    /// With deviations of visibility, over the receiver and from sampling. Where the source is uneven, fewer samples count.
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
    // What is neither of points nor of parts may be either.
    [(of_points + rest / 16.0).sqrt(), (of_parts / 4.0 + rest / 16.0).sqrt()]
}
