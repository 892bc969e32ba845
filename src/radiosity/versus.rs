//! The same question to two engines: whole solutions side by side, timed and compared.

use super::record::{Outcome, Seconds};
use super::run::run;
use super::{Options, Visibility};
use crate::Result;
use crate::model::Model;
use crate::points::{Comparison, Irradiance, Point, compare};
use crate::progress::Progress;
use crate::radiosity::links::Tally;
use serde::Serialize;

/// Another engine's solution beside one.
#[derive(Clone, Debug, Serialize)]
pub struct Versus {
    /// The other engine.
    pub visibility: Visibility,
    /// Its seconds by stage (reading the scene is not repeated and stays 0).
    pub seconds: Seconds,
    /// Its links at the end.
    pub links: usize,
    /// Its elements at the end.
    pub elements: usize,
    /// Its bundles by method.
    pub bundles: Tally,
    /// Its time over the solution's, reading the scene left out: above 1 if the other took longer.
    pub speedup: f64,
    /// The solution's irradiance at the points, compared with the other's.
    pub difference: Comparison,
}

/// Solves once more with another engine and compares; all other options are those of the outcome, which must hold irradiance
/// at these points.
///
/// # Errors
/// As [`run()`].
pub fn versus(
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
    let super::Record { seconds, links, elements, bundles, .. } = other.record;
    Ok(Versus { visibility, speedup: seconds.work() / own, seconds, links, elements, bundles, difference })
}
