//! Which sides of the faces light can reach.

use super::ground::ground;
use crate::math::{Aabb, triangle_normal};
use crate::ray::EndRule;
use crate::scene::{Scene, magnitude};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// For each face whether front and back can be reached by light.
///
/// Sheets have two lit sides. A closed part is lit on the sides that have an emitter: outside for a chair, inside for a room
/// that is one closed box, whatever its winding; the winding number at a point in front of the emitter decides. Parts that are
/// not consistently wound count as sheets, and so do the parts listed in `open`. The [`ground`] is lit from above.
pub(super) fn lit_sides(scene: &Scene, open: &[u32]) -> Vec<[bool; 2]> {
    let mut parts = closed_parts(scene);
    open.iter().for_each(|&part| parts[part as usize].clear());
    let lights = light_points(scene);
    let mut seen_of_part: Vec<[bool; 2]> = parts
        .par_iter()
        .map(|faces| {
            if faces.is_empty() {
                return [true, true];
            }
            let bounds = Aabb::of(faces.iter().flat_map(|&t| scene.corners(t)));
            let outward = signed_volume(scene, faces, bounds.center()) > 0.0;
            let (mut inside, mut outside) = (false, lights.is_empty() || scene.environment.is_some());
            for &light in &lights {
                let holds = light.cmpge(bounds.min).all()
                    && light.cmple(bounds.max).all()
                    && winding(scene, faces, light).abs() > 0.5;
                (inside, outside) = (inside || holds, outside || !holds);
            }
            if outward { [outside, inside] } else { [inside, outside] }
        })
        .collect();
    if let Some((part, front_is_up)) = ground(scene) {
        seen_of_part[part as usize] = [front_is_up, !front_is_up];
    }
    scene.triangle_component.iter().map(|&part| seen_of_part[part as usize]).collect()
}

/// A ray that met a face on a side that was assumed to be dark.
#[derive(Clone, Copy, Debug)]
pub struct Entered {
    /// The face.
    pub triangle: u32,
    /// Origin of the ray, scene units.
    pub from: Vec3,
    /// Whether the origin is on an emitter.
    pub emits: bool,
}

/// Largest number of rays of a part whose origins are tested: limits the time to 8 winding numbers per part.
const MAX_TESTED_RAYS: usize = 8;
/// Part of the tested rays that must start outside: 2 of 8, so that one ray that slips through an edge does not decide.
const MIN_OUTSIDE_SHARE: f64 = 0.25;

/// The closed parts (components of the scene, ascending) that have light on both sides: rays from outside or from an emitter
/// have met their inside, because some of their faces are turned over. Other rays that meet a closed part from within start on
/// an object that reaches into the part or stands on the same floor, and that is dark there.
pub fn lit_inside(scene: &Scene, entered: &[Entered]) -> Vec<u32> {
    let parts = closed_parts(scene);
    let mut by_part: Vec<Vec<Entered>> = vec![Vec::new(); parts.len()];
    for ray in entered {
        by_part[scene.triangle_component[ray.triangle as usize] as usize].push(*ray);
    }
    let is_lit = |(rays, faces): (&Vec<Entered>, &Vec<u32>)| {
        if rays.is_empty() || faces.is_empty() {
            return false;
        }
        let tested: Vec<&Entered> = rays.iter().step_by(rays.len().div_ceil(MAX_TESTED_RAYS)).collect();
        let outside = |ray: &&&Entered| winding(scene, faces, ray.from).abs() < 0.5;
        let from_outside = tested.iter().filter(outside).count() as f64;
        rays.iter().any(|ray| ray.emits) || from_outside >= MIN_OUTSIDE_SHARE * tested.len() as f64
    };
    let lit: Vec<bool> = by_part.par_iter().zip(&parts).map(is_lit).collect();
    (0..).zip(lit).filter_map(|(part, lit)| lit.then_some(part)).collect()
}

/// The faces of each closed and consistently wound part; an empty list for other parts.
fn closed_parts(scene: &Scene) -> Vec<Vec<u32>> {
    let count = scene.triangle_component.iter().max().map_or(0, |&m| m as usize + 1);
    let mut parts = vec![Vec::new(); count];
    let mut edges: Vec<(u32, u32, u32)> = Vec::new();
    for (t, corners) in scene.triangles.iter().enumerate() {
        if scene.triangle_sides[t] == 1 {
            let part = scene.triangle_component[t];
            parts[part as usize].push(t as u32);
            edges.extend((0..3).map(|i| (part, corners[i], corners[(i + 1) % 3])));
        }
    }
    edges.par_sort_unstable();
    let mut open = vec![false; count];
    for pair in edges.windows(2) {
        open[pair[0].0 as usize] |= pair[0] == pair[1];
    }
    let lonely: Vec<u32> = edges
        .par_iter()
        .filter(|&&(part, a, b)| edges.binary_search(&(part, b, a)).is_err())
        .map(|&(part, _, _)| part)
        .collect();
    lonely.into_iter().for_each(|part| open[part as usize] = true);
    parts.iter_mut().zip(open).filter(|(_, open)| *open).for_each(|(part, _)| part.clear());
    parts
}

/// Points in front of at most four faces of every emitter, and behind them for two-sided emission.
fn light_points(scene: &Scene) -> Vec<Vec3> {
    // Faces of an emitter that are tested: limits the time to 4 winding numbers per emitter (8 if it emits from both sides).
    const FACES: usize = 4;
    let mut points = Vec::new();
    for emitter in &scene.emitters {
        for k in 0..FACES.min(emitter.triangles.len()) {
            let t = emitter.triangles[k * emitter.triangles.len() / FACES.min(emitter.triangles.len())];
            let [a, b, c] = scene.corners(t);
            let (middle, normal) = ((a + b + c) / 3.0, triangle_normal(a, b, c));
            let step = EndRule::new(magnitude([a, b, c])).height();
            points.push(middle + step * normal);
            if scene.two_sided_emission {
                points.push(middle - step * normal);
            }
        }
    }
    points
}

fn signed_volume(scene: &Scene, faces: &[u32], from: Vec3) -> f64 {
    let from = from.as_dvec3();
    let six = |t: &u32| {
        let [a, b, c] = scene.corners(*t).map(|p| p.as_dvec3() - from);
        a.dot(b.cross(c))
    };
    faces.iter().map(six).sum()
}

/// Winding number: the sum of the signed solid angles of the faces over 4π (van Oosterom and Strackee 1983), ±1 inside, 0
/// outside.
fn winding(scene: &Scene, faces: &[u32], from: Vec3) -> f64 {
    let from = from.as_dvec3();
    let angle = |t: &u32| {
        let [a, b, c] = scene.corners(*t).map(|p| (p.as_dvec3() - from).normalize_or(DVec3::X));
        2.0 * a.dot(b.cross(c)).atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))
    };
    faces.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}
