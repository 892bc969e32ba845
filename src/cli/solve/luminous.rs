//! Luminous quantities of a solution.

use crate::bench::side_by_side::ComparedRecord;
use crate::cli::mpi::Sharing;
use crate::radiosity::Record;
use crate::scene::Photometry;
use serde::Serialize;

/// The record with luminous quantities, and what the ranks have shared.
#[derive(Serialize)]
pub struct Reported {
    #[serde(flatten)]
    pub compared: ComparedRecord,
    /// Only with `--photometric`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub photometric: Option<Luminous>,
    /// Only with `--mpi`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sharing: Option<Sharing>,
}

/// Luminous quantities of the whole scene.
#[derive(Serialize)]
pub struct Luminous {
    #[serde(flatten)]
    pub photometry: Photometry,
    /// Mean illuminance of the elements, lx.
    pub mean_illuminance_lx: f64,
}

impl Luminous {
    /// From the record of a solution.
    pub fn of(photometry: Photometry, record: &Record) -> Luminous {
        Luminous { photometry, mean_illuminance_lx: photometry.of(record.mean_irradiance) }
    }
}
