//! Form factors of a model, with occlusion.

use crate::form_factors::matrix::{
    Facets, Format, Grouping, Matrix, Report, Settings, compute, memory_bound, write,
};
use crate::model::Model;
use crate::progress::Progress;
use crate::{Error, Result, memory};
use std::path::Path;

/// Options of [`Model::form_factors`]: [`FormFactorOptions::default`], then `with_…`.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct FormFactorOptions {
    grouping: Grouping,
    rays: Option<u32>,
    pair_rays: Option<u32>,
    closure: bool,
    /// None: a part of the available memory.
    max_bytes: Option<u64>,
    seed: u64,
}

impl Default for FormFactorOptions {
    /// By polygon; rays by their number; closure; a part of the available memory; seed 1.
    fn default() -> Self {
        FormFactorOptions {
            grouping: Grouping::Polygon,
            rays: None,
            pair_rays: None,
            closure: true,
            max_bytes: None,
            seed: 1,
        }
    }
}

impl FormFactorOptions {
    /// Rows and columns.
    #[must_use]
    pub fn with_grouping(mut self, grouping: Grouping) -> FormFactorOptions {
        self.grouping = grouping;
        self
    }

    /// Rays of every polygon that look for what it sees, 1 to 1,048,576; default 2,048, more where there are few polygons.
    #[must_use]
    pub fn with_rays(mut self, rays: u32) -> FormFactorOptions {
        self.rays = Some(rays);
        self
    }

    /// Largest number of rays between two polygons that are partly hidden from each other, 4 to 4,194,304; default 256, more where
    /// there are few.
    #[must_use]
    pub fn with_pair_rays(mut self, rays: u32) -> FormFactorOptions {
        self.pair_rays = Some(rays);
        self
    }

    /// Whether rows that nothing escapes from are adjusted to the sum 1, each entry by as much as it is uncertain; default true.
    /// A F is symmetric either way.
    #[must_use]
    pub fn with_closure(mut self, closure: bool) -> FormFactorOptions {
        self.closure = closure;
        self
    }

    /// Refuses to begin if the matrix could take more than so many bytes; default: four fifths of the available memory.
    #[must_use]
    pub fn with_max_bytes(mut self, bytes: u64) -> FormFactorOptions {
        self.max_bytes = Some(bytes);
        self
    }

    /// Seed of all random numbers; default 1.
    #[must_use]
    pub fn with_seed(mut self, seed: u64) -> FormFactorOptions {
        self.seed = seed;
        self
    }

    fn settings(&self, facets: usize) -> Result<Settings> {
        let mut settings = Settings { enforce: self.closure, seed: self.seed, ..Settings::new(facets) };
        settings.rays = self.rays.unwrap_or(settings.rays);
        settings.largest_bundle = self.pair_rays.unwrap_or(settings.largest_bundle);
        settings.bundle = settings.bundle.min(settings.largest_bundle);
        for (name, value, min, max) in
            [("rays", settings.rays, 1, 1 << 20), ("pair_rays", settings.largest_bundle, 4, 1 << 22)]
        {
            if !(min..=max).contains(&value) {
                return Err(Error::Argument(format!("`{name}` {value}: must lie in {min}..{max}")));
            }
        }
        let (bytes, limit) = (memory_bound(facets, &settings), self.max_bytes.or_else(memory::usable));
        if let Some(limit) = limit.filter(|&limit| bytes > limit) {
            return Err(Error::OutOfMemory(format!(
                "the matrix of {facets} polygons could take {bytes} bytes: raise `max_bytes` (now {limit}) or lower `rays`"
            )));
        }
        Ok(settings)
    }
}

/// Form factors F(from → to): the fraction of what the front of one polygon (object, material) sends out that arrives at the front of
/// another, with what stands between them. A sparse matrix by rows; A(from) F(from → to) is symmetric.
#[derive(Clone, Debug)]
pub struct FormFactors {
    matrix: Matrix,
    report: Report,
}

impl Model {
    /// Form factors between all polygons, objects or materials, by exact rays on the threads of the model. Needs
    /// [`Detail::Rays`](crate::Detail::Rays). `&()` ignores progress.
    ///
    /// # Errors
    /// [`Error::Argument`] if an option is out of its range, [`Error::OutOfMemory`] if the matrix could be too large,
    /// [`Error::Scene`] with more than 2²⁶ polygons, [`Error::Cancelled`] if `progress` stops it, which takes less than a second or so.
    pub fn form_factors(&self, options: &FormFactorOptions, progress: &dyn Progress) -> Result<FormFactors> {
        self.on_threads(|| {
            let scene = self.scene();
            let facets = Facets::new_unless(scene, progress)?;
            let settings = options.settings(facets.count())?;
            let (matrix, report) = compute(self, &facets, &settings, progress)?;
            let matrix = matrix.grouped(scene, &facets, options.grouping, progress)?;
            Ok(FormFactors { matrix, report })
        })?
    }
}

impl FormFactors {
    /// Number of rows, and of columns.
    pub fn len(&self) -> usize {
        self.matrix.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.matrix.is_empty()
    }

    /// Columns of a row, ascending, and the form factor of each, in `[0, 1]`. Pairs that do not see each other have no entry.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row(&self, from: usize) -> (&[u32], &[f32]) {
        let span = self.matrix.offsets[from] as usize..self.matrix.offsets[from + 1] as usize;
        (&self.matrix.columns[span.clone()], &self.matrix.factors[span])
    }

    /// The whole matrix by rows (CSR): row `i` has the entries `offsets[i]..offsets[i + 1]` of the columns and the form factors; one offset
    /// more than rows.
    pub fn csr(&self) -> (&[u64], &[u32], &[f32]) {
        let Matrix { offsets, columns, factors, .. } = &self.matrix;
        (offsets, columns, factors)
    }

    /// One form factor; 0 if there is no entry.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn factor(&self, from: usize, to: usize) -> f32 {
        let (columns, factors) = self.row(from);
        columns.binary_search(&(to as u32)).map_or(0.0, |at| factors[at])
    }

    /// Names of the rows: those of objects or materials, which need not be unique; none for polygons.
    pub fn names(&self) -> &[String] {
        &self.matrix.names
    }

    /// Area of each row, scene units squared; 0 for objects and materials without faces.
    pub fn areas(&self) -> &[f64] {
        &self.matrix.areas
    }

    /// Fraction of what each row sends out that leaves the scene, in `[0, 1]`.
    pub fn escaped(&self) -> &[f32] {
        &self.matrix.escaped
    }

    /// Fraction of what each row sends out that falls on back sides, in `[0, 1]`.
    pub fn lost(&self) -> &[f32] {
        &self.matrix.lost
    }

    /// Rays traced.
    pub fn rays(&self) -> u64 {
        self.report.rays
    }

    /// Mean over the polygons of |row sum + escaped + lost − 1| before closure: what sampling and discovery missed.
    pub fn row_sum_error(&self) -> f64 {
        self.report.row_sum_error
    }

    /// The same over the rows from which nothing escapes, after closure; 0 without such rows.
    pub fn closed_row_sum_error(&self) -> f64 {
        self.report.closed_row_sum_error
    }

    /// Writes the matrix, completely or not at all; the extension says the format: `npz` (as `scipy.sparse.load_npz` reads it), `csv`
    /// (from, to, factor) or `mtx` (Matrix Market).
    ///
    /// # Errors
    /// [`Error::Argument`] for another extension, [`Error::Io`] if the file cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let format = Format::of(path).map_err(|error| Error::Argument(format!("`path` {error}")))?;
        write(path, &self.matrix, format, None)
    }
}
