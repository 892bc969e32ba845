//! Row sums of the form factors along links: what they are, what they must be, and how they are made so.

use super::clock::Clock;
use super::cut::{Closure, Cut};
use super::field::{Incoming, Outgoing, Rgb, gather};
use super::options::Rows;
use super::probe::OFF;
use super::{Solver, mean};
use crate::element::{Element, Elements, Shape};
use crate::embree::Hits;
use crate::link::{cosine_direction, point_on};
use crate::ray::{LANES, Packet};
use rayon::prelude::*;
use sobol_burley::sample_4d;

/// A leaf that sees hardly anything of what it should along its links is not mended: nothing is known of it.
const NOTHING: f64 = 0.1;
/// What balancing leaves of more than this has not been balanced.
const TOO_MUCH: f64 = 1.25;
/// Most rounds of balancing, and the root mean square error of the row sums (by area) at which it ends.
const ROUNDS: usize = 20;
const BALANCED: f64 = 3e-5;
/// Rounds before the clock is looked at.
const LEAST_ROUNDS: usize = 1;
/// Part of the light that a row sum above 1 gives back of what it gets, beyond which it is cut down.
const GROWS: f64 = 0.98;
/// Least and largest factor of a leaf.
const LEAST: f32 = 1e-4;
const MOST: f32 = 2.0;
/// Rays by which a leaf finds out what it sees of the scene: its share of these, by area or emitted power, within limits.
const RAYS: f64 = 2e5;
const LEAST_RAYS: usize = 48;
const MOST_RAYS: usize = 8192;
/// Standard errors by which rows may differ from that.
const SURE: f64 = 1.5;

impl Solver<'_> {
    /// The sum of each surface element's form factors along its links, before it is multiplied by its own closure: the
    /// irradiance that radiosity 1 everywhere would cause.
    pub(super) fn row_sums(&self, cut: &Cut) -> Vec<f64> {
        let of = |&e: &u32| [f64::from(self.closure[e as usize].sends); 3];
        let surfaces: Vec<Rgb> = cut.elements[cut.clusters..].iter().map(of).collect();
        let ones = Outgoing::pull(&self.elements, cut, &surfaces, |_, r| cut.responses[r].ones);
        let Incoming { clusters, surfaces } = gather(&self.elements, cut, &ones);
        cut.expand(&self.elements, &clusters, &surfaces).into_iter().map(|e| e[0]).collect()
    }

    /// Makes the row sums of leaves what they must be: 1 where there is no way out of the scene (method E.7), elsewhere
    /// what rays say. What the errors of links add or take away would be multiplied by every bounce.
    ///
    /// Returns the row sums there were, and the number of leaves that would have made light grow without end (see
    /// [`Solver::bound`]). When it is late nobody asks rays, and less is balanced.
    pub(super) fn close(&mut self, clock: &Clock) -> (Vec<f64>, usize) {
        self.closure.fill(Closure::NONE);
        let mut cut = self.cut();
        let sampled = self.row_sums(&cut);
        let goals = self.goals(&sampled, clock);
        let mut sums = sampled.clone();
        for round in 0..if self.rows == Rows::Balanced { ROUNDS } else { 1 } {
            let (mut off, mut all) = (0.0, 0.0);
            for (e, &sum) in sums.iter().enumerate() {
                let before = self.closure[e].gathers;
                let missing = missing(goals[e], f64::from(before) * sum);
                self.closure[e] = match self.rows {
                    Rows::Sampled => Closure::NONE,
                    Rows::Closed => Closure { gathers: missing as f32, sends: 1.0 },
                    Rows::Balanced => {
                        let factor = (before * missing.sqrt() as f32).clamp(LEAST, MOST);
                        Closure { gathers: factor, sends: factor }
                    }
                };
                let element = &self.elements.elements[e];
                if element.is_leaf() && self.closure[e].gathers < MOST && missing != 1.0 {
                    off += element.area * (1.0 / missing - 1.0).powi(2);
                    all += element.area;
                }
            }
            if off <= BALANCED * BALANCED * all || (round >= LEAST_ROUNDS && clock.late()) {
                break;
            }
            cut.reclose(&self.elements, &self.closure);
            sums = self.row_sums(&cut);
        }
        // What balancing has left is made up where it is gathered.
        for (e, &sum) in sums.iter().enumerate().filter(|_| self.rows == Rows::Balanced) {
            let row = f64::from(self.closure[e].gathers) * sum;
            let missing = missing(goals[e], row);
            if missing < TOO_MUCH {
                self.closure[e].gathers *= missing as f32;
            }
        }
        (sampled, self.bound(&sums))
    }

    /// Leaves whose row sum (before closure) is above 1, which no form factors have, and so far that light which is reflected
    /// again and again would hardly lose or even gain, gather as if it were 1. Returns their number.
    fn bound(&mut self, sums: &[f64]) -> usize {
        let mut bounded = 0;
        for (e, &sum) in sums.iter().enumerate() {
            let Shape::Surface { side, .. } = self.elements.elements[e].shape else { continue };
            let reflectance = self.elements.sides[side as usize].reflectance.into_iter().fold(0.0, f32::max);
            let row = f64::from(self.closure[e].gathers) * sum;
            if row > 1.0 && row * f64::from(reflectance) > GROWS {
                self.closure[e].gathers = (1.0 / sum) as f32;
                bounded += usize::from(self.elements.elements[e].is_leaf());
            }
        }
        bounded
    }

    /// By element, what the row sums of leaves are to be; 0 where it is not known. Rays have noise that links, whose form
    /// factors are computed, need not have: rows are brought towards what rays say only as far as that is sure, of all
    /// leaves of a side together first.
    fn goals(&self, sums: &[f64], clock: &Clock) -> Vec<f64> {
        let elements = &self.elements.elements;
        let found = self.looks(clock);
        let mut sides = vec![Pool::default(); self.elements.sides.len()];
        for (e, seen) in found.iter().enumerate() {
            if let (Shape::Surface { side, .. }, Seen::Part(met, rays)) = (&elements[e].shape, seen) {
                sides[*side as usize].add(elements[e].area, sums[e], *met, *rays);
            }
        }
        (0..elements.len())
            .map(|e| match (&elements[e].shape, found[e]) {
                (_, Seen::All) => 1.0,
                (Shape::Surface { side, .. }, Seen::Part(met, rays)) => {
                    let row = sums[e] * sides[*side as usize].factor();
                    row + surely(met / rays - row, variance(met, rays))
                }
                _ => 0.0,
            })
            .collect()
    }

    /// By element, what rays of leaves say that they see.
    fn looks(&self, clock: &Clock) -> Vec<Seen> {
        let elements = &self.elements.elements;
        let power = |e: &Element| match e.shape {
            Shape::Surface { side, .. } if e.is_leaf() => {
                e.area * mean(self.elements.sides[side as usize].exitance)
            }
            _ => 0.0,
        };
        let emitted = elements.iter().map(power).sum::<f64>().max(f64::MIN_POSITIVE);
        (0..elements.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|e| match elements[e].shape {
                Shape::Surface { side, .. } if elements[e].is_leaf() => {
                    if self.probe.closed[side as usize] {
                        return Seen::All;
                    }
                    if clock.late() {
                        return Seen::Nothing;
                    }
                    // What much light comes from, or goes to, must be known well.
                    let share = (elements[e].area / self.elements.area).max(power(&elements[e]) / emitted);
                    let packets = ((RAYS * share) as usize).clamp(LEAST_RAYS, MOST_RAYS) / LANES;
                    Seen::Part(self.met(e, packets) as f64, (packets * LANES) as f64)
                }
                _ => Seen::Nothing,
            })
            .collect()
    }

    /// How many rays from a leaf, out of so many times sixteen, meet a side that light can reach.
    fn met(&self, e: usize, packets: usize) -> usize {
        let Shape::Surface { side, corners } = &self.elements.elements[e].shape else { return 0 };
        let normal = self.elements.sides[*side as usize].normal;
        let length = 1.01 * self.elements.clusters[0].bounds.diagonal();
        let exact = self.sight.exact();
        let mut met = 0;
        for k in 0..packets {
            let mut packet = Packet::EMPTY;
            for lane in 0..LANES {
                let [u, v, p, q] = sample_4d((k * LANES + lane) as u32, 0, self.seed as u32 ^ e as u32);
                let from = point_on(corners, u, v) + OFF * self.ends.slack() * normal;
                packet.set(lane, from, from + length * cosine_direction(normal, p, q), self.ends);
            }
            packet.near = [0.0; LANES];
            let mut hits = [Hits::NONE];
            exact.scene.first_hits(exact.traversal, std::slice::from_ref(&packet), &mut hits);
            met += (0..LANES)
                .filter(|&lane| match hits[0].triangle[lane] {
                    Hits::NOTHING => false,
                    t => {
                        let direction = packet.point(lane, 1.0) - packet.point(lane, 0.0);
                        self.elements.met(t, direction) != Elements::NONE
                    }
                })
                .count();
        }
        met
    }
}

/// What is known of the part of what an element sees that is not sky.
#[derive(Clone, Copy)]
enum Seen {
    /// Not asked.
    Nothing,
    /// There is no way out.
    All,
    /// So many of so many rays.
    Part(f64, f64),
}

/// Leaves of a side together: area, and sums by area of their rows, of what rays say, and of that one's variance by area
/// squared.
#[derive(Clone, Copy, Default)]
struct Pool {
    area: f64,
    row: f64,
    seen: f64,
    variance: f64,
}

impl Pool {
    fn add(&mut self, area: f64, row: f64, met: f64, rays: f64) {
        self.area += area;
        self.row += area * row;
        self.seen += area * met / rays;
        self.variance += area * area * variance(met, rays);
    }

    /// What rows are to be multiplied by.
    fn factor(&self) -> f64 {
        if self.row <= NOTHING * self.seen || self.row <= 0.0 {
            return 1.0;
        }
        1.0 + surely(self.seen - self.row, self.variance) / self.row
    }
}

/// Of a part of so many rays; never 0.
fn variance(met: f64, rays: f64) -> f64 {
    let p = (met + 1.0) / (rays + 2.0);
    p * (1.0 - p) / rays
}

/// What is left of a difference when what may be chance is taken off.
fn surely(difference: f64, variance: f64) -> f64 {
    difference.signum() * (difference.abs() - SURE * variance.sqrt()).max(0.0)
}

/// What a leaf must gather more, by what its row sum is to be and what it is.
fn missing(goal: f64, sum: f64) -> f64 {
    if sum > NOTHING * goal && goal > 0.0 { goal / sum } else { 1.0 }
}
