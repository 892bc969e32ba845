//! Automatic cameras: for a solution, and for a scene whose light is not known, the same for all its solutions.
//!
//! Eyes stand on the ground, at eye height, and look to the places that are dense in detail. If nearly all directions
//! from there meet a surface, the scene is enclosed (a room, a garden under a dome), and only they are considered;
//! otherwise also views from outside, which show all of it. The best of them is lit, has little close to the camera,
//! and shows many outlines, many surfaces and many objects that do not emit.

#[cfg(test)]
mod tests;

use super::Mesh;
use super::camera::{Camera, First, Frame, Stage, render};
use crate::Result;
use crate::image_io::luminance;
use crate::math::Aabb;
use crate::radiosity::mesh::{Element, RadiosityMesh};
use crate::ray::Packet;
use crate::scene::{Scene, unit_in_metres};
use glam::Vec3;
use std::collections::{HashMap, HashSet};

/// Columns and rows of the pictures that views are compared by: 3,072 rays, a few milliseconds a view.
const PREVIEW_PIXELS: [usize; 2] = [64, 48];
/// Fraction of the directions from an eye that meet a surface where the scene is enclosed. From the middle of a cube with
/// one open side 5/6 do.
const ENCLOSED_FRACTION: f32 = 0.9;
/// Angle of view from top to bottom from inside, radians: of a 35 mm camera with a wide-angle lens of 20 mm.
const INSIDE_ANGLE: f32 = 1.1;
/// Angle of view from top to bottom from outside, radians: of a 35 mm camera with a lens of 28 mm.
const OUTSIDE_ANGLE: f32 = 0.8;
/// Largest angle by which an eye looks up or down, radians: less than half of [`INSIDE_ANGLE`], so that the horizon stays in the
/// picture.
const MAX_PITCH: f32 = 0.4;
/// Fraction of neighbouring pixels with an outline between them at which a picture has half of the possible detail: that of the
/// furnished rooms of `make scenes`.
const HALF_DETAIL_FRACTION: f32 = 0.15;

/// Median distance in a picture, relative to half of the scene's diagonal, from which on it is an overview: nearer views show one
/// object or wall. Selects pictures only.
const MIN_OVERVIEW_DISTANCE: f32 = 0.25;
/// Score factor of a view without objects; 1 for a view of all, relative to one of all: a close view of a few may still be the best.
const NO_OBJECTS_FACTOR: f32 = 0.2;

/// The best view of the scene; `unit` is the name of the unit of length, for the eye height.
pub fn best_view(stage: &Stage, solution: &RadiosityMesh, up: Vec3, unit: &str) -> Camera {
    let mut eyes = eyes(stage, bounds(stage, solution), up, unit);
    let enclosed = eyes.iter().filter(|eye| eye.closed >= ENCLOSED_FRACTION).count();
    let inside = enclosed > 0 && 2 * enclosed >= eyes.len();
    if inside {
        eyes.retain(|eye| eye.closed >= ENCLOSED_FRACTION);
    }
    let mut cameras = if inside { Vec::new() } else { from_outside(stage, solution, up) };
    let judge = ViewScore::new(stage, solution);
    let places = dense_places(solution, bounds(stage, solution));
    for eye in &eyes {
        cameras.extend(places.iter().filter_map(|&place| from_eye(eye, place, up)));
    }
    let mut best: Option<(f32, Camera)> = None;
    for (camera, near) in cameras {
        let frame = render(stage, &camera, PREVIEW_PIXELS, 1, &());
        let score = judge.score(&frame, near);
        if best.as_ref().is_none_or(|b| score > b.0) {
            best = Some((score, camera));
        }
    }
    let outside = || from_outside(stage, solution, up).swap_remove(0).0;
    best.map_or_else(outside, |(_, camera)| camera)
}

/// Views of the whole scene in eight directions at three heights, with the distance within which surfaces are too near.
fn from_outside(stage: &Stage, solution: &RadiosityMesh, up: Vec3) -> Vec<(Camera, f32)> {
    let bounds = bounds(stage, solution);
    let (x, y) = up.any_orthonormal_pair();
    let (centre, radius) = (bounds.center(), 0.5 * bounds.diagonal());
    let turns = (0..8).map(|k| std::f32::consts::TAU * (k as f32) / 8.0);
    let mut cameras = Vec::new();
    for side in turns.map(|turn| x * turn.cos() + y * turn.sin()) {
        for rise in [0.35f32, 0.0, 0.8] {
            let back = (side * rise.cos() + up * rise.sin()).normalize();
            let eye = centre + back * (2.4 * radius);
            cameras.push((camera(eye, -back, up, OUTSIDE_ANGLE), 0.08 * radius));
        }
    }
    cameras
}

/// The view from an eye towards a place; `None` if the place is above or below it.
fn from_eye(eye: &Viewpoint, place: Vec3, up: Vec3) -> Option<(Camera, f32)> {
    let way = place - eye.position;
    let level = way - up * way.dot(up);
    let pitch = way.dot(up).atan2(level.length()).clamp(-MAX_PITCH, MAX_PITCH);
    let forward =
        level.try_normalize().filter(|_| level.length() > eye.height)? * pitch.cos() + up * pitch.sin();
    Some((camera(eye.position, forward, up, INSIDE_ANGLE), 0.6 * eye.height))
}

/// Name of the automatic camera, and beginning of the names of others.
pub const VIEW: &str = "view";

fn camera(eye: Vec3, forward: Vec3, up: Vec3, angle: f32) -> Camera {
    Camera { name: VIEW.into(), eye, forward, up, angle }
}

/// The box around what does not emit, or around everything if all emits: emitters may be as far away as the sun.
fn bounds(stage: &Stage, solution: &RadiosityMesh) -> Aabb {
    let mesh = stage.mesh;
    let dark = |t: &usize| solution.elements[mesh.element[*t] as usize].exitance == [0.0; 3];
    let corners = (0..mesh.triangles.len()).filter(dark).flat_map(|t| mesh.corners(t));
    let bounds = Aabb::of(corners);
    if bounds.diagonal() > 0.0 { bounds } else { Aabb::of(mesh.positions.iter().copied()) }
}

/// Score of views of a scene.
struct ViewScore<'a> {
    solution: &'a RadiosityMesh,
    /// Number of objects that do not emit.
    objects: usize,
    /// Half of the scene's diagonal.
    radius: f32,
}

impl ViewScore<'_> {
    fn new<'a>(stage: &Stage, solution: &'a RadiosityMesh) -> ViewScore<'a> {
        let dark = solution.elements.iter().filter(|e| e.exitance == [0.0; 3]);
        let objects = dark.map(|e| e.object).collect::<HashSet<u32>>().len().max(1);
        let radius = 0.5 * bounds(stage, solution).diagonal();
        ViewScore { solution, objects, radius }
    }

    /// Lit surfaces that do not emit, not nearer than `near`, with outlines, many of them, of many objects, and far
    /// enough for an overview.
    fn score(&self, frame: &Frame, near: f32) -> f32 {
        let all = frame.radiance.len() as f32;
        let mut lights: Vec<f32> = frame.radiance.iter().map(|&r| luminance(r)).collect();
        lights.sort_by(f32::total_cmp);
        let dim = 0.02 * lights[lights.len() * 9 / 10];
        let (mut lit, mut close) = (0.0, 0.0);
        let (mut surfaces, mut objects) = (HashSet::new(), HashSet::new());
        let mut distances = Vec::new();
        for (first, &light) in frame.first.iter().zip(&frame.radiance) {
            let Some(first) = first else { continue };
            let element = &self.solution.elements[first.element as usize];
            close += f32::from(u8::from(first.distance < near));
            surfaces.insert((element.triangle, element.front));
            distances.push(first.distance);
            if element.exitance == [0.0; 3] {
                objects.insert(element.object);
                lit += f32::from(u8::from(luminance(light) > dim));
            }
        }
        if distances.is_empty() {
            return 0.0;
        }
        distances.sort_by(f32::total_cmp);
        let overview = (distances[distances.len() / 2] / (MIN_OVERVIEW_DISTANCE * self.radius)).min(1.0);
        let columns = PREVIEW_PIXELS[0];
        let outline = |a: usize, b: usize| is_outline(&frame.first[a], &frame.first[b], self.solution);
        let outlines = (0..frame.first.len()).filter(|&k| {
            (k + 1) % columns != 0 && outline(k, k + 1)
                || k + columns < frame.first.len() && outline(k, k + columns)
        });
        let detail = outlines.count() as f32 / all;
        let detail = detail / (detail + HALF_DETAIL_FRACTION);
        let shown = NO_OBJECTS_FACTOR + objects.len() as f32 / self.objects as f32;
        let many = (1.0 + surfaces.len() as f32).ln();
        (lit / all).sqrt() * (1.0 - close / all).powi(2) * detail * many * shown * overview
    }
}

/// Whether there is an outline between two pixels: another object, a step of more than a tenth of the distance, or a
/// bend of more than 37 degrees.
fn is_outline(a: &Option<First>, b: &Option<First>, solution: &RadiosityMesh) -> bool {
    let (Some(a), Some(b)) = (a, b) else { return a.is_some() != b.is_some() };
    let [e, f] = [a, b].map(|first| &solution.elements[first.element as usize]);
    let normal = |corners: [u32; 4]| {
        let [a, b, c, d] = corners.map(|v| solution.vertices[v as usize]);
        (c - a).cross(d - b).normalize_or_zero()
    };
    e.object != f.object
        || (a.distance - b.distance).abs() > 0.1 * a.distance.min(b.distance)
        || normal(e.corners).dot(normal(f.corners)) < 0.8
}

/// Eye height of a standing person, metres (ISO 7250: median of adults).
const EYE_HEIGHT_METRES: f64 = 1.6;
/// Smallest eye height relative to the width of the scene: in a valley of kilometres a person sees the next slope only.
const MIN_HEIGHT_FRACTION: f32 = 0.015;
/// Largest eye height relative to the free height above the ground: a view from just below a ceiling or a table shows little else.
const MAX_HEADROOM_FRACTION: f32 = 0.6;
/// Smallest height of an eye at which a person can stand, relative to the eye height: the eyes of a person who stoops. Selects pictures
/// only.
const MIN_STANDING_FRACTION: f32 = 0.6;
/// Number of places on the ground where eyes may stand: limits the time of a view, together with [`PREVIEW_PIXELS`].
const SPOTS: usize = 24;
/// Number of directions from a place in which surfaces are looked for: [`ENCLOSED_FRACTION`] is then known to √(0.9 · 0.1 / 48) = 4 %.
const DIRECTIONS: usize = 48;
/// Smallest cosine between up and the normal of ground: 37 degrees.
const MIN_GROUND_COSINE: f32 = 0.8;
/// Largest number of surfaces below a place that are passed on the way to the ground: storeys, tables and carpets; limits the time of a
/// place.
const MAX_FLOORS: usize = 8;
/// Cells along the longest side of the scene in which faces are counted: in a room of 5 m a cell is 30 cm wide, so that the densest
/// hold furniture.
const CELLS: f32 = 16.0;
/// Number of places with most faces at which eyes look: each is combined with every eye, so that time grows with it.
const PLACES: usize = 4;

/// A place for a camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Viewpoint {
    pub(super) position: Vec3,
    /// Height above the ground.
    pub(super) height: f32,
    /// Fraction of all directions that meet a surface.
    pub(super) closed: f32,
}

/// Eyes, in scenes with this box and unit of length, above surfaces that face upwards, spread evenly by area, and above the ground below
/// those.
fn eyes(stage: &Stage, bounds: Aabb, up: Vec3, unit: &str) -> Vec<Viewpoint> {
    let (size, level) = (bounds.extent(), bounds.extent() * (Vec3::ONE - up.abs()));
    let min_height = MIN_HEIGHT_FRACTION * level.max_element();
    let person = unit_in_metres(unit).map_or(0.0, |metres| (EYE_HEIGHT_METRES / metres) as f32);
    let (tall, tiny) = (person.max(min_height), 1e-4 * size.max_element());
    let mut eyes = Vec::new();
    for spot in spots(stage, up) {
        let ground = lowest(stage, spot, up, tiny);
        for foot in [Some(spot), ground.filter(|g| g.distance(spot) > 10.0 * tiny)].into_iter().flatten() {
            let headroom = distance(stage, foot + tiny * up, up).unwrap_or(f32::INFINITY);
            let height = tall.min(MAX_HEADROOM_FRACTION * headroom);
            let position = foot + height * up;
            let met = (0..DIRECTIONS).filter(|&k| distance(stage, position, sphere(k)).is_some()).count();
            eyes.push(Viewpoint { position, height, closed: met as f32 / DIRECTIONS as f32 });
        }
    }
    // Under tables only if there is no room to stand.
    if eyes.iter().any(|eye| eye.height >= MIN_STANDING_FRACTION * tall) {
        eyes.retain(|eye| eye.height >= MIN_STANDING_FRACTION * tall);
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
fn dense_places(solution: &RadiosityMesh, bounds: Aabb) -> Vec<Vec3> {
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

/// Fraction of the diagonal by which a lamp may reach out of the box around everything else: lamps in openings of a ceiling.
const INSIDE: f32 = 0.01;

/// The automatic camera for a scene with the same light on all surfaces. It depends neither on options of the solver nor on which lamps
/// within the scene are on.
///
/// # Errors
/// Embree fails.
pub fn scene_view(scene: &Scene) -> Result<Camera> {
    let solution = evenly_lit(scene);
    // Nothing stops it.
    let mesh = Mesh::new_unless(&solution, &()).unwrap_or_default();
    let stage = Stage::new(&mesh, &solution)?;
    Ok(best_view(&stage, &solution, scene.up_axis().vector(), &scene.unit))
}

/// The scene with equal light on all lit sides, one element per side of a triangle. Emitters outside the box around everything else emit:
/// the sun, a sky. Others are surfaces like all.
pub(super) fn evenly_lit(scene: &Scene) -> RadiosityMesh {
    let of_emitter = |t: usize| scene.triangle_emitter[t] != u32::MAX;
    let corners = |t: usize| scene.triangles[t].map(|v| scene.positions[v as usize]);
    let dark = Aabb::of((0..scene.triangles.len()).filter(|&t| !of_emitter(t)).flat_map(corners));
    let reach = INSIDE * dark.diagonal();
    let is_outside =
        |t: usize| corners(t).iter().any(|p| (*p - dark.min).min(dark.max - *p).min_element() < -reach);
    let mut solution =
        RadiosityMesh { origin: scene.origin, vertices: scene.positions.clone(), ..RadiosityMesh::default() };
    for (t, &[a, b, c]) in scene.triangles.iter().enumerate() {
        let emits = of_emitter(t) && is_outside(t);
        for front in [true, false].into_iter().take(usize::from(scene.triangle_sides[t])) {
            let corners = if front { [a, b, c, c] } else { [a, c, b, b] };
            let exitance = [f64::from(u8::from(emits && front)); 3];
            solution.elements.push(Element {
                corners,
                radiosity: exitance.map(|e| e + 0.5),
                irradiance: [1.0; 3],
                error: [0.0; 3],
                albedo: [0.5; 3],
                exitance,
                area: 1.0,
                level: 0,
                links: 0,
                triangle: t as u32,
                object: scene.triangle_object[t],
                material: 0,
                front,
                crossed: false,
                narrow: false,
                walls: 0,
            });
        }
    }
    solution
}
