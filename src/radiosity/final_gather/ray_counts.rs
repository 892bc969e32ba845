//! Numbers of rays of elements: those that the error asked for needs, those that the time allows, and the share of each element.

use super::element_rays::{EXCHANGE_SET, LeafRays};
use super::gatherer::FinalGather;
use super::local_noise::LocalResult;
use super::local_pass::EXCHANGE_SHARE;
use super::ray_rows::RayRows;
use crate::math::sampling::mix;
use crate::radiosity::deadline::{Deadline, RAY_SHARE};
use crate::radiosity::refinement::{LinkedScene, UNIFORM_IMPORTANCE};
use crate::radiosity::rgb::mean;

/// Smallest number of rays of an element, so that no element stays without exchange, and the deviation of its rays is known. 2 or 8 instead
/// change irradiance by less than 0.05 % (`constants.py solve`).
const MIN_ROW_RAYS: f64 = 4.0;
/// Smallest number of rays of an element where little light is reflected and only points are asked for: one for each half of the rays.
const FEWEST_ROW_RAYS: f64 = 2.0;
/// Largest number of rays of an element: 1/√4,096 = 1.6 % of the spread of one ray remain as noise.
const MAX_ROW_RAYS: f64 = 4096.0;
/// Of the rays of the exchange beyond the smallest number of each element, the fraction that is distributed by reflected light. The
/// others are distributed by area alone, because light along links may be incomplete: with a half, an element that links leave dark has
/// at least half of the rays that it would get by area. The inside of a lamp shade reflects a hundred times as much light as the walls
/// around it.
const SHARE_BY_LIGHT: f64 = 0.5;
/// Number of rays of all elements together after the deadline, which take less than 0.1 s (see [`MAX_LATE_LEAVES`]). With too few rays,
/// two elements may exchange light only with each other, and their light would never decay.
pub const LATE_RAYS: f64 = 1e5;
/// Largest number of leaves that are traced after the deadline: with [`MIN_ROW_RAYS`] and [`LATE_RAYS`] half a million rays, some 0.4 s on
/// two cores. If there are more leaves, those above their share of the area and an even selection of the others are traced.
const MAX_LATE_LEAVES: usize = 100_000;
/// Fraction of the light that is reflected in scenes for which [`RAYS_TIMES_ERROR_SQUARED`] holds: half.
const USUAL_REFLECTED: f64 = 0.5;
/// Number of elements over whose rays sharing is expected to average: between its windows of 9 and 25 elements. It only plans numbers
/// of rays: with fewer, elements get more rays and take longer; with more, their noise is above the error asked for.
pub(super) const AVERAGED_ELEMENTS: f64 = 16.0;
/// Rays of an element times the square of the error: one ray deviates by about half of the mean, the mean over [`AVERAGED_ELEMENTS`]
/// counts, and direct and reflected light each have that variance.
const RAYS_TIMES_ERROR_SQUARED: f64 = 2.0 * 0.25 / AVERAGED_ELEMENTS;
/// Fraction of the error of elements that may be noise of their rays, where these deviate little: a fifth of the squared error. Most of
/// the rest is the variation of light over an element.
pub(super) const NEEDED_SHARE: f64 = 0.45;
/// Approximate number of leaves whose rays are timed for an estimate: limits it to 32,000 rays, 1 % of the rays at the
/// default error. Used with a time limit only.
const TIMED_LEAVES: usize = 2000;
/// Rays of each timed leaf: one packet.
const TIMED_RAYS: u32 = 16;
/// Fraction of the rays that remains to be distributed after surfaces have been split and each part has its smallest number:
/// parts are made for 20 rays each and [`MIN_ROW_RAYS`] of them are fixed, 1 − 4 / 20.
const SHARED_AFTER_SPLIT: f64 = 0.8;

impl FinalGather<'_> {
    /// The number of rays, at most `rays`, that brings the error of the elements below the error asked for, relative to the mean
    /// irradiance. If the elements are not asked for, only the light that they reflect to points counts.
    pub fn useful_rays(&self, rays: f64) -> f64 {
        let part = if self.elements { 1.0 } else { self.weight_of_reflected() };
        rays.min(self.rays_for(part).max(self.rays_for_openings(part)))
    }

    /// The number of rays with which the light of the sky through openings, on the surfaces that points see, has half of the error asked
    /// for, if the fraction `part` of the error counts. A fraction p of the rays of these surfaces leaves the scene, so that each ray has
    /// the relative variance (1 - p) / p. Half of all rays start on these surfaces.
    fn rays_for_openings(&self, part: f64) -> f64 {
        let Some(view) = self.linked.points_view.filter(|view| view.open > 0.0) else { return 0.0 };
        let part = part * self.linked.fraction_from_beyond(view.open);
        2.0 * (1.0 - view.open) / view.open * (2.0 * part / self.error).powi(2) / EXCHANGE_SHARE
    }

    /// The number of rays that brings the error of the elements below the error asked for if the fraction `part` of it counts.
    fn rays_for(&self, part: f64) -> f64 {
        let each = RAYS_TIMES_ERROR_SQUARED * (part / self.error).powi(2);
        (each * self.linked.leaves().len() as f64).max(LATE_RAYS)
    }

    /// Weight of errors of reflected light at points: where reflected light is a fraction r of their light, r / [`USUAL_REFLECTED`].
    fn weight_of_reflected(&self) -> f64 {
        let at_points = self.linked.points_view.map(|view| view.reflected);
        let reflected = at_points.unwrap_or_else(|| self.reflected_everywhere());
        (reflected / USUAL_REFLECTED).min(1.0)
    }

    /// The fraction of all light that surfaces reflect. The ground under an open sky receives a hundredth of its light from itself.
    pub(super) fn reflected_everywhere(&self) -> f64 {
        let LinkedScene { elements, surroundings, .. } = self.linked;
        f64::from(elements.clusters[0].reflectance * surroundings.enclosed[0])
    }

    /// The number of rays of elements that brings their noise to [`NEEDED_SHARE`] of the error asked for, by the deviations that the
    /// exchange has found. If N rays are distributed as in [`FinalGather::sample_elements`], in proportion to √area times the deviation σ
    /// of one ray, the error of all elements together is Σ √A σ / √(N · Σ A).
    pub(super) fn needed_rays(&self, leaves: &[u32], results: &[LocalResult]) -> f64 {
        let elements = &self.linked.elements.elements;
        let (mut deviations, mut area, mut light) = (0.0, 0.0, 0.0);
        for &leaf in leaves {
            let (own, result) = (elements[leaf as usize].area, &results[leaf as usize]);
            deviations += own.sqrt() * f64::from(result.deviation);
            area += own;
            light += own * mean(result.irradiance);
        }
        let noise = NEEDED_SHARE * self.error * light / area;
        let rays = deviations * deviations / (AVERAGED_ELEMENTS * area * noise * noise);
        if rays.is_finite() { rays.max(LATE_RAYS) } else { f64::INFINITY }
    }

    /// The number of rays, at most `rays`, that the time allows, from a timed sample of the leaves. `None` if the time does not suffice
    /// for the smallest number of rays of each element.
    pub fn affordable_rays(&self, rays: f64, deadline: &Deadline) -> Option<f64> {
        if deadline.late() {
            return None;
        }
        let leaves = self.linked.leaves();
        let step = leaves.len().div_ceil(TIMED_LEAVES).max(1);
        let timed = |&leaf: &u32| self.row_rays(leaf, TIMED_RAYS);
        let sample: Vec<LeafRays> = leaves.iter().step_by(step).map(timed).collect();
        let start = deadline.elapsed();
        let [traced] = RayRows::trace(self, [&sample], |_| None, |_| ());
        let traced: u32 = traced.rows.iter().map(|row| row.rays).sum();
        let each = (deadline.elapsed() - start) / f64::from(traced.max(1));
        let possible = RAY_SHARE * deadline.left() / each;
        let shared = (possible - MIN_ROW_RAYS * leaves.len() as f64) * SHARED_AFTER_SPLIT;
        (shared >= LATE_RAYS.min(rays)).then_some(shared.min(rays))
    }

    /// A row with `count` rays in each half.
    fn row_rays(&self, leaf: u32, count: u32) -> LeafRays {
        LeafRays { leaf, count, to_emitters: true, suns: 1, sequences: self.sequences_of(leaf, EXCHANGE_SET) }
    }

    /// Traces the rays of all leaves, those in the exchange and those outside of it; the share of each leaf depends on its area and
    /// importance. After the deadline, each leaf traces at most its share of [`LATE_RAYS`], and of many leaves only some are traced.
    pub(super) fn trace_rows(&self, leaves: &[u32], rays: Option<f64>, deadline: &Deadline) -> [RayRows; 2] {
        let (elements, states) = (&self.linked.elements, &self.linked.elements.states);
        let area = |e: u32| elements.elements[e as usize].area;
        let counted = |e: u32| area(e) * f64::from(states[e as usize].importance);
        let light = |e: u32| mean(self.reflected[e as usize].light.map(f64::from)).max(0.0);
        let all_counted: f64 = leaves.iter().map(|&e| counted(e)).sum();
        let all_light: f64 = leaves.iter().map(|&e| counted(e) * light(e)).sum();
        // Noise of the rays of a leaf is in proportion to the light that it sends.
        let share = |e: u32| {
            let by_light = if all_light > 0.0 { light(e) / all_light } else { 1.0 / all_counted };
            counted(e) * ((1.0 - SHARE_BY_LIGHT) / all_counted + SHARE_BY_LIGHT * by_light)
        };
        // Rays to the sky join no elements, and elements in the open need few to know the deviation of others. Rays that elements have
        // because points see them leave the scene as often as rays from all that points see.
        let stay = |leaf: u32| {
            if !self.has_environment() {
                return 1.0;
            }
            let stays = 1.0 - f64::from(self.linked.surroundings.escaped[self.side_of(leaf) as usize]);
            let Some(view) = self.linked.points_view else { return stays };
            let uniform_share = UNIFORM_IMPORTANCE / f64::from(states[leaf as usize].importance);
            uniform_share * stays + (1.0 - uniform_share) * (1.0 - view.open)
        };
        let reflected = self.reflected_everywhere();
        let count = |leaf: u32, rays: f64| {
            let stays = stay(leaf);
            // The deviation of rays is needed only where elements gather light.
            let least = match (self.elements, self.has_environment()) {
                (true, _) => MIN_ROW_RAYS,
                (_, true) => {
                    (2.0 * MIN_ROW_RAYS * stays / USUAL_REFLECTED).clamp(FEWEST_ROW_RAYS, MIN_ROW_RAYS)
                }
                (_, false) => {
                    (MIN_ROW_RAYS * reflected / USUAL_REFLECTED).clamp(FEWEST_ROW_RAYS, MIN_ROW_RAYS)
                }
            };
            let rays = least + rays * stays * share(leaf);
            (rays.min(MAX_ROW_RAYS) as u32).div_ceil(2)
        };
        let rays = rays.filter(|_| !deadline.late()).unwrap_or(LATE_RAYS);
        let planned = leaves.iter().map(|&leaf| self.row_rays(leaf, count(leaf, rays)));
        let (exchanged, apart): (Vec<LeafRays>, Vec<LeafRays>) =
            planned.partition(|of| !states[of.leaf as usize].is_excluded());
        // Half of the leaves that are traced late are large ones, half are drawn.
        let large = elements.area / (0.5 * MAX_LATE_LEAVES as f64);
        let step = leaves.len().div_ceil(MAX_LATE_LEAVES / 2) as u64;
        let few = leaves.len() <= MAX_LATE_LEAVES;
        let traced_late = |leaf: u32| few || area(leaf) >= large || mix(u64::from(leaf)).is_multiple_of(step);
        let fewer = |of: &LeafRays| LeafRays { count: of.count.min(count(of.leaf, LATE_RAYS)), ..*of };
        // The steps after the rays have the rest of the time.
        let tracing = deadline.part(RAY_SHARE);
        let instead = |batch: &[LeafRays]| {
            let late = || batch.iter().filter(|of| traced_late(of.leaf)).map(fewer).collect();
            tracing.late().then(late)
        };
        deadline.stage("local pass, rays", leaves.len());
        let rows = RayRows::trace(self, [&exchanged, &apart], instead, |n| deadline.advance(n));
        deadline.stage("local pass, light", 0);
        rows
    }
}
