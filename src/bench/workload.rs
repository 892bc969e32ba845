//! The questions of a benchmark: receiver points, the emitters they face, and the segments between them.

use crate::ray::{EndRule, LANES, Packet, gather_neighbours};
use crate::scene::{EmitterSampler, Scene, point_on};
use crate::visibility::reference::end_rule;
use glam::Vec3;
use rayon::prelude::*;
use sobol_burley::sample_4d;

/// A point on a surface and the side that is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Scene units, relative to the scene's origin.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
}

/// A point and an emitter that face each other at least in part.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Index into [`Workload::points`].
    pub point: u32,
    /// Index into [`Scene::emitters`].
    pub emitter: u32,
    /// Smallest width of the emitter across the direction to the point.
    pub emitter_size: f32,
    /// Irradiance of the point from the unoccluded emitter relative to the others', by its centre: the weight in
    /// images.
    pub weight: f32,
}

/// Which segments of a pair share a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Those that end close together: packets are coherent.
    Near,
    /// As drawn: every packet is spread over the whole emitter, and so is every power of two of them.
    Spread,
}

/// Points and pairs of a scene, the same for every engine.
#[derive(Clone, Debug)]
pub struct Workload {
    /// Receiver points, in an order that keeps neighbours together.
    pub points: Vec<Point>,
    /// Pairs in the order of their points.
    pub pairs: Vec<Pair>,
    seed: u64,
    ends: EndRule,
    samplers: Vec<EmitterSampler>,
}

impl Workload {
    /// All pairs between these points and the scene's emitters.
    pub fn new(scene: &Scene, points: Vec<Point>, seed: u64) -> Workload {
        let samplers: Vec<EmitterSampler> =
            scene.emitters.iter().map(|e| EmitterSampler::new(scene, e)).collect();
        let pairs = points
            .par_iter()
            .enumerate()
            .flat_map_iter(|(p, point)| {
                samplers.iter().enumerate().filter_map(move |(e, s)| {
                    s.size_and_weight(point.position, point.normal).map(|(emitter_size, weight)| Pair {
                        point: p as u32,
                        emitter: e as u32,
                        emitter_size,
                        weight,
                    })
                })
            })
            .collect();
        Workload { points, pairs, seed, ends: end_rule(scene), samplers }
    }

    /// Appends `rays` segments of a pair to `packets`, sixteen a packet.
    ///
    /// The segments of a smaller number are among those of a larger one. `stream` separates independent sample sets
    /// of the same pair: engines under test share stream 0, references use others.
    pub fn add_bundle(
        &self,
        scene: &Scene,
        pair: usize,
        (rays, order): (usize, Order),
        stream: u64,
        packets: &mut Vec<Packet>,
    ) {
        self.each_segment(scene, pair, (rays, order), stream, |i, a, b| {
            if i % LANES == 0 {
                packets.push(Packet::EMPTY);
            }
            packets.last_mut().expect("just pushed").set(i % LANES, a, b, self.ends);
        });
    }

    /// Points whose convex hull holds the emitter of a pair.
    pub fn hull(&self, pair: usize) -> &[Vec3] {
        self.samplers[self.pairs[pair].emitter as usize].hull()
    }

    /// The mean of a value of each pair over the emitters of each point, weighted by their unoccluded irradiance:
    /// the part of the light that arrives. 0 at points that face no emitter.
    pub fn weighted(&self, values: &[f32]) -> Vec<f32> {
        let mut sums = vec![(0.0f64, 0.0f64); self.points.len()];
        for (pair, &value) in self.pairs.iter().zip(values) {
            let (sum, weight) = &mut sums[pair.point as usize];
            *sum += f64::from(pair.weight) * f64::from(value);
            *weight += f64::from(pair.weight);
        }
        sums.into_iter().map(|(sum, weight)| if weight > 0.0 { (sum / weight) as f32 } else { 0.0 }).collect()
    }

    /// Puts `rays` segments of each of these pairs into packets without gaps: for engines that need no bundles.
    pub fn packed(
        &self,
        scene: &Scene,
        pairs: &[usize],
        rays: usize,
        stream: u64,
        packets: &mut Vec<Packet>,
    ) {
        packets.clear();
        let mut n = 0;
        for &pair in pairs {
            self.each_segment(scene, pair, (rays, Order::Near), stream, |_, a, b| {
                if n % LANES == 0 {
                    packets.push(Packet::EMPTY);
                }
                packets.last_mut().expect("just pushed").set(n % LANES, a, b, self.ends);
                n += 1;
            });
        }
    }

    fn each_segment(
        &self,
        scene: &Scene,
        pair: usize,
        (rays, order): (usize, Order),
        stream: u64,
        mut f: impl FnMut(usize, Vec3, Vec3),
    ) {
        let Pair { point, emitter, .. } = self.pairs[pair];
        let point = &self.points[point as usize];
        let seed = scramble(self.seed ^ stream << 56 ^ (pair as u64) << 8);
        let sampler = &self.samplers[emitter as usize];
        let facing = sampler.facing(scene, point.position);
        // Owen-scrambled Sobol' points: stratified for every power of two, 65536 at most a scramble.
        let draw = |i: u32| sample_4d(i & 0xffff, 0, seed ^ (i >> 16).wrapping_mul(0x9e37_79b9));
        let mut ends: Vec<Vec3> =
            (0..rays as u32).map(draw).map(|[u, v, ..]| facing.sample(scene, u, v)).collect();
        if order == Order::Near {
            gather_neighbours(&mut ends);
        }
        ends.into_iter().enumerate().for_each(|(i, end)| f(i, point.position, end));
    }
}

/// A well-mixed 32-bit seed.
fn scramble(v: u64) -> u32 {
    let v = (v ^ v >> 33).wrapping_mul(0xff51_afd7_ed55_8ccd);
    let v = (v ^ v >> 33).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    (v ^ v >> 33) as u32
}

/// `count` points on the surfaces that do not emit, area-weighted, low-discrepancy; sheets get either side.
///
/// # Errors
/// If every surface emits.
pub fn surface_points(scene: &Scene, count: usize, seed: u64) -> crate::Result<Vec<Point>> {
    let receivers: Vec<u32> = (0..scene.triangles.len() as u32)
        .filter(|&t| scene.triangle_emitter[t as usize] == u32::MAX)
        .collect();
    let mut sums = Vec::with_capacity(receivers.len());
    let mut sum = 0.0f64;
    for &t in &receivers {
        let [a, b, c] = scene.corners(t);
        sum += crate::math::triangle_area(a, b, c);
        sums.push(sum);
    }
    if receivers.is_empty() {
        return Err(crate::Error::Scene(
            "every surface of the scene emits: there is nothing to receive light".into(),
        ));
    }
    let seed = scramble(seed ^ 0x706f_696e_7473);
    let mut points: Vec<(u64, Point)> = (0..count as u32)
        .into_par_iter()
        .map(|i| {
            let draw = sample_4d(i & 0xffff, 0, seed ^ (i >> 16).wrapping_mul(0x9e37_79b9));
            let target = f64::from(draw[0]) * sum;
            let k = sums.partition_point(|&s| s <= target).min(sums.len() - 1);
            let corners = scene.corners(receivers[k]);
            let position = point_on(corners, draw[1], draw[2]);
            let mut normal = crate::math::triangle_normal(corners[0], corners[1], corners[2]);
            if scene.triangle_sides[receivers[k] as usize] == 2 && draw[3] < 0.5 {
                normal = -normal;
            }
            (curve_key(scene, position), Point { position, normal })
        })
        .collect();
    // Neighbours together: both engines find their caches warm.
    points.par_sort_by_key(|(key, _)| *key);
    Ok(points.into_iter().map(|(_, point)| point).collect())
}

/// Position along a Morton curve of 2^10 cells an axis.
fn curve_key(scene: &Scene, p: Vec3) -> u64 {
    let cell = ((p - scene.bounds.min) / scene.bounds.extent().max_element().max(f32::MIN_POSITIVE) * 1023.0)
        .as_uvec3();
    (0..10).fold(0, |key, bit| {
        let pick = |v: u32| u64::from(v >> bit & 1);
        key | (pick(cell.x) | pick(cell.y) << 1 | pick(cell.z) << 2) << (3 * bit)
    })
}
