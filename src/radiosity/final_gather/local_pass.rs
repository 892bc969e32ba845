//! The local pass: the irradiance of each element of a scene with clusters, by rays of its own.
//!
//! Light at a linked cluster is distributed among its surfaces by orientation; what they hide from each other is known only on
//! average, and insides of furniture would receive light that never gets there. So in the end every element traces a few rays. The
//! exchange of two elements is estimated by all rays that join them, from either side ([`TransportMatrix`]), so that no energy is
//! created, and light that arrives by one half of the rays is sent along the other ([`RayTransport`]). The rays are stored, twelve
//! bytes each, and the light is solved on them to the last bounce without further rays, starting from the direct light, or from the
//! light along links where the time is up. The direct light of all elements is brought to what rays from the emitters say of it. See
//! `docs/method.md`, Local pass.

use super::bright_leaves::Brightest;
use super::gatherer::FinalGather;
use super::local_noise::{LocalResult, assign_noise, weigh_errors};
use super::ray_rows::{PathEnd, RayRow, RayRows};
use super::untraced::estimate_untraced;
use crate::radiosity::deadline::{Deadline, GATHER_SHARE};
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::links::{Tally, VisibilityEngine};
use crate::radiosity::options::RowSums;
use crate::radiosity::refinement::LinkedScene;
use crate::radiosity::rgb::{Rgb, add, mean};
use crate::radiosity::surroundings::{Arrived, SampledShare, emitted_share};
use crate::radiosity::transport::{
    Convergence, Field, MatrixRow, Path, RayTransport, TransportMatrix, solve,
};
use glam::Vec3;
use rayon::prelude::*;
use std::array::from_fn;

/// Expected relative error of the direct light that all elements receive together, by their own rays.
const DIRECT_ERROR: f64 = 0.01;
/// Part of the rays by which elements exchange light. The others gather that light for one element each. In an office and a living
/// room a seventh and two sevenths leave the same error of the elements within a tenth of it (`scenes/room.py`).
pub(super) const EXCHANGE_SHARE: f64 = 1.0 / 7.0;

/// Part of the light of the suns up to which a surface is in the shade, or not seen by rays up to which it is in the sun: half a ray of sixteen, those of
/// four leaves.
const SHADED: f64 = 1.0 / 32.0;

/// The result of the local pass.
pub struct LocalPass {
    /// By element; 0 for clusters and elements with children.
    pub results: Vec<LocalResult>,
    /// Rays for the light of the elements; none if it is not asked for or there is no time for them.
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
    /// Traces the exchange's share of about `rays` rays, of `useful` ones, and solves the light on them. The deviations that it finds tell how many of `most`
    /// rays the light of the elements needs: on leaves and rocks more than is known before, as elements share little. Without a number, or after the
    /// deadline, elements trace only a few: enough for the light of the whole scene, not for that of each element. Of many elements, some
    /// are then not traced.
    pub fn local_pass(&self, rays: Option<f64>, [useful, most]: [f64; 2], deadline: &Deadline) -> LocalPass {
        let all = self.linked.leaves();
        let states = &self.linked.elements.states;
        let start = deadline.elapsed();
        let [mut rows, mut apart] = self.trace_rows(&all, rays.map(|rays| EXCHANGE_SHARE * rays), deadline);
        let traced: f64 = rows.rows.iter().chain(&apart.rows).map(|row| f64::from(row.rays)).sum();
        let seconds_a_ray = (deadline.elapsed() - start) / traced.max(1.0);
        let untraced = all.len() - rows.rows.len() - apart.rows.len();
        rows.number_rows(self.linked.elements.len(), &self.reflected);
        let sampled = self.emitted_share();
        // The light of leaves that were not traced is not known here.
        let (factor, received) = match untraced {
            0 => self.balance_of_direct_light(self.received_directly(&[&rows, &apart]), &sampled),
            _ => (1.0, sampled.share),
        };
        let direct = [0, 1].map(|half| direct_light(&rows, half, factor));
        // Of an iteration that the deadline ends at once the start remains. Otherwise it is the direct light: links bring a little light
        // to rooms without any.
        let along_links = |row: &RayRow| states[row.leaf as usize].irradiance;
        let start = deadline.late().then(|| rows.rows.iter().map(along_links).collect());
        let mut transport = RayTransport::new(self.exchange(&rows), self.path_exchange(&rows), direct);
        let (first, convergence) = solve(&mut transport, start, deadline);
        let light = transport.both(first);
        let mut results = vec![LocalResult::default(); self.linked.elements.len()];
        for ((row, a), b) in rows.rows.iter().zip(&light[0]).zip(&light[1]) {
            // Light is not negative. Values below zero are rounding in the dark and noise: rows with a sum that is too large send light back.
            results[row.leaf as usize].irradiance = from_fn(|k| (0.5 * (a[k] + b[k])).max(0.0));
        }
        let leaves: Vec<u32> = rows.rows.iter().map(|row| row.leaf).collect();
        rows.add_light_of_ends(|row| Some(self.reflected_by(leaves[row as usize], &results)));
        let halves = transport.row_sums();
        let sums = assign_row_sums(&rows, &halves, &mut results);
        if self.elements {
            let brightest = |leaves: &[(u32, f64)], power: f64| {
                let rays = [self.gather_rays, self.light_rays];
                Brightest::of(&self.linked.elements, leaves, rays, self.error * power)
            };
            self.mark_shadows(&[&rows, &apart], &mut results);
            assign_noise(&self.linked.elements, &rows, (&transport, &sums), brightest, &mut results);
        } else {
            count_sent(&rows, &halves, &light, &mut results);
        }
        if untraced > 0 || self.elements && all.len() > rows.rows.len() {
            estimate_untraced(&self.linked.elements, &all, &mut results);
        }
        self.light_apart(&mut apart, factor, &mut results);
        let arrived = self.arrived(&[&rows, &apart], &all, &results);
        let element_rays = rays.map(|rays| match deadline.limited() {
            true => ((1.0 - EXCHANGE_SHARE) * useful).min(GATHER_SHARE * deadline.left() / seconds_a_ray),
            false => (1.0 - EXCHANGE_SHARE) * rays,
        });
        let exchanged = rays.map_or(0.0, |rays| EXCHANGE_SHARE * rays);
        let traced_part = (exchanged + element_rays.unwrap_or(0.0)) / useful;
        let element_rays = element_rays.filter(|_| self.elements).map(|rays| {
            weigh_errors(&self.linked.elements, &all, &mut results);
            let possible = if deadline.limited() { rays } else { (1.0 - EXCHANGE_SHARE) * most };
            possible.min(self.needed_rays(&all, &results))
        });
        let RayRows { hurried, mut tally, .. } = rows;
        tally.add(apart.tally);
        let hurried = hurried + apart.hurried;
        LocalPass {
            results,
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

    /// Gives leaves that take no part in the exchange the light that their rays have found, that of emitters times a factor, now that the light of others is
    /// known.
    fn light_apart(&self, apart: &mut RayRows, factor: f64, results: &mut [LocalResult]) {
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

    /// What comes from beyond the scene. Leaves without rows have as much of it relative to their light as the others.
    fn arrived(&self, rows: &[&RayRows], all: &[u32], results: &[LocalResult]) -> Arrived {
        let elements = &self.linked.elements.elements;
        let rows = || rows.iter().flat_map(|rows| &rows.rows);
        let beyond = |row: &RayRow| {
            (elements[row.leaf as usize].area, row.sky / row.rays as f32, row.sun / row.rays as f32)
        };
        let power = |leaf: u32| elements[leaf as usize].area * mean(results[leaf as usize].irradiance);
        let known: f64 = rows().map(|row| power(row.leaf)).sum();
        let part = if known > 0.0 { all.iter().map(|&leaf| power(leaf)).sum::<f64>() / known } else { 1.0 };
        Arrived::of(rows().map(beyond)).times(part)
    }

    /// Marks leaves where rays to suns, their own and those of leaves with the same parent, find part of the light.
    fn mark_shadows(&self, rows: &[&RayRows], results: &mut [LocalResult]) {
        let Elements { elements, sides, .. } = &self.linked.elements;
        if self.suns().is_empty() {
            return;
        }
        let parent = |row: &RayRow| elements[row.leaf as usize].parent as usize;
        let rows = || rows.iter().flat_map(|rows| &rows.rows);
        let mut sums = vec![[0.0f64; 2]; elements.len()];
        for row in rows() {
            let normal = sides[self.side_of(row.leaf) as usize].normal.as_dvec3();
            let free: f64 = self.suns().iter().map(|sun| mean(sun.irradiance_on(normal))).sum();
            let found = [f64::from(row.sun.element_sum()) / 3.0, f64::from(row.rays) * free];
            sums[parent(row)].iter_mut().zip(found).for_each(|(sum, v)| *sum += v);
        }
        for row in rows() {
            let [seen, free] = sums[parent(row)];
            results[row.leaf as usize].sun_varies = seen > SHADED * free && seen < (1.0 - SHADED) * free;
        }
    }

    /// The direct light of rows from the emitters of the scene, W/m² times scene units squared.
    fn received_directly(&self, rows: &[&RayRows]) -> f64 {
        let elements = &self.linked.elements.elements;
        let light = |row: &RayRow| elements[row.leaf as usize].area * mean(emitters_irradiance(row));
        rows.iter().map(|rows| rows.rows.iter().map(light).sum::<f64>()).sum()
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
        let (own, other) = ((DIRECT_ERROR * found.max(sampled.mean)).powi(2), sampled.error.powi(2));
        let share = found + own / (own + other) * (sampled.mean - found);
        (share / found, sampled.share.map(|of| of * share / sampled.mean))
    }

    /// What a leaf reflects by these results, W/m².
    fn reflected_by(&self, leaf: u32, results: &[LocalResult]) -> Vec3 {
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
        let (first, second) = rayon::join(|| of_half(0), || of_half(1));
        [first, second].map(|(matrix, rows, met)| match linked.settings.row_sums {
            RowSums::Balanced => matrix.balanced(&rows, &met),
            RowSums::Sampled => matrix,
        })
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

/// Direct irradiance of the rows by a half of their rays, with that from the emitters of the scene times a factor; W/m².
fn direct_light(rows: &RayRows, half: usize, factor: f64) -> Field {
    let of_row = |row: &RayRow| {
        let mut direct = of_half(row, row.halves[half].direct);
        add(&mut direct, factor - 1.0, of_half(row, row.halves[half].emitted));
        direct
    };
    rows.rows.par_iter().map(of_row).collect()
}

/// The mean over half of the rays of a row of what they add up to.
fn of_half(row: &RayRow, sum: Vec3) -> Rgb {
    sum.to_array().map(|of| 2.0 * f64::from(of) / f64::from(row.rays))
}

/// Assigns the number of rays, the part of them that stayed in the scene and the row sum to all leaves with rows. Returns the mean row sums of the form
/// factors by both halves of the rays.
fn assign_row_sums(rows: &RayRows, [first, second]: &[Vec<f64>; 2], results: &mut [LocalResult]) -> Vec<f64> {
    let sums: Vec<f64> = first.iter().zip(second).map(|(a, b)| 0.5 * (a + b)).collect();
    for (row, sum) in rows.rows.iter().zip(&sums) {
        let (rays, result) = (f64::from(row.rays), &mut results[row.leaf as usize]);
        result.rays = row.rays;
        result.row_sum = (sum + f64::from(row.outside + row.continued()) / rays) as f32;
        result.kept = 1.0 - row.gone as f32 / rays as f32;
    }
    sums
}

/// Lets the ledger, which multiplies row sums by the mean light of both halves, count what rows send: the light of each half times what the rays of the
/// other half say of where it goes.
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
        if own > 0.0 {
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
