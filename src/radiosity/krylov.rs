//! The light of a [`System`].

use super::Settled;
use super::clock::Clock;
use super::field::Rgb;
use super::system::{Field, System};
use rayon::prelude::*;

/// Residual at which a solution is good, relative to what emitters send (root mean squares by area), and iterations at
/// most.
const SETTLED: f64 = 1e-4;
const ITERATIONS: usize = 100;
/// Iterations however late it is; more where they are quick: so many rays over all iterations.
const LEAST: usize = 3;
const QUICK: usize = 50_000_000;
/// Terms that are summed up in a row: sums do not depend on threads.
const BLOCK: usize = 4096;

impl System {
    /// The irradiance for what emitters send, from a first guess, and how good it is.
    ///
    /// The stabilised bi-conjugate gradients of van der Vorst (1992), each channel by itself: what the rows lack is made up on
    /// one side only. Sweeps that take turns, of whatever order, need hundreds where light is caught between white
    /// surfaces; a Krylov space has these few slow modes after a few steps. Where its recurrence breaks down, it begins
    /// anew from the best solution so far; that is also what is left if it does not converge, or has to stop.
    pub fn solve(&self, direct: &Field, start: Field, clock: &Clock) -> (Field, Settled) {
        let want = self.dot(direct, direct).map(|d| d * SETTLED * SETTLED);
        let mut settled = Settled { sweeps: 1, residual: f64::INFINITY, converged: false };
        let mut best = start;
        let mut space = Space::new(self, direct, best.clone());
        let mut sound = true;
        let least = (QUICK / self.joined().max(1)).clamp(LEAST, ITERATIONS);
        for iteration in 0..ITERATIONS {
            let left = self.dot(&space.r, &space.r);
            let worst = (0..3).map(|k| left[k] / want[k].max(f64::MIN_POSITIVE)).fold(0.0, f64::max);
            let residual = SETTLED * worst.sqrt();
            if residual < settled.residual && left.iter().all(|l| l.is_finite()) {
                settled.residual = residual;
                best.clone_from(&space.x);
            }
            let done: [bool; 3] = std::array::from_fn(|k| left[k] <= want[k]);
            settled.converged = done == [true; 3];
            if settled.converged || (iteration >= least && clock.late()) {
                break;
            }
            if !sound {
                settled.sweeps += 1;
                space = Space::new(self, direct, best.clone());
            }
            settled.sweeps += 2;
            sound = space.advance(self, done);
        }
        // Factors are not negative, and neither is light: what rounding leaves below zero in the dark is nothing.
        (best.into_par_iter().map(|e| e.map(|v| v.max(0.0))).collect(), settled)
    }

    fn dot(&self, a: &Field, b: &Field) -> Rgb {
        let parts: Vec<Rgb> = (0..a.len().div_ceil(BLOCK))
            .into_par_iter()
            .map(|block| {
                let range = block * BLOCK..((block + 1) * BLOCK).min(a.len());
                let mut sum = [0.0; 3];
                for i in range {
                    (0..3).for_each(|k| sum[k] += self.area[i] * a[i][k] * b[i][k]);
                }
                sum
            })
            .collect();
        parts.iter().fold([0.0; 3], |sum, part| std::array::from_fn(|k| sum[k] + part[k]))
    }
}

/// Where the iteration is.
struct Space {
    x: Field,
    /// Residual, search direction, and the shadow of the first residual.
    r: Field,
    p: Field,
    shadow: Field,
    rho: Rgb,
}

impl Space {
    fn new(system: &System, direct: &Field, x: Field) -> Space {
        let r = combined(direct, &[([-1.0; 3], &system.apply(&x))]);
        let rho = system.dot(&r, &r);
        Space { x, p: r.clone(), shadow: r.clone(), r, rho }
    }

    /// One step; whether it can go on, `done` by channel.
    fn advance(&mut self, system: &System, done: [bool; 3]) -> bool {
        let v = system.apply(&self.p);
        let alpha = divide(self.rho, system.dot(&self.shadow, &v));
        let s = combined(&self.r, &[(alpha.map(|a| -a), &v)]);
        let t = system.apply(&s);
        let omega = divide(system.dot(&t, &s), system.dot(&t, &t));
        self.x = combined(&self.x, &[(alpha, &self.p), (omega, &s)]);
        self.r = combined(&s, &[(omega.map(|o| -o), &t)]);
        let next = system.dot(&self.shadow, &self.r);
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
    a.par_iter()
        .enumerate()
        .with_min_len(BLOCK)
        .map(|(i, a)| std::array::from_fn(|k| more.iter().fold(a[k], |sum, (c, b)| sum + c[k] * b[i][k])))
        .collect()
}

/// By channel; 0 where a channel has come to rest.
fn divide(a: Rgb, b: Rgb) -> Rgb {
    std::array::from_fn(|k| if b[k] == 0.0 { 0.0 } else { a[k] / b[k] })
}

#[cfg(test)]
mod tests {
    use super::super::options::Rows;
    use super::super::system::Place;
    use super::*;
    use crate::radiosity::links::numbers;

    /// Two rooms of white walls, joined by a door: every `DOOR`th ray goes through.
    fn rooms(n: u32, rays: u32, reflectance: f32) -> System {
        const DOOR: u64 = 50;
        let met: Vec<u32> = (0..u64::from(n * rays))
            .map(|k| {
                let [u, ..] = numbers(7, k);
                let room = u32::from((k / u64::from(rays)) as u32 >= n / 2) ^ u32::from(k % DOOR == 0);
                room * (n / 2) + (u * (n / 2) as f32) as u32
            })
            .collect();
        let places: Vec<Place> = (1..=n as usize)
            .map(|i| Place { area: 1.0, reflectance: [reflectance; 3], end: i * rays as usize, closed: true })
            .collect();
        System::new(&places, &met, Rows::Balanced, &Clock::start(&(), None))
    }

    #[test]
    fn a_furnace_has_the_same_light_everywhere() {
        let system = rooms(200, 64, 0.95);
        let solve = |direct: f64| {
            system.solve(&vec![[direct; 3]; 200], vec![[0.0; 3]; 200], &Clock::start(&(), None))
        };
        let (found, settled) = solve(1.0);
        assert!(settled.converged && settled.residual <= SETTLED, "{settled:?}");
        assert!(found.iter().flatten().all(|e| (e / 20.0 - 1.0).abs() < 1e-3), "{found:?}");
        assert!(solve(0.0).0.iter().flatten().all(|&e| e == 0.0));
    }

    /// Rows that give back more than they get have no light that would be a solution; what is written is finite, and the
    /// record says that it is not converged.
    #[test]
    fn what_does_not_converge_says_so() {
        let system = rooms(200, 64, 1.5);
        let direct: Field = (0..200).map(|i| [f64::from(u8::from(i < 10)), 0.0, f64::NAN]).collect();
        let (found, settled) = system.solve(&direct, vec![[0.0; 3]; 200], &Clock::start(&(), None));
        assert!(!settled.converged && found.iter().flatten().all(|e| e.is_finite()), "{settled:?}");
    }

    /// Why the light is not found by relaxing rows one at a time, be they in turn (Gauss and Seidel) or that with the
    /// largest residual first (Southwell): both look at more rays in white rooms, and neither can use two threads.
    #[test]
    fn krylov_takes_less_work_than_southwell_and_gauss_seidel() {
        let (n, rays) = (200usize, 64usize);
        let system = rooms(n as u32, rays as u32, 0.97);
        let direct: Field = (0..n).map(|i| [f64::from(u8::from(i < 10)); 3]).collect();
        let (found, settled) = system.solve(&direct, vec![[0.0; 3]; n], &Clock::start(&(), None));
        let krylov = settled.sweeps * system.joined();
        // In columns: who gets what from j.
        let mut columns = vec![Vec::new(); n];
        for i in 0..n {
            for (j, factor) in system.form_factors(i) {
                columns[j as usize].push((i, factor));
            }
        }
        let settled = |r: &[f64]| r.iter().map(|v| v * v).sum::<f64>() <= 10.0 * SETTLED * SETTLED;
        let relax = |i: usize, x: &mut [f64], r: &mut [f64]| {
            let d = std::mem::take(&mut r[i]);
            x[i] += d;
            columns[i].iter().for_each(|&(j, factor)| r[j] += 0.97 * d * factor);
            columns[i].len()
        };
        let run = |southwell: bool| {
            let (mut x, mut r) = (vec![0.0; n], direct.iter().map(|d| d[0]).collect::<Vec<f64>>());
            let mut work = 0;
            for step in 0.. {
                let largest = || (0..n).max_by(|&a, &b| r[a].total_cmp(&r[b])).unwrap_or(0);
                let i = if southwell { largest() } else { step % n };
                work += relax(i, &mut x, &mut r);
                if settled(&r) {
                    break;
                }
            }
            assert!((0..n).all(|i| (x[i] / found[i][0] - 1.0).abs() < 1e-2));
            work
        };
        let (southwell, seidel) = (run(true), run(false));
        assert!(4 * krylov < southwell && 4 * krylov < seidel, "{krylov} {southwell} {seidel}");
    }
}
