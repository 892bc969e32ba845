//! Measurements of a model: exact against multi-resolution visibility on the same segments.

use crate::bench::record::MrRow;
use crate::bench::{self, BenchOptions, page};
use crate::files::json_text;
use crate::model::{Detail, Model};
use crate::{Error, Result};

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
    /// Fraction of the stated 95 % intervals, in `[0, 1]`, that the reference confirms.
    pub interval_coverage: f64,
    /// Fraction of the segments, in `[0, 1]`, that met at least one averaged cluster.
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
    /// [`Error::Argument`] if an option is out of its range or names nothing, or the model holds no optics; [`Error::Scene`] if nothing
    /// emits or receives light; [`Error::Cancelled`] if the caller's progress stops it, which is asked between its stages.
    pub fn bench(&self, options: &BenchOptions) -> Result<BenchReport> {
        if self.detail() < Detail::Optics {
            return Err(Error::arguments(
                "the benchmark needs optics: prepare the model with ⟨Detail::Optics⟩".into(),
            ));
        }
        self.on_threads(|| {
            let (record, images) = bench::run(self, options, self.progress())?;
            let page = page::render(&record, &images, "")?;
            let rows = record.mr.iter().map(BenchRow::of).collect();
            let json = json_text(&record).expect("numbers, texts and lists alone");
            Ok(BenchReport { rows, json, page })
        })?
    }
}
