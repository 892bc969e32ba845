//! The local pass: the irradiance of each element of a scene with clusters, by rays of its own.
//!
//! Light at a linked cluster is distributed among its surfaces by orientation; what they hide from each other is known only on
//! average, and insides of furniture would receive light that never gets there. So in the end every element traces a few rays. The
//! exchange of two elements is estimated by all rays that join them, from either side ([`TransportMatrix`]), so that no energy is
//! created. The rays are stored, twelve bytes each, and the light is solved on them to the last bounce without further rays,
//! starting from the light along links. See `docs/method.md`, Local pass.

use super::gatherer::FinalGather;
use super::local_noise::{LocalResult, assign_noise};
use super::ray_rows::RayRows;
use crate::radiosity::deadline::{Deadline, RAY_SHARE};
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::links::Tally;
use crate::radiosity::refinement::LinkedScene;
use crate::radiosity::transport::{
    Convergence, Field, MatrixRow, Method, RayTransport, TransportMatrix, solve,
};
use std::sync::atomic::{AtomicBool, Ordering};

/// Smallest number of rays of an element, so that no element stays without exchange. 2 or 8 instead change irradiance
/// by less than 0.05 % (`constants.py solve`).
const MIN_ROW_RAYS: f64 = 4.0;
/// Largest number of rays of an element: 1/√4,096 = 1.6 % of the spread of one ray remain as noise.
const MAX_ROW_RAYS: f64 = 4096.0;
/// Rays that all elements share after the deadline. Too few rays can isolate two elements that only see each other, and their
/// light would never decay.
pub const LATE_RAYS: f64 = 1e5;
/// Largest number of rays of a local pass that begins or goes on after an interruption: 0.4 million take some 0.3 s on two cores.
const MAX_INTERRUPTED_RAYS: f64 = 4e5;
/// Part of the rays by which elements exchange light. The others gather that light for one element each. In an office and a living
/// room a seventh and two sevenths leave the same error of the elements within a tenth of it (`scenes/room.py`).
const EXCHANGE_SHARE: f64 = 1.0 / 7.0;
/// Rays of an element times the square of the error: one ray deviates by about half of the mean, 16 neighbours share their rays,
/// which gives 0.5² / 16, and direct and reflected light each have that variance.
const RAYS_TIMES_ERROR_SQUARED: f64 = 2.0 * 0.25 / 16.0;
/// Approximate number of leaves whose rays are timed for an estimate: limits it to 32,000 rays, 1 % of the rays at the
/// default error. Used with a time limit only.
const TIMED_LEAVES: usize = 2000;
/// Rays of each timed leaf: one packet.
const TIMED_RAYS: u32 = 16;
/// Part of the rays that remains after surfaces have been split for so many rays and each part has its smallest number:
/// parts are made for 20 rays each and [`MIN_ROW_RAYS`] of them are fixed, 1 − 4 / 20.
const SHARED_AFTER_SPLIT: f64 = 0.8;

/// The result of the local pass.
pub struct LocalPass {
    /// By element; 0 for clusters and elements with children.
    pub results: Vec<LocalResult>,
    /// [`TransportMatrix::reciprocity`] of the form factors.
    pub reciprocity: f64,
    /// Rays that are left for the light of the elements; none if there is no time for them.
    pub element_rays: Option<f64>,
    /// How the light converged.
    pub convergence: Convergence,
    /// Cost of the rays.
    pub tally: Tally,
}

impl LinkedScene {
    /// Whether even the smallest number of rays of a local pass takes long. After an interruption the pass is then left out, and
    /// the light along links stays.
    pub fn has_long_local_pass(&self) -> bool {
        MIN_ROW_RAYS * self.leaves().len() as f64 > MAX_INTERRUPTED_RAYS
    }
}

impl FinalGather<'_> {
    /// Traces about `rays` rays and solves the light on them. Without a number, or after the deadline, elements trace only a few:
    /// enough for the light of the whole scene, not for that of each element. None after an
    /// interruption if even these would take long.
    pub fn local_pass(&self, rays: Option<f64>, deadline: &Deadline) -> Option<LocalPass> {
        let rows = self.trace_rows(rays.map(|rays| EXCHANGE_SHARE * rays), deadline)?;
        let matrix = self.transport_matrix(&rows, deadline);
        let (irradiance, convergence) = self.light_on_rays(&rows, &matrix, deadline);
        let mut results = vec![LocalResult::default(); self.linked.elements.len()];
        for (row, irradiance) in rows.rows.iter().zip(irradiance) {
            results[row.leaf as usize].irradiance = irradiance;
        }
        assign_noise(&self.linked.elements, &rows, &matrix, &mut results);
        let element_rays = rays.map(|rays| (1.0 - EXCHANGE_SHARE) * rays);
        let reciprocity = matrix.reciprocity();
        Some(LocalPass { results, reciprocity, element_rays, convergence, tally: rows.tally })
    }

    /// The number of rays, at most `rays`, that brings the error of the elements below `error`, relative to the mean.
    pub fn useful_rays(&self, rays: f64, error: f64) -> f64 {
        let each = RAYS_TIMES_ERROR_SQUARED / (error * error);
        rays.min((each * self.linked.leaves().len() as f64).max(LATE_RAYS))
    }

    /// The number of rays, at most `rays`, that there is time for; none if there is not even time for the smallest number of rays of each
    /// element. From a timed sample of the leaves.
    pub fn affordable_rays(&self, rays: f64, deadline: &Deadline) -> Option<f64> {
        if deadline.late() {
            return None;
        }
        let leaves = self.linked.leaves();
        let step = leaves.len().div_ceil(TIMED_LEAVES).max(1);
        let sample: Vec<u32> = leaves.iter().copied().step_by(step).collect();
        let start = deadline.elapsed();
        let traced = RayRows::trace(self, &sample, |_| TIMED_RAYS, |_| ());
        let each = (deadline.elapsed() - start) / traced.met.len().max(1) as f64;
        let possible = RAY_SHARE * deadline.left() / each;
        let shared = (possible - MIN_ROW_RAYS * leaves.len() as f64) * SHARED_AFTER_SPLIT;
        (shared >= LATE_RAYS.min(rays)).then_some(shared.min(rays))
    }

    /// The rays of all leaves: each leaf's share by its area and importance. None if an interruption cut a long pass short.
    fn trace_rows(&self, rays: Option<f64>, deadline: &Deadline) -> Option<RayRows> {
        let (elements, states) = (&self.linked.elements, &self.linked.elements.states);
        let leaves = self.linked.leaves();
        let counted = |e: u32| elements.elements[e as usize].area * f64::from(states[e as usize].importance);
        let all_counted: f64 = leaves.iter().map(|&e| counted(e)).sum();
        let (long, cut_short) = (self.linked.has_long_local_pass(), AtomicBool::new(false));
        let count = |leaf| {
            let share = counted(leaf) / all_counted;
            if long && deadline.interrupted() {
                cut_short.store(true, Ordering::Relaxed);
                return 0;
            }
            let rays = rays.filter(|_| !deadline.late()).unwrap_or(LATE_RAYS);
            (MIN_ROW_RAYS + rays * share).min(MAX_ROW_RAYS) as u32
        };
        deadline.stage("local pass, rays", leaves.len());
        let rows = RayRows::trace(self, &leaves, count, |n| deadline.advance(n));
        deadline.stage("local pass, light", 0);
        (!(cut_short.into_inner() || long && deadline.interrupted())).then_some(rows)
    }

    /// The exchange of the leaves, from their rays.
    fn transport_matrix(&self, rows: &RayRows, deadline: &Deadline) -> TransportMatrix {
        let linked = self.linked;
        let elements = &linked.elements;
        let mut row_of = vec![Elements::NONE; elements.len()];
        for (i, row) in (0..).zip(&rows.rows) {
            row_of[row.leaf as usize] = i;
        }
        let met: Vec<u32> =
            rows.met.iter().map(|&e| if e == Elements::NONE { e } else { row_of[e as usize] }).collect();
        let matrix_rows: Vec<MatrixRow> = rows
            .rows
            .iter()
            .map(|row| match elements.elements[row.leaf as usize].shape {
                Shape::Surface { side, .. } => MatrixRow {
                    area: elements.elements[row.leaf as usize].area,
                    reflectance: elements.sides[side as usize].reflectance,
                    end: row.end,
                    closed: linked.surroundings.closed[side as usize],
                },
                Shape::Cluster(_) => unreachable!("rows are those of surfaces"),
            })
            .collect();
        TransportMatrix::new(&matrix_rows, &met, linked.settings.row_sums, deadline)
    }

    /// Irradiance of the rows, W/m², starting from the light along links.
    fn light_on_rays(
        &self,
        rows: &RayRows,
        matrix: &TransportMatrix,
        deadline: &Deadline,
    ) -> (Field, Convergence) {
        let direct: Field = (0..rows.rows.len())
            .map(|i| {
                let (row, met) = rows.of(i);
                row.direct.to_array().map(|d| f64::from(d) / met.len() as f64)
            })
            .collect();
        let start =
            rows.rows.iter().map(|r| self.linked.elements.states[r.leaf as usize].irradiance).collect();
        solve(&RayTransport { matrix, direct }, Some(start), Method::Krylov, deadline)
    }
}
