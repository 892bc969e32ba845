//! Edge-connected parts of polygons, and whether they are closed; groups of triangles across their edges.

use super::Scene;
use crate::math::Aabb;
use crate::math::Sets;
use crate::math::parallel;
use rayon::prelude::*;
use std::collections::HashSet;

/// Every undirected edge of every polygon, sorted so that equal edges are adjacent.
pub(super) struct Edges(Vec<(u64, u32)>);

impl Edges {
    /// Edges of the polygons in `corners`, each with the index of its polygon.
    pub fn of<'a>(polygons: impl Iterator<Item = &'a [u32]>) -> Self {
        let mut edges = Vec::new();
        for (i, p) in polygons.enumerate() {
            for (k, &a) in p.iter().enumerate() {
                let b = p[(k + 1) % p.len()];
                edges.push((u64::from(a.min(b)) << 32 | u64::from(a.max(b)), i as u32));
            }
        }
        edges.par_sort_unstable();
        Edges(edges)
    }

    /// Each edge with its polygons, ascending.
    pub fn faces(&self) -> impl Iterator<Item = ([u32; 2], impl Iterator<Item = u32> + '_)> + '_ {
        self.0.chunk_by(|a, b| a.0 == b.0).map(|run| {
            let edge = [(run[0].0 >> 32) as u32, run[0].0 as u32];
            (edge, run.iter().map(|&(_, polygon)| polygon))
        })
    }
}

/// Edge-connected parts of a scene.
pub(super) struct Parts {
    /// Part of each polygon, numbered from 0 in order of the first polygon.
    pub part: Vec<u32>,
    /// Whether every edge of the part has exactly two faces.
    pub closed: Vec<bool>,
}

/// Finds the edge-connected parts.
///
/// Where more than two faces meet, faces of different objects are separated: two bricks in contact along an edge are
/// two closed solids. A solid whose faces belong to several objects (one per material, for example) is one part,
/// because its edges have two faces. Two faces of different objects on each other, of which `are_folded` tells by their edge, are
/// separated: they are walls of two open boxes side by side.
pub(super) fn parts(edges: &Edges, object: &[u32], are_folded: impl Fn([u32; 2], [u32; 2]) -> bool) -> Parts {
    let n = object.len();
    let (mut sets, mut open) = (Sets::new(n), vec![false; n]);
    let mut meeting = Vec::new();
    for (edge, faces) in edges.faces() {
        meeting.clear();
        meeting.extend(faces);
        if let [a, b] = meeting[..]
            && (object[a as usize] == object[b as usize] || !are_folded(edge, [a, b]))
        {
            sets.join(a, b);
            continue;
        }
        meeting.sort_unstable_by_key(|&f| (object[f as usize], f));
        for same in meeting.chunk_by(|&a, &b| object[a as usize] == object[b as usize]) {
            same.iter().for_each(|&f| sets.join(same[0], f));
            if same.len() != 2 {
                same.iter().for_each(|&f| open[f as usize] = true);
            }
        }
    }
    number(sets, &open)
}

fn number(mut sets: Sets, open: &[bool]) -> Parts {
    let mut part = vec![u32::MAX; open.len()];
    let mut closed = Vec::new();
    for i in 0..open.len() {
        let root = sets.root(i as u32) as usize;
        if root == i {
            part[i] = closed.len() as u32;
            closed.push(true);
        }
        part[i] = part[root];
        closed[part[i] as usize] &= !open[i];
    }
    Parts { part, closed }
}

/// The parts in which an edge has no second triangle with the opposite order of corners, or several with the same order: they are open or
/// not consistently wound.
pub(crate) fn badly_wound(triangles: impl Iterator<Item = (u32, [u32; 3])>) -> HashSet<u32> {
    let edges_of = |(part, [a, b, c]): (u32, [u32; 3])| [(part, a, b), (part, b, c), (part, c, a)];
    let mut edges: Vec<(u32, u32, u32)> = triangles.flat_map(edges_of).collect();
    edges.par_sort_unstable();
    let lonely =
        |&(part, a, b): &(u32, u32, u32)| edges.binary_search(&(part, b, a)).is_err().then_some(part);
    let mut found: HashSet<u32> = parallel::flat_map(&edges, lonely).into_iter().collect();
    found.extend(edges.windows(2).filter(|pair| pair[0] == pair[1]).map(|pair| pair[0].0));
    found
}

impl Scene {
    /// Boxes around the edge-connected parts of the scene, by `triangle_component`.
    pub(crate) fn component_bounds(&self) -> Vec<Aabb> {
        let parts = self.triangle_component.iter().max().map_or(0, |&part| part as usize + 1);
        let mut bounds = vec![Aabb::EMPTY; parts];
        for (t, &part) in self.triangle_component.iter().enumerate() {
            bounds[part as usize] = bounds[part as usize].union(Aabb::of(self.corners(t as u32)));
        }
        bounds
    }

    /// Groups of some triangles across their common edges: for each the place in the list of the first of its group. `joins` states whether
    /// two neighbours are joined, by their places.
    pub(crate) fn joined_across_edges(
        &self,
        triangles: &[u32],
        joins: impl Fn([u32; 2]) -> bool,
    ) -> Vec<u32> {
        let mut sets = Sets::new(triangles.len());
        for pair in self.edges_of(triangles).windows(2) {
            let ((a0, b0, i), (a1, b1, j)) = (pair[0], pair[1]);
            if (a0, b0) == (a1, b1) && joins([i, j]) {
                sets.join(i, j);
            }
        }
        (0..triangles.len() as u32).map(|i| sets.root(i)).collect()
    }

    /// The edges of some triangles, ascending: both vertices, the smaller index first, and the place of the triangle in the list.
    pub(crate) fn edges_of(&self, triangles: &[u32]) -> Vec<(u32, u32, u32)> {
        let edges_of_triangle = |(i, &t): (u32, &u32)| {
            let [a, b, c] = self.triangles[t as usize];
            [(a, b), (b, c), (c, a)].map(|(p, q)| (p.min(q), p.max(q), i))
        };
        let mut edges: Vec<(u32, u32, u32)> = (0..).zip(triangles).flat_map(edges_of_triangle).collect();
        edges.par_sort_unstable();
        edges
    }
}
