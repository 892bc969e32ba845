//! Links whose error is too large are replaced by links of their ends' parts.

use super::{Solver, clock::Clock, histogram::Histogram};
use crate::radiosity::elements::Shape;
use crate::radiosity::links::{
    Between, Care, Light, Link, Meter, Question, Scratch, Sight, Split, Tally, judge, mix,
};
use rayon::prelude::*;
use std::collections::VecDeque;

/// Links refined between two looks at the clock, with their parts in turn and once.
const SLICE: usize = 2048;
const SHORT_SLICE: usize = 64;
/// Links that a link becomes more, about.
const MORE: usize = 3;
/// Pairs that one task measures.
const CHUNK: usize = 64;
/// Runs of neighbouring pairs that stand for a wave, about, and the length of each; at most an eighth of it but for the first.
const RUNS: usize = 16;
const RUN: usize = 16;

/// What became of links that were to be refined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Refined {
    /// Links that were replaced.
    pub replaced: usize,
    /// There is no memory for more.
    pub full: bool,
}

/// Two elements that a link is to be measured for.
#[derive(Clone, Copy)]
struct Pair {
    a: u32,
    b: u32,
    /// What the link that held them says of visibility: [`Link::mixed`].
    mixed: f32,
    /// What it knows to stand between its ends.
    between: Between,
    /// Whether none of its segments got through.
    hidden: bool,
}

impl Pair {
    /// Two elements of which nothing is known.
    fn new(a: u32, b: u32) -> Pair {
        Pair { a, b, mixed: 0.5, between: Between::SOMETHING, hidden: false }
    }
}

impl Solver {
    /// Errors of all links, relative to the scene's mean irradiance, and the ends to split.
    pub(super) fn errors(&self) -> Vec<(f32, Split)> {
        let scale = 1.0 / self.scale as f32;
        self.links
            .par_iter()
            .with_min_len(4096)
            .map(|l| {
                let (error, split) = judge(&self.elements, l, &self.light, self.oracle);
                (error * scale, split)
            })
            .collect()
    }

    /// The error above which there are at most `count` links, `least` or more.
    pub(super) fn threshold(&self, errors: &[(f32, Split)], count: usize, least: f32) -> f32 {
        let open = errors.iter().filter(|(_, split)| *split != Split::Neither);
        Histogram::new(open.map(|(error, _)| *error)).threshold(count, least)
    }

    /// Refines all links with errors above a threshold and their parts in turn, with `once` not these, a slice at a time;
    /// `stop` is told the number of links and elements and asked between slices, and not before something is refined.
    pub(super) fn refine(
        &mut self,
        errors: &[(f32, Split)],
        threshold: f32,
        once: bool,
        stop: &dyn Fn(usize) -> bool,
    ) -> Refined {
        let open = |(error, split): (f32, Split)| error > threshold && split != Split::Neither;
        let mut wave: VecDeque<(Link, Split)> = VecDeque::new();
        let mut kept = Vec::with_capacity(self.links.len());
        for (link, &error) in self.links.iter().zip(errors) {
            if open(error) { wave.push_back((*link, error.1)) } else { kept.push(*link) }
        }
        self.links = kept;
        let mut refined = Refined::default();
        while !wave.is_empty() {
            let held = self.links.len() + wave.len();
            let most = self.max_links.saturating_sub(held) / MORE;
            refined.full = most == 0;
            if refined.full || (refined.replaced > 0 && stop(held + self.elements.len())) {
                break;
            }
            let slice = if once { SHORT_SLICE } else { SLICE };
            let slice: Vec<_> = wave.drain(..slice.min(most).min(wave.len())).collect();
            refined.replaced += slice.len();
            let pairs = self.parts(&slice);
            let made = self.measure(&pairs, threshold, self.seed);
            let scale = 1.0 / self.scale as f32;
            let judged: Vec<(f32, Split)> = made
                .par_iter()
                .with_min_len(1024)
                .map(|l| judge(&self.elements, l, &self.light, self.oracle))
                .collect();
            for (link, (error, split)) in made.into_iter().zip(judged) {
                if !once && open((error * scale, split)) {
                    wave.push_back((link, split));
                } else {
                    self.links.push(link);
                }
            }
        }
        self.links.extend(wave.into_iter().map(|(link, _)| link));
        refined
    }

    /// The pairs that replace links; ends are split as needed.
    fn parts(&mut self, wave: &[(Link, Split)]) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for (link, split) in wave {
            let (end, other) = if *split == Split::A { (link.a, link.b) } else { (link.b, link.a) };
            self.open(end);
            let children = self.elements.elements[end as usize].child_range();
            if link.a != link.b {
                let known = Pair {
                    mixed: link.mixed(),
                    between: link.between,
                    hidden: link.transmittance == 0.0,
                    ..Pair::new(0, other)
                };
                pairs.extend(children.map(|c| Pair { a: c as u32, ..known }));
                continue;
            }
            for c in children.clone() {
                if self.elements.elements[c].is_cluster() {
                    pairs.push(Pair::new(c as u32, c as u32));
                }
                pairs.extend((c + 1..children.end).map(|d| Pair::new(c as u32, d as u32)));
            }
        }
        pairs
    }

    /// Gives an element children that send out what it does.
    pub(super) fn open(&mut self, element: u32) {
        let before = self.elements.len();
        self.elements.split(element);
        for _ in before..self.elements.len() {
            let e = element as usize;
            self.radiosity.push(self.radiosity[e]);
            self.incident.push(self.incident[e]);
            self.closure.push(self.closure[e]);
            if let Some(&importance) = self.importance.get(e) {
                self.importance.push(importance);
            }
            self.feature_sizes.push(self.size_of(self.feature_sizes.len()));
            let light = self.light[e];
            self.light.push(Light { deviation: 0.5 * light.deviation, ..light });
        }
    }

    /// Measures pairs, in their order; those that exchange nothing are left out.
    fn measure(&mut self, pairs: &[Pair], threshold: f32, seed: u64) -> Vec<Link> {
        let meter = Meter { sight: &self.sight_for(pairs, threshold), seed, ..self.meter() };
        let made: Vec<(Vec<Link>, Tally)> = pairs
            .par_chunks(CHUNK)
            .map_init(Scratch::default, |scratch, chunk| {
                scratch.tally = Tally::default();
                let (own, others): (Vec<Pair>, Vec<Pair>) = chunk.iter().partition(|p| p.a == p.b);
                let asked: Vec<_> =
                    others.iter().map(|pair| ([pair.a, pair.b], self.care(pair, threshold))).collect();
                let mut links = meter.measure_all(&asked, scratch);
                links.extend(own.iter().map(|pair| self.inside(pair.a)));
                (links, scratch.tally)
            })
            .collect();
        let mut links = Vec::with_capacity(pairs.len());
        for (part, tally) in made {
            links.extend(part);
            self.tally.add(tally);
        }
        links
    }

    /// Measures all links anew, but those that are certain, with samples of their own. Which links are kept
    /// depends on what was seen of them: the same samples' values are too large where most is seen, and too small where
    /// little is. Those whose turn has not come when it is late stay as they are.
    pub(super) fn look_again(&mut self, threshold: f32, clock: &Clock) {
        let (certain, doubtful): (Vec<Link>, Vec<Link>) = std::mem::take(&mut self.links)
            .into_iter()
            .partition(|l| l.between == Between::NOTHING || l.a == l.b);
        let again = |l: &Link| Pair { mixed: l.mixed(), between: l.between, ..Pair::new(l.a, l.b) };
        let closing = self.closing * (certain.len() + doubtful.len() + self.elements.len()) as f64;
        self.links = certain;
        for slice in doubtful.chunks(SLICE) {
            if clock.left() <= closing {
                self.links.extend(slice);
                continue;
            }
            let pairs: Vec<Pair> = slice.iter().map(again).collect();
            let made = self.measure(&pairs, threshold, mix(self.seed));
            self.links.extend(made);
        }
    }

    /// The engine for a wave of pairs: exact rays where multi-resolution visibility is not likely to take less time for
    /// them, by a sample of the wave.
    fn sight_for(&self, pairs: &[Pair], threshold: f32) -> Sight {
        let meter = self.meter();
        let step = (pairs.len() / RUNS).max(8 * RUN);
        let sample = pairs.chunks(step).flat_map(|part| &part[..RUN.min(part.len())]);
        let questions: Vec<Question> = sample
            .filter(|pair| pair.a != pair.b)
            .filter_map(|pair| Some(meter.draft(pair.a, pair.b, self.care(pair, threshold))?.1))
            .collect();
        self.sight.for_these(&questions, &mut Scratch::default())
    }

    /// The link of a cluster with itself: what the probe found.
    fn inside(&self, cluster: u32) -> Link {
        let area = self.elements.elements[cluster as usize].area as f32;
        let coupling = self.probe.enclosed[cluster as usize] * area;
        Link {
            a: cluster,
            b: cluster,
            coupling,
            transmittance: 1.0,
            variation: [coupling; 2],
            noise: 0.3 * coupling,
            rays: 0,
            between: Between::SOMETHING,
        }
    }

    /// How much an error of the coupling of two elements matters.
    fn care(&self, &Pair { a, b, mixed, between, hidden }: &Pair, threshold: f32) -> Care {
        let worth = |receiver: u32, source: u32| {
            let e = &self.elements.elements[receiver as usize];
            let (l, from) = (self.light[receiver as usize], self.light[source as usize]);
            let of_area = (e.area / self.elements.area).sqrt() / e.area.max(f64::MIN_POSITIVE);
            f64::from(l.weight) * f64::from(from.mean + from.deviation) * of_area
        };
        let tolerated = f64::from(threshold) * self.scale;
        let (at_a, at_b) = (worth(a, b), worth(b, a));
        let first_receives = at_a >= at_b;
        let receiver = if first_receives { a } else { b };
        let feature_size = self.feature_sizes[receiver as usize];
        Care {
            worth: (at_a.max(at_b) / tolerated) as f32,
            feature_size,
            mixed,
            between,
            hidden,
            first_receives,
        }
    }

    /// What the oracle must know of every element's light, from the present solution.
    pub(super) fn look(&mut self) {
        let n = self.elements.len();
        let mut light = vec![Light::default(); n];
        let mut squares = vec![0.0f64; n];
        for e in (0..n).rev() {
            let element = &self.elements.elements[e];
            let mean = super::mean(self.radiosity[e]);
            let weight = match element.shape {
                Shape::Cluster(c) => self.elements.clusters[c as usize].reflectance,
                Shape::Surface { side, .. } => {
                    self.elements.sides[side as usize].reflectance.iter().sum::<f32>() / 3.0
                }
            };
            let weight = weight.max(LEAST_WEIGHT) * self.importance.get(e).copied().unwrap_or(1.0);
            if element.is_leaf() {
                squares[e] = mean * mean;
            } else {
                let parts = element.child_range();
                let sum: f64 = parts.map(|c| self.elements.elements[c].area * squares[c]).sum();
                squares[e] = sum / element.area.max(f64::MIN_POSITIVE);
            }
            let deviation = (squares[e] - mean * mean).max(0.0).sqrt();
            light[e] = Light { mean: mean as f32, deviation: deviation as f32, weight };
        }
        self.light = light;
    }
}

/// Dark surfaces count as if they reflected this much: their irradiance is an output too.
const LEAST_WEIGHT: f32 = 0.1;
