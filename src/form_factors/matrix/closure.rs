//! Adjusting a symmetric matrix of exchange so that closed rows have their sums.

use super::pair::Row;

/// Relative error of closed forms that are means over few points: what is certain otherwise may give in by as much.
const MODEL: f64 = 1e-3;
/// Rows are as close to their sums as this, relative, when the adjustment ends: single precision.
const TOLERANCE: f64 = 1e-8;
/// Rounds and steps of a round after which it ends anyway.
const ROUNDS: usize = 6;
const STEPS: usize = 200;
/// No entry becomes less than this part of itself.
const LEAST: f64 = 0.1;

/// Changes the exchange of pairs so that the rows with a wanted sum have it. Gives the number of steps.
///
/// Of all symmetric changes the one with the least `Σ (δ_ij / σ_ij)²` (Gauss' adjustment of observations by their standard
/// errors): `δ_ij = σ_ij² (λ_i + λ_j)`, with one `λ` a row that solves a positive semi-definite system, by conjugate
/// gradients with diagonal preconditioning (Hestenes and Stiefel 1952). What is known well stays as it is, and what was
/// found by chance takes up what was not found. Entries stay positive; rounds follow for what that leaves.
pub fn adjust(upper: &mut [Row], wanted: &[Option<f64>]) -> usize {
    let mut steps = 0;
    for _ in 0..ROUNDS {
        let mut sums = vec![0.0; wanted.len()];
        each(upper, |i, j, exchange, _| {
            sums[i] += exchange;
            sums[j] += exchange;
        });
        // Rows without entries cannot be mended.
        let missing: Vec<f64> = wanted
            .iter()
            .zip(&sums)
            .map(|(w, &sum)| w.filter(|_| sum > 0.0).map_or(0.0, |w| w - sum))
            .collect();
        let off =
            missing.iter().zip(wanted).filter_map(|(m, w)| w.map(|w| (m / w).abs())).fold(0.0, f64::max);
        if off < TOLERANCE {
            break;
        }
        let (lambda, taken) = solve(upper, wanted, &missing);
        steps += taken;
        for (i, row) in upper.iter_mut().enumerate() {
            for k in 0..row.partner.len() {
                let g = f64::from(row.exchange[k]);
                let change = variance(g, row.error[k].into()) * (lambda[i] + lambda[row.partner[k] as usize]);
                row.exchange[k] = (g + change).max(LEAST * g) as f32;
            }
        }
    }
    steps
}

fn variance(exchange: f64, error: f64) -> f64 {
    error * error + (MODEL * exchange).powi(2)
}

/// Conjugate gradients for `Σ_j σ_ij² (λ_i + λ_j) = missing_i` over the rows that have a wanted sum.
fn solve(upper: &[Row], wanted: &[Option<f64>], missing: &[f64]) -> (Vec<f64>, usize) {
    let n = missing.len();
    let mut diagonal = vec![0.0; n];
    each(upper, |i, j, exchange, error| {
        let s = variance(exchange, error);
        diagonal[i] += s;
        diagonal[j] += s;
    });
    let free = |i: usize| wanted[i].is_some() && diagonal[i] > 0.0;
    let precondition =
        |r: &[f64]| -> Vec<f64> { (0..n).map(|i| if free(i) { r[i] / diagonal[i] } else { 0.0 }).collect() };
    let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
    let mut lambda = vec![0.0; n];
    let mut residual = missing.to_vec();
    let mut preconditioned = precondition(&residual);
    let mut direction = preconditioned.clone();
    let mut square = dot(&residual, &preconditioned);
    let goal = square * TOLERANCE * TOLERANCE;
    for step in 1..=STEPS {
        let mut product: Vec<f64> = diagonal.iter().zip(&direction).map(|(d, x)| d * x).collect();
        each(upper, |i, j, exchange, error| {
            let s = variance(exchange, error);
            product[i] += s * direction[j];
            product[j] += s * direction[i];
        });
        (0..n).filter(|&i| !free(i)).for_each(|i| product[i] = 0.0);
        let curvature = dot(&direction, &product);
        if curvature <= 0.0 {
            return (lambda, step);
        }
        let length = square / curvature;
        for i in 0..n {
            lambda[i] += length * direction[i];
            residual[i] -= length * product[i];
        }
        preconditioned = precondition(&residual);
        let next = dot(&residual, &preconditioned);
        if next <= goal {
            return (lambda, step);
        }
        for (d, p) in direction.iter_mut().zip(&preconditioned) {
            *d = p + next / square * *d;
        }
        square = next;
    }
    (lambda, STEPS)
}

/// Calls `take` with both facets, exchange and error of every pair, in order.
pub fn each(upper: &[Row], mut take: impl FnMut(usize, usize, f64, f64)) {
    for (i, row) in upper.iter().enumerate() {
        for (k, &j) in row.partner.iter().enumerate() {
            take(i, j as usize, f64::from(row.exchange[k]), f64::from(row.error[k]));
        }
    }
}
