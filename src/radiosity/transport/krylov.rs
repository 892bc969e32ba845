//! Stabilised bi-conjugate gradients for the transport equation.

use super::{Convergence, Field, RayTransport};
use crate::math::parallel;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::rgb::Rgb;

/// Residual relative to direct light (root mean squares by weight) at which a solution has converged. 1e-3 instead
/// changes irradiance by 0.03 %, 1e-5 by 0.003 % (`constants.py solve`).
const TOLERANCE: f64 = 1e-4;
/// Largest number of iterations: limits the time to 200 products with the matrix if the iteration does not converge.
const MAX_ITERATIONS: usize = 100;
/// Smallest number of iterations of one solution, and of passes along paths, that are made even after the deadline. Changes results
/// with a time limit only.
const MIN_ITERATIONS: usize = 3;
/// Terms that iterations and passes may read after the deadline if this allows more of them: limits the delay of either to a fraction
/// of a second. Changes results with a time limit only.
const LATE_TERMS: usize = 50_000_000;
/// Terms of the matrix that take as much memory traffic as the vectors of one unknown in one iteration: some 16 reads and writes of
/// 24 bytes against 20 bytes that an entry reads in each of two products.
const TERMS_OF_VECTORS: usize = 10;
/// Terms of one partial sum: partial sums do not depend on the number of threads.
const BLOCK: usize = 4096;

/// Fraction of the light of the scene that a pass along paths may add for the passes to end: a twentieth of the error that is asked for
/// by default. More is missing where passes converge slowly.
const MAX_MISSING: f64 = 1e-3;
/// Largest number of passes along paths: if each returns 0.9 of the light of the one before, 0.9^64 = 0.1 % of it is missing.
const MAX_PASSES: usize = 64;

/// The light along rays and paths: solves the exchange along rays, adds the light along paths as direct light, and repeats both until a
/// pass adds little. One system with the paths as further terms would be exact, but the noise of few rays can join groups of elements to
/// few others, which then trap their light: single points of an office were several times too bright. A limited number of passes does not
/// build up such light.
///
/// After the deadline, passes continue as far as [`LATE_TERMS`] allow, at least [`MIN_ITERATIONS`] of them.
pub fn solve(
    transport: &mut RayTransport,
    start: Option<Field>,
    deadline: &Deadline,
) -> (Field, Convergence) {
    // Paths first bring the light of the guess.
    if let Some(start) = &start {
        transport.bring(&[start.clone(), start.clone()]);
    }
    let (mut first, mut convergence) = krylov(transport, start, deadline);
    if !transport.has_paths() {
        return (first, convergence);
    }
    let (mut before, mut added, mut late_terms) = (0.0, 1.0, 0);
    for pass in 0..MAX_PASSES {
        let light = transport.both(first.clone());
        let power: f64 = dot(transport, &light[0], &vec![[1.0; 3]; light[0].len()]).iter().sum();
        if (power - before).abs() <= MAX_MISSING * power {
            return (first, convergence);
        }
        added = (1.0 - before / power).abs();
        if pass >= MIN_ITERATIONS && late_terms > LATE_TERMS && deadline.late() {
            break;
        }
        before = power;
        transport.bring(&light);
        let found;
        (first, found) = krylov(transport, Some(first), deadline);
        late_terms += if deadline.late() { found.sweeps * terms(transport) } else { 0 };
        convergence = Convergence { sweeps: convergence.sweeps + found.sweeps, ..found };
    }
    (first, Convergence { residual: added, converged: false, ..convergence })
}

/// The irradiance `E = direct + K E` along rays, from a first guess, and how the iteration converged. Without a guess it begins with
/// direct light.
///
/// The stabilised bi-conjugate gradients of van der Vorst (1992), each channel by itself; the product of two halves of
/// rays is not symmetric. Sweeps need hundreds of applications where light is trapped between white surfaces; a Krylov space contains
/// these few slow modes after a few iterations. Where the recurrence breaks down, the iteration restarts from the best solution
/// so far, which is also the result if the iteration does not converge or has to stop.
pub fn krylov(transport: &RayTransport, start: Option<Field>, deadline: &Deadline) -> (Field, Convergence) {
    let direct = &transport.direct();
    let want = dot(transport, direct, direct).map(|d| d * TOLERANCE * TOLERANCE);
    let mut convergence = Convergence { sweeps: 1, residual: f64::INFINITY, converged: false };
    let mut best = start.unwrap_or_else(|| direct.clone());
    let mut space = Space::new(transport, direct, best.clone());
    let mut sound = true;
    let min_iterations = (LATE_TERMS / terms(transport).max(1)).clamp(MIN_ITERATIONS, MAX_ITERATIONS);
    for iteration in 0..MAX_ITERATIONS {
        let left = dot(transport, &space.r, &space.r);
        let worst = (0..3).map(|k| left[k] / want[k].max(f64::MIN_POSITIVE)).fold(0.0, f64::max);
        let residual = TOLERANCE * worst.sqrt();
        if residual < convergence.residual && left.iter().all(|l| l.is_finite()) {
            convergence.residual = residual;
            best.clone_from(&space.x);
        }
        let done: [bool; 3] = std::array::from_fn(|k| left[k] <= want[k]);
        convergence.converged = done == [true; 3];
        if convergence.converged || (iteration >= min_iterations && deadline.late()) {
            break;
        }
        if !sound {
            convergence.sweeps += 1;
            space = Space::new(transport, direct, best.clone());
        }
        convergence.sweeps += 2;
        sound = space.advance(transport, done);
    }
    (best, convergence)
}

/// Terms that take as much time as an iteration, its vectors included.
fn terms(transport: &RayTransport) -> usize {
    transport.terms() + TERMS_OF_VECTORS * transport.weights().len()
}

/// `x - K x`.
fn apply(transport: &RayTransport, x: &Field) -> Field {
    let mut result = transport.reflected(x);
    parallel::for_each_chunk_mut(&mut result, BLOCK, |block, part| {
        for (y, x) in part.iter_mut().zip(&x[block * BLOCK..]) {
            *y = std::array::from_fn(|k| x[k] - y[k]);
        }
    });
    result
}

/// Weighted inner product by channel.
fn dot(transport: &RayTransport, a: &Field, b: &Field) -> Rgb {
    let weights = transport.weights();
    let parts: Vec<Rgb> = parallel::map(0..a.len().div_ceil(BLOCK), |block| {
        let range = block * BLOCK..((block + 1) * BLOCK).min(a.len());
        let mut sum = [0.0; 3];
        for i in range {
            (0..3).for_each(|k| sum[k] += weights[i] * a[i][k] * b[i][k]);
        }
        sum
    });
    parts.iter().fold([0.0; 3], |sum, part| std::array::from_fn(|k| sum[k] + part[k]))
}

/// State of the iteration.
struct Space {
    x: Field,
    /// Residual, search direction, and the first residual (the shadow residual).
    r: Field,
    p: Field,
    shadow: Field,
    rho: Rgb,
}

impl Space {
    fn new(transport: &RayTransport, direct: &Field, x: Field) -> Space {
        let r = combined(direct, &[([-1.0; 3], &apply(transport, &x))]);
        let rho = dot(transport, &r, &r);
        Space { x, p: r.clone(), shadow: r.clone(), r, rho }
    }

    /// One iteration. Returns whether the recurrence can continue; `done` marks the channels that have converged.
    fn advance(&mut self, transport: &RayTransport, done: [bool; 3]) -> bool {
        let v = apply(transport, &self.p);
        let alpha = divide(self.rho, dot(transport, &self.shadow, &v));
        let s = combined(&self.r, &[(alpha.map(|a| -a), &v)]);
        let t = apply(transport, &s);
        let omega = divide(dot(transport, &t, &s), dot(transport, &t, &t));
        self.x = combined(&self.x, &[(alpha, &self.p), (omega, &s)]);
        self.r = combined(&s, &[(omega.map(|o| -o), &t)]);
        let next = dot(transport, &self.shadow, &self.r);
        let beta: Rgb = std::array::from_fn(|k| divide(next, self.rho)[k] * divide(alpha, omega)[k]);
        let sound = (0..3).all(|k| {
            let product = next[k] * beta[k];
            product.is_finite() && (done[k] || product != 0.0)
        });
        self.rho = next;
        self.p = combined(&self.r, &[(beta, &self.p), (std::array::from_fn(|k| -beta[k] * omega[k]), &v)]);
        sound
    }
}

/// `a + Σ c b`.
fn combined(a: &Field, more: &[(Rgb, &Field)]) -> Field {
    parallel::map(parallel::at_least(BLOCK, 0..a.len()), |i| {
        std::array::from_fn(|k| more.iter().fold(a[i][k], |sum, (c, b)| sum + c[k] * b[i][k]))
    })
}

/// Quotient by channel; 0 for a channel that has converged.
fn divide(a: Rgb, b: Rgb) -> Rgb {
    std::array::from_fn(|k| if b[k] == 0.0 { 0.0 } else { a[k] / b[k] })
}

#[cfg(test)]
mod tests {
    use super::super::transport_matrix::{MatrixRow, TransportMatrix};
    use super::*;
    use crate::math::sampling::numbers;
    use crate::ranks::Ranks;

    /// A room of rows that reflect more than they receive has no solution: the result is finite and not marked as converged.
    #[test]
    fn what_does_not_converge_says_so() {
        let (n, rays) = (200u32, 32u32);
        let of_row = |i: usize| {
            let (area, reflectance, end) = (1.0, [1.5; 3], i * rays as usize);
            MatrixRow { area, reflectance, end, closed: true, escapes: 0.0, apart: 0 }
        };
        let rows: Vec<MatrixRow> = (1..=n as usize).map(of_row).collect();
        let half = |half: u64| {
            let to = |k: u64| (numbers(7 + half, k)[0] * n as f32) as u32;
            let met: Vec<u32> = (0..u64::from(n * rays)).map(to).collect();
            TransportMatrix::new(&rows, &met, &Ranks::default()).balanced(&rows, &met)
        };
        let direct = || (0..n).map(|i| [f64::from(u8::from(i < 10)), 0.0, f64::NAN]).collect();
        let transport = RayTransport::new([0, 1].map(half), [Vec::new(), Vec::new()], [direct(), direct()]);
        let (found, convergence) = krylov(&transport, Some(vec![[0.0; 3]; 200]), &Deadline::start(&(), None));
        assert!(!convergence.converged && found.iter().flatten().all(|e| e.is_finite()), "{convergence:?}");
    }
}
