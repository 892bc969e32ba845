//! The error of the irradiance at points: a sample of them is computed again by the path tracer, which shares nothing with the solver.

use crate::Result;
use crate::model::Model;
use crate::path_tracer::{self, Settings};
use crate::points::Point;
use crate::progress::Progress;
use crate::radiosity::deadline::Deadline;
use crate::radiosity::options::Options;
use crate::radiosity::rgb::{Rgb, mean};

/// Paths of all sampled points together: 512 for each of 200 points, by which irradiance is known to about 3 %.
const PATHS: usize = 200 * 512;
/// Largest number of paths of a point, where there are few: sixteen times 512, by which irradiance is known to a quarter of 3 %.
const MAX_PATHS: usize = 1 << 13;

/// Error of the irradiance at points.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PointsError {
    /// Points that were computed again, evenly spaced among all.
    pub points: usize,
    /// Root mean square of their errors, less the noise of the paths, relative to the mean irradiance of all points; at least
    /// `detection_limit`.
    pub rms: f64,
    /// Smallest error that can be told from the noise of the paths, relative to the same mean.
    pub detection_limit: f64,
    /// Upper end of its 95 % interval.
    pub rms_upper: f64,
}

/// Progress that stops the path tracer at the deadline.
struct DeadlineProgress<'a>(&'a Deadline<'a>);

impl Progress for DeadlineProgress<'_> {
    fn stage(&self, name: &str, steps: u64) {
        self.0.stage(name, steps as usize);
    }

    fn advance(&self, steps: u64) {
        self.0.advance(steps as usize);
    }

    fn stopped(&self) -> bool {
        self.0.late()
    }
}

impl PointsError {
    /// The error of `irradiance` (W/m²) at `points`, by [`Options::audit`] of them; `None` without light, for a single point, or if the
    /// time does not suffice.
    pub fn of(
        model: &Model,
        points: &[Point],
        irradiance: &[Rgb],
        options: &Options,
        deadline: &Deadline,
    ) -> Option<PointsError> {
        let count = points.len().min(options.audit);
        let level = irradiance.iter().map(|e| mean(*e)).sum::<f64>() / points.len().max(1) as f64;
        if count < 2 || level <= 0.0 {
            return None;
        }
        let sampled: Vec<usize> = (0..count).map(|k| k * points.len() / count).collect();
        let chosen: Vec<Point> = sampled.iter().map(|&i| points[i]).collect();
        let samples = (PATHS / count).clamp(2, MAX_PATHS) as u32;
        // Other paths than those of `mrvis reference` with the same seed.
        let settings = Settings { samples, direct_only: options.direct_only, seed: !options.seed };
        let traced: Result<_> =
            path_tracer::irradiance(model, &chosen, settings, &DeadlineProgress(deadline));
        let traced = traced.ok()?;
        let square = |(k, &i): (usize, &usize)| {
            let error = mean(irradiance[i]) - mean(traced.values[k]);
            error * error - mean(traced.standard_errors[k]).powi(2)
        };
        let squares: Vec<f64> = sampled.iter().enumerate().map(square).collect();
        let (found, resolved) = super::error_bars::mean_square(&squares)?;
        Some(PointsError {
            points: count,
            rms: found.max(resolved).sqrt() / level,
            detection_limit: resolved.sqrt() / level,
            rms_upper: (found.max(0.0) + 2.0 * resolved).sqrt() / level,
        })
    }
}
