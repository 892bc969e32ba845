//! The part of the tree that a group of neighbouring bundles can meet, determined once for the group.
//!
//! All segments of the group lie inside the group's shaft, so no bundle meets geometry that the shaft misses. Each
//! bundle's walk starts at the rest: boxes, arranged in nodes of sixteen, and triangles that must be tested at every
//! feature size, arranged in blocks of sixteen.

use super::shaft::Shaft;
use super::triangles;
use super::wide::{
    AxisOptics, BLOCK_WORK, LEAF, NO_OPTICS, NODE_WORK, WideBlock, WideNode, WideTree, mixed, smallest,
};
use crate::optics::{AXIS_COUNT, AxisMix};
use crate::ray::Lanes;
use crate::simd::{LANES, Simd};

/// Number of boxes at which the search for a frontier ends: four nodes. Any value from 32 to 128 changes the error of a
/// forest by less than 0.5 % of itself (`constants.py bench`).
const MAX_BOXES: usize = 64;
/// Largest number of triangles of a frontier: eight blocks. Any value from 64 to 256 gives the same errors (`constants.py
/// bench`).
const MAX_TRIANGLES: usize = 128;

/// Sixteen boxes of a frontier, arranged as a node.
pub(super) struct FrontierRow {
    pub node: WideNode,
    pub optics: [AxisOptics; AXIS_COUNT],
}

/// A child of a node that touches the group's shaft.
#[derive(Clone, Copy)]
struct FrontierChild {
    node: u32,
    lane: usize,
}

/// Start of the walks of a group.
#[derive(Default)]
pub(super) struct Frontier {
    pub rows: Vec<FrontierRow>,
    pub blocks: Vec<WideBlock>,
    boxes: usize,
    triangles: usize,
    queue: Vec<FrontierChild>,
}

impl Frontier {
    /// Opens the tree for a group whose emitter sizes lie in `(narrowest, widest)` and feature sizes in `(finest,
    /// coarsest)`, scene units. Returns the number of visited nodes and the work. `soft`: leaves are never opened.
    #[inline(always)]
    pub fn open<S: Simd>(
        &mut self,
        simd: S,
        tree: &WideTree,
        shaft: &Shaft,
        (narrowest, widest): (f32, f32),
        (finest, coarsest): (f32, f32),
        soft: bool,
    ) -> (u32, u64) {
        self.rows.clear();
        self.blocks.clear();
        self.queue.clear();
        (self.boxes, self.triangles) = (0, 0);
        let mix = AxisMix::around(shaft.direction());
        let (mut at, mut head, mut work) = (0, 0, 0u64);
        loop {
            let node = &tree.nodes[at];
            work += NODE_WORK;
            let touched = shaft.touches(simd, node);
            if touched != 0 {
                let optics = &tree.optics[at];
                // Clusters that the bundles will probably aggregate stay closed.
                let aggregated = shaft.aggregates(simd, node, mixed(simd, optics, &mix).0, narrowest, finest);
                // Leaves that no bundle may aggregate, in any direction, are opened here.
                let perhaps = simd.bits(simd.lt(smallest(simd, optics), simd.splat(coarsest.max(widest))));
                for lane in Lanes(touched) {
                    let child = node.child[lane];
                    let found = FrontierChild { node: at as u32, lane };
                    if child & LEAF == 0 {
                        if aggregated >> lane & 1 == 1 {
                            self.add_box(tree, found);
                        } else {
                            self.queue.push(found);
                        }
                    } else if perhaps >> lane & 1 == 1 || soft && node.soft_leaves >> lane & 1 == 1 {
                        self.add_box(tree, found);
                    } else {
                        let block = &tree.blocks[(child & !LEAF) as usize];
                        work += BLOCK_WORK;
                        let met = triangles::candidates(simd, shaft, block);
                        if self.triangles + met.count_ones() as usize <= MAX_TRIANGLES {
                            self.gather(block, met);
                        } else {
                            self.add_box(tree, found);
                        }
                    }
                }
            }
            if head == self.queue.len() || self.queue.len() - head + self.boxes >= MAX_BOXES {
                break;
            }
            let FrontierChild { node, lane } = self.queue[head];
            at = tree.nodes[node as usize].child[lane] as usize;
            head += 1;
        }
        for k in head..self.queue.len() {
            self.add_box(tree, self.queue[k]);
        }
        (head as u32 + 1, work)
    }

    fn add_box(&mut self, tree: &WideTree, FrontierChild { node, lane }: FrontierChild) {
        let (from, optics) = (&tree.nodes[node as usize], &tree.optics[node as usize]);
        let to = self.boxes % LANES;
        if to == 0 {
            self.rows.push(FrontierRow { node: WideNode::EMPTY, optics: NO_OPTICS });
        }
        self.boxes += 1;
        let row = self.rows.last_mut().expect("just pushed");
        for axis in 0..3 {
            row.node.min[axis][to] = from.min[axis][lane];
            row.node.max[axis][to] = from.max[axis][lane];
            row.node.slope[axis][to] = from.slope[axis][lane];
        }
        row.node.child[to] = from.child[lane];
        row.node.soft_leaves |= (from.soft_leaves >> lane & 1) << to;
        row.node.smallest = row.node.smallest.min(from.smallest);
        for (to_axis, from_axis) in row.optics.iter_mut().zip(optics) {
            to_axis.size[to] = from_axis.size[lane];
            to_axis.extinction[to] = from_axis.extinction[lane];
        }
    }

    fn gather(&mut self, from: &WideBlock, triangles: u32) {
        for lane in Lanes(triangles) {
            let to = self.triangles % LANES;
            if to == 0 {
                self.blocks.push(WideBlock::EMPTY);
            }
            self.triangles += 1;
            let block = self.blocks.last_mut().expect("just pushed");
            for axis in 0..3 {
                block.corner[axis][to] = from.corner[axis][lane];
                block.edge1[axis][to] = from.edge1[axis][lane];
                block.edge2[axis][to] = from.edge2[axis][lane];
            }
            block.used |= 1 << to;
        }
    }
}
