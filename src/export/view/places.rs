//! Where a person would stand in a scene, and where the detail is.

use super::Stage;
use crate::math::Aabb;
use crate::radiosity::mesh::RadiosityMesh;
use crate::ray::Packet;
use crate::scene::unit_in_metres;
use glam::Vec3;
use std::collections::{HashMap, HashSet};

/// Eye height of a standing person, metres (ISO 7250: median of adults).
const EYE_HEIGHT_METRES: f64 = 1.6;
/// Smallest eye height relative to the width of the scene: in a valley of kilometres a person sees the next slope only.
const MIN_HEIGHT_PART: f32 = 0.015;
/// Largest eye height relative to the free height above the ground.
const MAX_HEADROOM_PART: f32 = 0.6;
/// Where an eye is lower than this part of the eye height, a person would crawl.
const MIN_STANDING_PART: f32 = 0.6;
/// Number of places on the ground, and of directions from each.
const SPOTS: usize = 24;
const DIRECTIONS: usize = 48;
/// Smallest cosine between up and the normal of ground: 37 degrees.
const MIN_GROUND_COSINE: f32 = 0.8;
/// Surfaces below a place that are passed on the way to the ground.
const MAX_FLOORS: usize = 8;
/// Cells along the longest side of the scene in which faces are counted, and number of places with most of them.
const CELLS: f32 = 16.0;
const PLACES: usize = 4;

/// A place for a camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Eye {
    pub(super) position: Vec3,
    /// Height above the ground.
    pub(super) height: f32,
    /// Part of all directions that meet a surface.
    pub(super) closed: f32,
}

/// Eyes, in scenes with this box and unit of length, above surfaces that face upwards, spread evenly by area, and above the ground below those.
pub(super) fn eyes(stage: &Stage, bounds: Aabb, up: Vec3, unit: &str) -> Vec<Eye> {
    let (size, level) = (bounds.extent(), bounds.extent() * (Vec3::ONE - up.abs()));
    let min_height = MIN_HEIGHT_PART * level.max_element();
    let person = unit_in_metres(unit).map_or(0.0, |metres| (EYE_HEIGHT_METRES / metres) as f32);
    let (tall, tiny) = (person.max(min_height), 1e-4 * size.max_element());
    let mut eyes = Vec::new();
    for spot in spots(stage, up) {
        let ground = lowest(stage, spot, up, tiny);
        for foot in [Some(spot), ground.filter(|g| g.distance(spot) > 10.0 * tiny)].into_iter().flatten() {
            let headroom = distance(stage, foot + tiny * up, up).unwrap_or(f32::INFINITY);
            let height = tall.min(MAX_HEADROOM_PART * headroom);
            let position = foot + height * up;
            let met = (0..DIRECTIONS).filter(|&k| distance(stage, position, sphere(k)).is_some()).count();
            eyes.push(Eye { position, height, closed: met as f32 / DIRECTIONS as f32 });
        }
    }
    // Under tables only if there is no room to stand.
    if eyes.iter().any(|eye| eye.height >= MIN_STANDING_PART * tall) {
        eyes.retain(|eye| eye.height >= MIN_STANDING_PART * tall);
    }
    eyes
}

/// Points on surfaces that face upwards, one in each stratum of their area.
fn spots(stage: &Stage, up: Vec3) -> Vec<Vec3> {
    let mesh = stage.mesh;
    let mut sums = Vec::new();
    let mut sum = 0.0;
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = mesh.corners(t);
        if mesh.normals[corners[0] as usize].dot(up) > MIN_GROUND_COSINE {
            sum += f64::from((b - a).cross(c - a).length());
            sums.push((sum, t));
        }
    }
    if sums.is_empty() {
        return Vec::new();
    }
    let spot = |k: usize| {
        let target = (k as f64 + 0.5) / SPOTS as f64 * sum;
        let [a, b, c] = mesh.corners(sums[sums.partition_point(|s| s.0 < target).min(sums.len() - 1)].1);
        // The R2 sequence of M. Roberts, folded into the triangle.
        let [mut u, mut v] = [0.754_877_7, 0.569_840_3].map(|step| (0.5 + step * k as f32).fract());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        a + u * (b - a) + v * (c - a)
    };
    (0..SPOTS).map(spot).collect()
}

/// The lowest surface below a place that faces upwards.
fn lowest(stage: &Stage, spot: Vec3, up: Vec3, tiny: f32) -> Option<Vec3> {
    let mut found = None;
    let mut at = spot - tiny * up;
    for _ in 0..MAX_FLOORS {
        let Some(t) = distance(stage, at, -up) else { break };
        at -= (t + tiny) * up;
        found = Some(at + tiny * up);
    }
    found
}

/// Distance of the first surface that a ray meets on its lit side.
fn distance(stage: &Stage, from: Vec3, direction: Vec3) -> Option<f32> {
    let mut rays = Packet::EMPTY;
    rays.set_ray(0, from, direction);
    stage.first(&rays)[0].map(|(_, t)| t)
}

/// Direction `k` of a spiral of evenly spread directions.
fn sphere(k: usize) -> Vec3 {
    let z = 1.0 - 2.0 * (k as f32 + 0.5) / DIRECTIONS as f32;
    let turn = 2.399_963 * k as f32; // the golden angle
    let r = (1.0 - z * z).sqrt();
    Vec3::new(r * turn.cos(), r * turn.sin(), z)
}

/// Middles of the cells with the most faces that do not emit, the densest first; neighbours of a cell do not follow it.
pub(super) fn dense_places(solution: &RadiosityMesh, bounds: Aabb) -> Vec<Vec3> {
    let cell = bounds.extent().max_element() / CELLS;
    let mut seen = HashSet::new();
    let mut cells: HashMap<[i32; 3], (usize, Vec3)> = HashMap::new();
    for element in &solution.elements {
        if element.exitance != [0.0; 3] || !seen.insert(element.triangle) {
            continue;
        }
        let middle = element.corners.iter().map(|&v| solution.vertices[v as usize]).sum::<Vec3>() / 4.0;
        let entry = cells.entry((middle / cell).floor().as_ivec3().to_array()).or_default();
        *entry = (entry.0 + 1, entry.1 + middle);
    }
    let mut cells: Vec<([i32; 3], (usize, Vec3))> = cells.into_iter().collect();
    cells.sort_by_key(|&(at, (count, _))| (std::cmp::Reverse(count), at));
    let mut places: Vec<[i32; 3]> = Vec::new();
    let mut middles = Vec::new();
    for (at, (count, sum)) in cells {
        if middles.len() < PLACES && places.iter().all(|p| (0..3).any(|k| (p[k] - at[k]).abs() > 1)) {
            places.push(at);
            middles.push(sum / count as f32);
        }
    }
    middles
}
