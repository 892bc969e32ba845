//! Triangle mesh with light at its vertices.

use crate::progress::Progress;
use crate::radiosity::mesh::{Element, RadiosityMesh};
use glam::Vec3;
use rayon::prelude::*;
use rustc_hash::FxHashMap;

/// A triangle mesh of all sides of surfaces, with light at the vertices. Vectors have one entry per vertex or per
/// triangle.
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
/// Largest number of halvings of an edge: the largest depth of a quadtree.
const MAX_HALVINGS: u32 = 24;

impl Mesh {
    /// The mesh of a solution.
    #[cfg(test)]
    pub fn new(solution: &RadiosityMesh) -> Mesh {
        Mesh::new_unless(solution, &()).expect("nothing stops it")
    }

    /// The mesh of a solution; none if `progress` has stopped.
    pub fn new_unless(solution: &RadiosityMesh, progress: &dyn Progress) -> Option<Mesh> {
        let go_on = || (!progress.stopped()).then_some(());
        let vertices: FxHashMap<[u32; 3], u32> =
            solution.vertices.iter().enumerate().map(|(i, &p)| (bits(p), i as u32)).collect();
        let normals: Vec<Vec3> = solution.elements.par_iter().map(|e| normal(solution, e)).collect();
        let outlined = |e| go_on().map(|()| outline(solution, &vertices, e));
        let outlines: Vec<Vec<u32>> = solution.elements.par_iter().map(outlined).collect::<Option<_>>()?;
        let around = Around::new(solution.vertices.len(), &outlines);
        // By element the irradiance at the vertices of its outline.
        let light_of = |(outline, &normal): (&Vec<u32>, &Vec3)| -> Option<Vec<[f32; 3]>> {
            go_on()?;
            Some(outline.iter().map(|&v| mean(solution, &normals, normal, around.of(v))).collect())
        };
        let light: Vec<Vec<[f32; 3]>> =
            outlines.par_iter().zip(&normals).map(light_of).collect::<Option<_>>()?;
        let mut out = Builder::default();
        for (e, (element, outline)) in solution.elements.iter().zip(&outlines).enumerate() {
            go_on()?;
            let ring: Vec<u32> = outline
                .iter()
                .zip(&light[e])
                .map(|(&v, &light)| out.vertex(solution.vertices[v as usize], normals[e], light, element))
                .collect();
            match ring[..] {
                [a, b, c] => out.triangle([a, b, c], e),
                [a, b, c, d] if !element.is_triangle() => {
                    out.triangle([a, b, c], e);
                    out.triangle([a, c, d], e);
                }
                _ => {
                    let corners = &element.corners[..if element.is_triangle() { 3 } else { 4 }];
                    let sum: Vec3 = corners.iter().map(|&v| solution.vertices[v as usize]).sum();
                    let irradiance = element.irradiance.map(|x| x as f32);
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

/// Vertices along an element's edges: its corners and the vertices of smaller neighbours.
fn outline(solution: &RadiosityMesh, vertices: &FxHashMap<[u32; 3], u32>, e: &Element) -> Vec<u32> {
    let corners = &e.corners[..if e.is_triangle() { 3 } else { 4 }];
    let mut out = Vec::with_capacity(corners.len());
    for (k, &a) in corners.iter().enumerate() {
        out.push(a);
        halves(solution, vertices, a, corners[(k + 1) % corners.len()], MAX_HALVINGS, &mut out);
    }
    out
}

/// Appends the vertices between two positions, found by halving: elements are split at the middles of their edges.
fn halves(
    solution: &RadiosityMesh,
    vertices: &FxHashMap<[u32; 3], u32>,
    a: u32,
    b: u32,
    depth: u32,
    out: &mut Vec<u32>,
) {
    let (p, q) = (solution.vertices[a as usize], solution.vertices[b as usize]);
    let Some(&m) = vertices.get(&bits(0.5 * (p + q))).filter(|&&m| m != a && m != b && depth > 0) else {
        return;
    };
    halves(solution, vertices, a, m, depth - 1, out);
    out.push(m);
    halves(solution, vertices, m, b, depth - 1, out);
}

/// Elements around each vertex.
struct Around {
    first: Vec<u32>,
    elements: Vec<u32>,
}

impl Around {
    fn new(vertices: usize, outlines: &[Vec<u32>]) -> Around {
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
        Around { first, elements }
    }

    fn of(&self, vertex: u32) -> &[u32] {
        &self.elements[self.first[vertex as usize] as usize..self.first[vertex as usize + 1] as usize]
    }
}

/// Mean irradiance of the elements that face along `normal`, weighted by the distance of their centres.
fn mean(solution: &RadiosityMesh, normals: &[Vec3], normal: Vec3, around: &[u32]) -> [f32; 3] {
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for &e in around.iter().filter(|&&e| normals[e as usize].dot(normal) >= MIN_SMOOTH_COSINE) {
        let element = &solution.elements[e as usize];
        let weight = 1.0 / element.area.sqrt();
        weights += weight;
        sum.iter_mut().zip(element.irradiance).for_each(|(s, x)| *s += weight * x);
    }
    sum.map(|s| if weights > 0.0 { (s / weights) as f32 } else { 0.0 })
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
        let radiosity: [f32; 3] =
            std::array::from_fn(|c| element.exitance[c] as f32 + element.albedo[c] * irradiance[c]);
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
