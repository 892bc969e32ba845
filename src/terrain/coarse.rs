//! Large grids as fewer triangles: the leaves of a restricted quadtree, smaller where the ground is rough.

use super::Grid;
use super::quadtree::{Node, Quadtree, Side};
use crate::math::parallel;
use glam::Vec3;
use rustc_hash::FxHashMap;
use std::ops::Range;

/// Triangles for each node that is divided, with those that the restriction adds: a divided node has three leaves more, and a leaf has
/// two to three triangles.
const TRIANGLES_PER_SPLIT: usize = 8;

/// Largest rounding error of an interpolated height of a plane, over ε times its largest height. If all heights have one sign, the sample
/// has an error of at most ε/2, each of the two sums ε/2, and the products together 5 ε/2: 8 ε/2.
const ROUNDINGS: f32 = 4.0;

/// Largest side of a piece, cells: Embree's grids have 32,767 at most.
const MAX_PIECE: u32 = 1 << 14;

/// Triangles of the leaves of a quadtree.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Columns and rows of the samples at vertices.
    pub vertices: Vec<[u32; 2]>,
    /// Indices of vertices, counter-clockwise seen from above. Those of a leaf follow each other.
    pub triangles: Vec<[u32; 3]>,
    /// The leaf of each triangle.
    pub leaves: Vec<u32>,
}

/// A rectangle of more than one cell of a grid, with heights at all samples, and the triangles that represent it.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Its first column and row.
    pub first: [u32; 2],
    /// Columns and rows of cells.
    pub cells: [u16; 2],
    /// Its triangles among those of the mesh.
    pub triangles: Range<u32>,
    /// Largest vertical distance of a sample from these triangles, m.
    pub error: f32,
}

/// The triangles and pieces of a grid with about this number of triangles, placed to be nearest to the samples. Cells that are in no
/// piece have two triangles of their own.
pub fn coarse(grid: &Grid, triangles: usize) -> (Mesh, Vec<Piece>) {
    let levels = errors(grid);
    let (mut finite, with_holes): (Vec<f32>, Vec<f32>) =
        levels.iter().flat_map(|level| &level.errors).copied().partition(|error| error.is_finite());
    // Nodes with a hole are divided in any case; the others have half of the triangles or more.
    let wanted = triangles / TRIANGLES_PER_SPLIT;
    let splits = wanted.saturating_sub(with_holes.len()).max(wanted / 2);
    // Even ground is never divided.
    let highest = grid.heights().iter().fold(0.0f32, |most, height| most.max(height.abs()));
    let mut limit = ROUNDINGS * f32::EPSILON * highest;
    if splits < finite.len() {
        limit = finite.select_nth_unstable_by(splits, |a, b| b.total_cmp(a)).1.max(limit);
    }
    let limit = f64::from(limit);
    let error = |node: &Node| {
        if node.size > MAX_PIECE {
            return f64::INFINITY;
        }
        let level = &levels[node.size.trailing_zeros() as usize - 1];
        let [column, row] = node.first.map(|at| (at / node.size) as usize);
        f64::from(level.errors[row * level.columns + column])
    };
    let tree = Quadtree::refine(grid, error, limit);
    let mesh = tree.mesh();
    let mut pieces: Vec<Piece> = Vec::new();
    let mut start = 0;
    for of_leaf in mesh.leaves.chunk_by(|a, b| a == b) {
        let triangles = start..start + of_leaf.len() as u32;
        start = triangles.end;
        let leaf = of_leaf[0] as usize;
        if tree.nodes()[leaf].size > 1 {
            let [[west, east], [north, south]] = tree.samples(leaf);
            let cells = [east - west, south - north].map(|n| n as u16);
            pieces.push(Piece { first: [west as u32, north as u32], cells, triangles, error: 0.0 });
        }
    }
    parallel::for_each_mut(&mut pieces, |_, piece| piece.error = piece.largest_distance(grid, &mesh));
    (mesh, pieces)
}

impl Piece {
    fn largest_distance(&self, grid: &Grid, mesh: &Mesh) -> f32 {
        let corners: Vec<[Vec3; 3]> = self.triangles.clone().map(|t| mesh.corners(grid, t)).collect();
        let flat: Vec<[[f32; 2]; 3]> = corners.iter().map(|c| c.map(|p| [p.x, p.y])).collect();
        let distance = |column: u32, row: u32| {
            let place = [column as f32, row as f32];
            let (t, [a, b, c]) = triangle_at(&flat, place);
            let height = a * corners[t][0].z + b * corners[t][1].z + c * corners[t][2].z;
            (grid.height(column as usize, row as usize) - height).abs()
        };
        let [columns, rows] = [0, 1].map(|k| self.first[k]..=self.first[k] + u32::from(self.cells[k]));
        rows.flat_map(|row| columns.clone().map(move |column| (column, row)))
            .map(|(column, row)| distance(column, row))
            .fold(0.0, f32::max)
    }
}

impl Mesh {
    /// Corners of a triangle: column, row and height.
    fn corners(&self, grid: &Grid, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| {
            let [column, row] = self.vertices[v as usize];
            Vec3::new(column as f32, row as f32, grid.height(column as usize, row as usize))
        })
    }
}

/// Index of the triangle that contains a place, or of the triangle that the place is least outside of, and the barycentric coordinates
/// there.
pub fn triangle_at(triangles: &[[[f32; 2]; 3]], place: [f32; 2]) -> (usize, [f32; 3]) {
    let cross =
        |a: [f32; 2], b: [f32; 2], c: [f32; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    let mut best = (0, [f32::NEG_INFINITY; 3]);
    for (k, &[a, b, c]) in triangles.iter().enumerate() {
        let whole = cross(a, b, c);
        let parts = [cross(place, b, c), cross(a, place, c), cross(a, b, place)].map(|part| part / whole);
        let least = |parts: [f32; 3]| parts.into_iter().fold(f32::INFINITY, f32::min);
        if least(parts) > least(best.1) {
            best = (k, parts);
        }
    }
    best
}

/// Errors of the nodes of one size, row by row.
struct Level {
    columns: usize,
    errors: Vec<f32>,
}

/// For the nodes of two, four, ... cells on a side, the largest vertical distance of a sample on it from its two triangles, or of a node
/// below it from its own; infinite if some samples are holes, 0 if all are.
fn errors(grid: &Grid) -> Vec<Level> {
    let cells = [grid.columns() - 1, grid.rows() - 1];
    let mut levels: Vec<Level> = Vec::new();
    let mut size = 2;
    loop {
        let [columns, rows] = cells.map(|n| n.div_ceil(size));
        let below = levels.last();
        let error = |k: usize| {
            let (column, row) = (k % columns, k / columns);
            let own = error_of_node(grid, [column * size, row * size], size);
            let child = |i: usize, j: usize| {
                let level = below?;
                (i < level.columns).then(|| level.errors.get(j * level.columns + i).copied()).flatten()
            };
            let children = [[0, 0], [1, 0], [0, 1], [1, 1]];
            children.iter().filter_map(|[i, j]| child(2 * column + i, 2 * row + j)).fold(own, f32::max)
        };
        let errors = parallel::map(0..columns * rows, error);
        levels.push(Level { columns, errors });
        if columns * rows == 1 {
            return levels;
        }
        size *= 2;
    }
}

fn error_of_node(grid: &Grid, [west, north]: [usize; 2], size: usize) -> f32 {
    let (east, south) = ((west + size).min(grid.columns() - 1), (north + size).min(grid.rows() - 1));
    let at = |column, row| grid.height(column, row);
    let [nw, ne, sw, se] = [at(west, north), at(east, north), at(west, south), at(east, south)];
    let (across, down) = (1.0 / (east - west) as f32, 1.0 / (south - north) as f32);
    let (mut largest, mut holes) = (0.0f32, 0usize);
    for row in north..=south {
        let y = (row - north) as f32 * down;
        for column in west..=east {
            let x = (column - west) as f32 * across;
            let height = match x + y <= 1.0 {
                true => nw + (ne - nw) * x + (sw - nw) * y,
                false => se + (sw - se) * (1.0 - x) + (ne - se) * (1.0 - y),
            };
            let distance = (at(column, row) - height).abs();
            // The distance is NaN for a hole, and if a corner of the triangle is a hole.
            (largest, holes) = (largest.max(distance), holes + usize::from(distance.is_nan()));
        }
    }
    match holes {
        0 => largest,
        _ if (north..=south).all(|row| (west..=east).all(|column| at(column, row).is_nan())) => 0.0,
        _ => f32::INFINITY,
    }
}

impl Quadtree<'_> {
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
            (Side::SOUTH, [west, south], [middle[0], south], middle[0] < east),
            (Side::EAST, [east, south], [east, middle[1]], middle[1] < south),
            (Side::NORTH, [east, north], [middle[0], north], middle[0] < east),
            (Side::WEST, [west, north], [west, middle[1]], middle[1] < south),
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
