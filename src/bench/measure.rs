//! Running the engines over a workload: seconds, visible fractions, errors.

use super::workload::Workload;
use crate::ray::{LANES, Occluder, Packet};
use crate::scene::Scene;
use crate::visibility::{Answer, Bundle, Cost, Exact, MultiResolution, Workspace};
use crate::{Error, Result};
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// Pairs whose segments are made at once, at most: small enough to stay in cache, large enough that a clock reading
/// costs nothing.
const CHUNK: usize = 1024;
/// Segments of a chunk, at most (but those of one pair are always together).
const CHUNK_SEGMENTS: usize = 1 << 15;
/// Chunks whose segments are made at once, on all cores, for each thread that asks: few enough to stay in cache.
const AHEAD: usize = 2;

/// Visible fraction of each pair, and the seconds that the queries alone took.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// In the order of the pairs.
    pub visible: Vec<f32>,
    /// Wall time of each timed section, in their order: the same sections for every run of the same question.
    pub sections: Vec<f64>,
}

impl Run {
    /// Wall time of all timed sections.
    pub fn seconds(&self) -> f64 {
        self.sections.iter().sum()
    }

    /// Takes the shorter time of each section from another run of the same question: what else the machine does
    /// only ever makes a section longer, and rarely the same one twice.
    pub fn shorten(&mut self, other: &Run) {
        self.sections.iter_mut().zip(&other.sections).for_each(|(a, &b)| *a = a.min(b));
    }
}

/// A [`Run`] of the multi-resolution engine.
#[derive(Clone, Debug, Default)]
pub struct MrRun {
    /// Time of deciding whether the engine pays, seconds; not part of the sections.
    pub decide_s: f64,
    /// Fractions and seconds.
    pub run: Run,
    /// Stated interval of each pair.
    pub intervals: Vec<(f32, f32)>,
    /// Summed cost.
    pub cost: Cost,
}

/// What a chunk of pairs is asked, made outside the timed section, and what was answered.
#[derive(Default)]
struct Chunk<T> {
    pairs: Range<usize>,
    packets: Vec<Packet>,
    answers: Vec<T>,
    workspace: Workspace,
}

/// Pairs in the order they are asked.
fn chunks(pairs: Range<usize>, rays: usize) -> Vec<Range<usize>> {
    let step = (CHUNK_SEGMENTS / rays.max(1)).clamp(1, CHUNK);
    pairs.clone().step_by(step).map(|first| first..(first + step).min(pairs.end)).collect()
}

/// Asks engines and takes the time of the queries alone, on one thread or on several.
pub struct Timer {
    pool: Option<rayon::ThreadPool>,
}

impl Timer {
    /// A timer for queries on `threads` threads; with one thread it is the calling one.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub fn new(threads: usize) -> Result<Timer> {
        let pool = (threads > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(threads).build());
        let pool = pool.transpose().map_err(|e| Error::Argument(format!("--threads {threads}: {e}")))?;
        Ok(Timer { pool })
    }

    /// Exact visible fractions of a range of pairs with `rays` segments each. `advance` is told how many pairs are
    /// done.
    pub fn exact(
        &self,
        scene: &Scene,
        workload: &Workload,
        pairs: Range<usize>,
        engine: Exact,
        rays: usize,
        advance: &dyn Fn(usize),
    ) -> Run {
        let mut visible = Vec::with_capacity(pairs.len());
        let sections = self.chunk_by_chunk(
            chunks(pairs, rays),
            |chunk: &mut Chunk<u32>| {
                workload.packed(scene, chunk.pairs.clone(), rays, 0, &mut chunk.packets);
                chunk.answers.clear();
                chunk.answers.resize(chunk.packets.len(), 0);
            },
            |chunk| engine.occluded(&chunk.packets, &mut chunk.answers),
            |chunk| {
                visible
                    .extend((0..chunk.pairs.len()).map(|k| clear_fraction(&chunk.answers, k * rays, rays)));
                advance(chunk.pairs.len());
            },
        );
        Run { visible, sections }
    }

    /// Visible fractions of a range of pairs by the multi-resolution engine, `rays` segments each at feature size
    /// `s`. Where a sample of the bundles says that it cannot pay, all are handed to Embree. `advance` is told how many pairs are done.
    #[allow(clippy::too_many_arguments)] // The question, the engine and its two parameters.
    pub fn multi_resolution(
        &self,
        scene: &Scene,
        workload: &Workload,
        pairs: Range<usize>,
        engine: &MultiResolution,
        s: f32,
        rays: usize,
        advance: &dyn Fn(usize),
    ) -> MrRun {
        let per_pair = rays.div_ceil(LANES);
        let start = Instant::now();
        let pays = pays(scene, workload, engine, s, rays);
        let mut result = MrRun { decide_s: start.elapsed().as_secs_f64(), ..MrRun::default() };
        result.run.sections = self.chunk_by_chunk(
            chunks(pairs, rays),
            |chunk: &mut Chunk<Option<Answer>>| {
                chunk.packets.clear();
                for pair in chunk.pairs.clone() {
                    workload.add_bundle(scene, pair, rays, 0, &mut chunk.packets);
                }
            },
            |chunk| {
                let Chunk { pairs, packets, answers, workspace } = chunk;
                let bundle = |pair: usize| {
                    let first = (pair - pairs.start) * per_pair;
                    Bundle {
                        packets: &packets[first..first + per_pair],
                        emitter_size: workload.pairs[pair].emitter_size,
                    }
                };
                answers.clear();
                if pays {
                    // Emitter by emitter: neighbours share the upper part of their traversal.
                    let mut order: Vec<usize> = pairs.clone().collect();
                    order.sort_by_key(|&pair| workload.pairs[pair].emitter);
                    let bundles: Vec<Bundle> = order.iter().map(|&pair| bundle(pair)).collect();
                    answers.resize(bundles.len(), None);
                    let mut next = order.iter();
                    engine.answers(&bundles, s, workspace, |answer| {
                        let pair = next.next().expect("an answer a bundle");
                        answers[pair - pairs.start] = Some(answer);
                    });
                } else {
                    answers.extend(pairs.clone().map(|pair| Some(engine.hand_over(bundle(pair), workspace))));
                }
            },
            |chunk| {
                for answer in chunk.answers.iter().flatten() {
                    result.run.visible.push(answer.transmittance);
                    result.intervals.push((answer.lo, answer.hi));
                    result.cost.add(answer.cost);
                }
                advance(chunk.pairs.len());
            },
        );
        result
    }

    /// Prepares, asks and collects a few chunks at a time, in their order; the seconds of each asking.
    fn chunk_by_chunk<T: Send>(
        &self,
        ranges: Vec<Range<usize>>,
        prepare: impl Fn(&mut Chunk<T>) + Sync,
        ask: impl Fn(&mut Chunk<T>) + Sync,
        mut collect: impl FnMut(&Chunk<T>),
    ) -> Vec<f64> {
        let places = AHEAD * self.pool.as_ref().map_or(1, |pool| pool.current_num_threads());
        let blank = || Chunk {
            pairs: 0..0,
            packets: Vec::new(),
            answers: Vec::new(),
            workspace: Workspace::default(),
        };
        let mut chunks: Vec<Chunk<T>> = (0..places).map(|_| blank()).collect();
        let mut seconds = Vec::new();
        for group in ranges.chunks(places) {
            let chunks = &mut chunks[..group.len()];
            chunks.iter_mut().zip(group).for_each(|(chunk, pairs)| chunk.pairs = pairs.clone());
            chunks.par_iter_mut().with_max_len(1).for_each(&prepare);
            let start = Instant::now();
            match &self.pool {
                None => chunks.iter_mut().for_each(&ask),
                Some(pool) => pool.install(|| chunks.par_iter_mut().with_max_len(1).for_each(&ask)),
            }
            seconds.push(start.elapsed().as_secs_f64());
            chunks.iter().for_each(&mut collect);
        }
        seconds
    }
}

/// Segments of runs of neighbouring pairs, spread evenly over a workload; what a sample is to decide on.
pub struct Sample {
    packets: Vec<Packet>,
    /// Packets and emitter size of each pair, run by run.
    runs: Vec<Vec<(Range<usize>, f32)>>,
}

impl Sample {
    /// Runs and pairs of each.
    const SHAPE: (usize, usize) = (16, 16);

    /// `rays` segments of each pair.
    pub fn of(scene: &Scene, workload: &Workload, rays: usize) -> Sample {
        let mut sample = Sample { packets: Vec::new(), runs: Vec::new() };
        let pairs = workload.pairs.len();
        let length = (Self::SHAPE.1 * scene.emitters.len()).min(pairs);
        let runs = Self::SHAPE.0.min(pairs / length.max(1));
        for k in 0..runs {
            let first = (pairs - length) * k / (runs - 1).max(1);
            let range = first..first + length;
            // The run is that of one emitter, as the engine is asked.
            let emitter = workload.pairs[first].emitter;
            let mut run = Vec::new();
            for pair in range.filter(|&pair| workload.pairs[pair].emitter == emitter) {
                let first = sample.packets.len();
                workload.add_bundle(scene, pair, rays, 0, &mut sample.packets);
                run.push((first..sample.packets.len(), workload.pairs[pair].emitter_size));
            }
            sample.runs.push(run);
        }
        sample
    }

    /// The bundles, run by run.
    pub fn bundles(&self) -> Vec<Vec<Bundle<'_>>> {
        let bundle = |(range, emitter_size): &(Range<usize>, f32)| Bundle {
            packets: &self.packets[range.clone()],
            emitter_size: *emitter_size,
        };
        self.runs.iter().map(|run| run.iter().map(bundle).collect()).collect()
    }
}

/// Whether the engine pays on a sample of the workload.
fn pays(scene: &Scene, workload: &Workload, engine: &MultiResolution, s: f32, rays: usize) -> bool {
    let sample = Sample::of(scene, workload, rays);
    let runs = sample.bundles();
    engine.pays(runs.iter().map(Vec::as_slice), s, &mut Workspace::default())
}

/// Clear part of `count` lanes from lane `first` of packets without gaps.
fn clear_fraction(blocked: &[u32], first: usize, count: usize) -> f32 {
    let stopped = (first..first + count).filter(|i| blocked[i / LANES] >> (i % LANES) & 1 == 1).count();
    1.0 - stopped as f32 / count as f32
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
    /// Traces `rays` segments a pair, on all threads, with samples of its own. `advance` is told how many pairs are
    /// done with one of the two halves.
    pub fn trace(
        scene: &Scene,
        workload: &Workload,
        engine: Exact,
        rays: usize,
        advance: &(dyn Fn(usize) + Sync),
    ) -> Reference {
        let half = rays.div_ceil(2);
        let estimate = |stream: u64| -> Vec<f32> {
            let parts: Vec<Vec<f32>> = chunks(0..workload.pairs.len(), half)
                .into_par_iter()
                .map_init(
                    || (Vec::new(), Vec::new()),
                    |(packets, blocked), pairs| {
                        workload.packed(scene, pairs.clone(), half, stream, packets);
                        blocked.clear();
                        blocked.resize(packets.len(), 0);
                        engine.occluded(packets, blocked);
                        advance(pairs.len());
                        (0..pairs.len()).map(|k| clear_fraction(blocked, k * half, half)).collect()
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
        /// An interval that ends a bit or two short of 1 still holds 1.
        const ROUNDING: f32 = 1e-6;
        let n = self.rays as f32;
        let inside = intervals.iter().enumerate().filter(|&(pair, &(lo, hi))| {
            let p = self.mean(pair);
            let noise = 2.0 * (p * (1.0 - p) / n).sqrt() + ROUNDING;
            lo - noise <= p && p <= hi + noise
        });
        inside.count() as f64 / intervals.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_cover_every_pair_once() {
        for (pairs, rays) in [(0, 16), (1, 1), (1000, 16), (1000, 256), (7, 65536), (300, 1000)] {
            let all: Vec<usize> = chunks(0..pairs, rays).into_iter().flatten().collect();
            assert_eq!(all, (0..pairs).collect::<Vec<_>>());
        }
    }

    #[test]
    fn sections_keep_their_shorter_times() {
        let mut run = Run { visible: vec![], sections: vec![1.0, 5.0, 2.0] };
        run.shorten(&Run { visible: vec![], sections: vec![2.0, 1.0, 2.0] });
        assert_eq!(run.seconds(), 4.0);
    }

    #[test]
    fn fractions_are_read_across_packets() {
        let blocked = [0xffff_u32, 0x0003];
        assert_eq!(clear_fraction(&blocked, 0, 16), 0.0);
        assert_eq!(clear_fraction(&blocked, 16, 4), 0.5);
        assert!((clear_fraction(&blocked, 14, 6) - 2.0 / 6.0).abs() < 1e-6);
    }

    #[test]
    fn the_noise_of_the_reference_drops_out() {
        let reference = Reference { a: vec![0.6, 0.4], b: vec![0.4, 0.6], rays: 2000 };
        assert!((reference.errors(&[0.7, 0.7]).0.powi(2) - 0.03).abs() < 1e-6);
        assert!((reference.errors(&[0.7, 0.7]).1 - 0.2).abs() < 1e-6);
        assert!((reference.standard_error() - 0.1).abs() < 1e-6);
        assert_eq!(reference.coverage(&[(0.4, 0.6), (0.0, 0.0)]), 0.5);
    }
}
