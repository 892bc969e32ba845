//! The matrix by rows, its statistics, and sums over groups.

use super::closure::{self, each};
use super::facets::Facets;
use super::pair::Row;
use super::{Report, Settings, go_on};
use crate::Result;
use crate::error::number;
use crate::progress::Progress;
use crate::scene::Scene;
use std::collections::BTreeMap;

/// Form factors F(from → to): the fraction of what the front of one polygon (object, material) sends out that arrives at the front of
/// another, with what stands between them. A sparse matrix by rows (CSR), each with a polygon's, object's or material's values;
/// A(from) F(from → to) is symmetric.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct FormFactors {
    /// Where the entries of each row begin in `columns` and `factors`, and the end of the last: one more than rows.
    pub offsets: Vec<u64>,
    /// Columns of the entries, ascending in each row. Pairs that do not see each other have no entry.
    pub columns: Vec<u32>,
    /// The form factor of each entry, in `[0, 1]`.
    pub factors: Vec<f32>,
    /// Names of the rows: those of objects or materials, which need not be unique; none for polygons.
    pub names: Vec<String>,
    /// Area of each row, scene units squared; 0 for objects and materials without faces.
    pub areas: Vec<f64>,
    /// Fraction of what each row sends out that leaves the scene, in `[0, 1]`.
    pub escaped: Vec<f32>,
    /// Fraction of what each row sends out that falls on back sides, in `[0, 1]`.
    pub lost: Vec<f32>,
    /// Rays traced.
    pub rays: u64,
    /// Mean over the polygons of |row sum + escaped + lost − 1| before closure: what sampling and discovery missed.
    pub row_sum_error: f64,
    /// The same over the rows from which nothing escapes, after closure; 0 without such rows.
    pub closed_row_sum_error: f64,
}

impl FormFactors {
    /// Columns of a row, ascending, and the form factor of each, in `[0, 1]`. Pairs that do not see each other have no entry.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row(&self, from: usize) -> (&[u32], &[f32]) {
        let span = self.offsets[from] as usize..self.offsets[from + 1] as usize;
        (&self.columns[span.clone()], &self.factors[span])
    }

    /// One form factor; 0 if there is no entry.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn factor(&self, from: usize, to: usize) -> f32 {
        let (columns, factors) = self.row(from);
        columns.binary_search(&(to as u32)).map_or(0.0, |at| factors[at])
    }

    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.areas.len()
    }

    /// Column and form factor of the entries of a row.
    pub(crate) fn entries(&self, i: usize) -> impl Iterator<Item = (usize, f64)> {
        let (columns, factors) = self.row(i);
        columns.iter().zip(factors).map(|(&column, &factor)| (column as usize, f64::from(factor)))
    }

    /// Sum of the form factors of a row.
    pub(crate) fn row_sum(&self, i: usize) -> f64 {
        self.entries(i).map(|(_, f)| f).sum()
    }
}

/// The matrix of groups: `F(G→H) = Σ_{i in G} A_i Σ_{j in H} F_ij / A_G`.
pub fn by_groups(
    faces: FormFactors,
    scene: &Scene,
    facets: &Facets,
    by: Grouping,
    progress: &dyn Progress,
) -> Result<FormFactors> {
    let (of, names): (&[u32], Vec<String>) = match by {
        Grouping::Polygon => return Ok(faces),
        Grouping::Object => (&scene.triangle_object, scene.objects.iter().map(|o| o.name.clone()).collect()),
        Grouping::Material => {
            (&scene.triangle_material, scene.materials.iter().map(|m| m.name.clone()).collect())
        }
    };
    let group = |facet: usize| of[facets.triangle(facet)] as usize;
    let n = names.len();
    let (mut areas, mut shares) = (vec![0.0; n], vec![[0.0; 2]; n]);
    let mut sums: Vec<BTreeMap<u32, f64>> = vec![BTreeMap::new(); n];
    for i in 0..faces.len() {
        go_on(progress)?;
        let (g, area) = (group(i), faces.areas[i]);
        areas[g] += area;
        shares[g][0] += area * f64::from(faces.escaped[i]);
        shares[g][1] += area * f64::from(faces.lost[i]);
        for (j, f) in faces.entries(i) {
            *sums[g].entry(group(j) as u32).or_default() += area * f;
        }
    }
    let share = |k: usize| -> Vec<f32> {
        shares.iter().zip(&areas).map(|(s, a)| if *a > 0.0 { (s[k] / a) as f32 } else { 0.0 }).collect()
    };
    let mut out = FormFactors {
        offsets: vec![0],
        columns: Vec::new(),
        factors: Vec::new(),
        escaped: share(0),
        lost: share(1),
        areas: areas.clone(),
        names,
        ..faces
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
pub fn assemble(
    facets: &Facets,
    mut upper: Vec<Row>,
    shares: Vec<[f32; 2]>,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(FormFactors, Report)> {
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
    let closed: Vec<bool> = shares.iter().map(|s| s[0] + s[1] <= Report::MAX_CLOSED_LOSS).collect();
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
    let mut matrix = FormFactors {
        offsets,
        columns,
        factors,
        escaped: shares.iter().map(|s| s[0]).collect(),
        lost: shares.iter().map(|s| s[1]).collect(),
        names: Vec::new(),
        areas,
        rays,
        row_sum_error: 0.0,
        closed_row_sum_error: 0.0,
    };
    let report = report(&matrix, &off, &closed, &variance, steps);
    (matrix.row_sum_error, matrix.closed_row_sum_error) = (report.row_sum_error, report.closed_row_sum_error);
    go_on(progress)?;
    Ok((matrix, report))
}

fn report(m: &FormFactors, off: &[f64], closed: &[bool], variance: &[f64], steps: usize) -> Report {
    let n = m.len().max(1) as f64;
    let sums: Vec<f64> = (0..m.len()).map(|i| m.row_sum(i)).collect();
    let total: f64 = m.areas.iter().sum();
    let weighted = |shares: &[f32]| -> f64 {
        shares.iter().zip(&m.areas).map(|(s, a)| f64::from(*s) * a).sum::<f64>() / total
    };
    let (mut difference, mut exchange) = (0.0, 0.0);
    let mut transposed = vec![0u64; m.len()];
    for i in 0..m.len() {
        for (j, f) in m.entries(i) {
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
        if f64::from(m.lost[i]) > Report::MAX_LOSS {
            let share = number(f64::from(100.0 * m.lost[i]));
            let why = "faces that touch it, sheets, or faces wound the wrong way";
            bad.push((i, format!("{share} % of the light it sends out falls on back sides: {why}")));
        } else if off.abs() > Report::MAX_LOSS.max(6.0 * variance[i].sqrt() / m.areas[i]) {
            bad.push((i, format!("row sum, escaped and lost shares add up to {}", number(1.0 + off))));
        }
    }
    let bad_facets = bad.len();
    bad.truncate(Report::MAX_BAD);
    Report {
        facets: m.len(),
        entries: m.columns.len(),
        rays: m.rays,
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
