//! Solves a model with a second visibility engine and compares time and irradiance of both solutions.

use crate::points::Comparison;
use crate::radiosity::links::Tally;
use crate::radiosity::{Record, Seconds};
use crate::visibility::Engine;
use crate::{
    Result,
    model::Model,
    points::{Irradiance, Point, compare},
    progress::Progress,
    radiosity::{Options, Outcome, run},
};
use serde::Serialize;

/// The solution of the second engine, compared with that of the first.
#[derive(Clone, Debug, Serialize)]
pub struct SideBySide {
    /// The second engine.
    #[serde(rename = "visibility")]
    pub engine: Engine,
    /// Seconds of each stage with the second engine. The scene is not read again, so that `load` is 0.
    pub seconds: Seconds,
    /// Links at the end of the solve.
    pub links: usize,
    /// Elements at the end of the solve, clusters included.
    pub elements: usize,
    /// Number of bundles of segments by the method that answered them.
    pub bundles: Tally,
    /// Seconds of the second engine divided by those of the first, without reading the scene and without the audit: above 1 if the
    /// first is faster.
    pub speedup: f64,
    /// Difference of the irradiance at the points: that of the first solution, with the second as reference.
    pub difference: Comparison,
}

/// Content of `solution.json`: the record of a solve, and the comparison if there is one.
#[derive(Clone, Debug, Serialize)]
pub struct ComparedRecord {
    /// The record of the first solution.
    #[serde(flatten)]
    pub record: Record,
    /// The comparison with a second engine; `null` without one.
    pub versus: Option<SideBySide>,
}

/// Solves the model again with the engine `engine` and compares the result with `outcome`. All other options are those of
/// `outcome`, which must hold the irradiance at `points`.
///
/// # Errors
/// As [`run()`].
pub fn side_by_side(
    model: &Model,
    points: &[Point],
    outcome: &Outcome,
    engine: Engine,
    progress: &dyn Progress,
) -> Result<SideBySide> {
    let record = &outcome.record;
    let options = Options { engine, ..record.options.clone() };
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
    Ok(SideBySide { engine, speedup: seconds.work() / own, seconds, links, elements, bundles, difference })
}
