//! Groups faces into quads and single triangles.

use crate::math::triangle_normal;
use crate::scene::Scene;
use glam::Vec3;
use rustc_hash::FxHashSet;

/// Groups faces into single triangles and pairs that are convex planar quads of one object, material and part; pairs with the
/// longest shared edge come first. The corners are counterclockwise; a triangle repeats its last corner.
pub(super) fn quads(scene: &Scene, faces: &[u32]) -> Vec<([u32; 2], [Vec3; 4])> {
    let edge = |t: u32, i: usize| {
        let v = scene.triangles[t as usize];
        let (a, b) = (v[i], v[(i + 1) % 3]);
        ((a.min(b), a.max(b)), t, i)
    };
    let mut edges: Vec<_> = faces.iter().flat_map(|&t| (0..3).map(move |i| edge(t, i))).collect();
    edges.sort_unstable();
    let mut pairs: Vec<(f32, [u32; 2], [Vec3; 4])> = edges
        .chunk_by(|a, b| a.0 == b.0)
        .filter_map(|uses| match *uses {
            [(_, t, i), (_, u, j)] => quad(scene, t, i, u, j),
            _ => None,
        })
        .collect();
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut used = FxHashSet::default();
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

/// The quad of two faces that share an edge, `i` of the one and `j` of the other, with the length of that edge.
fn quad(scene: &Scene, t: u32, i: usize, u: u32, j: usize) -> Option<(f32, [u32; 2], [Vec3; 4])> {
    let alike = |of: &[u32]| of[t as usize] == of[u as usize];
    let (v, w) = (scene.triangles[t as usize], scene.triangles[u as usize]);
    let same = alike(&scene.triangle_object)
        && alike(&scene.triangle_material)
        && alike(&scene.triangle_component)
        && alike(&scene.triangle_emitter)
        && scene.triangle_reflectance[t as usize] == scene.triangle_reflectance[u as usize]
        && scene.triangle_sides[t as usize] == scene.triangle_sides[u as usize]
        // Equal winding: the faces run through the edge in opposite directions.
        && v[i] == w[(j + 1) % 3];
    if !same {
        return None;
    }
    let at = |v: u32| scene.positions[v as usize];
    // In order: start of the edge, third corner of the other face, end of the edge, third corner of this face.
    let corners = [at(v[i]), at(w[(j + 2) % 3]), at(v[(i + 1) % 3]), at(v[(i + 2) % 3])];
    let n: [Vec3; 4] = std::array::from_fn(|k| {
        let (a, b, c) = (corners[(k + 3) % 4], corners[k], corners[(k + 1) % 4]);
        triangle_normal(a, b, c)
    });
    // Convex, without a straight corner, and in one plane.
    let planar = n.iter().all(|m| m.dot(n[0]) > 1.0 - 1e-6);
    planar.then(|| ((corners[2] - corners[0]).length(), [t, u], corners))
}
