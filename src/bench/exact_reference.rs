//! Independent reference of the answers: many exact rays per pair, in two independent halves.

use super::measure::{Queries, chunks, clear_fraction};
use crate::math::NORMAL_95;
use crate::math::parallel;
use crate::ray::Occluder;
use crate::visibility::Exact;

/// Two independent estimates of each pair's visible fraction, half of the rays each.
#[derive(Clone, Debug)]
pub struct ExactReference {
    /// Estimates of the first half.
    pub a: Vec<f32>,
    /// Estimates of the second half, with other samples.
    pub b: Vec<f32>,
    /// Rays per pair of both halves together.
    pub rays: usize,
}

impl ExactReference {
    /// Traces `rays` segments per pair on all threads; the halves use the samples of two `streams`. `advance` gets
    /// the number of pairs done with one half.
    pub fn trace(
        queries: Queries,
        engine: &Exact,
        rays: usize,
        streams: [u64; 2],
        advance: &(dyn Fn(usize) + Sync),
    ) -> ExactReference {
        let half = rays.div_ceil(2);
        let Queries { scene, workload, pairs } = queries;
        let [a, b] = streams.map(|stream| -> Vec<f32> {
            let parts: Vec<Vec<f32>> = parallel::map_with(
                &chunks(pairs.len(), half),
                || (Vec::new(), Vec::new()),
                |(packets, blocked), part| {
                    packets.clear();
                    workload.pack(scene, &pairs[part.clone()], half, stream, packets);
                    blocked.clear();
                    blocked.resize(packets.len(), 0);
                    engine.occluded(packets, blocked);
                    advance(part.len());
                    (0..part.len()).map(|k| clear_fraction(blocked, k * half, half)).collect()
                },
            );
            parts.concat()
        });
        ExactReference { a, b, rays: 2 * half }
    }

    /// Mean of both halves.
    pub fn mean(&self, pair: usize) -> f32 {
        0.5 * (self.a[pair] + self.b[pair])
    }

    /// Standard error of [`ExactReference::mean`] (root mean square over the pairs): half the RMS difference of the halves.
    pub fn standard_error(&self) -> f64 {
        let sum: f64 = self.a.iter().zip(&self.b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        0.5 * (sum / self.a.len().max(1) as f64).sqrt()
    }

    /// Unbiased estimates of the squared errors; single ones may be negative. See [`ExactReference::errors`].
    pub fn squares(&self, visible: &[f32]) -> Vec<f64> {
        let halves = self.a.iter().zip(&self.b);
        visible.iter().zip(halves).map(|(&x, (&a, &b))| f64::from(x - a) * f64::from(x - b)).collect()
    }

    /// RMS error and mean error of estimates.
    ///
    /// E[(x − a)(x − b)] = (x − E[a])² because a and b are independent: the noise of the reference cancels.
    pub fn errors(&self, visible: &[f32]) -> (f64, f64) {
        let n = visible.len().max(1) as f64;
        let (mut square, mut bias) = (0.0, 0.0);
        for ((&x, &a), &b) in visible.iter().zip(&self.a).zip(&self.b) {
            square += f64::from(x - a) * f64::from(x - b);
            bias += f64::from(x) - 0.5 * f64::from(a + b);
        }
        ((square / n).max(0.0).sqrt(), bias / n)
    }

    /// Fraction of the answers whose intervals the reference confirms; see [`agrees`].
    pub fn coverage(&self, visible: &[f32], intervals: &[(f32, f32)]) -> f64 {
        let answers = visible.iter().zip(intervals).enumerate();
        let agree = answers.filter(|&(k, (&x, &interval))| agrees(x, interval, self.mean(k), self.rays));
        agree.count() as f64 / intervals.len().max(1) as f64
    }
}

/// Whether the mean `p` of `rays` independent rays confirms an answer `x` with the stated 95 % interval `[lo, hi]`.
///
/// ```text
/// |p − x| ≤ √(h² + 1.96² q (1 − q) / rays)      h = x − lo or hi − x, on p's side;  q = p clamped to [lo, hi]
/// ```
///
/// The answer claims a standard error of h / 1.96; the mean has √(q (1 − q) / rays). Both are independent, so correct intervals are
/// confirmed in 95 of 100 cases for any number of rays. One ray refutes a certificate (lo = hi = 0 or 1).
pub fn agrees(x: f32, (lo, hi): (f32, f32), p: f32, rays: usize) -> bool {
    /// Rounding of f32 intervals that end at 0 or 1.
    const ROUNDING: f64 = 1e-6;
    let [x, lo, hi, p] = [x, lo, hi, p].map(f64::from);
    let half = if p < x { x - lo } else { hi - x };
    let q = p.clamp(lo.min(hi), hi);
    let noise = 1.96f64.powi(2) * (q * (1.0 - q)).max(0.0) / rays.max(1) as f64;
    (p - x).abs() <= (half * half + noise).sqrt() + ROUNDING
}

/// A root mean square and its 95 % interval.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RmsEstimate {
    /// The root mean square.
    pub rms: f64,
    /// 95 % interval, lower end.
    pub lo: f64,
    /// 95 % interval, upper end.
    pub hi: f64,
}

impl RmsEstimate {
    /// RMS of independent squared errors, at most 1 each.
    ///
    /// The interval is Student's for the mean square. A single square gives no interval: [0, 1]. If all squares are the same, the rule of
    /// three bounds the fraction of deviating squares by 3 / N with 95 % (N squares, deviations of at most 1).
    pub fn of(squares: &[f64]) -> RmsEstimate {
        let n = squares.len().max(1) as f64;
        let mean = squares.iter().sum::<f64>() / n;
        let root = |square: f64| square.clamp(0.0, 1.0).sqrt();
        if squares.len() < 2 {
            return RmsEstimate { rms: root(mean), lo: 0.0, hi: 1.0 };
        }
        let variance = squares.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let half = match variance > 0.0 {
            true => student(squares.len() - 1) * (variance / n).sqrt(),
            false => 3.0 / squares.len() as f64,
        };
        RmsEstimate { rms: root(mean), lo: root(mean - half), hi: root(mean + half) }
    }
}

/// Quantile of Student's t distribution for a 95 % interval: the table for up to four degrees of freedom, then the
/// expansion of Cornish and Fisher (Abramowitz and Stegun 26.7.5).
fn student(freedom: usize) -> f64 {
    /// Quantiles for 1 to 4 degrees of freedom.
    const SMALL_SAMPLE_QUANTILES: [f64; 4] = [12.706, 4.303, 3.182, 2.776];
    let v = freedom as f64;
    let first = (NORMAL_95.powi(3) + NORMAL_95) / 4.0;
    let second = (5.0 * NORMAL_95.powi(5) + 16.0 * NORMAL_95.powi(3) + 3.0 * NORMAL_95) / 96.0;
    let third = (3.0 * NORMAL_95.powi(7) + 19.0 * NORMAL_95.powi(5) + 17.0 * NORMAL_95.powi(3)
        - 15.0 * NORMAL_95)
        / 384.0;
    match freedom {
        0 => f64::INFINITY,
        1..=4 => SMALL_SAMPLE_QUANTILES[freedom - 1],
        _ => NORMAL_95 + first / v + second / (v * v) + third / v.powi(3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_of_the_reference_drops_out() {
        let reference = ExactReference { a: vec![0.6, 0.4], b: vec![0.4, 0.6], rays: 2000 };
        assert!((reference.errors(&[0.7, 0.7]).0.powi(2) - 0.03).abs() < 1e-6);
        assert!((reference.errors(&[0.7, 0.7]).1 - 0.2).abs() < 1e-6);
        assert!((reference.standard_error() - 0.1).abs() < 1e-6);
        assert_eq!(reference.coverage(&[0.5, 0.0], &[(0.4, 0.6), (0.0, 0.0)]), 0.5);
    }

    #[test]
    fn one_ray_refutes_a_certificate() {
        assert!(agrees(1.0, (1.0, 1.0), 1.0, 64) && agrees(0.0, (0.0, 0.0), 0.0, 64));
        assert!(!agrees(1.0, (1.0, 1.0), 1023.0 / 1024.0, 1024) && !agrees(0.0, (0.0, 0.0), 1.0 / 64.0, 64));
        // Interval half width 0.1 and noise 1.96 · 0.0625 of the rays add as squares: 0.158.
        assert!(agrees(0.4, (0.3, 0.5), 0.557, 64) && !agrees(0.4, (0.3, 0.5), 0.56, 64));
    }

    #[test]
    fn intervals_are_wide_for_few_samples() {
        // One gives no interval; two give a wide one.
        let one = RmsEstimate::of(&[0.04]);
        assert_eq!((one.lo, one.hi), (0.0, 1.0));
        assert!((one.rms - 0.2).abs() < 1e-12);
        assert_eq!(RmsEstimate::of(&[]).hi, 1.0);
        let two = RmsEstimate::of(&[0.03, 0.05]);
        assert!(two.lo == 0.0 && (two.hi.powi(2) - (0.04 + 12.706 * 0.01)).abs() < 1e-9, "{two:?}");
        // No error in 300 pairs: at most 1 pair of 100 has an error of 1.
        let none = RmsEstimate::of(&[0.0; 300]);
        assert!(none.rms == 0.0 && none.lo == 0.0 && (none.hi - 0.1).abs() < 1e-9, "{none:?}");
    }

    /// Student's table: 2.571 for 5 degrees of freedom, 2.228 for 10, 2.042 for 30.
    #[test]
    fn quantiles_are_those_of_the_table() {
        for (freedom, quantile) in [(1, 12.706), (5, 2.571), (10, 2.228), (30, 2.042), (100_000, 1.960)] {
            assert!((student(freedom) - quantile).abs() < 0.01, "{freedom}: {}", student(freedom));
        }
    }
}
