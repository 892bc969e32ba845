//! Where surfaces of overlapping faces continue at sharp edges: before or behind them, as the walls of a room or the sides of a box do.

use super::magnitudes::largest_distance;
use super::overlap::Faces;
use crate::math::Sets;
use crate::math::parallel;
use crate::math::{Aabb, triangle_area, triangle_normal};
use glam::Vec3;
use rustc_hash::{FxHashMap, FxHashSet};

/// Largest number of triangles at an edge that are compared, so that the time is in proportion to the triangles.
const MAX_AT_EDGE: usize = 64;

/// Largest number of tests whether an edge of a triangle lies on a border: a second. Where more would be needed, none is made.
const MAX_TESTS: usize = 10_000_000;

/// Largest cosine between edges that lie on each other in opposite directions, as with a consistent order of corners: 2.6 degrees.
const MAX_COSINE: f32 = -0.999;

/// Smallest cosine of the angle between neighbouring triangles of one surface: 26 degrees, more than the bends of a modelled terrain or of
/// a column with 18 sides, and less than that between a wall and a floor or ceiling.
const MIN_SMOOTH_COSINE: f32 = 0.9;

/// A surface: neighbouring triangles of a part without sharp edges between them.
struct Surface {
    triangles: Vec<u32>,
    /// The edges beyond which it has no triangle.
    outline: Vec<OutlineEdge>,
}

/// An edge of a surface.
struct OutlineEdge {
    /// The triangle of the surface.
    triangle: u32,
    /// In the order of the corners.
    ends: [u32; 2],
    /// Scene units.
    length: f32,
    /// Number of triangles with this edge before the plane of its triangle, less that behind it.
    before: f32,
    /// Whether a triangle before or behind the plane touches it, whatever its order of corners and its part.
    is_touched: bool,
    /// Whether no triangle of the part shares it.
    is_border: bool,
}

/// Smallest difference of the lengths before and behind a surface relative to their sum: the rounding of f32 in sums of a few hundred
/// edges.
const MIN_DIFFERENCE: f32 = 1e-4;

/// A surface is a flap if at most this part of its longest outline continues, and less than this part before it: paving that touches a
/// house along one line, or a cloth that hangs over two edges of a table, but no floor with two of its four walls.
const MIN_CONTINUED: f32 = 0.5;

impl Surface {
    fn continued(&self, faces: &Faces) -> Continued {
        let of_triangle = |&t: &u32| {
            let [a, b, c] = corners(faces, t);
            triangle_area(a, b, c)
        };
        let area = self.triangles.iter().map(of_triangle).sum();
        let sum = |part: fn(&OutlineEdge) -> f32| self.outline.iter().map(part).sum::<f32>();
        let length = sum(|edge| edge.before * edge.length);
        let differs = length.abs() > MIN_DIFFERENCE * sum(|edge| edge.before.abs() * edge.length);
        let length = if differs { length } else { 0.0 };
        let [all, continued, before, touched] = self.longest_outline();
        let part = |of: f32| if all > 0.0 { of / all - MIN_CONTINUED } else { -1.0 };
        let is_flap = part(continued) <= MIN_DIFFERENCE && part(before) < -MIN_DIFFERENCE;
        let has_walls_around = part(touched) > MIN_DIFFERENCE;
        Continued { surface: 0, joined: 0, length, area, joined_area: area, is_flap, has_walls_around }
    }

    /// Length of the longest connected outline, and of its edges at which the surface continues, at which it continues before itself, and
    /// which others touch; scene units.
    fn longest_outline(&self) -> [f32; 4] {
        let mut numbers = FxHashMap::<u32, u32>::default();
        for v in self.outline.iter().flat_map(|edge| edge.ends) {
            let next = numbers.len() as u32;
            numbers.entry(v).or_insert(next);
        }
        let mut sets = Sets::new(numbers.len());
        self.outline.iter().for_each(|edge| sets.join(numbers[&edge.ends[0]], numbers[&edge.ends[1]]));
        let mut outlines = vec![[0.0; 4]; numbers.len()];
        for edge in &self.outline {
            let outline = &mut outlines[sets.root(numbers[&edge.ends[0]]) as usize];
            let is_part =
                [true, edge.before != 0.0, edge.before > 0.0, edge.before != 0.0 || edge.is_touched];
            for (sum, is_part) in outline.iter_mut().zip(is_part) {
                *sum += if is_part { edge.length } else { 0.0 };
            }
        }
        outlines.into_iter().max_by(|a, b| a[0].total_cmp(&b[0])).unwrap_or_default()
    }
}

/// How the surface of a triangle continues at its outline: with triangles that share an edge, or else with those on whose edges its borders
/// lie. Surfaces continue where the order of the corners is consistent.
#[derive(Clone, Copy)]
pub(super) struct Continued {
    /// Number of the surface, in the order of the file.
    pub surface: u32,
    /// Number of the set of the surfaces of `joined_area`.
    pub joined: u32,
    /// The length of the edges at which it continues before it, less that of the edges at which it continues behind it, scene units.
    pub length: f32,
    /// Area of the surface, scene units squared.
    pub area: f64,
    /// The same with the other overlapping surfaces that continue it without a sharp edge, as the tiles of a terrain do.
    pub joined_area: f64,
    /// Whether it is a flap ([`MIN_CONTINUED`]).
    pub is_flap: bool,
    /// Whether others stand on, or hang from, more than half of its outline, whatever their winding.
    pub has_walls_around: bool,
}

impl Continued {
    /// [`Continued::length`], but 0 for flaps.
    pub fn length_of_walls(&self) -> f32 {
        if self.is_flap { 0.0 } else { self.length }
    }
}

/// How the surfaces of some triangles continue.
pub(super) fn continuations(of: &FxHashSet<u32>, faces: &Faces) -> FxHashMap<u32, Continued> {
    let mut seeds: Vec<u32> = of.iter().copied().collect();
    seeds.sort_unstable();
    let at_edge = edges_of_parts(&seeds, faces);
    let mut known = FxHashSet::default();
    let mut surfaces = Vec::new();
    for seed in seeds {
        if !known.contains(&seed) {
            let surface = surface_around(seed, &at_edge, faces);
            known.extend(surface.triangles.iter().copied());
            surfaces.push(surface);
        }
    }
    let mut joined = add_contacts(&mut surfaces, faces);
    let all: Vec<Continued> = surfaces.iter().map(|surface| surface.continued(faces)).collect();
    let mut areas = vec![0.0; all.len()];
    (0..).zip(&all).for_each(|(k, of)| areas[joined.root(k) as usize] += of.area);
    let of_surface = |(k, surface): (usize, &Surface)| {
        let set = joined.root(k as u32);
        let continued =
            Continued { surface: k as u32, joined: set, joined_area: areas[set as usize], ..all[k] };
        surface.triangles.iter().map(|&t| (t, continued)).collect::<Vec<_>>()
    };
    surfaces.iter().enumerate().flat_map(of_surface).collect()
}

/// The edges of all triangles of the parts of some triangles, ascending, with their triangles.
fn edges_of_parts(seeds: &[u32], faces: &Faces) -> Vec<([u32; 2], u32)> {
    let parts: FxHashSet<u32> = seeds.iter().map(|&t| faces.properties.part(t)).collect();
    let is_of_parts = |t: u32| parts.contains(&faces.properties.part(t));
    let all = 0..if parts.is_empty() { 0 } else { faces.triangles.len() as u32 };
    let with_triangle = |t: u32| edges(faces, t).map(|edge| (edge, t));
    let mut edges =
        parallel::flat_map(all, |t| is_of_parts(t).then(|| with_triangle(t)).into_iter().flatten());
    parallel::sort_by_key(&mut edges, |&([a, b], t)| (u64::from(a) << 32 | u64::from(b), t));
    edges
}

/// The surface of a triangle, and where triangles continue it that share its edges.
fn surface_around(seed: u32, at_edge: &[([u32; 2], u32)], faces: &Faces) -> Surface {
    let mut surface = Surface { triangles: vec![seed], outline: Vec::new() };
    let (mut known, mut next) = (FxHashSet::from_iter([seed]), 0);
    while let Some(&t) = surface.triangles.get(next) {
        next += 1;
        let normal = normal_of(faces, t);
        for ends in edges(faces, t) {
            let length = length(faces, ends);
            let mut edge =
                OutlineEdge { triangle: t, ends, length, before: 0.0, is_touched: false, is_border: true };
            let mut is_inner = false;
            for u in neighbours(at_edge, ends, faces.properties.part(seed), faces) {
                edge.is_border = false;
                if normal_of(faces, u).dot(normal) > MIN_SMOOTH_COSINE {
                    is_inner = true;
                    if known.insert(u) {
                        surface.triangles.push(u);
                    }
                } else {
                    edge.before += side_of(t, u, faces);
                }
            }
            if !is_inner || edge.before != 0.0 {
                surface.outline.push(edge);
            }
        }
    }
    surface
}

/// Middle of an edge on the border of a surface.
struct Middle {
    at: Vec3,
    border: [u32; 2],
    triangle: u32,
    /// Places of the surface in the list and of the edge in its outline.
    place: [usize; 2],
}

/// A border of a surface that lies on an edge of a triangle of another part.
struct Contact {
    /// See [`Middle::place`].
    place: [usize; 2],
    /// 1 if the triangle lies before the surface, -1 behind it, 0 in it or if it continues the surface without a sharp edge.
    side: f32,
    /// Whether it continues the surface without a sharp edge.
    is_smooth: bool,
    /// Whether the order of the corners is consistent.
    is_consistent: bool,
    t: u32,
    edge: [u32; 2],
}

/// Adds the borders that lie on edges of other triangles, for surfaces whose side is undecided: flaps, and those that continue over equal
/// lengths on both sides. They continue at edges without neighbours alone, not at those of closed boxes: a rug as large as the box that it
/// lies on is not a face of the box. Returns the sets of surfaces that continue each other without a sharp edge.
fn add_contacts(surfaces: &mut [Surface], faces: &Faces) -> Sets {
    let mut joined = Sets::new(surfaces.len());
    let alone =
        surfaces.iter().enumerate().filter(|(_, surface)| surface.continued(faces).length_of_walls() == 0.0);
    let middle = |place: [usize; 2], edge: &OutlineEdge| {
        let [p, q] = edge.ends.map(|v| position(faces, v));
        Middle { at: 0.5 * (p + q), border: edge.ends, triangle: edge.triangle, place }
    };
    let of_surface = |(k, surface): (usize, &Surface)| {
        let borders = surface.outline.iter().enumerate().filter(|(_, edge)| edge.is_border);
        borders.map(|(m, edge)| middle([k, m], edge)).collect::<Vec<_>>()
    };
    let mut middles: Vec<Middle> = alone.flat_map(of_surface).collect();
    if middles.is_empty() {
        return joined;
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
    let all = 0..faces.triangles.len() as u32;
    if parallel::map(all.clone(), |t| reached(t).1.len()).into_iter().sum::<usize>() > MAX_TESTS {
        return joined;
    }
    let contacts = |t: u32| {
        let (t, near, bounds) = reached(t);
        let distance = largest_distance(&bounds) as f32;
        let contact = |of: &Middle| {
            let is_near = bounds.distance(of.at) <= distance;
            let touches = |edge: &[u32; 2]| is_near && lies_on(faces, of.at, of.border, *edge, distance);
            let edge = edges(faces, t).into_iter().find(touches)?;
            let is_smooth = normal_of(faces, of.triangle).dot(normal_of(faces, t)) > MIN_SMOOTH_COSINE;
            let side = if is_smooth { 0.0 } else { side_of(of.triangle, t, faces) };
            let is_consistent = cosine(faces, of.border, edge) < MAX_COSINE;
            Some(Contact { place: of.place, side, is_smooth, is_consistent, t, edge })
        };
        near.iter().filter_map(contact).collect::<Vec<_>>()
    };
    let found: Vec<Contact> = parallel::flat_map(all, contacts);
    for &Contact { place: [k, m], side, .. } in &found {
        surfaces[k].outline[m].is_touched |= side != 0.0;
    }
    let found: Vec<Contact> = found.into_iter().filter(|of| of.is_consistent).collect();
    let at_edge = edges_of_parts(&found.iter().map(|of| of.t).collect::<Vec<_>>(), faces);
    let is_open =
        |of: &&Contact| neighbours(&at_edge, of.edge, faces.properties.part(of.t), faces).next().is_none();
    let numbers = (0..).zip(surfaces.iter());
    let surface_of: FxHashMap<u32, u32> =
        numbers.flat_map(|(k, surface)| surface.triangles.iter().map(move |&t| (t, k))).collect();
    for &Contact { place: [k, m], side, is_smooth, t, .. } in found.iter().filter(is_open) {
        surfaces[k].outline[m].before += side;
        if let Some(&other) = surface_of.get(&t).filter(|_| is_smooth) {
            joined.join(k as u32, other);
        }
    }
    joined
}

/// The triangles of a part beyond an edge of one of its triangles, from the edges of its triangles.
fn neighbours<'a>(
    at_edge: &'a [([u32; 2], u32)],
    [v, w]: [u32; 2],
    part: u32,
    faces: &'a Faces,
) -> impl Iterator<Item = u32> + 'a {
    let first = at_edge.partition_point(|(edge, _)| *edge < [w, v]);
    let of_edge = at_edge[first..].iter().take_while(move |(edge, _)| *edge == [w, v]);
    of_edge.map(|&(_, t)| t).filter(move |&t| faces.properties.part(t) == part).take(MAX_AT_EDGE)
}

/// Whether the middle of a border lies on an edge that runs along it.
fn lies_on(faces: &Faces, middle: Vec3, border: [u32; 2], edge: [u32; 2], distance: f32) -> bool {
    let [v, w] = edge.map(|v| position(faces, v));
    let along = (w - v).normalize_or_zero();
    let at = (middle - v).dot(along);
    let is_between = at >= 0.0 && at <= v.distance(w);
    is_between
        && cosine(faces, border, edge).abs() > -MAX_COSINE
        && (middle - v - at * along).length() <= distance
}

/// Cosine of the angle between two edges.
fn cosine(faces: &Faces, edge: [u32; 2], other: [u32; 2]) -> f32 {
    let [a, b] = [edge, other].map(|[v, w]| (position(faces, w) - position(faces, v)).normalize_or_zero());
    a.dot(b)
}

/// 1 if a triangle lies before the plane of another one, -1 behind it, 0 in it; by its corner that is farthest from the plane.
fn side_of(plane: u32, t: u32, faces: &Faces) -> f32 {
    let ([start, ..], normal) = (corners(faces, plane), normal_of(faces, plane));
    let corners = corners(faces, t);
    let distance = largest_distance(&Aabb::of(corners.into_iter().chain([start]))) as f32;
    let heights = corners.map(|p| (p - start).dot(normal));
    let farthest = heights.into_iter().fold(0.0, |far: f32, h| if h.abs() > far.abs() { h } else { far });
    if farthest.abs() > distance { farthest.signum() } else { 0.0 }
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
