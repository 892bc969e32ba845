//! The matrix by rows, its statistics, and sums over groups.

use super::closure::{self, each};
use super::facets::Facets;
use super::pair::Row;
use super::{Report, Settings, go_on};
use crate::Result;
use crate::progress::Progress;
use crate::scene::Scene;
use std::collections::BTreeMap;

/// A sparse matrix of form factors in compressed rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix {
    /// Start of each row in `columns` and `factors`, and the end of the last; rows + 1 entries.
    pub offsets: Vec<u64>,
    /// Columns of the entries, ascending in each row.
    pub columns: Vec<u32>,
    /// Form factors `F(row → column)`, unitless.
    pub factors: Vec<f32>,
    /// Area of each row's facet or group, scene units squared.
    pub areas: Vec<f64>,
    /// Fraction of each row's flux that escapes from the scene.
    pub escaped: Vec<f32>,
    /// Fraction of each row's flux that falls on back sides.
    pub lost: Vec<f32>,
    /// Names of the rows; empty for facets.
    pub names: Vec<String>,
}

/// What a [`Matrix`] holds, borrowed.
#[derive(Clone, Copy)]
pub struct Rows<'a> {
    pub offsets: &'a [u64],
    pub columns: &'a [u32],
    pub factors: &'a [f32],
    pub areas: &'a [f64],
    pub escaped: &'a [f32],
    pub lost: &'a [f32],
    pub names: &'a [String],
}

impl<'a> Rows<'a> {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.areas.len()
    }

    /// Column and form factor of the entries of a row.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f64)> + use<'a> {
        let span = self.offsets[i] as usize..self.offsets[i + 1] as usize;
        let columns = self.columns[span.clone()].iter().map(|&c| c as usize);
        columns.zip(self.factors[span].iter().map(|&f| f64::from(f)))
    }
}

impl Matrix {
    /// What it holds.
    pub fn rows(&self) -> Rows<'_> {
        let Matrix { offsets, columns, factors, areas, escaped, lost, names } = self;
        Rows { offsets, columns, factors, areas, escaped, lost, names }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.areas.len()
    }

    /// Whether there are no rows.
    #[cfg(any(test, feature = "internals"))]
    pub fn is_empty(&self) -> bool {
        self.areas.is_empty()
    }

    /// Column and form factor of the entries of a row.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.rows().row(i)
    }

    /// Sum of the form factors of a row.
    pub fn row_sum(&self, i: usize) -> f64 {
        self.row(i).map(|(_, f)| f).sum()
    }

    /// One entry; 0 if not stored.
    #[cfg(any(test, feature = "internals"))]
    pub fn get(&self, i: usize, j: usize) -> f64 {
        self.row(i).find(|&(c, _)| c == j).map_or(0.0, |(_, f)| f)
    }

    /// The matrix of groups: `F(G→H) = Σ_{i in G} A_i Σ_{j in H} F_ij / A_G`.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] if `progress` stops it.
    pub fn grouped(
        self,
        scene: &Scene,
        facets: &Facets,
        by: Grouping,
        progress: &dyn Progress,
    ) -> Result<Matrix> {
        let (of, names): (&[u32], Vec<String>) = match by {
            Grouping::Polygon => return Ok(self),
            Grouping::Object => {
                (&scene.triangle_object, scene.objects.iter().map(|o| o.name.clone()).collect())
            }
            Grouping::Material => {
                (&scene.triangle_material, scene.materials.iter().map(|m| m.name.clone()).collect())
            }
        };
        let group = |facet: usize| of[facets.triangle(facet)] as usize;
        let n = names.len();
        let (mut areas, mut shares) = (vec![0.0; n], vec![[0.0; 2]; n]);
        let mut sums: Vec<BTreeMap<u32, f64>> = vec![BTreeMap::new(); n];
        for i in 0..self.len() {
            go_on(progress)?;
            let (g, area) = (group(i), self.areas[i]);
            areas[g] += area;
            shares[g][0] += area * f64::from(self.escaped[i]);
            shares[g][1] += area * f64::from(self.lost[i]);
            for (j, f) in self.row(i) {
                *sums[g].entry(group(j) as u32).or_default() += area * f;
            }
        }
        let share = |k: usize| -> Vec<f32> {
            shares.iter().zip(&areas).map(|(s, a)| if *a > 0.0 { (s[k] / a) as f32 } else { 0.0 }).collect()
        };
        let mut out = Matrix {
            offsets: vec![0],
            columns: Vec::new(),
            factors: Vec::new(),
            escaped: share(0),
            lost: share(1),
            areas: areas.clone(),
            names,
        };
        for (sums, area) in sums.into_iter().zip(areas) {
            for (h, sum) in sums {
                out.columns.push(h);
                out.factors.push((sum / area) as f32);
            }
            out.offsets.push(out.columns.len() as u64);
        }
        Ok(out)
    }
}

/// Rows and columns of a matrix of form factors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Grouping {
    /// Polygons of the file, in its order.
    #[default]
    Polygon,
    /// Objects and groups of the file.
    Object,
    /// Materials.
    Material,
}

/// Assembles the full matrix from its upper half, adjusted if [`Settings::enforce`] is set, with its statistics.
///
/// # Errors
/// [`crate::Error::Cancelled`] if `progress` stops it.
pub fn assemble(
    facets: &Facets,
    mut upper: Vec<Row>,
    shares: Vec<[f32; 2]>,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(Matrix, Report)> {
    let n = facets.count();
    let rays = n as u64 * u64::from(settings.rays) + upper.iter().map(|r| r.rays).sum::<u64>();
    let (mut variance, mut sums) = (vec![0f64; n], vec![0f64; n]);
    let mut offsets = vec![0u64; n + 1];
    each(&upper, |i, j, exchange, error| {
        for k in [i, j] {
            offsets[k + 1] += 1;
            sums[k] += exchange;
            variance[k] += error * error;
        }
    });
    go_on(progress)?;
    let areas: Vec<f64> = (0..n).map(|i| facets.area(i)).collect();
    // Error of the row sums before closure.
    let off: Vec<f64> = (0..n)
        .map(|i| sums[i] / areas[i] + f64::from(shares[i][0]) + f64::from(shares[i][1]) - 1.0)
        .collect();
    // A few stray rays through cracks do not make a row open.
    let closed: Vec<bool> = shares.iter().map(|s| s[0] + s[1] <= Report::STRAY).collect();
    let steps = if settings.enforce {
        let kept = |i: usize| 1.0 - f64::from(shares[i][0] + shares[i][1]);
        let wanted: Vec<Option<f64>> = (0..n).map(|i| closed[i].then_some(areas[i] * kept(i))).collect();
        closure::adjust(&mut upper, &wanted, progress)
    } else {
        0
    };
    go_on(progress)?;
    (0..n).for_each(|i| offsets[i + 1] += offsets[i]);
    let entries = offsets[n] as usize;
    let (mut columns, mut factors) = (vec![0u32; entries], vec![0f32; entries]);
    let mut next = offsets.clone();
    // The upper half is in row order, so the columns of every row are ascending.
    each(&upper, |i, j, exchange, _| {
        for (row, column) in [(i, j), (j, i)] {
            let at = next[row] as usize;
            next[row] += 1;
            columns[at] = column as u32;
            factors[at] = (exchange / areas[row]) as f32;
        }
    });
    drop(upper);
    go_on(progress)?;
    let matrix = Matrix {
        offsets,
        columns,
        factors,
        escaped: shares.iter().map(|s| s[0]).collect(),
        lost: shares.iter().map(|s| s[1]).collect(),
        names: Vec::new(),
        areas,
    };
    let report = report(&matrix, &off, &closed, &variance, rays, steps);
    go_on(progress)?;
    Ok((matrix, report))
}

fn report(m: &Matrix, off: &[f64], closed: &[bool], variance: &[f64], rays: u64, steps: usize) -> Report {
    let n = m.len().max(1) as f64;
    let sums: Vec<f64> = (0..m.len()).map(|i| m.row_sum(i)).collect();
    let total: f64 = m.areas.iter().sum();
    let weighted = |shares: &[f32]| -> f64 {
        shares.iter().zip(&m.areas).map(|(s, a)| f64::from(*s) * a).sum::<f64>() / total
    };
    let (mut difference, mut exchange) = (0.0, 0.0);
    let mut transposed = vec![0u64; m.len()];
    for i in 0..m.len() {
        for (j, f) in m.row(i) {
            // The pattern is symmetric: entries (j, i) appear in ascending order of i.
            let at = m.offsets[j] + transposed[j];
            transposed[j] += 1;
            difference += (m.areas[i] * f - m.areas[j] * f64::from(m.factors[at as usize])).abs();
            exchange += m.areas[i] * f;
        }
    }
    let closed_rows = closed.iter().filter(|&&c| c).count();
    let short = |i: usize| sums[i] + f64::from(m.escaped[i] + m.lost[i]) - 1.0;
    let closed_off: f64 = (0..m.len()).filter(|&i| closed[i]).map(|i| short(i).abs()).sum();
    let mut bad = Vec::new();
    for (i, off) in off.iter().enumerate() {
        if f64::from(m.lost[i]) > Report::BAD {
            let share = 100.0 * m.lost[i];
            bad.push((
                i,
                format!("{share:.1} % of what it sends out falls on back sides: is it wound the wrong way?"),
            ));
        } else if off.abs() > Report::BAD.max(6.0 * variance[i].sqrt() / m.areas[i]) {
            bad.push((i, format!("row sum, escaped and lost shares add up to {:.4}", 1.0 + off)));
        }
    }
    let bad_facets = bad.len();
    bad.truncate(Report::MAX_BAD);
    Report {
        facets: m.len(),
        entries: m.columns.len(),
        rays,
        row_sum_error: off.iter().map(|o| o.abs()).sum::<f64>() / n,
        worst_row_sum_error: off.iter().fold(0.0, |w, o| o.abs().max(w)),
        row_sums: sums.iter().fold([f64::INFINITY, 0.0], |[lo, hi], &s| [lo.min(s), hi.max(s)]),
        closed_row_sum_error: if closed_rows > 0 { closed_off / closed_rows as f64 } else { 0.0 },
        closed_rows,
        escaped: weighted(&m.escaped),
        lost: weighted(&m.lost),
        reciprocity_residual: if exchange > 0.0 { difference / exchange } else { 0.0 },
        row_standard_error: (variance.iter().zip(&m.areas).map(|(v, a)| v / (a * a)).sum::<f64>() / n).sqrt(),
        closure_steps: steps,
        bad,
        bad_facets,
    }
}
