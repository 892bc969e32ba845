//! What lies near a receiver: how many blocks of triangles a threshold leaves to be opened around it.

use super::Cut;
use super::layout::{LEAF, Node};
use super::traverse::Threshold;
use crate::ray::Lanes;
use crate::simd::{Kernel, Simd};
use glam::Vec3;
use smallvec::{SmallVec, smallvec};

/// Kernel that counts the blocks around a point that are too close to be averaged, at most `limit`; those of large surfaces do not
/// count. Lengths of the threshold are at a distance of 1.
pub(super) struct Near<'a> {
    pub cut: &'a Cut,
    pub at: Vec3,
    pub threshold: Threshold,
    pub limit: u32,
}

impl Kernel for Near<'_> {
    type Output = u32;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> u32 {
        let Near { cut, at, threshold, limit } = self;
        let (constant, slope) = (simd.splat(threshold.s), simd.splat(threshold.e));
        let mut count = 0;
        let mut stack: SmallVec<[u32; 64]> = smallvec![0];
        while let Some(reference) = stack.pop() {
            let node = &cut.nodes[reference as usize];
            let stop = simd.load_half(&node.stop);
            let largest = simd.fma(slope, distances(simd, node, at), constant);
            let never = simd.splat(f32::from_bits(u32::from(super::layout::NEVER) << 16));
            let opened = simd.and(simd.le(largest, stop), simd.lt(stop, never));
            for lane in Lanes(node.used & simd.bits(opened)) {
                match node.child[lane] & LEAF {
                    0 => stack.push(node.child[lane]),
                    _ => count += 1,
                }
            }
            if count >= limit {
                return limit;
            }
        }
        count
    }
}

/// Distances of a point from the boxes of a node.
#[inline(always)]
fn distances<S: Simd>(simd: S, node: &Node, at: Vec3) -> S::F {
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
