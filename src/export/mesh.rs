//! Triangle mesh with light at its vertices.

use crate::math::Sets;
use crate::math::parallel;
use crate::progress::Progress;
use crate::radiosity::mesh::{Element, RadiosityMesh};
use glam::{DVec3, Vec3};
use rayon::slice::ParallelSliceMut;
use rustc_hash::FxHashMap;
use smallvec::SmallVec;
use std::array::from_fn;
use std::f32::consts::PI;

/// A triangle mesh of all sides of surfaces, with light at the vertices. Vectors have one entry per vertex or per triangle.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Positions relative to [`RadiosityMesh::origin`], scene units.
    pub positions: Vec<Vec3>,
    /// Unit normals of the lit side.
    pub normals: Vec<Vec3>,
    /// Irradiance, W/m².
    pub irradiance: Vec<[f32; 3]>,
    /// Radiosity (emission and reflected light), W/m².
    pub radiosity: Vec<[f32; 3]>,
    /// Vertices counterclockwise as seen from the lit side.
    pub triangles: Vec<[u32; 3]>,
    /// Index of the element of each triangle.
    pub element: Vec<u32>,
}

/// Smallest cosine between normals of elements of one smooth surface: 26 degrees, between the 20 and 30 degrees of
/// edges of round columns with 18 and 12 sides.
const MIN_SMOOTH_COSINE: f32 = 0.9;
/// Smallest sum of the angles of elements that surround a vertex, radians: between those at a corner of two walls, 3/2 π, and on a plane.
const MIN_ANGLE_AROUND: f32 = 1.75 * PI;
/// Relative difference of light that an 8-bit picture does not show.
const VISIBLE_STEP: f64 = 1.0 / 255.0;
/// Largest number of passes of the search for vertices of neighbours on edges. The second finds those on edges of which the first has found
/// an end; in the scenes tried the third finds none.
const MAX_OUTLINE_PASSES: usize = 4;

impl Mesh {
    /// The mesh of a solution.
    #[cfg(test)]
    pub fn new(solution: &RadiosityMesh) -> Mesh {
        Mesh::new_unless(solution, &()).expect("nothing stops it")
    }

    /// The mesh of a solution; none if `progress` has stopped.
    pub fn new_unless(solution: &RadiosityMesh, progress: &dyn Progress) -> Option<Mesh> {
        let go_on = || (!progress.stopped()).then_some(());
        let normals: Vec<Vec3> = parallel::map(&solution.elements, |e| normal(solution, e));
        let outlines = outlines(solution, &go_on)?;
        let around = VertexElements::new(solution.vertices.len(), &outlines);
        let at_outlines = at_outlines(solution, &normals, &outlines, &around, &go_on)?;
        let mut out = Builder::default();
        for (e, (element, outline)) in solution.elements.iter().zip(&outlines).enumerate() {
            go_on()?;
            let vertex = |(&v, &irradiance): (&u32, &[f32; 3])| {
                out.vertex(solution.vertices[v as usize], normals[e], irradiance, element)
            };
            let ring: Vec<u32> = outline.iter().zip(&at_outlines[e]).map(vertex).collect();
            match ring[..] {
                [a, b, c] => out.triangle([a, b, c], e),
                [a, b, c, d] if !element.is_triangle() => {
                    out.triangle([a, b, c], e);
                    out.triangle([a, c, d], e);
                }
                [] | [_] | [_, _] => {}
                _ => {
                    let corners = element.outline();
                    let sum: Vec3 = corners.iter().map(|&v| solution.vertices[v as usize]).sum();
                    let irradiance = match element.crossed {
                        true => centroid(&at_outlines[e]),
                        false => element.irradiance.map(|x| x as f32),
                    };
                    let centre = out.vertex(sum / corners.len() as f32, normals[e], irradiance, element);
                    for k in 0..ring.len() {
                        out.triangle([centre, ring[k], ring[(k + 1) % ring.len()]], e);
                    }
                }
            }
        }
        Some(out.mesh)
    }

    /// The corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }
}

fn bits(p: Vec3) -> [u32; 3] {
    // −0 and +0 are one position.
    (p + Vec3::ZERO).to_array().map(f32::to_bits)
}

fn normal(solution: &RadiosityMesh, e: &Element) -> Vec3 {
    let [a, b, c, d] = e.corners.map(|v| solution.vertices[v as usize].as_dvec3());
    (c - a).cross(d - b).normalize_or_zero().as_vec3()
}

/// The vertices along the edges of each element: its corners, and the vertices of smaller neighbours and of neighbours that were cut there;
/// none if `go_on` returns none.
fn outlines(solution: &RadiosityMesh, go_on: &(impl Fn() -> Option<()> + Sync)) -> Option<Vec<Vec<u32>>> {
    let mut outlines: Vec<Vec<u32>> = solution.elements.iter().map(|e| e.outline().to_vec()).collect();
    join_twins(solution, &mut outlines);
    for _ in 0..MAX_OUTLINE_PASSES {
        let edges = Edges::of(solution, &outlines);
        let longer = |outline: &Vec<u32>| go_on().map(|()| edges.outline(solution, outline));
        let found: Vec<Vec<u32>> = parallel::some_map(&outlines, longer)?;
        let is_same = found.iter().zip(&outlines).all(|(new, old)| new.len() == old.len());
        outlines = found;
        if is_same {
            break;
        }
    }
    Some(outlines)
}

/// Replaces vertices that differ by rounding by the first of them, as those of two neighbours that were cut along one plane. They are ends
/// of edges from one vertex.
fn join_twins(solution: &RadiosityMesh, outlines: &mut [Vec<u32>]) {
    let edges = Edges::of(solution, outlines);
    let place = |v: u32| solution.vertices[v as usize];
    let twins_beside = |v: u32| {
        let mut ends: SmallVec<[u32; 8]> = SmallVec::from_slice(edges.ends_of(v));
        ends.sort_by(|&a, &b| place(a).x.total_cmp(&place(b).x));
        let mut found: SmallVec<[[u32; 2]; 2]> = SmallVec::new();
        for (k, &a) in ends.iter().enumerate() {
            let [own, all] = [place(a), place(a).abs().max(place(v).abs())].map(rounding);
            let near = ends[k + 1..].iter().take_while(|b| place(**b).x - place(a).x <= all);
            // The end of an edge from `a` is another corner of an element, except within rounding of `a` itself.
            let limit = |b: u32| if edges.ends_of(a).contains(&b) { own } else { all };
            found.extend(near.filter(|b| place(**b).distance(place(a)) <= limit(**b)).map(|&b| [a, b]));
        }
        found
    };
    let count = solution.vertices.len() as u32;
    let found: Vec<[u32; 2]> = parallel::flat_map(0..count, twins_beside);
    if found.is_empty() {
        return;
    }
    let mut sets = Sets::new(count as usize);
    found.into_iter().for_each(|[a, b]| sets.join(a, b));
    for outline in outlines {
        outline.iter_mut().for_each(|v| *v = sets.root(*v));
        outline.dedup();
        if outline.len() > 1 && outline.first() == outline.last() {
            outline.pop();
        }
    }
}

/// Largest distance of places that differ by rounding of a few operations, scene units.
fn rounding(place: Vec3) -> f32 {
    4.0 * f32::EPSILON * place.abs().max_element()
}

/// The edges of all elements, to find the vertices of neighbours on an edge.
struct Edges {
    /// By vertex, where its entries in `ends` begin.
    first: Vec<u32>,
    /// The other ends of the edges at each vertex.
    ends: Vec<u32>,
}

impl Edges {
    fn of(solution: &RadiosityMesh, outlines: &[Vec<u32>]) -> Edges {
        let both_ways = |outline: &Vec<u32>| {
            let edge = |k: usize| [outline[k], outline[(k + 1) % outline.len()]].map(u64::from);
            let packed = |[a, b]: [u64; 2]| [a << 32 | b, b << 32 | a];
            (0..outline.len()).map(edge).flat_map(packed).collect::<SmallVec<[_; 8]>>()
        };
        let mut edges: Vec<u64> = parallel::flat_map(outlines, both_ways);
        edges.par_sort_unstable();
        edges.dedup();
        let first = |v: u32| edges.partition_point(|edge| edge >> 32 < u64::from(v)) as u32;
        let first = parallel::map(0..solution.vertices.len() as u32 + 1, first);
        Edges { first, ends: edges.into_iter().map(|edge| edge as u32).collect() }
    }

    /// The other ends of the edges at a vertex.
    fn ends_of(&self, v: u32) -> &[u32] {
        &self.ends[self.first[v as usize] as usize..self.first[v as usize + 1] as usize]
    }

    /// An outline with the vertices of neighbours between its own ones.
    fn outline(&self, solution: &RadiosityMesh, outline: &[u32]) -> Vec<u32> {
        let mut longer = Vec::with_capacity(outline.len());
        for (k, &a) in outline.iter().enumerate() {
            longer.push(a);
            self.add_between(solution, [a, outline[(k + 1) % outline.len()]], &mut longer);
        }
        longer
    }

    /// Appends the vertices between the ends of an edge that other edges along it join with these.
    fn add_between(&self, solution: &RadiosityMesh, [a, b]: [u32; 2], outline: &mut Vec<u32>) {
        let place = |v: u32| solution.vertices[v as usize].as_dvec3();
        let (from, along) = (place(a), place(b) - place(a));
        let ends = [a, b].map(|v| solution.vertices[v as usize].abs());
        let rounding = f64::from(rounding(ends[0].max(ends[1])));
        let mut found: SmallVec<[(f64, u32); 8]> = SmallVec::new();
        let mut next: SmallVec<[u32; 8]> = SmallVec::from_slice(&[a, b]);
        while let Some(v) = next.pop() {
            for &w in self.ends_of(v) {
                let part = (place(w) - from).dot(along) / along.length_squared();
                let distance = (place(w) - from - part * along).length();
                let is_between = part > 0.0 && part < 1.0 && distance <= rounding;
                if is_between && w != a && w != b && !found.iter().any(|of| of.1 == w) {
                    found.push((part, w));
                    next.push(w);
                }
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        outline.extend(found.into_iter().map(|of| of.1));
    }
}

/// Elements around each vertex.
struct VertexElements {
    first: Vec<u32>,
    elements: Vec<u32>,
}

impl VertexElements {
    fn new(vertices: usize, outlines: &[Vec<u32>]) -> VertexElements {
        let mut first = vec![0u32; vertices + 1];
        outlines.iter().flatten().for_each(|&v| first[v as usize + 1] += 1);
        (0..vertices).for_each(|v| first[v + 1] += first[v]);
        let mut next = first.clone();
        let mut elements = vec![0; first[vertices] as usize];
        for (e, outline) in outlines.iter().enumerate() {
            for &v in outline {
                elements[next[v as usize] as usize] = e as u32;
                next[v as usize] += 1;
            }
        }
        VertexElements { first, elements }
    }

    fn of(&self, vertex: u32) -> &[u32] {
        &self.elements[self.first[vertex as usize] as usize..self.first[vertex as usize + 1] as usize]
    }
}

/// Irradiance at the vertices along each element's outline, W/m²; none if `go_on` returns none.
///
/// A vertex has the mean of the elements around it. Interpolation between such means flattens light: at the edge of a wall the value of a
/// vertex lies half an element away from it. So each vertex is corrected by the mean of what its elements lack: the difference between an
/// element's irradiance and the mean of its vertices (one step of van Cittert's iteration), and inside a surface kept between the light of
/// the elements around it. Where an element still lacks more than its uncertainty, as at the edge of a shadow, those of its vertices that
/// are darker than itself get closer to its own light, or the brighter ones if it has too much; light is not continuous there. The vertices
/// of elements that another surface stands across have the light of their neighbours, on either side of it, times what the elements lack.
fn at_outlines(
    solution: &RadiosityMesh,
    normals: &[Vec3],
    outlines: &[Vec<u32>],
    around: &VertexElements,
    go_on: &(impl Fn() -> Option<()> + Sync),
) -> Option<Vec<Vec<[f32; 3]>>> {
    let means = |values: &[[f64; 3]]| -> Option<Vec<Vec<[f64; 3]>>> {
        let of = |e: usize| {
            go_on()?;
            Some(
                outlines[e]
                    .iter()
                    .map(|&v| mean(solution, values, normals, e as u32, v, around.of(v)))
                    .collect(),
            )
        };
        parallel::some_map(0..outlines.len(), of)
    };
    let weights: Vec<Vec<f64>> =
        solution.elements.iter().zip(outlines).map(|(e, outline)| weights(solution, e, outline)).collect();
    let of_elements: Vec<[f64; 3]> = solution.elements.iter().map(|e| e.irradiance).collect();
    let mut found = means(&of_elements)?;
    let lacks = lacking(solution, &weights, &found);
    let corrections = means(&lacks)?;
    let correct = |e: usize, at: &mut Vec<[f64; 3]>| {
        for (k, v) in at.iter_mut().enumerate() {
            let vertex = outlines[e][k];
            let range =
                range_inside(solution, normals, outlines, &lacks, [e as u32, vertex], around.of(vertex));
            *v = from_fn(|c| {
                let corrected = (v[c] + corrections[e][k][c]).max(0.0);
                range.map_or(corrected, |[low, high]| corrected.clamp(low[c].min(v[c]), high[c].max(v[c])))
            });
        }
    };
    parallel::for_each_mut(&mut found, correct);
    let lacks = lacking(solution, &weights, &found);
    let is_dark = |e: u32| solution.elements[e as usize].irradiance == [0.0; 3];
    // An element without light beside others without light lies behind a wall. A single one has met no light by chance.
    let is_behind = |e: usize| {
        let beside = |&v: &u32| count_at(solution, normals, e as u32, v, around.of(v));
        is_dark(e as u32)
            && outlines[e].iter().flat_map(beside).any(|other| other != e as u32 && is_dark(other))
    };
    let with_own_light = |e: usize, at: &mut Vec<[f64; 3]>| match is_behind(e) {
        true => at.iter_mut().for_each(|v| *v = [0.0; 3]),
        false => (0..3).for_each(|c| approach(&solution.elements[e], c, lacks[e][c], &weights[e], at)),
    };
    parallel::for_each_mut(&mut found, with_own_light);
    Some(found.into_iter().map(|at| at.into_iter().map(|v| v.map(|v| v as f32)).collect()).collect())
}

/// Smallest and largest light at a vertex inside a surface: that of the elements that [`count_at`] it, and beyond it what all of these lack
/// alike, as at a peak. None where the elements do not surround the vertex: at the edges of surfaces light may be beyond theirs.
fn range_inside(
    solution: &RadiosityMesh,
    normals: &[Vec3],
    outlines: &[Vec<u32>],
    lacks: &[[f64; 3]],
    [element, vertex]: [u32; 2],
    around: &[u32],
) -> Option<[[f64; 3]; 2]> {
    let (mut low, mut high, mut angle) = ([f64::INFINITY; 3], [0.0; 3], 0.0);
    let (mut least, mut most) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for e in count_at(solution, normals, element, vertex, around) {
        let (light, lacks) = (solution.elements[e as usize].irradiance, lacks[e as usize]);
        for c in 0..3 {
            (low[c], high[c]) = (light[c].min(low[c]), light[c].max(high[c]));
            (least[c], most[c]) = (lacks[c].min(least[c]), lacks[c].max(most[c]));
        }
        angle += angle_at(solution, &outlines[e as usize], vertex);
    }
    let range = [from_fn(|c| low[c] + most[c].min(0.0)), from_fn(|c| high[c] + least[c].max(0.0))];
    (angle > MIN_ANGLE_AROUND).then_some(range)
}

/// Angle of an outline at one of its vertices, radians.
fn angle_at(solution: &RadiosityMesh, outline: &[u32], vertex: u32) -> f32 {
    let n = outline.len();
    let place = |k: usize| solution.vertices[outline[k % n] as usize];
    let at = |k: usize| (place(k + n - 1) - place(k)).angle_between(place(k + 1) - place(k));
    outline.iter().position(|&v| v == vertex).map_or(0.0, at)
}

/// Changes the vertices of an element in one channel so that their mean lacks no more of the element's light than its uncertainty.
fn approach(e: &Element, c: usize, lacks: f64, weights: &[f64], at: &mut [[f64; 3]]) {
    let own = e.irradiance[c];
    let beyond = lacks.abs() - e.error[c].max(VISIBLE_STEP * own);
    if beyond <= 0.0 {
        return;
    }
    if e.crossed {
        let mean = own - lacks;
        // What is dark on one side of another surface stays dark.
        let factor = if mean > 0.0 { 1.0 + beyond.copysign(lacks) / mean } else { 1.0 };
        at.iter_mut().for_each(|v| v[c] *= factor);
        return;
    }
    let missing = |v: f64| if lacks > 0.0 { (own - v).max(0.0) } else { (own - v).min(0.0) };
    let all: f64 = at.iter().zip(weights).map(|(v, w)| w * missing(v[c]).abs()).sum();
    let part = (beyond / all.max(f64::MIN_POSITIVE)).min(1.0);
    at.iter_mut().for_each(|v| v[c] += part * missing(v[c]));
}

/// The irradiance of each element less the mean of the mesh over it, W/m². The vertex in the middle of an element with smaller
/// neighbours has the element's own light and does not count.
fn lacking(solution: &RadiosityMesh, weights: &[Vec<f64>], at_outlines: &[Vec<[f64; 3]>]) -> Vec<[f64; 3]> {
    let of = |((e, weights), at): ((&Element, &Vec<f64>), &Vec<[f64; 3]>)| {
        let lacks = |c: usize| e.irradiance[c] - weights.iter().zip(at).map(|(w, v)| w * v[c]).sum::<f64>();
        from_fn(lacks)
    };
    solution.elements.iter().zip(weights).zip(at_outlines).map(of).collect()
}

/// The weight of each vertex of an outline in the mean of linear interpolation over the element's triangles: the area of the triangles at
/// the vertex.
fn weights(solution: &RadiosityMesh, element: &Element, outline: &[u32]) -> Vec<f64> {
    let place = |k: usize| solution.vertices[outline[k % outline.len()] as usize].as_dvec3();
    let area = |a: DVec3, b: DVec3, c: DVec3| (b - a).cross(c - a).length();
    let sums: Vec<f64> = match outline.len() {
        3 => return vec![1.0 / 3.0; 3],
        4 if !element.is_triangle() => {
            let (first, second) = (area(place(0), place(1), place(2)), area(place(0), place(2), place(3)));
            vec![first + second, first, first + second, second]
        }
        n => {
            let corners = element.outline();
            let sum: DVec3 = corners.iter().map(|&v| solution.vertices[v as usize].as_dvec3()).sum();
            let centre = sum / corners.len() as f64;
            let parts: Vec<f64> = (0..n).map(|k| area(centre, place(k), place(k + 1))).collect();
            (0..n).map(|k| parts[k] + parts[(k + n - 1) % n]).collect()
        }
    };
    let all: f64 = sums.iter().sum();
    sums.iter().map(|s| if all > 0.0 { s / all } else { 1.0 / sums.len() as f64 }).collect()
}

fn centroid(values: &[[f32; 3]]) -> [f32; 3] {
    from_fn(|c| values.iter().map(|v| v[c]).sum::<f32>() / values.len() as f32)
}

/// Distance of a vertex from a wall, relative to the root of the area of its elements, up to which the wall parts them: elements that a
/// wall crosses farther than 1/128 of their diameter from their corners are cut along it (`radiosity::refinement::crossings`).
const NEAR_WALL: f32 = 1.0 / 64.0;

/// A wall along an edge of an element.
struct WalledEdge {
    element: u32,
    /// The ends of the edge, counterclockwise around the element.
    ends: [Vec3; 2],
}

/// Whether a wall passes between two elements at a vertex that it meets or passes near. At the end of a wall, elements beyond it that it
/// does not touch share their light.
fn is_between(
    solution: &RadiosityMesh,
    wall: &WalledEdge,
    elements: [u32; 2],
    vertex: u32,
    normal: Vec3,
) -> bool {
    let place = |v: u32| solution.vertices[v as usize];
    let [from, to] = wall.ends;
    let [a, b] = elements.map(|e| {
        let e = &solution.elements[e as usize];
        let middle = e.corners.iter().map(|&v| place(v)).sum::<Vec3>() / 4.0;
        ((to - from).cross(middle - from).dot(normal), e.area.sqrt() as f32)
    });
    let (at, along) = (place(vertex), to - from);
    let part = ((at - from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    let rounding = rounding(from.abs().max(to.abs()));
    let is_end = || wall.ends.iter().any(|end| end.distance(at) <= rounding);
    a.0 * b.0 < 0.0
        && at.distance(from + part * along) <= rounding + NEAR_WALL * a.1.max(b.1)
        && (elements.contains(&wall.element) || !is_end())
}

/// The walls along the edges of some elements.
fn walls_of(solution: &RadiosityMesh, elements: &[u32]) -> SmallVec<[WalledEdge; 4]> {
    let place = |v: u32| solution.vertices[v as usize];
    let mut found = SmallVec::new();
    for &element in elements.iter().filter(|&&e| solution.elements[e as usize].walls != 0) {
        let e = &solution.elements[element as usize];
        let corners = e.outline();
        let edges = (0..corners.len()).filter(|k| e.walls >> k & 1 != 0);
        let ends = |k: usize| [place(corners[k]), place(corners[(k + 1) % corners.len()])];
        found.extend(edges.map(|k| WalledEdge { element, ends: ends(k) }));
    }
    found
}

/// The elements around a vertex of an element that face along its normal and whose light continues at the vertex. Elements that other
/// surfaces stand across, and sides that no light reaches, count only beside no others, and those beyond a wall not at all. Elements in a
/// gap narrower than themselves and those beside it do not count for each other.
fn count_at(
    solution: &RadiosityMesh,
    normals: &[Vec3],
    element: u32,
    vertex: u32,
    around: &[u32],
) -> SmallVec<[u32; 8]> {
    let normal = normals[element as usize];
    let faces = |e: u32| normals[e as usize].dot(normal) >= MIN_SMOOTH_COSINE;
    let mut found: SmallVec<[u32; 8]> = around.iter().copied().filter(|&e| faces(e)).collect();
    let walls = walls_of(solution, &found);
    let is_narrow = |e: u32| solution.elements[e as usize].narrow;
    let beyond = |e: u32| walls.iter().any(|wall| is_between(solution, wall, [element, e], vertex, normal));
    found.retain(|e| *e == element || is_narrow(*e) == is_narrow(element) && !beyond(*e));
    let counts = |e: u32| !solution.elements[e as usize].crossed && (e as usize) < solution.lit();
    if found.iter().any(|&e| counts(e)) {
        found.retain(|e| counts(*e));
    }
    found
}

/// Mean at a vertex of an element of the values of the elements that [`count_at`] it, weighted by the distance of their centres.
fn mean(
    solution: &RadiosityMesh,
    values: &[[f64; 3]],
    normals: &[Vec3],
    element: u32,
    vertex: u32,
    around: &[u32],
) -> [f64; 3] {
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for e in count_at(solution, normals, element, vertex, around) {
        let weight = 1.0 / solution.elements[e as usize].area.sqrt();
        weights += weight;
        sum.iter_mut().zip(values[e as usize]).for_each(|(s, x)| *s += weight * x);
    }
    sum.map(|s| if weights > 0.0 { s / weights } else { 0.0 })
}

/// Vertices with equal position, normal and light are merged.
type Key = ([u32; 3], [u32; 3], [u32; 3]);

#[derive(Default)]
struct Builder {
    mesh: Mesh,
    known: FxHashMap<Key, u32>,
}

impl Builder {
    fn vertex(&mut self, position: Vec3, normal: Vec3, irradiance: [f32; 3], element: &Element) -> u32 {
        let radiosity: [f32; 3] = from_fn(|c| element.exitance[c] as f32 + element.albedo[c] * irradiance[c]);
        let mesh = &mut self.mesh;
        *self.known.entry((bits(position), bits(normal), radiosity.map(f32::to_bits))).or_insert_with(|| {
            mesh.positions.push(position);
            mesh.normals.push(normal);
            mesh.irradiance.push(irradiance);
            mesh.radiosity.push(radiosity);
            mesh.positions.len() as u32 - 1
        })
    }

    fn triangle(&mut self, corners: [u32; 3], element: usize) {
        self.mesh.triangles.push(corners);
        self.mesh.element.push(element as u32);
    }
}
