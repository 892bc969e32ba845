//! Replaces links whose error is too large by links between parts of their ends.

use super::histogram::Histogram;
use super::link_measurement::{Pair, SLICE, measure};
use super::linked_scene::LinkedScene;
use crate::progress::Progress;
use crate::radiosity::links::{Link, Split, link_error};
use rayon::prelude::*;
use std::collections::VecDeque;

/// Links refined between two checks of the deadline in steps of limited time, where each link is refined once: the
/// first step has as many links. Changes results with a time limit only.
const SHORT_SLICE: usize = 64;
/// Additional links that replace one link, about: four parts instead of one whole.
const ADDED_LINKS: usize = 3;

/// Outcome of a refinement step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Replaced {
    /// Links that were replaced.
    pub links: usize,
    /// Whether the limit of links was reached.
    pub full: bool,
}

/// Errors of all links relative to the scene's mean irradiance, and the ends to split.
pub fn link_errors(linked: &LinkedScene) -> Vec<(f32, Split)> {
    let scale = 1.0 / linked.mean_irradiance as f32;
    linked
        .links
        .par_iter()
        .with_min_len(4096)
        .map(|l| {
            let (error, split) = link_error(&linked.elements, l, linked.settings.oracle);
            (error * scale, split)
        })
        .collect()
}

/// The error that at most `count` links exceed, no smaller than `min`.
pub fn threshold(errors: &[(f32, Split)], count: usize, min: f32) -> f32 {
    let open = errors.iter().filter(|(_, split)| *split != Split::Neither);
    Histogram::new(open.map(|(error, _)| *error)).threshold(count, min)
}

/// Refines all links with errors above a threshold and the links that replace them; with `once` not the latter. Between slices,
/// but not before the first, `stop` is asked with the number of links and elements. Each generation of links is a stage.
pub fn refine(
    linked: &mut LinkedScene,
    errors: &[(f32, Split)],
    threshold: f32,
    once: bool,
    stop: &dyn Fn(usize) -> bool,
    progress: &dyn Progress,
) -> Replaced {
    let open = |(error, split): (f32, Split)| error > threshold && split != Split::Neither;
    let mut wave: VecDeque<(Link, Split)> = VecDeque::new();
    let mut kept = Vec::with_capacity(linked.links.len());
    for (link, &error) in linked.links.iter().zip(errors) {
        if open(error) { wave.push_back((*link, error.1)) } else { kept.push(*link) }
    }
    linked.links = kept;
    let mut replaced = Replaced::default();
    // Links of the present generation that are not replaced yet.
    let mut generation = 0;
    while !wave.is_empty() {
        if generation == 0 {
            generation = wave.len();
            progress.stage(&format!("refining to {threshold:.0e}"), generation as u64);
        }
        let held = linked.links.len() + wave.len();
        let room = linked.settings.max_links.saturating_sub(held) / ADDED_LINKS;
        replaced.full = room == 0;
        if replaced.full || (replaced.links > 0 && stop(held + linked.elements.len())) {
            break;
        }
        let slice = if once { SHORT_SLICE } else { SLICE };
        let slice: Vec<_> = wave.drain(..slice.min(room).min(generation)).collect();
        generation -= slice.len();
        progress.advance(slice.len() as u64);
        replaced.links += slice.len();
        let pairs = parts(linked, &slice);
        let made = measure(linked, &pairs, threshold, linked.settings.seed);
        let scale = 1.0 / linked.mean_irradiance as f32;
        let errors: Vec<(f32, Split)> = made
            .par_iter()
            .with_min_len(1024)
            .map(|l| link_error(&linked.elements, l, linked.settings.oracle))
            .collect();
        for (link, (error, split)) in made.into_iter().zip(errors) {
            if !once && open((error * scale, split)) {
                wave.push_back((link, split));
            } else {
                linked.links.push(link);
            }
        }
    }
    linked.links.extend(wave.into_iter().map(|(link, _)| link));
    replaced
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
