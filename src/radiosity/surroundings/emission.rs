//! The fraction of the emitted light that meets surfaces: rays from the emitters, drawn by the cosine or by their profiles of directions.

use super::side_rays::{ESCAPED, SideRays};
use crate::math::parallel;
use crate::math::sampling::{cosine_direction, mix, numbers, point_on};
use crate::radiosity::elements::{Elements, Side, emission_gain};
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::ray::LANES;
use crate::visibility::Exact;
use glam::Vec3;
use sobol_burley::sample_4d;

/// Packets of sixteen rays, which all sides share by power: 131,072 rays leave a standard error of at most 1 / (2 · 362) = 0.14 %
/// of the power, and less as they are evenly spread.
const PACKETS: usize = 1 << 13;
/// Directions, over all packets, at which profiles are read: 2²² readings of 0.1 µs take 0.4 s on one thread.
const PROFILE_EVALUATIONS: usize = 1 << 22;
/// Largest number of directions along a side of a grid: a beam of 1° is 1/3,300 of the cosine distribution and holds about 20 of 256²
/// directions.
const MAX_GRID: usize = 256;

/// A share that rays have sampled.
#[derive(Clone, Copy, Debug, Default)]
pub struct SampledShare {
    /// By channel, in `[0, 1]`.
    pub share: Rgb,
    /// Of all channels together, in `[0, 1]`.
    pub mean: f64,
    /// Its standard error.
    pub error: f64,
}

/// The fraction of the emitted power that meets sides with elements; 0 without emitters. `length` exceeds the diagonal of the scene.
pub fn emitted_share(elements: &Elements, exact: &Exact, length: f32, seed: u64) -> SampledShare {
    let emitting = elements.sides.iter().filter(|side| side.exitance.iter().any(|&m| m > 0.0));
    let power = |side: &Side| elements.elements[side.element as usize].area * mean(side.exitance);
    let all: f64 = emitting.clone().map(power).sum();
    if all <= 0.0 {
        return SampledShare::default();
    }
    // Evenly spaced in the running sum of the power.
    let mut groups: Vec<(&Side, usize)> = Vec::new();
    let mut before = 0.0;
    for side in emitting {
        let places = |sum: f64| (sum / all * PACKETS as f64).round() as usize;
        let count = places(before + power(side)) - places(before);
        before += power(side);
        if count > 0 {
            groups.push((side, count));
        }
    }
    let grid = ((PROFILE_EVALUATIONS / groups.len()).isqrt()).min(MAX_GRID);
    let tracer = SideRays { elements, exact, length };
    let found: Vec<[usize; 2]> = parallel::map(0..groups.len(), |i| {
        let (side, count) = &groups[i];
        rays(&tracer, side, count * LANES, grid, mix(!seed ^ mix(i as u64)))
    });
    let [met, traced] = found.iter().fold([0, 0], |[a, b], [c, d]| [a + c, b + d]);
    let traced = traced.max(1) as f64;
    let mean_share = met as f64 / traced;
    // All rays represent the same power, averaged over the channels.
    let (mut sent, mut received) = ([0.0; 3], [0.0; 3]);
    for ((side, _), [met, traced]) in groups.iter().zip(&found) {
        let colour = side.exitance.map(|m| m / mean(side.exitance));
        add(&mut sent, *traced as f64, colour);
        add(&mut received, *met as f64, colour);
    }
    let share = |k: usize| if sent[k] > 0.0 { received[k] / sent[k] } else { mean_share };
    // Half a ray of either kind is added (Jeffreys): even if no traced ray leaves the scene, some light may leave it.
    let likely = (met as f64 + 0.5) / (traced + 1.0);
    let error = (likely * (1.0 - likely) / traced).sqrt();
    SampledShare { share: std::array::from_fn(share), mean: mean_share, error }
}

/// Rays of a side that meet sides with elements, and all its rays.
fn rays(tracer: &SideRays, side: &Side, count: usize, grid: usize, seed: u64) -> [usize; 2] {
    let corners = tracer.elements.corners(side);
    let directions = directions(side, count, grid, seed);
    let rays = directions.iter().enumerate().map(|(i, direction)| {
        let [u, v, ..] = spread(seed, i);
        ((point_on(corners, u, v), side.normal, side.end), *direction)
    });
    let mut met = 0;
    tracer.trace(rays, &mut Vec::new(), |found| met += usize::from(found.side < ESCAPED));
    [met, directions.len()]
}

/// Four numbers for a ray, from a low-discrepancy sequence of 65,536 rays for each seed.
fn spread(seed: u64, ray: usize) -> [f32; 4] {
    sample_4d((ray & 0xffff) as u32, 0, mix(seed ^ (ray >> 16) as u64) as u32)
}

/// Directions in proportion to a side's light; for a side with a profile they are evenly spaced in the running sum of the light over a
/// grid of cosine-weighted directions. None if none of these is lit.
fn directions(side: &Side, count: usize, grid: usize, seed: u64) -> Vec<Vec3> {
    if side.profile.is_none() {
        let direction = |k: usize| {
            let [.., u, v] = spread(seed, k);
            cosine_direction(side.normal, u, v)
        };
        return (0..count).map(direction).collect();
    }
    let candidate = |k: usize| {
        let [u, v, ..] = numbers(!seed, k as u64);
        let (column, row) = ((k % grid) as f32, (k / grid) as f32);
        cosine_direction(side.normal, (column + u) / grid as f32, (row + v) / grid as f32)
    };
    let gain = |k: usize| {
        let from = candidate(k);
        f64::from(emission_gain(side.profile.as_deref(), Vec3::ZERO, side.normal, from))
    };
    let gains: Vec<f64> = (0..grid * grid).map(gain).collect();
    let all: f64 = gains.iter().sum();
    let [start, ..] = numbers(seed, u64::MAX);
    let (mut directions, mut sum) = (Vec::with_capacity(count), 0.0);
    for (k, gain) in gains.iter().enumerate() {
        sum += gain;
        while directions.len() < count
            && (directions.len() as f64 + f64::from(start)) / count as f64 * all < sum
        {
            directions.push(candidate(k));
        }
    }
    directions
}
