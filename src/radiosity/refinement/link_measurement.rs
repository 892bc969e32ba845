//! Measures the links of many pairs of elements in parallel.

use super::linked_scene::LinkedScene;
use crate::math::parallel;
use crate::math::sampling::mix;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::links::{
    Accuracy, BlockerCertificate, Link, LinkEstimator, Scratch, Tally, VisibilityEngine, VisibilityQuery,
};
use crate::radiosity::surroundings::Surroundings;
use crate::ranks::Ranks;
use crate::visibility::sample_runs;
use serde::{Serialize, de::DeserializeOwned};

/// Pairs per parallel task: up to 64 packets. Does not change results.
const CHUNK: usize = 64;
/// Links measured between two checks of the deadline: at most 32,768 segments. Changes results with a time limit only.
pub const LINKS_PER_CHECK: usize = 2048;
/// Standard error of the link of a cluster with itself, relative to its exchange area: that of a share measured by 11
/// rays (√(1/11) = 0.3). Half or twice as much change irradiance by less than 0.001 % (`constants.py solve`).
const INSIDE_NOISE: f32 = 0.3;

/// Two elements whose link is to be measured.
#[derive(Clone, Copy)]
pub struct Pair {
    pub a: u32,
    pub b: u32,
    /// [`Link::transmittance_deviation`] of the link between the elements that contain the ends.
    pub deviation: f32,
    /// The certificate of that link.
    pub certificate: BlockerCertificate,
    /// Whether all segments of that link were blocked.
    pub blocked: bool,
}

impl Pair {
    /// Two elements without an earlier measurement.
    pub fn new(a: u32, b: u32) -> Pair {
        Pair { a, b, deviation: 0.5, certificate: BlockerCertificate::UNKNOWN, blocked: false }
    }
}

/// Links of all pairs in the order of their tasks, and the tally of all queries. One rank runs each task of up to [`CHUNK`] pairs.
pub fn measured<P: Sync, L: Send + Serialize + DeserializeOwned>(
    ranks: &Ranks,
    pairs: &[P],
    measure: impl Fn(&mut Scratch, &[P]) -> Vec<L> + Send + Sync,
) -> (Vec<L>, Tally) {
    let measure_chunk = |scratch: &mut Scratch, k: usize| {
        scratch.tally = Tally::default();
        (measure(scratch, &pairs[CHUNK * k..pairs.len().min(CHUNK * (k + 1))]), scratch.tally)
    };
    let rows = ranks.rows(pairs.len().div_ceil(CHUNK));
    let made = rows.gather(parallel::map_with(rows.numbers(), Scratch::default, measure_chunk));
    let (mut links, mut tally) = (Vec::with_capacity(pairs.len()), Tally::default());
    for (part, own) in made {
        links.extend(part);
        tally.add(own);
    }
    (links, tally)
}

/// Measures pairs, in their order within each task, the insides of clusters last; pairs that exchange nothing are left out.
/// `threshold` is the tolerated error relative to the mean irradiance.
pub fn measure(linked: &mut LinkedScene, pairs: &[Pair], threshold: f32, seed: u64) -> Vec<Link> {
    let engine = engine_for(linked, pairs, threshold);
    let estimator = LinkEstimator { engine: &engine, ..estimator(linked, seed) };
    let (links, tally) = measured(&linked.ranks, pairs, |scratch, chunk| {
        let (inside, others): (Vec<Pair>, Vec<Pair>) = chunk.iter().partition(|p| p.a == p.b);
        let asked: Vec<_> =
            others.iter().map(|pair| ([pair.a, pair.b], accuracy(linked, pair, threshold))).collect();
        let mut links = estimator.measure_all(&asked, scratch);
        links.extend(inside.iter().map(|pair| inside_link(linked, pair.a)));
        links
    });
    linked.tally.add(tally);
    links
}

/// Measures all links without a certificate again, with other samples. Refinement keeps a link because of its measurement, so
/// that the kept values are biased: too large where most is visible, too small where little is. Links whose turn comes after
/// the deadline keep their values; `closing` is the time in seconds, for each link and element, that the last sweeps need.
pub fn remeasure_links(linked: &mut LinkedScene, threshold: f32, closing: f64, deadline: &Deadline) {
    let (certain, uncertain): (Vec<Link>, Vec<Link>) = std::mem::take(&mut linked.links)
        .into_iter()
        .partition(|l| l.certificate == BlockerCertificate::CLEAR || l.a == l.b);
    let again = |l: &Link| Pair {
        deviation: l.transmittance_deviation(),
        certificate: l.certificate,
        ..Pair::new(l.a, l.b)
    };
    let closing = closing * (certain.len() + uncertain.len() + linked.elements.len()) as f64;
    linked.links = certain;
    deadline.stage("measuring links again", uncertain.len());
    for slice in uncertain.chunks(LINKS_PER_CHECK) {
        deadline.advance(slice.len());
        if deadline.left() <= closing {
            linked.links.extend(slice);
            continue;
        }
        let pairs: Vec<Pair> = slice.iter().map(again).collect();
        let made = measure(linked, &pairs, threshold, mix(linked.settings.seed));
        linked.links.extend(made);
    }
}

/// The estimator of the scene's links.
fn estimator(linked: &LinkedScene, seed: u64) -> LinkEstimator<'_> {
    LinkEstimator { elements: &linked.elements, engine: &linked.engine, seed, inside: linked.settings.inside }
}

/// The engine for a set of pairs: exact rays where multi-resolution visibility is not faster for a sample of the pairs.
fn engine_for(linked: &LinkedScene, pairs: &[Pair], threshold: f32) -> VisibilityEngine {
    let estimator = estimator(linked, linked.settings.seed);
    let queries = |pairs: &[Pair]| -> Vec<VisibilityQuery> {
        let between = pairs.iter().filter(|pair| pair.a != pair.b);
        between
            .filter_map(|pair| Some(estimator.draft(pair.a, pair.b, accuracy(linked, pair, threshold))?.1))
            .collect()
    };
    linked.engine.for_queries(sample_runs(pairs.len()).map(|run| queries(&pairs[run])))
}

/// The link of a cluster with itself, from the rays of the probe.
fn inside_link(linked: &LinkedScene, cluster: u32) -> Link {
    let area = linked.elements.elements[cluster as usize].area as f32;
    let Surroundings { enclosed, enclosed_emission, .. } = &linked.surroundings;
    let exchange_area = enclosed[cluster as usize] * area;
    // Of emitted light a larger fraction is enclosed, as of a small lamp above a large floor: the lamp's light meets the floor, but the
    // floor's light no lamp.
    let of_emission = enclosed_emission[cluster as usize] * area;
    Link {
        a: cluster,
        b: cluster,
        exchange_area,
        transmittance: 1.0,
        variation: [exchange_area.max(of_emission); 2],
        noise: INSIDE_NOISE * exchange_area,
        rays: 0,
        certificate: BlockerCertificate::UNKNOWN,
    }
}

/// How accurately the link of a pair must be measured.
fn accuracy(linked: &LinkedScene, pair: &Pair, threshold: f32) -> Accuracy {
    let &Pair { a, b, deviation, certificate, blocked } = pair;
    let worth = |receiver: u32, source: u32| {
        let e = &linked.elements.elements[receiver as usize];
        let [l, from] = [receiver, source].map(|e| linked.elements.states[e as usize].statistics);
        let of_area = (e.area / linked.elements.area).sqrt() / e.area.max(f64::MIN_POSITIVE);
        f64::from(l.weight) * f64::from(from.mean + from.deviation) * of_area
    };
    let tolerated = f64::from(threshold) * linked.mean_irradiance;
    let (at_a, at_b) = (worth(a, b), worth(b, a));
    let first_receives = at_a >= at_b;
    let receiver = if first_receives { a } else { b };
    Accuracy {
        worth: (at_a.max(at_b) / tolerated) as f32,
        feature_size: linked.elements.states[receiver as usize].feature_size,
        deviation,
        certificate,
        blocked,
        first_receives,
    }
}
