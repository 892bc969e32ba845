//! Traversal of the cut for single segments.

use super::Cut;
use super::layout::{Block, Extinctions, LEAF};
use crate::optics::AxisMix;
use crate::ray::{Lanes, Packet};
use crate::simd::vector;
use crate::simd::{LANES, Simd};
use glam::Vec3;

/// Depth at which a segment counts as blocked: it transmits less than 1/256, -ln(1/256).
pub(super) const OPAQUE_DEPTH: f32 = 5.545_177;
/// Entries of the stack: fifteen for each level of nodes, of which `build` makes at most 28.
pub(super) const STACK: usize = 512;
/// Rounding of parameters where a box begins and ends: three operations.
const SLACK: f32 = 4.0 * f32::EPSILON;

/// Sixteen segments: `origin + t direction`, open where `t` lies outside `near` and `far`; receivers lie at 0.
pub(super) struct Segments<'a> {
    pub packet: &'a Packet,
    inverse: [[f32; LANES]; 3],
    length: [f32; LANES],
}

impl<'a> Segments<'a> {
    #[inline(always)]
    pub fn of<S: Simd>(simd: S, packet: &'a Packet) -> Segments<'a> {
        let direction = vector::load(simd, &packet.direction);
        let length = simd.root(vector::dot(simd, &direction, &direction));
        // Far below what a component of a unit vector can be, but for zero; inverses stay finite.
        let smallest = simd.mul(length, simd.splat(1e-20));
        let mut all = Segments { packet, inverse: [[0.0; LANES]; 3], length: [0.0; LANES] };
        for (d, inverse) in direction.iter().zip(&mut all.inverse) {
            let flat = simd.lt(simd.abs(*d), smallest);
            simd.store(simd.div(simd.splat(1.0), simd.select(flat, smallest, *d)), inverse);
        }
        simd.store(length, &mut all.length);
        all
    }

    fn direction(&self, lane: usize) -> Vec3 {
        let d = &self.packet.direction;
        Vec3::new(d[0][lane], d[1][lane], d[2][lane])
    }
}

/// What segments average.
#[derive(Clone, Copy)]
pub(super) struct Rule {
    /// Width of the part of the emitter that a segment stands for, a length: blockers up to `width t` have no umbra at the receiver and
    /// are averaged.
    pub width: f32,
    /// Optical depth, before its correction, at which a segment counts as blocked.
    pub opaque: f32,
}

impl Rule {
    /// Averages nothing.
    pub const NOTHING: Rule = Rule { width: 0.0, opaque: OPAQUE_DEPTH };
}

/// What a segment met.
#[derive(Clone, Copy, Default)]
pub(super) struct Met {
    /// Optical depth of the aggregated children.
    pub depth: f32,
    pub blocked: bool,
    /// Whether anything was aggregated.
    pub aggregated: bool,
    /// Nodes and blocks that were tested.
    pub nodes: u32,
    pub blocks: u32,
}

/// A segment prepared for tests of boxes.
struct Prepared<S: Simd> {
    inverse: [f32; 3],
    origin: [f32; 3],
    /// Index of the bounds that the segment meets first, by axis.
    first: [usize; 3],
    near: S::F,
    far: S::F,
}

/// Follows the segment of a lane through the part of the tree below `from`, without the children `left_out` of that node.
#[inline(always)]
pub(super) fn trace<S: Simd>(
    simd: S,
    cut: &Cut,
    (from, left_out): (u32, u32),
    (segments, lane): (&Segments, usize),
    rule: &Rule,
    stack: &mut [u32; STACK],
) -> Met {
    let Segments { packet, inverse, .. } = segments;
    let inverse = [inverse[0][lane], inverse[1][lane], inverse[2][lane]];
    let prepared = Prepared::<S> {
        inverse,
        origin: [packet.origin[0][lane], packet.origin[1][lane], packet.origin[2][lane]],
        first: [usize::from(inverse[0] < 0.0), usize::from(inverse[1] < 0.0), usize::from(inverse[2] < 0.0)],
        near: simd.splat(packet.near[lane]),
        far: simd.splat(packet.far[lane]),
    };
    let width = simd.splat(rule.width);
    let mut mix = None;
    let mut met = Met::default();
    let mut kept = !left_out;
    stack[0] = from;
    let mut top = 1;
    while top > 0 {
        top -= 1;
        let reference = stack[top];
        if reference & LEAF != 0 {
            met.blocks += 1;
            if block_blocks(simd, &cut.blocks[(reference & !LEAF) as usize], packet, lane) {
                met.blocked = true;
                return met;
            }
            continue;
        }
        met.nodes += 1;
        let node = &cut.nodes[reference as usize];
        let (enter, leave) = prepared.pass(simd, node);
        let hit = node.used & kept & simd.bits(simd.le(enter, leave));
        kept = u32::MAX;
        if hit == 0 {
            continue;
        }
        // The umbra is widest where the segment enters, nearest to the receiver.
        let small = simd.lt(simd.load_half(&node.stop), simd.mul(width, enter));
        let amid = simd.and(simd.lt(prepared.near, enter), simd.lt(leave, prepared.far));
        let averaged = hit & simd.bits(simd.and(small, amid));
        if averaged != 0 {
            let mix = mix.get_or_insert_with(|| AxisMix::around(segments.direction(lane)));
            let kappa = extinction(simd, &cut.extinctions[reference as usize], mix);
            let depth = simd.mul(simd.mul(kappa, simd.splat(segments.length[lane])), simd.sub(leave, enter));
            met.depth += simd.sum(simd.keep(simd.mask(averaged), depth));
            met.aggregated = true;
            if met.depth > rule.opaque {
                met.blocked = true;
                return met;
            }
        }
        for lane in Lanes(hit & !averaged) {
            let child = node.child[lane];
            if child & LEAF != 0 {
                simd.prefetch(&cut.blocks[(child & !LEAF) as usize]);
            } else {
                simd.prefetch(&cut.nodes[child as usize]);
            }
            stack[top] = child;
            top += 1;
        }
    }
    met
}

/// Extinctions of the children of a node in a direction.
#[inline(always)]
fn extinction<S: Simd>(simd: S, Extinctions(axes): &Extinctions, mix: &AxisMix) -> S::F {
    let mut kappa = simd.mul(simd.splat(mix.weights[0]), simd.load_half(&axes[mix.axes[0]]));
    kappa = simd.fma(simd.splat(mix.weights[1]), simd.load_half(&axes[mix.axes[1]]), kappa);
    simd.fma(simd.splat(mix.weights[2]), simd.load_half(&axes[mix.axes[2]]), kappa)
}

impl<S: Simd> Prepared<S> {
    /// Parameters at which the segment enters and leaves the children of a node; entered after they are left if it misses them.
    #[inline(always)]
    fn pass(&self, simd: S, node: &super::layout::Node) -> (S::F, S::F) {
        let (mut enter, mut leave) = (self.near, self.far);
        for axis in 0..3 {
            let scale = simd.splat(node.step[axis] * self.inverse[axis]);
            let offset = simd.splat((node.origin[axis] - self.origin[axis]) * self.inverse[axis]);
            let first = self.first[axis];
            let a = simd.fma(simd.load_whole(&node.bounds[first][axis]), scale, offset);
            let b = simd.fma(simd.load_whole(&node.bounds[1 - first][axis]), scale, offset);
            enter = simd.max(a, enter);
            leave = simd.min(b, leave);
        }
        (enter, simd.mul(leave, simd.splat(1.0 + SLACK)))
    }
}

/// Whether a triangle of a block blocks a segment (Möller and Trumbore 1997).
#[inline(always)]
fn block_blocks<S: Simd>(simd: S, block: &Block, packet: &Packet, lane: usize) -> bool {
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
