//! The cluster trees in traversal layout: nodes of sixteen children, blocks of sixteen triangles.

use crate::clusters::{Hierarchy, Tree};
use crate::math::Aabb;
use crate::optics::{AXIS_COUNT, AxisMix, ClusterOptics};
use crate::scene::Scene;
use crate::simd::{LANES, Simd, half_nearest, half_up};

// Work of walks is counted in tests of a box or triangle against a packet. These numbers are estimates that select between engines and
// change no answer of either.

/// Work of the shaft test of a node of sixteen boxes: one for each of the six rows of bounds.
pub(super) const NODE_WORK: u64 = 6;
/// Work of rejecting the triangles of a block by its shaft. Twice that of a node: nine rows of corners and edges, and
/// their cross products.
pub(super) const BLOCK_WORK: u64 = 12;
/// Work that accounts for the cache miss of a node, in trees larger than the caches near a core: nearly two nodes.
pub(super) const FETCH_WORK: u64 = 10;

/// Bit of a child address that marks a leaf block.
pub(super) const LEAF: u32 = 1 << 31;

/// Up to sixteen children. Unused lanes hold a box at the largest finite coordinates, which no shaft touches.
#[derive(Clone)]
#[repr(C, align(64))]
pub(super) struct WideNode {
    pub min: [[f32; LANES]; 3],
    pub max: [[f32; LANES]; 3],
    /// [`ClusterOptics::slope`].
    pub slope: [[f32; LANES]; 3],
    pub child: [u32; LANES],
    /// Smallest feature size of the children along any axis: with smaller thresholds nothing can be aggregated.
    pub smallest: f32,
    /// Mask of children that are leaves without faces of emitters, and may transmit according to their extinction.
    pub soft_leaves: u32,
}

/// Feature sizes and extinctions of the children of a node along one axis, as bfloat16.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct AxisOptics {
    /// Rounded up: a feature size must not be underestimated.
    pub size: [u16; LANES],
    /// Rounded to nearest.
    pub extinction: [u16; LANES],
}

/// Up to sixteen triangles as a corner and two edges. Unused lanes are degenerate and never block.
#[repr(C, align(64))]
pub(super) struct WideBlock {
    pub corner: [[f32; LANES]; 3],
    pub edge1: [[f32; LANES]; 3],
    pub edge2: [[f32; LANES]; 3],
    pub used: u32,
}

/// Both trees of a hierarchy under one top node, sixteen children per node; traversed by the multi-resolution engine.
pub struct WideTree {
    /// Largest coordinate magnitude of the scene, scene units: the scale of rounding errors.
    pub(super) magnitude: f32,
    pub(super) nodes: Vec<WideNode>,
    pub(super) optics: Vec<[AxisOptics; AXIS_COUNT]>,
    pub(super) blocks: Vec<WideBlock>,
}

impl WideNode {
    /// A node without children.
    pub const EMPTY: WideNode = WideNode {
        min: [[f32::MAX; LANES]; 3],
        max: [[f32::MAX; LANES]; 3],
        slope: [[0.0; LANES]; 3],
        child: [LEAF; LANES],
        smallest: f32::INFINITY,
        soft_leaves: 0,
    };
}

impl WideBlock {
    /// A block without triangles.
    pub const EMPTY: WideBlock =
        WideBlock { corner: [[0.0; LANES]; 3], edge1: [[0.0; LANES]; 3], edge2: [[0.0; LANES]; 3], used: 0 };
}

/// Optics of unused lanes: a huge size instead of infinity, because a weight of zero times infinity is NaN.
pub(super) const NO_OPTICS: [AxisOptics; AXIS_COUNT] =
    [AxisOptics { size: [half_up(1e30); LANES], extinction: [0; LANES] }; AXIS_COUNT];

/// Smallest feature size of each child along any axis.
#[inline(always)]
pub(super) fn smallest<S: Simd>(simd: S, optics: &[AxisOptics; AXIS_COUNT]) -> S::F {
    let mut smallest = simd.load_half(&optics[0].size);
    for axis in &optics[1..] {
        smallest = simd.min(smallest, simd.load_half(&axis.size));
    }
    smallest
}

/// Feature sizes and extinctions of a node's children, interpolated for a direction.
#[inline(always)]
pub(super) fn mixed<S: Simd>(simd: S, optics: &[AxisOptics; AXIS_COUNT], mix: &AxisMix) -> (S::F, S::F) {
    let (mut sizes, mut extinctions) = (simd.splat(0.0), simd.splat(0.0));
    for (&axis, weight) in mix.axes.iter().zip(mix.weights) {
        let weight = simd.splat(weight);
        sizes = simd.fma(weight, simd.load_half(&optics[axis].size), sizes);
        extinctions = simd.fma(weight, simd.load_half(&optics[axis].extinction), extinctions);
    }
    (sizes, extinctions)
}

/// A tree of clusters to be laid out, with the optics of those that may be aggregated.
struct ClusterTree<'a> {
    scene: &'a Scene,
    tree: &'a Tree,
    optics: Option<&'a [ClusterOptics]>,
}

impl WideTree {
    /// Lays out the clusters of a scene; `optics` has one entry per cluster of `hierarchy.micro`.
    pub fn build(scene: &Scene, hierarchy: &Hierarchy, optics: &[ClusterOptics]) -> WideTree {
        let magnitude = scene.magnitude();
        let mut wide =
            WideTree { magnitude, nodes: vec![WideNode::EMPTY], optics: vec![NO_OPTICS], blocks: Vec::new() };
        let trees = [(&hierarchy.micro, Some(optics)), (&hierarchy.large, None)]
            .map(|(tree, optics)| ClusterTree { scene, tree, optics });
        for (lane, tree) in trees.iter().filter(|t| !t.tree.clusters.is_empty()).enumerate() {
            let addresses = wide.append(tree);
            wide.place(0, lane, tree, 0, addresses[0]);
        }
        wide
    }

    /// Appends the nodes and blocks of a tree; returns the address of each cluster.
    fn append(&mut self, clusters: &ClusterTree) -> Vec<u32> {
        let ClusterTree { scene, tree, .. } = *clusters;
        let (mut node, mut block) = (self.nodes.len() as u32, self.blocks.len() as u32);
        let addresses: Vec<u32> = tree
            .clusters
            .iter()
            .map(|c| {
                let next = if c.is_leaf() { &mut block } else { &mut node };
                *next += 1;
                (*next - 1) | if c.is_leaf() { LEAF } else { 0 }
            })
            .collect();
        for (c, cluster) in tree.clusters.iter().enumerate() {
            if cluster.is_leaf() {
                self.blocks.push(block_of(scene, tree.triangles_of(c)));
                continue;
            }
            let place = self.nodes.len();
            self.nodes.push(WideNode::EMPTY);
            self.optics.push(NO_OPTICS);
            for (lane, child) in cluster.child_range().enumerate() {
                self.place(place, lane, clusters, child, addresses[child]);
            }
        }
        addresses
    }

    /// Stores a cluster in a lane of a node; clusters without optics are never aggregated.
    fn place(&mut self, node: usize, lane: usize, clusters: &ClusterTree, cluster: usize, address: u32) {
        let ClusterTree { scene, tree, optics } = *clusters;
        let target = &mut self.nodes[node];
        set_box(target, lane, tree.clusters[cluster].bounds.thickened());
        target.child[lane] = address;
        let Some(optics) = optics else { return };
        let emits = |&t: &u32| scene.triangle_emitter[t as usize] != u32::MAX;
        if address & LEAF != 0 && !tree.triangles_of(cluster).iter().any(emits) {
            target.soft_leaves |= 1 << lane;
        }
        set_optics(target, &mut self.optics[node], lane, &optics[cluster]);
    }

    /// Size of all arrays in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice())
            + size_of_val(self.optics.as_slice())
            + size_of_val(self.blocks.as_slice())
    }
}

/// Sets the box of a child.
pub(super) fn set_box(node: &mut WideNode, lane: usize, bounds: Aabb) {
    for axis in 0..3 {
        node.min[axis][lane] = bounds.min[axis];
        node.max[axis][lane] = bounds.max[axis];
    }
}

/// Sets the optics of a child, so that it may be aggregated.
pub(super) fn set_optics(
    node: &mut WideNode,
    wide: &mut [AxisOptics; AXIS_COUNT],
    lane: usize,
    optics: &ClusterOptics,
) {
    for axis in 0..3 {
        node.slope[axis][lane] = optics.slope[axis];
    }
    for (axis, entry) in wide.iter_mut().enumerate() {
        entry.size[lane] = half_up(optics.feature_size(axis));
        entry.extinction[lane] = half_nearest(optics.extinction[axis]);
        node.smallest = node.smallest.min(optics.feature_size(axis));
    }
}

fn block_of(scene: &Scene, triangles: &[u32]) -> WideBlock {
    let mut block = WideBlock::EMPTY;
    for (lane, &t) in triangles.iter().enumerate() {
        let [a, b, c] = scene.corners(t);
        for axis in 0..3 {
            block.corner[axis][lane] = a[axis];
            block.edge1[axis][lane] = b[axis] - a[axis];
            block.edge2[axis][lane] = c[axis] - a[axis];
        }
        block.used |= 1 << lane;
    }
    block
}
