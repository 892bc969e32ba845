//! Light on grids of points, from the records of `solve` jobs.

use super::journal::Entry;
use super::table::record;
use serde::Deserialize;
use std::path::Path;

/// A grid in a record; see `--grid` of `mrvis solve`.
#[derive(Clone, Debug, Deserialize, PartialEq)]
pub struct RecordedGrid {
    /// The object, group or material.
    pub name: String,
    /// Number of points along the horizontal side.
    pub columns: usize,
    /// Number of points along the vertical side.
    pub rows: usize,
    /// Height above the surface, scene units.
    pub height: f64,
    /// Unit of the light.
    pub unit: String,
    /// Smallest light.
    pub minimum: f64,
    /// Mean light.
    pub mean: f64,
    /// Largest light.
    pub maximum: f64,
    /// Minimum divided by mean.
    pub uniformity: Option<f64>,
}

/// A grid of a job.
#[derive(Clone, Debug)]
pub struct JobGrid {
    /// Name of the job.
    pub job: String,
    /// The grid.
    pub grid: RecordedGrid,
}

/// The grids of jobs with outputs below `out`, in the order of the jobs.
pub fn grids<'a>(out: &Path, entries: impl IntoIterator<Item = &'a Entry>) -> Vec<JobGrid> {
    let of = |entry: &Entry| -> Vec<JobGrid> {
        let fields = record(&out.join(&entry.job).join(&entry.record)).unwrap_or_default();
        let grids = fields.get("grids").and_then(|grids| Vec::<RecordedGrid>::deserialize(grids).ok());
        let of_job = |grid| JobGrid { job: entry.job.clone(), grid };
        grids.unwrap_or_default().into_iter().map(of_job).collect()
    };
    entries.into_iter().filter(|entry| entry.has_outputs()).flat_map(of).collect()
}
