//! Layout of the tree of the distance cut: nodes of sixteen children with boxes of 16 bits, blocks of sixteen triangles.

use crate::math::Aabb;
use crate::optics::AXIS_COUNT;
use crate::simd::LANES;

/// Bit of a child address that marks a block of triangles.
pub(super) const LEAF: u32 = 1 << 31;
/// Largest number of steps of a box across its node: what 16 bits hold.
const MAX_STEPS: f32 = 65_535.0;

/// Up to sixteen children. Unused lanes are not in `used`.
#[derive(Clone)]
#[repr(C, align(64))]
pub(super) struct CutNode {
    /// Lower and upper bounds of the boxes by axis, in steps from `origin`; rounded outwards.
    pub bounds: [[[u16; LANES]; 3]; 2],
    pub child: [u32; LANES],
    /// Stop sizes, bfloat16, rounded up: a child is aggregated where the threshold of the umbra criterion exceeds this length.
    /// [`NO_THRESHOLD`] for children that are always opened.
    pub stop: [u16; LANES],
    pub origin: [f32; 3],
    pub step: [f32; 3],
    pub used: u32,
}

/// Extinctions of the children along each axis, bfloat16, 1/length.
#[derive(Clone)]
#[repr(C, align(32))]
pub(super) struct Extinctions(pub [[u16; LANES]; AXIS_COUNT]);

/// Up to sixteen triangles as a corner and two edges. Unused lanes are degenerate and block nothing.
#[derive(Clone)]
#[repr(C, align(64))]
pub(super) struct CutBlock {
    pub corner: [[f32; LANES]; 3],
    pub edge1: [[f32; LANES]; 3],
    pub edge2: [[f32; LANES]; 3],
}

/// The largest finite bfloat16: no threshold exceeds it.
pub(super) const NO_THRESHOLD: u16 = 0x7f7f;

impl CutNode {
    /// A node without children whose boxes lie in `around`.
    pub fn within(around: Aabb) -> CutNode {
        // Two steps are for rounding: one beyond either side of the box.
        let step = (around.extent() / (MAX_STEPS - 4.0)).max(glam::Vec3::splat(f32::MIN_POSITIVE * 1e6));
        // Rounding of coordinates is coarser than the steps of nodes that are small and far from zero.
        let rounding = f32::EPSILON * around.min.abs().max(around.max.abs());
        let step = step.max(rounding);
        let origin = around.min - 2.0 * step;
        CutNode {
            bounds: [[[u16::MAX; LANES]; 3], [[0; LANES]; 3]],
            child: [LEAF; LANES],
            stop: [NO_THRESHOLD; LANES],
            origin: origin.to_array(),
            step: step.to_array(),
            used: 0,
        }
    }

    /// Stores the box of a child, a step larger on each side.
    pub fn place(&mut self, lane: usize, address: u32, bounds: Aabb) {
        for axis in 0..3 {
            let steps = |v: f32| (v - self.origin[axis]) / self.step[axis];
            self.bounds[0][axis][lane] = (steps(bounds.min[axis]).floor() - 1.0).clamp(0.0, MAX_STEPS) as u16;
            self.bounds[1][axis][lane] = (steps(bounds.max[axis]).ceil() + 1.0).clamp(0.0, MAX_STEPS) as u16;
        }
        self.child[lane] = address;
        self.used |= 1 << lane;
    }

    /// The stored box of a child.
    pub fn bounds(&self, lane: usize) -> Aabb {
        let corner = |side: usize| {
            std::array::from_fn(|axis| {
                f32::from(self.bounds[side][axis][lane]).mul_add(self.step[axis], self.origin[axis])
            })
        };
        Aabb { min: glam::Vec3::from_array(corner(0)), max: glam::Vec3::from_array(corner(1)) }
    }
}

impl Extinctions {
    pub const NONE: Extinctions = Extinctions([[0; LANES]; AXIS_COUNT]);
}

impl CutBlock {
    /// Up to sixteen triangles.
    pub fn of(triangles: impl Iterator<Item = [glam::Vec3; 3]>) -> CutBlock {
        let zero = [[0.0; LANES]; 3];
        let mut block = CutBlock { corner: zero, edge1: zero, edge2: zero };
        for (lane, [a, b, c]) in triangles.enumerate() {
            for axis in 0..3 {
                block.corner[axis][lane] = a[axis];
                block.edge1[axis][lane] = b[axis] - a[axis];
                block.edge2[axis][lane] = c[axis] - a[axis];
            }
        }
        block
    }
}
