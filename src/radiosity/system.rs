//! Light between elements that rays join.

use super::clock::Clock;
use super::field::{Rgb, add};
use super::options::Rows;
use rayon::prelude::*;

/// Rows that one task takes.
const CHUNK: usize = 256;
/// Most rounds of balancing, the mean error of the row sums, as part of them, at which it ends, and the factors that it may
/// come to: what faces that lie in one plane both claim cannot be balanced.
const ROUNDS: usize = 16;
const BALANCED: f64 = 1e-3;
/// Powers of what is missing that factors are multiplied with, in turn: Chebyshev's, for rows that differ from their
/// neighbours by an eighth or more of what they differ by themselves.
const POWERS: [f64; 4] = [0.517, 0.685, 1.27, 3.16];
const FACTORS: [f32; 2] = [1e-3, 8.0];

/// A value a place, RGB.
pub(super) type Field = Vec<Rgb>;

/// Exchange of light between places, by the rays that join them.
///
/// Rays leave place i at random over its area and with the cosine, `r_i` of them for each unit of area. A ray of i that
/// ends on j and one of j that ends on i sample the same exchange `X_ij = A_i F_ij = A_j F_ji`, so both count for both ends,
/// with the weight `1/(r_i + r_j)` (balance heuristic, Veach and Guibas 1995): `X` is symmetric whatever chance does.
/// Its row sums are right on average only; those of the scaled `d_i X_ij d_j` are what is known of them: 1 where no ray
/// is lost (method E.7).
///
/// `E_i - g_i d_i/A_i Σ_j X_ij d_j ρ_j E_j` is what emitters send to i.
pub struct System {
    /// Ends of the rows.
    ends: Vec<usize>,
    /// By row, the places at the other ends of its rays, and of those that it is met by.
    others: Vec<u32>,
    /// Rays for each unit of area.
    density: Vec<f32>,
    /// Reflectance of the places, RGB.
    reflectance: Vec<[f32; 3]>,
    /// Areas.
    pub(super) area: Vec<f64>,
    /// `d` and `g`.
    factors: Vec<f32>,
    rests: Vec<f32>,
}

/// What [`System::new`] needs to know of a place.
pub struct Place {
    /// Area, scene units squared.
    pub area: f64,
    /// Reflectance, RGB.
    pub reflectance: [f32; 3],
    /// End of its rays among all.
    pub end: usize,
    /// Nothing that leaves it leaves the scene, as more rays than its own say.
    pub closed: bool,
}

impl System {
    /// For places and the places that their rays met, `u32::MAX` for none. Row sums are mended as `rows` says.
    pub fn new(places: &[Place], met: &[u32], rows: Rows, clock: &Clock) -> System {
        let n = places.len();
        let rays = |i: usize| places[i].end - if i > 0 { places[i - 1].end } else { 0 };
        let (ends, others) = both_ways(places, met);
        let mut system = System {
            ends,
            others,
            density: (0..n).map(|i| (rays(i) as f64 / places[i].area) as f32).collect(),
            reflectance: places.iter().map(|p| p.reflectance).collect(),
            area: places.iter().map(|p| p.area).collect(),
            factors: vec![1.0; n],
            rests: vec![1.0; n],
        };
        let want: Vec<f64> = (0..n)
            .map(|i| {
                let own = &met[places[i].end - rays(i)..places[i].end];
                system.row(i, places[i].closed, own.len(), own.iter().filter(|&&j| j != u32::MAX).count())
            })
            .collect();
        system.balance(&want, rows, clock);
        system
    }

    /// Mean difference of `A_i F_ij` and `A_j F_ji` as part of them.
    pub fn reciprocity(&self) -> f64 {
        let (mut differ, mut all) = (0.0, 0.0);
        for ((row, rest), area) in self.rows().into_iter().zip(&self.rests).zip(&self.area) {
            (differ, all) = (differ + area * row * f64::from((1.0 / rest - 1.0).abs()), all + area * row);
        }
        if all > 0.0 { differ / all } else { 0.0 }
    }

    /// The row sums.
    pub fn rows(&self) -> Vec<f64> {
        self.row_sums().into_iter().zip(&self.rests).map(|(sum, rest)| sum * f64::from(*rest)).collect()
    }

    /// The row sum of i, by what became of its rays and by those that met it, each as sure as it is.
    fn row(&self, i: usize, closed: bool, rays: usize, met: usize) -> f64 {
        if closed && met == rays {
            return 1.0;
        }
        let (mut sum, mut squares) = (0.0, 0.0);
        for w in self.weights(i).map(|(_, w)| f64::from(w) / self.area[i]) {
            (sum, squares) = (sum + w, squares + w * w);
        }
        let (rays, met) = (rays as f64, met as f64);
        // Half a ray of either kind more than there is: none of a few is not never.
        let part = (met + 0.5) / (rays + 1.0);
        let (of_part, of_sum) = (part * (1.0 - part) / rays, squares);
        (met / rays * of_sum + sum * of_part) / (of_sum + of_part)
    }

    /// Ends of all rays.
    pub fn joined(&self) -> usize {
        self.others.len()
    }

    /// The other ends of i's rays, with what each adds to the form factor with them.
    pub fn form_factors(&self, i: usize) -> impl Iterator<Item = (u32, f64)> {
        let own = f64::from(self.factors[i] * self.rests[i]) / self.area[i];
        self.weights(i).map(move |(j, w)| (j, own * f64::from(w * self.factors[j as usize])))
    }

    /// The other ends of i's rays, with their weights.
    fn weights(&self, i: usize) -> impl Iterator<Item = (u32, f32)> {
        let own = self.density[i];
        let from = if i > 0 { self.ends[i - 1] } else { 0 };
        self.others[from..self.ends[i]].iter().map(move |&j| (j, 1.0 / (own + self.density[j as usize])))
    }

    /// Brings the row sums to those wanted: all of it by factors that apply to what is gathered and sent alike, as far as
    /// that goes (Sinkhorn 1967), and the rest where it is gathered.
    fn balance(&mut self, want: &[f64], rows: Rows, clock: &Clock) {
        if rows == Rows::Sampled {
            return;
        }
        let mut sums = self.row_sums();
        for round in 0..if rows == Rows::Balanced { ROUNDS } else { 0 } {
            let power = POWERS[round % POWERS.len()];
            let (mut off, mut all) = (0.0, 0.0);
            for (i, (&want, &sum)) in want.iter().zip(&sums).enumerate().filter(|(_, (_, sum))| **sum > 0.0) {
                off += self.area[i] * (sum - want).abs();
                all += self.area[i] * want;
                let [least, most] = FACTORS;
                self.factors[i] = (self.factors[i] * (want / sum).powf(power) as f32).clamp(least, most);
            }
            sums = self.row_sums();
            if off <= BALANCED * all || clock.late() {
                break;
            }
        }
        for (i, (want, sum)) in want.iter().zip(sums).enumerate().filter(|(_, (_, sum))| *sum > 0.0) {
            self.rests[i] = (want / sum) as f32;
        }
    }

    /// The row sums of `d_i X_ij d_j / A_i`.
    fn row_sums(&self) -> Vec<f64> {
        let sum = |i: usize| {
            let sum: f64 = self.weights(i).map(|(j, w)| f64::from(w * self.factors[j as usize])).sum();
            f64::from(self.factors[i]) * sum / self.area[i]
        };
        (0..self.area.len()).into_par_iter().with_min_len(CHUNK).map(sum).collect()
    }

    /// What emitters must send for the irradiance to be `x`.
    pub(super) fn apply(&self, x: &Field) -> Field {
        let sent: Vec<[f32; 4]> = (0..x.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|j| {
                let rho = self.reflectance[j].map(|rho| rho * self.factors[j]);
                let [r, g, b] = std::array::from_fn(|k| rho[k] * x[j][k] as f32);
                [r, g, b, self.density[j]]
            })
            .collect();
        (0..x.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|i| {
                let from = if i > 0 { self.ends[i - 1] } else { 0 };
                let mut sum = [0.0; 3];
                for &j in &self.others[from..self.ends[i]] {
                    let [r, g, b, density] = sent[j as usize];
                    let weight = 1.0 / (self.density[i] + density);
                    add(&mut sum, f64::from(weight), [r, g, b].map(f64::from));
                }
                let gathers = f64::from(self.factors[i] * self.rests[i]) / self.area[i];
                std::array::from_fn(|k| x[i][k] - gathers * sum[k])
            })
            .collect()
    }
}

/// Ends of the rows, and in each the other ends of the rays that leave or end there.
fn both_ways(places: &[Place], met: &[u32]) -> (Vec<usize>, Vec<u32>) {
    let rows = || places.iter().scan(0, |from, p| Some(std::mem::replace(from, p.end)..p.end));
    let mut ends = vec![0usize; places.len()];
    let each = |f: &mut dyn FnMut(usize, u32)| {
        for (i, row) in rows().enumerate() {
            for &j in met[row].iter().filter(|&&j| j != u32::MAX) {
                f(i, j);
                f(j as usize, i as u32);
            }
        }
    };
    each(&mut |i, _| ends[i] += 1);
    let mut all = 0;
    for end in &mut ends {
        (*end, all) = (all, all + *end);
    }
    let mut others = vec![0; all];
    each(&mut |i, j| {
        others[ends[i]] = j;
        ends[i] += 1;
    });
    (ends, others)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiosity::links::numbers;

    /// Places that face each other at random, some with more rays than others: what one gives is what the other gets, and no
    /// row is short.
    #[test]
    fn exchange_is_symmetric_and_complete() {
        let n = 50u32;
        let mut met = Vec::new();
        let places: Vec<Place> = (0..n)
            .map(|i| {
                let rays = 20 + 40 * u64::from(i % 5);
                met.extend((0..rays).map(|k| (numbers(u64::from(i), k)[0] * n as f32) as u32));
                Place { area: 0.5 + f64::from(i % 3), reflectance: [0.5; 3], end: met.len(), closed: true }
            })
            .collect();
        let system = |rows| System::new(&places, &met, rows, &Clock::start(&(), None));
        let sampled = system(Rows::Sampled);
        let mut exchange = vec![0.0; (n * n) as usize];
        for i in 0..n as usize {
            for (j, w) in sampled.weights(i) {
                exchange[i * n as usize + j as usize] += f64::from(w);
            }
        }
        for (i, j) in (0..n as usize).flat_map(|i| (0..i).map(move |j| (i, j))) {
            let [there, back] = [(i, j), (j, i)].map(|(i, j)| exchange[i * n as usize + j]);
            assert!((there - back).abs() <= 1e-6 * there, "{i} {j}: {there} {back}");
        }
        assert_eq!(sampled.reciprocity(), 0.0);
        assert!(sampled.rows().iter().any(|row| (row - 1.0).abs() > 0.05));
        for (rows, differ) in [(Rows::Closed, 1.0), (Rows::Balanced, 3e-3)] {
            let system = system(rows);
            assert!(system.rows().iter().all(|row| (row - 1.0).abs() < 1e-5));
            let found = system.reciprocity();
            assert!(found > 0.0 && found < differ, "{rows:?} {found}");
        }
    }
}
