//! Irradiance at points: light of emitters by Lambert's formula and shadow rays, light of surfaces by a final gather.

use super::Solver;
use super::field::{Rgb, add};
use crate::element::{Elements, Lookup, Shape};
use crate::embree::{CommittedScene, Hits, Traversal};
use crate::form_factor::point_to_polygon;
use crate::link::{Question, Scratch, Tally, cosine_direction, mix, numbers, point_on};
use crate::ray::{LANES, Packet};
use crate::scene::Scene;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use sobol_burley::sample;

/// A surface of an emitter.
struct Face {
    corners: [Vec3; 4],
    polygon: [DVec3; 4],
    count: usize,
    normal: Vec3,
    exitance: Rgb,
    area: f32,
}

/// What points receive.
pub struct Receiver<'a> {
    solver: &'a Solver<'a>,
    traced: &'a CommittedScene,
    traversal: Traversal,
    lookup: Lookup,
    /// Reflected radiosity by element.
    reflected: Vec<[f32; 3]>,
    /// By emitter, its lit faces.
    emitters: Vec<(Vec<Face>, f32)>,
    /// Every lit face, as emitter and face, and the running sums of their power.
    lit: Vec<(u32, u32)>,
    powers: Vec<f32>,
    /// Low-discrepancy numbers for shadow rays.
    table: Vec<[f32; 2]>,
    /// Bounces that are followed before an element's light is taken: in scenes with clusters the first things met are not
    /// taken at their word, since what lies in clusters knows its light on average only.
    bounces: u64,
    light_rays: usize,
    /// Directions about +z for the final gather, blocks of 4 by 4 neighbours together; several sets that points choose
    /// from, none for direct light only.
    hemispheres: Vec<Vec<Vec3>>,
    feature_size: f32,
    magnitude: f32,
    length: f32,
}

/// Buffers of a thread.
#[derive(Default)]
struct Buffers {
    scratch: Scratch,
    packets: Vec<Packet>,
    hits: Vec<Hits>,
    places: Vec<Met>,
    beyond: Vec<Met>,
}

/// Where a ray ended.
#[derive(Clone, Copy)]
struct Met {
    place: Vec3,
    side: u32,
    leaf: u32,
    /// What has become of a unit of its light where it arrives, by channel.
    share: Vec3,
}

impl<'a> Receiver<'a> {
    /// Prepares for points of a scene with a solution.
    pub fn new(
        scene: &Scene,
        solver: &'a Solver<'a>,
        (traced, traversal): (&'a CommittedScene, Traversal),
        options: &super::Options,
    ) -> Receiver<'a> {
        let elements = &solver.elements;
        let mut emitters: Vec<(Vec<Face>, f32)> =
            scene.emitters.iter().map(|e| (Vec::new(), e.min_width)).collect();
        for side in elements.sides.iter().filter(|s| s.exitance.iter().any(|&m| m > 0.0)) {
            let element = &elements.elements[side.element as usize];
            let Shape::Surface { corners, .. } = element.shape else { continue };
            let emitter = scene.triangle_emitter[side.triangles[0] as usize] as usize;
            emitters[emitter].0.push(Face {
                corners,
                polygon: corners.map(|p| p.as_dvec3()),
                count: if corners[2] == corners[3] { 3 } else { 4 },
                normal: side.normal,
                exitance: side.exitance,
                area: element.area as f32,
            });
        }
        let (mut lit, mut powers, mut power) = (Vec::new(), Vec::new(), 0.0);
        for (e, (faces, _)) in (0u32..).zip(&emitters) {
            for (k, face) in (0u32..).zip(faces) {
                power += face.area * super::mean(face.exitance) as f32;
                lit.push((e, k));
                powers.push(power);
            }
        }
        let rows = ((options.gather_rays(elements.large_from > 0) as f64).sqrt() / 4.0).ceil() as usize * 4;
        let sets = if options.direct_only { 0 } else { SETS };
        let hemispheres = (0..sets).map(|k| hemisphere(rows, mix(options.seed ^ k as u64))).collect();
        let table = (0..options.light_rays() as u32)
            .map(|i| [sample(i & 0xffff, 0, 7), sample(i & 0xffff, 1, 7)])
            .collect();
        let reflected = elements.elements.iter().zip(&solver.radiosity).map(|(e, radiosity)| match e.shape {
            Shape::Cluster(_) => [0.0; 3],
            Shape::Surface { side, .. } => {
                let emitted = elements.sides[side as usize].exitance;
                std::array::from_fn(|k| (radiosity[k] - emitted[k]) as f32)
            }
        });
        Receiver {
            lookup: Lookup::new(elements),
            reflected: reflected.collect(),
            solver,
            traced,
            traversal,
            emitters,
            lit,
            powers,
            table,
            bounces: if elements.large_from > 0 { BOUNCES } else { 0 },
            light_rays: options.light_rays(),
            hemispheres,
            feature_size: options.feature_size.unwrap_or(1e-2 * scene.bounds.diagonal()),
            magnitude: crate::visibility::reference::magnitude(scene),
            length: 1.01 * scene.bounds.diagonal(),
        }
    }

    /// Irradiance at points (scene units relative to the scene's origin, unit normals), in their order, and how
    /// visibility was answered.
    pub fn irradiance(&self, points: &[(Vec3, Vec3)]) -> (Vec<Rgb>, Tally) {
        let made: Vec<(Vec<Rgb>, Tally)> = points
            .par_chunks(64)
            .enumerate()
            .map_init(Buffers::default, |buffers, (chunk, points)| {
                buffers.scratch.tally = Tally::default();
                let values = points
                    .iter()
                    .enumerate()
                    .map(|(i, &(at, normal))| {
                        let seed = mix(self.solver.seed ^ (64 * chunk + i) as u64);
                        let mut sum = self.direct(at, normal, seed, buffers);
                        if !self.hemispheres.is_empty() {
                            add(&mut sum, 1.0, self.gathered(at, normal, seed, buffers));
                        }
                        sum
                    })
                    .collect();
                (values, buffers.scratch.tally)
            })
            .collect();
        let (mut values, mut tally) = (Vec::with_capacity(points.len()), Tally::default());
        for (part, counts) in made {
            values.extend(part);
            tally.add(counts);
        }
        (values, tally)
    }

    /// What emitters send directly.
    fn direct(&self, at: Vec3, normal: Vec3, seed: u64, buffers: &mut Buffers) -> Rgb {
        let mut sum = [0.0; 3];
        let place = (at.as_dvec3(), normal.as_dvec3());
        let mut shares: Vec<f32> = Vec::new();
        for (e, (faces, width)) in self.emitters.iter().enumerate() {
            let mut free = [0.0; 3];
            shares.clear();
            let mut total = 0.0;
            for face in faces {
                let factor = point_to_polygon(place.0, place.1, &face.polygon[..face.count]).max(0.0);
                add(&mut free, factor, face.exitance);
                total += (factor * super::mean(face.exitance)) as f32;
                shares.push(total);
            }
            if total > 0.0 {
                let ask = Ask { at, normal, faces, shares: &shares, width: *width, seed: seed ^ e as u64 };
                add(&mut sum, self.visible(ask, buffers), free);
            }
        }
        sum
    }

    /// The part of an emitter's irradiance that arrives: a few rays, and more where they disagree, until the standard error
    /// is what all rays would leave at worst. Averaged visibility varies less, and needs fewer.
    fn visible(&self, ask: Ask, buffers: &mut Buffers) -> f64 {
        let [shift_u, shift_v, ..] = numbers(ask.seed, 0);
        let total = *ask.shares.last().expect("emitters have faces");
        let (mut sum, mut seen, mut squares, mut count) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
        // What the standard error is at most where all rays are asked.
        let tolerance = 0.5 / (self.light_rays as f64).sqrt();
        for first in (0..self.light_rays).step_by(LANES) {
            let mut packet = Packet::EMPTY;
            let mut weights = [0.0f32; LANES];
            for (lane, (weight, [u, v])) in weights.iter_mut().zip(&self.table[first..]).enumerate() {
                let (u, v) = ((u + shift_u).fract(), (v + shift_v).fract());
                let target = u * total;
                let f = ask.shares.partition_point(|&s| s <= target).min(ask.faces.len() - 1);
                let before = if f > 0 { ask.shares[f - 1] } else { 0.0 };
                let share = ask.shares[f] - before;
                let face = &ask.faces[f];
                let y = point_on(&face.corners, ((target - before) / share).clamp(0.0, 1.0), v);
                let d = y - ask.at;
                let r2 = d.length_squared().max(f32::MIN_POSITIVE);
                let kernel = ask.normal.dot(d).max(0.0) * (-face.normal.dot(d)).max(0.0) / (r2 * r2);
                *weight = kernel * face.area * super::mean(face.exitance) as f32 / share;
                if *weight > 0.0 {
                    packet.set(lane, ask.at, y, self.solver.ends);
                }
            }
            if packet.is_empty() {
                continue;
            }
            let question = Question { packet, emitter_size: ask.width, feature_size: self.feature_size };
            let through = self.solver.sight.transmittances(&question, &mut buffers.scratch);
            let packet = question.packet;
            for lane in packet.lanes() {
                sum += f64::from(weights[lane]);
                seen += f64::from(weights[lane] * through[lane]);
                squares += f64::from(weights[lane] * through[lane] * through[lane]);
            }
            count += packet.len() as f64;
            let mean = seen / sum;
            let variance = (squares / sum - mean * mean).max(0.0);
            if first + LANES >= PILOT && variance <= count * tolerance * tolerance {
                break;
            }
        }
        if sum > 0.0 { seen / sum } else { 1.0 }
    }

    /// What surfaces reflect: one ray in each cell of a hemisphere of equal cosine weight.
    fn gathered(&self, at: Vec3, normal: Vec3, seed: u64, buffers: &mut Buffers) -> Rgb {
        let Buffers { packets, hits, places, .. } = buffers;
        let from = at + 2e-6 * self.magnitude * normal;
        let (x, y) = normal.any_orthonormal_pair();
        let [turn, ..] = numbers(seed, 1);
        let (sin, cos) = (std::f32::consts::TAU * turn).sin_cos();
        let (x, y) = (self.length * (cos * x + sin * y), self.length * (cos * y - sin * x));
        let z = self.length * normal;
        let directions = &self.hemispheres[(seed % SETS as u64) as usize];
        packets.resize(directions.len() / LANES, Packet::EMPTY);
        for (packet, directions) in packets.iter_mut().zip(directions.chunks_exact(LANES)) {
            for (lane, d) in directions.iter().enumerate() {
                let to = d.x * x + d.y * y + d.z * z;
                for axis in 0..3 {
                    packet.origin[axis][lane] = from[axis];
                    packet.direction[axis][lane] = to[axis];
                }
            }
            (packet.near, packet.far, packet.active) = ([0.0; LANES], [1.0; LANES], 0xffff);
        }
        hits.clear();
        hits.resize(packets.len(), Hits::NONE);
        self.traced.first_hits(self.traversal, packets, hits);
        let mut sum = [0.0; 3];
        places.clear();
        for (packet, hits) in packets.iter().zip(hits.iter()) {
            // Sixteen terms in f32, then f64.
            let mut part = Vec3::ZERO;
            for lane in 0..LANES {
                let Some(met) = self.met(packet, hits, lane) else { continue };
                if self.bounces > 0 {
                    places.push(met);
                } else {
                    part += Vec3::from(self.reflected[met.leaf as usize]);
                }
            }
            add(&mut sum, 1.0, part.to_array().map(f64::from));
        }
        self.continued(seed, &mut sum, buffers);
        let Buffers { scratch, .. } = buffers;
        let rays = directions.len() as u64;
        scratch.tally.segments += rays;
        scratch.tally.exact_rays += rays;
        sum.map(|s| s / rays as f64)
    }
}

/// Shadow rays before others are left out.
const PILOT: usize = 2 * LANES;
/// Sets of directions.
const SETS: usize = 64;

/// Directions about +z with the density cos/π: one in each cell of a grid of `rows` by `rows`.
fn hemisphere(rows: usize, seed: u64) -> Vec<Vec3> {
    let blocks = rows / 4;
    (0..rows * rows)
        .map(|k| {
            let (block, lane) = (k / LANES, k % LANES);
            let (i, j) = (block % blocks * 4 + lane % 4, block / blocks * 4 + lane / 4);
            let [r, s, ..] = numbers(seed, k as u64);
            cosine_direction(Vec3::Z, (i as f32 + r) / rows as f32, (j as f32 + s) / rows as f32)
        })
        .collect()
}

/// See [`Receiver::bounces`].
const BOUNCES: u64 = 3;

impl Receiver<'_> {
    fn met(&self, packet: &Packet, hits: &Hits, lane: usize) -> Option<Met> {
        let triangle = hits.triangle[lane];
        if triangle == Hits::NOTHING {
            return None;
        }
        let (from, place) = (packet.point(lane, 0.0), packet.point(lane, hits.t[lane]));
        let side = self.solver.elements.met(triangle, place - from);
        if side == Elements::NONE {
            return None;
        }
        let leaf = self.lookup.leaf(side, place);
        Some(Met { place, side, leaf, share: Vec3::ONE })
    }

    /// Adds what the places met reflect: the light of one emitter through one shadow ray, and of what one more ray meets,
    /// which is followed further in turn.
    fn continued(&self, seed: u64, sum: &mut Rgb, buffers: &mut Buffers) {
        for bounce in (0..self.bounces).rev() {
            if buffers.places.is_empty() {
                return;
            }
            self.bounce(mix(seed ^ bounce), bounce == 0, sum, buffers);
        }
    }

    /// One more ray and a shadow ray from each place, which are replaced by those beyond unless this is the last.
    fn bounce(&self, seed: u64, last: bool, sum: &mut Rgb, buffers: &mut Buffers) {
        let Buffers { packets, hits, places, beyond: further, scratch } = buffers;
        further.clear();
        let elements = &self.solver.elements;
        packets.clear();
        for (i, met) in places.iter().enumerate() {
            if i % LANES == 0 {
                packets.push(Packet::EMPTY);
            }
            let [u, v, ..] = numbers(seed, 2 + i as u64);
            let normal = elements.sides[met.side as usize].normal;
            let from = met.place + 2e-6 * self.magnitude * normal;
            let to = from + self.length * cosine_direction(normal, u, v);
            let (packet, lane) = (&mut packets[i / LANES], i % LANES);
            packet.set(lane, from, to, self.solver.ends);
            packet.near[lane] = 0.0;
        }
        hits.clear();
        hits.resize(packets.len(), Hits::NONE);
        self.traced.first_hits(self.traversal, packets, hits);
        scratch.tally.segments += places.len() as u64;
        scratch.tally.exact_rays += places.len() as u64;
        for (g, (group, (packet, hits))) in
            places.chunks(LANES).zip(packets.iter().zip(hits.iter())).enumerate()
        {
            let mut shadow = Packet::EMPTY;
            let mut light = [[0.0f32; 3]; LANES];
            for (lane, met) in group.iter().enumerate() {
                let reflectance = met.share * Vec3::from(elements.sides[met.side as usize].reflectance);
                if let Some(beyond) = self.met(packet, hits, lane) {
                    let mut received = Vec3::ZERO;
                    if last {
                        received = Vec3::from(self.reflected[beyond.leaf as usize]);
                    } else {
                        further.push(Met { share: reflectance, ..beyond });
                    }
                    let from = &elements.sides[beyond.side as usize];
                    if from.exitance.iter().any(|&m| m > 0.0) {
                        let q = self.ratio(met, beyond.place, from.normal, from.exitance);
                        received += q / (1.0 + q) * Vec3::from(from.exitance.map(|m| m as f32));
                    }
                    add(sum, 1.0, (reflectance * received).to_array().map(f64::from));
                }
                let [.., u, v] = numbers(seed, 2 + (g * LANES + lane) as u64);
                if let Some((from, face)) = self.on_emitter(u, v) {
                    let q = self.ratio(met, from, face.normal, face.exitance);
                    if q > 0.0 {
                        shadow.set(lane, met.place, from, self.solver.ends);
                        let arriving = q / (1.0 + q) * Vec3::from(face.exitance.map(|m| m as f32));
                        light[lane] = (reflectance * arriving).to_array();
                    }
                }
            }
            if shadow.is_empty() {
                continue;
            }
            let width = self.emitters.iter().map(|(_, w)| *w).fold(f32::MAX, f32::min);
            let question = Question { packet: shadow, emitter_size: width, feature_size: self.feature_size };
            let through = self.solver.sight.scattered().transmittances(&question, scratch);
            for lane in question.packet.lanes() {
                add(sum, f64::from(through[lane]), light[lane].map(f64::from));
            }
        }
        std::mem::swap(places, further);
    }

    /// A point on an emitter by two numbers in `[0, 1)`; faces are chosen by their power.
    fn on_emitter(&self, u: f32, v: f32) -> Option<(Vec3, &Face)> {
        let target = u * *self.powers.last()?;
        let f = self.powers.partition_point(|&p| p <= target).min(self.powers.len() - 1);
        let before = if f > 0 { self.powers[f - 1] } else { 0.0 };
        let (e, k) = self.lit[f];
        let face = &self.emitters[e as usize].0[k as usize];
        let u = ((target - before) / (self.powers[f] - before)).clamp(0.0, 1.0);
        Some((point_on(&face.corners, u, v), face))
    }

    /// Density with which a cosine-weighted ray from a place finds a point of an emitter, over the density of
    /// [`Receiver::on_emitter`]. Both find it; weighted by their densities (the balance heuristic of Veach and Guibas
    /// 1995) each contributes less than the emitter's exitance, however near it is.
    fn ratio(&self, met: &Met, at: Vec3, normal: Vec3, exitance: Rgb) -> f32 {
        let d = at - met.place;
        let r2 = d.length_squared().max(f32::MIN_POSITIVE);
        let own = self.solver.elements.sides[met.side as usize].normal;
        let kernel = own.dot(d).max(0.0) * (-normal.dot(d)).max(0.0) / (std::f32::consts::PI * r2 * r2);
        kernel * self.powers.last().copied().unwrap_or(0.0) / super::mean(exitance) as f32
    }
}

/// A point and the faces of an emitter, with running sums of their unoccluded irradiance.
struct Ask<'a> {
    at: Vec3,
    normal: Vec3,
    faces: &'a [Face],
    shares: &'a [f32],
    width: f32,
    seed: u64,
}
