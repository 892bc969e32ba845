//! Unbiased rows: averaged answers corrected by exact segments, compared with exact rays at equal error
//! (docs/method.md, Unbiased combination).
//!
//! A pilot with independent segments measures, for several averaged levels, their time and their difference to exact
//! segments by class of answer. The number of corrections per class minimises variance at a price per correction.
//! Price and level minimise the expected time relative to exact rays of equal error.

mod allocate;

use super::context::Bench;
use super::measure::{Queries, Run, Timer, bundles};
use super::pilot::{UNBIASED_SEGMENTS, pilot_pairs};
use super::record::{UnbiasedLevel, UnbiasedRow, curve, interpolate_log_log, ratio};
use super::reference::Reference;
use super::rounds::WARM_UP_PAIRS;
use super::rounds::as_often;
use super::rows::Measured;
use super::workload::Order;
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::{Bundle, Correction, Estimate, Exact, MultiResolution, Unbiased, Workspace};
use allocate::{CLASSES, Class, allocate};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;
use std::time::Instant;

/// Emitter sizes used by the umbra criterion, relative to the true size: smaller emitters open more clusters. Three
/// steps of 2, of which the pilot selects one.
const EMITTER_PARTS: [f32; 3] = [1.0, 0.5, 0.25];
/// Random streams (sample sets) of the rows and of the pilot; independent of the streams of other measurements.
const STREAM: u64 = 5;
const PILOT_STREAMS: [u64; 2] = [6, 7];

/// An averaged level and its corrections.
#[derive(Clone)]
struct Plan {
    segments: usize,
    feature_size: f64,
    emitter_part: f32,
    correction: Correction,
    /// Expected time of an estimate relative to exact rays of equal error.
    work: f64,
}

impl Bench<'_> {
    /// Measures the unbiased rows, each as often as the other rows.
    pub fn unbiased(
        &self,
        queries: Queries,
        engine: &MultiResolution,
        measured: &Measured,
    ) -> Vec<UnbiasedRow> {
        let curve = &curve(measured.exact.iter().chain(&measured.certified))[..];
        let reference = &measured.reference;
        self.progress.stage("unbiased", (UNBIASED_SEGMENTS.len() * queries.pairs.len()) as u64);
        let sample = pilot_pairs(queries);
        let pilot_queries = Queries { pairs: &sample, ..queries };
        UNBIASED_SEGMENTS
            .iter()
            .map(|&segments| {
                let start = Instant::now();
                let exact = self.embree(queries.workload, segments);
                let pilot = Pilot::new(pilot_queries, &exact, segments);
                let sizes = [self.sizes.first(), self.sizes.last()].into_iter().flatten();
                let plans = sizes.flat_map(|&s| EMITTER_PARTS.map(|part| (s, part)));
                let pairs = queries.pairs.len() as f64;
                let exactly = |rms| interpolate_log_log(curve, rms).map_or(f64::MAX, |t| t.seconds / pairs);
                let plan = plans
                    .map(|(s, part)| pilot.plan(engine, (s, part), &exactly))
                    .min_by(|a, b| a.work.total_cmp(&b.work))
                    .expect("there are sizes");
                let pilot_s = start.elapsed().as_secs_f64();
                let unbiased = Unbiased {
                    engine,
                    exact,
                    feature_size: (plan.feature_size * f64::from(plan.emitter_part)) as f32,
                    emitter_part: plan.emitter_part,
                    correction: &plan.correction,
                };
                let seed = self.options.seed;
                let ask = |queries: Queries, advance: &dyn Fn(usize)| {
                    self.timer.unbiased(queries, &unbiased, segments, seed, advance)
                };
                ask(queries.first(WARM_UP_PAIRS), &|_| ());
                let advance = |first: bool, n: usize| self.progress.advance(if first { n as u64 } else { 0 });
                let mut found = None;
                let seconds = as_often(measured.rounds, |first| {
                    let (mut run, corrections) = ask(queries, &|n| advance(first, n));
                    let sections = std::mem::take(&mut run.sections);
                    found.get_or_insert((run, corrections));
                    sections
                });
                let (run, corrections) = found.expect("at least one run");
                row(&plan, (&run, seconds), corrections, reference, curve, pilot_s)
            })
            .collect()
    }
}

/// The row of one run.
fn row(
    plan: &Plan,
    (run, seconds): (&Run, f64),
    corrections: u64,
    reference: &Reference,
    curve: &[(f64, f64)],
    pilot_s: f64,
) -> UnbiasedRow {
    let (rms, bias) = reference.errors(&run.visible);
    let pairs = run.visible.len().max(1) as f64;
    let same = interpolate_log_log(curve, rms);
    let averaged = UnbiasedLevel {
        feature_size: Some(plan.feature_size * f64::from(plan.emitter_part)),
        emitter_part: plan.emitter_part.into(),
        rays: plan.segments as f64,
    };
    let exact = UnbiasedLevel { feature_size: None, emitter_part: 1.0, rays: corrections as f64 / pairs };
    UnbiasedRow {
        levels: vec![averaged, exact],
        rays: plan.segments,
        seconds,
        pilot_s,
        rms,
        bias,
        // Errors of estimates and of the reference are independent between pairs.
        bias_error: (rms * rms + reference.standard_error().powi(2)).sqrt() / pairs.sqrt(),
        speedup_at_same_rms: same.and_then(|t| ratio(t.seconds, seconds)),
        extrapolated: same.is_some_and(|t| t.extrapolated),
    }
}

impl Timer {
    /// Unbiased estimates, and the number of correcting segments.
    fn unbiased(
        &self,
        queries: Queries,
        unbiased: &Unbiased,
        rays: usize,
        seed: u64,
        advance: &dyn Fn(usize),
    ) -> (Run, u64) {
        let (mut visible, mut corrections) = (Vec::with_capacity(queries.pairs.len()), 0);
        let sections = self.chunk_by_chunk(
            super::measure::chunks(queries.pairs.len(), rays),
            |chunk: &mut super::measure::Chunk<Estimate>| {
                chunk.prepare(queries, (rays, Order::Spread), STREAM)
            },
            |chunk| {
                let (order, bundles) =
                    bundles(queries, chunk.pairs.clone(), (&chunk.packets, &chunk.hulls), rays);
                chunk.answers.clear();
                chunk.answers.resize(bundles.len(), Estimate::default());
                let mut next = order.iter();
                let pair = |k: usize| queries.pairs[chunk.pairs.start + order[k]];
                let chance = |k: usize| chance(seed, pair(k));
                unbiased.estimates(&bundles, chance, &mut chunk.workspace, |estimate| {
                    chunk.answers[*next.next().expect("an estimate a bundle")] = estimate;
                });
            },
            |chunk| {
                visible.extend(chunk.answers.iter().map(|e| e.visible));
                corrections += chunk.answers.iter().map(|e| u64::from(e.corrections)).sum::<u64>();
                advance(chunk.pairs.len());
            },
        );
        (Run { visible, sections }, corrections)
    }
}

/// Random bits of a pair.
fn chance(seed: u64, pair: usize) -> u64 {
    Pcg64Mcg::new((u128::from(seed) << 64) | (pair as u128 * 2 + 1)).next_u64()
}

/// Exact answers to the pairs of a pilot.
struct Pilot<'a> {
    queries: Queries<'a>,
    segments: usize,
    packets: Vec<Packet>,
    /// Number of clear segments of each packet.
    clear: Vec<f32>,
    /// Mean variance of a pair's mean over its exact segments.
    variance: f64,
    /// Time of an exact packet, seconds.
    seconds: f64,
}

impl<'a> Pilot<'a> {
    fn new(queries: Queries<'a>, exact: &Exact, segments: usize) -> Pilot<'a> {
        let make = |stream: u64| {
            let mut packets = Vec::new();
            for &pair in queries.pairs {
                let how = (segments, Order::Spread);
                queries.workload.add_bundle(queries.scene, pair, how, stream, &mut packets);
            }
            packets
        };
        let mut seconds = f64::MAX;
        let mut trace = |packets: &[Packet]| -> Vec<f32> {
            let mut blocked = vec![0; packets.len()];
            let start = Instant::now();
            exact.occluded(packets, &mut blocked);
            seconds = seconds.min(start.elapsed().as_secs_f64() / packets.len() as f64);
            packets.iter().zip(blocked).map(|(p, b)| (p.active & !b).count_ones() as f32).collect()
        };
        let packets = make(PILOT_STREAMS[0]);
        let clear = trace(&packets);
        let other = trace(&make(PILOT_STREAMS[1]));
        let per_pair = segments / LANES;
        let halves = clear.chunks(per_pair).zip(other.chunks(per_pair));
        let square = |(a, b): (&[f32], &[f32])| {
            let difference = (a.iter().sum::<f32>() - b.iter().sum::<f32>()) / segments as f32;
            0.5 * f64::from(difference).powi(2)
        };
        let variance = halves.map(square).sum::<f64>() / queries.pairs.len() as f64;
        Pilot { queries, segments, packets, clear, variance, seconds }
    }

    /// Corrections of one averaged level that minimise the expected time. `exactly` is the time per pair, seconds, of
    /// exact rays with a given error.
    fn plan(
        &self,
        engine: &MultiResolution,
        (feature_size, emitter_part): (f64, f32),
        exactly: &dyn Fn(f64) -> f64,
    ) -> Plan {
        let per_pair = self.segments / LANES;
        let pairs = self.queries.pairs;
        let hulls = self.queries.hulls(0..pairs.len());
        let (order, bundles) = bundles(self.queries, 0..pairs.len(), (&self.packets, &hulls), self.segments);
        let bundles: Vec<Bundle> =
            bundles.iter().map(|b| Bundle { emitter_size: b.emitter_size * emitter_part, ..*b }).collect();
        let mut workspace = Workspace::default();
        let (mut answers, mut seconds) = (Vec::new(), f64::MAX);
        for _ in 0..2 {
            answers.clear();
            let start = Instant::now();
            let s = (feature_size * f64::from(emitter_part)) as f32;
            engine.walked_answers(&bundles, s, &mut workspace, |a| answers.push(a));
            seconds = seconds.min(start.elapsed().as_secs_f64() / pairs.len() as f64);
        }
        let mut classes = vec![Class::default(); CLASSES];
        for ((answer, sums), &k) in answers.iter().zip(workspace.sums().chunks(per_pair)).zip(&order) {
            if answer.cost.aggregated > 0 {
                let clear = &self.clear[k * per_pair..(k + 1) * per_pair];
                classes[Correction::class(answer.transmittance)].add(clear, sums);
            }
        }
        let (correction, work) = allocate(&classes, pairs.len(), |corrections, packets| {
            (seconds + packets * self.seconds) / exactly((self.variance + corrections).max(1e-12).sqrt())
        });
        Plan { segments: self.segments, feature_size, emitter_part, correction, work }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chances_differ_between_pairs() {
        let all: std::collections::HashSet<u64> = (0..1000).map(|pair| chance(1, pair)).collect();
        assert_eq!(all.len(), 1000);
        let mean = (0..1000).map(|pair| (chance(1, pair) >> 40) as f64 / f64::from(1u32 << 24)).sum::<f64>();
        assert!((mean / 1000.0 - 0.5).abs() < 0.05, "{mean}");
    }
}
