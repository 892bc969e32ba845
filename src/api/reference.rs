//! Irradiance at points by path tracing.

use super::solve::SurfacePoint;
use crate::Result;
use crate::model::Model;
use crate::path_tracer::{Settings, irradiance};

/// Irradiance at points by path tracing; see [`Model::reference`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Reference {
    /// Irradiance at each point, W/m², linear RGB.
    pub irradiance: Vec<[f64; 3]>,
    /// Its standard error, W/m².
    pub standard_errors: Vec<[f64; 3]>,
}

impl Model {
    /// Irradiance at points of surfaces by path tracing with all reflections: `samples` paths for each point, at least 2, best 8 times a
    /// power of two. Independent of clusters, elements and form factors. Needs [`Detail::Rays`](crate::Detail::Rays).
    ///
    /// A point means the nearest surface along its normal that is about parallel, within 1e-5 of the scene's diagonal.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) if a position is not finite or beyond 1e12, a normal has no length or there are fewer
    /// than 2 samples; [`Error::Cancelled`](crate::Error::Cancelled) if the caller's progress stops it.
    pub fn reference(&self, points: &[SurfacePoint], samples: u32, seed: u64) -> Result<Reference> {
        self.reference_of(points.len(), |i| points[i], samples, false, seed)
    }

    /// [`Model::reference`] at `count` points that `at` gives: they are copied once. `direct_only`: without reflections.
    #[doc(hidden)]
    pub fn reference_of(
        &self,
        count: usize,
        at: impl Fn(usize) -> SurfacePoint,
        samples: u32,
        direct_only: bool,
        seed: u64,
    ) -> Result<Reference> {
        let points = SurfacePoint::all_checked(count, at, self.scene().origin, |point| point)?;
        let settings = Settings { samples, direct_only, seed };
        let found = self.on_threads(|| irradiance(self, &points, settings, self.progress()))??;
        Ok(Reference { irradiance: found.values, standard_errors: found.standard_errors })
    }
}
