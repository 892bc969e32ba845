//! The k-d tree of Sillion 94 with clusters that fill their cells.
//!
//! The builder of [`mrvis::internals::clusters`] fits boxes to their contents, which mends much of what the paper found missing: in a
//! cell most of a desk's extinction is spread over air.

use mrvis::Scene;
use mrvis::internals::SceneParts;
use mrvis::internals::clusters::{Cluster, FAN_OUT, Tree};
use mrvis::internals::math::Aabb;

/// Number of halvings, at most: 20 an axis.
const MAX_HALVINGS: usize = 60;

/// A cell with what it holds.
struct Cell {
    bounds: Aabb,
    parent: usize,
    faces: Vec<u32>,
    halvings: usize,
    /// What a plane cut out of its parent: not divided.
    is_cut: bool,
}

/// The tree over some triangles of a scene, as we read [Sillion 94]: cells are halved in the middle of their longest edge until they hold at most
/// [`FAN_OUT`] triangles; what the plane cuts becomes a cell that is not divided, so that leaves may hold more triangles
/// than that.
pub fn cell_tree(scene: &Scene, faces: &[u32]) -> Tree {
    let bounds = |faces: &[u32]| Aabb::of(faces.iter().flat_map(|&t| scene.corners(t)));
    let first = Cell { bounds: bounds(faces), parent: 0, faces: faces.to_vec(), halvings: 0, is_cut: false };
    let mut cells = vec![first];
    let mut tree = Tree::default();
    while let Some(cell) = cells.get(tree.clusters.len()) {
        let (here, first_child) = (tree.clusters.len(), cells.len() as u32);
        let divides = cell.faces.len() > FAN_OUT && !cell.is_cut && cell.halvings < MAX_HALVINGS;
        let children = if divides { halves(scene, cell, here) } else { Vec::new() };
        tree.clusters.push(Cluster {
            bounds: cell.bounds,
            parent: cell.parent as u32,
            first_child: if children.is_empty() { 0 } else { first_child },
            children: children.len() as u32,
            first_triangle: 0,
            triangles: cell.faces.len() as u32,
        });
        cells.extend(children);
    }
    // Triangles leaf by leaf in depth-first order.
    let mut stack = vec![0usize];
    while let Some(c) = stack.pop() {
        tree.clusters[c].first_triangle = tree.order.len() as u32;
        if tree.clusters[c].is_leaf() {
            tree.order.extend(&cells[c].faces);
        }
        stack.extend(tree.clusters[c].child_range().rev());
    }
    tree
}

fn halves(scene: &Scene, cell: &Cell, here: usize) -> Vec<Cell> {
    let axis = cell.bounds.extent().max_position();
    let middle = 0.5 * (cell.bounds.min[axis] + cell.bounds.max[axis]);
    let mut parts = [Vec::new(), Vec::new(), Vec::new()];
    for &t in &cell.faces {
        let Aabb { min, max } = Aabb::of(scene.corners(t));
        let part = if max[axis] <= middle {
            0
        } else if min[axis] >= middle {
            1
        } else {
            2
        };
        parts[part].push(t);
    }
    let mut bounds = [cell.bounds; 3];
    (bounds[0].max[axis], bounds[1].min[axis]) = (middle, middle);
    let made = parts.into_iter().zip(bounds).enumerate().map(|(k, (faces, bounds))| Cell {
        bounds,
        parent: here,
        faces,
        halvings: cell.halvings + 1,
        is_cut: k == 2,
    });
    made.filter(|cell| !cell.faces.is_empty()).collect()
}
