//! Paths from one point, advanced bounce by bounce so that rays form Embree packets.

use super::light::PowerSampler;
use super::surfaces::{SurfaceHit, Surfaces};
use super::{Estimate, Settings};
use crate::embree::Hits;
use crate::math::sampling::mix;
use crate::points::Point;
use crate::ray::{LANES, Packet};
use crate::sky::Environment;
use glam::{DVec3, Vec3};
use sobol_burley::sample_4d;
use std::f32::consts::PI;

/// Number of independent groups of samples; the standard error is estimated from their spread. Samples inside a group
/// are stratified (Owen 1997), so their own spread would overestimate the error.
const GROUPS: u32 = 8;
/// Number of paths advanced together: limits the buffers of a thread to 2 × 512 paths of 40 bytes. Affects only the rounding of sums.
const BATCH_PATHS: u32 = 512;
/// Number of bounces without Russian roulette: affects noise and time, not the mean (Arvo and Kirk 1990).
const MIN_BOUNCES: u32 = 3;
/// Length of the sample sequence; longer runs repeat the sequence with another seed.
const SEQUENCE_SAMPLES: u32 = 1 << 16;

/// A path at its current vertex.
struct Path {
    position: Vec3,
    /// Its distance from its surface, scene units.
    skin: f32,
    normal: Vec3,
    throughput: [f32; 3],
    sample: u32,
}

/// Path tracer of one thread; keeps its buffers from point to point.
pub struct Paths<'a> {
    surfaces: &'a Surfaces<'a>,
    lights: Option<&'a PowerSampler>,
    sky: Option<&'a Environment>,
    settings: Settings,
    active: Vec<Path>,
    next: Vec<Path>,
    sums: [[f64; 3]; GROUPS as usize],
}

impl<'a> Paths<'a> {
    pub fn new(
        surfaces: &'a Surfaces<'a>,
        lights: Option<&'a PowerSampler>,
        sky: Option<&'a Environment>,
        settings: Settings,
    ) -> Paths<'a> {
        Paths {
            surfaces,
            lights,
            sky,
            settings,
            active: Vec::new(),
            next: Vec::new(),
            sums: Default::default(),
        }
    }

    /// Irradiance at one point; `number` is its index in the list of points.
    pub fn estimate(&mut self, number: u64, point: &Point) -> Estimate {
        if self.lights.is_none() && self.sky.is_none() {
            return Estimate { mean: [0.0; 3], standard_error: [0.0; 3] };
        }
        self.sums = Default::default();
        let normal = point.normal.as_vec3();
        let (start, skin) = self.surfaces.start(self.surfaces.local(point.position), normal);
        let stream = mix(self.settings.seed ^ mix(number));
        let total = self.settings.samples;
        for first in (0..total).step_by(BATCH_PATHS as usize) {
            self.active.clear();
            self.active.extend((first..total.min(first.saturating_add(BATCH_PATHS))).map(|sample| Path {
                position: start,
                skin,
                normal,
                // Irradiance is π times the mean radiance over cosine-distributed directions.
                throughput: [PI; 3],
                sample,
            }));
            let mut bounce = 0;
            while !self.active.is_empty() {
                self.step(stream, bounce);
                std::mem::swap(&mut self.active, &mut self.next);
                bounce += 1;
            }
        }
        self.summary()
    }

    /// Advances all active paths by one bounce; continued paths are in `next`.
    fn step(&mut self, stream: u64, bounce: u32) {
        self.next.clear();
        self.add_sky(stream, bounce);
        for chunk in self.active.chunks(LANES) {
            let mut shadow = Packet::EMPTY;
            let mut rays = Packet::EMPTY;
            let mut direct = [[0f32; 3]; LANES];
            let mut roulette = [0f32; LANES];
            let mut directions = [Vec3::ZERO; LANES];
            for (lane, path) in chunk.iter().enumerate() {
                let (u, v) = numbers(stream, bounce, path.sample);
                let on_surface = path.position - path.skin * path.normal;
                let sample = self.lights.and_then(|lights| lights.sample(on_surface, [u[2], u[3], v[0]]));
                if let Some(emitter_sample) = sample {
                    let chance = path.normal.dot(emitter_sample.direction) / PI;
                    if chance > 0.0 {
                        // Balance heuristic with the sampled direction, which can hit the same emitter.
                        let share = chance / (chance + emitter_sample.density);
                        direct[lane] = product(path.throughput, emitter_sample.radiance).map(|x| x * share);
                        // A ray is most exact at its start: the end with the smaller coordinates.
                        let mut ends = [path.position, emitter_sample.end];
                        if emitter_sample.skin < path.skin {
                            ends.reverse();
                        }
                        shadow.set_between(lane, ends[0], ends[1], [0.0, 1.0]);
                    }
                }
                directions[lane] = cosine_direction(path.normal, u[0], u[1]);
                roulette[lane] = v[1];
                rays.set_ray(lane, path.position, directions[lane]);
            }
            let mut blocked = [0];
            self.surfaces.blocked(std::slice::from_ref(&shadow), &mut blocked);
            let mut hits = Hits::NONE;
            self.surfaces.intersect(std::slice::from_ref(&rays), std::slice::from_mut(&mut hits));
            for (lane, path) in chunk.iter().enumerate() {
                let sum = &mut self.sums[(path.sample % GROUPS) as usize];
                if (shadow.active & !blocked[0]) >> lane & 1 == 1 {
                    add(sum, direct[lane]);
                }
                let direction = directions[lane];
                if let Some(sky) = self.sky.filter(|_| hits.triangle[lane] == Hits::NO_HIT) {
                    let far = direction.as_dvec3();
                    let chance = f64::from(path.normal.dot(direction) / PI);
                    let share = if sky.sky().is_some() { chance / (chance + sky.pdf(far)) } else { 1.0 };
                    add(sum, product(path.throughput, sky.radiance(far).map(|l| (l * share) as f32)));
                }
                let Some(place) = self.surfaces.place(&rays, &hits, lane, direction) else { continue };
                if place.emission != [0.0; 3]
                    && let Some(lights) = self.lights
                    && let Some(cosine) = lights.facing(place.cosine, place.profile.is_some())
                {
                    let chance = path.normal.dot(direction) / PI;
                    let density = lights.density(place.emission, hits.t[lane], cosine);
                    let share = chance / (chance + density);
                    let gain = place.profile.map_or(1.0, |p| p.gain(-direction, cosine));
                    add(sum, product(path.throughput, place.emission).map(|x| x * share * gain));
                }
                if self.settings.direct_only {
                    continue;
                }
                let mut throughput = product(path.throughput, place.reflectance);
                let brightest = throughput.into_iter().fold(0.0, f32::max);
                let survival = if bounce < MIN_BOUNCES { 1.0 } else { (brightest / PI).min(1.0) };
                if brightest == 0.0 || roulette[lane] >= survival {
                    continue;
                }
                throughput = throughput.map(|x| x / survival);
                let Path { sample, .. } = *path;
                let SurfaceHit { position, skin, normal, .. } = place;
                self.next.push(Path { position, skin, normal, throughput, sample });
            }
        }
    }

    /// Adds the light that arrives at the vertices of all active paths from a point of each sun, and from a direction of the sky that is
    /// drawn in proportion to radiance.
    fn add_sky(&mut self, stream: u64, bounce: u32) {
        let Some(sky) = self.sky else { return };
        for (number, sun) in sky.suns().iter().enumerate() {
            let full = sun.radiance().map(|l| l * sun.solid_angle());
            self.add_directions(!stream ^ number as u64, bounce, |normal, place| {
                let direction = sun.sample(place);
                // The throughput holds π.
                let share = direction.dot(normal) / f64::from(PI);
                (direction, full.map(|l| l * share))
            });
        }
        if sky.sky().is_some() {
            self.add_directions(stream ^ 0x5bd1_e995, bounce, |normal, place| {
                let drawn = sky.sample(place);
                // The balance heuristic with the cosine-distributed ray.
                let chance = drawn.direction.dot(normal) / f64::from(PI);
                (drawn.direction, drawn.radiance.map(|l| l * chance / (chance + drawn.pdf)))
            });
        }
    }

    /// Adds the light of one direction from each vertex of the active paths: `draw` gives it, and its radiance over the density of the
    /// direction times the cosine over π, for a normal and a place in the unit square.
    fn add_directions(
        &mut self,
        stream: u64,
        bounce: u32,
        draw: impl Fn(DVec3, [f64; 2]) -> (DVec3, [f64; 3]),
    ) {
        for chunk in self.active.chunks(LANES) {
            let (mut shadow, mut light) = (Packet::EMPTY, [[0f32; 3]; LANES]);
            for (lane, path) in chunk.iter().enumerate() {
                let ([.., s, t], _) = numbers(stream, bounce, path.sample);
                let normal = path.normal.as_dvec3();
                let (direction, radiance) = draw(normal, [s.into(), t.into()]);
                if direction.dot(normal) > 0.0 {
                    light[lane] = product(path.throughput, radiance.map(|l| l as f32));
                    shadow.set_ray(lane, path.position, direction.as_vec3());
                }
            }
            let mut blocked = [0];
            self.surfaces.blocked(std::slice::from_ref(&shadow), &mut blocked);
            for (lane, path) in chunk.iter().enumerate() {
                if (shadow.active & !blocked[0]) >> lane & 1 == 1 {
                    add(&mut self.sums[(path.sample % GROUPS) as usize], light[lane]);
                }
            }
        }
    }

    /// Mean over all samples, and its standard error from the spread of the groups.
    fn summary(&self) -> Estimate {
        let total = self.settings.samples;
        let groups = GROUPS.min(total);
        let mut mean = [0.0; 3];
        let mut standard_error = [0.0; 3];
        for c in 0..3 {
            mean[c] = self.sums.iter().map(|s| s[c]).sum::<f64>() / f64::from(total);
            let spread: f64 = (0..groups)
                .map(|g| {
                    let size = total / groups + u32::from(g < total % groups);
                    (self.sums[g as usize][c] / f64::from(size) - mean[c]).powi(2)
                })
                .sum();
            standard_error[c] = (spread / f64::from(groups * (groups - 1))).sqrt();
        }
        Estimate { mean, standard_error }
    }
}

/// Random numbers in `[0, 1)` for one bounce of one sample: two for the direction, three for the emitter, one for Russian roulette.
fn numbers(stream: u64, bounce: u32, sample: u32) -> ([f32; 4], [f32; 4]) {
    let (group, index) = (sample % GROUPS, sample / GROUPS);
    let seed =
        stream ^ u64::from(group) << 32 ^ u64::from(index / SEQUENCE_SAMPLES) << 40 ^ u64::from(bounce);
    let seed = mix(seed) as u32;
    (sample_4d(index % SEQUENCE_SAMPLES, 0, seed), sample_4d(index % SEQUENCE_SAMPLES, 1, seed))
}

/// A direction around `normal` with density cos θ / π (Malley: a point on the disc, projected to the hemisphere).
fn cosine_direction(normal: Vec3, u: f32, v: f32) -> Vec3 {
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    let r = u.sqrt();
    let (x, y) = normal.any_orthonormal_pair();
    (x * (r * cos) + y * (r * sin) + normal * (1.0 - u).sqrt()).normalize()
}

fn product(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| a[c] * b[c])
}

fn add(sum: &mut [f64; 3], x: [f32; 3]) {
    sum.iter_mut().zip(x).for_each(|(s, x)| *s += f64::from(x));
}
