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
use crate::characterise::{AxisMix, Traits};
use crate::embree::{CommittedScene, Traversal};
use crate::hierarchy::Hierarchy;
use crate::ray::{Lanes, Packet};
use crate::scene::Scene;
use crate::simd::{Isa, Kernel, LANES, Simd, decay, dispatch};

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
    /// Transmittance of each segment of the last packet.
    transmittance: [f32; LANES],
}

impl Default for Workspace {
    fn default() -> Self {
        Workspace { stack: Vec::with_capacity(256), transmittance: [0.0; LANES] }
    }
}

/// What the walk found for one packet.
struct Walked {
    blocked: u32,
    aggregated: u32,
    tested: u32,
    nodes: u32,
    gave_up: bool,
    totals: Totals,
}

/// Sums over the segments of a packet.
#[derive(Clone, Copy, Default)]
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
        let mut sum = Totals::default();
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
        walked.totals
    }
}

struct Walk<'a, 'b> {
    engine: &'a MultiResolution<'b>,
    packet: &'a Packet,
    e: f32,
    s: f32,
    workspace: &'a mut Workspace,
}

/// What box tests need of the segments, lane by lane.
struct Segments<S: Simd> {
    origin: [S::F; 3],
    inverse: [S::F; 3],
    /// The same as scalars.
    inverses: [[f32; LANES]; 3],
    near: S::F,
    far: S::F,
}

impl<S: Simd> Segments<S> {
    #[inline(always)]
    fn of(simd: S, packet: &Packet) -> Self {
        let mut inverses = [[0.0; LANES]; 3];
        let inverse = [0, 1, 2].map(|axis| {
            let d = simd.load(&packet.direction[axis]);
            // Finite even for zero, so that 0 · inverse is never NaN.
            let tiny = simd.lt(simd.abs(d), simd.splat(1e-30));
            let inverse = simd.div(simd.splat(1.0), simd.select(tiny, simd.splat(1e-30), d));
            simd.store(inverse, &mut inverses[axis]);
            inverse
        });
        Segments {
            origin: [0, 1, 2].map(|axis| simd.load(&packet.origin[axis])),
            inverse,
            inverses,
            near: simd.load(&packet.near),
            far: simd.load(&packet.far),
        }
    }
}

/// Where segments and boxes overlap and what the criterion says of it.
struct Overlap<S: Simd> {
    hit: S::M,
    aggregated: S::M,
    path: S::F,
}

/// Boxes against segments, whichever of the two lies in the lanes.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // One formula with its operands.
fn overlap<S: Simd>(
    simd: S,
    (min, max): ([S::F; 3], [S::F; 3]),
    (origin, inverse): ([S::F; 3], [S::F; 3]),
    (near, far): (S::F, S::F),
    size: S::F,
    (e, s): (f32, f32),
) -> Overlap<S> {
    let mut enter = simd.splat(0.0);
    let mut leave = simd.splat(1.0);
    for axis in 0..3 {
        let a = simd.mul(simd.sub(min[axis], origin[axis]), inverse[axis]);
        let b = simd.mul(simd.sub(max[axis], origin[axis]), inverse[axis]);
        enter = simd.max(simd.min(a, b), enter);
        leave = simd.min(simd.max(a, b), leave);
    }
    let hit = simd.and(simd.le(enter, leave), simd.and(simd.lt(near, leave), simd.lt(enter, far)));
    // An end inside, or within the end's margin: the cluster must be opened (method D.5).
    let outside = simd.and(simd.lt(near, enter), simd.lt(leave, far));
    let t = if e > s { enter } else { leave };
    let threshold = simd.add(simd.splat(s), simd.mul(simd.splat(e - s), t));
    let aggregated = simd.and(simd.and(hit, outside), simd.lt(size, threshold));
    Overlap { hit, aggregated, path: simd.sub(leave, enter) }
}

impl Kernel for Walk<'_, '_> {
    type Output = Walked;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Walked {
        let Walk { engine, packet, e, s, workspace } = self;
        let tree = &engine.tree;
        let shaft = Shaft::of(simd, packet, engine.magnitude);
        let mix = AxisMix::around(shaft.direction());
        let mut walked =
            Walked { blocked: 0, aggregated: 0, tested: 0, nodes: 0, gave_up: false, totals: Totals::default() };
        let segments = Segments::of(simd, packet);
        // Optical depth in units of each segment's length, and its largest part.
        let (mut depth, mut deepest) = ([0.0f32; LANES], [0.0f32; LANES]);
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
                // Traits along the bundle's direction, between the three axes around it (method A.14).
                let traits = &tree.traits[reference as usize];
                let mut sizes = simd.splat(0.0);
                let mut kappas = simd.splat(0.0);
                for (&axis, weight) in mix.axes.iter().zip(mix.weights) {
                    let weight = simd.splat(weight);
                    sizes = simd.add(sizes, simd.mul(weight, simd.load_half(&traits[axis].size)));
                    kappas = simd.add(kappas, simd.mul(weight, simd.load_half(&traits[axis].extinction)));
                }
                let soft_leaves = if soft { node.soft_leaves } else { 0 };
                let small = shaft.maybe_small(simd, node, sizes, e, s);
                let crowd = touched.count_ones();
                if touched & (small | soft_leaves) == 0 && crowd <= CROWD {
                    for lane in Lanes(touched) {
                        workspace.stack.push((node.child[lane], active));
                    }
                    continue;
                }
                let count = active.count_ones();
                if crowd < count {
                    // Few boxes, many segments: segments in the lanes.
                    work += crowd;
                    let (mut size_of, mut kappa_of) = ([0.0; LANES], [0.0; LANES]);
                    simd.store(sizes, &mut size_of);
                    simd.store(kappas, &mut kappa_of);
                    let alive = simd.mask(active);
                    for lane in Lanes(touched) {
                        let bounds = |b: &[[f32; LANES]; 3]| [0, 1, 2].map(|axis| simd.splat(b[axis][lane]));
                        let o = overlap(
                            simd,
                            (bounds(&node.min), bounds(&node.max)),
                            (segments.origin, segments.inverse),
                            (segments.near, segments.far),
                            simd.splat(size_of[lane]),
                            (e, s),
                        );
                        let hit = simd.and(o.hit, alive);
                        let aggregated = if soft_leaves >> lane & 1 == 1 { hit } else { simd.and(o.aggregated, hit) };
                        let bits = simd.bits(aggregated);
                        if bits != 0 {
                            walked.aggregated |= bits;
                            let d = simd.keep(aggregated, simd.mul(o.path, simd.splat(kappa_of[lane])));
                            simd.store(simd.add(simd.load(&depth), d), &mut depth);
                            simd.store(simd.max(simd.load(&deepest), d), &mut deepest);
                        }
                        let opened = simd.bits(hit) & !bits;
                        if opened != 0 {
                            workspace.stack.push((node.child[lane], opened));
                        }
                    }
                } else {
                    // Few segments, many boxes: boxes in the lanes.
                    work += count;
                    let touched = simd.mask(touched);
                    let soft_leaves = simd.mask(soft_leaves);
                    let bounds = |b: &[[f32; LANES]; 3]| [0, 1, 2].map(|axis| simd.load(&b[axis]));
                    let (min, max) = (bounds(&node.min), bounds(&node.max));
                    let mut opened = simd.zero_bits();
                    for i in Lanes(active) {
                        let o = overlap(
                            simd,
                            (min, max),
                            (
                                [0, 1, 2].map(|axis| simd.splat(packet.origin[axis][i])),
                                [0, 1, 2].map(|axis| simd.splat(segments.inverses[axis][i])),
                            ),
                            (simd.splat(packet.near[i]), simd.splat(packet.far[i])),
                            sizes,
                            (e, s),
                        );
                        let hit = simd.and(o.hit, touched);
                        let aggregated = simd.and(hit, simd.or(o.aggregated, soft_leaves));
                        if simd.bits(aggregated) != 0 {
                            walked.aggregated |= 1 << i;
                            let d = simd.keep(aggregated, simd.mul(o.path, kappas));
                            depth[i] += simd.sum(d);
                            deepest[i] = deepest[i].max(simd.greatest(d));
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
            }
            if work > WORK_LIMIT {
                walked.gave_up = true;
                return walked;
            }
        }
        walked.totals = finish(simd, packet, &walked, (&depth, &deepest), &mut workspace.transmittance);
        walked
    }
}

/// Transmittances from optical depths, and the sums of them and of their bounds.
#[inline(always)]
fn finish<S: Simd>(
    simd: S,
    packet: &Packet,
    walked: &Walked,
    (depth, deepest): (&[f32; LANES], &[f32; LANES]),
    transmittance: &mut [f32; LANES],
) -> Totals {
    let clear = packet.active & !walked.blocked;
    if walked.aggregated & clear == 0 {
        *transmittance = std::array::from_fn(|i| (clear >> i & 1) as f32);
        let n = clear.count_ones() as f32;
        return Totals { transmittance: n, lo: n, hi: n };
    }
    let length = {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let d = simd.load(&packet.direction[axis]);
            simd.mul(d, d)
        });
        simd.root(simd.add(simd.add(x, y), z))
    };
    let clear = simd.mask(clear);
    let tau = simd.mul(simd.load(depth), length);
    let t = simd.keep(clear, decay(simd, tau));
    simd.store(t, transmittance);
    // Any dependence between the clusters lies within Fréchet's bounds (method D.7): the smallest of the parts
    // from above, 1 - Σ(1 - T_i) >= 1 - τ from below.
    let lo = simd.keep(clear, simd.max(simd.sub(simd.splat(1.0), tau), simd.splat(0.0)));
    let hi = simd.keep(clear, decay(simd, simd.mul(simd.load(deepest), length)));
    Totals { transmittance: simd.sum(t), lo: simd.sum(lo), hi: simd.sum(hi) }
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
