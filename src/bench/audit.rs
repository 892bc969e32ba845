//! Audit: claimed against observed error, by independent exact rays on a random sample of the bundles.

use super::exact_reference::{ExactReference, RmsEstimate};
use super::measure::{MrRun, Queries};
use super::record;
use crate::math::NORMAL_95;
use crate::visibility::{Exact, wilson};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

/// Exact rays per bundle: two halves of 32 rays, each with a standard error of at most 9 %; [`RmsEstimate`] averages
/// their noise over the bundles.
pub(super) const AUDIT_RAYS: usize = 64;
/// Random streams of the two halves.
const STREAMS: [u64; 2] = [3, 4];
/// Fewest bundles, where the workload has as many: coverage of 95 % is then known to ±2 % (Wilson: 1.96 √(0.95 · 0.05 / 400)).
const MIN_BUNDLES: usize = 400;
/// Largest number of bins of the calibration: 50 bundles per bin at [`MIN_BUNDLES`].
const MAX_BINS: usize = 8;

/// Exact rays on a random sample of the queries. All rows are compared with the same rays.
pub(super) struct AuditRays {
    fraction: f64,
    /// Indices into the queries.
    chosen: Vec<usize>,
    reference: ExactReference,
}

impl AuditRays {
    /// Traces the rays on all threads.
    pub fn trace(queries: Queries, engine: &Exact, fraction: f64, seed: u64) -> AuditRays {
        let count = ((fraction * queries.pairs.len() as f64).ceil() as usize).max(MIN_BUNDLES);
        let chosen = one_of_each(queries.pairs.len(), count, seed);
        let pairs: Vec<usize> = chosen.iter().map(|&k| queries.pairs[k]).collect();
        let reference =
            ExactReference::trace(Queries { pairs: &pairs, ..queries }, engine, AUDIT_RAYS, STREAMS, &|_| ());
        AuditRays { fraction, chosen, reference }
    }

    /// Compares a run over all queries with the rays.
    pub fn evaluate(&self, run: &MrRun) -> record::IntervalAudit {
        let visible: Vec<f32> = self.chosen.iter().map(|&k| run.run.visible[k]).collect();
        let intervals: Vec<(f32, f32)> = self.chosen.iter().map(|&k| run.intervals[k]).collect();
        self.compare(&visible, &intervals)
    }

    /// [`AuditRays::evaluate`] for answers to the chosen queries alone.
    fn compare(&self, visible: &[f32], intervals: &[(f32, f32)]) -> record::IntervalAudit {
        let squares = self.reference.squares(visible);
        let claims: Vec<f64> =
            intervals.iter().map(|&(lo, hi)| f64::from(hi - lo) / (2.0 * NORMAL_95)).collect();
        let n = intervals.len();
        let coverage = self.reference.coverage(visible, intervals);
        let (coverage_lo, coverage_hi) = wilson(coverage as f32, n.max(1) as f32);
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&i, &j| claims[i].total_cmp(&claims[j]).then(i.cmp(&j)));
        let all = bin(&order, &claims, &squares);
        record::IntervalAudit {
            fraction: self.fraction,
            bundles: n,
            rays: self.reference.rays,
            claimed_rms: all.claimed,
            observed_rms: all.observed,
            observed_lo: all.observed_lo,
            observed_hi: all.observed_hi,
            coverage,
            coverage_lo: coverage_lo.into(),
            coverage_hi: coverage_hi.into(),
            bins: bins(&order, &claims).into_iter().map(|part| bin(part, &claims, &squares)).collect(),
        }
    }
}

/// `count` indices below `all`, one at random in each of `count` equal parts.
fn one_of_each(all: usize, count: usize, seed: u64) -> Vec<usize> {
    let mut random = Pcg64Mcg::new(u128::from(seed) ^ 0x0061_7564_6974);
    let count = count.min(all);
    let start = |k: usize| k * all / count;
    let mut within = |k: usize| random.next_u64() as usize % (start(k + 1) - start(k));
    (0..count).map(|k| start(k) + within(k)).collect()
}

/// Divides an order by claim into parts of about equal length; equal claims stay together.
fn bins<'a>(order: &'a [usize], claims: &[f64]) -> Vec<&'a [usize]> {
    let per_bin = order.len().div_ceil(MAX_BINS).max(1);
    let mut bins = Vec::new();
    let mut rest = order;
    while !rest.is_empty() {
        let last = claims[rest[per_bin.min(rest.len()) - 1]];
        let (bin, others) = rest.split_at(rest.partition_point(|&k| claims[k] <= last));
        bins.push(bin);
        rest = others;
    }
    bins
}

/// RMS claim and RMS error of some bundles.
fn bin(part: &[usize], claims: &[f64], squares: &[f64]) -> record::CalibrationBin {
    let n = part.len().max(1) as f64;
    let mean = |f: &dyn Fn(usize) -> f64| part.iter().map(|&k| f(k)).sum::<f64>() / n;
    let own: Vec<f64> = part.iter().map(|&k| squares[k]).collect();
    let found = RmsEstimate::of(&own);
    record::CalibrationBin {
        count: part.len(),
        claimed: mean(&|k| claims[k] * claims[k]).sqrt(),
        observed: found.rms,
        observed_lo: found.lo,
        observed_hi: found.hi,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uniform in `[0, 1)`.
    fn unit(random: &mut Pcg64Mcg) -> f32 {
        (random.next_u64() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// 4,000 synthetic queries: their audit, answers with errors of `error` claimed standard errors, and stated intervals.
    fn synthetic(error: f32) -> (AuditRays, Vec<f32>, Vec<(f32, f32)>) {
        let mut random = Pcg64Mcg::new(7);
        let (mut a, mut b, mut visible, mut intervals) = (vec![], vec![], vec![], vec![]);
        for _ in 0..4000 {
            let reference = unit(&mut random);
            let mut half =
                || (0..AUDIT_RAYS / 2).filter(|_| unit(&mut random) < reference).count() as f32 / 32.0;
            a.push(half());
            b.push(half());
            let claim = 0.02 + 0.1 * unit(&mut random);
            // The sum of twelve uniform numbers is nearly normal.
            let normal = (0..12).map(|_| unit(&mut random)).sum::<f32>() - 6.0;
            let x = reference + error * claim * normal;
            visible.push(x);
            intervals.push((x - 1.96 * claim, x + 1.96 * claim));
        }
        let reference = ExactReference { a, b, rays: AUDIT_RAYS };
        (AuditRays { fraction: 1.0, chosen: (0..4000).collect(), reference }, visible, intervals)
    }

    #[test]
    fn correct_claims_are_confirmed() {
        let (audit, visible, intervals) = synthetic(1.0);
        let found = audit.compare(&visible, &intervals);
        assert_eq!((found.bundles, found.rays), (4000, 64));
        assert!(found.observed_lo < found.claimed_rms && found.claimed_rms < found.observed_hi, "{found:?}");
        assert!(found.observed_hi < 1.2 * found.observed_lo, "the audit is sharp: {found:?}");
        // Calibrated: coverage is 95 %.
        assert!(found.coverage_lo < 0.95 && 0.95 < found.coverage_hi, "{found:?}");
        let inside = |b: &&record::CalibrationBin| b.observed_lo < b.claimed && b.claimed < b.observed_hi;
        assert_eq!(found.bins.len(), MAX_BINS);
        assert!(found.bins.iter().filter(inside).count() >= MAX_BINS - 2, "{:?}", found.bins);
        assert_eq!(found.bins.iter().map(|b| b.count).sum::<usize>(), 4000);
        assert!(found.bins.windows(2).all(|b| b[0].claimed < b[1].claimed));
    }

    #[test]
    fn claims_below_the_error_are_refuted() {
        let (audit, visible, intervals) = synthetic(4.0);
        let found = audit.compare(&visible, &intervals);
        assert!(found.observed_lo > 3.5 * found.claimed_rms, "{found:?}");
        assert!(found.coverage_hi < 0.7 && found.coverage_lo < found.coverage, "{found:?}");
        // Claims of half the true error are detected.
        let (audit, visible, intervals) = synthetic(2.0);
        assert!(audit.compare(&visible, &intervals).coverage_hi < 0.9);
        // Claims of four times the true error hold more often than stated.
        let (audit, visible, intervals) = synthetic(0.25);
        assert!(audit.compare(&visible, &intervals).coverage_lo > 0.96);
    }

    #[test]
    fn places_are_distinct_and_equal_claims_stay_together() {
        for (all, count) in [(1, 1), (10, 10), (1000, 37), (5, 9), (3, 0)] {
            let chosen = one_of_each(all, count, 1);
            assert_eq!(chosen.len(), count.min(all));
            assert!(chosen.windows(2).all(|w| w[0] < w[1]) && chosen.iter().all(|&k| k < all));
        }
        let claims = [0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.3];
        let order: Vec<usize> = (0..10).collect();
        assert_eq!(bins(&order, &claims), [&order[..9], &order[9..]]);
        assert!(bins(&[], &[]).is_empty());
    }
}
