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
use super::{Answer, Bundle, Cost, Exact, Method, wilson};
use crate::characterise::{AxisMix, Traits};
use crate::embree::{CommittedScene, Traversal};
use crate::hierarchy::Hierarchy;
use crate::ray::{Lanes, Packet};
use crate::scene::Scene;
use crate::simd::{Isa, Kernel, LANES, Simd, decay, dispatch};
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

/// Work after which a bundle is handed to Embree, a packet; in units of one box against sixteen segments. A node costs
/// two, a block of triangles four, and each triangle that cannot be ruled out two a packet.
const WORK_LIMIT: u32 = 200;
/// What Embree needs for a packet, as part of this engine's own work when it aggregates nothing: right for rooms of
/// 300,000 triangles. Under wide beams in foliage that work is too large a yardstick, and the engine is kept where it
/// takes up to twice Embree's time for few segments.
const EMBREE_SHARE: f64 = 0.15;

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
    stack: Vec<u32>,
    /// Transmittance of each segment of the first packet.
    transmittance: [f32; LANES],
    /// Blocked segments of each packet of a bundle.
    blocked: Vec<u32>,
}

impl Default for Workspace {
    fn default() -> Self {
        Workspace { stack: Vec::with_capacity(256), transmittance: [0.0; LANES], blocked: Vec::new() }
    }
}

/// What the walk found for one packet.
struct Walked {
    /// Segments of the first packet that met an aggregated cluster.
    aggregated: u32,
    tested: bool,
    nodes: u32,
    work: u32,
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
        let sum = match bundle.packets {
            [] => Totals::default(),
            packets => self.packets(packets, bundle.emitter_size, s, workspace, &mut cost),
        };
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

    /// The visible fraction of a bundle by exact rays: for bundles where [`MultiResolution::pays`] says no.
    pub fn hand_over(&self, bundle: Bundle, workspace: &mut Workspace) -> Answer {
        let exact = Exact { scene: self.exact, traversal: self.traversal };
        let mut answer = exact.answer(bundle, &mut workspace.blocked);
        answer.cost.handed_over = answer.cost.segments;
        answer
    }

    /// Whether this engine is likely to take less time than exact rays for bundles like these.
    ///
    /// Counts work instead of measuring time, so that the same question has the same answer on every run: what the
    /// walk does for feature size `s` against what it would do if nothing could be aggregated, which stands for
    /// Embree's traversal.
    pub fn pays(&self, sample: &[Bundle], s: f32, workspace: &mut Workspace) -> bool {
        let mut count = |packets: &[Packet], e: f32, s: f32| {
            let walk = Walk { engine: self, packets, e, s, limit: u32::MAX, workspace };
            f64::from(dispatch(self.isa, walk).work)
        };
        let (mut own, mut exact) = (0.0, 0.0);
        for bundle in sample.iter().filter(|b| !b.packets.is_empty()) {
            own += count(bundle.packets, bundle.emitter_size, s);
            // No feature size is below zero: everything is opened.
            exact += count(&bundle.packets[..1], 0.0, 0.0) * bundle.packets.len() as f64;
        }
        own < EMBREE_SHARE * exact
    }

    fn packets(
        &self,
        packets: &[Packet],
        e: f32,
        s: f32,
        workspace: &mut Workspace,
        cost: &mut Cost,
    ) -> Totals {
        let limit = match self.leaf {
            Leaf::Exact => WORK_LIMIT * (packets.len() as u32 + 1),
            // No rays, whatever it takes.
            Leaf::Extinction => u32::MAX,
        };
        let walked = dispatch(self.isa, Walk { engine: self, packets, e, s, limit, workspace });
        let n: u64 = packets.iter().map(|p| p.len() as u64).sum();
        cost.segments += n;
        cost.nodes += u64::from(walked.nodes);
        if walked.gave_up {
            cost.exact_rays += n;
            cost.handed_over += n;
            self.exact.occluded_by(self.traversal, u32::MAX, packets, &mut workspace.blocked);
            let probe = packets[0].active & !workspace.blocked[0];
            workspace.transmittance = std::array::from_fn(|i| (probe >> i & 1) as f32);
            let clear = n - workspace.blocked.iter().map(|b| u64::from(b.count_ones())).sum::<u64>();
            return Totals { transmittance: clear as f32, lo: clear as f32, hi: clear as f32 };
        }
        cost.exact_rays += if walked.tested { n } else { 0 };
        let probe = &packets[0];
        let met = walked.aggregated & probe.active & !workspace.blocked[0];
        cost.aggregated += n * u64::from(met.count_ones()) / probe.len() as u64;
        walked.totals
    }

    /// Transmittance of each segment of one packet; 0 in unused lanes.
    pub fn transmittances(&self, packet: &Packet, e: f32, s: f32, workspace: &mut Workspace) -> [f32; LANES] {
        self.packets(std::slice::from_ref(packet), e, s, workspace, &mut Cost::default());
        workspace.transmittance
    }
}

/// What box tests need of the segments, lane by lane.
struct Segments<S: Simd> {
    origin: [S::F; 3],
    inverse: [S::F; 3],
    near: S::F,
    far: S::F,
}

impl<S: Simd> Segments<S> {
    #[inline(always)]
    fn of(simd: S, packet: &Packet) -> Self {
        let inverse = [0, 1, 2].map(|axis| {
            let d = simd.load(&packet.direction[axis]);
            // Finite even for zero, so that 0 · inverse is never NaN.
            let tiny = simd.lt(simd.abs(d), simd.splat(1e-30));
            simd.div(simd.splat(1.0), simd.select(tiny, simd.splat(1e-30), d))
        });
        Segments {
            origin: [0, 1, 2].map(|axis| simd.load(&packet.origin[axis])),
            inverse,
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

/// A box against the segments in the lanes.
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

/// One traversal for all packets of a bundle.
struct Walk<'a, 'b> {
    engine: &'a MultiResolution<'b>,
    packets: &'a [Packet],
    e: f32,
    s: f32,
    limit: u32,
    workspace: &'a mut Workspace,
}

impl Kernel for Walk<'_, '_> {
    type Output = Walked;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Walked {
        let Walk { engine, packets, e, s, limit, workspace } = self;
        let tree = &engine.tree;
        let probe = &packets[0];
        let shaft = Shaft::of(simd, packets, engine.magnitude);
        let mix = AxisMix::around(shaft.direction());
        let mut walked = Walked {
            aggregated: 0,
            tested: false,
            nodes: 0,
            work: 0,
            gave_up: false,
            totals: Totals::default(),
        };
        let segments = Segments::of(simd, probe);
        let alive = simd.mask(probe.active);
        let (mut depth, mut deepest) = (simd.splat(0.0), simd.splat(0.0));
        let soft = engine.leaf == Leaf::Extinction;
        let mut work = 0;
        workspace.blocked.clear();
        workspace.blocked.resize(packets.len(), 0);
        workspace.stack.clear();
        workspace.stack.push(0);
        let push = |stack: &mut Vec<u32>, reference: u32| {
            // Its lines arrive while others are worked on.
            if reference & LEAF != 0 {
                simd.prefetch(&tree.blocks[(reference & !LEAF) as usize]);
            } else {
                simd.prefetch(&tree.nodes[reference as usize]);
            }
            stack.push(reference);
        };
        while let Some(reference) = workspace.stack.pop() {
            if reference & LEAF != 0 {
                let block = &tree.blocks[(reference & !LEAF) as usize];
                let candidates = shaft.candidates(simd, block);
                work += 4;
                if candidates != 0 {
                    work += 2 * packets.len() as u32 * candidates.count_ones();
                    walked.tested = true;
                    let mut open = false;
                    for k in Lanes(candidates) {
                        let triangle = Triangle::of(block, k, shaft.apex());
                        open = false;
                        for (packet, blocked) in packets.iter().zip(&mut workspace.blocked) {
                            if *blocked != packet.active {
                                *blocked |= triangle.blocks(simd, packet) & packet.active;
                                open |= *blocked != packet.active;
                            }
                        }
                        if !open {
                            break;
                        }
                    }
                    if !open {
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
                let soft_leaves = if soft { node.soft_leaves } else { 0 };
                if node.smallest >= s.max(e) && soft_leaves == 0 {
                    Lanes(touched).for_each(|lane| push(&mut workspace.stack, node.child[lane]));
                    continue;
                }
                let traits = &tree.traits[reference as usize];
                let mut sizes = simd.splat(0.0);
                let mut kappas = simd.splat(0.0);
                for (&axis, weight) in mix.axes.iter().zip(mix.weights) {
                    let weight = simd.splat(weight);
                    sizes = simd.add(sizes, simd.mul(weight, simd.load_half(&traits[axis].size)));
                    kappas = simd.add(kappas, simd.mul(weight, simd.load_half(&traits[axis].extinction)));
                }
                let small = touched & (shaft.maybe_small(simd, node, sizes, e, s) | soft_leaves);
                for lane in Lanes(touched & !small) {
                    push(&mut workspace.stack, node.child[lane]);
                }
                if small == 0 {
                    continue;
                }
                work += small.count_ones();
                let (mut size_of, mut kappa_of) = ([0.0; LANES], [0.0; LANES]);
                simd.store(sizes, &mut size_of);
                simd.store(kappas, &mut kappa_of);
                for lane in Lanes(small) {
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
                    // One decision for the whole bundle: what one segment may not aggregate is opened for all.
                    if simd.bits(simd.and_not(hit, o.aggregated)) != 0 && soft_leaves >> lane & 1 == 0 {
                        push(&mut workspace.stack, node.child[lane]);
                        continue;
                    }
                    walked.aggregated |= simd.bits(hit);
                    let d = simd.keep(hit, simd.mul(o.path, simd.splat(kappa_of[lane])));
                    depth = simd.add(depth, d);
                    deepest = simd.max(deepest, d);
                }
            }
            if work > limit {
                walked.work = work;
                walked.gave_up = true;
                return walked;
            }
        }
        walked.work = work;
        walked.totals = finish(simd, packets, walked.aggregated != 0, (depth, deepest), workspace);
        walked
    }
}

/// Totals of a bundle: triangles were tested with all segments, optical depths are those of the first packet.
#[inline(always)]
fn finish<S: Simd>(
    simd: S,
    packets: &[Packet],
    aggregated: bool,
    (depth, deepest): (S::F, S::F),
    workspace: &mut Workspace,
) -> Totals {
    let clear = |p: &Packet, blocked: u32| p.active & !blocked;
    let all: u32 = packets.iter().zip(&workspace.blocked).map(|(p, &b)| clear(p, b).count_ones()).sum();
    let seen = clear(&packets[0], workspace.blocked[0]);
    if !aggregated {
        workspace.transmittance = std::array::from_fn(|i| (seen >> i & 1) as f32);
        let all = all as f32;
        return Totals { transmittance: all, lo: all, hi: all };
    }
    let n: usize = packets.iter().map(Packet::len).sum();
    let probe = &packets[0];
    let length = {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let d = simd.load(&probe.direction[axis]);
            simd.mul(d, d)
        });
        simd.root(simd.add(simd.add(x, y), z))
    };
    let active = simd.mask(probe.active);
    let tau = simd.mul(depth, length);
    // Mean of V·T over the probe, corrected by what the other segments saw of V (a control variate: T varies
    // smoothly over the bundle, V does not).
    let estimate = |t: S::F| {
        let t = simd.keep(active, t);
        let m = probe.len() as f32;
        let mean = simd.sum(t) / m;
        let product = simd.sum(simd.keep(simd.mask(seen), t)) / m;
        let v = product + mean * (all as f32 / n as f32 - seen.count_ones() as f32 / m);
        v.clamp(0.0, 1.0) * n as f32
    };
    let t = decay(simd, tau);
    simd.store(simd.keep(simd.mask(seen), t), &mut workspace.transmittance);
    Totals {
        transmittance: estimate(t),
        lo: estimate(simd.max(simd.sub(simd.splat(1.0), tau), simd.splat(0.0))),
        hi: estimate(decay(simd, simd.mul(deepest, length))),
    }
}

/// A triangle as seen from the common receiver end of a bundle, or from the world's origin if there is none.
///
/// The volumes of Möller & Trumbore 1997, taken apart by direction: with v = o - corner,
/// det = d · (e2 × e1), a det = d · (e2 × v), b det = d · (v × e1), t det = e2 · (v × e1). All but d is the same for
/// every segment from o, and nothing is divided.
struct Triangle {
    corner: Vec3,
    edge1: Vec3,
    edge2: Vec3,
    /// e2 × e1.
    normal: Vec3,
    apex: Option<[Vec3; 2]>,
}

impl Triangle {
    #[inline(always)]
    fn of(block: &Block, k: usize, apex: Option<Vec3>) -> Triangle {
        let pick = |v: &[[f32; LANES]; 3]| Vec3::new(v[0][k], v[1][k], v[2][k]);
        let (corner, edge1, edge2) = (pick(&block.corner), pick(&block.edge1), pick(&block.edge2));
        let apex = apex.map(|o| [edge2.cross(o - corner), (o - corner).cross(edge1)]);
        Triangle { corner, edge1, edge2, normal: edge2.cross(edge1), apex }
    }

    /// Lanes that it blocks. Edges are widened by 1e-6, so that no segment slips between neighbours.
    #[inline(always)]
    fn blocks<S: Simd>(&self, simd: S, packet: &Packet) -> u32 {
        let splat = |v: Vec3| [simd.splat(v.x), simd.splat(v.y), simd.splat(v.z)];
        let cross = |a: &[S::F; 3], b: &[S::F; 3]| {
            let part = |i: usize, j: usize| simd.sub(simd.mul(a[i], b[j]), simd.mul(a[j], b[i]));
            [part(1, 2), part(2, 0), part(0, 1)]
        };
        let dot = |a: &[S::F; 3], b: &[S::F; 3]| {
            simd.add(simd.add(simd.mul(a[0], b[0]), simd.mul(a[1], b[1])), simd.mul(a[2], b[2]))
        };
        let (e1, e2) = (splat(self.edge1), splat(self.edge2));
        let d = [0, 1, 2].map(|axis| simd.load(&packet.direction[axis]));
        let (p, q) = match self.apex {
            Some([p, q]) => (splat(p), splat(q)),
            None => {
                let v = [0, 1, 2].map(|a| simd.sub(simd.load(&packet.origin[a]), simd.splat(self.corner[a])));
                (cross(&e2, &v), cross(&v, &e1))
            }
        };
        let det = dot(&d, &splat(self.normal));
        // Everything with the sign of the determinant.
        let zero = simd.splat(0.0);
        let back = simd.lt(det, zero);
        let turn = |v: S::F| simd.select(back, simd.sub(zero, v), v);
        let (det, a, b, t) = (turn(det), turn(dot(&d, &p)), turn(dot(&d, &q)), turn(dot(&e2, &q)));
        let slack = simd.mul(det, simd.splat(-1e-6));
        let inside = simd.and(simd.le(slack, a), simd.le(slack, b));
        let inside = simd.and(inside, simd.le(simd.add(simd.add(a, b), slack), det));
        let reach = simd.and(
            simd.le(simd.mul(simd.load(&packet.near), det), t),
            simd.le(t, simd.mul(simd.load(&packet.far), det)),
        );
        simd.bits(simd.and(simd.and(inside, reach), simd.lt(zero, det)))
    }
}
