//! Shapes of the nodes of a quadtree, and triangles of its leaves without cracks.

use super::{Grid, Quadtree, Side};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

/// Size and directions of the surface of a node: of all triangles of the grid in it, whatever the level.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Area of the surface, m²; 0 if all of the node is a hole.
    pub area: f64,
    /// Mean normal, a unit vector.
    pub axis: Vec3,
    /// Largest angle between the axis and a normal, radians.
    pub half_angle: f32,
    /// Lowest corner of the box around the surface, m.
    pub low: DVec3,
    /// Highest corner.
    pub high: DVec3,
    /// ∫ n dA, m².
    vector: DVec3,
}

impl Shape {
    const EMPTY: Shape = Shape {
        area: 0.0,
        axis: Vec3::Z,
        half_angle: 0.0,
        low: DVec3::INFINITY,
        high: DVec3::NEG_INFINITY,
        vector: DVec3::ZERO,
    };

    /// The shape of all children; their cones bound the cone.
    fn around(children: &[Shape]) -> Shape {
        let mut out = Shape::EMPTY;
        for child in children.iter().filter(|c| c.area > 0.0) {
            out.area += child.area;
            out.vector += child.vector;
            out.low = out.low.min(child.low);
            out.high = out.high.max(child.high);
        }
        out.axis = out.vector.normalize_or(DVec3::Z).as_vec3();
        for child in children.iter().filter(|c| c.area > 0.0) {
            out.half_angle = out.half_angle.max(out.axis.angle_between(child.axis) + child.half_angle);
        }
        out
    }

    /// The shape of the cells between columns and rows.
    fn of_cells(grid: &Grid, [columns, rows]: [[usize; 2]; 2]) -> Shape {
        let mut out = Shape::EMPTY;
        let triangles = || {
            (rows[0]..rows[1]).flat_map(move |r| {
                (columns[0]..columns[1]).flat_map(move |c| {
                    let at = |i: usize, j: usize| grid.position(c + i, r + j);
                    [[at(0, 1), at(1, 1), at(1, 0)], [at(0, 1), at(1, 0), at(0, 0)]]
                })
            })
        };
        let normal = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a);
        for corners in triangles().filter(|t| t.iter().all(|p| p.is_finite())) {
            let vector = normal(corners);
            out.area += vector.length();
            out.vector += vector;
            for corner in corners {
                (out.low, out.high) = (out.low.min(corner), out.high.max(corner));
            }
        }
        out.axis = out.vector.normalize_or(DVec3::Z).as_vec3();
        for corners in triangles().filter(|t| t.iter().all(|p| p.is_finite())) {
            out.half_angle = out.half_angle.max(out.axis.angle_between(normal(corners).as_vec3()));
        }
        out
    }
}

/// Triangles of the leaves of a quadtree.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Columns and rows of the samples at vertices.
    pub vertices: Vec<[u32; 2]>,
    /// Indices of vertices, counter-clockwise seen from above.
    pub triangles: Vec<[u32; 3]>,
    /// The leaf of each triangle.
    pub leaves: Vec<u32>,
}

impl Quadtree<'_> {
    /// Shapes of all nodes; those beyond the grid and of holes have no area.
    pub fn shapes(&self) -> Vec<Shape> {
        let of_leaf = |i: usize| match self.nodes()[i].is_leaf() && self.is_on_grid(i) {
            true => Shape::of_cells(self.grid(), self.samples(i)),
            false => Shape::EMPTY,
        };
        let mut shapes: Vec<Shape> = (0..self.nodes().len()).into_par_iter().map(of_leaf).collect();
        // Children come after their parents.
        for i in (0..shapes.len()).rev() {
            if let Some(children) = self.children(i) {
                shapes[i] = Shape::around(&children.map(|c| shapes[c]));
            }
        }
        shapes
    }

    /// Triangles of all leaves. Where the leaves across an edge are smaller, the leaf has a vertex in the middle of the edge, so
    /// that no edge has a crack. Triangles with a corner in a hole are left out.
    pub fn mesh(&self) -> Mesh {
        let mut mesh = Mesh::default();
        let mut known = FxHashMap::default();
        for leaf in self.leaves() {
            let (polygon, apex) = self.outline(leaf);
            let n = polygon.len();
            for i in 1..n - 1 {
                let corners = [0, i, i + 1].map(|k| polygon[(apex + k) % n]);
                if corners.iter().any(|&[c, r]| self.grid().height(c as usize, r as usize).is_nan()) {
                    continue;
                }
                let index = corners.map(|corner| {
                    *known.entry(corner).or_insert_with(|| {
                        mesh.vertices.push(corner);
                        mesh.vertices.len() as u32 - 1
                    })
                });
                mesh.triangles.push(index);
                mesh.leaves.push(leaf as u32);
            }
        }
        mesh
    }

    /// Vertices around a leaf, counter-clockwise, and the one that all its triangles share: a vertex in the middle of an edge if
    /// there is one, because no other edge is in line with it; else the south-west corner, as in the grid's own triangles.
    fn outline(&self, leaf: usize) -> (Vec<[u32; 2]>, usize) {
        let [[west, east], [north, south]] = self.samples(leaf).map(|side| side.map(|v| v as u32));
        let node = self.nodes()[leaf];
        let half = node.size / 2;
        let middle = [node.first[0] + half, node.first[1] + half];
        let mut polygon = Vec::with_capacity(8);
        let mut apex = 0;
        let sides = [
            (Side::South, [west, south], [middle[0], south], middle[0] < east),
            (Side::East, [east, south], [east, middle[1]], middle[1] < south),
            (Side::North, [east, north], [middle[0], north], middle[0] < east),
            (Side::West, [west, north], [west, middle[1]], middle[1] < south),
        ];
        for (side, corner, between, is_inside) in sides {
            polygon.push(corner);
            let is_split = || self.neighbour(leaf, side).is_some_and(|a| !self.nodes()[a].is_leaf());
            if half > 0 && is_inside && is_split() {
                apex = polygon.len();
                polygon.push(between);
            }
        }
        (polygon, apex)
    }
}
