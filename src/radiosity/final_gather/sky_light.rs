//! Light of the sky and the suns: rays that leave the scene receive the light of the sky, and points trace shadow rays to the suns.

use super::bright_leaves::FRACTION_OF_ERROR;
use super::cells_around::RayCell;
use super::element_rays::LeafRays;
use super::gather_point::GatherPoint;
use super::gatherer::{Buffers, FinalGather, PathVertex, RayResult};
use crate::math::sampling::{numbers, shifted};
use crate::radiosity::links::{Scratch, VisibilityEngine, VisibilityQuery};
use crate::radiosity::rgb::Rgb;
use crate::ray::{LANES, Packet};
use crate::sky::Sun;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// Rays of an element are compared with the open sky only if more than this fraction of them leaves the scene: with more blocked rays,
/// the comparison would add noise.
const MIN_OPEN_FRACTION: f32 = 0.5;

/// Smallest number of rays from a point to a sun, evenly spread over the disc, even if all agree: all of them miss a gap that shows a
/// twentieth of the disc in one of seven hundred cases. A gap between leaves that shows a fiftieth of the disc lights a room as much as
/// the sky does through a window.
const AGREED_RAYS: usize = 8 * LANES;
/// Largest ratio of the rays from a point to a sun to [`Options::light_rays`](crate::radiosity::Options::light_rays): four times as
/// many rays halve the noise. The unoccluded sun has ten times the light of a clear sky, so that its shadows have most of the noise;
/// points whose rays agree trace [`AGREED_RAYS`] alone.
const MAX_SUN_RAYS_RATIO: usize = 4;
/// Visible fraction of the disc of a sun from which on the error is relative to this fraction: behind blinds and leaves a tenth of the
/// sun is most of the light. Relative to all of the sun, the error there would be ten times as large.
const MIN_VISIBLE_SUN: f64 = 0.1;

/// Smallest error of the light of the sky in a cell, relative to this light: samples in the cell that agree by chance have an error as
/// well. The limit matters only where all samples agree.
const MIN_CELL_ERROR: f64 = 0.01;

impl FinalGather<'_> {
    /// The suns of the scene.
    pub(super) fn suns(&self) -> &[Sun] {
        self.environment.map_or(&[], |of| of.suns())
    }

    /// Whether light comes from beyond the scene.
    pub(super) fn has_environment(&self) -> bool {
        self.environment.is_some()
    }

    /// Irradiance by a cosine-weighted ray that leaves the scene in this direction, W/m²: π times the radiance of the sky.
    pub(super) fn sky_of_ray(&self, direction: Vec3) -> Vec3 {
        let Some(environment) = self.environment else { return Vec3::ZERO };
        let direction = direction.as_dvec3().normalize_or_zero();
        Vec3::from(environment.radiance(direction).map(|l| (PI * l) as f32))
    }

    /// Replaces the light of the sky along the rays of a batch of leaves, `halves` times the number of each, by values with the same mean
    /// and less noise where most rays leave the scene. The unoccluded sky is a control variate: with the light of the sky F in the
    /// direction of a ray, blocked or not, its known mean E over the hemisphere, and the fraction v of the rays that leave the scene, v
    /// (E − F) is added. Each half of the rays of a leaf has v from the other half, so that v is independent of its own rays.
    pub(super) fn compare_with_open_sky(&self, batch: &[LeafRays], halves: usize, buffers: &mut Buffers) {
        let Buffers { packets, vertices, results, .. } = buffers;
        let Some(environment) = self.environment else { return };
        let mut first = 0;
        for of in batch {
            let rays = halves * of.count as usize;
            let (range, middle) = (first..first + rays, first + rays / 2);
            first = range.end;
            let normal = self.linked.elements.sides[vertices[range.start].side as usize].normal.as_dvec3();
            let halves = [range.start..middle, middle..range.end];
            let open = halves.clone().map(|half| self.open_part(&results[half], normal));
            if open == [0.0; 2] {
                continue;
            }
            let mean = environment.tabulated_sky_irradiance(normal);
            let mean = Vec3::from(mean.map(|e| e as f32));
            for (half, part) in halves.into_iter().zip([open[1], open[0]]) {
                for i in half.filter(|_| part > 0.0) {
                    let (packet, lane) = (&packets[i / LANES], i % LANES);
                    let ray = || self.sky_of_ray(packet.point(lane, 1.0) - packet.point(lane, 0.0));
                    let free = if results[i].escaped { results[i].sky } else { ray() };
                    results[i].sky += part * (mean - free);
                }
            }
        }
    }

    /// The fraction of some rays of a leaf that leave the scene; 0 where comparison with the open sky adds noise: where it is below
    /// [`MIN_OPEN_FRACTION`], or a sun is hidden, and with it the brightest sky.
    fn open_part(&self, results: &[RayResult], normal: DVec3) -> f32 {
        let count = results.len().max(1) as f32;
        let escaped = results.iter().filter(|of| of.escaped).count() as f32 / count;
        let seen = results.iter().map(|of| of.sun.element_sum()).sum::<f32>() / count;
        let free: f64 = self.suns().iter().flat_map(|sun| sun.irradiance_on(normal)).sum();
        if escaped <= MIN_OPEN_FRACTION || f64::from(seen) < 0.5 * free { 0.0 } else { escaped }
    }

    /// A sampled direction towards a sun, and the irradiance by a ray in this direction on a surface with this normal, W/m²; `None` if
    /// this point of the disc is below the horizon of the surface.
    fn sun_ray(sun: &Sun, normal: Vec3, [u, v]: [f32; 2]) -> Option<(Vec3, Vec3)> {
        let direction = sun.sample([u.into(), v.into()]);
        let cosine = direction.dot(normal.as_dvec3());
        let light = sun.radiance().map(|l| (l * sun.solid_angle() * cosine) as f32);
        (cosine > 0.0).then(|| (direction.as_vec3(), Vec3::from(light)))
    }

    /// Width of a sun at the far end of rays of this length, scene units.
    fn width_of(sun: &Sun, length: f32) -> f32 {
        2.0 * length * (0.5 * sun.diameter).tan() as f32
    }

    /// Adds the light of the suns at `buffers.vertices` to the results: the mean of `count` rays to each, the first from the vertex and
    /// the others from `buffers.sun_places`. `random` gives the numbers of which the last two choose the place on the disc.
    pub(super) fn add_suns(
        &self,
        random: &impl Fn(usize) -> [f32; 4],
        count: impl Fn(&PathVertex) -> u32,
        buffers: &mut Buffers,
    ) {
        let Buffers { vertices, results, scratch, sun_places, .. } = buffers;
        let engine = self.linked.engine.scattered();
        // Exact rays of several leaves fill packets together; other engines take one feature size a packet.
        let mixes = matches!(engine, VisibilityEngine::Exact(_));
        for sun in self.suns() {
            let (mut packet, mut rays, mut used) = (Packet::EMPTY, [(0usize, Vec3::ZERO); LANES], 0);
            let mut places = sun_places.iter();
            let starts =
                vertices.iter().enumerate().flat_map(|(i, vertex)| (0..count(vertex)).map(move |m| (i, m)));
            let mut starts = starts.peekable();
            while let Some((i, m)) = starts.next() {
                let vertex = &vertices[i];
                let side = &self.linked.elements.sides[vertex.side as usize];
                let [.., u, v] = random(i);
                let at =
                    if m == 0 { vertex.at } else { *places.next().expect("a place for each further ray") };
                if let Some((direction, light)) = Self::sun_ray(sun, side.normal, shifted([u, v], m)) {
                    let from = side.end.lifted(at, side.normal);
                    packet.set_blocked_from_start(used, from, from + self.length * direction, [side.end; 2]);
                    rays[used] = (i, light / count(vertex) as f32);
                    used += 1;
                }
                let next = starts.peek().map(|(i, _)| &vertices[*i]);
                let ends = next.is_none_or(|next| !mixes && next.leaf != vertex.leaf);
                if used == LANES || ends && used > 0 {
                    let (feature_size, emitter_size) =
                        (self.feature_size_of(vertex.leaf), Self::width_of(sun, self.length));
                    let query = VisibilityQuery { packet, emitter_size, feature_size };
                    let through = engine.transmittances(&query, scratch);
                    for (&(i, light), through) in rays[..used].iter().zip(through) {
                        results[i].sun += through * light;
                    }
                    (packet, used) = (Packet::EMPTY, 0);
                }
            }
        }
    }

    /// Irradiance of the suns at points, W/m²: few rays, and more where they disagree.
    pub(super) fn suns_at(&self, points: &[GatherPoint], scratch: &mut Scratch) -> Vec<Rgb> {
        let engine = self.linked.engine.scattered();
        let mut values = vec![[0.0; 3]; points.len()];
        for (k, sun) in self.suns().iter().enumerate() {
            for (value, point) in values.iter_mut().zip(points) {
                let light = self.sun_at(sun, k as u64, point, &engine, scratch);
                value.iter_mut().zip(light).for_each(|(sum, e)| *sum += e);
            }
        }
        values
    }

    fn sun_at(
        &self,
        sun: &Sun,
        number: u64,
        point: &GatherPoint,
        engine: &VisibilityEngine,
        scratch: &mut Scratch,
    ) -> Rgb {
        let &GatherPoint { at, normal, end, feature_size, seed, .. } = point;
        let free = sun.irradiance_on(normal.as_dvec3());
        let [shift_u, shift_v, ..] = numbers(seed ^ !number, 0);
        let reach = self.reach_from(at);
        // Sums over rays of the unoccluded light, of the light that passes, and of the unoccluded light times the squared transmittance.
        let (mut all, mut seen, mut squares, mut count) = (0.0, 0.0, 0.0, 0.0);
        let rays = (MAX_SUN_RAYS_RATIO * self.light_rays).max(AGREED_RAYS);
        for first in (0..rays).step_by(LANES) {
            let (mut packet, mut weights) = (Packet::EMPTY, [0.0; LANES]);
            for (lane, [u, v]) in self.table.iter().cycle().skip(first).take(LANES).enumerate() {
                let place = [(u + shift_u).fract(), (v + shift_v).fract()];
                if let Some((direction, light)) = Self::sun_ray(sun, normal, place) {
                    packet.set_lifted(lane, at, at + reach * direction, [end; 2]);
                    weights[lane] = light.element_sum();
                }
            }
            if packet.is_empty() {
                break;
            }
            let query = VisibilityQuery { packet, emitter_size: Self::width_of(sun, reach), feature_size };
            let through = engine.transmittances(&query, scratch);
            for lane in query.packet.lanes() {
                let (weight, through) = (f64::from(weights[lane]), f64::from(through[lane]));
                (all, seen, squares) =
                    (all + weight, seen + weight * through, squares + weight * through * through);
            }
            count += query.packet.len() as f64;
            // Two rays that pass and two that do not are added (Agresti and Coull 1998): otherwise few rays of which
            // all but one agree would end the loop too early.
            let variance = |more: f64| {
                let (more, all) = (more * all / count, all + 2.0 * more * all / count);
                (squares + more) / all - ((seen + more) / all).powi(2)
            };
            let tolerance = FRACTION_OF_ERROR * self.error * (seen / all).max(MIN_VISIBLE_SUN);
            let is_known = variance(0.0) < 1e-9 || variance(2.0) <= count * tolerance * tolerance;
            if first + LANES >= AGREED_RAYS && is_known {
                break;
            }
        }
        let visible = if all > 0.0 { seen / all } else { 0.0 };
        free.map(|e| visible * e)
    }
}

/// The light of the sky in the cells of a point.
#[derive(Clone, Copy, Default)]
pub(super) struct SkyLight {
    /// The unoccluded light of the sky in all cells, W/m².
    all: DVec3,
    /// Squared errors of this light in cells whose rays reach the sky, and in all cells, mean over the channels, (W/m²)².
    errors: [f64; 2],
}

impl SkyLight {
    /// Adds cells, each of which is the fraction `area` of the hemisphere, or subtracts them if `sign` is negative.
    pub fn add<'a>(&mut self, cells: impl Iterator<Item = &'a RayCell>, area: f64, sign: f64) {
        for cell in cells {
            let (sky, error) = (f64::from(cell.sky), f64::from(cell.error));
            let error = sign * area * area * (error + (MIN_CELL_ERROR * sky).powi(2));
            self.all += sign * area * cell.unblocked.as_dvec3();
            self.errors[1] += error;
            if cell.is_open {
                self.errors[0] += error;
            }
        }
    }

    /// Correction of the light of the cells by the known light of the open sky, W/m²: the error of all cells, times the fraction of its
    /// variance that is due to cells whose rays reach the sky.
    pub fn compared_with(&self, open: DVec3) -> DVec3 {
        let part = (self.errors[0] / self.errors[1]).clamp(0.0, 1.0);
        if part.is_finite() { part * (open - self.all) } else { DVec3::ZERO }
    }
}
