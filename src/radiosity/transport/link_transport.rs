//! Transport along links.

use super::active_nodes::{ActiveNodes, NodeKind};
use super::directional::{CLUSTER_UNKNOWNS, NodeIrradiance};
use super::gather_push_pull::{NodeRadiosity, gather};
use super::{Convergence, Field};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::{DIRECTIONS, Elements, RowFactors, Shape};
use crate::radiosity::rgb::Rgb;

/// Links as rows of the transport operator. Unknowns are the irradiances of the active nodes in the order of
/// [`NodeIrradiance::to_field`].
pub struct LinkTransport<'a> {
    elements: &'a Elements,
    nodes: &'a ActiveNodes,
    weights: Vec<f64>,
}

impl<'a> LinkTransport<'a> {
    /// For active nodes, with the row factors of the elements.
    pub fn new(elements: &'a Elements, nodes: &'a ActiveNodes) -> LinkTransport<'a> {
        let unknowns = CLUSTER_UNKNOWNS * nodes.clusters + nodes.elements.len() - nodes.clusters;
        let weights = (0..unknowns).map(|i| weight(elements, nodes, i)).collect();
        LinkTransport { elements, nodes, weights }
    }

    /// Irradiance that emitters and light from beyond the scene cause directly.
    pub fn direct(&self) -> Field {
        self.bounce(&vec![[0.0; 3]; self.weights.len()])
    }

    /// Irradiance after one more bounce: by the reflection of `irradiance`, by emitters, and from beyond the scene. Row factors correct the
    /// exchange between elements: the light of surfaces from beyond the scene does not change with them.
    pub fn bounce(&self, irradiance: &Field) -> Field {
        let nodes = self.nodes;
        let irradiance = NodeIrradiance::from_field(irradiance, nodes.clusters);
        let surfaces: Vec<Rgb> = (nodes.clusters..nodes.elements.len())
            .map(|p| {
                let e = nodes.elements[p] as usize;
                let Shape::Surface { side, .. } = self.elements.elements[e].shape else { return [0.0; 3] };
                let s = &self.elements.sides[side as usize];
                let RowFactors { gathers, sends } = self.elements.states[e].factors;
                let (gathers, sends) = (f64::from(gathers), f64::from(sends));
                let incident = irradiance.surfaces[p - nodes.clusters];
                let beyond = nodes.beyond_at(p - nodes.clusters);
                std::array::from_fn(|k| {
                    let incident = gathers * incident[k] + (1.0 - gathers) * beyond[k];
                    sends * (s.exitance[k] + f64::from(s.reflectance[k]) * incident)
                })
            })
            .collect();
        let outgoing = NodeRadiosity::pull(self.elements, nodes, &surfaces, |p, r| {
            nodes.reflections[r].sent(&irradiance.clusters[p], nodes.reflections[r].emit)
        });
        let mut arriving = gather(self.elements, nodes, &outgoing);
        if let Some(beyond) = &nodes.beyond {
            arriving.add(beyond);
        }
        arriving.to_field()
    }

    /// Weight of each unknown in sums over the scene.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }
}

/// Weight of an unknown: reflectance times the area (of clusters: the projected area) that it lights; 0 where the children of
/// the node have unknowns of their own.
fn weight(elements: &Elements, nodes: &ActiveNodes, unknown: usize) -> f64 {
    let (node, component) = if unknown < CLUSTER_UNKNOWNS * nodes.clusters {
        (unknown / CLUSTER_UNKNOWNS, unknown % CLUSTER_UNKNOWNS)
    } else {
        (unknown - DIRECTIONS * nodes.clusters, DIRECTIONS)
    };
    if nodes.kinds[node] == NodeKind::Open {
        return 0.0;
    }
    let element = &elements.elements[nodes.elements[node] as usize];
    match element.shape {
        Shape::Surface { side, .. } => {
            let r = elements.sides[side as usize].reflectance;
            element.area * f64::from(r[0] + r[1] + r[2]) / 3.0
        }
        Shape::Cluster(c) => {
            let cluster = &elements.clusters[c as usize];
            let area = if component < DIRECTIONS { cluster.projected[component] } else { element.area };
            area * f64::from(cluster.reflectance)
        }
    }
}

// Jacobi sweeps with a coarse-level correction.

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

/// The irradiance `E = direct + K E` along links, from a first guess; without one from direct light. Sweeps until it changes by less than
/// `tolerance` of itself (mean by the weights of the unknowns), at most `max_sweeps` times, and after the deadline only a few times.
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
