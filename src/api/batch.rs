//! Answers to batches: bundles in chunks, chunks in parallel, segments in packets.

use super::segments::{Answers, Frame, Segments};
use super::visibility::{Chosen, Visibility};
use crate::Result;
use crate::model::Model;
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::{
    Answer, Bundle, Cost, Exact, Method, MultiResolution, Work, Workspace, sample_runs, wilson,
};
use rayon::prelude::*;
use std::ops::Range;

/// A chunk ends at so many bundles, or when it has so many segments: limits it to 1,024 packets and four groups of
/// bundles that share their traversal. Does not depend on the number of threads, so that answers do not.
const CHUNK: (usize, usize) = (256, 1 << 14);
/// Largest batch that is answered without deciding between engines: the decision walks 16 bundles, a quarter of the batch.
const SMALL: usize = 64;

impl Visibility {
    /// Answers a batch into the caller's arrays, on the threads of the model; gives what it took. The answers do not depend on the
    /// number of threads. See [`Segments`] for the frame of positions.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument), which names array and index, if lengths do not match, offsets do not ascend, a
    /// position is not finite, a segment has no length, or a size is out of its range; if the engine needs feature sizes or optics that
    /// are missing. `answers` are then as they were.
    pub fn answer_into(&self, segments: &Segments, answers: &mut Answers) -> Result<Cost> {
        self.model.on_threads(|| {
            let frame = segments.frame(self.model.scene().origin);
            segments.check(&frame)?;
            answers.check(segments.bundle_count(), segments.origins.len())?;
            let ask = Ask { segments, frame, model: &self.model };
            let engine = match self.chosen(segments.feature_sizes.is_some())? {
                Chosen::Either(engine) => {
                    if ask.pays(&engine) {
                        Chosen::Clusters(engine)
                    } else {
                        Chosen::Exact(self.model.exact())
                    }
                }
                engine => engine,
            };
            let costs: Vec<Cost> = chunks(segments, answers)
                .into_par_iter()
                .map(|chunk| match &engine {
                    Chosen::Exact(engine) => ask.exact(engine, chunk),
                    Chosen::Clusters(engine) | Chosen::Either(engine) => {
                        self.model.with_workspace(|workspace| ask.clusters(engine, chunk, workspace))
                    }
                })
                .collect();
            let mut all = Cost::default();
            costs.into_iter().for_each(|cost| all.add(cost));
            Ok(all)
        })?
    }
}

/// Some bundles and where their answers go.
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

impl Chunk<'_> {
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

/// The batch in chunks.
fn chunks<'a>(segments: &Segments, answers: &'a mut Answers) -> Vec<Chunk<'a>> {
    let Answers { transmittance, intervals, methods, method_codes, segments: each } = answers;
    let mut transmittance = &mut **transmittance;
    let (mut lo, mut hi) =
        intervals.as_mut().map_or_else(Default::default, |(lo, hi)| (&mut **lo, &mut **hi));
    let mut methods = methods.as_mut().map_or_else(Default::default, |m| &mut **m);
    let mut method_codes = method_codes.as_mut().map_or_else(Default::default, |m| &mut **m);
    let mut each = each.as_mut().map(|e| &mut **e);
    let (mut chunks, mut first) = (Vec::new(), 0);
    while first < segments.bundle_count() {
        let from = segments.of_bundle(first).start;
        let mut end = first + 1;
        while end < segments.bundle_count()
            && end - first < CHUNK.0
            && segments.of_bundle(end - 1).end - from < CHUNK.1
        {
            end += 1;
        }
        let count = segments.of_bundle(end - 1).end - from;
        chunks.push(Chunk {
            bundles: first..end,
            transmittance: front(&mut transmittance, end - first),
            lo: front(&mut lo, end - first),
            hi: front(&mut hi, end - first),
            methods: front(&mut methods, end - first),
            method_codes: front(&mut method_codes, end - first),
            each: each.as_mut().map(|each| front(each, count)),
        });
        first = end;
    }
    chunks
}

/// Removes and returns the first entries of a slice; an empty slice (an output that was not asked for) gives none.
fn front<'a, T>(slice: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let all = std::mem::take(slice);
    let (front, rest) = all.split_at_mut(count.min(all.len()));
    *slice = rest;
    front
}

/// A batch that was checked.
struct Ask<'a> {
    segments: &'a Segments<'a>,
    frame: Frame<'a>,
    model: &'a Model,
}

impl Ask<'_> {
    /// Appends segments to packets, sixteen a packet, beginning with a new one.
    fn pack(&self, segments: Range<usize>, packets: &mut Vec<Packet>) {
        for (k, i) in segments.enumerate() {
            if k % LANES == 0 {
                packets.push(Packet::EMPTY);
            }
            let (from, to) = self.frame.ends(i);
            let along = (to - from).normalize_or_zero();
            let here = self.model.end_at(from, along);
            let rules = [here, self.model.end_at(to, along).seen_from(here)];
            packets.last_mut().expect("just pushed").set_unknown(k % LANES, from, to, rules);
        }
    }

    /// Packets of bundles, and where those of each bundle begin.
    fn packets(&self, bundles: Range<usize>) -> (Vec<Packet>, Vec<usize>) {
        let (mut packets, mut starts) = (Vec::new(), vec![0]);
        for k in bundles {
            self.pack(self.segments.of_bundle(k), &mut packets);
            starts.push(packets.len());
        }
        (packets, starts)
    }

    /// Whether the multi-resolution engine is likely to take less time than exact rays, by a sample of the bundles. A small batch is
    /// its own sample: the engine gives up by itself where it does not pay.
    fn pays(&self, engine: &MultiResolution) -> bool {
        let (bundles, sizes) = (self.segments.bundle_count(), self.segments.feature_sizes);
        let Some(sizes) = sizes.filter(|_| bundles > SMALL) else { return true };
        let (mut workspace, mut work) = (Workspace::default(), Work::default());
        for run in sample_runs(bundles) {
            let (packets, starts) = self.packets(run.clone());
            let sizes: Vec<f32> = run.clone().map(|k| sizes.of(k)).collect();
            let bundle = |(j, k): (usize, usize)| self.bundle(k, &packets[starts[j]..starts[j + 1]]);
            let asked: Vec<Bundle> = run.enumerate().map(bundle).collect();
            work.add(engine.work(&asked, &sizes, &mut workspace));
        }
        work.is_clearly_less()
    }

    fn bundle<'p>(&self, k: usize, packets: &'p [Packet]) -> Bundle<'p> {
        Bundle { packets, emitter_size: self.segments.emitter_sizes.of(k), emitter: &[] }
    }

    /// Exact answers: packets hold the segments of the chunk without gaps.
    fn exact(&self, engine: &Exact, mut chunk: Chunk) -> Cost {
        let bundles = chunk.bundles.clone();
        let first = self.segments.of_bundle(bundles.start).start;
        let all = first..self.segments.of_bundle(bundles.end - 1).end;
        let mut packets = Vec::with_capacity(all.len().div_ceil(LANES));
        self.pack(all.clone(), &mut packets);
        let mut blocked = vec![0; packets.len()];
        engine.occluded(&packets, &mut blocked);
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
        Cost { segments, exact_rays: segments, ..Cost::default() }
    }

    /// Answers by clusters: bundles have packets of their own. Where segments are wanted each packet is asked by itself.
    fn clusters(&self, engine: &MultiResolution, mut chunk: Chunk, workspace: &mut Workspace) -> Cost {
        let bundles = chunk.bundles.clone();
        let (packets, starts) = self.packets(bundles.clone());
        let apart = chunk.each.is_some();
        let size = |k: usize| self.segments.feature_sizes.map_or(0.0, |sizes| sizes.of(k));
        let (mut asked, mut sizes, mut of) = (Vec::new(), Vec::new(), Vec::new());
        for (j, k) in bundles.enumerate() {
            let own = &packets[starts[j]..starts[j + 1]];
            for part in own.chunks(if apart { 1 } else { own.len().max(1) }) {
                asked.push(self.bundle(k, part));
                sizes.push(size(k));
                of.push(j);
            }
        }
        let mut sums = vec![Sum::default(); chunk.bundles.len()];
        let mut each = chunk.each.take();
        let (mut at, mut cost) = (0, Cost::default());
        engine.answers_lanes(&asked, &sizes, workspace, |k, answer, lanes| {
            sums[of[k]].add(&answer);
            cost.add(answer.cost);
            if let Some(each) = &mut each {
                let n = answer.cost.segments as usize;
                each[at..at + n].copy_from_slice(&lanes[..n]);
                at += n;
            }
        });
        for (j, sum) in sums.iter().enumerate() {
            chunk.write(j, &sum.answer());
        }
        cost
    }
}

/// Answers to parts of a bundle.
#[derive(Clone, Copy, Default)]
struct Sum {
    parts: u32,
    segments: f64,
    values: [f64; 3],
    method: Method,
}

impl Sum {
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
