//! Boxes around the directions of the packets of a bundle.

use super::super::shaft::filled;
use crate::ray::Packet;
use crate::simd::{LANES, Simd};
use glam::Vec3;

/// Bounds of the directions of sixteen packets.
pub(super) struct Row {
    lo: [[f32; LANES]; 3],
    hi: [[f32; LANES]; 3],
    /// Packets with an unblocked segment.
    pub open: u32,
}

/// The packets of a bundle as tiles: boxes around their directions, computed when the first triangle needs them.
///
/// A triangle that misses a tile misses its packet, and one that covers a tile blocks the packet, both without testing
/// segments. Effective if the segments of each packet are close together, see [`crate::ray::gather_neighbours`].
#[derive(Default)]
pub(in super::super) struct Tiles {
    pub(super) rows: Vec<Row>,
}

impl Tiles {
    /// Removes the tiles of the last bundle.
    pub fn clear(&mut self) {
        self.rows.clear();
    }

    #[inline(always)]
    pub fn make<S: Simd>(&mut self, simd: S, packets: &[Packet], blocked: &[u32]) {
        for (packets, blocked) in packets.chunks(LANES).zip(blocked.chunks(LANES)) {
            let mut row = Row { lo: [[0.0; LANES]; 3], hi: [[0.0; LANES]; 3], open: 0 };
            for (k, (packet, blocked)) in packets.iter().zip(blocked).enumerate() {
                let [_, direction] = filled(simd, packet);
                for (axis, d) in direction.into_iter().enumerate() {
                    row.lo[axis][k] = simd.least(d);
                    row.hi[axis][k] = simd.greatest(d);
                }
                row.open |= u32::from(*blocked != packet.active) << k;
            }
            self.rows.push(row);
        }
    }
}

impl Row {
    /// Smallest and largest product of a plane with the directions of each packet.
    #[inline(always)]
    pub fn products<S: Simd>(&self, simd: S, plane: Vec3) -> (S::F, S::F) {
        let (mut least, mut greatest) = (simd.splat(0.0), simd.splat(0.0));
        for axis in 0..3 {
            let n = simd.splat(plane[axis]);
            let (near, far) = match plane[axis] > 0.0 {
                true => (&self.lo[axis], &self.hi[axis]),
                false => (&self.hi[axis], &self.lo[axis]),
            };
            least = simd.fma(n, simd.load(near), least);
            greatest = simd.fma(n, simd.load(far), greatest);
        }
        (least, greatest)
    }
}
