//! Exchange of light between leaves that rays join.

use super::operator::Field;
use super::row_normalisation::{BalancedRows, RAY_ROWS, balance};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::options::RowSums;
use crate::radiosity::rgb::add;
use crate::ranks::Ranks;
use rayon::prelude::*;

/// Rows of one parallel task.
const CHUNK: usize = 256;

/// Exchange of light between rows, by the rays that join them.
///
/// Rays leave row i at random over its area and with the cosine density, `r_i` of them for each unit of area. A ray of i that
/// ends on j and one of j that ends on i sample the same exchange `X_ij = A_i F_ij = A_j F_ji`, so both count at both ends, with
/// the weight `1/(r_i + r_j)` (balance heuristic, Veach and Guibas 1995): `X` is symmetric whatever the samples. Its row sums are
/// right only on average; those of the scaled `d_i X_ij d_j` are the expected ones: 1 where no ray leaves the scene.
///
/// One bounce is `g_i d_i / A_i Σ_j X_ij d_j ρ_j E_j`.
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
    /// `g`, the factor of gathering alone.
    rests: Vec<f32>,
    /// The row sums that are expected.
    expected: Vec<f64>,
    /// By row, how much its expected sum changes with the part of its own rays that stay in the scene.
    own_part: Vec<f32>,
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
    /// Part of the light from the row's side that meets no other row: its own rays alone would decide how far they are trusted.
    pub escapes: f64,
    /// Of its rays, those that met elements which take no part in the exchange.
    pub apart: usize,
}

impl TransportMatrix {
    /// For rows and the rows that their rays met, `u32::MAX` for none. `row_sums` says how row sums are normalised.
    pub fn new(
        rows: &[MatrixRow],
        met: &[u32],
        row_sums: RowSums,
        ranks: &Ranks,
        deadline: &Deadline,
    ) -> TransportMatrix {
        let n = rows.len();
        let rays = |i: usize| rows[i].end - if i > 0 { rows[i - 1].end } else { 0 };
        let (ends, others) = both_ways(rows, met);
        let mut matrix = TransportMatrix {
            ends,
            others,
            density: (0..n).map(|i| (rays(i) as f64 / rows[i].area) as f32).collect(),
            reflectance: rows.iter().map(|p| p.reflectance).collect(),
            area: rows.iter().map(|p| p.area).collect(),
            factors: vec![1.0; n],
            rests: vec![1.0; n],
            expected: Vec::new(),
            own_part: Vec::new(),
            ranks: ranks.clone(),
        };
        let expected: Vec<(f64, f32)> = (0..n)
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|i| matrix.expected_row_sum(i, &rows[i], &met[rows[i].end - rays(i)..rows[i].end]))
            .collect();
        (matrix.expected, matrix.own_part) = expected.into_iter().unzip();
        if row_sums == RowSums::Balanced {
            let sums = matrix.sums();
            let sums = balance(&mut matrix, sums, &RAY_ROWS, deadline);
            // The remainder is corrected where light is gathered.
            for (i, sum) in sums.into_iter().enumerate().filter(|(_, sum)| *sum > 0.0) {
                matrix.rests[i] = (matrix.expected[i] / sum) as f32;
            }
        }
        matrix
    }

    /// Mean difference of `A_i F_ij` and `A_j F_ji`, relative to their mean.
    pub fn reciprocity(&self) -> f64 {
        let (mut differ, mut all) = (0.0, 0.0);
        for ((row, rest), area) in self.rows().into_iter().zip(&self.rests).zip(&self.area) {
            (differ, all) = (differ + area * row * f64::from((1.0 / rest - 1.0).abs()), all + area * row);
        }
        if all > 0.0 { differ / all } else { 0.0 }
    }

    /// The row sums of the form factors.
    pub fn rows(&self) -> Vec<f64> {
        self.sums().into_iter().zip(&self.rests).map(|(sum, rest)| sum * f64::from(*rest)).collect()
    }

    /// The expected row sum of i: the part of its own rays that stayed in the scene and the sum of its weights, each weighted by
    /// the variance of the other, relative to the row sum: `(1 - p)/n` of n rays with the part p, and the mean weight. Variances in
    /// proportion to either estimate, or p from the same rays, would favour one of them: row sums were 1.3 % too small or up to 5 % too large. Also
    /// returns the part of the sum that its own rays decide.
    fn expected_row_sum(&self, i: usize, row: &MatrixRow, rays: &[u32]) -> (f64, f32) {
        let kept = || rays.iter().filter(|&&j| j != u32::MAX);
        let (rays, met) = (rays.len(), kept().count());
        if row.closed && met + row.apart == rays && (met > 0 || rays == 0) {
            return (if rays > 0 { met as f64 / rays as f64 } else { 1.0 }, 0.0);
        }
        let (mut sum, mut squares) = (0.0, 0.0);
        for w in self.weights(i).map(|(_, w)| f64::from(w) / self.area[i]) {
            (sum, squares) = (sum + w, squares + w * w);
        }
        if rays == 0 {
            return (sum.min(1.0), 0.0);
        }
        let (rays, met) = (rays as f64, met as f64);
        if sum <= 0.0 {
            return (0.0, 0.0);
        }
        let (of_part, of_sum) = (row.escapes / rays, squares / sum);
        let expected = (met / rays * of_sum + sum * of_part) / (of_sum + of_part);
        let of_own: f64 = kept().map(|&j| f64::from(self.weight(i, j))).sum();
        let own = (met / rays * of_sum + of_own / self.area[i] * of_part) / (of_sum + of_part);
        (expected, if met > 0.0 { (own * rays / met) as f32 } else { 0.0 })
    }

    /// How much the expected sum of row i changes with the part of its own rays that stay in the scene, in `[0, 1]`, and that sum.
    pub fn own_part(&self, i: usize) -> (f64, f64) {
        (f64::from(self.own_part[i]), self.expected[i])
    }

    /// Number of entries: two for each ray that met a row.
    pub fn entries(&self) -> usize {
        self.others.len()
    }

    /// The rows at the other ends of i's rays, with the form factor that each ray contributes.
    pub fn form_factors(&self, i: usize) -> impl Iterator<Item = (u32, f64)> {
        let own = f64::from(self.factors[i] * self.rests[i]) / self.area[i];
        self.weights(i).map(move |(j, w)| (j, own * f64::from(w * self.factors[j as usize])))
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
        let sent: Vec<[f32; 4]> = (0..x.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|j| {
                let rho = self.reflectance[j].map(|rho| rho * self.factors[j]);
                let [r, g, b] = std::array::from_fn(|k| rho[k] * x[j][k] as f32);
                [r, g, b, self.density[j]]
            })
            .collect();
        let rows = self.ranks.rows(x.len());
        let own = rows
            .numbers()
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
                sum.map(|s| gathers * s)
            })
            .collect();
        rows.gather_numbers(own)
    }
}

impl BalancedRows for TransportMatrix {
    /// The row sums of `d_i X_ij d_j / A_i`.
    fn sums(&self) -> Vec<f64> {
        let sum = |i: usize| {
            let sum: f64 = self.weights(i).map(|(j, w)| f64::from(w * self.factors[j as usize])).sum();
            f64::from(self.factors[i]) * sum / self.area[i]
        };
        let rows = self.ranks.rows(self.area.len());
        rows.gather_numbers(rows.numbers().with_min_len(CHUNK).map(sum).collect())
    }

    fn target(&self, i: usize, sum: f64) -> Option<(f64, f64)> {
        (sum > 0.0).then(|| (self.expected[i], self.area[i]))
    }

    fn factor(&mut self, i: usize) -> &mut f32 {
        &mut self.factors[i]
    }
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
        let system = |rows| {
            TransportMatrix::new(&matrix_rows, &met, rows, &Ranks::default(), &Deadline::start(&(), None))
        };
        let sampled = system(RowSums::Sampled);
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
        let balanced = system(RowSums::Balanced);
        assert!(balanced.rows().iter().all(|row| (row - 1.0).abs() < 1e-5));
        let found = balanced.reciprocity();
        assert!(found > 0.0 && found < 3e-3, "{found}");
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
        let matrix = TransportMatrix::new(
            &rows,
            &met,
            RowSums::Balanced,
            &Ranks::default(),
            &Deadline::start(&(), None),
        );
        let mean = matrix.rows().iter().sum::<f64>() / f64::from(n);
        assert!((mean / kept - 1.0).abs() < 3e-3, "{mean} instead of {kept}");
    }

    /// Rows of few rays of which some leave the scene and bring light: what they send is right on average only with the covariance of light and rays that
    /// stay. The rays of a half are stratified, so that it is not that of independent rays, and rows have different densities.
    #[test]
    fn light_of_rays_that_leave_is_sent_in_full() {
        for (escape, half) in
            [([0.1; 2], [2u64, 2]), ([0.5; 2], [2, 3]), ([0.8; 2], [2, 8]), ([0.2, 0.8], [2, 2])]
        {
            let n = 8000u64;
            // Half of what stays of the kind of rows that loses more goes to the other kind, and as much comes back.
            let across = 0.5 * (1.0 - f64::max(escape[0], escape[1]));
            let (mut met, mut brought, mut rows) = (Vec::new(), Vec::new(), Vec::new());
            for i in 0..n {
                let (half, escapes) = (half[(i % 2) as usize], escape[(i % 2) as usize]);
                let crosses = across / (1.0 - escapes);
                let mut gone = [0.0; 2];
                for k in 0..2 * half {
                    let [stays, which, kind, _] = numbers(i, k);
                    let other = u64::from(f64::from(kind) < crosses);
                    let to = 2 * (which * (n / 2) as f32) as u64 + (i + other) % 2;
                    let stays = (f64::from(stays) + (k % half) as f64) / half as f64;
                    gone[(k / half) as usize] += if stays < escapes { 1.0 / half as f64 } else { 0.0 };
                    met.push(if stays < escapes { u32::MAX } else { to as u32 });
                }
                brought.push((0.5 * (gone[0] + gone[1]), -0.25 * (gone[0] - gone[1]).powi(2)));
                rows.push(MatrixRow {
                    area: 1.0,
                    reflectance: [1.0; 3],
                    end: met.len(),
                    closed: false,
                    escapes,
                    apart: 0,
                });
            }
            let deadline = Deadline::start(&(), None);
            let matrix = TransportMatrix::new(&rows, &met, RowSums::Balanced, &Ranks::default(), &deadline);
            let received = |part: f64| {
                let light = |i: usize| {
                    let (own, sum) = matrix.own_part(i);
                    let more = if own > 0.0 { -brought[i].1 * own / sum } else { 0.0 };
                    brought[i].0 + part * more
                };
                let sent: Field = (0..n as usize).map(|i| [light(i); 3]).collect();
                matrix.reflected(&sent).into_iter().map(|e| e[0]).sum::<f64>()
            };
            let want: f64 = (0..n as usize).map(|i| (1.0 - escape[i % 2]) * brought[i].0).sum();
            let [plain, full] = [0.0, 1.0].map(|part| received(part) / want);
            assert!((full - 1.0).abs() < 0.012, "{escape:?} {half:?}: {plain} {full}");
        }
    }
}
