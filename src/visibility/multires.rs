//! Multi-resolution visibility [SD95 sec 3.2]: one traversal for all segments of a bundle, sixteen lanes wide.
//!
//! A node holds sixteen children. Its shaft test throws out the children that no segment can touch. If any of the
//! rest could be small enough to be aggregated, each active segment tests all sixteen boxes at once; a child is
//! aggregated for a segment if both ends lie outside it and its feature size b is below the threshold
//!
//! ```text
//! b*(t) = s (1 - t) + e t          t = 0 at the receiver, 1 at the emitter
//! ```
//!
//! at the less favourable end of the overlap. This is the umbra test u = b + (b - e) d2/d1 < s solved for b
//! (method A.6), at the safe end (D.10). Opened leaves test their triangles. What meets more work than exact rays
//! would cost is handed to Embree whole.

use super::reference;
use super::shaft::Shaft;
use super::wide::{Block, LEAF, WideTree};
use super::{Answer, Bundle, Cost, Method, wilson};
use crate::characterise::{Traits, nearest_axis};
use crate::embree::{CommittedScene, Traversal};
use crate::hierarchy::Hierarchy;
use crate::ray::{Lanes, Packet};
use crate::scene::Scene;
use crate::simd::{Isa, Kernel, LANES, Simd, dispatch};
use glam::Vec3;

/// What happens in a leaf that the criterion opens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Leaf {
    /// Its triangles are tested.
    #[default]
    Exact,
    /// It is answered by extinction all the same: the paper's average visibility [SD95 sec 5].
    Extinction,
}

/// Work after which a packet is handed to Embree, in units of one segment against sixteen boxes. An Embree packet
/// costs about as much as three hundred of them in a large scene.
const WORK_LIMIT: u32 = 400;
/// Cost of one block of triangles in those units: the candidates test and about two triangles.
const BLOCK_WORK: u32 = 8;
/// With more children than this in the shaft, testing segment by segment prunes enough to pay.
const CROWD: u32 = 4;

/// The multi-resolution engine: the wide tree and the exact scene it falls back on.
pub struct MultiResolution<'a> {
    tree: WideTree,
    exact: &'a CommittedScene,
    traversal: Traversal,
    magnitude: f32,
    leaf: Leaf,
    isa: Isa,
}

/// Buffers of a thread, kept between calls.
pub struct Workspace {
    stack: Vec<(u32, u32)>,
    /// Optical depth of each segment, summed lane by lane of the nodes.
    depth: Box<[[f32; LANES]; LANES]>,
    /// Largest single optical depth, for the upper Fréchet bound.
    deepest: Box<[[f32; LANES]; LANES]>,
    /// Transmittance of each segment of the last packet.
    transmittance: [f32; LANES],
}

impl Default for Workspace {
    fn default() -> Self {
        let zero = || Box::new([[0.0; LANES]; LANES]);
        Workspace { stack: Vec::with_capacity(256), depth: zero(), deepest: zero(), transmittance: [0.0; LANES] }
    }
}

/// What the walk found for one packet.
struct Walked {
    blocked: u32,
    aggregated: u32,
    tested: u32,
    nodes: u32,
    gave_up: bool,
}

/// Sums over the segments of a packet.
struct Totals {
    transmittance: f32,
    lo: f32,
    hi: f32,
}

impl<'a> MultiResolution<'a> {
    /// Lays out a hierarchy for traversal.
    ///
    /// `traits` are those of `hierarchy.micro`; `exact` is the whole scene, traced as `traversal` says when a
    /// packet is handed over.
    pub fn new(
        scene: &Scene,
        hierarchy: &Hierarchy,
        traits: &[Traits],
        exact: &'a CommittedScene,
        traversal: Traversal,
        leaf: Leaf,
    ) -> MultiResolution<'a> {
        MultiResolution {
            tree: WideTree::build(scene, hierarchy, traits),
            exact,
            traversal,
            magnitude: reference::magnitude(scene),
            leaf,
            isa: Isa::detect(),
        }
    }

    /// Uses another instruction set; one that the machine lacks is replaced by plain code.
    #[must_use]
    pub fn with_isa(mut self, isa: Isa) -> Self {
        self.isa = if isa.available() { isa } else { Isa::Portable };
        self
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Bytes of the traversal structure.
    pub fn bytes(&self) -> usize {
        self.tree.bytes()
    }

    /// The visible fraction of a bundle for feature size `s` (scene units, on the receiver; finite, positive).
    pub fn answer(&self, bundle: Bundle, s: f32, workspace: &mut Workspace) -> Answer {
        let mut cost = Cost::default();
        let mut sum = Totals { transmittance: 0.0, lo: 0.0, hi: 0.0 };
        for packet in bundle.packets {
            let totals = self.packet(packet, bundle.emitter_size, s, workspace, &mut cost);
            sum.transmittance += totals.transmittance;
            sum.lo += totals.lo;
            sum.hi += totals.hi;
        }
        let n = (cost.segments as f32).max(1.0);
        let method = match (cost.exact_rays > 0, cost.aggregated > 0) {
            (false, false) => Method::Clear,
            (true, false) => Method::Exact,
            (false, true) => Method::Aggregated,
            (true, true) => Method::Mixed,
        };
        let (lo, hi) = (wilson(sum.lo / n, n).0, wilson(sum.hi / n, n).1);
        Answer { transmittance: sum.transmittance / n, lo, hi, method, cost }
    }

    /// Transmittance of each segment of one packet; 0 in unused lanes.
    pub fn transmittances(&self, packet: &Packet, e: f32, s: f32, workspace: &mut Workspace) -> [f32; LANES] {
        self.packet(packet, e, s, workspace, &mut Cost::default());
        workspace.transmittance
    }

    fn packet(&self, packet: &Packet, e: f32, s: f32, workspace: &mut Workspace, cost: &mut Cost) -> Totals {
        let walked = dispatch(self.isa, Walk { engine: self, packet, e, s, workspace });
        let n = u64::from(packet.active.count_ones());
        cost.segments += n;
        cost.nodes += u64::from(walked.nodes);
        if walked.gave_up {
            cost.exact_rays += n;
            cost.handed_over += n;
            let mut blocked = [0];
            self.exact.occluded_by(self.traversal, u32::MAX, std::slice::from_ref(packet), &mut blocked);
            for (i, t) in workspace.transmittance.iter_mut().enumerate() {
                *t = ((packet.active & !blocked[0]) >> i & 1) as f32;
            }
            let clear = (packet.active & !blocked[0]).count_ones() as f32;
            return Totals { transmittance: clear, lo: clear, hi: clear };
        }
        cost.exact_rays += u64::from(walked.tested.count_ones());
        cost.aggregated += u64::from((walked.aggregated & !walked.blocked).count_ones());
        finish(packet, &walked, workspace)
    }
}

/// Sums the lanes of the depths and takes the exponentials.
fn finish(packet: &Packet, walked: &Walked, workspace: &mut Workspace) -> Totals {
    let mut totals = Totals { transmittance: 0.0, lo: 0.0, hi: 0.0 };
    workspace.transmittance = [0.0; LANES];
    for i in Lanes(packet.active & !walked.blocked) {
        let (mut t, mut lo, mut hi) = (1.0, 1.0, 1.0);
        if walked.aggregated >> i & 1 == 1 {
            let depth: f32 = workspace.depth[i].iter().sum();
            t = (-depth).exp();
            // Any dependence between the clusters lies within Fréchet's bounds (method D.7); 1 - τ bounds
            // 1 - Σ(1 - T_i) from below.
            lo = (1.0 - depth).max(0.0);
            hi = (-workspace.deepest[i].iter().fold(0.0f32, |a, &b| a.max(b))).exp();
        }
        workspace.transmittance[i] = t;
        totals.transmittance += t;
        totals.lo += lo;
        totals.hi += hi;
    }
    totals
}

struct Walk<'a, 'b> {
    engine: &'a MultiResolution<'b>,
    packet: &'a Packet,
    e: f32,
    s: f32,
    workspace: &'a mut Workspace,
}

/// Lane by lane what a box test needs of a segment.
struct Segments {
    inverse: [[f32; LANES]; 3],
    length: [f32; LANES],
    axis: [u8; LANES],
}

impl Segments {
    #[inline(always)]
    fn of<S: Simd>(simd: S, packet: &Packet) -> Segments {
        let mut s = Segments { inverse: [[0.0; LANES]; 3], length: [0.0; LANES], axis: [0; LANES] };
        let mut square = simd.splat(0.0);
        for axis in 0..3 {
            let d = simd.load(&packet.direction[axis]);
            square = simd.add(square, simd.mul(d, d));
            // Finite even for zero, so that 0 · inverse is never NaN.
            let tiny = simd.lt(simd.abs(d), simd.splat(1e-30));
            let d = simd.select(tiny, simd.splat(1e-30), d);
            simd.store(simd.div(simd.splat(1.0), d), &mut s.inverse[axis]);
        }
        simd.store(simd.sqrt(square), &mut s.length);
        for i in packet.lanes() {
            s.axis[i] = nearest_axis(Vec3::from(packet.direction.map(|a| a[i]))) as u8;
        }
        s
    }
}

impl Kernel for Walk<'_, '_> {
    type Output = Walked;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Walked {
        let Walk { engine, packet, e, s, workspace } = self;
        let tree = &engine.tree;
        let shaft = Shaft::of(simd, packet, engine.magnitude);
        let mut walked = Walked { blocked: 0, aggregated: 0, tested: 0, nodes: 0, gave_up: false };
        let mut segments: Option<Segments> = None;
        let soft = engine.leaf == Leaf::Extinction;
        let mut work = 0;
        workspace.stack.clear();
        workspace.stack.push((0, packet.active));
        while let Some((reference, active)) = workspace.stack.pop() {
            let active = active & !walked.blocked;
            if active == 0 {
                continue;
            }
            if reference & LEAF != 0 {
                let block = &tree.blocks[(reference & !LEAF) as usize];
                let candidates = shaft.candidates(simd, block);
                work += BLOCK_WORK;
                if candidates != 0 {
                    walked.tested |= active;
                    // Only these lanes: for others the same leaf may have been aggregated (method D.11).
                    walked.blocked |= intersect(simd, packet, block, candidates) & active;
                    if walked.blocked == packet.active {
                        break;
                    }
                }
            } else {
                let node = &tree.nodes[reference as usize];
                walked.nodes += 1;
                work += 2;
                let touched = shaft.touches(simd, node);
                if touched == 0 {
                    continue;
                }
                let small = shaft.maybe_small(simd, node, e, s);
                let may_aggregate = touched & (small | if soft { node.soft_leaves } else { 0 });
                if may_aggregate == 0 && touched.count_ones() <= CROWD {
                    for lane in Lanes(touched) {
                        workspace.stack.push((node.child[lane], active));
                    }
                    continue;
                }
                let segments = segments.get_or_insert_with(|| Segments::of(simd, packet));
                work += active.count_ones();
                let touched = simd.mask(touched);
                let soft_leaves = simd.mask(if soft { node.soft_leaves } else { 0 });
                let bounds = |b: &[[f32; LANES]; 3]| [simd.load(&b[0]), simd.load(&b[1]), simd.load(&b[2])];
                let (min, max) = (bounds(&node.min), bounds(&node.max));
                let mut opened = simd.zero_bits();
                for i in Lanes(active) {
                    let mut enter = simd.splat(0.0);
                    let mut leave = simd.splat(1.0);
                    for axis in 0..3 {
                        let o = simd.splat(packet.origin[axis][i]);
                        let inverse = simd.splat(segments.inverse[axis][i]);
                        let a = simd.mul(simd.sub(min[axis], o), inverse);
                        let b = simd.mul(simd.sub(max[axis], o), inverse);
                        enter = simd.max(simd.min(a, b), enter);
                        leave = simd.min(simd.max(a, b), leave);
                    }
                    let near = simd.splat(packet.near[i]);
                    let far = simd.splat(packet.far[i]);
                    let hit = simd.and(touched, simd.le(enter, leave));
                    let hit = simd.and(hit, simd.and(simd.lt(near, leave), simd.lt(enter, far)));
                    // An end inside, or within the end's margin: the cluster must be opened (method D.5).
                    let outside = simd.and(simd.lt(near, enter), simd.lt(leave, far));
                    let threshold = {
                        let t = if e > s { enter } else { leave };
                        simd.add(simd.splat(s), simd.mul(simd.splat(e - s), t))
                    };
                    let axis = &tree.traits[reference as usize][segments.axis[i] as usize];
                    let small = simd.lt(simd.load_half(&axis.size), threshold);
                    let passed = simd.or(simd.and(outside, small), soft_leaves);
                    let aggregated = simd.and(hit, passed);
                    if simd.bits(aggregated) != 0 {
                        if walked.aggregated >> i & 1 == 0 {
                            walked.aggregated |= 1 << i;
                            workspace.depth[i] = [0.0; LANES];
                            workspace.deepest[i] = [0.0; LANES];
                        }
                        let path = simd.mul(simd.sub(leave, enter), simd.splat(segments.length[i]));
                        let depth = simd.keep(aggregated, simd.mul(path, simd.load_half(&axis.extinction)));
                        simd.store(simd.add(simd.load(&workspace.depth[i]), depth), &mut workspace.depth[i]);
                        simd.store(simd.max(simd.load(&workspace.deepest[i]), depth), &mut workspace.deepest[i]);
                    }
                    opened = simd.set_bit(opened, simd.and_not(hit, aggregated), 1 << i);
                }
                let mut masks = [0; LANES];
                simd.store_bits(opened, &mut masks);
                for (lane, &mask) in masks.iter().enumerate() {
                    if mask != 0 {
                        workspace.stack.push((node.child[lane], mask));
                    }
                }
            }
            if work > WORK_LIMIT {
                walked.gave_up = true;
                break;
            }
        }
        walked
    }
}

/// Segments that a candidate triangle of a block blocks (Möller & Trumbore 1997, one triangle for all lanes).
///
/// Edges are widened by 1e-6 of the triangle, so that no segment slips between neighbours.
#[inline(always)]
fn intersect<S: Simd>(simd: S, packet: &Packet, block: &Block, candidates: u32) -> u32 {
    let load = |v: &[[f32; LANES]; 3]| [simd.load(&v[0]), simd.load(&v[1]), simd.load(&v[2])];
    let pick = |v: &[[f32; LANES]; 3], i: usize| [simd.splat(v[0][i]), simd.splat(v[1][i]), simd.splat(v[2][i])];
    let cross = |a: &[S::F; 3], b: &[S::F; 3]| {
        let part = |i: usize, j: usize| simd.sub(simd.mul(a[i], b[j]), simd.mul(a[j], b[i]));
        [part(1, 2), part(2, 0), part(0, 1)]
    };
    let dot = |a: &[S::F; 3], b: &[S::F; 3]| {
        simd.add(simd.add(simd.mul(a[0], b[0]), simd.mul(a[1], b[1])), simd.mul(a[2], b[2]))
    };
    let (origin, direction) = (load(&packet.origin), load(&packet.direction));
    let (near, far) = (simd.load(&packet.near), simd.load(&packet.far));
    let (low, high) = (simd.splat(-1e-6), simd.splat(1.0 + 1e-6));
    let mut blocked = simd.mask(0);
    for k in Lanes(candidates) {
        let (e1, e2, v) = (pick(&block.edge1, k), pick(&block.edge2, k), pick(&block.corner, k));
        let p = cross(&direction, &e2);
        let inverse = simd.div(simd.splat(1.0), dot(&e1, &p));
        let to = [0, 1, 2].map(|a| simd.sub(origin[a], v[a]));
        let q = cross(&to, &e1);
        let a = simd.mul(dot(&to, &p), inverse);
        let b = simd.mul(dot(&direction, &q), inverse);
        let t = simd.mul(dot(&e2, &q), inverse);
        let inside = simd.and(simd.and(simd.le(low, a), simd.le(low, b)), simd.le(simd.add(a, b), high));
        let between = simd.and(simd.le(near, t), simd.le(t, far));
        blocked = simd.or(blocked, simd.and(inside, between));
    }
    simd.bits(blocked)
}
