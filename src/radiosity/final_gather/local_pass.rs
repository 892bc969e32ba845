//! The local pass: the irradiance of each element of a scene with clusters, by rays of its own.
//!
//! Light at a linked cluster is distributed among its surfaces by orientation. Occlusion between these surfaces is known only on average,
//! and insides of furniture would receive light that cannot reach them. Therefore every element finally traces a few rays. The exchange of
//! two elements is estimated by all rays that join them, from either side ([`TransportMatrix`]), so that no energy is created, and light
//! that arrives by one half of the rays is sent along the other ([`RayTransport`]). The rays are stored, twelve bytes each, and the light
//! is solved on them to the last bounce without further rays, starting from the direct light, or from the light along links if the time is
//! up. The direct light of all elements is scaled to the total that rays from the emitters measure. See `docs/method.md`, Local pass.

use super::bright_leaves::Brightest;
use super::element_samples::ElementLight;
use super::gatherer::FinalGather;
use super::local_noise::{LocalResult, assign_noise, weigh_errors};
use super::neighbours::axis;
use super::ray_rows::{PathEnd, RayRow, RayRows};
use super::untraced::Surrounding;
use crate::math::parallel;
use crate::radiosity::deadline::{Deadline, GATHER_SHARE};
use crate::radiosity::elements::{Element, Elements, Shape};
use crate::radiosity::links::{Tally, VisibilityEngine};
use crate::radiosity::options::RowNormalisation;
use crate::radiosity::refinement::LinkedScene;
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::radiosity::surroundings::{SampledShare, SkyPower, emitted_share};
use crate::radiosity::transport::{
    Convergence, Field, MatrixRow, Path, RayTransport, TransportMatrix, solve,
};
use glam::Vec3;
use std::array::from_fn;
use std::collections::HashMap;

/// Expected relative error of the direct light that all elements receive together, by their own rays: half of the error that is asked
/// for by default. It only weighs this light against other estimates of it.
const DIRECT_ERROR: f64 = 0.01;
/// Fraction of the rays by which elements exchange light. Each of the other rays gathers that light for one element. In an office and
/// a living room a seventh and two sevenths leave errors of the elements that differ by less than a tenth (`scenes/room.py`).
pub(super) const EXCHANGE_SHARE: f64 = 1.0 / 7.0;

/// The result of the local pass.
pub struct LocalPass {
    /// By element; 0 for clusters and elements with children.
    pub results: Vec<LocalResult>,
    /// Rays for the light of the elements; `None` if this light is not requested or the time is too short for them.
    pub element_rays: Option<f64>,
    /// Leaves whose light is known by the rays of the exchange, with this light.
    pub samples: Vec<(u32, ElementLight)>,
    /// Rays of both passes together, as a fraction of `wanted`.
    pub traced_part: f64,
    /// The rays that the error asked for needs in both passes.
    pub wanted: f64,
    /// Fraction of the emitted power that meets elements, by rays from the emitters.
    pub sampled: SampledShare,
    /// The same by these rays and the rays of the elements together, by channel.
    pub received: Rgb,
    /// The power that arrives from beyond the scene.
    pub arrived: SkyPower,
    /// How the light converged.
    pub convergence: Convergence,
    /// Leaves with fewer rays than planned.
    pub reduced: usize,
    /// Leaves that were not traced for lack of time: their light is estimated ([`Surrounding::estimate`]).
    pub untraced: usize,
    /// Cost of the rays.
    pub tally: Tally,
}

/// The fractions of the light along links that leaves without rays keep, by leaf.
fn link_parts(around: Option<&Surrounding>, traced: &[u32], untraced: &[u32]) -> HashMap<u32, Vec3> {
    let Some(around) = around.filter(|_| !untraced.is_empty()) else { return HashMap::new() };
    untraced.iter().copied().zip(around.cap_links(traced, untraced)).collect()
}

impl FinalGather<'_> {
    /// Traces the exchange's share of about `rays` rays, of `useful` ones, and solves the light on them. The deviations of the rays
    /// determine how many of `max` rays the light of the elements needs: on foliage and rocks more than estimated before, because
    /// elements share little light. If `rays` is `None`, or after the deadline, elements trace only a few rays: enough for the light of
    /// the whole scene, not for that of each element. Of many elements, some are then not traced.
    pub fn local_pass(&self, rays: Option<f64>, useful: f64, max: f64, deadline: &Deadline) -> LocalPass {
        let all = self.linked.leaves();
        let states = &self.linked.elements.states;
        let start = deadline.elapsed();
        let [mut rows, mut apart] = self.trace_rows(&all, rays.map(|rays| EXCHANGE_SHARE * rays), deadline);
        let traced: f64 = rows.rows.iter().chain(&apart.rows).map(|row| f64::from(row.rays)).sum();
        let seconds_a_ray = (deadline.elapsed() - start) / traced.max(1.0);
        let untraced = self.untraced(&all, [&rows, &apart]);
        let leaves: Vec<u32> = rows.rows.iter().map(|row| row.leaf).collect();
        let is_estimated = !untraced.is_empty() || self.elements && all.len() > leaves.len();
        let around = is_estimated.then(|| Surrounding::new(&self.linked.elements, &leaves));
        let link_part = link_parts(around.as_ref(), &leaves, &untraced);
        let link_part = |leaf: u32| link_part.get(&leaf).copied().unwrap_or(Vec3::ONE);
        rows.number_rows(self.linked.elements.len(), |leaf| link_part(leaf) * self.reflected_from(leaf));
        let sampled = self.emitted_share();
        // The light of leaves that were not traced is not known here.
        let (factor, received) = match untraced.is_empty() {
            true => self.balance_of_direct_light(self.received_directly(&[&rows, &apart]), &sampled),
            false => (1.0, sampled.share),
        };
        let direct = [0, 1].map(|half| direct_light(&rows, half, factor));
        // After the deadline few iterations are made: they start from the light along links. Otherwise the start is the direct light,
        // because links bring a little light to rooms without any.
        let along_links = |row: &RayRow| states[row.leaf as usize].irradiance;
        let start = deadline.late().then(|| rows.rows.iter().map(along_links).collect());
        let importance = leaves.iter().map(|&leaf| f64::from(states[leaf as usize].importance));
        let mut transport = RayTransport::new(self.exchange(&rows), self.path_exchange(&rows), direct)
            .with_importance(importance);
        let (first, convergence) = solve(&mut transport, start, deadline);
        let light = transport.both(first);
        let mut results = vec![LocalResult::default(); self.linked.elements.len()];
        assign_irradiance(&rows, &light, &mut results);
        rows.add_light_of_ends(|row| Some(self.reflected_by(leaves[row as usize], &results)));
        let halves = transport.row_sums();
        let sums = assign_row_sums(&rows, &halves, &mut results);
        if self.elements {
            self.mark_shadows(&[&rows, &apart], &mut results);
            self.assign_errors(&rows, &transport, &sums, &mut results);
        } else {
            count_sent(&rows, &halves, &light, &mut results);
        }
        if let Some(around) = &around {
            let others = apart.rows.iter().map(|row| row.leaf).chain(untraced.iter().copied());
            around.estimate(&leaves, &others.collect::<Vec<u32>>(), link_part, &mut results);
        }
        self.light_of_excluded(&mut apart, factor, &mut results);
        let arrived = self.arrived([&rows, &apart], around.as_ref(), &untraced);
        self.balance_untraced(around.as_ref(), &all, &untraced, &sampled, arrived, &mut results);
        let (mut wanted, mut samples) = (EXCHANGE_SHARE * useful, Vec::new());
        let element_rays = rays.filter(|_| self.elements).map(|rays| {
            weigh_errors(&self.linked.elements, &all, self.linked.dark(), &mut results);
            samples = self.exchange_samples(&rows, &results);
            let needed = ((1.0 - EXCHANGE_SHARE) * max).min(self.needed_rays(&all, &results));
            wanted += needed;
            if deadline.limited() {
                // Where the exchange had fewer rays than planned, the light of the elements has more.
                let missing = EXCHANGE_SHARE * (useful - rays);
                (needed + missing).min(GATHER_SHARE * deadline.left() / seconds_a_ray)
            } else {
                needed
            }
        });
        let traced_part = (EXCHANGE_SHARE * rays.unwrap_or(0.0) + element_rays.unwrap_or(0.0)) / wanted;
        let RayRows { reduced, mut tally, .. } = rows;
        tally.add(apart.tally);
        LocalPass {
            results,
            element_rays,
            samples,
            traced_part,
            wanted,
            sampled,
            received,
            arrived: arrived[0],
            convergence,
            reduced: reduced + apart.reduced,
            untraced: untraced.len(),
            tally,
        }
    }

    /// Sets the light of leaves outside the exchange to the light that their rays have found, that of emitters times a factor. The light
    /// of all other leaves must be known.
    fn light_of_excluded(&self, apart: &mut RayRows, factor: f64, results: &mut [LocalResult]) {
        apart.add_light_of_ends(|leaf| Some(self.reflected_by(leaf, results)));
        let Elements { elements, sides, .. } = &self.linked.elements;
        let mut first = 0;
        for row in &apart.rows {
            let mut light = direct_irradiance(row);
            add(&mut light, factor - 1.0, emitters_irradiance(row));
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

    /// Assigns standard errors to all leaves with rows, as [`assign_noise`].
    fn assign_errors(
        &self,
        rows: &RayRows,
        transport: &RayTransport,
        sums: &[f64],
        results: &mut [LocalResult],
    ) {
        let brightest = |leaves: &[(u32, f64)], power: f64| {
            Brightest::of(
                &self.linked.elements,
                leaves,
                self.gather_rays,
                self.light_rays,
                self.error * power,
            )
        };
        assign_noise(&self.linked.elements, rows, transport, sums, brightest, results);
    }

    /// Leaves without rows.
    fn untraced(&self, all: &[u32], rows: [&RayRows; 2]) -> Vec<u32> {
        if all.len() == rows[0].rows.len() + rows[1].rows.len() {
            return Vec::new();
        }
        let mut is_traced = vec![false; self.linked.elements.len()];
        rows.iter().flat_map(|rows| &rows.rows).for_each(|row| is_traced[row.leaf as usize] = true);
        all.iter().copied().filter(|&leaf| !is_traced[leaf as usize]).collect()
    }

    /// The power that arrives from beyond the scene, and the part of it that arrives at `untraced` leaves.
    fn arrived(&self, rows: [&RayRows; 2], around: Option<&Surrounding>, untraced: &[u32]) -> [SkyPower; 2] {
        let elements = &self.linked.elements.elements;
        let rows = || rows.iter().flat_map(|rows| &rows.rows);
        let beyond = |row: &RayRow| {
            let [sky, sun] = row.sky_and_sun();
            (elements[row.leaf as usize].area, sky, sun)
        };
        let mut all = SkyPower::of(rows().map(beyond));
        let extrapolated = around.filter(|_| !untraced.is_empty());
        let extrapolated = extrapolated
            .map(|around| around.arrived(rows().map(|row| (row.leaf, row.sky_and_sun())), untraced))
            .unwrap_or_default();
        all.add(extrapolated);
        [all, extrapolated]
    }

    /// Scales the light of `untraced` ones of the leaves towards the power that the emitters, sky and suns send to all leaves, less what
    /// the other leaves keep. `sampled` is the fraction of the emitted power that meets elements. Of the power that arrives from beyond
    /// the scene, the second value is extrapolated from leaves around: it counts as uncertain by itself. The other leaves have the error
    /// of their direct light. Engines that average clusters keep their own sum, as in [`FinalGather::balance_of_direct_light`]; so do
    /// beams without a sampled ray.
    fn balance_untraced(
        &self,
        around: Option<&Surrounding>,
        leaves: &[u32],
        untraced: &[u32],
        sampled: &SampledShare,
        [arrived, extrapolated]: [SkyPower; 2],
        results: &mut [LocalResult],
    ) {
        let Some(around) = around.filter(|_| !untraced.is_empty()) else { return };
        let power = self.emitted_power();
        let has_share = sampled.mean > 0.0 || mean(power) <= 0.0;
        if !matches!(self.linked.engine, VisibilityEngine::Exact(_)) || !has_share {
            return;
        }
        let received: Rgb = from_fn(|k| sampled.share[k] * power[k] + arrived.sky[k] + arrived.sun[k]);
        let error = (DIRECT_ERROR * mean(received)).hypot(sampled.error * mean(power));
        let error = error.hypot(mean(extrapolated.sky) + mean(extrapolated.sun));
        around.balance(leaves, untraced, received, error, results);
    }

    /// The direct light of rows from the emitters of the scene, W/m² times scene units squared.
    fn received_directly(&self, rows: &[&RayRows]) -> f64 {
        let elements = &self.linked.elements.elements;
        let light = |row: &RayRow| elements[row.leaf as usize].area * mean(emitters_irradiance(row));
        rows.iter().map(|rows| rows.rows.iter().map(light).sum::<f64>()).sum()
    }

    /// The power of all emitters of the scene, W/m² times scene units squared.
    fn emitted_power(&self) -> Rgb {
        let Elements { elements, sides, .. } = &self.linked.elements;
        let mut power = [0.0; 3];
        sides.iter().for_each(|side| add(&mut power, elements[side.element as usize].area, side.exitance));
        power
    }

    /// The fraction of the emitted power that meets elements.
    fn emitted_share(&self) -> SampledShare {
        let LinkedScene { elements, engine, surroundings, settings, .. } = self.linked;
        emitted_share(elements, &engine.exact(), surroundings.length, settings.seed)
    }

    /// Returns the factor that scales the direct light that elements receive, W/m² times scene units squared, to the light that the
    /// emitters send them, and this fraction of the emitted power by channel. Both sums have errors: that of the elements is expected to be
    /// [`DIRECT_ERROR`], and the factor is nearer to 1 where the share sampled by rays is less certain, as of a lamp whose light mostly
    /// leaves the scene. Engines that average clusters keep their own sum, so that the ledger shows its difference from the rays.
    pub(super) fn balance_of_direct_light(&self, received: f64, sampled: &SampledShare) -> (f64, Rgb) {
        let power = mean(self.emitted_power());
        if received <= 0.0 || power <= 0.0 {
            return (1.0, sampled.share);
        }
        let found = received / power;
        // Beams narrower than the grid of their directions have no sampled ray.
        if sampled.mean <= 0.0 {
            return (1.0, [found; 3]);
        }
        if !matches!(self.linked.engine, VisibilityEngine::Exact(_)) {
            return (1.0, sampled.share);
        }
        let (own, other) = ((DIRECT_ERROR * found.max(sampled.mean)).powi(2), sampled.error.powi(2));
        let share = found + own / (own + other) * (sampled.mean - found);
        (share / found, sampled.share.map(|of| of * share / sampled.mean))
    }

    /// Reflected radiosity of a leaf by these results, W/m².
    pub(super) fn reflected_by(&self, leaf: u32, results: &[LocalResult]) -> Vec3 {
        let (reflectance, irradiance) = (self.reflectance(leaf), results[leaf as usize].irradiance);
        Vec3::from_array(from_fn(|k| reflectance[k] * irradiance[k] as f32))
    }

    /// The reflectance of a leaf, by channel.
    fn reflectance(&self, leaf: u32) -> [f32; 3] {
        self.linked.elements.sides[self.side_of(leaf) as usize].reflectance
    }

    /// The light that paths bring from row to row, by half of the rays.
    fn path_exchange(&self, rows: &RayRows) -> [Vec<Path>; 2] {
        let path = |end: &PathEnd| {
            let reflectance = Vec3::from(self.reflectance(rows.rows[end.met as usize].leaf));
            let part = 2.0 / rows.rows[end.row as usize].rays as f32;
            Path { row: end.row, met: end.met, share: (part * end.share * reflectance).to_array() }
        };
        let half_of = |end: &&PathEnd| rows.rows[end.row as usize].half_of(end.ray);
        [0, 1].map(|half| rows.ends.iter().filter(|end| half_of(end) == half).map(path).collect())
    }

    /// The exchange of the leaves, by half of their rays.
    fn exchange(&self, rows: &RayRows) -> [TransportMatrix; 2] {
        let linked = self.linked;
        let elements = &linked.elements;
        let escapes = self.escapes_of_sides(rows);
        let of_half = |half: usize| {
            let (mut met, mut first) = (Vec::with_capacity(rows.met.len() / 2), 0);
            let of_row = |row: &RayRow| {
                let side = self.side_of(row.leaf) as usize;
                let each = (row.end - first) / 2;
                met.extend_from_slice(&rows.met[first + half * each..][..each]);
                first = row.end;
                MatrixRow {
                    area: elements.elements[row.leaf as usize].area,
                    reflectance: elements.sides[side].reflectance,
                    end: met.len(),
                    closed: linked.surroundings.closed[side] && row.outside == 0,
                    escapes: escapes[side],
                    apart: row.halves[half].continued as usize,
                }
            };
            let of_rows: Vec<MatrixRow> = rows.rows.iter().map(of_row).collect();
            (TransportMatrix::new(&of_rows, &met, &self.ranks), of_rows, met)
        };
        let (first, second) = parallel::join(|| of_half(0), || of_half(1));
        [first, second].map(|(matrix, rows, met)| match linked.settings.row_sums {
            RowNormalisation::Balanced => matrix.balanced(&rows, &met),
            RowNormalisation::Sampled => matrix,
        })
    }

    /// By side, the fraction of the light of its rows that meets no other row, with half a ray added to either count (Jeffreys prior): a
    /// count of 0 among few rays does not mean the probability 0.
    fn escapes_of_sides(&self, rows: &RayRows) -> Vec<f64> {
        let mut sides = vec![(0.5, 1.0); self.linked.elements.sides.len()];
        let mut first = 0;
        for row in &rows.rows {
            let escaped = rows.met[first..row.end].iter().filter(|&&met| met == Elements::NONE).count();
            let of = &mut sides[self.side_of(row.leaf) as usize];
            *of = (of.0 + escaped as f64, of.1 + f64::from(row.rays));
            first = row.end;
        }
        sides.into_iter().map(|(escaped, rays)| escaped / rays).collect()
    }
}

/// Direct irradiance of the rows by a half of their rays, W/m²; the part by the emitters of the scene is multiplied by `factor`.
fn direct_light(rows: &RayRows, half: usize, factor: f64) -> Field {
    let of_row = |row: &RayRow| {
        let mut direct = of_half(row, row.halves[half].direct);
        add(&mut direct, factor - 1.0, of_half(row, row.halves[half].emitted));
        direct
    };
    parallel::map(&rows.rows, of_row)
}

/// The mean over half of the rays of a row, from their sum.
fn of_half(row: &RayRow, sum: Vec3) -> Rgb {
    sum.to_array().map(|of| 2.0 * f64::from(of) / f64::from(row.rays))
}

/// Assigns the number of rays, the fraction of them that stayed in the scene and the row sum to all leaves with rows. Returns the mean
/// row sums of the form factors by both halves of the rays.
fn assign_row_sums(rows: &RayRows, [first, second]: &[Vec<f64>; 2], results: &mut [LocalResult]) -> Vec<f64> {
    let sums: Vec<f64> = first.iter().zip(second).map(|(a, b)| 0.5 * (a + b)).collect();
    for (row, sum) in rows.rows.iter().zip(&sums) {
        let (rays, result) = (f64::from(row.rays), &mut results[row.leaf as usize]);
        result.rays = row.rays;
        result.meets_emitters = 2 * row.met_emitters > row.rays;
        result.row_sum = (sum + f64::from(row.outside + row.continued()) / rays) as f32;
        result.kept = 1.0 - row.escaped as f32 / rays as f32;
    }
    sums
}

/// Sets row sums such that the ledger, which multiplies them by the mean light of both halves, obtains the power that rows send: the
/// light of each half times the row sums of the other half.
fn count_sent(rows: &RayRows, sums: &[Vec<f64>; 2], light: &[Field; 2], results: &mut [LocalResult]) {
    let [first, second] = light;
    for (i, row) in rows.rows.iter().enumerate() {
        let rays = f64::from(row.rays);
        let part = |half: usize| {
            let apart = 2.0 * f64::from(row.halves[half].continued) + f64::from(row.outside);
            sums[half][i] + apart / rays
        };
        let result = &mut results[row.leaf as usize];
        let own = mean(result.irradiance);
        if own != 0.0 {
            let sent = 0.5 * (part(0) * mean(second[i]) + part(1) * mean(first[i]));
            result.row_sum = (sent / own) as f32;
        }
    }
}

/// Direct irradiance of a row, W/m².
fn direct_irradiance(row: &RayRow) -> Rgb {
    row.direct().to_array().map(|d| f64::from(d) / f64::from(row.rays))
}

/// Irradiance of a row by the emitters of the scene, W/m².
fn emitters_irradiance(row: &RayRow) -> Rgb {
    row.emitted().to_array().map(|d| f64::from(d) / f64::from(row.rays))
}

/// Assigns the mean irradiance of both halves to all leaves with rows. Noise may bring it below 0. It stays for what gathers
/// this light, as the noise of many leaves cancels: a limit at 0 would make points in houses under a sky a fifth too dark.
fn assign_irradiance(rows: &RayRows, light: &[Field; 2], results: &mut [LocalResult]) {
    for ((row, a), b) in rows.rows.iter().zip(&light[0]).zip(&light[1]) {
        results[row.leaf as usize].irradiance = from_fn(|k| 0.5 * (a[k] + b[k]));
    }
}

/// Sets negative light of leaves, which is noise or rounding in the dark, to 0. The other leaves of the same side lose what this adds, and
/// where a whole side has negative light, all sides that face the same way: below terrain over bright ground 1.3 % of all light.
pub fn limit_negative_light(elements: &Elements, light: &mut [Rgb]) {
    let side_of = |(e, element): (usize, &Element)| match element.shape {
        Shape::Surface { side, .. } if element.is_leaf() => Some((e, side as usize)),
        _ => None,
    };
    let leaves = || elements.elements.iter().enumerate().filter_map(side_of);
    // By side and channel, the power and the power without negative values.
    let mut powers = vec![[[0.0; 2]; 3]; elements.sides.len()];
    for (e, side) in leaves() {
        for (power, own) in powers[side].iter_mut().zip(light[e]) {
            let area = elements.elements[e].area;
            power.iter_mut().zip([own, own.max(0.0)]).for_each(|(sum, of)| *sum += area * of);
        }
    }
    // By signed axis that sides face and channel, the same after the limit of each side's power to 0.
    let mut facing = [[[0.0; 2]; 3]; 6];
    for (side, power) in elements.sides.iter().zip(&powers) {
        for (sums, [own, _]) in facing[axis(side.normal)].iter_mut().zip(power) {
            sums.iter_mut().zip([*own, own.max(0.0)]).for_each(|(sum, of)| *sum += of);
        }
    }
    let factor =
        |[all, positive]: [f64; 2]| if positive > 0.0 { (all / positive).clamp(0.0, 1.0) } else { 0.0 };
    for (e, side) in leaves() {
        let facing = &facing[axis(elements.sides[side].normal)];
        for (k, own) in light[e].iter_mut().enumerate() {
            *own = factor(powers[side][k]) * factor(facing[k]) * own.max(0.0);
        }
    }
}
