//! The record of a solution.

use crate::error::in_own_words;
use crate::model::summary::SceneSummary;
pub use crate::progress::timed;
use crate::radiosity::audit::{ErrorBarAudit, ErrorSource, Ledger, PointsError};
use crate::radiosity::links::Tally;
use crate::radiosity::mesh::RadiosityMesh;
use crate::radiosity::options::Options;
use crate::radiosity::refinement::{Iteration, StopReason};
use crate::radiosity::rgb::Rgb;
use crate::radiosity::surroundings::Unlit;
use crate::radiosity::transport::Convergence;
use serde::Serialize;

/// Seconds by stage.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Seconds {
    /// Reading the scene; the caller fills this in.
    pub load: f64,
    /// Building Embree's tree.
    pub embree: f64,
    /// Building clusters or, for exact visibility, reading them.
    pub hierarchy: f64,
    /// Measuring or reading the optics of clusters and comparing the costs of the engines (not for exact visibility).
    pub characterise: f64,
    /// Building elements and probing their surroundings.
    pub elements: f64,
    /// Refinement and sweeps.
    pub solve: f64,
    /// The local pass.
    pub local: f64,
    /// Irradiance at points.
    pub points: f64,
    /// The audit of error bars.
    pub audit: f64,
}

impl Seconds {
    /// Sum of all stages except reading the scene and the audit.
    pub fn work(&self) -> f64 {
        let Seconds { load: _, embree, hierarchy, characterise, elements, solve, local, points, audit: _ } =
            self;
        embree + hierarchy + characterise + elements + solve + local + points
    }
}

/// Everything about a solution except its light: the content of `solution.json`.
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
    /// Notes for the user.
    #[serde(serialize_with = "in_own_words")]
    pub warnings: Vec<String>,
    /// Steps of refinement.
    pub iterations: Vec<Iteration>,
    /// Why refinement ended.
    pub ended: StopReason,
    /// The last sweeps along links.
    #[serde(rename = "settled")]
    pub convergence: Convergence,
    /// The iterations of the local pass, if there was one.
    #[serde(rename = "settled_local")]
    pub local_convergence: Option<Convergence>,
    /// Whether the error estimate is no larger than [`Options::target_error`], where that is given, the energy balances and light arrives
    /// where it should.
    pub target_met: Option<bool>,
    /// Seconds by stage.
    pub seconds: Seconds,
    /// Origin of the clusters: `off` (built, not stored), `made` (built and stored) or `hit` (read).
    pub cache: String,
    /// Links at the end.
    pub links: usize,
    /// Elements at the end, clusters included.
    pub elements: usize,
    /// Sides without light, which have no elements.
    pub unlit: Unlit,
    /// Bytes of elements and links.
    pub bytes: usize,
    /// Segments for which triangles were tested, for links and points.
    pub exact_rays: u64,
    /// Bundles by method.
    pub bundles: Tally,
    /// The energy ledger.
    pub ledger: Ledger,
    /// RMS error of the elements' irradiance relative to its mean, that of points where their light was not asked for; `None` if it is
    /// unknown.
    pub error_estimate: Option<f64>,
    /// Upper end of the 95 % interval of the estimate; `None` for an estimate from error bars.
    pub error_estimate_upper: Option<f64>,
    /// Source of the estimate: an audit by independent paths, or the error bars if the audit had too few elements.
    pub error_estimate_source: Option<ErrorSource>,
    /// Error of the irradiance at points; none without an audit.
    pub points_error: Option<PointsError>,
    /// Comparison of error bars with errors; none if reflected light was omitted or the light of elements not asked for.
    pub audit: Option<ErrorBarAudit>,
    /// Mean irradiance over the lit sides, or over those of the inside if most of what is lit is inside, W/m², RGB; NaN where only direct
    /// light at points was computed.
    pub mean_irradiance: Rgb,
    /// Whether the caller interrupted the solution.
    pub interrupted: bool,
}

/// The result of a solution.
pub struct Outcome {
    /// The light of all surfaces.
    pub mesh: RadiosityMesh,
    /// The record of the solution.
    pub record: Record,
    /// Irradiance at the points asked for, W/m².
    pub irradiance: Vec<Rgb>,
}
