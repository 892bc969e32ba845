//! Exact against multi-resolution visibility on the same segments.

use crate::bench::{self, Options, page, record::MrRow};
use crate::files::json_text;
use crate::model::{Detail, Model};
use crate::{Error, Result};

/// Options of [`Model::bench`]: [`BenchOptions::default`] with other values of some fields.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct BenchOptions {
    /// Receiver points, uniform over all surfaces that do not emit, 1 to 100 million; default 20,000.
    pub points: usize,
    /// Segments from a point to an emitter, 1 to 65,536; 4 and 16 times as many are measured as well. Default 16.
    pub rays: usize,
    /// Feature sizes, scene units, above 0; default none: four sizes from two texels of the shadow images to a fifth of the largest receiver.
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

/// Options of this or of the inner kind from those of the other: the fields that both have.
macro_rules! with_fields_of {
    ($given:expr, $kind:ident $(, $rest:expr)?) => {{
        let given = $given;
        $kind {
            points: given.points,
            rays: given.rays,
            feature_sizes: given.feature_sizes,
            receivers: given.receivers,
            reference_rays: given.reference_rays,
            threads: given.threads,
            audit: given.audit,
            max_memory: given.max_memory,
            seed: given.seed,
            rounds: given.rounds,
            $(..$rest)?
        }
    }};
}

impl Default for BenchOptions {
    fn default() -> BenchOptions {
        with_fields_of!(Options::default(), BenchOptions)
    }
}

/// Results of [`Model::bench`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct BenchReport {
    /// Multi-resolution visibility by number of rays and feature size; one row if nothing is averaged at the default sizes.
    pub rows: Vec<BenchRow>,
    /// The whole record as JSON: the content of `bench --json`. The time of reading the scene is 0.
    pub json: String,
    /// The report as one HTML page with pictures and charts: `report.html` of the command. It refers to no other file.
    pub page: String,
}

/// Multi-resolution visibility with one feature size and number of rays; errors are those of visible fractions in `[0, 1]`.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct BenchRow {
    /// Feature size, scene units.
    pub feature_size: f64,
    /// Segments from a point to an emitter.
    pub rays: usize,
    /// Time of the queries, seconds.
    pub seconds: f64,
    /// Root mean square error.
    pub rms: f64,
    /// Mean error; positive: too bright.
    pub bias: f64,
    /// Part of the stated 95 % intervals, in `[0, 1]`, that the reference confirms.
    pub interval_coverage: f64,
    /// Part of the segments, in `[0, 1]`, that met at least one averaged cluster.
    pub aggregated: f64,
    /// Time of the fastest exact rays for the same RMS error divided by this time; `None` if undefined, for example without any error.
    pub speedup: Option<f64>,
}

impl BenchRow {
    fn of(row: &MrRow) -> BenchRow {
        let &MrRow { feature_size, rays, seconds, rms, bias, interval_coverage, .. } = row;
        let (aggregated, speedup) = (row.aggregated_fraction, row.speedup_at_same_rms);
        BenchRow { feature_size, rays, seconds, rms, bias, interval_coverage, aggregated, speedup }
    }
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
            return Err(Error::arguments(
                "the benchmark needs optics: prepare the model with ⟨Detail::Optics⟩".into(),
            ));
        }
        let more = Options { clusters: self.optics_options(), ..Options::default() };
        let options = with_fields_of!(options.clone(), Options, more);
        self.on_threads(|| {
            let (record, images) = bench::run(self, &options, self.progress())?;
            let page = page::render(&record, &images, "")?;
            let rows = record.mr.iter().map(BenchRow::of).collect();
            let json = json_text(&record).expect("numbers, texts and lists alone");
            Ok(BenchReport { rows, json, page })
        })?
    }
}
