//! Light transport: one bounce of light along links or along rays, row normalisation, and a solver for each.
//!
//! The light along links changes with every refinement step: a few sweeps from the last solution are enough. The light on the rays of the
//! local pass is solved once and accurately; the Krylov method needs two applications of the operator an iteration, but few iterations
//! however white the surfaces are.

mod active_nodes;
mod directional;
mod gather_push_pull;
mod krylov;
mod link_transport;
mod ray_transport;
mod row_normalisation;
mod transport_matrix;

pub use active_nodes::ActiveNodes;
pub use directional::{DirectionalIrradiance, NodeIrradiance, emission_moments};
pub use gather_push_pull::{MIN_PROJECTED, NodeRadiosity, gather, pushed};
pub use krylov::solve;
pub use link_transport::{LinkTransport, sweeps};
pub use ray_transport::{Path, RayTransport};
pub use row_normalisation::{cap_row_sums, link_row_sums, normalise_link_rows, short_rows};
pub use transport_matrix::{MatrixRow, TransportMatrix};

use crate::radiosity::rgb::Rgb;
use serde::Serialize;

/// One RGB value for each unknown: an irradiance in W/m².
pub type Field = Vec<Rgb>;

/// How a solution converged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Convergence {
    /// Applications of the transport operator.
    pub sweeps: usize,
    /// Remaining change relative to the light (along links: of the last sweep; by rays: relative to direct light).
    pub residual: f64,
    /// Whether the residual is as small as asked for.
    pub converged: bool,
}
