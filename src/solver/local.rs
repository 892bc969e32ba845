//! The local pass: what each element of a cluttered scene receives, by rays of its own.
//!
//! What arrives at a cluster is shared out among its surfaces by their orientation; what they hide from each other is known
//! on average only, and insides of furniture get light that never comes there (method D.13). So in the end every
//! element traces a few rays: its row of the form factors is the share of its rays that end on each other element, and
//! rows of closed scenes sum up to 1. The rows are kept, four bytes a ray, and the light is solved on them to the last
//! bounce, which costs no more rays; it starts from the solution along links.

use super::Settled;
use super::clock::Clock;
use super::field::Rgb;
use super::receive::{Buffers, Receiver};
use super::system::System;
use super::walk::Place;
use crate::element::{Elements, Shape};
use crate::link::{Tally, mix, point_on};
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
const TRACING: f64 = 0.7;
/// Part of the rays that is left when surfaces have been split for so many rays, and each part has its few.
const SHARED: f64 = 0.8;
/// Elements that one task traces for.
const CHUNK: usize = 64;
/// Groups between which reciprocity is measured, or a few more.
const GROUPS: usize = 8;
/// Rays of its neighbours that an element's own spread is mixed with: few rays say little about it.
const PRIOR: f64 = 8.0;

/// What the local pass has found, by element; 0 for clusters.
pub struct Local {
    /// Irradiance of leaves, W/m².
    pub incident: Vec<Rgb>,
    /// Standard error of its mean over the channels, from the spread of the rays.
    pub noise: Vec<f32>,
    /// Part of the rays that met a side that light can reach.
    pub met: Vec<f32>,
    /// Part of the rays that did not leave the scene.
    pub kept: Vec<f32>,
    /// Mean difference of what two groups of the scene exchange by the rays of one and of the other, as part of it.
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
        let (incident, settled) = self.solve(&rows, clock);
        let mut local = Local {
            noise: vec![0.0; incident.len()],
            met: vec![0.0; incident.len()],
            kept: vec![0.0; incident.len()],
            reciprocity: self.reciprocity(&rows),
            incident,
            settled,
            tally: rows.tally,
        };
        self.judge(&rows, &mut local);
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
    fn leaves(&self) -> Vec<u32> {
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
        self.look_around(self.solver.sight, |k| sample_4d(k as u32, 0, seed), buffers);
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

    /// Irradiance of all leaves.
    fn solve(&self, rows: &Rows, clock: &Clock) -> (Vec<Rgb>, Settled) {
        let elements = &self.solver.elements;
        let mut place = vec![Elements::NONE; elements.len()];
        for (i, row) in (0..).zip(&rows.rows) {
            place[row.leaf as usize] = i;
        }
        let side = |row: &Row| match elements.elements[row.leaf as usize].shape {
            Shape::Surface { side, .. } => &elements.sides[side as usize],
            Shape::Cluster(_) => unreachable!("rows are those of surfaces"),
        };
        let system = System {
            ends: rows.rows.iter().map(|r| r.end).collect(),
            others: rows
                .met
                .iter()
                .map(|&e| if e == Elements::NONE { e } else { place[e as usize] })
                .collect(),
            reflectance: rows.rows.iter().map(|r| side(r).reflectance).collect(),
            weight: rows.rows.iter().map(|r| elements.elements[r.leaf as usize].area).collect(),
        };
        let direct: Vec<Rgb> = (0..rows.rows.len())
            .map(|i| {
                let (row, met) = rows.of(i);
                row.direct.to_array().map(|d| f64::from(d) / met.len() as f64)
            })
            .collect();
        let start = rows.rows.iter().map(|r| self.solver.incident[r.leaf as usize]).collect();
        let mut incident = vec![[0.0; 3]; elements.len()];
        let (found, settled) = system.solve(&direct, start, clock);
        for (row, now) in rows.rows.iter().zip(found) {
            incident[row.leaf as usize] = now;
        }
        (incident, settled)
    }

    /// How sure each leaf's irradiance is, and what its rays met.
    fn judge(&self, rows: &Rows, local: &mut Local) {
        let elements = &self.solver.elements;
        let (mut area, mut level) = (0.0, 0.0);
        for row in &rows.rows {
            let of = elements.elements[row.leaf as usize].area;
            (area, level) = (area + of, level + of * self.brightness(row.leaf, &local.incident));
        }
        let level = level / f64::max(area, f64::MIN_POSITIVE);
        // Sum of squared differences and degrees of freedom, by leaf and by what holds it.
        let mut spread = vec![(0.0, 0.0); elements.len()];
        for i in 0..rows.rows.len() {
            let (row, met) = rows.of(i);
            let (mut sum, mut squares, mut hits) = (0.0, f64::from(row.squares), 0u32);
            for &e in met.iter().filter(|&&e| e != Elements::NONE) {
                let b = self.brightness(e, &local.incident);
                (sum, squares, hits) = (sum + b, squares + b * b, hits + 1);
            }
            let n = met.len() as f64;
            let direct = f64::from(row.direct.element_sum()) / 3.0;
            let own = (squares - (sum * sum + direct * direct) / n).max(0.0);
            local.met[row.leaf as usize] = hits as f32 / n as f32;
            local.kept[row.leaf as usize] = 1.0 - row.gone as f32 / n as f32;
            spread[row.leaf as usize] = (own, n - 1.0);
            let parent = &mut spread[elements.elements[row.leaf as usize].parent as usize];
            *parent = (parent.0 + own, parent.1 + n - 1.0);
        }
        for i in 0..rows.rows.len() {
            let (row, met) = rows.of(i);
            let (own, freedom) = spread[row.leaf as usize];
            let (all, of_all) = spread[elements.elements[row.leaf as usize].parent as usize];
            let variance = (own + PRIOR * all / of_all.max(1.0)) / (freedom + PRIOR);
            // One ray more might have met what no other has: something as bright as all there is on average.
            let n = met.len() as f64;
            local.noise[row.leaf as usize] = (variance / n).sqrt().hypot(level / n) as f32;
        }
    }

    /// See [`Local::reciprocity`]: rows are reciprocal on average only, and between large groups the average shows.
    fn reciprocity(&self, rows: &Rows) -> f64 {
        let elements = &self.solver.elements;
        // The largest clusters are opened until there are some groups.
        let mut groups = vec![0u32];
        while groups.len() < GROUPS {
            let opens = |&e: &u32| {
                let element = &elements.elements[e as usize];
                element.child_range().any(|c| elements.elements[c].is_cluster())
            };
            let area = |e: u32| elements.elements[e as usize].area;
            let Some(largest) =
                groups.iter().copied().filter(opens).max_by(|&a, &b| area(a).total_cmp(&area(b)))
            else {
                break;
            };
            groups.retain(|&g| g != largest);
            groups.extend(elements.elements[largest as usize].child_range().map(|c| c as u32));
        }
        let mut group = vec![0usize; elements.len()];
        for e in 1..elements.len() {
            let parent = group[elements.elements[e].parent as usize];
            group[e] = groups.iter().position(|&g| g as usize == e).map_or(parent, |g| g + 1);
        }
        let n = groups.len() + 1;
        let mut exchange = vec![0.0; n * n];
        for i in 0..rows.rows.len() {
            let (row, met) = rows.of(i);
            let each = elements.elements[row.leaf as usize].area / met.len() as f64;
            for &e in met.iter().filter(|&&e| e != Elements::NONE) {
                exchange[group[row.leaf as usize] * n + group[e as usize]] += each;
            }
        }
        let (mut differ, mut all) = (0.0, 0.0);
        for (g, h) in (0..n).flat_map(|g| (0..g).map(move |h| (g, h))) {
            let (there, back) = (exchange[g * n + h], exchange[h * n + g]);
            (differ, all) = (differ + (there - back).abs(), all + 0.5 * (there + back));
        }
        if all > 0.0 { differ / all } else { 0.0 }
    }

    /// What an element reflects, mean over the channels.
    fn brightness(&self, element: u32, incident: &[Rgb]) -> f64 {
        let elements = &self.solver.elements;
        let Shape::Surface { side, .. } = elements.elements[element as usize].shape else { return 0.0 };
        let rho = elements.sides[side as usize].reflectance;
        (0..3).map(|k| f64::from(rho[k]) * incident[element as usize][k]).sum::<f64>() / 3.0
    }
}

impl Rows {
    fn of(&self, i: usize) -> (&Row, &[u32]) {
        let from = if i > 0 { self.rows[i - 1].end } else { 0 };
        (&self.rows[i], &self.met[from..self.rows[i].end])
    }
}
