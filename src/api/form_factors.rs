//! Form factors of a model, with occlusion.

use crate::form_factors::matrix::{
    Facets, FormFactors, Format, Grouping, Settings, by_groups, compute, memory_bound, write,
};
use crate::model::Model;
use crate::{Error, Result, memory};
use std::path::Path;

options! {
    /// Options of [`Model::form_factors`]: [`FormFactorOptions::default`] with other values of some fields.
    #[derive(Clone, Debug)]
    #[non_exhaustive]
    pub struct FormFactorOptions {
        /// Rows and columns; default [`Grouping::Polygon`].
        pub grouping: Grouping = Grouping::Polygon;
        /// Rays of every polygon that look for what it sees; `None`: 2,048, more where there are few polygons.
        pub rays: Option<u32> = None, in 1..=1_048_576;
        /// Largest number of rays between two polygons that are partly hidden from each other; `None`: 256, more where there are few.
        pub pair_rays: Option<u32> = None, in 4..=4_194_304;
        /// Whether rows that nothing escapes from are adjusted to the sum 1, each entry by as much as it is uncertain; default true. A F is
        /// symmetric either way.
        pub closure: bool = true;
        /// Largest memory of the matrix, bytes: an error before the start if it could take more; default: four fifths of the available
        /// memory.
        pub max_bytes: Option<u64> = None;
        /// Seed of all random numbers; default 1.
        pub seed: u64 = 1;
    }
}

impl FormFactorOptions {
    fn settings(&self, facets: usize) -> Result<Settings> {
        self.check_ranges()?;
        let settings = Settings { enforce: self.closure, seed: self.seed, ..Settings::new(facets) };
        let settings = settings.with_rays(self.rays, self.pair_rays);
        let (bytes, limit) = (memory_bound(facets, &settings), self.max_bytes.or_else(memory::usable));
        if let Some(limit) = limit.filter(|&limit| bytes > limit) {
            return Err(Error::OutOfMemory(format!(
                "the matrix of {facets} polygons could take {bytes} bytes: raise ⟨max_bytes⟩ (now {limit}) or lower ⟨rays⟩"
            )));
        }
        Ok(settings)
    }
}

impl Model {
    /// Form factors between all polygons, objects or materials, by exact rays on the threads of the model. Needs
    /// [`Detail::Rays`](crate::Detail::Rays).
    ///
    /// # Errors
    /// [`Error::Argument`] if an option is out of its range, [`Error::OutOfMemory`] if the matrix could be too large, [`Error::Scene`]
    /// with more than 2²⁶ polygons, [`Error::Cancelled`] if the caller's progress stops it, which takes less than a second or so.
    pub fn form_factors(&self, options: &FormFactorOptions) -> Result<FormFactors> {
        self.on_threads(|| {
            let (scene, progress) = (self.scene(), self.progress());
            let facets = Facets::new_unless(scene, progress)?;
            let settings = options.settings(facets.count())?;
            let (factors, _) = compute(self, &facets, &settings, progress)?;
            by_groups(factors, scene, &facets, options.grouping, progress)
        })?
    }
}

impl FormFactors {
    /// Writes the matrix, completely or not at all; the extension says the format: `npz` (as `scipy.sparse.load_npz` reads it), `csv`
    /// (from, to, factor) or `mtx` (Matrix Market).
    ///
    /// # Errors
    /// [`Error::Argument`] for another extension, [`Error::Io`] if the file cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let format = Format::of(path)?;
        write(path, self, format, None)
    }
}
