//! Irradiance by path tracing with Embree, all bounces: the reference for solutions.
//!
//! Independent of clusters, links, elements and form factors; every value has a standard error. Paths start with
//! cosine-distributed directions; at every vertex they sample a point on an emitter (next-event estimation) and
//! continue in a cosine-distributed direction. The balance heuristic combines both ways of hitting an emitter (Veach,
//! *Robust Monte Carlo Methods for Light Transport Simulation*, 1997, 9.2), which bounds the noise of large near
//! emitters and of small distant ones. Russian roulette ends paths without bias.
//!
//! Rays that leave the scene meet the sky; from every vertex one ray goes to each sun, and one in a direction that is drawn in proportion
//! to the radiance of the sky, combined with the others in the same way.
//!
//! Emission is radiance on the front side of a face (on both sides if the scene says so); the reflectance applies to
//! both sides.

mod light;
mod paths;
mod surfaces;
#[cfg(test)]
mod tests;

use crate::math::parallel;
use crate::model::Model;
use crate::points::{Irradiance, Point};
use crate::progress::Progress;
use crate::{Error, Result};
use light::PowerSampler;
use paths::Paths;
use serde::{Deserialize, Serialize};
use surfaces::Surfaces;

/// Options of [`irradiance`].
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Paths per point, at least 2. Stratification is best with 8 times a power of two.
    pub samples: u32,
    /// Whether to compute only the light that arrives directly from emitters.
    pub direct_only: bool,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// Irradiance at `points` with standard errors, W/m² per channel (independent of the scene's unit of length).
///
/// A point means the nearest surface along its normal that is about parallel, within `1e-5` of the scene's diagonal: files
/// round coordinates. Paths start a few rounding errors above it, on the side of the normal. The same settings give the
/// same bits on any number of threads and ranks. A scene without emitters and sky gives zeros.
///
/// # Errors
/// [`Error::Argument`] with fewer than two samples; [`Error::Cancelled`] if `progress` stops it.
pub fn irradiance(
    model: &Model,
    points: &[Point],
    settings: Settings,
    progress: &dyn Progress,
) -> Result<Irradiance> {
    if settings.samples < 2 {
        return Err(Error::argument("samples", settings.samples, "must be at least 2"));
    }
    progress.stage("following paths", points.len() as u64);
    let surfaces = Surfaces::new(model);
    let lights = PowerSampler::new(model.scene());
    let rows = model.ranks().rows(points.len());
    let paths = || Paths::new(&surfaces, lights.as_ref(), model.scene().sky(), settings);
    let estimates: Vec<Estimate> = parallel::try_map_with(rows.numbers(), paths, |paths, i| {
        if progress.stopped() {
            return Err(Error::Cancelled("stopped before all points had their paths".into()));
        }
        let estimate = paths.estimate(i as u64, &points[i]);
        progress.advance(rows.steps(1) as u64);
        Ok(estimate)
    })?;
    let estimates = rows.gather(estimates);
    Ok(Irradiance {
        points: points.to_vec(),
        values: estimates.iter().map(|e| e.mean).collect(),
        standard_errors: estimates.iter().map(|e| e.standard_error).collect(),
    })
}

/// A mean and its standard error, W/m², RGB.
#[derive(Deserialize, Serialize)]
struct Estimate {
    mean: [f64; 3],
    standard_error: [f64; 3],
}
