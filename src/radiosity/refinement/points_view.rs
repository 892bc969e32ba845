//! Importance for points: what an error of an element's light counts at the points that are asked for.

use super::linked_scene::LinkedScene;
use crate::math::sampling::{cosine_direction, mix, numbers};
use crate::radiosity::elements::Elements;
use crate::radiosity::surroundings::SideRays;
use crate::ray::EndRule;
use crate::scene::magnitude;
use crate::visibility::Exact;
use glam::Vec3;
use rayon::prelude::*;

/// Paths from all points together: importance is known to 1/√16 = 25 % where a thousandth of them ends.
const PATHS: usize = 1 << 14;
/// Rays of a path: later ones count (reflectance)³ at most.
const BOUNCES: usize = 3;
/// Smallest number of ends in a cluster or on a side by which its own importance is known; others have that of what holds them.
const MIN_ENDS: u32 = 16;
/// Largest importance by points relative to the mean. With the part that is the same everywhere it is 8.5 at most: elements are at most √8.5 = 2.9 times
/// smaller than without it.
const MAX_IMPORTANCE: f64 = 16.0;
/// Part of importance that is the same everywhere: light comes to what points see from elsewhere, and the balance of all energy needs a right exchange
/// in rooms that no point sees. Rays of those are halved at most.
const EVERYWHERE: f64 = 0.5;
/// Points of one parallel task.
const CHUNK: usize = 16;

/// Where a path ended, and the part of the light that is sent there which reaches its point.
struct PathEnd {
    side: u32,
    share: f64,
    /// Whether it is the first end of its path.
    first: bool,
}

impl LinkedScene {
    /// Sets importance by what points (relative to the origin of the scene; position, unit normal) see, at once and by reflection: light reaches a
    /// point along the same paths that start from it. Its mean by area is about 1.
    pub fn look_from(&mut self, points: &[(Vec3, Vec3)], exact: &Exact) {
        let ends = self.paths_from(points, exact);
        let Elements { elements, sides, .. } = &self.elements;
        let mut sums = vec![(0.0, 0u32); elements.len()];
        for end in &ends {
            let (sum, count) = &mut sums[sides[end.side as usize].element as usize];
            (*sum, *count) = (*sum + end.share, *count + 1);
        }
        for e in (1..elements.len()).rev() {
            let (own, parent) = (sums[e], elements[e].parent as usize);
            sums[parent] = (sums[parent].0 + own.0, sums[parent].1 + own.1);
        }
        let mean = sums[0].0 / elements[0].area;
        if mean <= 0.0 {
            return;
        }
        let paths = paths_of_point(points.len()) * points.len().min(PATHS);
        let first: f64 = ends.iter().filter(|end| end.first).map(|end| end.share).sum();
        self.reflected_at_points = Some(first / paths as f64);
        let mut importance = vec![1.0; elements.len()];
        for e in 0..elements.len() {
            let (sum, count) = sums[e];
            importance[e] = match count >= MIN_ENDS && elements[e].area > 0.0 {
                true => (sum / elements[e].area / mean).min(MAX_IMPORTANCE),
                false => importance[elements[e].parent as usize],
            };
        }
        for (state, importance) in self.elements.states.iter_mut().zip(importance) {
            state.importance = (EVERYWHERE + (1.0 - EVERYWHERE) * importance) as f32;
        }
    }

    /// The ends of paths from points.
    fn paths_from(&self, points: &[(Vec3, Vec3)], exact: &Exact) -> Vec<PathEnd> {
        let Elements { sides, .. } = &self.elements;
        let tracer = SideRays { elements: &self.elements, exact, length: self.surroundings.length };
        let each = paths_of_point(points.len());
        let step = points.len().div_ceil(PATHS).max(1);
        let chosen: Vec<(usize, &(Vec3, Vec3))> = points.iter().enumerate().step_by(step).collect();
        let of_chunk = |chunk: &[(usize, &(Vec3, Vec3))]| {
            let (mut packets, mut ends) = (Vec::new(), Vec::new());
            let start = |&(i, &(at, normal)): &(usize, &(Vec3, Vec3))| {
                let end = EndRule::new(magnitude([at]));
                (0..each)
                    .map(move |k| ((at, normal, end), 1.0, mix(self.settings.seed ^ i as u64) ^ k as u64))
            };
            let mut paths: Vec<_> = chunk.iter().flat_map(start).collect();
            for bounce in 0..BOUNCES {
                let rays = paths.iter().map(|&(from, _, seed)| {
                    let [p, q, ..] = numbers(mix(seed), bounce as u64);
                    (from, cosine_direction(from.1, p, q))
                });
                let (mut next, mut k) = (Vec::new(), 0);
                tracer.trace(rays, &mut packets, |met| {
                    let (_, share, seed) = paths[k];
                    k += 1;
                    let Some(side) = sides.get(met.side as usize) else { return };
                    let share = share * f64::from(side.reflectance.iter().sum::<f32>()) / 3.0;
                    ends.push(PathEnd { side: met.side, share, first: bounce == 0 });
                    next.push(((met.at, side.normal, side.end), share, seed));
                });
                paths = next;
            }
            ends
        };
        let made: Vec<Vec<PathEnd>> = chosen.par_chunks(CHUNK).map(of_chunk).collect();
        made.into_iter().flatten().collect()
    }
}

/// Paths from each of so many points.
fn paths_of_point(points: usize) -> usize {
    PATHS.div_ceil(points.max(1))
}
