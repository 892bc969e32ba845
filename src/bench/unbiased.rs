//! Rows without bias: averaged answers corrected by exact segments, against plain exact rays at the same error
//! (method E.4).
//!
//! A pilot on a sample, with segments of its own, measures for some averaged levels what they cost, how far they are
//! from exact, segment by segment, and how that depends on the answer. The numbers of corrections by class are those
//! that leave the least variance at a price for a correction; price and level are those that promise the least time
//! relative to that of exact rays with the same error.

use super::measure::{Questions, Run, Timer, bundles};
use super::record::{UnbiasedLevel, UnbiasedRow, interpolate_log_log};
use super::reference::Reference;
use super::rounds::as_often;
use super::rows::{Bench, Measured, WARM_UP, curve, ratio};
use super::workload::Order;
use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::{Bundle, Correction, Estimate, Exact, MultiResolution, Unbiased, Workspace};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;
use std::time::Instant;

/// Segments of the averaged level.
pub(super) const SEGMENTS: [usize; 3] = [64, 256, 1024];
/// Parts of their size that emitters are taken for: smaller ones open more.
const EMITTER_PARTS: [f32; 3] = [1.0, 0.5, 0.25];
/// Sample set of the rows, and those of the pilot.
const STREAM: u64 = 5;
const PILOT_STREAMS: [u64; 2] = [6, 7];
/// Runs of neighbouring pairs in the pilot, and the pairs of each.
pub(super) const PILOT: (usize, usize) = (32, 32);
/// Least probability of a correction: rarer ones would make errors that nobody sees until they happen.
const RAREST: f32 = 1.0 / 32.0;
/// Least pairs that a class of the pilot is believed with.
const FEW: f64 = 16.0;
const CLASSES: usize = Correction::CLASSES;

/// Bytes of a pilot's segments, both sets of them, at most.
pub(super) fn pilot_bytes() -> usize {
    let packets = SEGMENTS.map(|n| n.div_ceil(LANES)).into_iter().max().unwrap_or(0);
    2 * PILOT.0 * PILOT.1 * packets * size_of::<Packet>()
}

/// An averaged level and how it is corrected.
#[derive(Clone)]
struct Plan {
    segments: usize,
    feature_size: f64,
    emitter_part: f32,
    correction: Correction,
    /// Time for an estimate over that of exact rays with the same error, expected.
    work: f64,
}

impl Bench<'_> {
    /// Rows without bias, each run as often as the rows that were measured.
    pub fn unbiased(
        &self,
        questions: Questions,
        engine: &MultiResolution,
        measured: &Measured,
    ) -> Vec<UnbiasedRow> {
        let (reference, curve) = (&measured.reference, &curve(&measured.exact)[..]);
        self.progress.stage("unbiased", (SEGMENTS.len() * questions.pairs.len()) as u64);
        let sample = sample(questions);
        let questions_of_pilot = Questions { pairs: &sample, ..questions };
        SEGMENTS
            .iter()
            .map(|&segments| {
                let start = Instant::now();
                let exact = self.embree(questions.workload, segments);
                let pilot = Pilot::new(questions_of_pilot, &exact, segments);
                let sizes = [self.sizes.first(), self.sizes.last()].into_iter().flatten();
                let plans = sizes.flat_map(|&s| EMITTER_PARTS.map(|part| (s, part)));
                let pairs = questions.pairs.len() as f64;
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
                let ask = |questions: Questions, advance: &dyn Fn(usize)| {
                    self.timer.unbiased(questions, &unbiased, segments, seed, advance)
                };
                ask(questions.first(WARM_UP), &|_| ());
                let advance = |first: bool, n: usize| self.progress.advance(if first { n as u64 } else { 0 });
                let mut found = None;
                let seconds = as_often(measured.rounds, |first| {
                    let (mut run, corrections) = ask(questions, &|n| advance(first, n));
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

/// What a run has to say for itself.
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
        // Both the estimates and the reference they are compared with err independently, pair by pair.
        bias_error: (rms * rms + reference.standard_error().powi(2)).sqrt() / pairs.sqrt(),
        speedup_at_same_rms: same.and_then(|t| ratio(t.seconds, seconds)),
        extrapolated: same.is_some_and(|t| t.extrapolated),
    }
}

impl Timer {
    /// Estimates without bias, and how many segments corrected them.
    fn unbiased(
        &self,
        questions: Questions,
        unbiased: &Unbiased,
        rays: usize,
        seed: u64,
        advance: &dyn Fn(usize),
    ) -> (Run, u64) {
        let (mut visible, mut corrections) = (Vec::with_capacity(questions.pairs.len()), 0);
        let sections = self.chunk_by_chunk(
            super::measure::chunks(questions.pairs.len(), rays),
            |chunk: &mut super::measure::Chunk<Estimate>| {
                chunk.prepare(questions, (rays, Order::Spread), STREAM)
            },
            |chunk| {
                let (order, bundles) = bundles(questions, chunk.pairs.clone(), &chunk.packets, rays);
                chunk.answers.clear();
                chunk.answers.resize(bundles.len(), Estimate::default());
                let mut next = order.iter();
                let pair = |k: usize| questions.pairs[chunk.pairs.start + order[k]];
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

/// Runs of neighbouring questions, evenly spread.
pub(super) fn sample(questions: Questions) -> Vec<usize> {
    let all = questions.pairs.len();
    let length = PILOT.1.min(all);
    let runs = PILOT.0.min(all / length.max(1));
    let first = |k: usize| (all - length) * k / (runs - 1).max(1);
    (0..runs).flat_map(|k| questions.pairs[first(k)..first(k) + length].iter().copied()).collect()
}

/// Exact answers to a sample.
struct Pilot<'a> {
    questions: Questions<'a>,
    segments: usize,
    packets: Vec<Packet>,
    /// Clear segments of each packet.
    clear: Vec<f32>,
    /// Variance of the mean of a pair's exact segments, averaged over the pairs.
    variance: f64,
    /// Seconds for an exact packet.
    seconds: f64,
}

impl<'a> Pilot<'a> {
    fn new(questions: Questions<'a>, exact: &Exact, segments: usize) -> Pilot<'a> {
        let make = |stream: u64| {
            let mut packets = Vec::new();
            for &pair in questions.pairs {
                let how = (segments, Order::Spread);
                questions.workload.add_bundle(questions.scene, pair, how, stream, &mut packets);
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
        let variance = halves.map(square).sum::<f64>() / questions.pairs.len() as f64;
        Pilot { questions, segments, packets, clear, variance, seconds }
    }

    /// The best use of an averaged level. `exactly` says how many seconds exact rays take to answer a pair with this
    /// error.
    fn plan(
        &self,
        engine: &MultiResolution,
        (feature_size, emitter_part): (f64, f32),
        exactly: &dyn Fn(f64) -> f64,
    ) -> Plan {
        let per_pair = self.segments / LANES;
        let pairs = self.questions.pairs;
        let (order, bundles) = bundles(self.questions, 0..pairs.len(), &self.packets, self.segments);
        let bundles: Vec<Bundle> =
            bundles.iter().map(|b| Bundle { emitter_size: b.emitter_size * emitter_part, ..*b }).collect();
        let mut workspace = Workspace::default();
        let (mut answers, mut seconds) = (Vec::new(), f64::MAX);
        for _ in 0..2 {
            answers.clear();
            let start = Instant::now();
            let s = (feature_size * f64::from(emitter_part)) as f32;
            engine.answers(&bundles, s, &mut workspace, |a| answers.push(a));
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

/// Differences of exact and averaged packets of some pairs.
#[derive(Clone, Debug, Default)]
struct Class {
    count: f64,
    /// Summed variance within the pairs of the mean difference of 1, 2, 4, ... neighbouring packets: what is left when
    /// so many of them, picked at random, stand for all.
    left: Vec<f64>,
    /// Summed square of the pairs' mean differences.
    square: f64,
}

impl Class {
    fn add(&mut self, clear: &[f32], sums: &[f32]) {
        let differences: Vec<f64> =
            clear.iter().zip(sums).map(|(c, t)| f64::from(c - t) / LANES as f64).collect();
        let mean = differences.iter().sum::<f64>() / differences.len() as f64;
        self.count += 1.0;
        self.square += mean * mean;
        for (j, left) in sizes(clear.len()).enumerate() {
            let parts = differences.chunks(left);
            let n = parts.len() as f64;
            let error = |part: &[f64]| (part.iter().sum::<f64>() / part.len() as f64 - mean).powi(2);
            self.left.resize(self.left.len().max(j + 1), 0.0);
            self.left[j] += parts.map(error).sum::<f64>() / n;
        }
    }

    fn join(mut self, other: &Class) -> Class {
        self.left.resize(self.left.len().max(other.left.len()), 0.0);
        self.left.iter_mut().zip(&other.left).for_each(|(a, b)| *a += b);
        Class { count: self.count + other.count, square: self.square + other.square, ..self }
    }

    /// Numbers of packets to choose from, below 1 with that probability, and the summed variance that each leaves.
    fn choices(&self) -> impl Iterator<Item = (f32, f64)> {
        let one = self.left.first().copied().unwrap_or(0.0);
        let rare = (1..=RAREST.log2().abs() as i32).rev().map(move |k| {
            let q = 0.5f64.powi(k);
            (q as f32, (one + self.square) / q - self.square)
        });
        rare.chain(self.left.iter().enumerate().map(|(j, &left)| ((1usize << j) as f32, left)))
    }
}

/// The powers of two that divide a number of packets.
fn sizes(packets: usize) -> impl Iterator<Item = usize> {
    (0..=packets.trailing_zeros()).map(|j| 1 << j)
}

/// Packets by class so that `work(variance, packets)` is least, where both are means over all `pairs`: each class takes
/// what is best for it at a price for a packet (Lagrange), and the price is tried out.
fn allocate(classes: &[Class], pairs: usize, work: impl Fn(f64, f64) -> f64) -> (Correction, f64) {
    let n = pairs.max(1) as f64;
    let whole = classes.iter().fold(Class::default(), Class::join);
    let choice = |price: f64| {
        let (mut packets, mut variance, mut asked) = ([1.0; CLASSES], 0.0, 0.0);
        for (class, packets) in classes.iter().zip(&mut packets) {
            // Classes that the pilot hardly saw are taken for what all are like.
            let believed = if class.count < FEW { &whole } else { class };
            let price = price * believed.count;
            let best = believed
                .choices()
                .min_by(|a, b| (a.1 + price * f64::from(a.0)).total_cmp(&(b.1 + price * f64::from(b.0))));
            let Some((m, left)) = best else { continue };
            *packets = m;
            let part = class.count / believed.count.max(1.0);
            (variance, asked) = (variance + left * part, asked + class.count * f64::from(m));
        }
        (Correction { packets }, work(variance / n, asked / n))
    };
    let prices = (-60..=4).map(|k| f64::from(k as f32 * 0.5).exp2());
    prices.map(choice).min_by(|a, b| a.1.total_cmp(&b.1)).expect("there are prices")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As many pairs, whose differences have this variance for one packet of `all` and are independent.
    fn class(count: f64, variance: f64, all: usize) -> Class {
        let left = sizes(all).map(|m| count * variance * (1.0 / m as f64 - 1.0 / all as f64)).collect();
        Class { count, left, square: 0.0 }
    }

    #[test]
    fn corrections_go_where_the_answers_vary() {
        let mut classes = vec![Class::default(); CLASSES];
        (classes[2], classes[11]) = (class(100.0, 0.0001, 64), class(100.0, 0.01, 64));
        let work = |variance: f64, packets: f64| (1e-5 + variance) * (1.0 + packets);
        let (correction, least) = allocate(&classes, 200, work);
        let [rare, often] = [2, 11].map(|c| f64::from(correction.packets[c]));
        assert!((4.0..=32.0).contains(&(often / rare)), "about in proportion: {rare} {often}");
        // No other number for all is better.
        for ((m, a), (_, b)) in classes[2].choices().zip(classes[11].choices()) {
            assert!(work((a + b) / 200.0, m.into()) > 0.999 * least, "{m}");
        }
    }

    #[test]
    fn costly_corrections_are_rare_and_never_left_out() {
        let mut classes = vec![Class::default(); CLASSES];
        (classes[0], classes[11]) = (class(1000.0, 1e-9, 16), class(50.0, 0.02, 16));
        let (correction, _) = allocate(&classes, 1050, |v, p| (0.01 + v) * (1.0 + 100.0 * p));
        assert!(correction.packets.iter().all(|&m| m >= RAREST));
        assert_eq!(correction.packets[0], RAREST);
    }

    #[test]
    fn all_packets_leave_nothing() {
        let mut one = Class::default();
        one.add(&[16.0, 0.0, 8.0, 8.0], &[8.0; 4]);
        assert_eq!((one.left.len(), one.left[2], one.square), (3, 0.0, 0.0));
        // Neighbours that make up for each other leave nothing either.
        assert!(one.left[0] > 0.1 && one.left[1] == 0.0);
        let left: Vec<f64> = one.choices().map(|c| c.1).collect();
        assert!(left.windows(2).all(|w| w[0] > w[1] || w[1] == 0.0), "{left:?}");
    }

    #[test]
    fn chances_differ_between_pairs() {
        let all: std::collections::HashSet<u64> = (0..1000).map(|pair| chance(1, pair)).collect();
        assert_eq!(all.len(), 1000);
        let mean = (0..1000).map(|pair| (chance(1, pair) >> 40) as f64 / f64::from(1u32 << 24)).sum::<f64>();
        assert!((mean / 1000.0 - 0.5).abs() < 0.05, "{mean}");
    }
}
