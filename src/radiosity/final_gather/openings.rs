//! Openings through which the sky lights closed rooms. Rays from all surfaces find the openings, and each point then traces rays to those
//! that its own rays may miss: a skylight of half a metre in a hall of 30 m is smaller than a cell of the grid of most points.

use super::gather_point::GatherPoint;
use super::gatherer::{Buffers, FinalGather};
use crate::embree::Hits;
use crate::math::parallel;
use crate::math::sampling::{cosine_direction, mix, numbers, pick, point_on, square_of_direction};
use crate::radiosity::elements::Shape;
use crate::ray::{LANES, Packet};
use glam::Vec3;
use std::sync::Arc;

/// Rays from the surfaces of rooms. An opening that is a thousandth of the surface of all rooms is found by about a hundred of them.
const RAYS: usize = 1 << 17;
/// A side does not count as one of a room if more than this fraction of its rays leaves the scene: rays of its own points reach the sky.
const MAX_OPEN_FRACTION: f32 = 0.125;
/// Largest number of rays to the sky along which an opening is located, each by [`HALVINGS`] times [`DIRECTIONS`] rays: together twice
/// [`RAYS`].
const MAX_FOLLOWED: usize = 512;
/// Largest number of places in openings of all rooms, to each of which points with little sky trace a ray: half the rays of their default
/// grid.
const MAX_PLACES: usize = 256;
/// Fraction of all directions, also downwards, in which rays leave the scene at a place in an opening: half in the opening of a thin
/// roof, a quarter in the plane of a window above the ground, less in a shaft. The limit must be above the value in the room and below
/// the value outside.
const OPENING_SKY_FRACTION: f32 = 0.25;
/// Number of directions that estimate this fraction.
const DIRECTIONS: usize = 2 * LANES;
/// Bisections of a ray to locate an opening, as if the open fraction of all directions grew along the ray: to a sixteenth of a metre in a
/// scene of 4 km.
const HALVINGS: usize = 16;

impl FinalGather<'_> {
    /// Places in the openings of rooms, computed at the first call. No lock is held during the computation: if a caller needs them in
    /// several tasks, a thread that waits in one of the tasks may be given another.
    pub(super) fn openings(&self) -> Arc<Vec<Vec3>> {
        let known = &self.linked.openings;
        known.get().cloned().unwrap_or_else(|| {
            let found = Arc::new(self.find_openings());
            // Another thread that was faster has found the same.
            let _ = known.set(found.clone());
            found
        })
    }

    fn find_openings(&self) -> Vec<Vec3> {
        let (elements, escaped) = (&self.linked.elements, &self.linked.surroundings.escaped);
        let area = |side: u32| elements.elements[elements.sides[side as usize].element as usize].area as f32;
        let of_rooms = |side: &u32| escaped[*side as usize] <= MAX_OPEN_FRACTION && area(*side) > 0.0;
        let sides: Vec<u32> = (0..elements.sides.len() as u32).filter(of_rooms).collect();
        if !self.has_environment() || sides.is_empty() {
            return Vec::new();
        }
        let sums: Vec<f32> = sides
            .iter()
            .scan(0.0, |sum, side| {
                *sum += f64::from(area(*side));
                Some(*sum as f32)
            })
            .collect();
        let rays = parallel::flat_map(0..RAYS / LANES, |k| self.rays_to_sky(&sides, &sums, k));
        let evenly = |count: usize, most: usize| count.div_ceil(most).max(1);
        let some: Vec<[Vec3; 2]> = rays.iter().step_by(evenly(rays.len(), MAX_FOLLOWED)).copied().collect();
        let places = parallel::flat_map(&some, |&[from, direction]| self.opening_on(from, direction));
        let step = evenly(places.len(), MAX_PLACES);
        places.into_iter().step_by(step).collect()
    }

    /// Origins and directions of those of sixteen diffuse rays that leave the scene, from sides with these running sums of their areas.
    fn rays_to_sky(&self, sides: &[u32], sums: &[f32], packet: usize) -> Vec<[Vec3; 2]> {
        let elements = &self.linked.elements;
        let seed = mix(self.linked.settings.seed ^ mix(packet as u64));
        let mut rays = Packet::EMPTY;
        for lane in 0..LANES {
            // Evenly spread numbers choose the sides: each has its share of the rays.
            let [u, v, r, t] = numbers(seed, lane as u64);
            let even = ((packet * LANES + lane) as f32 + u) / RAYS as f32;
            let (k, ..) = pick(sums, even);
            let side = &elements.sides[sides[k] as usize];
            let Shape::Surface { corners, .. } = elements.elements[side.element as usize].shape else {
                continue;
            };
            let [across, ..] = numbers(!seed, lane as u64);
            let at = side.end.lifted(point_on(&corners, across, v), side.normal);
            rays.set_between(lane, at, at + self.length * cosine_direction(side.normal, r, t), [0.0, 1.0]);
        }
        let mut hits = [Hits::NONE];
        self.traced.first_hits(self.traversal, std::slice::from_ref(&rays), &mut hits);
        let gone = rays.lanes().filter(|lane| hits[0].triangle[*lane] == Hits::NO_HIT);
        let ray = |lane: usize| {
            [rays.point(lane, 0.0), (rays.point(lane, 1.0) - rays.point(lane, 0.0)).normalize()]
        };
        gone.map(ray).collect()
    }

    /// The place where a ray to the sky leaves a room; `None` if the ray starts in the open.
    fn opening_on(&self, from: Vec3, direction: Vec3) -> Option<Vec3> {
        if self.sky_part(from) >= OPENING_SKY_FRACTION {
            return None;
        }
        let (mut inside, mut outside) = (0.0, self.reach_from(from));
        for _ in 0..HALVINGS {
            let middle = 0.5 * (inside + outside);
            match self.sky_part(from + middle * direction) < OPENING_SKY_FRACTION {
                true => inside = middle,
                false => outside = middle,
            }
        }
        Some(from + outside * direction)
    }

    /// The fraction of all directions from a place in which rays leave the scene.
    fn sky_part(&self, at: Vec3) -> f32 {
        let reach = self.reach_from(at);
        let mut packets = [Packet::EMPTY; DIRECTIONS / LANES];
        for k in 0..DIRECTIONS {
            // Equal bands of height, each turned by the golden angle from the last.
            let height = 1.0 - (2 * k + 1) as f32 / DIRECTIONS as f32;
            let (sin, cos) = (k as f32 * std::f32::consts::PI * (3.0 - 5f32.sqrt())).sin_cos();
            let radius = (1.0 - height * height).sqrt();
            let to = at + reach * Vec3::new(radius * cos, radius * sin, height);
            packets[k / LANES].set_between(k % LANES, at, to, [0.0, 1.0]);
        }
        let mut hits = [Hits::NONE; DIRECTIONS / LANES];
        self.traced.first_hits(self.traversal, &packets, &mut hits);
        let free = hits.iter().flat_map(|hits| hits.triangle).filter(|t| *t == Hits::NO_HIT).count();
        free as f32 / DIRECTIONS as f32
    }

    /// Directions in which the sky is visible from a point through openings, along the axes of a frame, as places of the unit square that
    /// [`cosine_direction`] maps to the hemisphere about +z.
    pub(super) fn seen_openings(
        &self,
        openings: &[Vec3],
        point: &GatherPoint,
        [x, y, z]: [Vec3; 3],
        buffers: &mut Buffers,
    ) -> Vec<[f32; 2]> {
        let Buffers { packets, hits, .. } = buffers;
        let local = |place: &Vec3| {
            let d = (*place - point.at).normalize_or_zero();
            Vec3::new(d.dot(x), d.dot(y), d.dot(z))
        };
        let directions: Vec<Vec3> = openings.iter().map(local).filter(|d| d.z > 0.0).collect();
        packets.clear();
        packets.resize(directions.len().div_ceil(LANES), Packet::EMPTY);
        let reach = self.reach_from(point.at);
        for (k, d) in directions.iter().enumerate() {
            let to = point.at + reach * (d.x * x + d.y * y + d.z * z);
            packets[k / LANES].set_between(k % LANES, point.at, to, [0.0, 1.0]);
        }
        hits.clear();
        hits.resize(packets.len(), Hits::NONE);
        self.traced.first_hits(self.traversal, packets, hits);
        let is_open = |k: usize| hits[k / LANES].triangle[k % LANES] == Hits::NO_HIT;
        let seen = directions.iter().enumerate().filter(|(k, _)| is_open(*k));
        seen.map(|(_, d)| square_of_direction(*d)).collect()
    }
}
