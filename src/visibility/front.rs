//! What a group of neighbouring bundles may meet, found once for all of them.
//!
//! The segments of every bundle lie inside the group's shaft, so what the shaft misses is missed by all and each
//! bundle's walk starts at what is left: boxes, sixteen side by side as in a node, and triangles that no feature
//! size lets through, in blocks of sixteen.

use super::shaft::Shaft;
use super::triangles;
use super::walk::{BLOCK, NODE};
use super::wide::{Block, LEAF, Node, WideTree, mixed};
use crate::characterise::AxisMix;
use crate::ray::Lanes;
use crate::simd::{LANES, Simd};

/// Boxes that are opened before a group's walks start, at most about.
const BOXES: usize = 64;
/// Triangles that are gathered, at most about.
const TRIANGLES: usize = 128;

/// Sixteen boxes of a front and what is known of them along the group's direction.
pub(super) struct Row {
    pub node: Node,
    pub sizes: [f32; LANES],
    pub extinctions: [f32; LANES],
}

/// A child of a node that the group's shaft touches.
#[derive(Clone, Copy)]
struct Found {
    node: u32,
    lane: usize,
    size: f32,
    extinction: f32,
}

/// Where the walks of a group start.
#[derive(Default)]
pub(super) struct Front {
    pub rows: Vec<Row>,
    pub blocks: Vec<Block>,
    boxes: usize,
    triangles: usize,
    queue: Vec<Found>,
}

impl Front {
    /// Opens the tree for a group whose bundles have emitters of sizes between two; returns its work.
    /// `soft` says that leaves are never opened.
    #[inline(always)]
    pub fn open<S: Simd>(
        &mut self,
        simd: S,
        tree: &WideTree,
        shaft: &Shaft,
        (least, largest): (f32, f32),
        s: f32,
        soft: bool,
    ) -> u32 {
        self.rows.clear();
        self.blocks.clear();
        self.queue.clear();
        (self.boxes, self.triangles) = (0, 0);
        let mix = AxisMix::around(shaft.direction());
        let (mut at, mut head, mut work) = (0, 0, 0);
        loop {
            let node = &tree.nodes[at];
            work += NODE;
            let touched = shaft.touches(simd, node);
            if touched != 0 {
                let (sizes, extinctions) = mixed(simd, &tree.traits[at], &mix);
                // What every bundle of the group will aggregate need not be opened.
                let aggregated = shaft.aggregates(simd, node, sizes, least, s);
                let perhaps = simd.bits(simd.lt(sizes, simd.splat(s.max(largest))));
                let (mut size_of, mut extinction_of) = ([0.0; LANES], [0.0; LANES]);
                simd.store(sizes, &mut size_of);
                simd.store(extinctions, &mut extinction_of);
                for lane in Lanes(touched) {
                    let child = node.child[lane];
                    let found =
                        Found { node: at as u32, lane, size: size_of[lane], extinction: extinction_of[lane] };
                    if child & LEAF == 0 {
                        if aggregated >> lane & 1 == 1 {
                            self.add_box(node, &found);
                        } else {
                            self.queue.push(found);
                        }
                    } else if perhaps >> lane & 1 == 1 || soft && node.soft_leaves >> lane & 1 == 1 {
                        self.add_box(node, &found);
                    } else {
                        let block = &tree.blocks[(child & !LEAF) as usize];
                        work += BLOCK;
                        let met = triangles::candidates(simd, shaft, block);
                        if self.triangles + met.count_ones() as usize <= TRIANGLES {
                            self.gather(block, met);
                        } else {
                            self.add_box(node, &found);
                        }
                    }
                }
            }
            if head == self.queue.len() || self.queue.len() - head + self.boxes >= BOXES {
                break;
            }
            let Found { node, lane, .. } = self.queue[head];
            at = tree.nodes[node as usize].child[lane] as usize;
            head += 1;
        }
        for k in head..self.queue.len() {
            let found = self.queue[k];
            self.add_box(&tree.nodes[found.node as usize], &found);
        }
        work
    }

    fn add_box(&mut self, from: &Node, &Found { lane, size, extinction, .. }: &Found) {
        let to = self.boxes % LANES;
        if to == 0 {
            self.rows.push(Row { node: Node::EMPTY, sizes: [f32::MAX; LANES], extinctions: [0.0; LANES] });
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
        (row.sizes[to], row.extinctions[to]) = (size, extinction);
    }

    fn gather(&mut self, from: &Block, triangles: u32) {
        for lane in Lanes(triangles) {
            let to = self.triangles % LANES;
            if to == 0 {
                self.blocks.push(Block::EMPTY);
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
