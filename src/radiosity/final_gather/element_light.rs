//! The irradiance of elements by their own rays, from light that is already computed.
//!
//! The local pass estimates irradiance and exchange with the same few rays. Here each element traces more rays, which read the light that
//! the local pass found: direct light from emitters drawn for this element, reflected light from the elements that cosine-weighted rays
//! hit. The rays of an element form two halves, to separate noise from differences between elements ([`super::sharing`]).

use super::element_rays::{LIGHT_SET, LeafRays, batches, join_sequences};
use super::element_samples::{DIRECT, ElementLight, REFLECTED, SharedLight};
use super::gatherer::{Buffers, FinalGather};
use super::local_pass::LocalPass;
use super::neighbours::{Place, Sight, Walls};
use super::ray_counts::NEEDED_SHARE;
use super::sharing::share;
use crate::math::parallel;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::{Elements, Shape, Side};
use crate::radiosity::links::{Tally, VisibilityEngine};
use crate::radiosity::rgb::{Rgb, mean};
use crate::radiosity::surroundings::{ESCAPED, SideRays, SkyPower};
use glam::Vec3;
use rustc_hash::FxHashMap;
use smallvec::SmallVec;

/// Smallest number of rays of each half: a quarter of a packet; a half without rays has no estimate of its noise.
const MIN_HALF: u32 = 4;
/// Largest number of rays of each half, so that no element can use up all rays: noise of 1 % where one ray deviates by half of the mean.
const MAX_HALF: u32 = 1024;
/// Deviation of one ray from the mean light of its element, relative to that light, where it is not known: that of a usual element, as
/// for [`RAYS_TIMES_ERROR_SQUARED`](super::ray_counts).
const DEFAULT_DEVIATION: f64 = 0.5;

/// Rays of an element to each sun for each of its other rays, where parts of the surface are in the shade. Rays to one sun are coherent:
/// four take about as long as a ray into the scene. Below trees most of the noise comes from shadows.
const RAYS_TO_SUN: u32 = 4;
/// Elements are split if the variance of direct light over elements exceeds the allowed variance by this factor. The parts keep some of the
/// variance: with 1 an office has 1,020 more elements, 34.5 instead of 33.8 s (`mrvis solve office.obj --output vtu --audit 0`).
const MIN_EXCESS: f64 = 1.1;
/// Number of neighbouring leaves that use one sequence of random numbers: more than the 49 that share their light.
const LEAVES_OF_SEQUENCE: usize = 64;
/// Distance beyond the middle of an edge at which the element there is looked up, as a fraction of the distance from the centre: far
/// above rounding, and within elements of an eighth of the size.
const BEYOND_EDGE: f32 = 1.0 / 16.0;
/// Elements of one parallel task that traces a ray along the normal of each: sixteen packets.
const CHUNK: usize = 256;

/// Largest factor by which reflected light is scaled to conserve its power, and the inverse of the smallest: with eight rays each, the
/// faces of a lamp that stands on a floor find up to three times the light that the floor sends there.
const MAX_REFLECTED_FACTOR: f64 = 4.0;

/// The light that elements have gathered.
pub struct Gathered {
    /// Leaves with their light.
    pub light: Vec<(u32, SharedLight)>,
    /// Fraction of the emitted power that meets elements, by channel.
    pub received: Rgb,
    /// The power that arrives from sky and suns.
    pub arrived: SkyPower,
    /// Leaves without light, because the time was too short.
    pub skipped: usize,
    /// Cost of the rays.
    pub tally: Tally,
}

/// Light of leaves by their own rays, before it is shared between neighbours.
pub struct ElementSamples {
    /// Leaves, in any order.
    leaves: Vec<u32>,
    /// Light of the leaves, in the same order.
    light: Vec<ElementLight>,
    /// Rays of each half of a leaf, divided by [`FinalGather::wanted_rays`].
    scale: f64,
    /// Leaves without rays, because the time was too short.
    skipped: usize,
    tally: Tally,
}

impl ElementSamples {
    /// The leaves over which direct light varies most, at most `max`: as many as needed to bring the area-weighted mean variance over all
    /// other leaves to at most `variance`, relative to the square of the mean light. None if the mean hardly exceeds this limit.
    pub fn most_varying(&self, elements: &Elements, variance: f64, max: usize) -> Vec<u32> {
        let area = |leaf: u32| elements.elements[leaf as usize].area;
        let (mut all, mut sum) = (0.0, 0.0);
        let mut found: Vec<(f64, u32)> = Vec::new();
        for (&leaf, light) in self.leaves.iter().zip(&self.light) {
            let area = area(leaf);
            all += area;
            sum += area * (light.mean(DIRECT) + light.mean(REFLECTED));
            if light.variance_over_quarters > 0.0 && !elements.states[leaf as usize].crossed {
                found.push((area * f64::from(light.variance_over_quarters), leaf));
            }
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let allowed = variance * sum * sum / all.max(f64::MIN_POSITIVE);
        let mut rest: f64 = found.iter().map(|of| of.0).sum();
        let mut split = Vec::new();
        if rest <= MIN_EXCESS * allowed {
            return split;
        }
        for (own, leaf) in found.into_iter().take(max) {
            if rest <= allowed {
                break;
            }
            rest -= own;
            split.push(leaf);
        }
        split
    }
}

/// Whether irradiances are 0 but for rounding, `dark`. Noise below 0 is a sign of light, even if the mean over channels is 0.
fn has_no_light(irradiances: [Rgb; 3], dark: f64) -> bool {
    irradiances.iter().flatten().all(|e| e.abs() <= dark)
}

impl FinalGather<'_> {
    /// The rays that a leaf should have, up to a factor.
    ///
    /// The sum of squared errors, by area and weight, is smallest with rays in proportion to √area times the weighted deviation of one
    /// ray (Neyman 1934). The rays of the local pass estimate the deviation: an estimate from the same rays as the light would correlate
    /// with it, and elements that happen to look dark would stay dark.
    fn wanted_rays(&self, local: &LocalPass, e: u32) -> f64 {
        let Elements { elements, states, .. } = &self.linked.elements;
        let result = &local.results[e as usize];
        let weight = elements[e as usize].area * f64::from(states[e as usize].importance);
        // Without rays of the first pass the deviation is unknown: leaves that were not traced for lack of time get the smallest number
        // of rays.
        let deviation = match result.rays {
            0 if states[e as usize].is_excluded() => DEFAULT_DEVIATION * mean(result.irradiance).max(0.0),
            0 => 0.0,
            _ => f64::from(result.deviation),
        };
        weight.sqrt() * deviation
    }

    /// The light of all leaves after a local pass: that of some leaves is `known`, each other leaf traces the rays that it would have if
    /// all leaves had about `rays` rays together. Leaves without rays because of the deadline are missing.
    pub fn sample_elements(
        &self,
        local: &LocalPass,
        known: Vec<(u32, ElementLight)>,
        rays: f64,
        deadline: &Deadline,
    ) -> ElementSamples {
        let all = self.linked.leaves();
        let sum: f64 = all.iter().map(|&e| self.wanted_rays(local, e)).sum();
        let mut samples = ElementSamples {
            leaves: Vec::new(),
            light: Vec::new(),
            scale: if sum > 0.0 { 0.5 * rays / sum } else { 0.0 },
            skipped: 0,
            tally: Tally::default(),
        };
        let mut is_known = vec![false; self.linked.elements.len()];
        known.iter().for_each(|(leaf, _)| is_known[*leaf as usize] = true);
        let others: Vec<u32> = all.into_iter().filter(|leaf| !is_known[*leaf as usize]).collect();
        (samples.leaves, samples.light) = known.into_iter().unzip();
        self.add_samples(&mut samples, local, &others, deadline);
        samples
    }

    /// Replaces the light of leaves that were split by that of their `parts`.
    pub fn sample_parts(
        &self,
        samples: &mut ElementSamples,
        local: &LocalPass,
        parts: &[u32],
        deadline: &Deadline,
    ) {
        let elements = &self.linked.elements.elements;
        let ElementSamples { leaves, light, .. } = samples;
        let is_leaf = |e: &u32| elements[*e as usize].is_leaf();
        let kept = leaves.iter().zip(light.iter()).filter(|(e, _)| is_leaf(e)).map(|(e, light)| (*e, *light));
        (*leaves, *light) = kept.unzip();
        self.add_samples(samples, local, parts, deadline);
    }

    fn add_samples(
        &self,
        samples: &mut ElementSamples,
        local: &LocalPass,
        leaves: &[u32],
        deadline: &Deadline,
    ) {
        let of = |&leaf: &u32| {
            let half = samples.scale * self.wanted_rays(local, leaf);
            // Halves of large elements fill packets of sixteen.
            let count = (8.0 * (half / 8.0).round()).clamp(f64::from(MIN_HALF), f64::from(MAX_HALF)) as u32;
            let result = &local.results[leaf as usize];
            let suns = if result.sun_varies { RAYS_TO_SUN } else { 1 };
            // Twice as many rays without rays to emitters take as long, if there are no rays to suns and bright surfaces besides.
            let has_others = self.has_environment() || self.bright().is_some();
            let (count, to_emitters) = match result.meets_emitters && !has_others {
                true => ((2 * count).min(MAX_HALF), false),
                false => (count, true),
            };
            LeafRays { leaf, count, to_emitters, suns, sequences: self.sequences_of(leaf, LIGHT_SET) }
        };
        let mut rays: Vec<LeafRays> = leaves.iter().map(of).collect();
        self.join_sequences(&mut rays);
        let (light, tally) = self.trace_elements(&rays, deadline);
        samples.tally.add(tally);
        for (&leaf, light) in leaves.iter().zip(light) {
            if light.rays > 0 {
                samples.leaves.push(leaf);
                samples.light.push(light);
            } else {
                samples.skipped += 1;
            }
        }
    }

    /// Gives neighbouring leaves parts of one sequence. Ids are numbers in the tree of clusters and parts of surfaces: most leaves with
    /// near ids are neighbours. Both halves of a leaf have parts of the same sequence, but not below a sky, where light is a product of
    /// means over both halves: their errors must be independent there.
    fn join_sequences(&self, rays: &mut [LeafRays]) {
        let mut ordered: Vec<&mut LeafRays> = rays.iter_mut().collect();
        ordered.sort_unstable_by_key(|of| self.linked.elements.elements[of.leaf as usize].ids[0]);
        let joins_halves = !self.has_environment();
        ordered.chunks_mut(LEAVES_OF_SEQUENCE).for_each(|group| join_sequences(group, joins_halves));
    }

    /// The irradiance of leaves from their samples, shared between neighbours.
    pub fn share_samples(&self, samples: ElementSamples, local: &LocalPass, deadline: &Deadline) -> Gathered {
        let Elements { elements, states, .. } = &self.linked.elements;
        let ElementSamples { leaves, light, skipped, tally, .. } = samples;
        let areas: Vec<f64> = leaves.iter().map(|&e| elements[e as usize].area).collect();
        let (mut light, mut received_share, mut arrived) = (light, local.received, local.arrived);
        if skipped == 0 {
            let of_emitters =
                |light: &ElementLight| light.mean(DIRECT) - f64::from(light.sun.element_sum()) / 3.0;
            let received = light.iter().zip(&areas).map(|(light, area)| area * of_emitters(light)).sum();
            let factor;
            (factor, received_share) = self.balance_of_direct_light(received, &local.sampled);
            light.iter_mut().for_each(|light| light.scale(DIRECT, Vec3::splat(factor as f32)));
            let factor = self.balance_of_reflected_light(&leaves, &areas, &light, local);
            light.iter_mut().for_each(|light| light.scale(REFLECTED, factor));
            arrived =
                SkyPower::of(light.iter().zip(&areas).map(|(light, &area)| (area, light.sky, light.sun)));
        }
        let received =
            light.iter().zip(&areas).map(|(of, area)| area * (of.mean(DIRECT) + of.mean(REFLECTED)));
        let level = received.sum::<f64>().max(0.0) / areas.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        // The light of an element differs on both sides of a surface that crosses it: crossed elements share no light. Elements without
        // light in both passes share none either, so that they get no light from elements behind the next wall.
        let dark = self.linked.dark();
        let is_alone = |i: usize| {
            let [direct, reflected] = [DIRECT, REFLECTED].map(|kind| light[i].by_channel(kind));
            let passes = [local.results[leaves[i] as usize].irradiance, direct, reflected];
            states[leaves[i] as usize].crossed || has_no_light(passes, dark)
        };
        let (alone, whole): (Vec<usize>, Vec<usize>) = (0..leaves.len()).partition(|&i| is_alone(i));
        let of_whole: Vec<u32> = whole.iter().map(|&i| leaves[i]).collect();
        let places = self.places_of(&of_whole);
        let light_of_whole: Vec<ElementLight> = whole.iter().map(|&i| light[i]).collect();
        let areas: Vec<f64> = whole.iter().map(|&i| areas[i]).collect();
        let needed = NEEDED_SHARE * self.error;
        let walls = self.walls_at(&of_whole);
        let sight = Sight { walls, blockers: Some(self.linked.engine.exact()) };
        let shared = share(&places, &areas, &sight, &light_of_whole, needed, &self.ranks, deadline);
        let own = alone.iter().map(|&i| {
            let result = &local.results[leaves[i] as usize];
            let own = SharedLight::alone(&light[i]);
            // The spread of n rays that all find the same light is 0. By the rule of succession (Laplace), the next ray finds other light
            // with the probability 1 / (n + 2). How much other light is known from the deviation in the local pass; elements without rays
            // there have the usual one.
            let one = match result.rays {
                0 => DEFAULT_DEVIATION * level,
                rays => f64::from(result.noise) * f64::from(rays).sqrt(),
            };
            let unseen = one / f64::from(2 * light[i].rays + 2);
            (leaves[i], SharedLight { error: own.error.max(unseen * unseen), ..own })
        });
        let light = whole.iter().map(|&i| leaves[i]).zip(shared).chain(own).collect();
        Gathered { light, received: received_share, arrived, skipped, tally }
    }

    /// The factors f, by channel, that make the reflected light that leaves receive equal to the light that leaves reflect towards
    /// others: Σ A f·r = Σ A k·ρ·(d + f·r), both summed over the same leaves. Here `d` is the light of a leaf from emitters, suns and
    /// sky, `r` its reflected light, ρ its reflectance and `k` the fraction of its light that other elements receive. Rays of leaves miss
    /// a small bright spot, as on a wall beside a lamp, or hit it too often; the light that the spot reflects is known from its own
    /// direct light.
    fn balance_of_reflected_light(
        &self,
        leaves: &[u32],
        areas: &[f64],
        light: &[ElementLight],
        local: &LocalPass,
    ) -> Vec3 {
        if !matches!(self.linked.engine, VisibilityEngine::Exact(_)) {
            return Vec3::ONE;
        }
        let (mut sent, mut missing) = ([0.0; 3], [0.0; 3]);
        for ((&leaf, area), light) in leaves.iter().zip(areas).zip(light) {
            let reflectance = self.linked.elements.sides[self.side_of(leaf) as usize].reflectance;
            let part = f64::from(local.results[leaf as usize].row_sum);
            let [mut direct, mut reflected] = [DIRECT, REFLECTED].map(|kind| light.by_channel(kind));
            for (k, sky) in light.sky.to_array().into_iter().enumerate() {
                (direct[k], reflected[k]) = (direct[k] + f64::from(sky), reflected[k] - f64::from(sky));
            }
            for k in 0..3 {
                let onwards = part * f64::from(reflectance[k]);
                sent[k] += area * onwards * direct[k];
                missing[k] += area * (1.0 - onwards) * reflected[k];
            }
        }
        let factor = |k: usize| match sent[k] > 0.0 && missing[k] > 0.0 {
            true => (sent[k] / missing[k]).clamp(1.0 / MAX_REFLECTED_FACTOR, MAX_REFLECTED_FACTOR) as f32,
            false => 1.0,
        };
        Vec3::from_array(std::array::from_fn(factor))
    }

    pub(super) fn side_of(&self, leaf: u32) -> u32 {
        match self.linked.elements.elements[leaf as usize].shape {
            Shape::Surface { side, .. } => side,
            Shape::Cluster(_) => unreachable!("leaves are surfaces"),
        }
    }

    /// The edges of leaves along which other surfaces stand, and those of elements beside them that other surfaces cross, by index in
    /// `leaves`.
    fn walls_at(&self, leaves: &[u32]) -> Walls {
        let Elements { elements, states, .. } = &self.linked.elements;
        let edges_of = |leaf: u32| -> (u32, SmallVec<[[Vec3; 2]; 4]>) {
            let Shape::Surface { side, corners } = elements[leaf as usize].shape else {
                unreachable!("leaves are surfaces")
            };
            let count = if corners[2] == corners[3] { 3 } else { 4 };
            (side, (0..count).map(|k| [corners[k], corners[(k + 1) % count]]).collect())
        };
        let mut walls = Walls::default();
        let along = self.linked.walls_along(&self.linked.engine.exact(), leaves);
        for ((place, leaf), bits) in (0..).zip(leaves).zip(along).filter(|(_, bits)| *bits != 0) {
            let edges = edges_of(*leaf).1.into_iter().enumerate();
            let edges = edges.filter(|(k, _)| bits >> k & 1 != 0).map(|(_, edge)| edge);
            walls.entry(place).or_default().extend(edges);
        }
        let places: FxHashMap<u32, u32> = leaves.iter().copied().zip(0..).collect();
        let is_crossed = |e: &u32| states[*e as usize].crossed && elements[*e as usize].is_leaf();
        for crossed in (0..elements.len() as u32).filter(is_crossed) {
            let (side, edges) = edges_of(crossed);
            for edge in edges {
                let middle = 0.5 * (edge[0] + edge[1]);
                let beyond = middle + BEYOND_EDGE * (middle - elements[crossed as usize].centre);
                if let Some(&place) = places.get(&self.lookup.leaf(side, beyond)) {
                    walls.entry(place).or_default().push(edge);
                }
            }
        }
        walls
    }

    /// The leaves as entries of the neighbour search, with the free height along the normal, which one ray measures.
    fn places_of(&self, leaves: &[u32]) -> Vec<Place> {
        let Elements { elements, sides, .. } = &self.linked.elements;
        let exact = self.linked.engine.exact();
        let rays = SideRays {
            elements: &self.linked.elements,
            exact: &exact,
            length: self.linked.surroundings.length,
        };
        let of_chunk = |leaves: &[u32]| {
            let sides = leaves.iter().map(|&e| {
                let (element, side) = (&elements[e as usize], self.side_of(e));
                (element.centre, element.radius, side, &sides[side as usize])
            });
            let normals =
                sides.clone().map(|(centre, .., side)| ((centre, side.normal, side.end), side.normal));
            let mut free = Vec::with_capacity(leaves.len());
            rays.trace(normals, &mut Vec::new(), |met| {
                free.push(if met.side == ESCAPED { f32::INFINITY } else { met.from.distance(met.at) });
            });
            let place = |((centre, radius, number, side), free): ((Vec3, f32, u32, &Side), f32)| Place {
                centre,
                normal: side.normal,
                radius,
                side: number,
                free,
            };
            sides.zip(free).map(place).collect::<Vec<Place>>()
        };
        parallel::flat_map(parallel::chunks(leaves, CHUNK), of_chunk)
    }

    /// The light of leaves by their own rays. Leaves without rays because of the deadline have no light.
    fn trace_elements(&self, leaves: &[LeafRays], deadline: &Deadline) -> (Vec<ElementLight>, Tally) {
        deadline.stage("light of elements", leaves.len());
        let batches = batches(leaves);
        let rows = self.ranks.rows(batches.len());
        let made: Vec<(Vec<ElementLight>, Tally)> =
            parallel::map_with(rows.numbers(), Buffers::default, |buffers, k| {
                buffers.scratch.tally = Tally::default();
                let batch = &leaves[batches[k].clone()];
                let light = match deadline.late() {
                    true => vec![ElementLight::default(); batch.len()],
                    false => self.light_of(batch, buffers),
                };
                deadline.advance(rows.steps(batch.len()));
                (light, buffers.scratch.tally)
            });
        let (mut light, mut tally) = (Vec::with_capacity(leaves.len()), Tally::default());
        for (part, cost) in rows.gather(made) {
            light.extend(part);
            tally.add(cost);
        }
        (light, tally)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_light() {
        let is_dark = |light: Rgb| has_no_light([[0.0; 3], light, [1e-10; 3]], 1e-9);
        assert!(is_dark([0.0, -1e-10, 1e-10]));
        for light in [[-1.0; 3], [1.0, -1.0, 0.0]] {
            assert!(!is_dark(light), "{light:?}");
        }
    }
}
