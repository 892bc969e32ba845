//! One bounce of light as an operator.

use crate::radiosity::rgb::Rgb;
use serde::Serialize;

/// One RGB value for each unknown.
pub type Field = Vec<Rgb>;

/// Transport of light between unknowns, each an irradiance in W/m²: `E = direct + K E`.
///
/// Rows of `K` are links (hierarchical, through the tree of elements) or rays (the local pass).
pub trait Transport: Sync {
    /// Irradiance that emitters cause directly.
    fn direct(&self) -> Field;
    /// `K E`: irradiance that the reflection of `irradiance` causes.
    fn reflected(&self, irradiance: &Field) -> Field;
    /// `direct + K E`: irradiance after one more bounce.
    fn bounce(&self, irradiance: &Field) -> Field;
    /// Weight of each unknown in sums over the scene.
    fn weights(&self) -> &[f64];
    /// Terms that one application of `K` adds up.
    fn terms(&self) -> usize;
}

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
