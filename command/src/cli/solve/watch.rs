//! Progress, interruption and the time limit of a solve.

use super::super::{interruption, job_context, progress::Bar};
use mrvis::internals::radiosity::Options;
use mrvis::{Engine, Error, Model, Progress, Result, Scene};
use std::sync::Arc;
use std::time::Instant;

/// Shows the stage of the solve, and says when to stop: by default once the user has interrupted it.
pub struct Watch<'a, S = fn() -> bool> {
    pub bar: &'a Bar,
    stopped: S,
}

impl<S: Fn() -> bool + Send + Sync> Progress for Watch<'_, S> {
    fn stage(&self, name: &str, steps: u64) {
        self.bar.stage(name, steps);
    }

    fn advance(&self, steps: u64) {
        self.bar.advance(steps);
    }

    fn stopped(&self) -> bool {
        (self.stopped)()
    }
}

/// Largest numbers of pixels of a picture, and of elements of a solution, of which all files are written even after an interruption: a
/// picture of a million pixels, and the smooth mesh of 100,000 elements with its files, each take about half a second on two cores.
const SMALL_PICTURE: usize = 1 << 20;
const SMALL_SOLUTION: usize = 100_000;

impl<'a> Watch<'a> {
    /// Stops at an interruption.
    pub fn new(bar: &'a Bar) -> Watch<'a> {
        Watch { bar, stopped: interruption::stopped }
    }

    /// Progress while files of a solution with this number of elements and pictures with this number of pixels are written. Stops large
    /// ones.
    pub fn for_files(&self, pixels: usize, elements: usize) -> impl Progress + use<'a> {
        let large = pixels > SMALL_PICTURE || elements > SMALL_SOLUTION;
        Watch { bar: self.bar, stopped: move || large && interruption::stopped() }
    }
}

/// Prepares the model within the time that the options allow for the whole solve.
pub fn prepare(scene: Arc<Scene>, options: &Options, watch: &Watch) -> Result<Model> {
    // What exact visibility needs is always prepared.
    let limit = options.max_seconds.filter(|_| options.engine != Engine::Exact);
    let left = limit.map_or(f64::INFINITY, |limit| limit - options.seconds_spent);
    // Clusters are measured only if time remains for the solve.
    let start = Instant::now();
    let until =
        Watch { bar: watch.bar, stopped: || watch.stopped() || start.elapsed().as_secs_f64() >= left };
    // A job with a limit of time does not wait for another one that prepares the same scene.
    let prepared = match options.max_seconds {
        Some(_) => Model::prepare_watched(scene, &options.prepare(), &until),
        None => job_context::prepare(scene, &options.prepare(), &until),
    };
    prepared.map_err(|error| match (error, options.max_seconds) {
        (Error::Cancelled(_), Some(seconds)) if !watch.stopped() => Error::arguments(format!(
            "--max-seconds {seconds}: the time was up before the clusters were measured; allow more (they are kept for the \
             next run) or take --visibility exact"
        )),
        (error, _) => error,
    })
}
