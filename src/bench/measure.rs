//! Runs engines over a workload: times and visible fractions.
//!
//! The minimum of several times is smaller than a single time, so rows that are compared are run equally often. Rows
//! are run in turns, so that other load and clock changes affect all rows alike. Of each timed section the minimum
//! over its runs counts: other load only lengthens a section.

use super::workload::Workload;
use crate::math::parallel;
use crate::ray::{LANES, Occluder, Packet};
use crate::scene::Scene;
use crate::visibility::{Answer, Bundle, Cost, Exact, MultiResolution, Workspace, wilson};
use crate::{Error, Result};
use glam::Vec3;
use std::borrow::Cow;
use std::ops::Range;
use std::time::{Duration, Instant};

/// Largest number of pairs in a chunk: the clock is read once per 1,024 queries. Does not change results.
const MAX_CHUNK_PAIRS: usize = 1024;
/// Largest number of segments in a chunk; the segments of one pair are never separated. Limits a chunk to 2,048 packets
/// of 516 bytes, 1 MB.
const MAX_CHUNK_SEGMENTS: usize = 1 << 15;
/// Chunks per thread that are prepared together: limits prepared packets to 2 MB per thread.
const CHUNKS_PER_THREAD: usize = 2;

/// Visible fraction of each pair, and the time of the queries alone.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// Visible fractions, in the order of the pairs.
    pub visible: Vec<f32>,
    /// Wall time of each timed section, seconds; every run of the same queries has the same sections.
    pub sections: Vec<f64>,
}

/// A [`Run`] of the multi-resolution engine.
#[derive(Clone, Debug, Default)]
pub struct MrRun {
    /// Visible fractions and times.
    pub run: Run,
    /// Stated 95 % interval of each pair.
    pub intervals: Vec<(f32, f32)>,
    /// Total cost.
    pub cost: Cost,
}

impl MrRun {
    /// An MR result with the answers of exact rays, `rays` per pair.
    pub fn handed_over(run: Run, rays: usize) -> MrRun {
        let intervals = run.visible.iter().map(|&v| wilson(v, rays as f32)).collect();
        let segments = (run.visible.len() * rays) as u64;
        let cost = Cost { segments, exact_rays: segments, handed_over: segments, ..Cost::default() };
        MrRun { run, intervals, cost }
    }
}

/// Pairs of a workload, in the order of the queries.
#[derive(Clone, Copy)]
pub struct Queries<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Points and emitters.
    pub workload: &'a Workload,
    /// Indices into [`Workload::pairs`]; neighbours are adjacent.
    pub pairs: &'a [usize],
}

impl<'a> Queries<'a> {
    /// [`Workload::hull`] of a range of the pairs.
    fn hulls(&self, range: Range<usize>) -> Vec<Cow<'a, [Vec3]>> {
        self.pairs[range].iter().map(|&pair| self.workload.hull(pair)).collect()
    }

    /// The first `count` pairs.
    pub fn first(self, count: usize) -> Queries<'a> {
        Queries { pairs: &self.pairs[..count.min(self.pairs.len())], ..self }
    }
}

/// A chunk of pairs: its segments, made outside the timed section, and its answers.
struct Chunk<'a, T> {
    /// Range within the queries.
    pub pairs: Range<usize>,
    pub packets: Vec<Packet>,
    /// [`Workload::hull`] of each pair.
    pub hulls: Vec<Cow<'a, [Vec3]>>,
    pub answers: Vec<T>,
    pub workspace: Workspace,
}

/// Divides `count` queries into chunks.
pub(super) fn chunks(count: usize, rays: usize) -> Vec<Range<usize>> {
    let step = (MAX_CHUNK_SEGMENTS / rays.max(1)).clamp(1, MAX_CHUNK_PAIRS);
    (0..count).step_by(step).map(|first| first..(first + step).min(count)).collect()
}

impl<'a, T> Chunk<'a, T> {
    /// Makes the bundles of the chunk.
    fn prepare(&mut self, queries: Queries<'a>, rays: usize) {
        self.packets.clear();
        self.hulls = queries.hulls(self.pairs.clone());
        for &pair in &queries.pairs[self.pairs.clone()] {
            queries.workload.add_bundle(queries.scene, pair, rays, 0, &mut self.packets);
        }
    }
}

/// The bundles of a chunk, sorted by emitter so that neighbours share the upper part of their traversal, and the
/// index within the chunk of each bundle.
fn bundles<'a>(
    queries: Queries<'a>,
    chunk: Range<usize>,
    packets: &'a [Packet],
    hulls: &'a [Cow<[Vec3]>],
    rays: usize,
) -> (Vec<usize>, Vec<Bundle<'a>>) {
    let per_pair = rays.div_ceil(LANES);
    let pairs = &queries.pairs[chunk];
    let pair = |k: usize| &queries.workload.pairs[pairs[k]];
    let mut order: Vec<usize> = (0..pairs.len()).collect();
    order.sort_by_key(|&k| pair(k).emitter);
    let bundle = |&k: &usize| Bundle {
        packets: &packets[k * per_pair..(k + 1) * per_pair],
        emitter_size: pair(k).emitter_size,
        emitter: &hulls[k],
    };
    let bundles = order.iter().map(bundle).collect();
    (order, bundles)
}

/// Runs queries and measures their time, on one or several threads.
pub struct Timer {
    pool: Option<rayon::ThreadPool>,
}

impl Timer {
    /// A timer for queries on `threads` threads; one thread is the calling thread.
    ///
    /// # Errors
    /// The threads cannot be started.
    pub fn new(threads: usize) -> Result<Timer> {
        let pool = (threads > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(threads).build());
        let pool = pool.transpose().map_err(|e| Error::argument("threads", threads, e.to_string()))?;
        Ok(Timer { pool })
    }

    /// The results of `make` for ranges of up to `step` of `count` items, in order.
    pub(super) fn parts<T: Send>(
        &self,
        count: usize,
        step: usize,
        make: impl Fn(Range<usize>) -> T + Sync,
    ) -> Vec<T> {
        let ranges: Vec<Range<usize>> =
            (0..count).step_by(step).map(|first| first..(first + step).min(count)).collect();
        match &self.pool {
            None => ranges.into_iter().map(make).collect(),
            Some(pool) => parallel::install(pool, || parallel::map(&ranges, |range| make(range.clone()))),
        }
    }

    /// Exact visible fractions with `rays` segments per pair. `advance` gets the number of pairs that were answered.
    pub fn exact(&self, queries: Queries, engine: &Exact, rays: usize, advance: &dyn Fn(usize)) -> Run {
        let Queries { scene, workload, pairs } = queries;
        let mut visible = Vec::with_capacity(pairs.len());
        let sections = self.chunk_by_chunk(
            chunks(pairs.len(), rays),
            |chunk: &mut Chunk<u32>| {
                chunk.packets.clear();
                workload.pack(scene, &pairs[chunk.pairs.clone()], rays, 0, &mut chunk.packets);
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

    /// Visible fractions by MR with `rays` segments per pair at feature size `s`. `advance` gets the number of pairs that were answered.
    pub fn multi_resolution(
        &self,
        queries: Queries,
        engine: &MultiResolution,
        s: f32,
        rays: usize,
        advance: &dyn Fn(usize),
    ) -> MrRun {
        self.bundled(queries, rays, advance, |bundles, workspace, each| {
            engine.answers(bundles, s, workspace, each)
        })
    }

    /// Exact visible fractions with certificates, `rays` segments per pair.
    pub fn certified(
        &self,
        queries: Queries,
        engine: &MultiResolution,
        rays: usize,
        advance: &dyn Fn(usize),
    ) -> MrRun {
        self.bundled(queries, rays, advance, |bundles, workspace, each| {
            engine.certified(bundles, workspace, each)
        })
    }

    /// Answers bundles chunk by chunk, in order.
    fn bundled(
        &self,
        queries: Queries,
        rays: usize,
        advance: &dyn Fn(usize),
        ask: impl Fn(&[Bundle], &mut Workspace, &mut dyn FnMut(Answer)) + Sync,
    ) -> MrRun {
        let mut result = MrRun::default();
        result.run.sections = self.chunk_by_chunk(
            chunks(queries.pairs.len(), rays),
            |chunk: &mut Chunk<Option<Answer>>| chunk.prepare(queries, rays),
            |chunk| {
                let Chunk { pairs, packets, hulls, answers, workspace } = chunk;
                let (order, bundles) = bundles(queries, pairs.clone(), packets, hulls, rays);
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

    /// Prepares, answers and collects a few chunks at a time, in order; the time of each group of chunks, seconds.
    fn chunk_by_chunk<'q, T: Send>(
        &self,
        ranges: Vec<Range<usize>>,
        prepare: impl Fn(&mut Chunk<'q, T>) + Sync,
        ask: impl Fn(&mut Chunk<'q, T>) + Sync,
        mut collect: impl FnMut(&Chunk<'q, T>),
    ) -> Vec<f64> {
        let places = CHUNKS_PER_THREAD * self.pool.as_ref().map_or(1, |pool| pool.current_num_threads());
        let blank = || Chunk {
            pairs: 0..0,
            packets: Vec::new(),
            hulls: Vec::new(),
            answers: Vec::new(),
            workspace: Workspace::default(),
        };
        let mut chunks: Vec<Chunk<'q, T>> = (0..places).map(|_| blank()).collect();
        let mut seconds = Vec::new();
        for group in ranges.chunks(places) {
            let chunks = &mut chunks[..group.len()];
            chunks.iter_mut().zip(group).for_each(|(chunk, pairs)| chunk.pairs = pairs.clone());
            parallel::for_each_mut(chunks, |_, chunk| prepare(chunk));
            let start = Instant::now();
            match &self.pool {
                None => chunks.iter_mut().for_each(&ask),
                Some(pool) => {
                    parallel::install(pool, || parallel::for_each_mut(chunks, |_, chunk| ask(chunk)))
                }
            }
            seconds.push(start.elapsed().as_secs_f64());
            chunks.iter().for_each(&mut collect);
        }
        seconds
    }
}

/// Clear fraction of `count` lanes from lane `first` of packets without gaps.
pub(super) fn clear_fraction(blocked: &[u32], first: usize, count: usize) -> f32 {
    let stopped = (first..first + count).filter(|i| blocked[i / LANES] >> (i % LANES) & 1 == 1).count();
    1.0 - stopped as f32 / count as f32
}

/// Smallest number of runs of each row: the smaller of two times is without a single disturbance. Changes times only.
const MIN_ROUNDS: usize = 2;
/// Largest number of runs of each row: limits the time of a row to six times that of one run.
pub(super) const MAX_ROUNDS: usize = 6;
/// A round starts only if the rounds are expected to end within this time: limits the duration of a benchmark.
pub(super) const MAX_TIME: Duration = Duration::from_secs(10);

/// Pairs that are asked, untimed, before each timed row: one chunk, which loads the upper nodes of the tree into the caches.
pub(super) const WARM_UP_PAIRS: usize = 1024;

/// Minimum times of rows that were run equally often.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RowTimes {
    /// Time of each row, seconds, in order.
    pub seconds: Vec<f64>,
    /// Number of runs of each row.
    pub rounds: usize,
}

/// Runs `rows` rows in at most `max_rounds` rounds. `run` gets the index of the row and whether this is its first run; it
/// returns the times of the row's timed sections, seconds, always the same sections.
pub(super) fn rounds(
    max_rounds: usize,
    max_time: Duration,
    rows: usize,
    mut run: impl FnMut(usize, bool) -> Vec<f64>,
) -> RowTimes {
    let start = Instant::now();
    let goes_on = |rounds: usize| {
        let likely_end = start.elapsed().mul_f64((rounds + 1) as f64 / rounds as f64);
        rounds < max_rounds && (rounds < MIN_ROUNDS || likely_end < max_time)
    };
    let mut best: Vec<Vec<f64>> = (0..rows).map(|row| run(row, true)).collect();
    let mut rounds = 1;
    while goes_on(rounds) {
        for (row, best) in best.iter_mut().enumerate() {
            shorten(best, &run(row, false));
        }
        rounds += 1;
    }
    RowTimes { seconds: best.iter().map(|sections| sections.iter().sum()).collect(), rounds }
}

/// Takes the smaller time of each section.
fn shorten(best: &mut [f64], again: &[f64]) {
    best.iter_mut().zip(again).for_each(|(a, &b)| *a = a.min(b));
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

    #[test]
    fn rows_take_turns_and_are_run_equally_often() {
        let mut calls = Vec::new();
        let timed = rounds(MAX_ROUNDS, MAX_TIME, 3, |row, first| {
            calls.push((row, first));
            vec![1.0 + row as f64]
        });
        assert_eq!((timed.rounds, &timed.seconds[..]), (MAX_ROUNDS, &[1.0, 2.0, 3.0][..]));
        let turns: Vec<(usize, bool)> =
            (0..MAX_ROUNDS).flat_map(|round| (0..3).map(move |row| (row, round == 0))).collect();
        assert_eq!(calls, turns);
        assert!(rounds(MAX_ROUNDS, MAX_TIME, 0, |_, _| Vec::new()).seconds.is_empty());
    }

    /// A long row is run as often as a short one.
    #[test]
    fn long_rows_hold_short_ones_back() {
        let mut calls = [0, 0];
        let patience = Duration::from_millis(100);
        rounds(MAX_ROUNDS, patience, 2, |row, _| {
            calls[row] += 1;
            std::thread::sleep(if row == 0 { patience.mul_f64(0.4) } else { Duration::ZERO });
            vec![0.0]
        });
        assert_eq!(calls, [MIN_ROUNDS; 2]);
    }

    #[test]
    fn sections_keep_their_shorter_times() {
        let mut best = [1.0, 5.0, 2.0];
        shorten(&mut best, &[2.0, 1.0, 2.0]);
        assert_eq!(best, [1.0, 1.0, 2.0]);
    }
}
