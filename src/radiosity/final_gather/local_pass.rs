//! The local pass: the irradiance of each element of a scene with clusters, by rays of its own.
//!
//! Light at a linked cluster is distributed among its surfaces by orientation; what they hide from each other is known only on
//! average, and insides of furniture would receive light that never gets there. So in the end every element traces a few rays. The
//! exchange of two elements is estimated by all rays that join them, from either side ([`TransportMatrix`]), so that no energy is
//! created. The rays are stored, twelve bytes each, and the light is solved on them to the last bounce without further rays,
//! starting from the direct light, or from the light along links where the time is up. The direct light of all elements is brought to what
//! rays from the emitters say of it. See `docs/method.md`, Local pass.

use super::element_rays::LeafRays;
use super::gatherer::FinalGather;
use super::local_noise::{LocalResult, assign_noise, weigh_errors};
use super::ray_rows::{RayRow, RayRows};
use super::untraced::estimate_untraced;
use crate::math::sampling::mix;
use crate::radiosity::deadline::{Deadline, GATHER_SHARE, RAY_SHARE};
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::links::{Tally, VisibilityEngine};
use crate::radiosity::refinement::LinkedScene;
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::radiosity::surroundings::{Arrived, SampledShare, emitted_share};
use crate::radiosity::transport::{
    Convergence, Field, MatrixRow, Method, RayTransport, TransportMatrix, solve,
};
use std::array::from_fn;

/// Smallest number of rays of an element, so that no element stays without exchange, and the deviation of its rays is known. 2 or 8 instead
/// change irradiance by less than 0.05 % (`constants.py solve`).
const MIN_ROW_RAYS: f64 = 4.0;
/// Smallest number of rays of an element where little light is reflected and only points are asked for. With one, row sums cannot be balanced: a
/// garden creates 2.5 % of the emitted power, with two 0.14 %.
const FEWEST_ROW_RAYS: f64 = 2.0;
/// Largest number of rays of an element: 1/√4,096 = 1.6 % of the spread of one ray remain as noise.
const MAX_ROW_RAYS: f64 = 4096.0;
/// Expected relative error of the direct light that all elements receive together, by their own rays.
const DIRECT_ERROR: f64 = 0.01;
/// Rays that all elements share after the deadline. Too few rays can isolate two elements that only see each other, and their
/// light would never decay.
pub const LATE_RAYS: f64 = 1e5;
/// Largest number of leaves that are traced after the deadline: with [`MIN_ROW_RAYS`] and [`LATE_RAYS`] half a million rays, some 0.4 s on
/// two cores. Of more leaves only those of more than their share of the area, and others evenly spread, are traced.
const MAX_LATE_LEAVES: usize = 100_000;
/// Part of the rays by which elements exchange light. The others gather that light for one element each. In an office and a living
/// room a seventh and two sevenths leave the same error of the elements within a tenth of it (`scenes/room.py`).
const EXCHANGE_SHARE: f64 = 1.0 / 7.0;
/// Part of the light that is reflected in scenes for which [`RAYS_TIMES_ERROR_SQUARED`] holds: half.
const USUAL_REFLECTED: f64 = 0.5;
/// Neighbours that share their rays.
const NEIGHBOURS: f64 = 16.0;
/// Rays of an element times the square of the error: one ray deviates by about half of the mean, neighbours share their rays, and direct and
/// reflected light each have that variance.
const RAYS_TIMES_ERROR_SQUARED: f64 = 2.0 * 0.25 / NEIGHBOURS;
/// Part of the error of elements that may be noise of their rays, where these are known to deviate little: a fifth of the square, as most of the rest
/// is light that differs over an element.
pub(super) const NEEDED_SHARE: f64 = 0.45;
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
    /// Rays for the light of the elements; none if there is no time for them.
    pub element_rays: Option<f64>,
    /// Rays of both passes together, as part of those that are useful.
    pub traced_part: f64,
    /// Part of the emitted power that meets elements, by rays from the emitters.
    pub sampled: SampledShare,
    /// The same by these rays and those of the elements together, by channel.
    pub received: Rgb,
    /// What comes from beyond the scene.
    pub arrived: Arrived,
    /// How the light converged.
    pub convergence: Convergence,
    /// Leaves with fewer rays than planned.
    pub hurried: usize,
    /// Leaves that there was no time to trace: their light is estimated ([`estimate_untraced`]).
    pub untraced: usize,
    /// Cost of the rays.
    pub tally: Tally,
}

impl FinalGather<'_> {
    /// Traces the exchange's share of about `rays` rays, of `useful` ones, and solves the light on them. Without a number, or after the
    /// deadline, elements trace only a few: enough for the light of the whole scene, not for that of each element. Of many elements, some
    /// are then not traced.
    pub fn local_pass(&self, rays: Option<f64>, useful: f64, deadline: &Deadline) -> LocalPass {
        let all = self.linked.leaves();
        let Elements { elements, states, .. } = &self.linked.elements;
        let start = deadline.elapsed();
        let mut rows = self.trace_rows(&all, rays.map(|rays| EXCHANGE_SHARE * rays), deadline);
        let traced: f64 = rows.rows.iter().map(|row| f64::from(row.rays)).sum();
        let seconds_a_ray = (deadline.elapsed() - start) / traced.max(1.0);
        let untraced = all.len() - rows.rows.len();
        // Light that leaves receive outside the exchange, W/m² times scene units squared.
        let apart = rows.take_out(|leaf| states[leaf as usize].is_apart());
        let light = |row: &RayRow| elements[row.leaf as usize].area * mean(emitters_irradiance(row));
        let light_apart: f64 = apart.rows.iter().map(light).sum();
        let beyond = |row: &RayRow| {
            (elements[row.leaf as usize].area, row.sky / row.rays as f32, row.sun / row.rays as f32)
        };
        let arrived = Arrived::of(rows.rows.iter().chain(&apart.rows).map(beyond));
        rows.number_rows(self.linked.elements.len(), &self.reflected);
        let matrix = self.transport_matrix(&rows, deadline);
        let mut direct = direct_light(&rows);
        let sampled = self.emitted_share();
        let mut received = sampled.share;
        // The light of leaves that were not traced is not known here.
        if untraced == 0 {
            let sum = rows.rows.iter().map(light).sum::<f64>() + light_apart;
            let factor;
            (factor, received) = self.balance_of_direct_light(sum, &sampled);
            for (direct, row) in direct.iter_mut().zip(&rows.rows) {
                let others = emitters_irradiance(row);
                (0..3).for_each(|k| direct[k] += (factor - 1.0) * others[k]);
            }
        }
        // Of an iteration that the deadline ends at once the start remains. Otherwise it is the direct light: links bring a little light
        // to rooms without any.
        let along_links = |row: &RayRow| states[row.leaf as usize].irradiance;
        let start = deadline.late().then(|| rows.rows.iter().map(along_links).collect());
        let (more, returned) = corrections_of_sent(&rows, &matrix);
        let sent_directly =
            direct.iter().zip(more).map(|(own, more)| from_fn(|k| own[k] + more[k])).collect();
        let transport = RayTransport { matrix: &matrix, direct: sent_directly, returned };
        let (sent, convergence) = solve(&transport, start, Method::Krylov, deadline);
        let mut results = vec![LocalResult::default(); self.linked.elements.len()];
        for ((row, direct), reflected) in rows.rows.iter().zip(&direct).zip(matrix.reflected(&sent)) {
            results[row.leaf as usize].irradiance = from_fn(|k| direct[k] + reflected[k]);
        }
        assign_noise(&self.linked.elements, &rows, &matrix, &mut results);
        if !self.elements {
            count_sent(&rows, &sent, &mut results);
        }
        if all.len() > rows.rows.len() {
            estimate_untraced(&self.linked.elements, &all, &mut results);
        }
        self.light_apart(&apart, &mut results);
        weigh_errors(&self.linked.elements, &all, &mut results);
        let needed = self.needed_rays(&all, &results);
        let element_rays = rays.map(|rays| match deadline.limited() {
            true => ((1.0 - EXCHANGE_SHARE) * useful).min(GATHER_SHARE * deadline.left() / seconds_a_ray),
            false => (1.0 - EXCHANGE_SHARE) * rays,
        });
        let exchanged = rays.map_or(0.0, |rays| EXCHANGE_SHARE * rays);
        let traced_part = (exchanged + element_rays.unwrap_or(0.0)) / useful;
        let element_rays = element_rays.map(|rays| rays.min(needed));
        let reciprocity = matrix.reciprocity();
        let RayRows { hurried, tally, .. } = rows;
        LocalPass {
            results,
            reciprocity,
            element_rays,
            traced_part,
            sampled,
            received,
            arrived,
            convergence,
            hurried,
            untraced,
            tally,
        }
    }

    /// Gives leaves that take no part in the exchange the light that their rays have found, now that the light of others is known.
    fn light_apart(&self, apart: &RayRows, results: &mut [LocalResult]) {
        let Elements { elements, sides, .. } = &self.linked.elements;
        let mut first = 0;
        for row in &apart.rows {
            let mut light = direct_irradiance(row);
            for &met in apart.met[first..row.end].iter().filter(|&&met| met != Elements::NONE) {
                let Shape::Surface { side, .. } = elements[met as usize].shape else { continue };
                let (side, irradiance) = (&sides[side as usize], results[met as usize].irradiance);
                let reflected = |k: usize| f64::from(side.reflectance[k]) * irradiance[k];
                add(&mut light, 1.0 / f64::from(row.rays), from_fn(reflected));
            }
            first = row.end;
            let result = &mut results[row.leaf as usize];
            result.irradiance = light;
            result.kept = row.kept_of_lit();
            result.row_sum = result.kept;
        }
    }

    /// The number of rays, at most `rays`, that brings the error of the elements below the error asked for, relative to the mean. Of elements that are
    /// not asked for only the light that they reflect remains, at points.
    pub fn useful_rays(&self, rays: f64) -> f64 {
        rays.min(self.rays_for(if self.elements { 1.0 } else { self.reflected_part() }))
    }

    /// The number of rays that brings the error of the elements below the error asked for if `part` of it counts.
    fn rays_for(&self, part: f64) -> f64 {
        let each = RAYS_TIMES_ERROR_SQUARED * (part / self.error).powi(2);
        (each * self.linked.leaves().len() as f64).max(LATE_RAYS)
    }

    /// The part to which errors of reflected light count at points: where that is a part r of their light, r / [`USUAL_REFLECTED`].
    fn reflected_part(&self) -> f64 {
        let reflected = self.linked.reflected_at_points.unwrap_or_else(|| self.reflected_everywhere());
        (reflected / USUAL_REFLECTED).min(1.0)
    }

    /// The part of all light that surfaces reflect. The ground under an open sky receives a hundredth of its light from itself.
    fn reflected_everywhere(&self) -> f64 {
        let LinkedScene { elements, surroundings, .. } = self.linked;
        f64::from(elements.clusters[0].reflectance * surroundings.enclosed[0])
    }

    /// The number of rays of elements that brings their noise to [`NEEDED_SHARE`] of the error asked for, by the deviations that the exchange has
    /// found: shared as [`FinalGather::sample_elements`] does, in proportion to √area times the deviation σ of one ray and its weight, N rays leave the error
    /// Σ √A σ / √(N · Σ A) of all elements together.
    fn needed_rays(&self, leaves: &[u32], results: &[LocalResult]) -> f64 {
        let elements = &self.linked.elements.elements;
        let (mut deviations, mut area, mut light) = (0.0, 0.0, 0.0);
        for &leaf in leaves {
            let (own, result) = (elements[leaf as usize].area, &results[leaf as usize]);
            deviations +=
                own.sqrt() * f64::from(result.weight * result.noise) * f64::from(result.rays).sqrt();
            area += own;
            light += own * mean(result.irradiance);
        }
        let noise = NEEDED_SHARE * self.error * light / area;
        let rays = deviations * deviations / (NEIGHBOURS * area * noise * noise);
        if rays.is_finite() { rays.max(LATE_RAYS) } else { f64::INFINITY }
    }

    /// The number of rays, at most `rays`, that there is time for; none if there is not even time for the smallest number of rays of each
    /// element. From a timed sample of the leaves.
    pub fn affordable_rays(&self, rays: f64, deadline: &Deadline) -> Option<f64> {
        if deadline.late() {
            return None;
        }
        let leaves = self.linked.leaves();
        let step = leaves.len().div_ceil(TIMED_LEAVES).max(1);
        let timed = |&leaf: &u32| LeafRays { leaf, count: TIMED_RAYS };
        let sample: Vec<LeafRays> = leaves.iter().step_by(step).map(timed).collect();
        let start = deadline.elapsed();
        let traced = RayRows::trace(self, &sample, |_| None, |_| ());
        let traced: u32 = traced.rows.iter().map(|row| row.rays).sum();
        let each = (deadline.elapsed() - start) / f64::from(traced.max(1));
        let possible = RAY_SHARE * deadline.left() / each;
        let shared = (possible - MIN_ROW_RAYS * leaves.len() as f64) * SHARED_AFTER_SPLIT;
        (shared >= LATE_RAYS.min(rays)).then_some(shared.min(rays))
    }

    /// The rays of all leaves: each leaf's share by its area and importance. After the deadline only the smallest number of rays, and of
    /// many leaves only some.
    fn trace_rows(&self, leaves: &[u32], rays: Option<f64>, deadline: &Deadline) -> RayRows {
        let (elements, states) = (&self.linked.elements, &self.linked.elements.states);
        let area = |e: u32| elements.elements[e as usize].area;
        let counted = |e: u32| area(e) * f64::from(states[e as usize].importance);
        let all_counted: f64 = leaves.iter().map(|&e| counted(e)).sum();
        // Deviations count only where elements gather light by them.
        let counts = (self.reflected_everywhere() / USUAL_REFLECTED).min(1.0);
        let least = if self.elements { MIN_ROW_RAYS } else { (MIN_ROW_RAYS * counts).max(FEWEST_ROW_RAYS) };
        // Rays to the sky join no elements, and elements in the open need few to know the deviation of others.
        let stay = |leaf: u32| match self.has_environment() {
            true => 1.0 - f64::from(self.linked.surroundings.escaped[self.side_of(leaf) as usize]),
            false => 1.0,
        };
        let streams = self.row_streams().count() as f64;
        let count = |leaf: u32, rays: f64| {
            let rays = least + rays * stay(leaf) * counted(leaf) / all_counted;
            (rays.min(MAX_ROW_RAYS) / streams).max(1.0) as u32
        };
        let rays = rays.filter(|_| !deadline.late()).unwrap_or(LATE_RAYS);
        let planned: Vec<LeafRays> =
            leaves.iter().map(|&leaf| LeafRays { leaf, count: count(leaf, rays) }).collect();
        // Half of the leaves that are traced late are large ones, half are drawn.
        let large = elements.area / (0.5 * MAX_LATE_LEAVES as f64);
        let step = leaves.len().div_ceil(MAX_LATE_LEAVES / 2) as u64;
        let few = leaves.len() <= MAX_LATE_LEAVES;
        let traced_late = |leaf: u32| few || area(leaf) >= large || mix(u64::from(leaf)).is_multiple_of(step);
        let fewer = |of: &LeafRays| LeafRays { count: of.count.min(count(of.leaf, LATE_RAYS)), ..*of };
        // What follows the rays has the rest of the time.
        let tracing = deadline.part(RAY_SHARE);
        let instead = |batch: &[LeafRays]| {
            let late = || batch.iter().filter(|of| traced_late(of.leaf)).map(fewer).collect();
            tracing.late().then(late)
        };
        deadline.stage("local pass, rays", leaves.len());
        let rows = RayRows::trace(self, &planned, instead, |n| deadline.advance(n));
        deadline.stage("local pass, light", 0);
        rows
    }

    /// The part of the emitted power that meets elements.
    fn emitted_share(&self) -> SampledShare {
        let LinkedScene { elements, engine, surroundings, settings, .. } = self.linked;
        emitted_share(elements, &engine.exact(), surroundings.length, settings.seed)
    }

    /// The factor that brings the direct light that elements receive, W/m² times scene units squared, to what the emitters send them, and
    /// that part of the emitted power by channel. Both sums have errors: the elements' own is expected to be [`DIRECT_ERROR`], and the
    /// factor is nearer to 1 where the share that rays have sampled is less certain, as of a lamp whose light mostly leaves the scene.
    /// Engines that average clusters keep what they have found, so that the ledger shows how far that is from what rays say.
    pub(super) fn balance_of_direct_light(&self, received: f64, sampled: &SampledShare) -> (f64, Rgb) {
        let Elements { elements, sides, .. } = &self.linked.elements;
        let power: f64 = sides.iter().map(|s| elements[s.element as usize].area * mean(s.exitance)).sum();
        if received <= 0.0 || power <= 0.0 {
            return (1.0, sampled.share);
        }
        let found = received / power;
        // No ray was drawn from beams that are narrower than the grid of their directions.
        if sampled.mean <= 0.0 {
            return (1.0, [found; 3]);
        }
        if !matches!(self.linked.engine, VisibilityEngine::Exact(_)) {
            return (1.0, sampled.share);
        }
        let (own, other) = ((DIRECT_ERROR * found).powi(2), sampled.error.powi(2));
        let share = found + own / (own + other) * (sampled.mean - found);
        (share / found, sampled.share.map(|of| of * share / sampled.mean))
    }

    /// The exchange of the leaves, from their rays.
    fn transport_matrix(&self, rows: &RayRows, deadline: &Deadline) -> TransportMatrix {
        let linked = self.linked;
        let elements = &linked.elements;
        let escapes = self.escapes_of_sides(rows);
        let matrix_rows: Vec<MatrixRow> = rows
            .rows
            .iter()
            .map(|row| match elements.elements[row.leaf as usize].shape {
                Shape::Surface { side, .. } => MatrixRow {
                    area: elements.elements[row.leaf as usize].area,
                    reflectance: elements.sides[side as usize].reflectance,
                    end: row.end,
                    closed: linked.surroundings.closed[side as usize] && row.outside == 0,
                    escapes: escapes[side as usize],
                    apart: row.continued as usize,
                },
                Shape::Cluster(_) => unreachable!("rows are those of surfaces"),
            })
            .collect();
        TransportMatrix::new(&matrix_rows, &rows.met, linked.settings.row_sums, &self.ranks, deadline)
    }

    /// By side, the part of the light of its rows that meets no other row, with half a ray more of either kind (Jeffreys): none of a few rays does not
    /// mean probability 0.
    fn escapes_of_sides(&self, rows: &RayRows) -> Vec<f64> {
        let mut sides = vec![(0.5, 1.0); self.linked.elements.sides.len()];
        let mut first = 0;
        for row in &rows.rows {
            let gone = rows.met[first..row.end].iter().filter(|&&met| met == Elements::NONE).count();
            let of = &mut sides[self.side_of(row.leaf) as usize];
            *of = (of.0 + gone as f64, of.1 + f64::from(row.rays));
            first = row.end;
        }
        sides.into_iter().map(|(gone, rays)| gone / rays).collect()
    }
}

/// Direct irradiance of the rows, W/m².
fn direct_light(rows: &RayRows) -> Field {
    (0..rows.rows.len()).map(|i| direct_irradiance(&rows.rows[i])).collect()
}

/// How much direct light rows send more than they receive, W/m², and the part of reflected light that they send on. What a row sends is the product of
/// its light and its row sum. If by chance many of its few rays leave the scene, it has much light of the sky, little reflected light and a small row
/// sum: the product is on average too small for the one and too large for the other by the covariance of both factors. With the part of its rays that
/// stay p, of variance v, and the row sum S, of which the own rays decide the part s, these are covariances with s p: reflected light R is R p / S.
fn corrections_of_sent(rows: &RayRows, matrix: &TransportMatrix) -> (Field, Vec<f64>) {
    let of = |(i, row): (usize, &RayRow)| {
        let (part, sum) = matrix.own_part(i);
        let each = if part > 0.0 { part / sum } else { 0.0 };
        let returned = if each > 0.0 { 1.0 - each * f64::from(row.variance) / sum } else { 1.0 };
        (row.covariance.to_array().map(|of| -each * f64::from(of)), returned)
    };
    rows.rows.iter().enumerate().map(of).unzip()
}

/// Lets the ledger, which multiplies row sums by the light of the same rays, count what rows send.
fn count_sent(rows: &RayRows, sent: &Field, results: &mut [LocalResult]) {
    for (row, sent) in rows.rows.iter().zip(sent) {
        let result = &mut results[row.leaf as usize];
        let own = mean(result.irradiance);
        result.row_sum *= if own > 0.0 { (mean(*sent) / own) as f32 } else { 1.0 };
    }
}

/// Direct irradiance of a row, W/m².
fn direct_irradiance(row: &RayRow) -> Rgb {
    row.direct.to_array().map(|d| f64::from(d) / f64::from(row.rays))
}

/// Irradiance of a row by the emitters of the scene, W/m².
fn emitters_irradiance(row: &RayRow) -> Rgb {
    (row.direct - row.sun - row.sky - row.onwards).to_array().map(|d| f64::from(d) / f64::from(row.rays))
}
