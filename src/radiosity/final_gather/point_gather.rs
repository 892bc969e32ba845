//! Irradiance at points: light of emitters by Lambert's formula and shadow rays, light of surfaces by a final gather.

use crate::radiosity::deadline::Deadline;
use crate::radiosity::final_gather::direct_light::Spot;
use crate::radiosity::transport::gather_push_pull::{Rgb, add};
use crate::radiosity::elements::emitters::Emitters;
use crate::radiosity::final_gather::paths::{Found, Place};
use crate::radiosity::{Options, Solver};
use crate::embree::{CommittedScene, Hits, Traversal};
use crate::radiosity::elements::{Lookup, Shape};
use crate::radiosity::links::{Scratch, Tally, cosine_direction, mix, numbers};
use crate::ray::{LANES, Packet};
use crate::scene::Scene;
use glam::Vec3;
use rayon::prelude::*;
use sobol_burley::sample;
use std::time::Instant;

/// Points that are asked for together.
pub(in crate::radiosity) const CHUNK: usize = 64;

/// What points receive.
pub struct FinalGather<'a> {
    pub(in crate::radiosity) solver: &'a Solver,
    pub(in crate::radiosity) traced: &'a CommittedScene,
    pub(in crate::radiosity) traversal: Traversal,
    pub(in crate::radiosity) lookup: Lookup,
    pub(in crate::radiosity) emitters: Emitters,
    /// Reflected radiosity by element.
    pub(in crate::radiosity) reflected: Vec<[f32; 3]>,
    /// By element, from which distance it is taken at its word; 0 in scenes without clusters, where elements are as small
    /// as their light asks for.
    pub(in crate::radiosity) sizes: Vec<f32>,
    /// Low-discrepancy numbers for shadow rays.
    pub(in crate::radiosity) table: Vec<[f32; 2]>,
    pub(in crate::radiosity) light_rays: usize,
    /// Directions about +z for the final gather, blocks of 4 by 4 neighbours together; several sets that points choose
    /// from, none for direct light only.
    hemispheres: Vec<Vec<Vec3>>,
    /// How far off their surface given points are taken to lie: files round them, and sheets lie on desks.
    pub(in crate::radiosity) slack: f32,
    pub(in crate::radiosity) feature_size: f32,
    pub(in crate::radiosity) magnitude: f32,
    /// Of rays: more than the scene's diagonal.
    pub(in crate::radiosity) length: f32,
}

/// Buffers of a thread.
#[derive(Default)]
pub(in crate::radiosity) struct Buffers {
    pub scratch: Scratch,
    pub packets: Vec<Packet>,
    pub hits: Vec<Hits>,
    pub places: Vec<Place>,
    pub beyond: Vec<Place>,
    pub found: Vec<Found>,
}

impl<'a> FinalGather<'a> {
    /// Prepares for points of a scene with a solution.
    pub fn new(
        scene: &Scene,
        solver: &'a Solver,
        (traced, traversal): (&'a CommittedScene, Traversal),
        options: &Options,
    ) -> FinalGather<'a> {
        let elements = &solver.elements;
        let cluttered = elements.large_from > 0;
        let gathered = options.gather_rays();
        let sets = if options.direct_only { 0 } else { SETS };
        let hemispheres = (0..sets).map(|k| hemisphere(gathered, mix(options.seed ^ k as u64))).collect();
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
        FinalGather {
            lookup: Lookup::new(elements),
            reflected: reflected.collect(),
            solver,
            traced,
            traversal,
            emitters: Emitters::new(scene, elements),
            sizes: elements.elements.iter().map(|e| if cluttered { e.radius } else { 0.0 }).collect(),
            table,
            light_rays: options.light_rays(),
            hemispheres,
            slack: 1e-5 * scene.bounds.diagonal() + 1e-6 * crate::visibility::reference::magnitude(scene),
            feature_size: options.feature_size.unwrap_or(1e-2 * scene.bounds.diagonal()),
            magnitude: crate::visibility::reference::magnitude(scene),
            length: 1.01 * scene.bounds.diagonal(),
        }
    }

    /// Irradiance at points (scene units relative to the scene's origin, unit normals), in their order, and how
    /// visibility was answered.
    pub fn irradiance(&self, points: &[(Vec3, Vec3)]) -> (Vec<Rgb>, Tally) {
        let sights = self.sights(points);
        let made: Vec<(Vec<Rgb>, Tally)> = points
            .par_chunks(CHUNK)
            .enumerate()
            .map_init(Buffers::default, |buffers, (chunk, points)| {
                buffers.scratch.tally = Tally::default();
                let seed = |i: usize| mix(self.solver.seed ^ (CHUNK * chunk + i) as u64);
                let points: Vec<Spot> = points
                    .iter()
                    .enumerate()
                    .map(|(i, &(at, normal))| Spot { at: at + self.slack * normal, normal, seed: seed(i) })
                    .collect();
                let mut values = self.direct(&points, &sights, &mut buffers.scratch);
                if !self.hemispheres.is_empty() {
                    for (value, &Spot { at, normal, seed }) in values.iter_mut().zip(&points) {
                        add(value, 1.0, self.gathered(at, normal, seed, buffers));
                    }
                }
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

    /// Options with fewer rays, if there is no time for all of them at these points, by a sample of them; even then each point
    /// has some.
    pub(in crate::radiosity) fn hurried(
        &self,
        points: &[(Vec3, Vec3)],
        options: &Options,
        deadline: &Deadline,
    ) -> Option<Options> {
        let part = self.possible(points, deadline);
        (part < 1.0).then(|| fewer(options, part))
    }

    /// The part of the rays at these points that there is time for, by a sample of them.
    pub(in crate::radiosity) fn possible(&self, points: &[(Vec3, Vec3)], deadline: &Deadline) -> f64 {
        if deadline.late() {
            0.0
        } else if deadline.limited() && points.len() > TIMED {
            let sample: Vec<(Vec3, Vec3)> =
                points.iter().copied().step_by(points.len().div_ceil(TIMED)).collect();
            let start = Instant::now();
            // They are one task; the others are for all threads.
            self.irradiance(&sample);
            let each = start.elapsed().as_secs_f64() / sample.len() as f64;
            deadline.left() * rayon::current_num_threads() as f64 / (each * points.len() as f64)
        } else {
            1.0
        }
    }

    /// A warning if points lie off all surfaces.
    pub(in crate::radiosity) fn far_off(&self, points: &[(Vec3, Vec3)]) -> Option<String> {
        let reach = FAR_OFF * self.length;
        let off: usize = points
            .par_chunks(LANES)
            .map(|points| {
                let mut packet = Packet::EMPTY;
                for (lane, &(at, normal)) in points.iter().enumerate() {
                    for axis in 0..3 {
                        packet.origin[axis][lane] = (at + reach * normal)[axis];
                        packet.direction[axis][lane] = -2.0 * reach * normal[axis];
                    }
                    (packet.near[lane], packet.far[lane]) = (0.0, 1.0);
                    packet.active |= 1 << lane;
                }
                let mut hits = [Hits::NONE];
                self.traced.first_hits(self.traversal, &[packet], &mut hits);
                (0..points.len()).filter(|&lane| hits[0].triangle[lane] == Hits::NOTHING).count()
            })
            .sum();
        (off > 0).then(|| {
            format!(
                "{off} of {} points lie more than {reach:.1e} off every surface along their normals: taken as they are, with what \
                 arrives there",
                points.len()
            )
        })
    }

    /// What surfaces reflect: one ray in each cell of a hemisphere of equal cosine weight.
    fn gathered(&self, at: Vec3, normal: Vec3, seed: u64, buffers: &mut Buffers) -> Rgb {
        let Buffers { packets, hits, places, .. } = buffers;
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
                    packet.origin[axis][lane] = at[axis];
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
                match self.taken(met, self.length * hits.t[lane]) {
                    Ok(reflected) => part += reflected,
                    Err(place) => places.push(place),
                }
            }
            add(&mut sum, 1.0, part.to_array().map(f64::from));
        }
        self.follow(seed, false, &mut sum, buffers);
        let Buffers { scratch, .. } = buffers;
        let rays = directions.len() as u64;
        scratch.tally.segments += rays;
        scratch.tally.exact_rays += rays;
        sum.map(|s| s / rays as f64)
    }
}

/// Points whose rays are timed.
const TIMED: usize = CHUNK / 4;
/// Rays of each kind that are left when there is no time.
const FEWEST: usize = 64;
/// Options with a part of the rays, but some of each kind.
pub(in crate::radiosity) fn fewer(options: &Options, part: f64) -> Options {
    let fewer = |rays: usize| Some(((rays as f64 * part) as usize).clamp(FEWEST.min(rays), rays));
    Options {
        light_rays: fewer(options.light_rays()),
        gather_rays: fewer(options.gather_rays()),
        ..options.clone()
    }
}

/// Distance from surfaces, as part of the scene's diagonal, at which it is told that points are not on them.
const FAR_OFF: f32 = 1e-3;
/// Sets of directions.
const SETS: usize = 64;

/// So many directions about +z or a few more, with the density cos/π: one in each cell of a grid, in blocks of 4 by 4.
fn hemisphere(count: usize, seed: u64) -> Vec<Vec3> {
    let blocks = count.div_ceil(LANES);
    let across = (blocks as f64).sqrt().ceil() as usize;
    let down = blocks.div_ceil(across);
    (0..across * down * LANES)
        .map(|k| {
            let (block, lane) = (k / LANES, k % LANES);
            let (i, j) = (block % across * 4 + lane % 4, block / across * 4 + lane / 4);
            let [r, s, ..] = numbers(seed, k as u64);
            let place =
                |cell: usize, within: f32, blocks: usize| (cell as f32 + within) / (4 * blocks) as f32;
            cosine_direction(Vec3::Z, place(i, r, across), place(j, s, down))
        })
        .collect()
}
