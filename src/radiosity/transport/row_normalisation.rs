//! Row normalisation of transport: form factors of an element that sees no way out of the scene sum up to 1 (`docs/method.md`, Form
//! factors and closure).
//!
//! Every bounce multiplies the sampling errors of row sums. Links and rows of rays (`TransportMatrix`) scale what a leaf gathers
//! and what it sends by the same factor (Sinkhorn and Knopp 1967), so that exchange stays reciprocal, and correct the remainder
//! where light is gathered. This file holds what both share, [`SinkhornRule`] and [`scaled`], and the procedure for links. The
//! procedure for rays is in `transport_matrix`. They are two because
//!
//! * a row sum of links is one gather of radiosity 1 through all levels of the tree, and only leaves of closed sides have a known
//!   sum; a row of rays is a list of entries, and its sum follows from its own rays;
//! * factors of links move by the square root of what is missing, those of rays by Chebyshev exponents: coarse links overlap, and
//!   accelerated factors would oscillate;
//! * links may add up to more than 1 where they are coarse, and such rows are bounded afterwards.
//!
//! The matrix of form factors between facets is no such scaling: `form_factors::matrix::closure` changes every entry by its own
//! standard error, which is the result that its user asks for. Here entries have no errors of their own (a ray is one sample, a
//! link stands for many pairs), and one factor a leaf is all that transport needs. The two share the condition on row sums and
//! nothing else.

use super::active_nodes::ActiveNodes;
use super::directional::NodeIrradiance;
use super::gather_push_pull::{NodeRadiosity, gather};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::{ElementState, Elements, RowFactors, Shape};
use crate::radiosity::options::Rows;
use crate::radiosity::rgb::Rgb;

/// When Sinkhorn scaling ends, and how far factors may go.
pub struct SinkhornRule {
    /// Most rounds.
    pub max_rounds: usize,
    /// Error of the row sums at which the rounds end, relative to their mean.
    pub tolerance: f64,
    /// Smallest and largest factor.
    pub limits: [f32; 2],
}

/// For rays; the error is the mean absolute one. Coplanar faces that both claim one ray cannot be balanced: the rounds
/// limit the time, the factors stay between 1/1,000 and 8, and the remainder is corrected where light is gathered.
pub const RAY_ROWS: SinkhornRule = SinkhornRule { max_rounds: 16, tolerance: 1e-3, limits: [1e-3, 8.0] };
/// For links; the error is the root mean square by area. The tolerance is a thirtieth of the error of 1e-3 that rays
/// leave; a factor above 2 would amplify a row of which half is missing.
pub const LINK_ROWS: SinkhornRule = SinkhornRule { max_rounds: 20, tolerance: 3e-5, limits: [1e-4, 2.0] };

/// Rounds for links that are made even after the deadline: without any, rows would not be normalised at all.
const MIN_LINK_ROUNDS: usize = 1;
/// A closed leaf whose row sum is at most this is not normalised, because a factor above 10 would mostly amplify noise.
/// 0.05 or 0.2 instead change irradiance without a local pass by less than 0.02 % (`constants.py solve`).
const MIN_ROW_SUM: f64 = 0.1;
/// Row sums of other leaves above this are errors and normalised as well. The exact sum is at most 1; the rest is for
/// sampling errors. 1.1 or 1.5 instead change irradiance without a local pass by less than 0.01 % (`constants.py
/// solve`).
const MAX_OPEN_ROW_SUM: f64 = 1.25;
/// Closed leaves with a row sum below this are probed by rays: other surfaces may cover part of them. The exact sum is
/// 1; the rest is for sampling errors. 0.6 or 0.9 instead change irradiance without a local pass by less than 0.1 %
/// (`constants.py solve`).
const SHORT_ROW_SUM: f64 = 0.8;
/// Largest part of its light that a row with a sum above 1 may return after one reflection: the light of such rows
/// grows to at most 1 / (1 − 0.98) = 50 times its source.
const MAX_RETURNED: f64 = 0.98;

/// A factor times a correction, within limits.
pub fn scaled(factor: f32, correction: f64, [least, most]: [f32; 2]) -> f32 {
    (factor * correction as f32).clamp(least, most)
}

/// The sum of each surface element's form factors along its links before multiplication by its own gather factor: the irradiance
/// that radiosity 1 everywhere would cause.
pub fn link_row_sums(elements: &Elements, states: &[ElementState], nodes: &ActiveNodes) -> Vec<f64> {
    let of = |&e: &u32| [f64::from(states[e as usize].factors.sends); 3];
    let surfaces: Vec<Rgb> = nodes.elements[nodes.clusters..].iter().map(of).collect();
    let ones = NodeRadiosity::pull(elements, nodes, &surfaces, |_, r| nodes.reflections[r].ones);
    let NodeIrradiance { clusters, surfaces } = gather(elements, nodes, &ones);
    nodes.expand(elements, &clusters, &surfaces).into_iter().map(|e| e[0]).collect()
}

/// Closed leaves whose row sums are short: other surfaces cover part of them, or their links have missed something.
pub fn short_rows(elements: &Elements, closed: &[bool], sums: &[f64]) -> Vec<u32> {
    let is_short = |&e: &u32| match elements.elements[e as usize].shape {
        Shape::Surface { side, .. } => {
            let leaf = elements.elements[e as usize].is_leaf();
            leaf && closed[side as usize] && sums[e as usize] < SHORT_ROW_SUM
        }
        Shape::Cluster(_) => false,
    };
    (0..sums.len() as u32).filter(is_short).collect()
}

/// Lets leaves whose row sum is above 1 gather as if it were 1. The row sum of a few coarse links may be several times 1, and
/// all other links would be refined for the light that is created there.
pub fn cap_row_sums(elements: &Elements, states: &mut [ElementState], nodes: &mut ActiveNodes) {
    states.iter_mut().for_each(|s| s.factors = RowFactors::ONE);
    let sums = link_row_sums(elements, states, nodes);
    for (state, sum) in states.iter_mut().zip(sums) {
        state.factors = RowFactors { gathers: (1.0 / sum).min(1.0) as f32, ..RowFactors::ONE };
    }
    nodes.update_factors(elements, states);
}

/// Brings the row sums of leaves to the targets in `states`, starting from `sampled` row sums with all factors 1. `closed` says by
/// side whether its leaves see no way out. After the deadline fewer rounds are made.
///
/// Rows of open scenes are not normalised: scaling them to the sums that rays find was tried; it scales dim light that is right and
/// adds the noise of the rays.
///
/// Returns the number of leaves whose light would have grown without end and was bounded.
pub fn normalise_link_rows(
    elements: &Elements,
    states: &mut [ElementState],
    nodes: &mut ActiveNodes,
    closed: &[bool],
    (rows, sampled): (Rows, &[f64]),
    deadline: &Deadline,
) -> usize {
    let rounds = if rows == Rows::Balanced { LINK_ROWS.max_rounds } else { 1 };
    let max_factor = LINK_ROWS.limits[1];
    let mut sums = sampled.to_vec();
    for round in 0..rounds {
        let (mut off, mut all) = (0.0, 0.0);
        for (e, &sum) in sums.iter().enumerate() {
            let before = states[e].factors.gathers;
            let missing = missing(elements, states, closed, e, f64::from(before) * sum);
            let factors = match rows {
                Rows::Sampled => RowFactors::ONE,
                Rows::Closed => RowFactors { gathers: missing as f32, sends: 1.0 },
                Rows::Balanced => {
                    let factor = scaled(before, missing.sqrt(), LINK_ROWS.limits);
                    RowFactors { gathers: factor, sends: factor }
                }
            };
            states[e].factors = factors;
            let element = &elements.elements[e];
            if element.is_leaf() && factors.gathers < max_factor && missing != 1.0 {
                off += element.area * (1.0 / missing - 1.0).powi(2);
                all += element.area;
            }
        }
        let done = off <= LINK_ROWS.tolerance * LINK_ROWS.tolerance * all;
        if done || (round >= MIN_LINK_ROUNDS && deadline.late()) {
            break;
        }
        nodes.update_factors(elements, states);
        sums = link_row_sums(elements, states, nodes);
    }
    // The remainder is corrected where light is gathered.
    for (e, &sum) in sums.iter().enumerate().filter(|_| rows == Rows::Balanced) {
        let row = f64::from(states[e].factors.gathers) * sum;
        states[e].factors.gathers *= missing(elements, states, closed, e, row) as f32;
    }
    bound_growing_rows(elements, states, &sums)
}

/// Leaves with a row sum above 1, which no form factors have, and reflect so much that their light would hardly decay, gather as
/// if the sum were 1. Returns their number.
fn bound_growing_rows(elements: &Elements, states: &mut [ElementState], sums: &[f64]) -> usize {
    let mut bounded = 0;
    for (e, &sum) in sums.iter().enumerate() {
        let Shape::Surface { side, .. } = elements.elements[e].shape else { continue };
        let reflectance = elements.sides[side as usize].reflectance.into_iter().fold(0.0, f32::max);
        let row = f64::from(states[e].factors.gathers) * sum;
        if row > 1.0 && row * f64::from(reflectance) > MAX_RETURNED {
            states[e].factors.gathers = (1.0 / sum) as f32;
            bounded += usize::from(elements.elements[e].is_leaf());
        }
    }
    bounded
}

/// The factor by which the row sum of an element must change; 1 where its sum is not known.
fn missing(elements: &Elements, states: &[ElementState], closed: &[bool], e: usize, sum: f64) -> f64 {
    let Shape::Surface { side, .. } = elements.elements[e].shape else { return 1.0 };
    let is_closed = closed[side as usize] && sum > MIN_ROW_SUM;
    if is_closed || sum > MAX_OPEN_ROW_SUM { f64::from(states[e].row_target) / sum } else { 1.0 }
}
