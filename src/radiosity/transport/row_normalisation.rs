//! Row normalisation of transport: form factors of an element from which no light leaves the scene sum up to 1 (`docs/method.md`, Form
//! factors and closure).
//!
//! Every bounce multiplies the sampling errors of row sums. [`LinkRows::balance`] scales what a row gathers and what it sends by the same
//! factor (Sinkhorn and Knopp 1967), so that exchange stays reciprocal.
//! A sum is found by one gather of radiosity 1 through all levels of the tree. Links may add up to more than 1
//! where they are coarse, and such rows are bounded afterwards. Rows of rays ([`super::TransportMatrix`]) are not scaled: the light
//! that is solved on few rays would depend on factors of the same rays.
//!
//! The matrix of form factors between facets is normalised in another way: `form_factors::matrix::closure` changes every entry
//! by its own standard error, because the entries are the result that its user asks for. Here entries have no errors of their
//! own (a link stands for many pairs), and transport needs only one factor per row.

use super::active_nodes::ActiveNodes;
use super::directional::NodeIrradiance;
use super::gather_push_pull::{NodeRadiosity, gather};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::{Elements, RowFactors, Shape};
use crate::radiosity::options::RowNormalisation;
use crate::radiosity::rgb::Rgb;

/// Largest number of rounds of Sinkhorn scaling: limits the time to that of 20 sweeps over the links.
const MAX_ROUNDS: usize = 20;
/// Number of rounds that are made even after the deadline: limits the delay to two sweeps. Changes results with a time limit only.
const MIN_ROUNDS: usize = 2;
/// Exponent of the corrections of the factors: both ends of a link change, so each takes the square root. Coarse links overlap, and larger
/// exponents oscillate.
const EXPONENT: f64 = 0.5;
/// Mean error of the row sums at which the rounds end, weighted by area, relative to their mean: a thirtieth of the error of 1e-3 that
/// rays leave. Rows at a limit do not count.
const TOLERANCE: f64 = 3e-5;
/// Smallest and largest factor: one above 2 would amplify a row of which half is missing; the smallest keeps factors positive and is
/// far below that of any row sum that occurs.
const FACTOR_LIMITS: [f32; 2] = [1e-4, 2.0];

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
/// Largest fraction of its light that a row with a sum above 1 may return after one reflection: the light of such rows
/// grows to at most 1 / (1 − 0.98) = 50 times its source.
const MAX_RETURNED: f64 = 0.98;

/// The sum of each surface element's form factors along its links before multiplication by its own gather factor: the irradiance
/// that radiosity 1 everywhere would cause.
pub fn link_row_sums(elements: &Elements, nodes: &ActiveNodes) -> Vec<f64> {
    let of = |&e: &u32| [f64::from(elements.states[e as usize].factors.sends); 3];
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

/// Scales the light that leaves gather as if their row sum were 1 where it is above 1. The row sum of a few coarse links may
/// be several times 1, and the light created there would cause the refinement of all other links.
pub fn cap_row_sums(elements: &mut Elements, nodes: &mut ActiveNodes) {
    elements.states.iter_mut().for_each(|s| s.factors = RowFactors::ONE);
    let sums = link_row_sums(elements, nodes);
    for (state, sum) in elements.states.iter_mut().zip(sums) {
        state.factors = RowFactors { gathers: (1.0 / sum).min(1.0) as f32, ..RowFactors::ONE };
    }
    nodes.update_factors(elements);
}

/// The rows of surface elements along their links.
struct LinkRows<'a> {
    elements: &'a mut Elements,
    nodes: &'a mut ActiveNodes,
    /// By side, whether its leaves are closed: no light leaves the scene from them.
    closed: &'a [bool],
}

impl LinkRows<'_> {
    /// The sums of all rows with the present factors.
    fn sums(&self) -> Vec<f64> {
        let sums = link_row_sums(self.elements, self.nodes);
        sums.iter()
            .zip(self.elements.states.iter())
            .map(|(sum, s)| sum * f64::from(s.factors.gathers))
            .collect()
    }

    /// The sum that a row should have, if that is known and a factor can bring `sum` to it; and the weight of the row's error.
    fn target(&self, e: usize, sum: f64) -> Option<(f64, f64)> {
        let element = &self.elements.elements[e];
        let Shape::Surface { side, .. } = element.shape else { return None };
        let is_closed = self.closed[side as usize] && sum > MIN_ROW_SUM;
        let weight = if element.is_leaf() { element.area } else { 0.0 };
        (is_closed || sum > MAX_OPEN_ROW_SUM).then(|| (self.elements.states[e].row_target.into(), weight))
    }

    /// Brings row sums to their targets by factors of both directions, as far as that converges (Sinkhorn and Knopp 1967), starting from
    /// `sums`. The remainder is corrected where light is gathered. Returns the sums with the factors found.
    fn balance(&mut self, mut sums: Vec<f64>, deadline: &Deadline) -> Vec<f64> {
        let [min, max] = FACTOR_LIMITS;
        for round in 1..=MAX_ROUNDS {
            let (mut error, mut all) = (0.0, 0.0);
            for (e, &sum) in sums.iter().enumerate() {
                let Some((target, weight)) = self.target(e, sum) else { continue };
                let factor = &mut self.elements.states[e].factors.gathers;
                *factor = (*factor * (target / sum).powf(EXPONENT) as f32).clamp(min, max);
                if *factor > min && *factor < max {
                    error += weight * (sum - target).abs();
                    all += weight * target;
                }
            }
            self.elements.states.iter_mut().for_each(|s| s.factors.sends = s.factors.gathers);
            self.nodes.update_factors(self.elements);
            sums = self.sums();
            if error <= TOLERANCE * all || (round >= MIN_ROUNDS && deadline.late()) {
                break;
            }
        }
        for (e, sum) in sums.iter_mut().enumerate() {
            if let Some((target, _)) = self.target(e, *sum) {
                self.elements.states[e].factors.gathers *= (target / *sum) as f32;
                *sum = target;
            }
        }
        sums
    }
}

/// Brings the row sums of leaves to their targets, starting from `sampled` row sums with all factors 1. `closed` holds,
/// by side, whether no light leaves the scene from its leaves. After the deadline fewer rounds are made.
///
/// Rows of open scenes are not normalised: scaling them to the sums measured by rays was tried; it scales dim light that is correct
/// and adds the noise of the rays.
///
/// Returns the number of leaves whose light would have grown without end and was bounded.
pub fn normalise_link_rows(
    elements: &mut Elements,
    nodes: &mut ActiveNodes,
    closed: &[bool],
    row_sums: RowNormalisation,
    sampled: &[f64],
    deadline: &Deadline,
) -> usize {
    let mut sums = sampled.to_vec();
    if row_sums == RowNormalisation::Balanced {
        sums = LinkRows { elements, nodes, closed }.balance(sums, deadline);
    }
    bound_growing_rows(elements, &sums)
}

/// Reduces the light that leaves gather as if their row sum were 1, where the sum is above 1, which is impossible for form
/// factors, and where they reflect so much that their light would hardly decay. Returns the number of these leaves.
fn bound_growing_rows(elements: &mut Elements, sums: &[f64]) -> usize {
    let mut bounded = 0;
    for (e, &sum) in sums.iter().enumerate() {
        let Shape::Surface { side, .. } = elements.elements[e].shape else { continue };
        let reflectance = elements.sides[side as usize].reflectance.into_iter().fold(0.0, f32::max);
        if sum > 1.0 && sum * f64::from(reflectance) > MAX_RETURNED {
            elements.states[e].factors.gathers /= sum as f32;
            bounded += usize::from(elements.elements[e].is_leaf());
        }
    }
    bounded
}
