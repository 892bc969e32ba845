//! Where flat surfaces of overlapping faces continue at their edges: before or behind their plane.

use super::magnitudes::largest_distance;
use super::overlap::Faces;
use crate::math::{Aabb, triangle_normal};
use glam::Vec3;
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};

/// Largest number of triangles at an edge that are compared, so that the time is in proportion to the triangles.
const MAX_AT_EDGE: usize = 64;

/// Largest number of tests whether an edge of a triangle lies on a border: a second. Where more would be needed, none is made.
const MAX_TESTS: usize = 10_000_000;

/// Largest cosine between edges that lie on each other in opposite directions: 2.6 degrees.
const MAX_COSINE: f32 = -0.999;

/// A flat surface: neighbouring triangles of one plane that face the same way.
struct Flat {
    /// A point of its plane.
    start: Vec3,
    normal: Vec3,
    triangles: Vec<u32>,
    /// Edges without a neighbour, in the order of the corners.
    border: Vec<[u32; 2]>,
    /// See [`lengths_before`].
    before: f32,
    /// Length of all edges at which it continues before or behind its plane, scene units.
    at_edges: f32,
    /// The ends of the first of these edges.
    first_edge: Option<[Vec3; 2]>,
    /// Whether all of them lie on one straight line.
    is_on_line: bool,
}

/// Smallest difference of the lengths before and behind a surface relative to their sum: the rounding of f32 in sums of a few hundred edges.
const MIN_DIFFERENCE: f32 = 1e-4;

impl Flat {
    /// Adds an edge, with 1 if the surface continues before its plane there and -1 behind it.
    fn continue_at(&mut self, edge: [Vec3; 2], sign: f32) {
        let length = edge[0].distance(edge[1]);
        self.before += sign * length;
        self.at_edges += sign.abs() * length;
        if sign != 0.0 {
            let [start, end] = *self.first_edge.get_or_insert(edge);
            let along = (end - start).normalize_or_zero();
            let distance = largest_distance(&Aabb::of(edge.into_iter().chain([start, end]))) as f32;
            let is_near = |p: Vec3| (p - start).reject_from_normalized(along).length() <= distance;
            self.is_on_line &= edge.into_iter().all(is_near);
        }
    }

    /// See [`lengths_before`].
    fn length_before(&self) -> f32 {
        let differs = self.before.abs() > MIN_DIFFERENCE * self.at_edges;
        if differs && !self.is_on_line { self.before } else { 0.0 }
    }
}

/// For each of some triangles, the length of the edges at which the flat surface that it belongs to continues before its plane, less that of the edges at which
/// it continues behind it, scene units. Surfaces continue where the order of the corners is consistent: with triangles that share an edge, or else with those
/// on whose edges their borders lie. Edges on one straight line do not count: a terrace that touches a pool there is none of its walls.
pub(super) fn lengths_before(of: &HashSet<u32>, faces: &Faces) -> HashMap<u32, f32> {
    let mut seeds: Vec<u32> = of.iter().copied().collect();
    seeds.sort_unstable();
    let at_edge = edges_of_parts(&seeds, faces);
    let mut known = HashSet::new();
    let mut flats = Vec::new();
    for seed in seeds {
        if !known.contains(&seed) {
            let flat = flat(seed, &at_edge, faces);
            known.extend(flat.triangles.iter().copied());
            flats.push(flat);
        }
    }
    add_contacts(&mut flats, faces);
    let length = |flat: &Flat| flat.length_before();
    flats.iter().flat_map(|flat| flat.triangles.iter().map(|&t| (t, length(flat)))).collect()
}

/// The edges of all triangles of the parts of some triangles, ascending, with their triangles.
fn edges_of_parts(seeds: &[u32], faces: &Faces) -> Vec<([u32; 2], u32)> {
    let parts: HashSet<u32> = seeds.iter().map(|&t| faces.properties.part(t)).collect();
    let is_of_parts = |t: &u32| parts.contains(&faces.properties.part(*t));
    let all = 0..if parts.is_empty() { 0 } else { faces.triangles.len() as u32 };
    let with_triangle = |t: u32| edges(faces, t).map(|edge| (edge, t));
    let mut edges: Vec<_> = all.into_par_iter().filter(is_of_parts).flat_map_iter(with_triangle).collect();
    edges.par_sort_unstable();
    edges
}

/// The flat surface of a triangle, and where triangles continue it that share its edges.
fn flat(seed: u32, at_edge: &[([u32; 2], u32)], faces: &Faces) -> Flat {
    let [start, b, c] = corners(faces, seed);
    let normal = triangle_normal(start, b, c);
    let mut flat = Flat {
        start,
        normal,
        triangles: vec![seed],
        border: Vec::new(),
        before: 0.0,
        at_edges: 0.0,
        first_edge: None,
        is_on_line: true,
    };
    let (mut known, mut next) = (HashSet::from([seed]), 0);
    while let Some(&t) = flat.triangles.get(next) {
        next += 1;
        for [v, w] in edges(faces, t) {
            let mut beyond = neighbours(at_edge, [v, w], faces.properties.part(seed), faces).peekable();
            if beyond.peek().is_none() {
                flat.border.push([v, w]);
            }
            for u in beyond {
                match height(&flat, u, faces) {
                    0.0 if normal_of(faces, u).dot(normal) > 0.0 && known.insert(u) => flat.triangles.push(u),
                    height => flat.continue_at([v, w].map(|v| position(faces, v)), sign(height)),
                }
            }
        }
    }
    flat
}

/// Middle of an edge on the border of a flat surface.
struct Middle {
    at: Vec3,
    border: [u32; 2],
    /// Place of the surface in the list.
    flat: usize,
}

/// A border of a surface that lies on an edge of a triangle of another part.
struct Contact {
    /// Place of the surface in the list.
    flat: usize,
    border: [u32; 2],
    /// 1 if the triangle lies before the surface, -1 behind it.
    sign: f32,
    t: u32,
    edge: [u32; 2],
}

/// Adds the lengths of borders that lie on edges without neighbours of other triangles, for surfaces that no triangle at their own edges continues. Edges of closed
/// boxes do not count: a rug as large as the box that it lies on is not a face of the box.
fn add_contacts(flats: &mut [Flat], faces: &Faces) {
    let alone = flats.iter().enumerate().filter(|(_, flat)| flat.length_before() == 0.0);
    let middle = |k: usize, [v, w]: [u32; 2]| {
        let at = 0.5 * (position(faces, v) + position(faces, w));
        Middle { at, border: [v, w], flat: k }
    };
    let of_flat =
        |(k, flat): (usize, &Flat)| flat.border.iter().map(move |&border| (k, border)).collect::<Vec<_>>();
    let mut middles: Vec<Middle> = alone.flat_map(of_flat).map(|(k, border)| middle(k, border)).collect();
    if middles.is_empty() {
        return;
    }
    let axis = Aabb::of(middles.iter().map(|of| of.at)).extent().max_position();
    middles.sort_by(|a, b| a.at[axis].total_cmp(&b.at[axis]).then(a.border.cmp(&b.border)));
    let reached = |t: u32| {
        let bounds = Aabb::of(corners(faces, t));
        let distance = largest_distance(&bounds) as f32;
        let first = middles.partition_point(|of| of.at[axis] < bounds.min[axis] - distance);
        let end = middles.partition_point(|of| of.at[axis] <= bounds.max[axis] + distance);
        (t, &middles[first..end.max(first)], bounds)
    };
    let all = || (0..faces.triangles.len() as u32).into_par_iter().map(reached);
    if all().map(|(_, near, _)| near.len()).sum::<usize>() > MAX_TESTS {
        return;
    }
    let flats_before: &[Flat] = flats;
    let contacts = |(t, near, bounds): (u32, &[Middle], Aabb)| {
        let distance = largest_distance(&bounds) as f32;
        let contact = |of: &Middle| {
            let is_near = bounds.distance(of.at) <= distance;
            let touches = |edge: &[u32; 2]| is_near && lies_on(faces, of.at, of.border, *edge, distance);
            let edge = edges(faces, t).into_iter().find(touches)?;
            let sign = sign(height(&flats_before[of.flat], t, faces));
            Some(Contact { flat: of.flat, border: of.border, sign, t, edge })
        };
        near.iter().filter_map(contact).collect::<Vec<_>>()
    };
    let found: Vec<Contact> = all().filter(|(_, near, _)| !near.is_empty()).flat_map_iter(contacts).collect();
    let at_edge = edges_of_parts(&found.iter().map(|of| of.t).collect::<Vec<_>>(), faces);
    let is_open =
        |of: &&Contact| neighbours(&at_edge, of.edge, faces.properties.part(of.t), faces).next().is_none();
    for of in found.iter().filter(is_open) {
        flats[of.flat].continue_at(of.border.map(|v| position(faces, v)), of.sign);
    }
}

/// The triangles of a part beyond an edge of one of its triangles, from the edges of its triangles.
fn neighbours<'a>(
    at_edge: &'a [([u32; 2], u32)],
    [v, w]: [u32; 2],
    part: u32,
    faces: &'a Faces,
) -> impl Iterator<Item = u32> + 'a {
    let first = at_edge.partition_point(|(edge, _)| *edge < [w, v]);
    let of_edge = at_edge[first..].iter().take_while(move |(edge, _)| *edge == [w, v]).take(MAX_AT_EDGE);
    of_edge.map(|&(_, t)| t).filter(move |&t| faces.properties.part(t) == part)
}

/// Whether the middle of a border lies on an edge that runs in the opposite direction.
fn lies_on(faces: &Faces, middle: Vec3, border: [u32; 2], edge: [u32; 2], distance: f32) -> bool {
    let [[p, q], [v, w]] = [border, edge].map(|edge| edge.map(|v| position(faces, v)));
    let along = (w - v).normalize_or_zero();
    let at = (middle - v).dot(along);
    let is_between = at >= 0.0 && at <= v.distance(w);
    is_between
        && (q - p).normalize_or_zero().dot(along) < MAX_COSINE
        && (middle - v - at * along).length() <= distance
}

/// Height of the corner of a triangle that is farthest from the plane of a surface; 0 in the plane.
fn height(flat: &Flat, t: u32, faces: &Faces) -> f32 {
    let corners = corners(faces, t);
    let distance = largest_distance(&Aabb::of(corners.into_iter().chain([flat.start]))) as f32;
    let heights = corners.map(|p| (p - flat.start).dot(flat.normal));
    let farthest = heights.into_iter().fold(0.0, |far: f32, h| if h.abs() > far.abs() { h } else { far });
    if farthest.abs() > distance { farthest } else { 0.0 }
}

fn sign(height: f32) -> f32 {
    if height == 0.0 { 0.0 } else { height.signum() }
}

fn position(faces: &Faces, v: u32) -> Vec3 {
    faces.positions[v as usize]
}

fn corners(faces: &Faces, t: u32) -> [Vec3; 3] {
    faces.triangles[t as usize].map(|v| position(faces, v))
}

fn normal_of(faces: &Faces, t: u32) -> Vec3 {
    let [a, b, c] = corners(faces, t);
    triangle_normal(a, b, c)
}

/// The edges of a triangle in the order of its corners.
fn edges(faces: &Faces, t: u32) -> [[u32; 2]; 3] {
    let [a, b, c] = faces.triangles[t as usize];
    [[a, b], [b, c], [c, a]]
}
