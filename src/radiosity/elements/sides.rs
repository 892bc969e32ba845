//! Which sides of the faces light can reach, and which faces make quads.

use crate::math::{Aabb, triangle_normal};
use crate::scene::Scene;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// For each face whether front and back can be reached by light.
///
/// Sheets have two sides. A closed part has the side that some emitter is on: outside for a chair, inside for a room
/// that is one closed box, whichever way it is wound; the winding number at a point in front of the emitter tells. Parts
/// that claim to be closed but are not wound one way count as sheets, and so do `open` ones.
pub(super) fn seen(scene: &Scene, open: &[u32]) -> Vec<[bool; 2]> {
    let mut parts = closed_parts(scene);
    open.iter().for_each(|&part| parts[part as usize].clear());
    let lights = light_points(scene);
    let seen_of_part: Vec<[bool; 2]> = parts
        .par_iter()
        .map(|faces| {
            if faces.is_empty() {
                return [true, true];
            }
            let bounds = Aabb::of(faces.iter().flat_map(|&t| scene.corners(t)));
            let outward = signed_volume(scene, faces, bounds.center()) > 0.0;
            let (mut inside, mut outside) = (false, lights.is_empty());
            for &light in &lights {
                let holds = light.cmpge(bounds.min).all()
                    && light.cmple(bounds.max).all()
                    && winding(scene, faces, light).abs() > 0.5;
                (inside, outside) = (inside || holds, outside || !holds);
            }
            if outward { [outside, inside] } else { [inside, outside] }
        })
        .collect();
    scene.triangle_component.iter().map(|&part| seen_of_part[part as usize]).collect()
}

/// A ray that met a face on the side that was taken for dark.
#[derive(Clone, Copy, Debug)]
pub struct Entered {
    /// The face.
    pub triangle: u32,
    /// Where the ray came from, scene units.
    pub from: Vec3,
    /// Whether that is on an emitter.
    pub emits: bool,
}

/// Rays of a part that are looked into, and how many of them must have come from outside.
const LOOKED_INTO: usize = 8;
const FROM_OUTSIDE: f64 = 0.25;

/// The closed parts (components of the scene, ascending) that have light on both sides: rays from outside have met their
/// inside, because some of their faces are turned over, or rays from an emitter have. What else meets a closed part from
/// within starts on something that reaches into it or stands on the same floor, and is dark there.
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
        let looked: Vec<&Entered> = rays.iter().step_by(rays.len().div_ceil(LOOKED_INTO)).collect();
        let outside = |ray: &&&Entered| winding(scene, faces, ray.from).abs() < 0.5;
        let came = looked.iter().filter(outside).count() as f64;
        rays.iter().any(|ray| ray.emits) || came >= FROM_OUTSIDE * looked.len() as f64
    };
    let lit: Vec<bool> = by_part.par_iter().zip(&parts).map(is_lit).collect();
    (0..).zip(lit).filter_map(|(part, lit)| lit.then_some(part)).collect()
}

/// The faces of each part that is closed and wound one way; nothing for the others.
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

/// Points just in front of some faces of every emitter (behind them too for two-sided emission).
fn light_points(scene: &Scene) -> Vec<Vec3> {
    const FACES: usize = 4;
    let step = 1e-4 * scene.bounds.diagonal();
    let mut points = Vec::new();
    for emitter in &scene.emitters {
        for k in 0..FACES.min(emitter.triangles.len()) {
            let t = emitter.triangles[k * emitter.triangles.len() / FACES.min(emitter.triangles.len())];
            let [a, b, c] = scene.corners(t);
            let (middle, normal) = ((a + b + c) / 3.0, triangle_normal(a, b, c));
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

/// Sum of the signed solid angles over 4π (van Oosterom and Strackee 1983): ±1 inside, 0 outside.
fn winding(scene: &Scene, faces: &[u32], from: Vec3) -> f64 {
    let from = from.as_dvec3();
    let angle = |t: &u32| {
        let [a, b, c] = scene.corners(*t).map(|p| (p.as_dvec3() - from).normalize_or(DVec3::X));
        2.0 * a.dot(b.cross(c)).atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))
    };
    faces.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

/// Groups faces into single triangles and pairs that are convex planar quads of one object, material and part, longest
/// shared edges first. The corners are those of the group, counterclockwise; a triangle repeats its last.
pub(super) fn quads(scene: &Scene, faces: &[u32]) -> Vec<([u32; 2], [Vec3; 4])> {
    let mut shared: HashMap<(u32, u32), Vec<(u32, usize)>> = HashMap::new();
    for &t in faces {
        let v = scene.triangles[t as usize];
        for i in 0..3 {
            let (a, b) = (v[i], v[(i + 1) % 3]);
            shared.entry((a.min(b), a.max(b))).or_default().push((t, i));
        }
    }
    let mut pairs: Vec<(f32, [u32; 2], [Vec3; 4])> = shared
        .into_values()
        .filter(|uses| uses.len() == 2)
        .filter_map(|uses| {
            let [(t, i), (u, j)] = [uses[0], uses[1]];
            quad(scene, t.min(u), if t < u { i } else { j }, t.max(u), if t < u { j } else { i })
        })
        .collect();
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut used = std::collections::HashSet::new();
    let mut groups: Vec<([u32; 2], [Vec3; 4])> = Vec::new();
    for (_, pair, corners) in pairs {
        if !used.contains(&pair[0]) && !used.contains(&pair[1]) {
            used.extend(pair);
            groups.push((pair, corners));
        }
    }
    for &t in faces.iter().filter(|t| !used.contains(*t)) {
        let [a, b, c] = scene.corners(t);
        groups.push(([t, t], [a, b, c, c]));
    }
    groups.sort_by_key(|(triangles, _)| *triangles);
    groups
}

/// Two faces that share the edges `i` and `j`, as a quad with the length of that edge.
fn quad(scene: &Scene, t: u32, i: usize, u: u32, j: usize) -> Option<(f32, [u32; 2], [Vec3; 4])> {
    let alike = |of: &[u32]| of[t as usize] == of[u as usize];
    let (v, w) = (scene.triangles[t as usize], scene.triangles[u as usize]);
    let same = alike(&scene.triangle_object)
        && alike(&scene.triangle_material)
        && alike(&scene.triangle_component)
        && alike(&scene.triangle_emitter)
        && scene.triangle_reflectance[t as usize] == scene.triangle_reflectance[u as usize]
        && scene.triangle_sides[t as usize] == scene.triangle_sides[u as usize]
        // Wound alike: the edge runs in opposite directions.
        && v[i] == w[(j + 1) % 3];
    if !same {
        return None;
    }
    let at = |v: u32| scene.positions[v as usize];
    // The shared edge is a diagonal of: its start, the other face's third corner, its end, this face's third corner.
    let corners = [at(v[i]), at(w[(j + 2) % 3]), at(v[(i + 1) % 3]), at(v[(i + 2) % 3])];
    let n: Vec<Vec3> = (0..4)
        .map(|k| {
            let (a, b, c) = (corners[(k + 3) % 4], corners[k], corners[(k + 1) % 4]);
            triangle_normal(a, b, c)
        })
        .collect();
    // Convex with no corner flat, and in one plane.
    let planar = n.iter().all(|m| m.dot(n[0]) > 1.0 - 1e-6);
    planar.then(|| ((corners[2] - corners[0]).length(), [t, u], corners))
}
