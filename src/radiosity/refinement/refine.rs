//! Replaces links whose error is too large by links between parts of their ends.

use super::link_measurement::{LINKS_PER_CHECK, Pair, measure};
use super::linked_scene::LinkedScene;
use super::sky_links::{measure_sky, sky_link_errors, sky_parts};
use crate::math::parallel;
use crate::progress::Progress;
use crate::radiosity::links::{Link, SkyLink, Split, link_error};
use std::collections::VecDeque;

/// Links refined between two checks of the deadline in steps of limited time, where each link is refined once: the
/// first step has as many links. Changes results with a time limit only.
const SHORT_SLICE: usize = 64;
/// Approximate number of links that are added when a link is replaced: four parts instead of one whole.
const ADDED_LINKS: usize = 3;

/// Result of a refinement step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StepResult {
    /// Links that were replaced.
    pub links: usize,
    /// Whether the limit of links was reached.
    pub full: bool,
}

/// Errors of links relative to the scene's mean irradiance, and the ends to split.
pub type LinkErrors = Vec<(f32, Split)>;

/// Errors of all links between elements.
pub fn link_errors(linked: &LinkedScene) -> LinkErrors {
    errors_of(linked, &linked.links)
}

fn errors_of(linked: &LinkedScene, links: &[Link]) -> LinkErrors {
    let scale = 1.0 / linked.mean_irradiance as f32;
    let error = |link: &Link| {
        let (error, split) = link_error(&linked.elements, link);
        (error * scale, split)
    };
    parallel::map(parallel::at_least(1024, links), error)
}

/// The error that at most `count` links exceed, no smaller than `min`.
pub fn threshold(errors: &[LinkErrors; 2], count: usize, min: f32) -> f32 {
    let open = errors.iter().flatten().filter(|(_, split)| *split != Split::Neither);
    Histogram::new(open.map(|(error, _)| *error)).threshold(count, min)
}

/// Refines all links with errors above a threshold and the links that replace them; with `once` only the former. `errors` are those of the
/// links between elements and of the links to the sky. Between slices, but not before the first, `stop` is called with the number of links
/// and elements. Each generation of links is a stage.
pub fn refine(
    linked: &mut LinkedScene,
    errors: &[LinkErrors; 2],
    threshold: f32,
    once: bool,
    stop: &dyn Fn(usize) -> bool,
    progress: &dyn Progress,
) -> StepResult {
    let open = |(error, split): (f32, Split)| error > threshold && split != Split::Neither;
    let mut wave = VecDeque::new();
    // Links to the sky come first: outdoors the sky is the source of all other light.
    for (link, &error) in std::mem::take(&mut linked.sky_links).into_iter().zip(&errors[1]) {
        if open(error) { wave.push_back(ToSplit::Sky(link, error.1)) } else { linked.sky_links.push(link) }
    }
    for (link, &error) in std::mem::take(&mut linked.links).into_iter().zip(&errors[0]) {
        if open(error) { wave.push_back(ToSplit::Between(link, error.1)) } else { linked.links.push(link) }
    }
    let mut replaced = StepResult::default();
    // Links of the present generation that are not replaced yet.
    let mut generation = 0;
    while !wave.is_empty() {
        if generation == 0 {
            generation = wave.len();
            progress.stage(&format!("refining to {threshold:.0e}"), generation as u64);
        }
        let held = linked.link_count() + wave.len();
        let room = linked.settings.max_links.saturating_sub(held) / ADDED_LINKS;
        replaced.full = room == 0;
        if replaced.full || (replaced.links > 0 && stop(held + linked.elements.len())) {
            break;
        }
        let slice = if once { SHORT_SLICE } else { LINKS_PER_CHECK };
        let slice = slice.min(room).min(generation);
        generation -= slice;
        progress.advance(slice as u64);
        replaced.links += slice;
        for made in replace(linked, wave.drain(..slice), threshold) {
            match made {
                ToSplit::Sky(_, split) | ToSplit::Between(_, split) if once || split == Split::Neither => {
                    made.keep(linked)
                }
                _ => wave.push_back(made),
            }
        }
    }
    wave.into_iter().for_each(|link| link.keep(linked));
    replaced
}

/// A link and the end to split; [`Split::Neither`] if its error is small enough.
enum ToSplit {
    Between(Link, Split),
    Sky(SkyLink, Split),
}

impl ToSplit {
    /// Puts the link among the others.
    fn keep(self, linked: &mut LinkedScene) {
        match self {
            ToSplit::Between(link, _) => linked.links.push(link),
            ToSplit::Sky(link, _) => linked.sky_links.push(link),
        }
    }
}

/// The links that replace a slice of others, with [`Split::Neither`] for those that need no refinement.
fn replace(linked: &mut LinkedScene, slice: impl Iterator<Item = ToSplit>, threshold: f32) -> Vec<ToSplit> {
    let (mut between, mut sky) = (Vec::new(), Vec::new());
    for link in slice {
        match link {
            ToSplit::Between(link, split) => between.push((link, split)),
            ToSplit::Sky(link, split) => sky.push((link, split)),
        }
    }
    let seed = linked.settings.seed;
    let pairs = parts(linked, &between);
    let between = measure(linked, &pairs, threshold, seed);
    let pairs = sky_parts(linked, &sky);
    let sky = measure_sky(linked, &pairs, threshold, seed);
    let end = |(error, split): (f32, Split)| if error > threshold { split } else { Split::Neither };
    let sky_errors = sky_link_errors(linked, &sky);
    let sky = sky.into_iter().zip(sky_errors).map(|(link, error)| ToSplit::Sky(link, end(error)));
    let errors = errors_of(linked, &between);
    let between = between.into_iter().zip(errors).map(|(link, error)| ToSplit::Between(link, end(error)));
    sky.chain(between).collect()
}

/// The pairs that replace links; ends are split as needed.
fn parts(linked: &mut LinkedScene, wave: &[(Link, Split)]) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for (link, split) in wave {
        let (end, other) = if *split == Split::A { (link.a, link.b) } else { (link.b, link.a) };
        linked.split(end);
        let children = linked.elements.elements[end as usize].child_range();
        if link.a != link.b {
            let known = Pair {
                deviation: link.transmittance_deviation(),
                certificate: link.certificate,
                blocked: link.transmittance == 0.0,
                ..Pair::new(0, other)
            };
            pairs.extend(children.map(|c| Pair { a: c as u32, ..known }));
            continue;
        }
        for c in children.clone() {
            if linked.elements.elements[c].is_cluster() {
                pairs.push(Pair::new(c as u32, c as u32));
            }
            pairs.extend((c + 1..children.end).map(|d| Pair::new(c as u32, d as u32)));
        }
    }
    pairs
}

/// Four bins an octave over errors from 2^-40 to 2^24.
const BINS: usize = 256;

/// Counts of links by the logarithm of their error.
struct Histogram {
    counts: [usize; BINS],
}

impl Histogram {
    /// The histogram of errors relative to the mean irradiance.
    pub fn new(errors: impl Iterator<Item = f32>) -> Histogram {
        let mut counts = [0; BINS];
        for e in errors {
            counts[bin(e)] += 1;
        }
        Histogram { counts }
    }

    /// The smallest error that at most `count` links exceed, not below `min`.
    pub fn threshold(&self, count: usize, min: f32) -> f32 {
        let mut sum = 0;
        for k in (0..BINS).rev() {
            sum += self.counts[k];
            if sum > count {
                // Counts include the whole bin, so that the threshold is its upper edge, except for the first bin: at least one bin is
                // refined.
                let edge = if sum == self.counts[k] { k } else { k + 1 };
                // Errors on the edge must exceed the threshold.
                return (lower(edge) * (1.0 - 1e-6)).max(min);
            }
        }
        min
    }
}

fn bin(error: f32) -> usize {
    if error.is_nan() || error <= 0.0 {
        0
    } else {
        ((error.log2() + 40.0) * 4.0).clamp(0.0, BINS as f32 - 1.0) as usize
    }
}

fn lower(bin: usize) -> f32 {
    (bin as f32 / 4.0 - 40.0).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_leave_as_many_as_asked() {
        let errors: Vec<f32> = (1..=1000).map(|i| i as f32 * 1e-3).collect();
        let histogram = Histogram::new(errors.iter().copied());
        for count in [10, 100, 400] {
            let threshold = histogram.threshold(count, 0.0);
            let above = errors.iter().filter(|&&e| e > threshold).count();
            // A bin is a fifth of its error wide.
            assert!(above <= count.max(170) && above > 0, "{count}: {above}");
        }
        assert_eq!(histogram.threshold(2000, 0.01), 0.01);
        assert!(histogram.threshold(1, 0.0) < 1.0, "one bin at least");
    }
}
