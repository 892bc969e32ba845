//! Whether anything lies close to a receiver, above its surface.

use super::DistanceCut;
use super::layout::{CutBlock, CutNode, LEAF};
use crate::ray::Lanes;
use crate::simd::{Kernel, Simd, vector};
use glam::Vec3;
use smallvec::{SmallVec, smallvec};

/// The half of a ball around a point that lies above a plane.
#[derive(Clone, Copy)]
pub(in crate::visibility) struct HalfBall {
    pub at: Vec3,
    pub radius: f32,
    /// Unit normal of the plane.
    pub normal: Vec3,
    /// Distance of the plane below `at`.
    pub depth: f32,
}

/// Kernel that tests whether boxes of triangles leave a half ball empty. Boxes are larger than their contents, so that doubtful cases
/// count as not empty.
pub(super) struct EmptyHalfBall<'a> {
    pub cut: &'a DistanceCut,
    pub ball: HalfBall,
}

impl Kernel for EmptyHalfBall<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> bool {
        let EmptyHalfBall { cut, ball } = self;
        let radius = simd.splat(ball.radius);
        let mut stack: SmallVec<[u32; 64]> = smallvec![0];
        while let Some(address) = stack.pop() {
            let node = &cut.nodes[address as usize];
            let close = simd.bits(simd.le(distances(simd, node, ball.at), radius));
            for lane in Lanes(node.used & close) {
                let child = node.child[lane];
                let bounds = node.bounds(lane);
                let top = Vec3::select(ball.normal.cmpgt(Vec3::ZERO), bounds.max, bounds.min);
                if ball.normal.dot(top - ball.at) <= -ball.depth {
                    continue;
                }
                if child & LEAF == 0 {
                    stack.push(child);
                } else if touches(simd, &cut.blocks[(child & !LEAF) as usize], &ball) {
                    return false;
                }
            }
        }
        true
    }
}

/// Whether the box of a triangle of a block meets a ball and a corner of the triangle lies above its plane.
#[inline(always)]
fn touches<S: Simd>(simd: S, block: &CutBlock, ball: &HalfBall) -> bool {
    let zero = simd.splat(0.0);
    let edges = [vector::load(simd, &block.edge1), vector::load(simd, &block.edge2)];
    let corner = vector::sub(simd, &vector::load(simd, &block.corner), &vector::splat(simd, ball.at));
    let (mut square, mut size, mut height) = (zero, zero, [zero; 3]);
    for axis in 0..3 {
        let [first, second] = [edges[0][axis], edges[1][axis]];
        let a = corner[axis];
        let (b, c) = (simd.add(a, first), simd.add(a, second));
        let low = simd.min(a, simd.min(b, c));
        let high = simd.max(a, simd.max(b, c));
        let outside = simd.max(simd.max(low, simd.sub(zero, high)), zero);
        square = simd.fma(outside, outside, square);
        size = simd.add(size, simd.add(simd.abs(first), simd.abs(second)));
        let along = simd.splat(ball.normal[axis]);
        for (height, at) in height.iter_mut().zip([a, b, c]) {
            *height = simd.fma(along, at, *height);
        }
    }
    let top = simd.max(height[0], simd.max(height[1], height[2]));
    let above = simd.lt(simd.splat(-ball.depth), top);
    let close = simd.le(square, simd.splat(ball.radius * ball.radius));
    // Unused lanes have no extent.
    simd.bits(simd.and(simd.lt(zero, size), simd.and(above, close))) != 0
}

/// Distances of a point from the boxes of a node.
#[inline(always)]
fn distances<S: Simd>(simd: S, node: &CutNode, at: Vec3) -> S::F {
    let zero = simd.splat(0.0);
    let mut square = zero;
    for axis in 0..3 {
        let (step, offset) = (simd.splat(node.step[axis]), simd.splat(node.origin[axis] - at[axis]));
        let low = simd.fma(simd.load_whole(&node.bounds[0][axis]), step, offset);
        let high = simd.fma(simd.load_whole(&node.bounds[1][axis]), step, offset);
        let outside = simd.max(simd.max(low, simd.sub(zero, high)), zero);
        square = simd.fma(outside, outside, square);
    }
    simd.root(square)
}
