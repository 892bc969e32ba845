//! What is written down about a solution.

use super::field::Rgb;
use super::{Audit, Ledger, Options, Versus};
use crate::model::summary::SceneSummary;
use crate::radiosity::links::Tally;
use crate::radiosity::solution::Solution;
use serde::Serialize;

/// One step of refinement with the sweeps after it.
#[derive(Clone, Debug, Serialize)]
pub struct Iteration {
    /// Time it took.
    pub seconds: f64,
    /// Links after it.
    pub links: usize,
    /// Elements after it.
    pub elements: usize,
    /// Links that were replaced.
    pub refined: usize,
    /// Largest link error left that could be refined, relative to the mean irradiance.
    pub error_bound: f64,
    /// Relative change of the radiosity in the last sweep.
    pub residual: f64,
}

/// Why refinement ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ended {
    /// No link that could be refined is above the error asked for.
    Error,
    /// The estimated error was no larger than the target.
    Target,
    /// The time was up.
    Time,
    /// There were as many links as allowed.
    Links,
    /// Somebody asked for it.
    Interrupted,
    /// There was nothing to refine: no light, or only what emitters send to points.
    Nothing,
}

/// How sweeps of light ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Settled {
    /// Sweeps made.
    pub sweeps: usize,
    /// What is left to change, relative to the light (along links: in the last sweep; by rays: to what emitters send).
    pub residual: f64,
    /// Whether that is as little as asked for.
    pub converged: bool,
}

/// Sides of surfaces that no light reaches: they have no elements. None are looked for in scenes with clusters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Unlit {
    /// How many.
    pub sides: usize,
    /// Of so many.
    pub of: usize,
    /// Their part of the area of all, in `[0, 1]`.
    pub area: f64,
}

/// Seconds by stage.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Seconds {
    /// Reading the scene; filled in by who read it.
    pub load: f64,
    /// Embree's tree.
    pub embree: f64,
    /// Clusters, made or (for exact visibility) read.
    pub hierarchy: f64,
    /// What clusters do to light, measured or read, and what exact rays are worth (not for exact visibility).
    pub characterise: f64,
    /// Elements and the rays that probe their surroundings.
    pub elements: f64,
    /// Refinement and sweeps.
    pub solve: f64,
    /// Rays of elements and the light on them.
    pub local: f64,
    /// Irradiance at points.
    pub points: f64,
    /// Checking error bars.
    pub audit: f64,
}

impl Seconds {
    /// All of them but reading the scene and checking error bars.
    pub fn work(&self) -> f64 {
        let Seconds { load: _, embree, hierarchy, characterise, elements, solve, local, points, audit: _ } =
            self;
        embree + hierarchy + characterise + elements + solve + local + points
    }
}

/// Everything about a solution but its light: what `solution.json` holds.
#[derive(Clone, Debug, Serialize)]
pub struct Record {
    /// Version of this program.
    pub mrvis: String,
    /// Version of Embree.
    pub embree: String,
    /// Threads used.
    pub threads: usize,
    /// Unit of length.
    pub unit: String,
    /// The options.
    pub options: Options,
    /// The scene.
    pub scene: SceneSummary,
    /// What a user should know.
    pub warnings: Vec<String>,
    /// Steps of refinement.
    pub iterations: Vec<Iteration>,
    /// Why there are no more of them.
    pub ended: Ended,
    /// The last sweeps along links.
    pub settled: Settled,
    /// Those of the local pass, if there was one.
    pub settled_local: Option<Settled>,
    /// Whether the error estimate is no larger than [`Options::target_error`], where that is given.
    pub target_met: Option<bool>,
    /// Seconds by stage.
    pub seconds: Seconds,
    /// Where the clusters came from: `off` (made, not kept), `made` (and kept for the next run) or `hit` (kept by another).
    pub cache: String,
    /// Links at the end.
    pub links: usize,
    /// Elements at the end, clusters included.
    pub elements: usize,
    /// Sides without elements.
    pub unlit: Unlit,
    /// Bytes of elements and links.
    pub bytes: usize,
    /// Exact segments traced, for links, probes and points.
    pub exact_rays: u64,
    /// Bundles by method.
    pub bundles: Tally,
    /// Where the energy went.
    pub ledger: Ledger,
    /// Estimated RMS error of the elements' irradiance relative to its mean.
    pub error_estimate: f64,
    /// How error bars compare with errors; none where no bounces were asked for.
    pub audit: Option<Audit>,
    /// Mean irradiance over all elements, W/m², RGB.
    pub mean_irradiance: Rgb,
    /// Whether refinement was ended from outside.
    pub interrupted: bool,
    /// Another engine's solution, where it was asked for.
    pub versus: Option<Versus>,
}

/// A solution.
pub struct Outcome {
    /// The light.
    pub solution: Solution,
    /// About it.
    pub record: Record,
    /// At the points asked for.
    pub irradiance: Vec<Rgb>,
}
