//! Least-squares adjustment of a symmetric exchange matrix to given row sums (`docs/method.md`, Form factors and closure).
//!
//! Every entry is an observation with a standard error, and changes in proportion to its variance: exact entries stay, uncertain
//! ones absorb the missing sum. A factor for each row and column (Sinkhorn scaling, which
//! `radiosity::transport::row_normalisation` uses where entries have no errors of their own) would change exact entries as much as
//! uncertain ones. The problems differ, so the code does.

use super::pair::Row;
use crate::progress::Progress;

/// Relative error of closed forms evaluated at few points; a lower bound of the assumed error of every entry, so that
/// the system of equations is never singular. Of the order of the mean error of row sums, 5e-4, in a block of houses
/// (`constants.py form-factors`).
const MODEL_ERROR: f64 = 1e-3;
/// Relative error of row sums at which the adjustment ends: below the rounding of f32 entries, 2⁻²⁴ = 6e-8.
const TOLERANCE: f64 = 1e-8;
/// Largest number of rounds: limits the time if the limits of entries make the wanted sums unreachable.
const MAX_ROUNDS: usize = 6;
/// Largest number of conjugate-gradient steps per round: limits the time of a round to 200 products with the matrix. Steps that are not
/// made are left to the next round.
const MAX_STEPS: usize = 200;
/// Smallest factor by which a round may reduce an entry: above 0, so that entries stay positive; six rounds can reduce
/// an entry to 1e-6.
const MIN_ENTRY_FACTOR: f64 = 0.1;

/// Changes the exchange areas of pairs so that rows with a wanted sum (`wanted`, length²) have that sum. Returns the
/// number of conjugate-gradient steps.
///
/// Minimises `Σ (δ_ij / σ_ij)²` over all symmetric changes (Gauss' adjustment of observations by their standard
/// errors): `δ_ij = σ_ij² (λ_i + λ_j)`, with one `λ` per row from a positive semi-definite system, solved by conjugate
/// gradients with diagonal preconditioning (Hestenes and Stiefel 1952). Accurate entries hardly change; uncertain ones
/// absorb the missing sum. Entries stay positive; further rounds correct the rest.
///
/// Ends early once `progress` has stopped.
pub fn adjust(upper: &mut [Row], wanted: &[Option<f64>], progress: &dyn Progress) -> usize {
    let mut steps = 0;
    for _ in 0..MAX_ROUNDS {
        let mut sums = vec![0.0; wanted.len()];
        each(upper, |i, j, exchange, _| {
            sums[i] += exchange;
            sums[j] += exchange;
        });
        // Rows without entries cannot be adjusted.
        let missing: Vec<f64> = wanted
            .iter()
            .zip(&sums)
            .map(|(w, &sum)| w.filter(|_| sum > 0.0).map_or(0.0, |w| w - sum))
            .collect();
        let off =
            missing.iter().zip(wanted).filter_map(|(m, w)| w.map(|w| (m / w).abs())).fold(0.0, f64::max);
        if off < TOLERANCE || progress.stopped() {
            break;
        }
        let (lambda, taken) = solve(upper, wanted, &missing, progress);
        steps += taken;
        for (i, row) in upper.iter_mut().enumerate() {
            for k in 0..row.partner.len() {
                let g = f64::from(row.exchange[k]);
                let change = variance(g, row.error[k].into()) * (lambda[i] + lambda[row.partner[k] as usize]);
                row.exchange[k] = (g + change).max(MIN_ENTRY_FACTOR * g) as f32;
            }
        }
    }
    steps
}

fn variance(exchange: f64, error: f64) -> f64 {
    error * error + (MODEL_ERROR * exchange).powi(2)
}

/// Solves `Σ_j σ_ij² (λ_i + λ_j) = missing_i` over the rows with a wanted sum; returns λ and the number of steps.
fn solve(
    upper: &[Row],
    wanted: &[Option<f64>],
    missing: &[f64],
    progress: &dyn Progress,
) -> (Vec<f64>, usize) {
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
    for step in 1..=MAX_STEPS {
        let mut product: Vec<f64> = diagonal.iter().zip(&direction).map(|(d, x)| d * x).collect();
        each(upper, |i, j, exchange, error| {
            let s = variance(exchange, error);
            product[i] += s * direction[j];
            product[j] += s * direction[i];
        });
        (0..n).filter(|&i| !free(i)).for_each(|i| product[i] = 0.0);
        let curvature = dot(&direction, &product);
        if curvature <= 0.0 || progress.stopped() {
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
    (lambda, MAX_STEPS)
}

/// Calls `take` with both facets, exchange area and standard error of every pair, in order.
pub fn each(upper: &[Row], mut take: impl FnMut(usize, usize, f64, f64)) {
    for (i, row) in upper.iter().enumerate() {
        for (k, &j) in row.partner.iter().enumerate() {
            take(i, j as usize, f64::from(row.exchange[k]), f64::from(row.error[k]));
        }
    }
}
