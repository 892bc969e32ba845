//! The local pass: what each element of a cluttered scene receives, by rays of its own.
//!
//! What arrives at a cluster is shared out among its surfaces by their orientation; what they hide from each other is known
//! on average only, and insides of furniture get light that never comes there (method D.13). So in the end every
//! element traces a few rays: what two elements exchange is estimated by the rays that join them, whichever they come from
//! ([`System`]), so that no energy is made. The rays are kept, twelve bytes each, and the light is solved on them to the
//! last bounce, which costs no more rays; it starts from the solution along links.

use super::Settled;
use super::clock::Clock;
use super::field::Rgb;
use super::receive::{Buffers, Receiver};
use super::system::{Place as Spot, System};
use super::walk::Place;
use crate::radiosity::elements::{Elements, Shape};
use crate::radiosity::links::{Tally, mix, point_on};
use glam::Vec3;
use rayon::prelude::*;
use sobol_burley::sample_4d;
use std::time::Instant;

/// Rays of an element at least and at most.
const LEAST: f64 = 4.0;
const MOST: f64 = 4096.0;
/// Rays that all elements share when it is late. Not fewer of each: between elements that meet but each other light would not
/// get lost.
pub(super) const LATE: f64 = 1e5;
/// Leaves whose rays are timed to see how many there is time for, about, and the rays of each.
const TIMED: usize = 2000;
const TIMED_RAYS: u32 = 16;
/// Part of the time that rays may take; the rest is for the light on them.
const TRACING: f64 = 0.5;
/// Part of the rays that is left when surfaces have been split for so many rays, and each part has its few.
const SHARED: f64 = 0.8;
/// Elements that one task traces for.
const CHUNK: usize = 64;
/// Rays of its neighbours that an element's own spread is mixed with: few rays say little about it.
const PRIOR: f64 = 8.0;

/// What the local pass has found, by element; 0 for clusters.
pub struct Local {
    /// Irradiance of leaves, W/m².
    pub incident: Vec<Rgb>,
    /// Standard error of its mean over the channels, from the spread of the rays.
    pub noise: Vec<f32>,
    /// Sum of the form factors with sides that light can reach.
    pub row: Vec<f32>,
    /// Part of the rays that did not leave the scene.
    pub kept: Vec<f32>,
    /// [`System::reciprocity`] of the factors that the light was solved with.
    pub reciprocity: f64,
    /// How the light on the rays settled.
    pub settled: Settled,
    /// What the rays cost.
    pub tally: Tally,
}

/// The rays of one leaf.
struct Row {
    leaf: u32,
    /// End of its rays among all.
    end: usize,
    /// Sums over the rays of what emitters send, and of the square of its mean over the channels.
    direct: Vec3,
    squares: f32,
    /// Rays that left the scene.
    gone: u32,
}

/// Elements that the rays of leaves meet; [`Elements::NONE`] for nothing.
struct Rows {
    rows: Vec<Row>,
    met: Vec<u32>,
    tally: Tally,
}

impl Receiver<'_> {
    /// Traces about `rays` rays and solves the light on them, starting from the solver's. Without a number, or when it gets
    /// late, elements trace but a few: enough for the light of the whole, not for each of them.
    pub(super) fn local(&self, rays: Option<f64>, clock: &Clock) -> Local {
        let rows = self.rows(rays, clock);
        let system = self.system(&rows, clock);
        let (incident, settled) = self.solve(&rows, &system, clock);
        let mut local = Local {
            noise: vec![0.0; incident.len()],
            row: vec![0.0; incident.len()],
            kept: vec![0.0; incident.len()],
            reciprocity: system.reciprocity(),
            incident,
            settled,
            tally: rows.tally,
        };
        self.judge(&rows, &system, &mut local);
        local
    }

    /// So many of the rays asked for as there is limited time for, by a sample of them; none if there is not even time for the few of
    /// each element.
    pub(super) fn affordable(&self, rays: f64, clock: &Clock) -> Option<f64> {
        if clock.late() {
            return None;
        }
        let leaves = self.leaves();
        let sample: Vec<u32> = leaves.iter().copied().step_by(leaves.len().div_ceil(TIMED).max(1)).collect();
        let start = Instant::now();
        let traced = self.trace(&sample, |_| TIMED_RAYS);
        let each = start.elapsed().as_secs_f64() / traced.met.len().max(1) as f64;
        let shared = (TRACING * clock.left() / each - LEAST * leaves.len() as f64) * SHARED;
        (shared >= LATE.min(rays)).then_some(shared.min(rays))
    }

    /// All surfaces without parts.
    pub(super) fn leaves(&self) -> Vec<u32> {
        let elements = &self.solver.elements;
        (0..elements.len() as u32)
            .filter(|&e| {
                let element = &elements.elements[e as usize];
                element.is_leaf() && !element.is_cluster() && element.area > 0.0
            })
            .collect()
    }

    /// The rays: each leaf's share by its area and importance.
    fn rows(&self, rays: Option<f64>, clock: &Clock) -> Rows {
        let elements = &self.solver.elements;
        let leaves = self.leaves();
        let importance = |e: u32| f64::from(self.solver.importance.get(e as usize).copied().unwrap_or(1.0));
        let counted = |e: u32| elements.elements[e as usize].area * importance(e);
        let all_counted: f64 = leaves.iter().map(|&e| counted(e)).sum();
        self.trace(&leaves, |leaf| {
            let share = counted(leaf) / all_counted;
            let rays = rays.filter(|_| !clock.late()).unwrap_or(LATE);
            (LEAST + rays * share).min(MOST) as u32
        })
    }

    /// Traces as many rays of each leaf as `count` says.
    fn trace(&self, leaves: &[u32], count: impl Fn(u32) -> u32 + Sync) -> Rows {
        let made: Vec<Rows> = leaves
            .par_chunks(CHUNK)
            .map_init(Buffers::default, |buffers, leaves| {
                let mut made = Rows { rows: Vec::new(), met: Vec::new(), tally: Tally::default() };
                buffers.scratch.tally = Tally::default();
                for &leaf in leaves {
                    self.row(leaf, count(leaf), buffers, &mut made);
                }
                made.tally = buffers.scratch.tally;
                made
            })
            .collect();
        let mut all =
            Rows { rows: Vec::with_capacity(leaves.len()), met: Vec::new(), tally: Tally::default() };
        all.met.reserve_exact(made.iter().map(|m| m.met.len()).sum());
        for part in made {
            let before = all.met.len();
            all.rows.extend(part.rows.into_iter().map(|r| Row { end: before + r.end, ..r }));
            all.met.extend(part.met);
            all.tally.add(part.tally);
        }
        all
    }

    /// Traces the rays of a leaf.
    fn row(&self, leaf: u32, count: u32, buffers: &mut Buffers, made: &mut Rows) {
        let element = &self.solver.elements.elements[leaf as usize];
        let Shape::Surface { side, corners } = element.shape else { return };
        let seed = mix(self.solver.seed ^ mix(element.ids[0])) as u32;
        buffers.places.clear();
        buffers.places.extend((0..count).map(|k| {
            let [u, v, ..] = sample_4d(k, 1, seed);
            Place { at: point_on(&corners, u, v), side, leaf, share: Vec3::ONE }
        }));
        self.look_around(&self.solver.sight, |k| sample_4d(k as u32, 0, seed), buffers);
        let (mut direct, mut squares, mut gone) = (Vec3::ZERO, 0.0, 0);
        for found in &buffers.found {
            direct += found.direct;
            gone += u32::from(found.gone);
            squares += (found.direct.element_sum() / 3.0).powi(2);
            let nothing = found.met.side == Elements::NONE;
            made.met.push(if nothing { Elements::NONE } else { found.met.leaf });
        }
        made.rows.push(Row { leaf, end: made.met.len(), direct, squares, gone });
    }

    /// What the leaves exchange, by their rays.
    fn system(&self, rows: &Rows, clock: &Clock) -> System {
        let elements = &self.solver.elements;
        let mut place = vec![Elements::NONE; elements.len()];
        for (i, row) in (0..).zip(&rows.rows) {
            place[row.leaf as usize] = i;
        }
        let met: Vec<u32> =
            rows.met.iter().map(|&e| if e == Elements::NONE { e } else { place[e as usize] }).collect();
        let places: Vec<Spot> = rows
            .rows
            .iter()
            .map(|row| match elements.elements[row.leaf as usize].shape {
                Shape::Surface { side, .. } => Spot {
                    area: elements.elements[row.leaf as usize].area,
                    reflectance: elements.sides[side as usize].reflectance,
                    end: row.end,
                    closed: self.solver.probe.closed[side as usize],
                },
                Shape::Cluster(_) => unreachable!("rows are those of surfaces"),
            })
            .collect();
        System::new(&places, &met, self.solver.rows, clock)
    }

    /// Irradiance of all elements that have rows.
    fn solve(&self, rows: &Rows, system: &System, clock: &Clock) -> (Vec<Rgb>, Settled) {
        let direct: Vec<Rgb> = (0..rows.rows.len())
            .map(|i| {
                let (row, met) = rows.of(i);
                row.direct.to_array().map(|d| f64::from(d) / met.len() as f64)
            })
            .collect();
        let start = rows.rows.iter().map(|r| self.solver.incident[r.leaf as usize]).collect();
        let mut incident = vec![[0.0; 3]; self.solver.elements.len()];
        let (found, settled) = system.solve(&direct, start, clock);
        for (row, now) in rows.rows.iter().zip(found) {
            incident[row.leaf as usize] = now;
        }
        (incident, settled)
    }

    /// How sure each leaf's irradiance is, and what its rays met.
    fn judge(&self, rows: &Rows, system: &System, local: &mut Local) {
        let elements = &self.solver.elements;
        let brightness: Vec<f64> =
            rows.rows.iter().map(|r| self.brightness(r.leaf, &local.incident)).collect();
        let area = |row: &Row| elements.elements[row.leaf as usize].area;
        let all: f64 = rows.rows.iter().map(area).sum();
        let level: f64 = rows.rows.iter().zip(&brightness).map(|(r, b)| area(r) * b).sum();
        let level = level / all.max(f64::MIN_POSITIVE);
        let seen: Vec<Seen> = (0..rows.rows.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|i| {
                let (row, met) = rows.of(i);
                Seen::new(
                    row,
                    met.len() as f64,
                    system.form_factors(i).map(|(j, f)| (f, brightness[j as usize])),
                )
            })
            .collect();
        let mut around = vec![[Spread::default(); 2]; elements.len()];
        for (row, seen) in rows.rows.iter().zip(&seen) {
            let around = &mut around[elements.elements[row.leaf as usize].parent as usize];
            around.iter_mut().zip(seen.spreads).for_each(|(a, s)| a.add(s));
        }
        let sums = system.rows();
        for (i, (row, seen)) in rows.rows.iter().zip(&seen).enumerate() {
            let leaf = row.leaf as usize;
            let n = rows.of(i).1.len() as f64;
            local.row[leaf] = sums[i] as f32;
            local.kept[leaf] = 1.0 - row.gone as f32 / n as f32;
            let around = around[elements.elements[leaf].parent as usize];
            let [direct, reflected] = [0, 1].map(|k| seen.spreads[k].with(around[k]));
            let rays = (seen.spreads[1].freedom + 1.0).max(1.0);
            let variance = direct / n
                + sums[i] * sums[i] * reflected / rays
                + sums[i] * (1.0 - sums[i]).max(0.0) * seen.mean * seen.mean / n;
            // One ray more might have met what no other has: something as bright as all there is on average.
            local.noise[leaf] = variance.sqrt().hypot(level / n) as f32;
        }
    }

    /// What an element reflects, mean over the channels.
    fn brightness(&self, element: u32, incident: &[Rgb]) -> f64 {
        let elements = &self.solver.elements;
        let Shape::Surface { side, .. } = elements.elements[element as usize].shape else { return 0.0 };
        let rho = elements.sides[side as usize].reflectance;
        (0..3).map(|k| f64::from(rho[k]) * incident[element as usize][k]).sum::<f64>() / 3.0
    }
}

/// What a leaf sees.
struct Seen {
    /// Mean of what that sends, W/m².
    mean: f64,
    /// How what emitters send differs from ray to ray, and what others do.
    spreads: [Spread; 2],
}

impl Seen {
    /// For `n` rays; `others` are the form factors and the brightness of what rays from and to it join it with.
    fn new(row: &Row, n: f64, others: impl Iterator<Item = (f64, f64)>) -> Seen {
        let direct = f64::from(row.direct.element_sum()) / 3.0;
        let (mut weights, mut squared_weights, mut sum, mut squares) = (0.0, 0.0, 0.0, 0.0);
        for (w, b) in others {
            (weights, squared_weights) = (weights + w, squared_weights + w * w);
            (sum, squares) = (sum + w * b, squares + w * b * b);
        }
        let some = |v: f64| if weights > 0.0 { v / weights } else { 0.0 };
        let (mean, rays) = (some(sum), if weights > 0.0 { weights * weights / squared_weights } else { 0.0 });
        Seen {
            mean,
            spreads: [
                Spread::new(n, (f64::from(row.squares) - direct * direct / n).max(0.0)),
                Spread::new(rays, rays * (some(squares) - mean * mean).max(0.0)),
            ],
        }
    }
}

/// Sum of squared differences from the mean, and degrees of freedom.
#[derive(Clone, Copy, Default)]
struct Spread {
    squares: f64,
    freedom: f64,
}

impl Spread {
    fn new(rays: f64, squares: f64) -> Spread {
        Spread { squares, freedom: (rays - 1.0).max(0.0) }
    }

    fn add(&mut self, other: Spread) {
        (self.squares, self.freedom) = (self.squares + other.squares, self.freedom + other.freedom);
    }

    /// The variance, by its own rays and some of those around.
    fn with(self, around: Spread) -> f64 {
        (self.squares + PRIOR * around.squares / around.freedom.max(1.0)) / (self.freedom + PRIOR)
    }
}

impl Rows {
    fn of(&self, i: usize) -> (&Row, &[u32]) {
        let from = if i > 0 { self.rows[i - 1].end } else { 0 };
        (&self.rows[i], &self.met[from..self.rows[i].end])
    }
}
