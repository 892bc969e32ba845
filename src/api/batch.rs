//! Answers to batches: bundles in chunks, chunks in parallel, segments in packets. No memory is allocated once buffers are large enough.

use super::segments::{Answers, Segments};
use super::visibility::{BatchEngine, Visibility};
use crate::math::parallel;
use crate::model::Model;
use crate::progress::Progress;
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::{
    Answer, BatchBuffers, Bundle, Cost, Exact, Method, MultiResolution, Work, Workspace, sample_runs, wilson,
};
use crate::{Error, Result};
use glam::DVec3;
use smallvec::SmallVec;
use std::ops::Range;

/// Largest numbers of bundles and of segments of a chunk: limits it to 1,024 packets and four groups of bundles that share their
/// traversal. Larger bundles are answered in parts of this number of segments. It is the same for any number of threads, so that the
/// answers are too.
const CHUNK: (usize, usize) = (256, 1 << 14);
/// Largest batch that is answered without deciding between engines: the decision walks 16 bundles, a quarter of the batch.
const MAX_UNDECIDED_SEGMENTS: usize = 64;

impl Visibility {
    /// Answers a batch into the caller's arrays; returns its cost. The answers do not depend on the number of threads. A model with
    /// one thread answers on the caller's, any other on its own. Buffers are kept for the next batch. See [`Segments`] for the frame of
    /// positions.
    ///
    /// # Errors
    /// [`Error::Argument`], which names array and index, if lengths do not match, offsets do not ascend, a position is not finite, a
    /// segment has no length, or a size is out of its range; if the engine needs feature sizes or optics that are missing. `answers` are
    /// then as they were. [`Error::Cancelled`] if the progress of [`Model::with_progress`] stops it, which is told of one stage with a
    /// step a bundle: some of the `answers` are then written.
    pub fn answer_into(&self, segments: &Segments, answers: &mut Answers) -> Result<Cost> {
        match self.model.has_one_thread() {
            true => self.answer_batch(segments, answers, false),
            false => self.model.on_threads(|| self.answer_batch(segments, answers, true))?,
        }
    }

    /// `parallel`: whether parts are answered in parallel.
    fn answer_batch(&self, segments: &Segments, answers: &mut Answers, parallel: bool) -> Result<Cost> {
        let progress = self.model.progress();
        let shift = segments.shift(self.model.scene().origin);
        segments.check(shift, parallel)?;
        answers.check(segments.bundle_count(), segments.origins.len())?;
        let ask = CheckedBatch { segments, shift, model: &self.model, progress, parallel };
        let engine = match self.chosen(segments.feature_sizes.is_some())? {
            BatchEngine::Either(engine) if ask.pays(&engine) => BatchEngine::Clusters(engine),
            BatchEngine::Either(_) => BatchEngine::Exact(self.model.exact()),
            engine => engine,
        };
        let bundles = segments.bundle_count();
        if bundles == 0 {
            return Ok(Cost::default());
        }
        progress.stage("visibility", bundles as u64);
        let cost = ask.answer(&engine, Chunk::new(answers, bundles));
        cost.ok_or_else(|| Error::Cancelled("stopped before all segments were answered".into()))
    }
}

/// A range of bundles and the output slices of their answers.
struct Chunk<'a> {
    bundles: Range<usize>,
    transmittance: &'a mut [f32],
    lo: &'a mut [f32],
    hi: &'a mut [f32],
    methods: &'a mut [Method],
    method_codes: &'a mut [u8],
    /// Transmittance of each segment; `None` if the caller gave no array.
    each: Option<&'a mut [f32]>,
}

impl<'a> Chunk<'a> {
    /// All bundles of a batch.
    fn new(answers: &'a mut Answers, bundles: usize) -> Chunk<'a> {
        let Answers { transmittance, intervals, methods, method_codes, segments } = answers;
        let (lo, hi) = intervals.as_mut().map_or_else(Default::default, |(lo, hi)| (&mut **lo, &mut **hi));
        Chunk {
            bundles: 0..bundles,
            transmittance,
            lo,
            hi,
            methods: methods.as_mut().map_or_else(Default::default, |m| &mut **m),
            method_codes: method_codes.as_mut().map_or_else(Default::default, |m| &mut **m),
            each: segments.as_mut().map(|each| &mut **each),
        }
    }

    /// The number of bundles of the first part, if the chunk is to be divided: whole groups of bundles as long as there are several.
    fn division(&self, segments: &Segments) -> Option<usize> {
        let (bundles, first) = (self.bundles.len(), segments.of_bundle(self.bundles.start).start);
        let large = bundles > CHUNK.0 || segments.of_bundle(self.bundles.end - 1).end - first > CHUNK.1;
        let half = bundles / 2;
        (large && half > 0).then(|| if bundles > CHUNK.0 { half.next_multiple_of(CHUNK.0) } else { half })
    }

    /// Splits off the first `bundles` bundles, which have `segments` segments.
    fn take_first(&mut self, bundles: usize, segments: usize) -> Chunk<'a> {
        let middle = self.bundles.start + bundles;
        let first = Chunk {
            bundles: self.bundles.start..middle,
            transmittance: taken(&mut self.transmittance, bundles),
            lo: taken(&mut self.lo, bundles),
            hi: taken(&mut self.hi, bundles),
            methods: taken(&mut self.methods, bundles),
            method_codes: taken(&mut self.method_codes, bundles),
            each: self.each.as_mut().map(|each| taken(each, segments)),
        };
        self.bundles.start = middle;
        first
    }

    fn write(&mut self, k: usize, answer: &Answer) {
        self.transmittance[k] = answer.transmittance;
        // Outputs that were not asked for are empty.
        for (out, value) in [(&mut *self.lo, answer.lo), (&mut *self.hi, answer.hi)] {
            out.get_mut(k).into_iter().for_each(|out| *out = value);
        }
        self.methods.get_mut(k).into_iter().for_each(|out| *out = answer.method);
        self.method_codes.get_mut(k).into_iter().for_each(|out| *out = answer.method as u8);
    }
}

/// Takes the first entries of a slice; none of an empty one, an output that was not asked for.
fn taken<'a, T>(slice: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    slice.split_off_mut(..count.min(slice.len())).unwrap_or_default()
}

/// A checked batch with the data that all its chunks share.
struct CheckedBatch<'a> {
    segments: &'a Segments<'a>,
    /// Offset from the positions of segments to positions relative to the scene's origin.
    shift: DVec3,
    model: &'a Model,
    progress: &'a dyn Progress,
    /// Whether parts are answered in parallel, on the threads of the pool that this runs in.
    parallel: bool,
}

impl CheckedBatch<'_> {
    /// Answers a chunk: its halves, until they are small. `None` if it was stopped.
    fn answer(&self, engine: &BatchEngine, mut chunk: Chunk) -> Option<Cost> {
        let Some(bundles) = chunk.division(self.segments) else {
            if self.progress.stopped() {
                return None;
            }
            let steps = chunk.bundles.len() as u64;
            let cost = self.model.with_workspace(|workspace| {
                let mut buffers = std::mem::take(&mut workspace.batch);
                let cost = match engine {
                    BatchEngine::Exact(engine) => self.exact(engine, chunk, &mut buffers),
                    BatchEngine::Clusters(engine) | BatchEngine::Either(engine) => {
                        self.clusters(engine, chunk, &mut buffers, workspace)
                    }
                };
                workspace.batch = buffers;
                cost
            });
            self.progress.advance(steps);
            return cost;
        };
        let start = chunk.bundles.start;
        let segments = self.segments.of_bundle(start + bundles).start - self.segments.of_bundle(start).start;
        let first = chunk.take_first(bundles, segments);
        let (first, other) = (|| self.answer(engine, first), || self.answer(engine, chunk));
        let (first, other) = if self.parallel { parallel::join(first, other) } else { (first(), other()) };
        let mut all = first?;
        all.add(other?);
        Some(all)
    }

    /// Appends segments to packets, sixteen a packet, beginning with a new one.
    fn pack(&self, segments: Range<usize>, packets: &mut Vec<Packet>) {
        for (k, i) in segments.enumerate() {
            if k % LANES == 0 {
                packets.push(Packet::EMPTY);
            }
            let (from, to) = self.segments.ends(i, self.shift);
            let along = (to - from).normalize_or_zero();
            let here = self.model.end_at(from, along);
            let rules = [here, self.model.end_at(to, along).seen_from(here)];
            packets.last_mut().expect("just pushed").set_unknown(k % LANES, from, to, rules);
        }
    }

    /// Writes the packets of bundles or parts of them, and where those of each begin.
    fn packets(&self, parts: impl Iterator<Item = Range<usize>>, buffers: &mut BatchBuffers) {
        let BatchBuffers { packets, starts, .. } = buffers;
        packets.clear();
        starts.clear();
        starts.push(0);
        for segments in parts {
            self.pack(segments, packets);
            starts.push(packets.len());
        }
    }

    /// Whether the multi-resolution engine is likely to take less time than exact rays, by a sample of the bundles. A small batch is
    /// its own sample: the engine gives up by itself where it does not pay.
    fn pays(&self, engine: &MultiResolution) -> bool {
        let (bundles, sizes) = (self.segments.bundle_count(), self.segments.feature_sizes);
        let Some(sizes) = sizes.filter(|_| bundles > MAX_UNDECIDED_SEGMENTS) else { return true };
        self.model.with_workspace(|workspace| {
            let (mut buffers, mut work) = (std::mem::take(&mut workspace.batch), Work::default());
            for run in sample_runs(bundles) {
                self.packets(run.clone().map(|k| self.segments.of_bundle(k)), &mut buffers);
                let BatchBuffers { packets, starts, sizes: of_run, .. } = &mut buffers;
                of_run.clear();
                of_run.extend(run.clone().map(|k| sizes.of(k)));
                let bundle = |(j, k): (usize, usize)| self.bundle(k, &packets[starts[j]..starts[j + 1]]);
                let asked: SmallVec<[Bundle; CHUNK.0]> = run.enumerate().map(bundle).collect();
                work.add(engine.work(&asked, of_run, workspace));
            }
            workspace.batch = buffers;
            work.is_clearly_less()
        })
    }

    fn bundle<'p>(&self, k: usize, packets: &'p [Packet]) -> Bundle<'p> {
        Bundle { packets, emitter_size: self.segments.emitter_sizes.of(k), emitter: &[] }
    }

    /// Exact answers: packets hold the segments of the chunk without gaps. `None` if it was stopped.
    fn exact(&self, engine: &Exact, mut chunk: Chunk, buffers: &mut BatchBuffers) -> Option<Cost> {
        let bundles = chunk.bundles.clone();
        let first = self.segments.of_bundle(bundles.start).start;
        let all = first..self.segments.of_bundle(bundles.end - 1).end;
        let BatchBuffers { packets, blocked, .. } = buffers;
        blocked.clear();
        for part in parts(all.clone()) {
            if self.progress.stopped() {
                return None;
            }
            packets.clear();
            self.pack(part, packets);
            let before = blocked.len();
            blocked.resize(before + packets.len(), 0);
            engine.occluded(packets, &mut blocked[before..]);
        }
        let clear = |i: usize| blocked[(i - first) / LANES] >> ((i - first) % LANES) & 1 == 0;
        for (j, k) in bundles.enumerate() {
            let own = self.segments.of_bundle(k);
            let n = own.len();
            let blocked = own.filter(|&i| !clear(i)).count();
            let transmittance = if n == 0 { 1.0 } else { 1.0 - blocked as f32 / n as f32 };
            let (lo, hi) = if n == 0 { (1.0, 1.0) } else { wilson(transmittance, n as f32) };
            let method = if n == 0 { Method::Clear } else { Method::Exact };
            chunk.write(j, &Answer { transmittance, lo, hi, method, cost: Cost::default() });
        }
        for (out, i) in chunk.each.into_iter().flatten().zip(all.clone()) {
            *out = f32::from(u8::from(clear(i)));
        }
        let segments = all.len() as u64;
        Some(Cost { segments, exact_rays: segments, ..Cost::default() })
    }

    /// Answers by clusters: bundles have packets of their own. Where segments are wanted each packet is asked by itself. `None` if it was
    /// stopped.
    fn clusters(
        &self,
        engine: &MultiResolution,
        mut chunk: Chunk,
        buffers: &mut BatchBuffers,
        workspace: &mut Workspace,
    ) -> Option<Cost> {
        let (bundles, mut each) = (chunk.bundles.clone(), chunk.each.take());
        let mut sums: SmallVec<[PartialAnswers; CHUNK.0]> =
            SmallVec::from_elem(PartialAnswers::default(), bundles.len());
        let mut cost = Cost::default();
        if bundles.len() > 1 {
            self.packets(bundles.clone().map(|k| self.segments.of_bundle(k)), buffers);
            cost.add(self.sums(engine, bundles, each, &mut sums, buffers, workspace));
        } else {
            // A bundle may be larger than a chunk.
            for part in parts(self.segments.of_bundle(bundles.start)) {
                if self.progress.stopped() {
                    return None;
                }
                let own = each.as_mut().and_then(|each| each.split_off_mut(..part.len()));
                self.packets(std::iter::once(part), buffers);
                cost.add(self.sums(engine, bundles.clone(), own, &mut sums, buffers, workspace));
            }
        }
        for (j, sum) in sums.iter().enumerate() {
            chunk.write(j, &sum.answer());
        }
        Some(cost)
    }

    /// Adds the answers to the packets in the buffers to those of their bundles, and writes those of their segments; returns their cost.
    fn sums(
        &self,
        engine: &MultiResolution,
        bundles: Range<usize>,
        mut each: Option<&mut [f32]>,
        sums: &mut [PartialAnswers],
        buffers: &mut BatchBuffers,
        workspace: &mut Workspace,
    ) -> Cost {
        let BatchBuffers { packets, starts, sizes, bundle_of, .. } = buffers;
        let first = bundles.start;
        let size = |k: usize| self.segments.feature_sizes.map_or(0.0, |sizes| sizes.of(k));
        let apart = each.is_some();
        let parts = |j: usize| {
            let own = &packets[starts[j]..starts[j + 1]];
            own.chunks(if apart { 1 } else { own.len().max(1) }).map(move |part| (j, part))
        };
        let mut parts = (0..bundles.len()).flat_map(parts).peekable();
        let (mut at, mut cost) = (0, Cost::default());
        while parts.peek().is_some() {
            sizes.clear();
            bundle_of.clear();
            let asked: SmallVec<[Bundle; CHUNK.0]> = parts
                .by_ref()
                .take(CHUNK.0)
                .map(|(j, part)| {
                    sizes.push(size(first + j));
                    bundle_of.push(j);
                    self.bundle(first + j, part)
                })
                .collect();
            engine.answers_lanes(&asked, sizes, workspace, |k, answer, lanes| {
                sums[bundle_of[k]].add(&answer);
                cost.add(answer.cost);
                if let Some(each) = &mut each {
                    let n = answer.cost.segments as usize;
                    each[at..at + n].copy_from_slice(&lanes[..n]);
                    at += n;
                }
            });
        }
        cost
    }
}

/// Segments in parts of at most a chunk. None for no segments.
fn parts(segments: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let end = segments.end;
    segments.step_by(CHUNK.1).map(move |first| first..end.min(first + CHUNK.1))
}

/// Sums of the answers to parts of a bundle.
#[derive(Clone, Copy, Default)]
struct PartialAnswers {
    parts: u32,
    segments: f64,
    values: [f64; 3],
    method: Method,
}

impl PartialAnswers {
    fn add(&mut self, answer: &Answer) {
        let n = answer.cost.segments as f64;
        self.segments += n;
        for (sum, value) in self.values.iter_mut().zip([answer.transmittance, answer.lo, answer.hi]) {
            *sum += n * f64::from(value);
        }
        self.method = match (self.parts, self.method, answer.method) {
            (0, _, new) => new,
            (_, old, new) if old == new => old,
            (_, old, new) => {
                let averaged = |m| matches!(m, Method::Aggregated | Method::Mixed);
                let tested = |m| matches!(m, Method::Exact | Method::Mixed | Method::Covered);
                match (averaged(old) || averaged(new), tested(old) || tested(new)) {
                    (true, true) => Method::Mixed,
                    (true, false) => Method::Aggregated,
                    _ => Method::Exact,
                }
            }
        };
        self.parts += 1;
    }

    /// The mean of the parts; that of intervals is one for any dependence between them.
    fn answer(&self) -> Answer {
        let [transmittance, lo, hi] = match self.segments {
            0.0 => [1.0; 3],
            n => self.values.map(|sum| (sum / n) as f32),
        };
        Answer { transmittance, lo, hi, method: self.method, cost: Cost::default() }
    }
}
