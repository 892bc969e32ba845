//! Jacobi sweeps with a coarse-level correction.

use super::{Convergence, Field, LinkTransport};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::rgb::Rgb;

/// Bounds of the factor by which reflected light is scaled after a sweep: coarse links may reflect more light than they
/// receive, and the estimate of the factor then has no bound. It only accelerates the sweeps. 0.1 or 0.5 as lower
/// bound, 5 or 500 as upper bound change irradiance by less than 0.001 % (`constants.py solve`).
const MIN_SCALE: f64 = 0.2;
/// As above: at a reflectance of 0.98 and first light, 1 / (1 − 0.98) = 50 is the factor of all bounces.
const MAX_SCALE: f64 = 50.0;
/// Relative change, and number of sweeps, at which sweeps end after the deadline: the scale factor brings the remaining light to
/// the right sum after a few bounces. Change results with a time limit only.
const LATE_CHANGE: f64 = 1e-3;
const LATE_SWEEPS: usize = 16;

/// The irradiance `E = direct + K E` along links, from a first guess; without one from direct light. Sweeps until it changes by
/// less than `tolerance` of itself (mean by the weights of the unknowns), at most `max_sweeps` times, and after the deadline only a few times.
///
/// Every sweep reads the last sweep's light (Jacobi), so that the result does not depend on threads. Relaxing one unknown at a
/// time, in turn or by its residual (Southwell), needs more work and one thread. After each sweep all
/// reflected light is scaled, by channel, to the sum that its energy balance implies: a coarse level of one unknown, which
/// removes the slow uniform mode of bright scenes and bounds links that reflect more than they receive.
pub fn sweeps(
    transport: &LinkTransport,
    start: Option<Field>,
    tolerance: f64,
    max_sweeps: usize,
    deadline: &Deadline,
) -> (Field, Convergence) {
    let direct = transport.direct();
    let weights = transport.weights();
    let mut state = match start {
        Some(state) if state.len() == direct.len() => state,
        _ => direct.clone(),
    };
    let mut convergence = Convergence::default();
    let enough = |c: &Convergence| c.sweeps >= LATE_SWEEPS || (c.sweeps > 0 && c.residual < LATE_CHANGE);
    while convergence.sweeps < max_sweeps && !(enough(&convergence) && deadline.late()) {
        convergence.sweeps += 1;
        let next = transport.bounce(&state);
        let (mut moved, mut total) = (0.0, 0.0);
        let (mut emitted, mut reflected, mut before) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for (i, weight) in weights.iter().enumerate() {
            for k in 0..3 {
                moved += weight * (next[i][k] - state[i][k]).abs();
                total += weight * next[i][k];
                emitted[k] += weight * direct[i][k];
                reflected[k] += weight * (next[i][k] - direct[i][k]);
                before[k] += weight * state[i][k];
            }
        }
        convergence.residual = if total > 0.0 { moved / total } else { 0.0 };
        convergence.converged = convergence.residual < tolerance;
        if convergence.converged {
            state = next;
            break;
        }
        // With x the scale of the light before the sweep, x before = emitted + x reflected.
        let scale: Rgb = std::array::from_fn(|k| {
            let kept = before[k] - reflected[k];
            if kept > 0.0 {
                (emitted[k] / kept).clamp(MIN_SCALE, MAX_SCALE)
            } else if reflected[k] > 0.0 {
                before[k] / reflected[k]
            } else {
                1.0
            }
        });
        let scaled =
            |i: usize| std::array::from_fn(|k| direct[i][k] + scale[k] * (next[i][k] - direct[i][k]));
        state = (0..next.len()).map(scaled).collect();
    }
    (state, convergence)
}
