//! Links to the sky and the suns: the first ones, their measurement, and the light that arrives along them.

use super::link_measurement::{LINKS_PER_CHECK, measured};
use super::linked_scene::LinkedScene;
use crate::math::parallel;
use crate::math::sampling::mix;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::{DIRECTIONS, Elements, Shape};
use crate::radiosity::links::{
    LastMeasurement, SkyEstimator, SkyLink, SkyPair, SkySource, Split, VisibilityEngine, VisibilityQuery,
    sky_link_error,
};
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::radiosity::surroundings::SkyPower;
use crate::radiosity::transport::{DirectionalIrradiance, MIN_PROJECTED};
use crate::ray::LANES;
use crate::sky::Environment;
use crate::visibility::sample_runs;
use rustc_hash::FxHashMap;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Number of segments up to which a last measurement is extended if the means of sides need as many: about .05 s. Where links alone take
/// as many, the errors of their many elements cancel.
const LAST_SEGMENTS: usize = 1 << 18;

impl LinkedScene {
    /// Lights the scene by a sky and suns: adds the links of the root to them, and adds their light to the mean irradiance: the
    /// irradiance of a horizontal plane on the parts of sides from which rays leave the scene.
    pub fn add_environment(&mut self, environment: &Arc<Environment>) {
        self.beyond = mean(environment.irradiance(environment.frame().up));
        let Elements { elements, sides, .. } = &self.elements;
        let (mut power, mut absorbed) = (0.0, 0.0);
        for (side, escaped) in sides.iter().zip(&self.surroundings.escaped) {
            let area = elements[side.element as usize].area;
            power += area * f64::from(*escaped) * self.beyond;
            absorbed += area * (1.0 - mean(side.reflectance.map(f64::from)) * (1.0 - f64::from(*escaped)));
        }
        self.mean_irradiance += if absorbed > 0.0 { power / absorbed } else { 0.0 };
        self.environment = Some(environment.clone());
        if self.mean_irradiance > 0.0 {
            let pairs: Vec<SkyPair> =
                SkySource::all(environment).into_iter().map(|source| new_pair(0, source)).collect();
            self.sky_links = measure_sky(self, &pairs, 1.0, self.settings.seed);
        }
    }

    /// Fraction of the light of surfaces that comes from beyond the scene, if a fraction `open` of their rays leaves the scene and their
    /// light from the emitters is the average over all surfaces.
    pub fn fraction_from_beyond(&self, open: f64) -> f64 {
        let (beyond, own) = (open * self.beyond, self.emitted_over_area());
        if beyond > 0.0 { beyond / (beyond + own) } else { 0.0 }
    }

    /// What arrives at elements along their own links from beyond the scene, by element.
    pub fn light_from_beyond(&self) -> Vec<(u32, DirectionalIrradiance)> {
        let Some(environment) = &self.environment else { return Vec::new() };
        let mut light = BTreeMap::<u32, DirectionalIrradiance>::new();
        let mut axes = FxHashMap::default();
        for link in self.sky_links.iter().filter(|link| link.transmittance > 0.0) {
            let arriving = light.entry(link.receiver).or_default();
            let irradiance = link.irradiance.map(f64::from);
            let element = &self.elements.elements[link.receiver as usize];
            let Shape::Cluster(c) = element.shape else {
                add(&mut arriving.even, 1.0, irradiance);
                continue;
            };
            let projected = self.elements.clusters[c as usize].projected;
            // Many clusters see the same patches.
            let shares = *axes.entry(link.source).or_insert_with(|| link.source.along_axes(environment));
            let total: f64 = (0..DIRECTIONS).map(|k| shares[k] * projected[k]).sum();
            if total > MIN_PROJECTED * element.area {
                let scale = element.area / total;
                arriving.beams.iter_mut().zip(shares).for_each(|(beam, s)| add(beam, scale * s, irradiance));
            } else {
                add(&mut arriving.even, 1.0, irradiance);
            }
        }
        light.into_iter().collect()
    }

    /// Power that arrives along links from beyond the scene.
    pub fn arrived(&self) -> SkyPower {
        let mut arrived = SkyPower::default();
        for link in &self.sky_links {
            let sum: &mut Rgb = match link.source {
                SkySource::Patch(_) => &mut arrived.sky,
                SkySource::Sun(_) => &mut arrived.sun,
            };
            let area = self.elements.elements[link.receiver as usize].area;
            add(sum, area, link.irradiance.map(f64::from));
        }
        arrived
    }

    /// Links between elements, to the sky and to suns.
    pub fn link_count(&self) -> usize {
        self.links.len() + self.sky_links.len()
    }
}

/// Errors of links to the sky relative to the scene's mean irradiance, and the ends to split; [`Split::A`] is the receiver.
pub fn sky_link_errors(linked: &LinkedScene, links: &[SkyLink]) -> Vec<(f32, Split)> {
    let Some(environment) = &linked.environment else { return Vec::new() };
    let scale = 1.0 / linked.mean_irradiance as f32;
    let error = |link: &SkyLink| {
        let (error, split) = sky_link_error(&linked.elements, environment, link);
        (error * scale, split)
    };
    parallel::map(parallel::at_least(1024, links), error)
}

/// The pairs that replace links to the sky; receivers are split as needed.
pub fn sky_parts(linked: &mut LinkedScene, links: &[(SkyLink, Split)]) -> Vec<SkyPair> {
    let mut pairs = Vec::with_capacity(4 * links.len());
    let Some(environment) = linked.environment.clone() else { return pairs };
    for (link, split) in links {
        let known = again(link);
        if *split == Split::A {
            linked.split(link.receiver);
            let children = linked.elements.elements[link.receiver as usize].child_range();
            pairs.extend(children.map(|c| SkyPair { receiver: c as u32, ..known }));
        } else {
            pairs.extend(link.source.parts(&environment).map(|source| SkyPair { source, ..known }));
        }
    }
    pairs
}

/// Measures links to the sky, as [`measure`](super::link_measurement::measure) does other links.
pub fn measure_sky(linked: &mut LinkedScene, pairs: &[SkyPair], threshold: f32, seed: u64) -> Vec<SkyLink> {
    let Some(environment) = linked.environment.clone() else { return Vec::new() };
    let pairs: Vec<SkyPair> = pairs.iter().map(|pair| with_worth(linked, pair, threshold)).collect();
    let estimator = |engine| sky_estimator(linked, &environment, engine, seed);
    let queries = |pairs: &[SkyPair]| -> Vec<VisibilityQuery> {
        pairs.iter().filter_map(|pair| Some(estimator(&linked.engine).draft(*pair)?.1)).collect()
    };
    let engine: VisibilityEngine =
        linked.engine.for_queries(sample_runs(pairs.len()).map(|run| queries(&pairs[run])));
    let estimator = estimator(&engine);
    let (links, tally) =
        measured(&linked.ranks, &pairs, |scratch, chunk| estimator.measure_all(chunk, scratch));
    linked.tally.add(tally);
    links
}

/// Measures the links to the sky that are not certainly clear again, as [`remeasure_links`](super::link_measurement::remeasure_links) does.
pub fn remeasure_sky_links(linked: &mut LinkedScene, threshold: f32, closing: f64, deadline: &Deadline) {
    let (certain, mut uncertain): (Vec<SkyLink>, Vec<SkyLink>) =
        std::mem::take(&mut linked.sky_links).into_iter().partition(|link| link.is_clear);
    let closing = closing * (certain.len() + uncertain.len() + linked.elements.len()) as f64;
    linked.sky_links = certain;
    // Neighbours are measured by consecutive points; suns come first, if the time does not suffice for all.
    parallel::sort_by_key(&mut uncertain, |link| match link.source {
        SkySource::Sun(sun) => (sun.into(), link.receiver),
        SkySource::Patch(patch) => (1 << 32 | u64::from(patch), link.receiver),
    });
    let pairs = last_pairs(linked, &uncertain, threshold);
    for (slice, pairs) in uncertain.chunks(LINKS_PER_CHECK).zip(pairs.chunks(LINKS_PER_CHECK)) {
        if deadline.left() <= closing {
            linked.sky_links.extend(slice);
            continue;
        }
        let made = measure_sky(linked, pairs, threshold, mix(linked.settings.seed));
        linked.sky_links.extend(made);
    }
}

/// The pairs of links that are measured for the last time, with enough segments that the sampling error of each side's mean irradiance
/// and of each cluster's light is no larger than that of an element by one link. Noise of variance σ² / n on parts of area a of an area A
/// adds up to Σ (a / A)² σ² / n, which is smallest for n in proportion to a σ. A dark side counts like any other.
fn last_pairs(linked: &LinkedScene, links: &[SkyLink], threshold: f32) -> Vec<SkyPair> {
    let Elements { elements, sides, area, .. } = &linked.elements;
    let mut pairs: Vec<SkyPair> = links.iter().map(|l| with_worth(linked, &again(l), threshold)).collect();
    let Some(environment) = &linked.environment else { return pairs };
    if links.len() * LANES >= LAST_SEGMENTS {
        return pairs;
    }
    let estimator = sky_estimator(linked, environment, &linked.engine, linked.settings.seed);
    let least: Vec<u32> = parallel::map(&pairs, |pair| estimator.segments(pair));
    // The surface or cluster whose mean a link counts for, by element; a σ of each link, and its sum over those of one mean.
    let whole_of = |link: &SkyLink| match elements[link.receiver as usize].shape {
        Shape::Surface { side, .. } => sides[side as usize].element as usize,
        Shape::Cluster(_) => link.receiver as usize,
    };
    let part = |(link, least): (&SkyLink, &u32)| {
        elements[link.receiver as usize].area * f64::from(link.noise) * f64::from(*least).sqrt()
    };
    let parts: Vec<f64> = links.iter().zip(&least).map(part).collect();
    let mut sums = vec![0.0; elements.len()];
    links.iter().zip(&parts).for_each(|(link, part)| sums[whole_of(link)] += part);
    let tolerated = (f64::from(threshold) * linked.mean_irradiance).powi(2) * area;
    let more = |k: usize| {
        let of = whole_of(&links[k]);
        (sums[of] * parts[k] / (tolerated * elements[of].area) - f64::from(least[k])).max(0.0)
    };
    let room = LAST_SEGMENTS as f64 - least.iter().map(|n| f64::from(*n)).sum::<f64>();
    let scale = (room / (0..links.len()).map(more).sum::<f64>()).min(1.0);
    let (mut first, mut left) = (0u32, 0.0);
    for (k, (pair, link)) in pairs.iter_mut().zip(links).enumerate() {
        left += scale * more(k);
        let count = least[k] + left as u32;
        left -= left.floor();
        pair.last = Some(LastMeasurement {
            first,
            count,
            variation: link.variation,
            noise: link.noise,
            transmittance: link.transmittance,
        });
        first = first.wrapping_add(count);
    }
    pairs
}

fn sky_estimator<'a>(
    linked: &'a LinkedScene,
    environment: &'a Environment,
    engine: &'a VisibilityEngine,
    seed: u64,
) -> SkyEstimator<'a> {
    SkyEstimator {
        elements: &linked.elements,
        environment,
        engine,
        length: linked.surroundings.length,
        seed,
        inside: linked.settings.inside,
    }
}

/// A pair without an earlier measurement.
fn new_pair(receiver: u32, source: SkySource) -> SkyPair {
    SkyPair { receiver, source, worth: f32::INFINITY, agreed: 0.0, is_clear: false, last: None }
}

/// The pair of a link, with the results of its earlier measurement.
fn again(link: &SkyLink) -> SkyPair {
    SkyPair { agreed: link.agreed, is_clear: link.is_clear, ..new_pair(link.receiver, link.source) }
}

/// The pair with the error that 1 W/m² causes.
fn with_worth(linked: &LinkedScene, pair: &SkyPair, threshold: f32) -> SkyPair {
    let receiver = pair.receiver as usize;
    let element = &linked.elements.elements[receiver];
    let weight = f64::from(linked.elements.states[receiver].statistics.weight);
    let of_area = (element.area / linked.elements.area).sqrt();
    let tolerated = f64::from(threshold) * linked.mean_irradiance;
    SkyPair { worth: (weight * of_area / tolerated) as f32, ..*pair }
}
