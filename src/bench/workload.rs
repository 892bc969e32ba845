//! Queries of a benchmark: receiver points, the emitters that they face, and the segments between them.

use super::lights::{Light, Lights, PatchSet};
use crate::math::Aabb;
use crate::math::parallel;
use crate::math::sampling::on_triangle;
use crate::model::{Instance, Mesh, Model};
use crate::ray::{EndRule, LANES, Packet, gather_neighbours};
use crate::scene::Scene;
use glam::Vec3;
use sobol_burley::sample_4d;
use std::borrow::Cow;

/// A point and an emitter that face each other at least partly.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Index into [`Workload::points`].
    pub point: u32,
    /// Index into [`Scene::emitters`]; suns and patches of the sky are counted on from there.
    pub emitter: u32,
    /// Smallest width of the emitter perpendicular to the direction to the point, scene units.
    pub emitter_size: f32,
    /// Relative irradiance of the point from the unoccluded emitter, by the emitter's centre: its weight in images. That of a patch of the
    /// sky also stands for patches that the point does not ask.
    pub weight: f32,
}

/// Points and pairs of a scene, the same for every engine.
#[derive(Clone, Debug)]
pub struct Workload {
    /// Receiver points along a space-filling curve.
    pub points: Vec<ReceiverPoint>,
    /// Pairs in the order of their points.
    pub pairs: Vec<Pair>,
    seed: u64,
    lights: Lights,
}

impl Workload {
    /// All pairs of these points and the emitters and suns of the model that face each other, and a few patches of the sky for each point.
    pub fn new(model: &Model, points: Vec<ReceiverPoint>, seed: u64) -> Workload {
        Workload::asking(PatchSet::Some, model, points, seed)
    }

    /// The pairs of images: emitters and suns; in scenes without, the patch of the sky with the largest irradiance.
    pub fn shown(model: &Model, points: Vec<ReceiverPoint>, seed: u64) -> Workload {
        Workload::asking(PatchSet::Shown, model, points, seed)
    }

    pub(super) fn asking(asked: PatchSet, model: &Model, points: Vec<ReceiverPoint>, seed: u64) -> Workload {
        let lights = Lights::of(model, asked);
        let pairs = parallel::flat_map(0..points.len(), |p| {
            let point = &points[p];
            let chance = || f64::from(scramble(seed ^ 0x70_6174_6368 ^ (p as u64) << 8)) / 2f64.powi(32);
            let sources = lights.seen_from(point.position, point.normal, chance).into_iter();
            sources.map(move |(emitter, (emitter_size, weight))| Pair {
                point: p as u32,
                emitter,
                emitter_size,
                weight,
            })
        });
        Workload { points, pairs, seed, lights }
    }

    /// Number of emitters, suns and patches of the sky.
    pub fn sources(&self) -> usize {
        self.lights.all.len()
    }

    /// Whether there are suns or patches of the sky.
    pub fn is_under_a_sky(&self) -> bool {
        self.lights.has_distant()
    }

    /// Whether the emitter of a pair is a sun or a patch of the sky.
    pub fn is_distant(&self, pair: usize) -> bool {
        matches!(self.light(pair), Light::Distant(_))
    }

    fn light(&self, pair: usize) -> &Light {
        &self.lights.all[self.pairs[pair].emitter as usize]
    }

    /// Appends `rays` segments of a pair to `packets`, sixteen per packet.
    ///
    /// The segments of a smaller number are a subset of those of a larger one. `stream` selects an independent sample
    /// set of the pair: engines under test share stream 0, references use others.
    pub fn add_bundle(
        &self,
        scene: &Scene,
        pair: usize,
        rays: usize,
        stream: u64,
        packets: &mut Vec<Packet>,
    ) {
        let first = packets.len();
        self.pack(scene, &[pair], rays, stream, packets);
        Packet::share_slack(&mut packets[first..]);
    }

    /// Points whose convex hull contains the emitter of a pair, or the ends of all segments of the pair to a sun or a patch of the sky.
    pub fn hull(&self, pair: usize) -> Cow<'_, [Vec3]> {
        match self.light(pair) {
            Light::Surface(_) => Cow::Borrowed(self.hull_of_surface(pair)),
            Light::Distant(distant) => {
                let point = &self.points[self.pairs[pair].point as usize];
                let from = EndRule::new(point.magnitude).lifted(point.position, point.normal);
                Cow::Owned(distant.hull(from).into())
            }
        }
    }

    /// Points whose convex hull contains the emitter of a pair; none of a sun or a patch of the sky.
    pub fn hull_of_surface(&self, pair: usize) -> &[Vec3] {
        match self.light(pair) {
            Light::Surface(sampler) => sampler.hull(),
            Light::Distant(_) => &[],
        }
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

    /// Appends `rays` segments of each of these pairs to packets without gaps, from a new packet on, for engines that need no bundles.
    pub fn pack(&self, scene: &Scene, pairs: &[usize], rays: usize, stream: u64, packets: &mut Vec<Packet>) {
        let mut n = 0;
        for &pair in pairs {
            self.each_segment(scene, pair, rays, stream, |a, b, rules| {
                if n % LANES == 0 {
                    packets.push(Packet::EMPTY);
                }
                packets.last_mut().expect("just pushed").set_lifted(n % LANES, a, b, rules);
                n += 1;
            });
        }
    }

    fn each_segment(
        &self,
        scene: &Scene,
        pair: usize,
        rays: usize,
        stream: u64,
        mut f: impl FnMut(Vec3, Vec3, [EndRule; 2]),
    ) {
        let point = &self.points[self.pairs[pair].point as usize];
        let seed = scramble(self.seed ^ stream << 56 ^ (pair as u64) << 8);
        // Owen-scrambled Sobol' points, stratified for every power of two; a scramble serves 65,536 points.
        let draw = |i: u32| sample_4d(i & 0xffff, 0, seed ^ (i >> 16).wrapping_mul(0x9e37_79b9));
        let rule = EndRule::new(point.magnitude);
        let from = rule.lifted(point.position, point.normal);
        let mut ends: Vec<(Vec3, EndRule)> = match self.light(pair) {
            Light::Surface(sampler) => {
                let facing = sampler.facing(scene, point.position);
                let end = |[u, v, ..]: [f32; 4]| rule.other_end(from, facing.sample(scene, u, v));
                (0..rays as u32).map(draw).map(end).collect()
            }
            // No surface is at the far end.
            Light::Distant(distant) => {
                let ends = distant.ends(from, point.normal, rays, draw);
                ends.into_iter().map(|end| (end, rule)).collect()
            }
        };
        gather_neighbours(&mut ends);
        ends.into_iter().for_each(|(end, there)| f(from, end, [rule, there]));
    }
}

/// A point on one side of a surface.
#[derive(Clone, Copy, Debug)]
pub struct ReceiverPoint {
    /// Position relative to the scene's origin, scene units.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Largest coordinate magnitude of the surface there, scene units: the scale of rounding errors.
    pub magnitude: f32,
}

/// A hash of 32 bits.
fn scramble(v: u64) -> u32 {
    let v = (v ^ v >> 33).wrapping_mul(0xff51_afd7_ed55_8ccd);
    let v = (v ^ v >> 33).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    (v ^ v >> 33) as u32
}

/// `count` area-uniform, low-discrepancy points on the surfaces of a model that do not emit, those of present instances where
/// they stand; a sheet gets points on both sides.
///
/// # Errors
/// Every surface emits.
pub fn surface_points(model: &Model, count: usize, seed: u64) -> crate::Result<Vec<ReceiverPoint>> {
    let meshes: Vec<ReceivingTriangles> =
        model.meshes().iter().map(|mesh| ReceivingTriangles::of(mesh)).collect();
    // Sums of areas: the scene's own triangles first, then the placed meshes.
    let mut sum = 0.0;
    let mut placed = Vec::new();
    for instance in model.instances().iter().filter(|instance| instance.is_present()) {
        placed.push((sum, instance));
        sum += meshes[instance.mesh as usize].area() * area_scale(instance);
    }
    if sum <= 0.0 {
        return Err(crate::Error::Scene(
            "every surface of the scene emits: there is nothing to receive light".into(),
        ));
    }
    let bounds = model.bounds();
    let seed = scramble(seed ^ 0x706f_696e_7473);
    let mut points: Vec<(u64, ReceiverPoint)> = parallel::map(0..count as u32, |i| {
        let draw = sample_4d(i & 0xffff, 0, seed ^ (i >> 16).wrapping_mul(0x9e37_79b9));
        let target = f64::from(draw[0]) * sum;
        // The first sum is 0; of instances without area the last has the same sum as the next with one.
        let (before, instance) = placed[placed.partition_point(|(before, _)| *before <= target) - 1];
        let target = (target - before) / area_scale(instance);
        let point = meshes[instance.mesh as usize].point(target, draw, instance);
        (curve_key(bounds, point.position), point)
    });
    // Neighbours are adjacent: the caches of both engines are warm.
    parallel::sort_by_key(&mut points, |(key, _)| (*key, 0));
    Ok(points.into_iter().map(|(_, point)| point).collect())
}

/// Triangles of a mesh that do not emit, with cumulative areas.
struct ReceivingTriangles<'a> {
    mesh: &'a Mesh,
    triangles: Vec<u32>,
    sums: Vec<f64>,
}

impl<'a> ReceivingTriangles<'a> {
    fn of(mesh: &'a Mesh) -> ReceivingTriangles<'a> {
        let scene = mesh.scene();
        let triangles: Vec<u32> = (0..scene.triangles.len() as u32)
            .filter(|&t| scene.triangle_emitter[t as usize] == u32::MAX)
            .collect();
        let mut sums = Vec::with_capacity(triangles.len());
        let mut sum = 0.0f64;
        for &t in &triangles {
            sum += scene.face_area(t);
            sums.push(sum);
        }
        ReceivingTriangles { mesh, triangles, sums }
    }

    /// Area of all triangles, squared units of the mesh.
    fn area(&self) -> f64 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    /// The point at which the cumulative area reaches `target`, where the instance places it; a sheet gets points on both sides.
    fn point(&self, target: f64, draw: [f32; 4], instance: &Instance) -> ReceiverPoint {
        let k = self.sums.partition_point(|&s| s <= target).min(self.sums.len() - 1);
        let (scene, face) = (self.mesh.scene(), self.triangles[k]);
        let corners = scene.corners(face);
        let position = on_triangle(corners, draw[1], draw[2]);
        let mut normal = crate::math::triangle_normal(corners[0], corners[1], corners[2]);
        if scene.triangle_sides[face as usize] == 2 && draw[3] < 0.5 {
            normal = -normal;
        }
        let position = instance.affine().transform_point3(position.as_dvec3()).as_vec3();
        let magnitude = instance.magnitude_of(self.mesh, face);
        ReceiverPoint { position, normal: instance.turned(normal), magnitude }
    }
}

/// Ratio of the area of a placed triangle to its area in the mesh.
fn area_scale(instance: &Instance) -> f64 {
    instance.affine().matrix3.determinant().abs().cbrt().powi(2)
}

/// Index along a Morton curve of 2^10 cells per axis.
fn curve_key(bounds: Aabb, p: Vec3) -> u64 {
    let cell = ((p - bounds.min) / bounds.extent().max_element().max(f32::MIN_POSITIVE) * 1023.0).as_uvec3();
    (0..10).fold(0, |key, bit| {
        let pick = |v: u32| u64::from(v >> bit & 1);
        key | (pick(cell.x) | pick(cell.y) << 1 | pick(cell.z) << 2) << (3 * bit)
    })
}
