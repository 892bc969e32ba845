//! Measures links to the sky: the light without blockers first, then visibility for all links together.

use super::accuracy::FEW_SEGMENTS_ERROR;
use super::blocker_certificate::MAX_TESTS;
use super::cluster_pair::{CLUSTER_DEVIATION, shorten_to_box};
use super::end_samples::{EndSamples, stratified_points};
use super::estimator::is_behind;
use super::sky_link::{Answers, LastMeasurement, SkyDraft, SkyPair, agreement};
use super::{Scratch, SkyLink, SkySource, VisibilityEngine, VisibilityQuery};
use crate::math::sampling::{mix, numbers, point_on};
use crate::radiosity::elements::{Element, Elements, Shape};
use crate::radiosity::options::Inside;
use crate::radiosity::rgb::{add, mean};
use crate::ray::{LANES, Packet};
use crate::sky::Environment;
use glam::Vec3;
use sobol_burley::sample_4d;

/// Largest half angle, radians, for which the width of a patch at the far end of segments is computed: 57°, where the tangent is 1.6.
/// The tangents of larger angles, which grow without bound, are no widths.
const MAX_HALF_ANGLE: f32 = 1.0;
/// Largest number of draws of a direction until it lies above the surface's horizon: of a patch half of which is above, 1 in 2⁴ = 16
/// segments remains without a direction and is left out.
const MAX_DRAWS: u64 = 4;
/// Binary logarithm of the number of points of a sequence, limited by the crate; another sequence begins after these points.
const SEQUENCE_BITS: u32 = 16;

/// Measures links to the sky.
#[derive(Clone, Copy)]
pub struct SkyEstimator<'a> {
    /// The elements.
    pub elements: &'a Elements,
    /// Sky and suns.
    pub environment: &'a Environment,
    /// The visibility engine.
    pub engine: &'a VisibilityEngine,
    /// Length of segments, more than the scene's diagonal; scene units.
    pub length: f32,
    /// Seed of all samples.
    pub seed: u64,
    /// How light is treated inside clusters.
    pub inside: Inside,
}

impl SkyPair {
    /// Lanes of a packet of the link's segments: all, four (see [`lanes`]), or the remaining ones of a last measurement.
    fn lanes(&self, number: u32, few: bool, seed: u64) -> impl Iterator<Item = usize> {
        let left = self.last.map_or(LANES, |last| last.count.saturating_sub(number * LANES as u32) as usize);
        lanes(few && self.last.is_none(), seed).take(left)
    }
}

impl SkyEstimator<'_> {
    /// The links of pairs, in their order, without those whose sources are below the horizon of all surfaces.
    pub fn measure_all(&self, pairs: &[SkyPair], scratch: &mut Scratch) -> Vec<SkyLink> {
        let mut links = Vec::with_capacity(pairs.len());
        let (mut drafts, mut queries) = (Vec::with_capacity(pairs.len()), Vec::with_capacity(pairs.len()));
        // The draft of each query, and the weights of its segments.
        let mut asked = Vec::with_capacity(pairs.len());
        for pair in pairs {
            let Some((draft, query)) = self.draft(*pair) else { continue };
            links.push(draft.link());
            if query.packet.is_empty() {
                scratch.tally.clear += u64::from(draft.pair.is_clear);
                continue;
            }
            let packets = pair.last.map_or(1, |last| last.count.div_ceil(LANES as u32));
            for number in 1..packets {
                let (packet, weights) = self.further_packet(&draft.pair, number);
                queries.push(VisibilityQuery { packet, ..query });
                asked.push((drafts.len(), weights));
            }
            queries.push(query);
            asked.push((drafts.len(), draft.weights));
            drafts.push((links.len() - 1, draft));
        }
        self.engine.answer_all(&queries, scratch, |k, transmittances| {
            let (draft, weights) = &asked[k];
            drafts[*draft].1.answers.add(&queries[k].packet, weights, transmittances);
        });
        drafts.iter().for_each(|(place, draft)| links[*place] = draft.link());
        links
    }

    /// A link without visibility, and the query for its visibility; none if no light can arrive.
    pub fn draft(&self, pair: SkyPair) -> Option<(SkyDraft, VisibilityQuery)> {
        let element = &self.elements.elements[pair.receiver as usize];
        if element.area <= 0.0 {
            return None;
        }
        let (draft, packet) = match &element.shape {
            Shape::Surface { side, corners } => self.at_surface(pair, element, *side, corners)?,
            Shape::Cluster(_) => self.at_cluster(pair, element)?,
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
        side_number: u32,
        corners: &[Vec3; 4],
    ) -> Option<(SkyDraft, Packet)> {
        let side = &self.elements.sides[side_number as usize];
        let (source, environment) = (pair.source, self.environment);
        let free = source.irradiance(environment, side.normal);
        if mean(free) <= 0.0 {
            return None;
        }
        // Only links that are not clear are measured again.
        pair.is_clear |= pair.last.is_none() && self.is_clear(element, corners, source);
        let mut draft = SkyDraft {
            pair,
            free,
            scale: mean(free) as f32,
            variation: 0.0,
            contrast: source.deviation(environment),
            weights: [0.0; LANES],
            mean_weight: source.mean_over_directions(environment, mean(free)) as f32,
            is_grid: pair.last.is_none(),
            answers: Answers::default(),
        };
        let mut packet = Packet::EMPTY;
        if !pair.is_clear {
            let few = self.is_small(&pair, draft.scale);
            (packet, draft.weights) = self.surface_packet(&pair, side_number, corners, 0, few);
        }
        Some((draft, packet))
    }

    /// Another packet of segments of a last measurement with their weights.
    fn further_packet(&self, pair: &SkyPair, number: u32) -> (Packet, [f32; LANES]) {
        match &self.elements.elements[pair.receiver as usize].shape {
            Shape::Surface { side, corners } => self.surface_packet(pair, *side, corners, number, false),
            Shape::Cluster(c) => {
                let (_, packet, weights) = self.cluster_packet(pair, *c, number, false);
                (packet, weights)
            }
        }
    }

    fn surface_packet(
        &self,
        pair: &SkyPair,
        side: u32,
        corners: &[Vec3; 4],
        number: u32,
        few: bool,
    ) -> (Packet, [f32; LANES]) {
        let (source, environment) = (pair.source, self.environment);
        let side = &self.elements.sides[side as usize];
        let seed = mix(self.seed_of(pair) ^ u64::from(number));
        let quarters = stratified_points(corners, seed);
        let first = |lane: usize| match pair.last {
            None => (quarters[lane & 3], self.direction(source, lane, 0, seed)),
            Some(last) => {
                let [s, t, u, v] = self.number(last, number, lane, 0);
                (point_on(corners, s, t), source.sample(environment, [u.into(), v.into()]))
            }
        };
        let (mut packet, mut weights) = (Packet::EMPTY, [0.0; LANES]);
        for lane in pair.lanes(number, few, seed) {
            let (point, direction) = first(lane);
            // A last measurement counts all directions; those below the horizon contribute no light.
            let draws = if pair.last.is_some() { 1 } else { MAX_DRAWS };
            let others = (1..draws).map(|draw| self.direction(source, lane, draw, seed));
            let above = std::iter::once(direction).chain(others).find(|d| d.dot(side.normal) > 0.0);
            let Some(direction) = above else { continue };
            weights[lane] = direction.dot(side.normal) * source.radiance(environment, direction);
            let from = side.end.lifted(point, side.normal);
            packet.set_lifted(lane, from, from + self.length * direction, [side.end; 2]);
        }
        (packet, weights)
    }

    /// Four numbers in `[0, 1)` of a point of a last measurement; those of another set are independent.
    fn number(&self, last: LastMeasurement, packet: u32, lane: usize, set: u32) -> [f32; 4] {
        let place = last.first.wrapping_add(packet * LANES as u32 + lane as u32);
        let turn = mix(self.seed ^ u64::from(place >> SEQUENCE_BITS)) as u32;
        sample_4d(place & ((1 << SEQUENCE_BITS) - 1), set, turn)
    }

    /// Seed of the samples of a pair.
    fn seed_of(&self, pair: &SkyPair) -> u64 {
        let tag = match pair.source {
            SkySource::Patch(k) => u64::from(k) << 1,
            SkySource::Sun(k) => u64::from(k) << 1 | 1,
        };
        mix(self.seed
            ^ mix(self.elements.elements[pair.receiver as usize].ids[0])
            ^ mix(!tag).rotate_left(17))
    }

    /// Number of segments that the accuracy of the link itself requires.
    pub fn segments(&self, pair: &SkyPair) -> u32 {
        let element = &self.elements.elements[pair.receiver as usize];
        let light = match element.shape {
            Shape::Surface { side, .. } => {
                let normal = self.elements.sides[side as usize].normal;
                mean(pair.source.irradiance(self.environment, normal)) as f32
            }
            Shape::Cluster(c) => self.model(pair.source, c, element),
        };
        lanes(self.is_small(pair, light), 0).count() as u32
    }

    /// Unoccluded irradiance of a cluster from its projected areas along the six directions, mean of the channels, W/m².
    fn model(&self, source: SkySource, cluster: u32, element: &Element) -> f32 {
        let along = source.along_axes(self.environment);
        let projected = self.elements.clusters[cluster as usize].projected;
        let model: f64 = along.iter().zip(projected).map(|(e, p)| e * p).sum();
        (model / element.area) as f32
    }

    fn at_cluster(&self, pair: SkyPair, element: &Element) -> Option<(SkyDraft, Packet)> {
        let Shape::Cluster(c) = element.shape else { return None };
        let scale = self.model(pair.source, c, element);
        if scale <= 0.0 {
            return None;
        }
        let (from, packet, weights) = self.cluster_packet(&pair, c, 0, self.is_small(&pair, scale));
        let mut free = [0.0; 3];
        for (density, normal) in from.density.iter().zip(from.normals) {
            let share = 1.0 / (f64::from(*density) * LANES as f64 * element.area);
            add(&mut free, share, pair.source.irradiance(self.environment, normal));
        }
        let draft = SkyDraft {
            pair,
            free,
            scale,
            variation: CLUSTER_DEVIATION,
            contrast: pair.source.deviation(self.environment),
            weights,
            mean_weight: 0.0,
            is_grid: false,
            answers: Answers::default(),
        };
        Some((draft, packet))
    }

    fn cluster_packet(
        &self,
        pair: &SkyPair,
        cluster: u32,
        number: u32,
        few: bool,
    ) -> (EndSamples, Packet, [f32; LANES]) {
        let (source, environment) = (pair.source, self.environment);
        let seed = mix(self.seed_of(pair) ^ u64::from(number));
        let axis = source.axis(environment);
        let from = match pair.last {
            None => EndSamples::draw(self.elements, pair.receiver, axis, 0, seed),
            Some(last) => EndSamples::at(self.elements, pair.receiver, axis, |lane| {
                let [of_side, of_point] = [0, 1].map(|set| self.number(last, number, lane, set));
                [of_side[0], of_side[1], of_point[0], of_point[1]]
            }),
        };
        let (mut packet, mut weights) = (Packet::EMPTY, [0.0; LANES]);
        for lane in pair.lanes(number, few, seed) {
            let direction = match pair.last {
                None => self.direction(source, lane, 0, seed),
                Some(last) => {
                    let [.., u, v] = self.number(last, number, lane, 0);
                    source.sample(environment, [u.into(), v.into()])
                }
            };
            let (normal, rule) = (from.normals[lane], from.rules[lane]);
            let cosine = direction.dot(normal);
            if cosine > 0.0 {
                weights[lane] = cosine * source.radiance(environment, direction) / from.density[lane];
                let start = rule.lifted(from.points[lane], normal);
                packet.set_lifted(lane, start, start + self.length * direction, [rule; 2]);
            }
        }
        if self.inside != Inside::Visible {
            shorten_to_box(&self.elements.clusters[cluster as usize].bounds, &mut packet, 0);
        }
        (from, packet, weights)
    }

    /// Whether four segments are enough for the visibility of a source with this irradiance, W/m².
    fn is_small(&self, pair: &SkyPair, light: f32) -> bool {
        pair.worth * light * agreement(pair.agreed) < FEW_SEGMENTS_ERROR
    }

    /// The direction of a segment. The source is divided into four parts, one for each row of four lanes, and each part into four, one
    /// for each point; the point of a part changes from row to row. A repeated draw takes any direction of the source.
    fn direction(&self, source: SkySource, lane: usize, draw: u64, seed: u64) -> Vec3 {
        let (i, j) = (lane & 3, lane >> 2);
        let inner = i ^ (seed >> (2 * j)) as usize & 3;
        let [u, v, ..] = numbers(mix(seed ^ draw), lane as u64);
        let place = |outer: usize, inner: usize, u: f32| {
            if draw > 0 { u.into() } else { ((2 * (outer & 1) + (inner & 1)) as f64 + f64::from(u)) / 4.0 }
        };
        source.sample(self.environment, [place(j, inner, u), place(j >> 1, inner >> 1, v)])
    }

    /// Whether geometry proves that nothing is between a surface and a source: no cluster and no surface is both in front of the receiver
    /// and in the cone of its view of the source.
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
