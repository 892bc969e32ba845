//! What answers are judged by: exact rays in two independent halves.

use super::measure::{Questions, chunks, clear_fraction};
use crate::ray::Occluder;
use crate::visibility::Exact;
use rayon::prelude::*;

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
    /// Traces `rays` segments a pair on all threads: the halves are the samples of two `streams`. `advance` is told
    /// how many pairs are done with one of the halves.
    pub fn trace(
        questions: Questions,
        engine: Exact,
        rays: usize,
        streams: [u64; 2],
        advance: &(dyn Fn(usize) + Sync),
    ) -> Reference {
        let half = rays.div_ceil(2);
        let Questions { scene, workload, pairs } = questions;
        let [a, b] = streams.map(|stream| -> Vec<f32> {
            let parts: Vec<Vec<f32>> = chunks(pairs.len(), half)
                .into_par_iter()
                .map_init(
                    || (Vec::new(), Vec::new()),
                    |(packets, blocked), part| {
                        workload.packed(scene, &pairs[part.clone()], half, stream, packets);
                        blocked.clear();
                        blocked.resize(packets.len(), 0);
                        engine.occluded(packets, blocked);
                        advance(part.len());
                        (0..part.len()).map(|k| clear_fraction(blocked, k * half, half)).collect()
                    },
                )
                .collect();
            parts.concat()
        });
        Reference { a, b, rays: 2 * half }
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

    /// Squared errors of estimates, each of them right in the mean only: see [`Reference::errors`]; single ones may be
    /// below 0.
    pub fn squares(&self, visible: &[f32]) -> Vec<f64> {
        let halves = self.a.iter().zip(&self.b);
        visible.iter().zip(halves).map(|(&x, (&a, &b))| f64::from(x - a) * f64::from(x - b)).collect()
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

/// A root mean square and what it is worth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Found {
    /// The root mean square.
    pub rms: f64,
    /// 95 % interval, lower end.
    pub lo: f64,
    /// Upper end.
    pub hi: f64,
}

impl Found {
    /// Of squares that come in independent runs of this length; 1: each is independent.
    pub fn of(squares: &[f64], run: usize) -> Found {
        let means: Vec<f64> =
            squares.chunks(run.max(1)).map(|run| run.iter().sum::<f64>() / run.len() as f64).collect();
        let n = means.len().max(1) as f64;
        let mean = means.iter().sum::<f64>() / n;
        let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        let half = 1.96 * (variance / n).sqrt();
        let root = |square: f64| square.max(0.0).sqrt();
        Found { rms: root(mean), lo: root(mean - half), hi: root(mean + half) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_of_the_reference_drops_out() {
        let reference = Reference { a: vec![0.6, 0.4], b: vec![0.4, 0.6], rays: 2000 };
        assert!((reference.errors(&[0.7, 0.7]).0.powi(2) - 0.03).abs() < 1e-6);
        assert!((reference.errors(&[0.7, 0.7]).1 - 0.2).abs() < 1e-6);
        assert!((reference.standard_error() - 0.1).abs() < 1e-6);
        assert_eq!(reference.coverage(&[(0.4, 0.6), (0.0, 0.0)]), 0.5);
    }
}
