//! Planar patches of surfaces.

use super::Scene;
use crate::math::parallel;
use glam::Vec3;

/// Smallest cosine between the normals of a patch's faces: cos 1.15°, above the rounding of normals in files with
/// four digits. No value from 0.999 to 0.99999 changes the errors of a forest (`constants.py bench`).
const MIN_COPLANAR_COSINE: f32 = 0.9998;
/// More faces than this at one edge form a fan: each is joined to its next neighbour alone, so that the pairs of faces do not grow with
/// the square.
const MAX_FACES_AT_EDGE: usize = 8;

impl Scene {
    /// Planar edge-connected patches of some triangles, grown from the largest triangles; each of triangles with the same `group`. The
    /// normals of all members agree with that of the first triangle, so that finely tessellated curves are not planes.
    pub(crate) fn planar_patches(&self, triangles: &[u32], group: impl Fn(u32) -> u32) -> Vec<Vec<u32>> {
        let normals: Vec<Vec3> = parallel::map(triangles, |&t| self.face_normal(t));
        let areas: Vec<f64> = parallel::map(triangles, |&t| self.face_area(t));
        let neighbours = self.neighbours(triangles);
        let mut seeds: Vec<u32> = (0..triangles.len() as u32).collect();
        // Numbers of at least 0 have the order of their bits.
        parallel::sort_by_key(&mut seeds, |&i| (!areas[i as usize].to_bits(), i));
        let group = |i: u32| group(triangles[i as usize]);
        let mut taken = vec![false; triangles.len()];
        let mut patches = Vec::new();
        for seed in seeds {
            if std::mem::replace(&mut taken[seed as usize], true) {
                continue;
            }
            let normal = normals[seed as usize];
            let mut members = vec![seed];
            let mut next = 0;
            while next < members.len() {
                let i = members[next];
                next += 1;
                let first = neighbours.partition_point(|n| n.0 < i);
                for &(_, j) in neighbours[first..].iter().take_while(|n| n.0 == i) {
                    let joins = group(j) == group(seed)
                        && normals[j as usize].dot(normal).abs() > MIN_COPLANAR_COSINE;
                    if joins && !std::mem::replace(&mut taken[j as usize], true) {
                        members.push(j);
                    }
                }
            }
            patches.push(members.into_iter().map(|i| triangles[i as usize]).collect());
        }
        patches
    }

    /// Pairs of places in the list of triangles that share an edge, in both orders, ascending.
    fn neighbours(&self, triangles: &[u32]) -> Vec<(u32, u32)> {
        let edges = self.edges_of(triangles);
        let runs = edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1));
        let mut pairs: Vec<(u32, u32)> = runs
            .flat_map(|run| {
                let reach = if run.len() <= MAX_FACES_AT_EDGE { run.len() } else { 2 };
                run.iter().enumerate().flat_map(move |(k, a)| {
                    run[k + 1..].iter().take(reach - 1).flat_map(move |b| [(a.2, b.2), (b.2, a.2)])
                })
            })
            .collect();
        parallel::sort_by_key(&mut pairs, |&(a, b)| (a.into(), b));
        pairs
    }
}
