//! Running the engines over a workload: seconds, visible fractions, errors.

use super::workload::Workload;
use crate::ray::{LANES, Occluder, Packet};
use crate::scene::Scene;
use crate::visibility::{Bundle, Cost, Exact, MultiResolution, Workspace};
use rayon::prelude::*;
use std::time::Instant;

/// Pairs whose segments are made at once: small enough to stay in cache, large enough that a clock reading costs
/// nothing.
const CHUNK: usize = 128;

/// Visible fraction of each pair, and the seconds that the queries alone took.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// In the order of the pairs.
    pub visible: Vec<f32>,
    /// Wall time of the timed sections.
    pub seconds: f64,
}

/// A [`Run`] of the multi-resolution engine.
#[derive(Clone, Debug, Default)]
pub struct MrRun {
    /// Fractions and seconds.
    pub run: Run,
    /// Stated interval of each pair.
    pub intervals: Vec<(f32, f32)>,
    /// Summed cost.
    pub cost: Cost,
}

/// What a chunk of pairs is asked; made outside the timed section.
struct Chunk {
    pairs: std::ops::Range<usize>,
    packets: Vec<Packet>,
}

fn chunks(pairs: usize) -> Vec<std::ops::Range<usize>> {
    (0..pairs.div_ceil(CHUNK)).map(|c| c * CHUNK..((c + 1) * CHUNK).min(pairs)).collect()
}

/// Exact visible fractions with `rays` segments a pair. `advance` is told how many pairs are done.
pub fn exact(scene: &Scene, workload: &Workload, engine: Exact, rays: usize, advance: &dyn Fn(usize)) -> Run {
    let mut run = Run { visible: vec![0.0; workload.pairs.len()], seconds: 0.0 };
    let mut chunk = Chunk { pairs: 0..0, packets: Vec::new() };
    let mut blocked = Vec::new();
    for pairs in chunks(workload.pairs.len()) {
        chunk.pairs = pairs;
        workload.packed(scene, chunk.pairs.clone(), rays, 0, &mut chunk.packets);
        blocked.clear();
        blocked.resize(chunk.packets.len(), 0);
        let start = Instant::now();
        engine.occluded(&chunk.packets, &mut blocked);
        run.seconds += start.elapsed().as_secs_f64();
        for (k, pair) in chunk.pairs.clone().enumerate() {
            run.visible[pair] = clear_fraction(&blocked, k * rays, rays);
        }
        advance(chunk.pairs.len());
    }
    run
}

/// Clear part of `count` lanes from lane `first` of packets without gaps.
fn clear_fraction(blocked: &[u32], first: usize, count: usize) -> f32 {
    let stopped = (first..first + count).filter(|i| blocked[i / LANES] >> (i % LANES) & 1 == 1).count();
    1.0 - stopped as f32 / count as f32
}

/// Visible fractions by the multi-resolution engine with `rays` segments a pair at feature size `s`.
pub fn multi_resolution(
    scene: &Scene,
    workload: &Workload,
    engine: &MultiResolution,
    s: f32,
    rays: usize,
    advance: &dyn Fn(usize),
) -> MrRun {
    let mut result = MrRun::default();
    let mut workspace = Workspace::default();
    let per_pair = rays.div_ceil(LANES);
    let (mut packets, mut bundle) = (Vec::new(), Vec::new());
    for pairs in chunks(workload.pairs.len()) {
        packets.clear();
        for pair in pairs.clone() {
            workload.bundle(scene, pair, rays, 0, &mut bundle);
            packets.append(&mut bundle);
        }
        let count = pairs.len();
        let start = Instant::now();
        for (packets, pair) in packets.chunks(per_pair).zip(pairs) {
            let emitter_size = workload.pairs[pair].emitter_size;
            let answer = engine.answer(Bundle { packets, emitter_size }, s, &mut workspace);
            result.run.visible.push(answer.transmittance);
            result.intervals.push((answer.lo, answer.hi));
            result.cost.add(answer.cost);
        }
        result.run.seconds += start.elapsed().as_secs_f64();
        advance(count);
    }
    result
}

/// Two independent estimates of each pair's visible fraction, half of the rays each.
#[derive(Clone, Debug)]
pub struct Reference {
    /// From the first half.
    pub a: Vec<f32>,
    /// From the second half, with other samples.
    pub b: Vec<f32>,
    /// Rays of both halves together, a pair.
    pub rays: usize,
}

impl Reference {
    /// Traces `rays` segments a pair, on all threads, with samples of its own.
    pub fn trace(scene: &Scene, workload: &Workload, engine: Exact, rays: usize, advance: &(dyn Fn(usize) + Sync)) -> Reference {
        let half = rays.div_ceil(2);
        let estimate = |stream: u64| -> Vec<f32> {
            let parts: Vec<Vec<f32>> = chunks(workload.pairs.len())
                .into_par_iter()
                .map_init(
                    || (Vec::new(), Vec::new()),
                    |(packets, blocked), pairs| {
                        let visible = pairs.clone().map(|pair| {
                            workload.bundle(scene, pair, half, stream, packets);
                            blocked.clear();
                            blocked.resize(packets.len(), 0);
                            engine.occluded(packets, blocked);
                            clear_fraction(blocked, 0, half)
                        });
                        let visible = visible.collect();
                        advance(pairs.len());
                        visible
                    },
                )
                .collect();
            parts.concat()
        };
        Reference { a: estimate(1), b: estimate(2), rays: 2 * half }
    }

    /// Mean of both halves.
    pub fn mean(&self, pair: usize) -> f32 {
        0.5 * (self.a[pair] + self.b[pair])
    }

    /// Standard error of [`Reference::mean`], root mean square over the pairs: half the RMS difference of the halves.
    pub fn standard_error(&self) -> f64 {
        let sum: f64 = self.a.iter().zip(&self.b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        0.5 * (sum / self.a.len().max(1) as f64).sqrt()
    }

    /// RMS and bias of estimates against the truth.
    ///
    /// E[(x - a)(x - b)] = (x - truth)² because a and b err independently: the reference's noise drops out of
    /// the RMS without having to be known.
    pub fn errors(&self, visible: &[f32]) -> (f64, f64) {
        let n = visible.len().max(1) as f64;
        let (mut square, mut bias) = (0.0, 0.0);
        for ((&x, &a), &b) in visible.iter().zip(&self.a).zip(&self.b) {
            square += f64::from(x - a) * f64::from(x - b);
            bias += f64::from(x) - 0.5 * f64::from(a + b);
        }
        ((square / n).max(0.0).sqrt(), bias / n)
    }

    /// Part of the pairs whose reference lies in the stated interval, widened by two of its own standard errors.
    pub fn coverage(&self, intervals: &[(f32, f32)]) -> f64 {
        let n = self.rays as f32;
        let inside = intervals.iter().enumerate().filter(|&(pair, &(lo, hi))| {
            let p = self.mean(pair);
            let noise = 2.0 * (p * (1.0 - p) / n).sqrt();
            lo - noise <= p && p <= hi + noise
        });
        inside.count() as f64 / intervals.len().max(1) as f64
    }
}
