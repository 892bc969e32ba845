//! Exact against multi-resolution visibility on the same segments.

use crate::bench::{self, Options, page, record::Record};
use crate::files::json_text;
use crate::model::{Detail, Model};
use crate::{Error, Result, optics};

/// Options of [`Model::bench`]: [`BenchOptions::default`] with other values of some fields.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct BenchOptions {
    /// Receiver points, uniform over all surfaces that do not emit, 1 to 100 million; default 20,000.
    pub points: usize,
    /// Segments from a point to an emitter, 1 to 65,536; 4 and 16 times as many are measured as well. Default 16.
    pub rays: usize,
    /// Feature sizes, scene units, above 0; default none: four sizes from two texels of the shadow images to a fifth of the largest.
    pub feature_sizes: Vec<f64>,
    /// Objects, groups or materials for shadow images; default none: the largest flat surfaces, and terrain.
    pub receivers: Vec<String>,
    /// Rays from a point to an emitter in the reference, 1 to 65,536; default 1,024.
    pub reference_rays: usize,
    /// Threads of the timed sections, 1 to 1024; default 1. All else runs on the threads of the model.
    pub threads: usize,
    /// Part of the bundles, in `[0, 1]`, on which independent exact rays check the stated intervals; default 0.05.
    pub audit: f64,
    /// Largest memory of the results, bytes; default: four fifths of the available memory.
    pub max_memory: Option<u64>,
    /// Seed of all random numbers; default 1.
    pub seed: u64,
    /// Rounds of the timed sections.
    pub(super) rounds: usize,
}

impl Default for BenchOptions {
    fn default() -> BenchOptions {
        let Options { points, rays, feature_sizes, receivers, reference_rays, .. } = Options::default();
        let Options { threads, audit, max_memory, seed, rounds, .. } = Options::default();
        BenchOptions {
            points,
            rays,
            feature_sizes,
            receivers,
            reference_rays,
            threads,
            audit,
            max_memory,
            seed,
            rounds,
        }
    }
}

impl BenchOptions {
    fn options(&self, clusters: optics::Options) -> Options {
        let BenchOptions { points, rays, feature_sizes, receivers, reference_rays, .. } = self.clone();
        let &BenchOptions { threads, audit, max_memory, seed, rounds, .. } = self;
        Options {
            points,
            rays,
            feature_sizes,
            receivers,
            reference_rays,
            threads,
            audit,
            max_memory,
            seed,
            rounds,
            clusters,
            ..Options::default()
        }
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
    /// or receives light; [`Error::Cancelled`] if the caller's progress stops it, which is asked between its stages.
    pub fn bench(&self, options: &BenchOptions) -> Result<BenchReport> {
        if self.detail() < Detail::Optics {
            return Err(Error::Argument(
                "the benchmark needs optics: prepare the model with `Detail::Optics`".into(),
            ));
        }
        let options = options.options(self.optics_options());
        self.on_threads(|| {
            let (record, images) = bench::run(self, &options, self.progress())?;
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
