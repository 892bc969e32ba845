//! Traversal of the cut for the segments of a packet: a node that several of them meet is decoded once.

use super::DistanceCut;
use super::layout::{CutBlock, CutNode, Extinctions, LEAF, NO_THRESHOLD};
use crate::optics::axes_around;
use crate::ray::{Lanes, Packet};
use crate::simd::{LANES, Simd, vector};

/// Depth at which a segment counts as blocked: it transmits less than 1/256, -ln(1/256).
pub(super) const OPAQUE_DEPTH: f32 = 5.545_177;
/// Entries of the stack: fifteen for each level of nodes, of which `build` makes at most 28.
pub(super) const STACK: usize = 512;
/// Rounding of parameters where a box begins and ends: three operations.
const BOX_ROUNDING: f32 = 4.0 * f32::EPSILON;

/// A node or block to be tested, and the segments that meet its box.
#[derive(Clone, Copy)]
pub(super) struct Entry {
    address: u32,
    lanes: u16,
    /// Whether the triangles belong to small pieces.
    small: bool,
}

/// Entries that are still to be tested.
pub(super) type Stack = [Entry; STACK];
/// A stack without entries.
pub(super) const EMPTY_STACK: Stack = [Entry { address: 0, lanes: 0, small: false }; STACK];

/// The rule by which children are averaged.
#[derive(Clone, Copy)]
pub(super) struct AveragingRule {
    /// Width of the part of the emitter that a segment stands for, a length: blockers up to `width t` have no umbra at the receiver and
    /// are averaged.
    pub width: f32,
    /// Optical depth, before its correction, at which a segment counts as blocked.
    pub opaque: f32,
}

impl AveragingRule {
    /// Averages nothing.
    pub const EXACT: AveragingRule = AveragingRule { width: 0.0, opaque: OPAQUE_DEPTH };
}

/// Results of the traversal for the segments of a packet.
pub(super) struct PacketTrace {
    /// Optical depths of the aggregated children.
    pub depths: [f32; LANES],
    /// Segments that are not blocked.
    pub open: u32,
    /// Segments that met an aggregated child.
    pub aggregated: u32,
    /// Nodes and blocks that were decoded.
    pub nodes: u32,
    pub blocks: u32,
    /// Tests of a segment against the children of a node, and against the triangles of a block.
    pub node_tests: u32,
    pub block_tests: u32,
    /// Tests against blocks of small pieces.
    pub small_tests: u32,
}

/// Sixteen segments `origin + t direction`, open where `t` lies outside `near` and `far`; receivers lie at 0.
struct Segments<'a> {
    packet: &'a Packet,
    inverse: [[f32; LANES]; 3],
    length: [f32; LANES],
    /// By lane and axis, the index of the bounds that the segment meets first.
    first: [[u8; 3]; LANES],
    axes: Axes,
}

impl<'a> Segments<'a> {
    #[inline(always)]
    fn of<S: Simd>(simd: S, packet: &'a Packet) -> Segments<'a> {
        let direction = vector::load(simd, &packet.direction);
        let length = simd.root(vector::dot(simd, &direction, &direction));
        // Far below any component of a unit vector that is not zero, so that inverses stay finite.
        let smallest = simd.mul(length, simd.splat(1e-20));
        let mut all = Segments {
            packet,
            inverse: [[0.0; LANES]; 3],
            length: [0.0; LANES],
            first: [[0; 3]; LANES],
            axes: Axes::around(simd, &direction),
        };
        for (axis, &d) in direction.iter().enumerate() {
            let flat = simd.lt(simd.abs(d), smallest);
            let inverse = simd.div(simd.splat(1.0), simd.select(flat, smallest, d));
            simd.store(inverse, &mut all.inverse[axis]);
            let negative = simd.bits(simd.lt(inverse, simd.splat(0.0)));
            for lane in 0..LANES {
                all.first[lane][axis] = (negative >> lane & 1) as u8;
            }
        }
        simd.store(length, &mut all.length);
        all
    }
}

/// The three axes around the direction of each segment and their weights: [`AxisMix`] for all lanes.
///
/// [`AxisMix`]: crate::optics::AxisMix
struct Axes {
    /// Lanes where |x| >= |y|, |y| >= |z| and |x| >= |z|.
    order: [u32; 3],
    /// Lanes where y and z, x and z, x and y have opposite signs.
    opposite: [u32; 3],
    weights: [[f32; LANES]; 3],
}

impl Axes {
    #[inline(always)]
    fn around<S: Simd>(simd: S, direction: &vector::Vector<S>) -> Axes {
        let [x, y, z] = *direction;
        let [a, b, c] = [simd.abs(x), simd.abs(y), simd.abs(z)];
        let order = [simd.bits(simd.le(b, a)), simd.bits(simd.le(c, b)), simd.bits(simd.le(c, a))];
        let zero = simd.splat(0.0);
        let opposite = [
            simd.bits(simd.lt(simd.mul(y, z), zero)),
            simd.bits(simd.lt(simd.mul(x, z), zero)),
            simd.bits(simd.lt(simd.mul(x, y), zero)),
        ];
        let (low, high) = (simd.min(a, b), simd.max(a, b));
        let (largest, smallest) = (simd.max(high, c), simd.min(low, c));
        let middle = simd.max(low, simd.min(high, c));
        let scale = simd.max(largest, simd.splat(f32::MIN_POSITIVE));
        let mut weights = [[0.0; LANES]; 3];
        simd.store(simd.div(simd.sub(largest, middle), scale), &mut weights[0]);
        simd.store(simd.div(simd.sub(middle, smallest), scale), &mut weights[1]);
        simd.store(simd.div(smallest, scale), &mut weights[2]);
        Axes { order, opposite, weights }
    }

    /// Extinctions of the children of a node in the direction of a lane.
    #[inline(always)]
    fn extinction<S: Simd>(&self, simd: S, Extinctions(kappa): &Extinctions, lane: usize) -> S::F {
        let bits = |of: &[u32; 3]| {
            ((of[0] >> lane & 1) | (of[1] >> lane & 1) << 1 | (of[2] >> lane & 1) << 2) as usize
        };
        let [face, edge, corner] = axes_around(bits(&self.order), bits(&self.opposite));
        let [first, second, third] = &self.weights;
        let mut sum = simd.mul(simd.splat(first[lane]), simd.load_half(&kappa[face]));
        sum = simd.fma(simd.splat(second[lane]), simd.load_half(&kappa[edge]), sum);
        simd.fma(simd.splat(third[lane]), simd.load_half(&kappa[corner]), sum)
    }
}

/// The boxes of the children of a node, and where each segment meets a plane at `b` steps from the origin of the node: at
/// `scale b + offset`.
struct Decoded {
    bounds: [[[f32; LANES]; 3]; 2],
    scale: [[f32; LANES]; 3],
    offset: [[f32; LANES]; 3],
}

impl Decoded {
    #[inline(always)]
    fn of<S: Simd>(simd: S, node: &CutNode, segments: &Segments) -> Decoded {
        let zero = [[0.0; LANES]; 3];
        let mut decoded = Decoded { bounds: [zero; 2], scale: zero, offset: zero };
        for axis in 0..3 {
            for side in 0..2 {
                simd.store(simd.load_whole(&node.bounds[side][axis]), &mut decoded.bounds[side][axis]);
            }
            let inverse = simd.load(&segments.inverse[axis]);
            let from = simd.sub(simd.splat(node.origin[axis]), simd.load(&segments.packet.origin[axis]));
            simd.store(simd.mul(simd.splat(node.step[axis]), inverse), &mut decoded.scale[axis]);
            simd.store(simd.mul(from, inverse), &mut decoded.offset[axis]);
        }
        decoded
    }

    /// Parameters at which the segment of a lane enters and leaves the children; for children that it misses the entry is above the exit.
    #[inline(always)]
    fn pass<S: Simd>(&self, simd: S, segments: &Segments, lane: usize) -> (S::F, S::F) {
        let mut enter = simd.splat(segments.packet.near[lane]);
        let mut leave = simd.splat(segments.packet.far[lane]);
        for axis in 0..3 {
            let (scale, offset) = (simd.splat(self.scale[axis][lane]), simd.splat(self.offset[axis][lane]));
            let first = usize::from(segments.first[lane][axis] & 1);
            let a = simd.fma(simd.load(&self.bounds[first][axis]), scale, offset);
            let b = simd.fma(simd.load(&self.bounds[1 - first][axis]), scale, offset);
            enter = simd.max(a, enter);
            leave = simd.min(b, leave);
        }
        (enter, simd.mul(leave, simd.splat(1.0 + BOX_ROUNDING)))
    }
}

/// Follows the segments of a packet through the part of the tree below `from`, without the children `left_out` of that node.
#[inline(always)]
pub(super) fn trace<S: Simd>(
    simd: S,
    cut: &DistanceCut,
    from: u32,
    left_out: u32,
    packet: &Packet,
    rule: &AveragingRule,
    stack: &mut Stack,
) -> PacketTrace {
    let segments = Segments::of(simd, packet);
    let mut walk = Walk { trace: PacketTrace::of(packet), segments };
    stack[0] = Entry { address: from, lanes: packet.active as u16, small: true };
    let (mut top, mut kept) = (1, !left_out);
    while top > 0 {
        top -= 1;
        let Entry { address, lanes, small } = stack[top];
        let lanes = u32::from(lanes) & walk.trace.open;
        if lanes == 0 {
            continue;
        }
        if address & LEAF != 0 {
            walk.block(simd, &cut.blocks[(address & !LEAF) as usize], lanes, small);
            continue;
        }
        let at = address as usize;
        let node = &cut.nodes[at];
        let opened = walk.node(simd, node, &cut.extinctions[at], lanes, node.used & kept, rule);
        kept = u32::MAX;
        let never = simd.splat(f32::from_bits(u32::from(NO_THRESHOLD) << 16));
        let small = simd.bits(simd.lt(simd.load_half(&node.stop), never));
        for (lane, &lanes) in opened.iter().enumerate().filter(|(_, lanes)| **lanes != 0) {
            let child = node.child[lane];
            if child & LEAF != 0 {
                simd.prefetch(&cut.blocks[(child & !LEAF) as usize]);
            } else {
                simd.prefetch(&cut.nodes[child as usize]);
            }
            stack[top] = Entry { address: child, lanes, small: small >> lane & 1 == 1 };
            top += 1;
        }
    }
    walk.trace
}

impl PacketTrace {
    fn of(packet: &Packet) -> PacketTrace {
        let (depths, open) = ([0.0; LANES], packet.active);
        let (nodes, blocks, node_tests, block_tests, small_tests) = (0, 0, 0, 0, 0);
        PacketTrace { depths, open, aggregated: 0, nodes, blocks, node_tests, block_tests, small_tests }
    }
}

/// State of the traversal for the segments of a packet.
struct Walk<'a> {
    segments: Segments<'a>,
    trace: PacketTrace,
}

impl Walk<'_> {
    /// Tests some of the children of a node: adds the depths of those that are aggregated, and returns the segments that meet each of
    /// the others.
    #[inline(always)]
    fn node<S: Simd>(
        &mut self,
        simd: S,
        node: &CutNode,
        extinctions: &Extinctions,
        lanes: u32,
        children: u32,
        rule: &AveragingRule,
    ) -> [u16; LANES] {
        self.trace.nodes += 1;
        self.trace.node_tests += lanes.count_ones();
        let decoded = Decoded::of(simd, node, &self.segments);
        let (stop, width) = (simd.load_half(&node.stop), simd.splat(rule.width));
        let packet = self.segments.packet;
        // Computed without branches: the averaged and the opened children, and the paths through the children.
        let (mut averaged, mut opened) = ([0u16; LANES], [0u16; LANES]);
        let mut paths = [[0.0; LANES]; LANES];
        let mut averaging = 0;
        for lane in Lanes(lanes) {
            let (enter, leave) = decoded.pass(simd, &self.segments, lane);
            // The umbra is widest where the segment enters, nearest to the receiver.
            let small = simd.lt(stop, simd.mul(width, enter));
            let (near, far) = (simd.splat(packet.near[lane]), simd.splat(packet.far[lane]));
            let amid = simd.and(simd.lt(near, enter), simd.lt(leave, far));
            let hit = children & simd.bits(simd.le(enter, leave));
            let small = simd.bits(simd.and(small, amid));
            simd.store(simd.sub(leave, enter), &mut paths[lane]);
            (averaged[lane], opened[lane]) = ((hit & small) as u16, (hit & !small) as u16);
            averaging |= u32::from(hit & small != 0) << lane;
        }
        for lane in Lanes(averaging) {
            let kappa = self.segments.axes.extinction(simd, extinctions, lane);
            let depth = simd.mul(kappa, simd.load(&paths[lane]));
            let depth = simd.sum(simd.keep(simd.mask(averaged[lane].into()), depth));
            self.trace.depths[lane] += self.segments.length[lane] * depth;
            self.trace.open &= !(u32::from(self.trace.depths[lane] > rule.opaque) << lane);
        }
        self.trace.aggregated |= averaging;
        let mut of_child = [0u16; LANES];
        for lane in Lanes(lanes & self.trace.open) {
            for child in Lanes(opened[lane].into()) {
                of_child[child] |= 1 << lane;
            }
        }
        of_child
    }

    /// Tests the triangles of a block.
    #[inline(always)]
    fn block<S: Simd>(&mut self, simd: S, block: &CutBlock, lanes: u32, small: bool) {
        self.trace.blocks += 1;
        self.trace.block_tests += lanes.count_ones();
        self.trace.small_tests += u32::from(small) * lanes.count_ones();
        for lane in Lanes(lanes) {
            if block_blocks(simd, block, self.segments.packet, lane) {
                self.trace.open &= !(1 << lane);
            }
        }
    }
}

/// Whether a triangle of a block blocks a segment (Möller and Trumbore 1997).
#[inline(always)]
fn block_blocks<S: Simd>(simd: S, block: &CutBlock, packet: &Packet, lane: usize) -> bool {
    let corner = vector::load(simd, &block.corner);
    let (edge1, edge2) = (vector::load(simd, &block.edge1), vector::load(simd, &block.edge2));
    let (o, d) = (&packet.origin, &packet.direction);
    let direction = [simd.splat(d[0][lane]), simd.splat(d[1][lane]), simd.splat(d[2][lane])];
    let origin = [simd.splat(o[0][lane]), simd.splat(o[1][lane]), simd.splat(o[2][lane])];
    let from = vector::sub(simd, &origin, &corner);
    let p = vector::cross(simd, &direction, &edge2);
    let q = vector::cross(simd, &from, &edge1);
    let det = vector::dot(simd, &edge1, &p);
    let zero = simd.splat(0.0);
    let sign = simd.select(simd.lt(det, zero), simd.splat(-1.0), simd.splat(1.0));
    let size = simd.abs(det);
    let u = simd.mul(sign, vector::dot(simd, &from, &p));
    let v = simd.mul(sign, vector::dot(simd, &direction, &q));
    let t = simd.mul(sign, vector::dot(simd, &edge2, &q));
    let inside = simd.and(
        simd.and(simd.le(zero, u), simd.le(zero, v)),
        simd.and(simd.le(simd.add(u, v), size), simd.lt(zero, size)),
    );
    let within = simd.and(
        simd.le(simd.mul(size, simd.splat(packet.near[lane])), t),
        simd.le(t, simd.mul(size, simd.splat(packet.far[lane]))),
    );
    simd.bits(simd.and(inside, within)) != 0
}

/// Extinction of the first child in the direction of each segment.
#[cfg(test)]
pub(super) fn extinctions(packet: &Packet, kappa: &Extinctions) -> [f32; LANES] {
    struct Extinction<'a>(&'a Packet, &'a Extinctions);
    impl crate::simd::Kernel for Extinction<'_> {
        type Output = [f32; LANES];
        fn run<S: Simd>(self, simd: S) -> [f32; LANES] {
            let segments = Segments::of(simd, self.0);
            std::array::from_fn(|lane| {
                let mut all = [0.0; LANES];
                simd.store(segments.axes.extinction(simd, self.1, lane), &mut all);
                all[0]
            })
        }
    }
    crate::simd::dispatch(crate::simd::Isa::detect(), Extinction(packet, kappa))
}
