//! Luminous quantities of a solution.

use super::at_points::AtPoints;
use super::grids::MeasuredGrid;
use crate::cli::mpi::Sharing;
use mrvis::internals::bench::side_by_side::ComparedRecord;
use mrvis::internals::export::SurfaceLight;
use mrvis::internals::radiosity::{Powers, Record};
use mrvis::internals::scene::Photometry;
use serde::Serialize;

/// The record with luminous quantities, and what the ranks have shared.
#[derive(Serialize)]
pub struct Reported {
    #[serde(flatten)]
    pub compared: ComparedRecord,
    /// Only with `--photometric`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub photometric: Option<Luminous>,
    /// Light at the points of `--points`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_points: Option<AtPoints>,
    /// Light on the grids of `--grid`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub grids: Vec<MeasuredGrid>,
    /// Light of the largest surfaces, where the light of elements is asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<SurfaceLight>,
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
    /// Powers of the energy ledger.
    pub ledger: LuminousLedger,
}

/// Luminous powers, summed over all surfaces.
#[derive(Serialize)]
pub struct LuminousLedger {
    /// lm, or lx times scene units squared where the length of a scene unit is not known.
    pub unit: String,
    #[serde(flatten)]
    pub powers: Powers<f64>,
}

impl Luminous {
    /// From the record of a solution.
    pub fn of(photometry: Photometry, record: &Record) -> Luminous {
        let (powers, unit) = record.ledger.shown(Some(photometry));
        Luminous {
            photometry,
            mean_illuminance_lx: photometry.of(record.mean_irradiance),
            ledger: LuminousLedger { unit, powers },
        }
    }
}
