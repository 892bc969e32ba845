//! Irradiance by brute force: paths through the scene, traced by Embree, every bounce.
//!
//! The oracle that solutions are compared with. It knows nothing of clusters, links, elements or form factors, and every
//! value comes with a standard error. Paths start in directions spread by the cosine; at every vertex they look for a
//! point on an emitter (next-event estimation) and go on in a direction spread by the cosine; what both can find is
//! weighted by the balance heuristic (Veach, *Robust Monte Carlo Methods for Light Transport Simulation*, 1997, 9.2), so
//! that neither large near lamps nor small far ones are noisy. Paths end by Russian roulette, which leaves the mean alone.
//!
//! Emission is radiance on the front side of a face (on both if the scene says so); reflectance is that of both sides.

mod light;
mod paths;
mod surfaces;
#[cfg(test)]
mod tests;

use crate::model::Model;
use crate::points::{Irradiance, Point};
use crate::{Error, Result};
use light::Lights;
use paths::Paths;
use rayon::prelude::*;
use surfaces::Surfaces;

/// How much is computed.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Paths a point, at least 2. Full use of the sample points' even spread: a multiple of 8 powers of two.
    pub samples: u32,
    /// Leaves out all bounces: only light that comes straight from emitters.
    pub direct_only: bool,
    /// Seed of everything random.
    pub seed: u64,
}

/// Irradiance at `points` with standard errors, W/m² in each channel (the scene's unit of length does not matter).
///
/// A path starts `1e-5` of the scene's diagonal off its point, along the normal, so that a point whose digits were
/// rounded is not below its own surface. The same settings give the same bits on any number of threads; `done` is called
/// with the number of points finished since the last call, from any thread. A scene without emitters gives zeros.
///
/// # Errors
/// Fewer than two samples.
pub fn irradiance(
    model: &Model,
    points: &[Point],
    settings: Settings,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Irradiance> {
    if settings.samples < 2 {
        return Err(Error::Argument("--samples must be at least 2".into()));
    }
    let surfaces = Surfaces::new(model);
    let lights = Lights::new(model.scene());
    let estimates: Vec<Estimate> = points
        .par_iter()
        .enumerate()
        .map_init(
            || Paths::new(&surfaces, lights.as_ref(), settings),
            |paths, (i, point)| {
                let estimate = paths.estimate(i as u64, point);
                done(1);
                estimate
            },
        )
        .collect();
    Ok(Irradiance {
        points: points.to_vec(),
        values: estimates.iter().map(|e| e.mean).collect(),
        standard_errors: estimates.iter().map(|e| e.standard_error).collect(),
    })
}

/// A value with its standard error, in each channel.
struct Estimate {
    mean: [f64; 3],
    standard_error: [f64; 3],
}
