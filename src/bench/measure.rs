//! Running the engines over a workload: seconds and visible fractions.

use super::workload::{Order, Workload};
use crate::ray::{LANES, Occluder, Packet};
use crate::scene::Scene;
use crate::visibility::{Answer, Bundle, Cost, Exact, MultiResolution, Workspace, wilson};
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

impl MrRun {
    /// The answers of exact rays, `rays` a pair, in the engine's place.
    pub fn handed_over(run: Run, rays: usize) -> MrRun {
        let intervals = run.visible.iter().map(|&v| wilson(v, rays as f32)).collect();
        let segments = (run.visible.len() * rays) as u64;
        let cost = Cost { segments, exact_rays: segments, handed_over: segments, ..Cost::default() };
        MrRun { run, intervals, cost }
    }
}

/// Pairs of a workload, in the order they are asked.
#[derive(Clone, Copy)]
pub struct Questions<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Points and emitters.
    pub workload: &'a Workload,
    /// Indices into [`Workload::pairs`]; neighbours together.
    pub pairs: &'a [usize],
}

impl<'a> Questions<'a> {
    /// The first `count` of them.
    pub fn first(self, count: usize) -> Questions<'a> {
        Questions { pairs: &self.pairs[..count.min(self.pairs.len())], ..self }
    }
}

/// What a chunk of pairs is asked, made outside the timed section, and what was answered.
#[derive(Default)]
pub(super) struct Chunk<T> {
    /// Which of the questions.
    pub pairs: Range<usize>,
    pub packets: Vec<Packet>,
    pub answers: Vec<T>,
    pub workspace: Workspace,
}

/// So many questions in chunks.
pub(super) fn chunks(count: usize, rays: usize) -> Vec<Range<usize>> {
    let step = (CHUNK_SEGMENTS / rays.max(1)).clamp(1, CHUNK);
    (0..count).step_by(step).map(|first| first..(first + step).min(count)).collect()
}

impl<T> Chunk<T> {
    /// Makes the bundles of the questions, of so many segments each.
    pub fn prepare(&mut self, questions: Questions, how: (usize, Order), stream: u64) {
        self.packets.clear();
        for &pair in &questions.pairs[self.pairs.clone()] {
            questions.workload.add_bundle(questions.scene, pair, how, stream, &mut self.packets);
        }
    }
}

/// The bundles of a chunk of questions emitter by emitter, so that neighbours share the upper part of their traversal,
/// and which question of the chunk each of them is.
pub(super) fn bundles<'a>(
    questions: Questions<'a>,
    chunk: Range<usize>,
    packets: &'a [Packet],
    rays: usize,
) -> (Vec<usize>, Vec<Bundle<'a>>) {
    let per_pair = rays.div_ceil(LANES);
    let pairs = &questions.pairs[chunk];
    let pair = |k: usize| &questions.workload.pairs[pairs[k]];
    let mut order: Vec<usize> = (0..pairs.len()).collect();
    order.sort_by_key(|&k| pair(k).emitter);
    let bundle = |&k: &usize| Bundle {
        packets: &packets[k * per_pair..(k + 1) * per_pair],
        emitter_size: pair(k).emitter_size,
        emitter: questions.workload.hull(pairs[k]),
    };
    let bundles = order.iter().map(bundle).collect();
    (order, bundles)
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
        let pool = pool.transpose().map_err(|e| Error::Argument(format!("threads {threads}: {e}")))?;
        Ok(Timer { pool })
    }

    /// Exact visible fractions with `rays` segments a pair. `advance` is told how many pairs are done.
    pub fn exact(&self, questions: Questions, engine: &Exact, rays: usize, advance: &dyn Fn(usize)) -> Run {
        let Questions { scene, workload, pairs } = questions;
        let mut visible = Vec::with_capacity(pairs.len());
        let sections = self.chunk_by_chunk(
            chunks(pairs.len(), rays),
            |chunk: &mut Chunk<u32>| {
                workload.packed(scene, &pairs[chunk.pairs.clone()], rays, 0, &mut chunk.packets);
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

    /// Visible fractions by the multi-resolution engine, `rays` segments a pair at feature size `s`. `advance` is
    /// told how many pairs are done.
    pub fn multi_resolution(
        &self,
        questions: Questions,
        engine: &MultiResolution,
        s: f32,
        rays: usize,
        advance: &dyn Fn(usize),
    ) -> MrRun {
        self.bundled(questions, rays, advance, |bundles, workspace, each| {
            engine.answers(bundles, s, workspace, each)
        })
    }

    /// Exact visible fractions with certificates, `rays` segments a pair.
    pub fn certified(
        &self,
        questions: Questions,
        engine: &MultiResolution,
        rays: usize,
        advance: &dyn Fn(usize),
    ) -> MrRun {
        self.bundled(questions, rays, advance, |bundles, workspace, each| {
            engine.certified(bundles, workspace, each)
        })
    }

    /// Asks chunk by chunk for the answers to bundles, in their order.
    fn bundled(
        &self,
        questions: Questions,
        rays: usize,
        advance: &dyn Fn(usize),
        ask: impl Fn(&[Bundle], &mut Workspace, &mut dyn FnMut(Answer)) + Sync,
    ) -> MrRun {
        let mut result = MrRun::default();
        result.run.sections = self.chunk_by_chunk(
            chunks(questions.pairs.len(), rays),
            |chunk: &mut Chunk<Option<Answer>>| chunk.prepare(questions, (rays, Order::Near), 0),
            |chunk| {
                let Chunk { pairs, packets, answers, workspace } = chunk;
                let (order, bundles) = bundles(questions, pairs.clone(), packets, rays);
                answers.clear();
                answers.resize(bundles.len(), None);
                let mut next = order.iter();
                ask(&bundles, workspace, &mut |answer| {
                    answers[*next.next().expect("an answer a bundle")] = Some(answer);
                });
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
    pub(super) fn chunk_by_chunk<T: Send>(
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

/// Clear part of `count` lanes from lane `first` of packets without gaps.
pub(super) fn clear_fraction(blocked: &[u32], first: usize, count: usize) -> f32 {
    let stopped = (first..first + count).filter(|i| blocked[i / LANES] >> (i % LANES) & 1 == 1).count();
    1.0 - stopped as f32 / count as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_cover_every_pair_once() {
        for (pairs, rays) in [(0, 16), (1, 1), (1000, 16), (1000, 256), (7, 65536), (300, 1000)] {
            let all: Vec<usize> = chunks(pairs, rays).into_iter().flatten().collect();
            assert_eq!(all, (0..pairs).collect::<Vec<_>>());
        }
    }

    #[test]
    fn fractions_are_read_across_packets() {
        let blocked = [0xffff_u32, 0x0003];
        assert_eq!(clear_fraction(&blocked, 0, 16), 0.0);
        assert_eq!(clear_fraction(&blocked, 16, 4), 0.5);
        assert!((clear_fraction(&blocked, 14, 6) - 2.0 / 6.0).abs() < 1e-6);
    }
}
