//! Scaling a symmetric matrix of exchange so that closed rows have their sums.

/// Rows are as close to their sums as this when the scaling stops.
const TOLERANCE: f64 = 1e-9;
/// Steps after which it stops anyway.
const MAX_STEPS: usize = 200;

/// Scales `G_ij` to `d_i G_ij d_j` so that the rows with a wanted sum have it; others keep `d = 1`. The rows and columns
/// of the matrix belong together, so that it stays symmetric. `product(d)` gives the rows' sums `Σ_j G_ij d_j`.
///
/// The scaling factors are those of Knight and Ruiz (2013) by simple iteration with the square root (Ruiz 2001), which
/// converges for symmetric matrices. Gives the factors and the number of steps.
pub fn factors(wanted: &[Option<f64>], product: impl Fn(&[f64]) -> Vec<f64>) -> (Vec<f64>, usize) {
    let mut d = vec![1.0; wanted.len()];
    for step in 1..=MAX_STEPS {
        let sums = product(&d);
        let mut worst = 0f64;
        for ((d, want), sum) in d.iter_mut().zip(wanted).zip(&sums) {
            let Some(want) = want else { continue };
            let now = *d * sum;
            // A row without entries cannot be scaled to anything.
            if now > 0.0 {
                worst = worst.max((now / want - 1.0).abs());
                *d *= (want / now).sqrt();
            }
        }
        if worst < TOLERANCE {
            return (d, step);
        }
    }
    (d, MAX_STEPS)
}
