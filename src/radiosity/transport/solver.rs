//! The solver for both kinds of transport.

use super::krylov::krylov;
use super::operator::{Convergence, Field, Transport};
use super::sweeps::sweeps;
use crate::radiosity::deadline::Deadline;

/// How a transport equation is solved.
///
/// The light along links changes with every refinement step: a few sweeps from the last solution are enough, and each is one
/// application of the operator. The light on the rays of the local pass is solved once and accurately; the Krylov method needs
/// two applications an iteration, but few iterations however white the surfaces are.
#[derive(Clone, Copy, Debug)]
pub enum Method {
    /// Jacobi sweeps with a coarse-level correction, until the light changes by less than `tolerance` of itself.
    Sweeps {
        /// Relative change at which the sweeps end.
        tolerance: f64,
        /// Largest number of sweeps.
        max_sweeps: usize,
    },
    /// Stabilised bi-conjugate gradients.
    Krylov,
}

/// The irradiance `E = direct + K E`, from a first guess. Without one the iteration begins with direct light.
pub fn solve(
    transport: &dyn Transport,
    start: Option<Field>,
    method: Method,
    deadline: &Deadline,
) -> (Field, Convergence) {
    match method {
        Method::Sweeps { tolerance, max_sweeps } => sweeps(transport, start, tolerance, max_sweeps, deadline),
        Method::Krylov => krylov(transport, start, deadline),
    }
}
