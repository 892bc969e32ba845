//! What emitters send points directly: Lambert's formula times the visible part, by bundles of shadow rays.

use super::field::{Rgb, add};
use super::lamps::Face;
use super::receive::{CHUNK, Receiver};
use crate::form_factors::analytic::point_to_polygon;
use crate::radiosity::links::{Question, Scratch, Sight, mix, numbers, point_on};
use crate::ray::{LANES, Packet};
use glam::Vec3;

/// A point that is asked for.
#[derive(Clone, Copy)]
pub(super) struct Spot {
    pub at: Vec3,
    pub normal: Vec3,
    /// Of its samples.
    pub seed: u64,
}

/// Shadow rays of a point before others are left out.
const PILOT: usize = 2 * LANES;
/// Chunks of points that stand for all.
const RUNS: usize = 16;
/// Points of each.
const RUN: usize = 16;

impl<'a> Receiver<'a> {
    /// By emitter, what to ask for its visibility from points like these.
    pub(super) fn sights(&self, points: &[(Vec3, Vec3)]) -> Vec<Sight> {
        let step = (points.len() / RUNS).max(CHUNK);
        let sample: Vec<Spot> = points
            .chunks(step)
            .flat_map(|part| &part[..RUN.min(part.len())])
            .enumerate()
            .map(|(i, &(at, normal))| Spot { at: at + self.slack * normal, normal, seed: mix(i as u64) })
            .collect();
        let of = |emitter: usize| {
            let questions: Vec<Question> =
                self.asks(&sample, emitter).iter().map(|ask| self.question(ask, emitter, 0).0).collect();
            self.solver.sight.for_these(&questions, &mut Scratch::default())
        };
        (0..self.lamps.emitters.len()).map(of).collect()
    }

    /// What emitters send directly to points, which ask for each emitter together.
    pub(super) fn direct(&self, points: &[Spot], sights: &[Sight], scratch: &mut Scratch) -> Vec<Rgb> {
        let mut values = vec![[0.0; 3]; points.len()];
        for (emitter, sight) in sights.iter().enumerate() {
            let mut asks = self.asks(points, emitter);
            self.see(&mut asks, emitter, sight, scratch);
            for ask in asks {
                let visible = if ask.sum > 0.0 { ask.seen / ask.sum } else { 1.0 };
                add(&mut values[ask.point], visible, ask.free);
            }
        }
        values
    }

    /// The points that an emitter's front faces.
    fn asks(&self, points: &[Spot], emitter: usize) -> Vec<Ask> {
        let faces = &self.lamps.emitters[emitter].0;
        let mut asks = Vec::new();
        for (point, &spot) in points.iter().enumerate() {
            let (mut free, mut total, mut shares) = ([0.0; 3], 0.0, Vec::with_capacity(faces.len()));
            for face in faces {
                let (at, normal) = (spot.at.as_dvec3(), spot.normal.as_dvec3());
                let factor = point_to_polygon(at, normal, &face.polygon[..face.count]).max(0.0);
                add(&mut free, factor, face.exitance);
                total += (factor * super::mean(face.exitance)) as f32;
                shares.push(total);
            }
            if total > 0.0 {
                asks.push(Ask { point, spot, free, shares, sum: 0.0, seen: 0.0, squares: 0.0, count: 0.0 });
            }
        }
        asks
    }

    /// The part of an emitter's irradiance that arrives: a few rays, and more where they disagree, until the standard error
    /// is what all rays would leave at worst. Averaged visibility varies less, and needs fewer.
    fn see(&self, asks: &mut [Ask], emitter: usize, sight: &Sight, scratch: &mut Scratch) {
        let tolerance = 0.5 / (self.light_rays as f64).sqrt();
        let mut left: Vec<usize> = (0..asks.len()).collect();
        for first in (0..self.light_rays).step_by(LANES) {
            let (questions, weights): (Vec<Question>, Vec<[f32; LANES]>) =
                left.iter().map(|&k| self.question(&asks[k], emitter, first)).unzip();
            sight.ask(&questions, scratch, |k, through| {
                asks[left[k]].add(&questions[k].packet, &weights[k], through);
            });
            left.retain(|&k| {
                // Where all rays so far went below the horizon nothing is known.
                let open = asks[k].count == 0.0;
                open || first + LANES < PILOT || asks[k].variance() > asks[k].count * tolerance * tolerance
            });
            if left.is_empty() {
                return;
            }
        }
    }

    /// Rays of a point from the `first` on, and what each of them counts.
    fn question(&self, ask: &Ask, emitter: usize, first: usize) -> (Question, [f32; LANES]) {
        let (faces, width) = &self.lamps.emitters[emitter];
        let Spot { at, normal, seed } = ask.spot;
        let [shift_u, shift_v, ..] = numbers(seed ^ emitter as u64, 0);
        let total = *ask.shares.last().expect("emitters have faces");
        let mut packet = Packet::EMPTY;
        let mut weights = [0.0f32; LANES];
        for (lane, (weight, [u, v])) in weights.iter_mut().zip(&self.table[first..]).enumerate() {
            let (u, v) = ((u + shift_u).fract(), (v + shift_v).fract());
            let target = u * total;
            let f = ask.shares.partition_point(|&s| s <= target).min(faces.len() - 1);
            let before = if f > 0 { ask.shares[f - 1] } else { 0.0 };
            let share = ask.shares[f] - before;
            let face: &Face = &faces[f];
            let y = point_on(&face.corners, ((target - before) / share).clamp(0.0, 1.0), v);
            let d = y - at;
            let r2 = d.length_squared().max(f32::MIN_POSITIVE);
            let kernel = (normal.dot(d).max(0.0) / r2) * ((-face.normal.dot(d)).max(0.0) / r2);
            *weight = kernel * face.area * super::mean(face.exitance) as f32 / share;
            if *weight > 0.0 {
                packet.set(lane, at, y, self.solver.ends);
            }
        }
        (Question { packet, emitter_size: *width, feature_size: self.feature_size }, weights)
    }
}

/// A point that faces an emitter, and what its rays have found so far.
struct Ask {
    point: usize,
    spot: Spot,
    /// Irradiance if nothing stood between.
    free: Rgb,
    /// Running sums of the faces' parts of it.
    shares: Vec<f32>,
    /// Of weights, weights times transmittances, and times their squares.
    sum: f64,
    seen: f64,
    squares: f64,
    /// Rays.
    count: f64,
}

impl Ask {
    fn add(&mut self, packet: &Packet, weights: &[f32; LANES], through: &[f32; LANES]) {
        for lane in packet.lanes() {
            self.sum += f64::from(weights[lane]);
            self.seen += f64::from(weights[lane] * through[lane]);
            self.squares += f64::from(weights[lane] * through[lane] * through[lane]);
        }
        self.count += packet.len() as f64;
    }

    /// Of one ray's transmittance.
    fn variance(&self) -> f64 {
        if self.sum > 0.0 { (self.squares / self.sum - (self.seen / self.sum).powi(2)).max(0.0) } else { 0.0 }
    }
}
