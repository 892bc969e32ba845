//! What lies near a receiver: how many blocks of triangles a threshold leaves to be opened around it.

use super::Cut;
use super::layout::{LEAF, Node};
use super::sums::Sums;
use crate::ray::Lanes;
use crate::simd::{Kernel, Simd};
use glam::Vec3;
use smallvec::{SmallVec, smallvec};

impl Found {
    /// Units of work.
    pub fn work(self) -> f64 {
        Sums { nodes: self.nodes, ..Sums::default() }.work()
    }
}

/// Kernel that counts the blocks around a point that are too close to be averaged, at most `limit`; those of large surfaces do not
/// count.
pub(super) struct Near<'a> {
    pub cut: &'a Cut,
    pub at: Vec3,
    /// Width at distance 1 of what a segment stands for.
    pub angle: f32,
    pub limit: u32,
}

/// Blocks that were found, and nodes that were tested.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    pub blocks: u32,
    pub nodes: u32,
}

impl Kernel for Near<'_> {
    type Output = Found;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Found {
        let Near { cut, at, angle, limit } = self;
        let angle = simd.splat(angle);
        let never = simd.splat(f32::from_bits(u32::from(super::layout::NEVER) << 16));
        let mut found = Found::default();
        let mut stack: SmallVec<[u32; 64]> = smallvec![0];
        while let Some(reference) = stack.pop() {
            let node = &cut.nodes[reference as usize];
            let stop = simd.load_half(&node.stop);
            let largest = simd.mul(angle, distances(simd, node, at));
            found.nodes += 1;
            let opened = simd.and(simd.le(largest, stop), simd.lt(stop, never));
            for lane in Lanes(node.used & simd.bits(opened)) {
                match node.child[lane] & LEAF {
                    0 => stack.push(node.child[lane]),
                    _ => found.blocks += 1,
                }
            }
            if found.blocks >= limit {
                return Found { blocks: limit, ..found };
            }
        }
        found
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
