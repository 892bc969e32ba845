//! A restricted quadtree over the cells of a grid: leaves that share an edge differ by one level at most.
//!
//! Neighbours are found as Daubert et al. (1997) do on generic edges: up to the first ancestor that has a sibling across the
//! edge, across, and down to the node that shares the edge.

use super::Grid;

/// No node.
const NONE: u32 = u32::MAX;

/// A square of cells. Squares at the east and south borders may extend beyond the grid; only their part on the grid counts.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// First column and row.
    pub first: [u32; 2],
    /// Side in cells, a power of 2.
    pub size: u32,
    parent: u32,
    /// The first of four: north-west, north-east, south-west, south-east.
    children: u32,
}

impl Node {
    /// Whether it has no children.
    pub fn is_leaf(&self) -> bool {
        self.children == NONE
    }
}

/// An edge of a square.
#[derive(Clone, Copy)]
pub struct Side {
    /// 0 for an edge of constant column, 1 for one of constant row.
    pub axis: usize,
    /// Whether it is towards increasing columns or rows.
    pub is_far: bool,
}

impl Side {
    pub const WEST: Side = Side { axis: 0, is_far: false };
    pub const EAST: Side = Side { axis: 0, is_far: true };
    pub const NORTH: Side = Side { axis: 1, is_far: false };
    pub const SOUTH: Side = Side { axis: 1, is_far: true };
}

/// The tree. Node 0 is the root; children come after their parents.
pub struct Quadtree<'a> {
    grid: &'a Grid,
    nodes: Vec<Node>,
}

impl<'a> Quadtree<'a> {
    /// Splits nodes, from the root on, of which `error` exceeds `max_error`, down to single cells; neighbours are split as far as
    /// the restriction needs.
    pub fn refine(grid: &'a Grid, mut error: impl FnMut(&Node) -> f64, max_error: f64) -> Quadtree<'a> {
        let size = (grid.columns() - 1).max(grid.rows() - 1).next_power_of_two() as u32;
        let root = Node { first: [0, 0], size, parent: NONE, children: NONE };
        let mut tree = Quadtree { grid, nodes: vec![root] };
        let mut open = vec![0];
        while let Some(i) = open.pop() {
            let node = tree.nodes[i];
            // The restriction may have split it before.
            if node.is_leaf() && (!tree.is_on_grid(i) || node.size == 1 || error(&node) <= max_error) {
                continue;
            }
            tree.split(i);
            let children = tree.nodes[i].children as usize;
            open.extend((children..children + 4).rev());
        }
        tree
    }

    /// All nodes, those beyond the grid included.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The grid.
    pub fn grid(&self) -> &'a Grid {
        self.grid
    }

    /// Indices of the leaves on the grid.
    pub fn leaves(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.nodes.len()).filter(|&i| self.nodes[i].is_leaf() && self.is_on_grid(i))
    }

    /// Indices of the children: north-west, north-east, south-west, south-east; `None` for a leaf.
    pub fn children(&self, node: usize) -> Option<[usize; 4]> {
        let first = self.nodes[node].children;
        (first != NONE).then(|| std::array::from_fn(|k| first as usize + k))
    }

    /// Whether a part of a node is on the grid.
    pub fn is_on_grid(&self, node: usize) -> bool {
        let [c, r] = self.nodes[node].first.map(|v| v as usize);
        c + 1 < self.grid.columns() && r + 1 < self.grid.rows()
    }

    /// First and last column and row of the samples of a node's part on the grid: `[[columns], [rows]]`.
    pub fn samples(&self, node: usize) -> [[usize; 2]; 2] {
        let Node { first, size, .. } = self.nodes[node];
        let last = [self.grid.columns() - 1, self.grid.rows() - 1];
        std::array::from_fn(|k| [first[k] as usize, ((first[k] + size) as usize).min(last[k])])
    }

    /// The node across an edge: of the same size, or a larger leaf. `None` at the border.
    pub fn neighbour(&self, node: usize, side: Side) -> Option<usize> {
        let across = self.across(node, side)?;
        self.is_on_grid(across).then_some(across)
    }

    fn across(&self, node: usize, side: Side) -> Option<usize> {
        let Node { parent, .. } = self.nodes[node];
        if parent == NONE {
            return None;
        }
        let siblings = self.nodes[parent as usize].children as usize;
        let bit = 1 << side.axis;
        let (place, mirrored) = (node - siblings, (node - siblings) ^ bit);
        if (place & bit != 0) != side.is_far {
            return Some(siblings + mirrored);
        }
        let across = self.across(parent as usize, side)?;
        Some(self.children(across).map_or(across, |children| children[mirrored]))
    }

    /// Splits a leaf, and before it the neighbours that are larger.
    fn split(&mut self, node: usize) {
        if !self.nodes[node].is_leaf() {
            return;
        }
        let Node { first, size, .. } = self.nodes[node];
        for side in [Side::WEST, Side::EAST, Side::NORTH, Side::SOUTH] {
            if let Some(across) = self.neighbour(node, side).filter(|&a| self.nodes[a].size > size) {
                self.split(across);
            }
        }
        let half = size / 2;
        self.nodes[node].children = self.nodes.len() as u32;
        for k in 0..4 {
            let first = [first[0] + (k & 1) * half, first[1] + (k >> 1) * half];
            self.nodes.push(Node { first, size: half, parent: node as u32, children: NONE });
        }
    }
}
