//! Exact against multi-resolution visibility on the same segments.

use crate::bench::{self, Options, page, record::Record};
use crate::files::json_text;
use crate::model::{Detail, Model};
use crate::progress::Progress;
use crate::{Error, Result};

/// Options of [`Model::bench`]: [`BenchOptions::default`], then `with_…`.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct BenchOptions {
    pub(super) options: Options,
}

impl BenchOptions {
    /// Receiver points, uniform over all surfaces that do not emit, 1 to 100 million; default 20,000.
    #[must_use]
    pub fn with_points(mut self, points: usize) -> BenchOptions {
        self.options.points = points;
        self
    }

    /// Segments from a point to an emitter, 1 to 65,536; 4 and 16 times as many are measured as well. Default 16.
    #[must_use]
    pub fn with_rays(mut self, rays: usize) -> BenchOptions {
        self.options.rays = rays;
        self
    }

    /// A feature size, scene units, above 0. May be called several times; default: four sizes from two texels of the shadow images to a fifth of the largest receiver.
    #[must_use]
    pub fn with_feature_size(mut self, size: f64) -> BenchOptions {
        self.options.feature_sizes.push(size);
        self
    }

    /// An object, group or material for shadow images. May be called several times; default: the largest flat surfaces, and terrain.
    #[must_use]
    pub fn with_receiver(mut self, name: impl Into<String>) -> BenchOptions {
        self.options.receivers.push(name.into());
        self
    }

    /// Rays from a point to an emitter in the reference, 1 to 65,536; default 1,024.
    #[must_use]
    pub fn with_reference_rays(mut self, rays: usize) -> BenchOptions {
        self.options.reference_rays = rays;
        self
    }

    /// Threads of the timed sections, 1 to 1024; default 1. All else runs on the threads of the model.
    #[must_use]
    pub fn with_threads(mut self, threads: usize) -> BenchOptions {
        self.options.threads = threads;
        self
    }

    /// Part of the bundles, in `[0, 1]`, on which independent exact rays check the stated intervals; default 0.05.
    #[must_use]
    pub fn with_audit(mut self, part: f64) -> BenchOptions {
        self.options.audit = part;
        self
    }

    /// Largest memory of the results, bytes; default: four fifths of the available memory.
    #[must_use]
    pub fn with_max_memory(mut self, bytes: u64) -> BenchOptions {
        self.options.max_memory = Some(bytes);
        self
    }

    /// Seed of all random numbers; default 1.
    #[must_use]
    pub fn with_seed(mut self, seed: u64) -> BenchOptions {
        self.options.seed = seed;
        self
    }
}

/// Results of [`Model::bench`].
#[derive(Clone, Debug)]
pub struct BenchReport {
    record: Record,
    page: String,
}

impl Model {
    /// Measures time and error of exact and of multi-resolution visibility on the same segments of this model, as `mrvis bench` does.
    /// Needs [`Detail::Optics`]. Takes seconds to minutes; nothing else should run on the machine meanwhile.
    ///
    /// # Errors
    /// [`Error::Argument`] if an option is out of its range or names nothing, or the model holds no optics; [`Error::Scene`] if nothing emits
    /// or receives light; [`Error::Cancelled`] if `progress` stops it, which is asked between its stages.
    pub fn bench(&self, options: &BenchOptions, progress: &dyn Progress) -> Result<BenchReport> {
        if self.detail() < Detail::Optics {
            return Err(Error::Argument(
                "the benchmark needs optics: prepare the model with `Detail::Optics`".into(),
            ));
        }
        let options = Options { clusters: self.optics_options(), ..options.options.clone() };
        self.on_threads(|| {
            let (record, images) = bench::run(self, &options, progress)?;
            let page = page::render(&record, &images, "")?;
            Ok(BenchReport { record, page })
        })?
    }
}

impl BenchReport {
    /// The record as JSON: the content of `bench --json`. The time of reading the scene is 0.
    pub fn json(&self) -> String {
        json_text(&self.record).expect("numbers, texts and lists alone")
    }

    /// The report as one HTML page with pictures and charts: `report.html` of the command. It refers to no other file.
    pub fn page(&self) -> &str {
        &self.page
    }
}
