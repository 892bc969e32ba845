//! Queries of a benchmark: receiver points, the emitters that they face, and the segments between them.

use super::surface::{point_on, scramble};
use crate::math::Aabb;
use crate::ray::{EndRule, LANES, Packet, gather_neighbours};
use crate::scene::{Emitter, Scene};
use crate::visibility::reference::end_rule;
use glam::{BVec3, Vec3};
use rayon::prelude::*;
use sobol_burley::sample_4d;

pub use super::surface::{Point, surface_points};

/// A point and an emitter that face each other at least partly.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Index into [`Workload::points`].
    pub point: u32,
    /// Index into [`Scene::emitters`].
    pub emitter: u32,
    /// Smallest width of the emitter perpendicular to the direction to the point, scene units.
    pub emitter_size: f32,
    /// Relative irradiance of the point from the unoccluded emitter, by the emitter's centre: its weight in images.
    pub weight: f32,
}

/// Assignment of the segments of a pair to packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Segments that end close together share a packet: packets are coherent.
    Near,
    /// Order of the samples: each packet, and each power of two of packets, is stratified over the whole emitter.
    Spread,
}

/// Points and pairs of a scene, the same for every engine.
#[derive(Clone, Debug)]
pub struct Workload {
    /// Receiver points along a space-filling curve.
    pub points: Vec<Point>,
    /// Pairs in the order of their points.
    pub pairs: Vec<Pair>,
    seed: u64,
    ends: EndRule,
    samplers: Vec<EmitterSampler>,
}

impl Workload {
    /// All pairs of these points and the scene's emitters that face each other.
    pub fn new(scene: &Scene, points: Vec<Point>, seed: u64) -> Workload {
        let samplers: Vec<EmitterSampler> =
            scene.emitters.iter().map(|e| EmitterSampler::new(scene, e)).collect();
        let pairs = points
            .par_iter()
            .enumerate()
            .flat_map_iter(|(p, point)| {
                samplers.iter().enumerate().filter_map(move |(e, s)| {
                    s.pair(point).map(|(emitter_size, weight)| Pair {
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

    /// Appends `rays` segments of a pair to `packets`, sixteen per packet.
    ///
    /// The segments of a smaller number are a subset of those of a larger one. `stream` selects an independent sample
    /// set of the pair: engines under test share stream 0, references use others.
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

    /// Points whose convex hull contains the emitter of a pair.
    pub fn hull(&self, pair: usize) -> &[Vec3] {
        &self.samplers[self.pairs[pair].emitter as usize].hull
    }

    /// Fraction of the unoccluded irradiance that arrives at each point: mean of `values` (one per pair) over the
    /// point's emitters, weighted by [`Pair::weight`]. 0 at points that face no emitter.
    pub fn weighted(&self, values: &[f32]) -> Vec<f32> {
        let mut sums = vec![(0.0f64, 0.0f64); self.points.len()];
        for (pair, &value) in self.pairs.iter().zip(values) {
            let (sum, weight) = &mut sums[pair.point as usize];
            *sum += f64::from(pair.weight) * f64::from(value);
            *weight += f64::from(pair.weight);
        }
        sums.into_iter().map(|(sum, weight)| if weight > 0.0 { (sum / weight) as f32 } else { 0.0 }).collect()
    }

    /// Puts `rays` segments of each of these pairs into packets without gaps, for engines that need no bundles.
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
        let facing = sampler.facing(scene, point);
        // Owen-scrambled Sobol' points, stratified for every power of two; a scramble serves 65,536 points.
        let draw = |i: u32| sample_4d(i & 0xffff, 0, seed ^ (i >> 16).wrapping_mul(0x9e37_79b9));
        let mut ends: Vec<Vec3> =
            (0..rays as u32).map(draw).map(|[u, v, ..]| facing.sample(scene, u, v)).collect();
        if order == Order::Near {
            gather_neighbours(&mut ends);
        }
        ends.into_iter().enumerate().for_each(|(i, end)| f(i, point.position, end));
    }
}

/// The points in the order of a convex polygon, or unchanged if there is no such order.
fn in_turn(points: [Vec3; 4]) -> [Vec3; 4] {
    let [a, b, c, d] = points;
    let orders = [points, [a, b, d, c], [a, c, b, d]];
    let convex = |p: &[Vec3; 4]| {
        let edge = |k: usize| p[(k + 1) % 4] - p[k % 4];
        let turn = |k: usize| edge(k).cross(edge(k + 1));
        (1..4).all(|k| turn(0).dot(turn(k)) > 0.0)
    };
    orders.into_iter().find(convex).unwrap_or(points)
}

/// The distinct points if they are at most eight, otherwise the corners of their bounding box.
fn hull(points: impl Iterator<Item = Vec3> + Clone) -> Vec<Vec3> {
    /// Largest number of points of a hull: that of a box.
    const MAX_HULL_POINTS: usize = 8;
    let mut distinct: Vec<Vec3> = Vec::new();
    for p in points.clone() {
        if distinct.len() <= MAX_HULL_POINTS && !distinct.contains(&p) {
            distinct.push(p);
        }
    }
    if let [a, b, c, d] = distinct[..] {
        return in_turn([a, b, c, d]).to_vec();
    }
    if distinct.len() <= MAX_HULL_POINTS {
        return distinct;
    }
    let bounds = Aabb::of(points);
    let corner = |k: u32| BVec3::new(k & 1 == 1, k & 2 == 2, k & 4 == 4);
    (0..8).map(|k| Vec3::select(corner(k), bounds.max, bounds.min)).collect()
}

/// Samples points on an emitter.
#[derive(Clone, Debug)]
struct EmitterSampler {
    triangles: Vec<u32>,
    /// Normals of the faces.
    normals: Vec<Vec3>,
    /// A corner of each face.
    corners: Vec<Vec3>,
    /// All corners or, for emitters with many corners, the corners of their bounding box.
    hull: Vec<Vec3>,
    /// Cumulative areas.
    sums: Vec<f32>,
    centre: Vec3,
    normal: Vec3,
    planar: bool,
    area: f32,
    width: f32,
    radiance: f32,
}

impl EmitterSampler {
    fn new(scene: &Scene, emitter: &Emitter) -> EmitterSampler {
        let (mut sum, mut centre) = (0.0f64, glam::DVec3::ZERO);
        let (mut normals, mut sums, mut corners) = (Vec::new(), Vec::new(), Vec::new());
        for &t in &emitter.triangles {
            let [a, b, c] = scene.corners(t);
            let area = crate::math::triangle_area(a, b, c);
            centre += area * ((a + b + c) / 3.0).as_dvec3();
            sum += area;
            normals.push(crate::math::triangle_normal(a, b, c));
            corners.push(a);
            sums.push(sum as f32);
        }
        EmitterSampler {
            hull: hull(emitter.triangles.iter().flat_map(|&t| scene.corners(t))),
            triangles: emitter.triangles.clone(),
            normals,
            corners,
            sums,
            centre: (centre / sum).as_vec3(),
            normal: emitter.normal.normalize_or_zero(),
            planar: emitter.normal.length() > 0.999,
            area: emitter.area as f32,
            width: emitter.min_width,
            radiance: emitter.emission.iter().sum::<f32>() / 3.0,
        }
    }

    /// Emitter size and weight for a point; `None` if no face of the emitter faces the point.
    fn pair(&self, point: &Point) -> Option<(f32, f32)> {
        let seen =
            self.normals.iter().zip(&self.corners).any(|(n, &corner)| n.dot(point.position - corner) > 0.0);
        // The centre decides: a point whose horizon cuts the emitter counts if the centre is above the horizon.
        let to = self.centre - point.position;
        let distance = to.length();
        let cosine = point.normal.dot(to) / distance;
        if !seen || cosine.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            return None;
        }
        let facing = if self.planar { (-self.normal.dot(to) / distance).max(0.0) } else { 1.0 };
        let weight = self.radiance * self.area * cosine * facing / (distance * distance);
        Some((self.width * facing, weight))
    }

    /// The faces towards a point, with cumulative areas.
    fn facing<'a>(&'a self, scene: &Scene, point: &Point) -> Facing<'a> {
        if self.planar {
            return Facing { triangles: &self.triangles, sums: std::borrow::Cow::Borrowed(&self.sums) };
        }
        let mut sum = 0.0;
        let sums = self
            .triangles
            .iter()
            .enumerate()
            .map(|(i, &t)| {
                if self.normals[i].dot(point.position - scene.corners(t)[0]) > 0.0 {
                    sum += self.sums[i] - if i > 0 { self.sums[i - 1] } else { 0.0 };
                }
                sum
            })
            .collect();
        Facing { triangles: &self.triangles, sums: std::borrow::Cow::Owned(sums) }
    }
}

struct Facing<'a> {
    triangles: &'a [u32],
    sums: std::borrow::Cow<'a, [f32]>,
}

impl Facing<'_> {
    /// Area-uniform point from two numbers in `[0, 1)`: the first selects the face and is reused within it.
    fn sample(&self, scene: &Scene, u: f32, v: f32) -> Vec3 {
        let total = *self.sums.last().expect("emitters have faces");
        let target = u * total;
        let mut i = self.sums.partition_point(|&s| s <= target).min(self.sums.len() - 1);
        // `target` may be rounded up to the total: take the last face with an area.
        while i > 0 && self.sums[i] == self.sums[i - 1] {
            i -= 1;
        }
        let before = if i > 0 { self.sums[i - 1] } else { 0.0 };
        let u = ((target - before) / (self.sums[i] - before)).clamp(0.0, 1.0);
        point_on(scene.corners(self.triangles[i]), u, v)
    }
}
