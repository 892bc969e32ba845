//! Irradiance at points: light of emitters by Lambert's formula and shadow rays, light of surfaces by a final gather.

use super::Solver;
use super::field::{Rgb, add};
use crate::element::Shape;
use crate::embree::{CommittedScene, Hits, Traversal};
use crate::form_factor::point_to_polygon;
use crate::link::{Scratch, Tally, cosine_direction, mix, numbers, point_on};
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
    /// By emitter, its lit faces.
    emitters: Vec<(Vec<Face>, f32)>,
    /// Low-discrepancy numbers for shadow rays.
    table: Vec<[f32; 2]>,
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
        let rows = ((options.gather_rays as f64).sqrt() / 4.0).ceil() as usize * 4;
        let sets = if options.direct_only { 0 } else { SETS };
        let hemispheres = (0..sets).map(|k| hemisphere(rows, mix(options.seed ^ k as u64))).collect();
        let table = (0..options.light_rays as u32)
            .map(|i| [sample(i & 0xffff, 0, 7), sample(i & 0xffff, 1, 7)])
            .collect();
        Receiver {
            solver,
            traced,
            traversal,
            emitters,
            table,
            light_rays: options.light_rays,
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

    /// The part of an emitter's irradiance that arrives: sixteen rays, and all where they disagree.
    fn visible(&self, ask: Ask, buffers: &mut Buffers) -> f64 {
        let [shift_u, shift_v, ..] = numbers(ask.seed, 0);
        let total = *ask.shares.last().expect("emitters have faces");
        let (mut sum, mut seen) = (0.0f64, 0.0f64);
        for first in (0..self.light_rays).step_by(LANES) {
            let mut packet = Packet::EMPTY;
            let mut weights = [0.0f32; LANES];
            for lane in 0..LANES.min(self.light_rays - first) {
                let [u, v] = self.table[first + lane];
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
                weights[lane] = kernel * face.area * super::mean(face.exitance) as f32 / share;
                if weights[lane] > 0.0 {
                    packet.set(lane, ask.at, y, self.solver.ends);
                }
            }
            if packet.is_empty() {
                continue;
            }
            let through =
                self.solver.sight.transmittances(&packet, ask.width, self.feature_size, &mut buffers.scratch);
            let before = sum;
            for lane in packet.lanes() {
                sum += f64::from(weights[lane]);
                seen += f64::from(weights[lane] * through[lane]);
            }
            let all = |value: f32| packet.lanes().all(|l| through[l] == value);
            if before == 0.0 && (all(0.0) || all(1.0)) {
                break;
            }
        }
        if sum > 0.0 { seen / sum } else { 1.0 }
    }

    /// What surfaces reflect: one ray in each cell of a hemisphere of equal cosine weight.
    fn gathered(&self, at: Vec3, normal: Vec3, seed: u64, buffers: &mut Buffers) -> Rgb {
        let Buffers { packets, hits, scratch } = buffers;
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
        let (elements, outgoing) = (&self.solver.elements, &self.solver.outgoing);
        let mut sum = [0.0; 3];
        for (packet, hits) in packets.iter().zip(hits.iter()) {
            for lane in 0..LANES {
                if hits.triangle[lane] == Hits::NOTHING {
                    continue;
                }
                let met = packet.point(lane, hits.t[lane]);
                let side = elements.met(hits.triangle[lane], met - from);
                if let Some(s) = elements.sides.get(side as usize) {
                    let leaf = elements.leaf_at(side, met) as usize;
                    add(&mut sum, 1.0, outgoing.radiosity[leaf]);
                    add(&mut sum, -1.0, s.exitance);
                }
            }
        }
        let rays = directions.len() as u64;
        scratch.tally.segments += rays;
        scratch.tally.exact_rays += rays;
        sum.map(|s| s / rays as f64)
    }
}

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

/// A point and the faces of an emitter, with running sums of their unoccluded irradiance.
struct Ask<'a> {
    at: Vec3,
    normal: Vec3,
    faces: &'a [Face],
    shares: &'a [f32],
    width: f32,
    seed: u64,
}
