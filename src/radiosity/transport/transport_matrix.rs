//! Exchange of light between leaves that rays join.

use super::Field;
use crate::math::parallel;
use crate::radiosity::rgb::add;
use crate::ranks::Ranks;

/// Rows of one parallel task: few enough to balance the load of the threads. Does not change results.
const CHUNK: usize = 256;
/// A row sum may exceed its expected value e by this, or by (1/ρ − e)/2 if that is more, where ρ is the reflectance; beyond, the exchange
/// of the row is scaled down. With (1/ρ − e)/2 the parts of the row add up to at most 1/ρ, whatever their signs, and no light grows. A
/// larger excess is safe for white rows: of products of both halves for closed boxes with 2 to 16 rays a row, none has an eigenvalue
/// above 1 with 0.25, some have 1.16 with 0.5. In a deep shade of reflectance 0.8, with eight rays, elements receive 4.7 % too much light
/// with 0, 0.6 % with 0.25.
const MIN_EXCESS: f64 = 0.25;

/// Exchange of light between rows, by one half of the rays that join them.
///
/// Rays leave row i at random over its area and with the cosine density, `r_i` of them for each unit of area. A ray of i that ends on j
/// and one of j that ends on i sample the same exchange `X_ij = A_i F_ij = A_j F_ji`, so both count at both ends, with the weight
/// `1/(r_i + r_j)` (balance heuristic, Veach and Guibas 1995): `X` is symmetric whatever the samples. Its row sums are right only on
/// average. A row exchanges the difference from the expected sum (1 where no ray leaves the scene) with itself: `X` stays symmetric, so
/// that no energy is created. The light of the row comes from the other half of the rays ([`super::RayTransport`]), which is independent
/// of the difference, so that the mean is right. Factors that scale rows to their sums depend on the rays that they scale.
///
/// One bounce is `k_i ρ_i E_i + d_i / A_i Σ_j X_ij d_j ρ_j E_j`.
pub struct TransportMatrix {
    /// End of each row in `others`.
    ends: Vec<usize>,
    /// By row, the rows at the other ends of its rays and of the rays that meet it.
    others: Vec<u32>,
    /// Rays for each unit of area.
    density: Vec<f32>,
    /// Reflectance, RGB.
    reflectance: Vec<[f32; 3]>,
    /// Areas, scene units squared.
    pub(super) area: Vec<f64>,
    /// `d`, the factor of both directions.
    factors: Vec<f32>,
    /// `k`, the share that a row exchanges with itself.
    kept: Vec<f32>,
    /// The processes that share products with the matrix.
    ranks: Ranks,
}

/// One row of a [`TransportMatrix`].
pub struct MatrixRow {
    /// Area, scene units squared.
    pub area: f64,
    /// Reflectance, RGB.
    pub reflectance: [f32; 3],
    /// End of its rays among all rays.
    pub end: usize,
    /// Whether other rays have shown that no light from the row leaves the scene.
    pub closed: bool,
    /// Fraction of the light from the row's side that meets no other row: taken from the side, so that the weight of the row's rays does
    /// not depend on them alone.
    pub escapes: f64,
    /// Number of its rays that met elements outside the matrix.
    pub apart: usize,
}

impl TransportMatrix {
    /// For rows and the rows that their rays met, `u32::MAX` for none, with row sums as sampled.
    pub fn new(rows: &[MatrixRow], met: &[u32], ranks: &Ranks) -> TransportMatrix {
        let n = rows.len();
        let (ends, others) = both_ways(rows, met);
        TransportMatrix {
            ends,
            others,
            density: (0..n).map(|i| (rays_of(rows, i).len() as f64 / rows[i].area) as f32).collect(),
            reflectance: rows.iter().map(|p| p.reflectance).collect(),
            area: rows.iter().map(|p| p.area).collect(),
            factors: vec![1.0; n],
            kept: vec![0.0; n],
            ranks: ranks.clone(),
        }
    }

    /// With the expected row sums, of the same rows.
    pub fn balanced(mut self, rows: &[MatrixRow], met: &[u32]) -> TransportMatrix {
        let expected: Vec<f64> = parallel::map(parallel::at_least(CHUNK, 0..rows.len()), |i| {
            self.expected_row_sum(i, &rows[i], &met[rays_of(rows, i)])
        });
        let factor = |((sum, expected), row): ((f64, &f64), &MatrixRow)| {
            let white = f64::from(row.reflectance.into_iter().fold(0.0, f32::max));
            let most = expected + MIN_EXCESS.max(0.5 * (1.0 / white - expected));
            if sum > most { (most / sum) as f32 } else { 1.0 }
        };
        self.factors = self.sums().into_iter().zip(&expected).zip(rows).map(factor).collect();
        let kept = |(sum, expected): (f64, &f64)| (expected - sum) as f32;
        self.kept = self.sums().into_iter().zip(&expected).map(kept).collect();
        self
    }

    /// The row sums of the form factors.
    pub fn rows(&self) -> Vec<f64> {
        // A sum of 0 must not become negative by rounding.
        self.sums().into_iter().zip(&self.kept).map(|(sum, kept)| (sum + f64::from(*kept)).max(0.0)).collect()
    }

    /// The expected row sum of i, from two estimates: the fraction of its own rays that stayed in the scene, and the sum of its weights.
    /// Each is weighted by the variance of the other, relative to the row sum: `(1 - p)/n` of n rays with the fraction p, and the usual
    /// weight `1/(2 n)`. Variances estimated from the rays or weights themselves would favour one of the two: row sums of few rays were
    /// up to 5 % too large.
    fn expected_row_sum(&self, i: usize, row: &MatrixRow, rays: &[u32]) -> f64 {
        let (rays, met) = (rays.len(), rays.iter().filter(|&&j| j != u32::MAX).count());
        if row.closed && met + row.apart == rays {
            return if rays > 0 { met as f64 / rays as f64 } else { 1.0 };
        }
        let sum = self.weights(i).map(|(_, w)| f64::from(w)).sum::<f64>() / self.area[i];
        if rays == 0 {
            return sum.min(1.0);
        }
        (0.5 * met as f64 / rays as f64 + sum * row.escapes) / (0.5 + row.escapes)
    }

    /// Number of entries: two for each ray that met a row.
    pub fn entries(&self) -> usize {
        self.others.len()
    }

    /// The rows at the other ends of i's rays, with the form factor that each ray contributes.
    pub fn form_factors(&self, i: usize) -> impl Iterator<Item = (u32, f64)> {
        let own = f64::from(self.factors[i]) / self.area[i];
        self.weights(i).map(move |(j, w)| (j, own * f64::from(w * self.factors[j as usize])))
    }

    /// The row sums of `d_i X_ij d_j / A_i`.
    fn sums(&self) -> Vec<f64> {
        let sum = |i: usize| {
            let sum: f64 = self.weights(i).map(|(j, w)| f64::from(w * self.factors[j as usize])).sum();
            f64::from(self.factors[i]) * sum / self.area[i]
        };
        let rows = self.ranks.rows(self.area.len());
        rows.gather_numbers(parallel::map(parallel::at_least(CHUNK, rows.numbers()), sum))
    }

    /// The rows at the other ends of i's rays, with the weights of the rays.
    fn weights(&self, i: usize) -> impl Iterator<Item = (u32, f32)> {
        let from = if i > 0 { self.ends[i - 1] } else { 0 };
        self.others[from..self.ends[i]].iter().map(move |&j| (j, self.weight(i, j)))
    }

    /// The weight of a ray that joins two rows.
    #[inline]
    fn weight(&self, i: usize, j: u32) -> f32 {
        1.0 / (self.density[i] + self.density[j as usize])
    }

    /// Irradiance that the reflection of `x` causes, W/m².
    pub fn reflected(&self, x: &Field) -> Field {
        let sent: Vec<[f32; 4]> = parallel::map(parallel::at_least(CHUNK, 0..x.len()), |j| {
            let rho = self.reflectance[j].map(|rho| rho * self.factors[j]);
            let [r, g, b] = std::array::from_fn(|k| rho[k] * x[j][k] as f32);
            [r, g, b, self.density[j]]
        });
        let rows = self.ranks.rows(x.len());
        let own = parallel::map(parallel::at_least(CHUNK, rows.numbers()), |i| {
            let from = if i > 0 { self.ends[i - 1] } else { 0 };
            let mut sum = [0.0; 3];
            for &j in &self.others[from..self.ends[i]] {
                let [r, g, b, density] = sent[j as usize];
                let weight = 1.0 / (self.density[i] + density);
                add(&mut sum, f64::from(weight), [r, g, b].map(f64::from));
            }
            let (gathers, kept) = (f64::from(self.factors[i]) / self.area[i], f64::from(self.kept[i]));
            std::array::from_fn(|k| gathers * sum[k] + kept * f64::from(self.reflectance[i][k]) * x[i][k])
        });
        rows.gather_numbers(own)
    }
}

/// The rays of a row among all rays.
fn rays_of(rows: &[MatrixRow], i: usize) -> std::ops::Range<usize> {
    let first = if i > 0 { rows[i - 1].end } else { 0 };
    first..rows[i].end
}

/// Ends of the rows, and by row the other ends of the rays that leave the row or end on it.
fn both_ways(rows: &[MatrixRow], met: &[u32]) -> (Vec<usize>, Vec<u32>) {
    let ranges = || rows.iter().scan(0, |from, p| Some(std::mem::replace(from, p.end)..p.end));
    let mut ends = vec![0usize; rows.len()];
    let each = |f: &mut dyn FnMut(usize, u32)| {
        for (i, row) in ranges().enumerate() {
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
    use crate::math::sampling::numbers;

    /// Rows that face each other at random, with different numbers of rays: exchange is symmetric and no row sum is short.
    #[test]
    fn exchange_is_symmetric_and_complete() {
        let n = 50u32;
        let mut met = Vec::new();
        let matrix_rows: Vec<MatrixRow> = (0..n)
            .map(|i| {
                let rays = 20 + 40 * u64::from(i % 5);
                met.extend((0..rays).map(|k| (numbers(u64::from(i), k)[0] * n as f32) as u32));
                MatrixRow {
                    area: 0.5 + f64::from(i % 3),
                    reflectance: [0.5; 3],
                    end: met.len(),
                    closed: true,
                    escapes: 0.0,
                    apart: 0,
                }
            })
            .collect();
        let sampled = TransportMatrix::new(&matrix_rows, &met, &Ranks::default());
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
        assert!(sampled.rows().iter().any(|row| (row - 1.0).abs() > 0.05));
        let balanced = sampled.balanced(&matrix_rows, &met);
        assert!(balanced.rows().iter().all(|row| (row - 1.0).abs() < 1e-5));
        // No energy appears.
        let light: Field = (0..n).map(|i| [f64::from(i % 7); 3]).collect();
        let power =
            |light: &Field| -> f64 { light.iter().zip(&balanced.area).map(|(e, area)| e[0] * area).sum() };
        let ratio = power(&balanced.reflected(&light)) / (0.5 * power(&light));
        assert!((ratio - 1.0).abs() < 1e-5, "{ratio}");
    }

    /// Rows of which six rays in ten leave the scene: their row sums are right on average.
    #[test]
    fn row_sums_of_open_rows_have_no_bias() {
        let n = 2000u32;
        let mut met = Vec::new();
        let rows: Vec<MatrixRow> = (0..n)
            .map(|i| {
                met.extend((0..20 + 20 * u64::from(i % 3)).map(|k| {
                    let [stays, which, ..] = numbers(u64::from(i), k);
                    if stays < 0.4 { (which * n as f32) as u32 } else { u32::MAX }
                }));
                MatrixRow {
                    area: 1.0,
                    reflectance: [0.5; 3],
                    end: met.len(),
                    closed: false,
                    escapes: 0.6,
                    apart: 0,
                }
            })
            .collect();
        let kept = met.iter().filter(|&&j| j != u32::MAX).count() as f64 / met.len() as f64;
        let matrix = TransportMatrix::new(&rows, &met, &Ranks::default()).balanced(&rows, &met);
        let mean = matrix.rows().iter().sum::<f64>() / f64::from(n);
        assert!((mean / kept - 1.0).abs() < 3e-3, "{mean} instead of {kept}");
    }
}
