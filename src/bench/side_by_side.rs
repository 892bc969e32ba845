//! One question to two engines: whole solutions side by side, timed and compared.

use crate::Result;
use crate::model::Model;
use crate::points::{Comparison, Irradiance, Point, compare};
use crate::progress::Progress;
use crate::radiosity::links::Tally;
use crate::radiosity::{Options, Outcome, Record, Seconds, Visibility, run};
use serde::Serialize;

/// The solution of another engine, compared with a first one.
#[derive(Clone, Debug, Serialize)]
pub struct Versus {
    /// The other engine.
    pub visibility: Visibility,
    /// Seconds by stage of the other engine (reading the scene is not repeated and stays 0).
    pub seconds: Seconds,
    /// Links at the end.
    pub links: usize,
    /// Elements at the end.
    pub elements: usize,
    /// Bundles by method.
    pub bundles: Tally,
    /// Time of the other engine divided by that of the first, without reading the scene: above 1 if the other took longer.
    pub speedup: f64,
    /// Irradiance of the first solution at the points, compared with that of the other.
    pub difference: Comparison,
}

/// A record with the comparison: what `solution.json` holds.
#[derive(Clone, Debug, Serialize)]
pub struct ComparedRecord {
    /// The first solution.
    #[serde(flatten)]
    pub record: Record,
    /// The solution of another engine, where it was asked for.
    pub versus: Option<Versus>,
}

/// Solves once more with another engine and compares. All other options are those of the outcome, which must hold the irradiance
/// at these points.
///
/// # Errors
/// As [`run()`].
pub fn side_by_side(
    model: &Model,
    points: &[Point],
    outcome: &Outcome,
    visibility: Visibility,
    progress: &dyn Progress,
) -> Result<Versus> {
    let record = &outcome.record;
    let options = Options { visibility, ..record.options.clone() };
    let model = model.prepared_to(&options.prepare(), progress)?;
    let other = run(&model, points, &options, progress)?;
    let at = |outcome: &Outcome| Irradiance {
        points: points.to_vec(),
        values: outcome.irradiance.clone(),
        standard_errors: Vec::new(),
    };
    let difference = compare(&at(&other), &at(outcome))?;
    let own = record.seconds.work().max(f64::MIN_POSITIVE);
    let Record { seconds, links, elements, bundles, .. } = other.record;
    Ok(Versus { visibility, speedup: seconds.work() / own, seconds, links, elements, bundles, difference })
}
