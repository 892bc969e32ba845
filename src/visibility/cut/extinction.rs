//! Extinction of the children of the cut, measured by rays through each (docs/method.md, Distance cut).

use super::DistanceCut;
use super::build::{ChildProperties, NodeProperties};
use super::layout::NO_THRESHOLD;
use super::traverse::{AveragingRule, EMPTY_STACK, trace};
use crate::math::Aabb;
use crate::math::parallel;
use crate::optics::{AXES, AXIS_COUNT, SOLID_DEPTH};
use crate::ray::Packet;
use crate::simd::{Kernel, LANES, Simd, dispatch, half_nearest, half_up};
use glam::Vec3;

/// Rays through a child along each axis, by the levels of nodes below it. 32 rays give the transmittance of a block with a standard error
/// of 1/(2 √32) = 0.09, without bias and independent of that of other blocks, so that errors average out along a path. Each level has
/// fewer children than the level below by a factor of about twelve; they get more rays, so that each level takes less time than that
/// below.
const RAYS: [usize; 4] = [32, 64, 256, 1024];

/// Sets the extinctions of all children.
pub(super) fn measure(cut: &mut DistanceCut, facts: &[NodeProperties]) {
    let tree = &*cut;
    let made: Vec<_> = parallel::map(0..tree.nodes.len(), |at| {
        dispatch(tree.isa, NodeRays { cut: tree, at, facts: &facts[at] })
    });
    for (extinctions, made) in cut.extinctions.iter_mut().zip(made) {
        extinctions.0 = made;
    }
}

/// Stop sizes, with which thresholds are compared: the size of the pieces, limited to between half the diameter of the child and its
/// diameter.
pub(super) fn stops(facts: &[NodeProperties]) -> impl Iterator<Item = [u16; LANES]> + '_ {
    let stop = |child: &ChildProperties| match child.surface {
        true => NO_THRESHOLD,
        false => half_up(child.piece.min(child.diameter).max(0.5 * child.diameter)).min(NO_THRESHOLD),
    };
    facts.iter().map(move |children| children.each_ref().map(stop))
}

/// Kernel that measures the children of a node.
struct NodeRays<'a> {
    cut: &'a DistanceCut,
    at: usize,
    facts: &'a NodeProperties,
}

impl Kernel for NodeRays<'_> {
    type Output = [[u16; LANES]; AXIS_COUNT];

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Self::Output {
        let node = &self.cut.nodes[self.at];
        let mut extinctions = [[0; LANES]; AXIS_COUNT];
        let (mut stack, mut lengths) = (EMPTY_STACK, Vec::new());
        for lane in crate::ray::Lanes(node.used) {
            if self.facts[lane].surface {
                continue;
            }
            let bounds = node.bounds(lane);
            let rays = RAYS[self.facts[lane].height.min(RAYS.len() - 1)];
            for (axis, extinctions) in extinctions.iter_mut().enumerate() {
                let seed = node.child[lane] ^ (axis as u32) << 27;
                let mut clear = 0;
                lengths.clear();
                lengths.resize(rays, 0.0);
                for (part, lengths) in lengths.chunks_mut(LANES).enumerate() {
                    let mut packet = Packet::EMPTY;
                    for (ray, length) in lengths.iter_mut().enumerate() {
                        let (start, through) = through(bounds, AXES[axis], sample(LANES * part + ray, seed));
                        packet.set_ray(ray, start, AXES[axis]);
                        (packet.far[ray], *length) = (through, through);
                    }
                    let trace = trace(
                        simd,
                        self.cut,
                        node.child[lane],
                        0,
                        &packet,
                        &AveragingRule::EXACT,
                        &mut stack,
                    );
                    clear += trace.open.count_ones() as usize;
                }
                extinctions[lane] = half_nearest(fitted(&lengths, clear)).min(NO_THRESHOLD);
            }
        }
        extinctions
    }
}

/// Point `k` of a sequence that fills the unit square evenly (R2; Roberts 2018), and a third coordinate that picks a face; shifted by a
/// hash of `seed`.
fn sample(k: usize, seed: u32) -> [f32; 3] {
    // Powers of the real root of x⁴ = x + 1.
    const R3_STEPS: [f64; 3] = [0.819_172_513_396_164, 0.671_043_606_703_789, 0.549_700_477_901_970];
    let hash = u64::from(seed).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d;
    let hash = (hash ^ hash >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    std::array::from_fn(|axis| {
        let shift = (hash >> (20 * axis) & 0xf_ffff) as f64 / f64::from(1 << 20);
        ((k as f64 * R3_STEPS[axis] + shift).fract()) as f32
    })
}

/// Where a ray along a unit vector enters a box, and the length of its way through it; uniform over the projection of the box.
fn through(bounds: Aabb, along: Vec3, [u, v, pick]: [f32; 3]) -> (Vec3, f32) {
    let extent = bounds.extent();
    let face = |axis: usize| along[axis].abs() * extent[(axis + 1) % 3] * extent[(axis + 2) % 3];
    let areas = [0, 1, 2].map(face);
    let all = areas[0] + areas[1] + areas[2];
    let at = pick * all;
    let axis = if at < areas[0] {
        0
    } else if at < areas[0] + areas[1] {
        1
    } else {
        2
    };
    // A face without area is picked only by rounding.
    let axis = if areas[axis] > 0.0 { axis } else { along.abs().max_position() };
    let (second, third) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut start = Vec3::ZERO;
    start[axis] = if along[axis] > 0.0 { bounds.min[axis] } else { bounds.max[axis] };
    start[second] = bounds.min[second] + u * extent[second];
    start[third] = bounds.min[third] + v * extent[third];
    let mut length = f32::INFINITY;
    for k in 0..3 {
        if along[k] != 0.0 {
            let end = if along[k] > 0.0 { bounds.max[k] } else { bounds.min[k] };
            length = length.min(((end - start[k]) / along[k]).max(0.0));
        }
    }
    (start, length)
}

/// The extinction for which the expected number of transmitted rays of these lengths is the number of clear ones, by Newton's
/// method from 0, which converges from below: the mean transmittance is convex and decreasing.
fn fitted(lengths: &[f32], clear: usize) -> f32 {
    let mean = lengths.iter().sum::<f32>() / lengths.len() as f32;
    if clear == lengths.len() || mean <= 0.0 {
        return 0.0;
    }
    let limit = SOLID_DEPTH / mean;
    if clear == 0 {
        return limit;
    }
    let wanted = clear as f32;
    let mut kappa = 0.0f32;
    for _ in 0..20 {
        let (mut sum, mut slope) = (0.0, 0.0);
        for &length in lengths {
            let t = (-kappa * length).exp();
            (sum, slope) = (sum + t, slope + length * t);
        }
        let step = (sum - wanted) / slope.max(f32::MIN_POSITIVE);
        kappa += step;
        if step.abs() < 1e-3 * kappa || kappa > limit {
            break;
        }
    }
    kappa.clamp(0.0, limit)
}
