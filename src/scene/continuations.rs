//! Where flat surfaces of overlapping faces continue at their edges: before or behind their plane.

use super::connect::Sets;
use super::magnitudes::largest_distance;
use super::overlap::Faces;
use crate::math::{Aabb, triangle_area, triangle_normal};
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
    /// The edges beyond which it has no triangle.
    outline: Vec<OutlineEdge>,
}

/// An edge of a flat surface.
struct OutlineEdge {
    /// In the order of the corners.
    ends: [u32; 2],
    /// Scene units.
    length: f32,
    /// Number of triangles with this edge before the plane, less that behind it.
    before: f32,
    /// Whether no triangle of the part shares it.
    is_border: bool,
}

/// Smallest difference of the lengths before and behind a surface relative to their sum: the rounding of f32 in sums of a few hundred edges.
const MIN_DIFFERENCE: f32 = 1e-4;

/// Smallest part of the longest outline of a surface at which it continues, as walls and floors of rooms and boxes do. Less is a flap, as paving that touches a house
/// along one line. Outlines of windows are shorter.
const MIN_CONTINUED: f32 = 0.5;

impl Flat {
    fn continued(&self, faces: &Faces) -> Continued {
        let lengths = |part: fn(&OutlineEdge) -> f32| self.outline.iter().map(part).sum::<f32>();
        let length = lengths(|edge| edge.before * edge.length);
        let differs = length.abs() > MIN_DIFFERENCE * lengths(|edge| edge.before.abs() * edge.length);
        if self.is_flap() {
            let area = |&t: &u32| {
                let [a, b, c] = corners(faces, t);
                triangle_area(a, b, c)
            };
            return Continued { length: 0.0, flap: Some(self.triangles.iter().map(area).sum()) };
        }
        Continued { length: if differs { length } else { 0.0 }, flap: None }
    }

    fn is_flap(&self) -> bool {
        let mut numbers = HashMap::<u32, u32>::new();
        for v in self.outline.iter().flat_map(|edge| edge.ends) {
            let next = numbers.len() as u32;
            numbers.entry(v).or_insert(next);
        }
        let mut sets = Sets::new(numbers.len());
        self.outline.iter().for_each(|edge| sets.join(numbers[&edge.ends[0]], numbers[&edge.ends[1]]));
        // By connected outline, its length and that of the edges at which the surface continues.
        let mut lengths = vec![[0.0; 2]; numbers.len()];
        for edge in &self.outline {
            let [all, continued] = &mut lengths[sets.root(numbers[&edge.ends[0]]) as usize];
            *all += edge.length;
            *continued += if edge.before == 0.0 { 0.0 } else { edge.length };
        }
        let longest = lengths.into_iter().max_by(|a, b| a[0].total_cmp(&b[0]));
        longest.is_none_or(|[all, continued]| continued <= MIN_CONTINUED * all)
    }
}

/// How the flat surface of a triangle continues at its edges: with triangles that share an edge, or else with those on whose edges its borders lie. Surfaces continue
/// where the order of the corners is consistent.
#[derive(Clone, Copy)]
pub(super) struct Continued {
    /// The length of the edges at which it continues before its plane, less that of the edges at which it continues behind it, scene units; 0 for flaps.
    pub length: f32,
    /// The area of a flap ([`MIN_CONTINUED`]), scene units squared.
    pub flap: Option<f64>,
}

/// How the flat surfaces of some triangles continue.
pub(super) fn continuations(of: &HashSet<u32>, faces: &Faces) -> HashMap<u32, Continued> {
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
    let of_flat = |flat: &Flat| {
        let continued = flat.continued(faces);
        flat.triangles.iter().map(|&t| (t, continued)).collect::<Vec<_>>()
    };
    flats.iter().flat_map(of_flat).collect()
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
    let mut flat = Flat { start, normal, triangles: vec![seed], outline: Vec::new() };
    let (mut known, mut next) = (HashSet::from([seed]), 0);
    while let Some(&t) = flat.triangles.get(next) {
        next += 1;
        for ends in edges(faces, t) {
            let length = length(faces, ends);
            let mut edge = OutlineEdge { ends, length, before: 0.0, is_border: true };
            let mut is_inner = false;
            for u in neighbours(at_edge, ends, faces.properties.part(seed), faces) {
                edge.is_border = false;
                let height = height(&flat, u, faces);
                edge.before += sign(height);
                if height == 0.0 && normal_of(faces, u).dot(normal) > 0.0 {
                    is_inner = true;
                    if known.insert(u) {
                        flat.triangles.push(u);
                    }
                }
            }
            if !is_inner || edge.before != 0.0 {
                flat.outline.push(edge);
            }
        }
    }
    flat
}

/// Middle of an edge on the border of a flat surface.
struct Middle {
    at: Vec3,
    border: [u32; 2],
    /// Places of the surface in the list and of the edge in its outline.
    place: [usize; 2],
}

/// A border of a surface that lies on an edge of a triangle of another part.
struct Contact {
    /// See [`Middle::place`].
    place: [usize; 2],
    /// 1 if the triangle lies before the surface, -1 behind it.
    sign: f32,
    t: u32,
    edge: [u32; 2],
}

/// Adds the borders that lie on edges without neighbours of other triangles, for surfaces that no triangle at their own edges continues. Edges of closed boxes do not
/// count: a rug as large as the box that it lies on is not a face of the box.
fn add_contacts(flats: &mut [Flat], faces: &Faces) {
    let alone = flats.iter().enumerate().filter(|(_, flat)| flat.continued(faces).length == 0.0);
    let middle = |place: [usize; 2], border: [u32; 2]| {
        let [p, q] = border.map(|v| position(faces, v));
        Middle { at: 0.5 * (p + q), border, place }
    };
    let of_flat = |(k, flat): (usize, &Flat)| {
        let borders = flat.outline.iter().enumerate().filter(|(_, edge)| edge.is_border);
        borders.map(|(m, edge)| middle([k, m], edge.ends)).collect::<Vec<_>>()
    };
    let mut middles: Vec<Middle> = alone.flat_map(of_flat).collect();
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
            let sign = sign(height(&flats_before[of.place[0]], t, faces));
            Some(Contact { place: of.place, sign, t, edge })
        };
        near.iter().filter_map(contact).collect::<Vec<_>>()
    };
    let found: Vec<Contact> = all().filter(|(_, near, _)| !near.is_empty()).flat_map_iter(contacts).collect();
    let at_edge = edges_of_parts(&found.iter().map(|of| of.t).collect::<Vec<_>>(), faces);
    let is_open =
        |of: &&Contact| neighbours(&at_edge, of.edge, faces.properties.part(of.t), faces).next().is_none();
    for &Contact { place: [k, m], sign, .. } in found.iter().filter(is_open) {
        flats[k].outline[m].before += sign;
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

fn length(faces: &Faces, [v, w]: [u32; 2]) -> f32 {
    position(faces, v).distance(position(faces, w))
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
