//! Tests of the triangles of a block against the segments of a bundle.
//!
//! The volumes of Möller and Trumbore 1997: with v = o - corner, det = d · (e2 × e1), a det = d · (e2 × v), b det = d
//! · (v × e1), t det = e2 · (v × e1). For segments from one point o only d varies, so a triangle is three planes
//! through o, and a segment is inside if it lies on the right side of each: three products per packet and no division.
//! The edges of the bundle's pyramid reject or accept all segments at once.

use super::shaft::{FromReceiver, Pyramid, Shaft, filled};
use super::wide::WideBlock;
use crate::ray::{Lanes, Packet};
use crate::simd::vector::{self, Vector};
use crate::simd::{LANES, Simd};
use glam::Vec3;

/// Widening of the edges of fans relative to the largest product: the two roundings of a multiplication and an
/// addition, 2 · 2⁻²⁴.
const FAN_EDGE_WIDENING: f32 = f32::EPSILON;

/// Result of testing a block.
#[derive(Clone, Copy, Default)]
pub(super) struct BlockTests {
    /// Whether a triangle was tested segment by segment.
    pub any: bool,
    /// Number of tests of a triangle against a packet, or of equivalent work.
    pub work: u64,
    /// Whether all segments are blocked.
    pub all: bool,
}

/// Tests a block against all packets of a bundle; adds the blocked lanes to `blocked`, one mask per packet.
#[inline(always)]
pub(super) fn block_all<S: Simd>(
    simd: S,
    shaft: &Shaft,
    block: &WideBlock,
    packets: &[Packet],
    tiles: &mut Tiles,
    blocked: &mut [u32],
) -> BlockTests {
    let corner = vector::load(simd, &block.corner);
    let (edge1, edge2) = (vector::load(simd, &block.edge1), vector::load(simd, &block.edge2));
    let misses = shaft.misses(simd, &corner, [&edge1, &edge2]);
    let touched = block.used & !simd.bits(misses);
    if touched == 0 {
        return BlockTests::default();
    }
    let normal = vector::cross(simd, &edge2, &edge1);
    let harmless = shaft.on_one_side(simd, &corner, &normal);
    let mut touched = touched & !simd.bits(harmless);
    if shaft.whole && touched != 0 {
        touched &= !simd.bits(shaft.beside(simd, &corner, [&edge1, &edge2]));
    }
    if touched == 0 {
        return BlockTests::default();
    }
    match &shaft.pyramid {
        Some(pyramid) => {
            let fans = Fans::of(simd, shaft, pyramid, &corner, &edge1, &edge2, &normal);
            fans.block(simd, block, touched, packets, tiles, blocked)
        }
        None => each(simd, block, touched, packets, blocked),
    }
}

/// Triangles of a block that the shaft of a group of bundles may meet, as a mask.
#[inline(always)]
pub(super) fn candidates<S: Simd>(simd: S, shaft: &Shaft, block: &WideBlock) -> u32 {
    let corner = vector::load(simd, &block.corner);
    let (edge1, edge2) = (vector::load(simd, &block.edge1), vector::load(simd, &block.edge2));
    let misses = shaft.misses(simd, &corner, [&edge1, &edge2]);
    let normal = vector::cross(simd, &edge2, &edge1);
    let harmless = simd.or(misses, shaft.on_one_side(simd, &corner, &normal));
    block.used & !simd.bits(harmless)
}

/// Tests triangles one by one against each segment.
#[inline(always)]
fn each<S: Simd>(
    simd: S,
    block: &WideBlock,
    candidates: u32,
    packets: &[Packet],
    blocked: &mut [u32],
) -> BlockTests {
    let mut tested = BlockTests { any: true, ..BlockTests::default() };
    for k in Lanes(candidates) {
        let triangle = Triangle::of(block, k);
        tested.work += 1 + packets.len() as u64;
        tested.all = true;
        for (packet, blocked) in packets.iter().zip(&mut *blocked) {
            if *blocked != packet.active {
                *blocked |= triangle.blocks(simd, packet) & packet.active;
                tested.all &= *blocked == packet.active;
            }
        }
        if tested.all {
            break;
        }
    }
    tested
}

/// Bundles of more packets than this are tested by tiles. A triangle costs 2 units of work for a row of tiles and 1 for
/// each packet it meets, instead of 1 for each packet: tiles pay from 4 packets if a triangle meets half of them.
const MAX_UNTILED_PACKETS: usize = 4;

/// The triangles of a block as fans of three planes each through the common receiver end.
struct Fans {
    /// A segment's line passes through the triangle, ahead of the receiver end, where all three products of planes and
    /// direction are >= 0. The products sum to the determinant.
    planes: [[[f32; LANES]; 3]; 3],
    /// t times the determinant, >= 0.
    height: [f32; LANES],
    /// Mask of triangles whose height had to change its sign.
    turned: u32,
    /// Bounds of the products' rounding errors.
    rounding: [f32; LANES],
    /// Mask of triangles that block every segment.
    covering: u32,
    /// Mask of triangles that no segment hits.
    missed: u32,
    /// Mask of triangles whose hits all lie beyond `near` and before `far`.
    amid: u32,
}

impl Fans {
    #[inline(always)]
    fn of<S: Simd>(
        simd: S,
        shaft: &Shaft,
        pyramid: &Pyramid,
        corner: &Vector<S>,
        edge1: &Vector<S>,
        edge2: &Vector<S>,
        normal: &Vector<S>,
    ) -> Fans {
        let zero = simd.splat(0.0);
        let v = vector::sub(simd, &vector::splat(simd, pyramid.apex), corner);
        let q = vector::cross(simd, &v, edge1);
        let height = vector::dot(simd, edge2, &q);
        // A triangle ahead of the receiver end has a determinant with the sign of the height.
        let below = simd.lt(height, zero);
        let sign = simd.select(below, simd.splat(-1.0), simd.splat(1.0));
        let height = simd.abs(height);
        let normal = vector::scaled(simd, sign, normal);
        let p = vector::scaled(simd, sign, &vector::cross(simd, edge2, &v));
        let q = vector::scaled(simd, sign, &q);
        let (a, b) = (p, q);
        let c = vector::sub(simd, &vector::sub(simd, &normal, &a), &b);
        let edges = simd.add(vector::sum_abs(simd, edge1), vector::sum_abs(simd, edge2));
        let reach = simd.add(vector::sum_abs(simd, &v), edges);
        let rounding = simd.mul(simd.mul(edges, reach), simd.splat(FAN_EDGE_WIDENING));
        let determinants = at_corners(simd, &normal, pyramid);
        let (least, _) = extremes(simd, determinants);
        // The corners must be inside or outside by more than rounding; MAX_SLOPE limits their lengths.
        let clearly = simd.mul(rounding, simd.splat(2.0 * pyramid.longest));
        let (mut missed, mut covering) = (simd.mask(0), simd.mask(0xffff));
        for plane in [&a, &b, &c] {
            let (low, high) = extremes(simd, at_corners(simd, plane, pyramid));
            missed = simd.or(missed, simd.lt(high, simd.sub(zero, clearly)));
            covering = simd.and(covering, simd.lt(clearly, low));
        }
        // Hits lie between the triangle's corners, and between the intersections of the pyramid's edges with its plane
        // if all edges intersect it.
        let (low, high) = shaft.reach(simd, corner, [edge1, edge2]);
        let mut amid = simd.bits(shaft.amid(simd, low, high));
        let crossed = simd.bits(simd.lt(zero, least));
        if crossed & !amid != 0 {
            let mut places = determinants;
            for (place, corner) in places.iter_mut().zip(&pyramid.corners) {
                *place = simd.div(simd.mul(height, simd.splat(shaft.along(*corner))), *place);
            }
            let (low, high) = extremes(simd, places);
            amid |= crossed & simd.bits(shaft.amid(simd, low, high));
        }
        let mut fans = Fans {
            planes: [[[0.0; LANES]; 3]; 3],
            height: [0.0; LANES],
            turned: simd.bits(below),
            rounding: [0.0; LANES],
            covering: simd.bits(covering) & crossed & amid,
            missed: simd.bits(missed),
            amid,
        };
        vector::store(simd, &a, &mut fans.planes[0]);
        vector::store(simd, &b, &mut fans.planes[1]);
        vector::store(simd, &c, &mut fans.planes[2]);
        simd.store(height, &mut fans.height);
        simd.store(simd.mul(rounding, simd.splat(shaft.longest())), &mut fans.rounding);
        fans
    }

    #[inline(always)]
    fn block<S: Simd>(
        &self,
        simd: S,
        block: &WideBlock,
        touched: u32,
        packets: &[Packet],
        tiles: &mut Tiles,
        blocked: &mut [u32],
    ) -> BlockTests {
        if touched & self.covering != 0 {
            packets.iter().zip(blocked).for_each(|(packet, blocked)| *blocked = packet.active);
            return BlockTests { all: true, ..BlockTests::default() };
        }
        let mut touched = touched & !self.missed;
        let mut tested = BlockTests { any: touched != 0, ..BlockTests::default() };
        let near_an_end = touched & !self.amid;
        if near_an_end != 0 && packets.iter().any(|packet| packet.backwards != 0) {
            // The common end has rounding errors that are larger than the margins at the other ends.
            let alone = each(simd, block, near_an_end, packets, blocked);
            (tested.work, tested.all) = (alone.work, alone.all);
            touched &= self.amid;
            if tested.all {
                return tested;
            }
        }
        if packets.len() <= MAX_UNTILED_PACKETS {
            for k in Lanes(touched) {
                let plane = self.planes_of(simd, block, k);
                tested.work += 1 + packets.len() as u64;
                tested.all = true;
                for (packet, blocked) in packets.iter().zip(&mut *blocked) {
                    *blocked |= plane.hits(simd, packet);
                    tested.all &= *blocked == packet.active;
                }
                if tested.all {
                    break;
                }
            }
            return tested;
        }
        if tested.any && tiles.rows.is_empty() {
            tiles.make(simd, packets, blocked);
            tested.work += packets.len() as u64;
        }
        for k in Lanes(touched) {
            let plane = self.planes_of(simd, block, k);
            tested.work += 1;
            tested.all = true;
            for (row, first) in tiles.rows.iter_mut().zip((0..).step_by(LANES)) {
                if row.open == 0 {
                    continue;
                }
                tested.work += 2;
                let (met, covered) = self.tiles(simd, k, row);
                for i in Lanes(covered) {
                    blocked[first + i] = packets[first + i].active;
                }
                row.open &= !covered;
                for i in Lanes(met & row.open) {
                    let (packet, blocked) = (&packets[first + i], &mut blocked[first + i]);
                    tested.work += 1;
                    *blocked |= plane.hits(simd, packet);
                    row.open &= !(u32::from(*blocked == packet.active) << i);
                }
                tested.all &= row.open == 0;
            }
            if tested.all {
                break;
            }
        }
        tested
    }

    /// Masks of the open packets of a row that triangle `k` may block partly, and of those that it blocks entirely.
    #[inline(always)]
    fn tiles<S: Simd>(&self, simd: S, k: usize, row: &TileRow) -> (u32, u32) {
        // Twice the bound for single products, because bounds of products add their own rounding.
        let clearly = simd.splat(2.0 * self.rounding[k]);
        let beside = simd.sub(simd.splat(0.0), clearly);
        let (mut met, mut covered) = (simd.mask(row.open), simd.mask(row.open));
        for plane in &self.planes {
            let n = Vec3::new(plane[0][k], plane[1][k], plane[2][k]);
            let (least, greatest) = row.products(simd, n);
            met = simd.and(met, simd.le(beside, greatest));
            covered = simd.and(covered, simd.lt(clearly, least));
        }
        let amid = self.amid >> k & 1 == 1;
        (simd.bits(met), if amid { simd.bits(covered) } else { 0 })
    }

    #[inline(always)]
    fn planes_of<S: Simd>(&self, simd: S, block: &WideBlock, k: usize) -> Planes<S> {
        let normal = || {
            let edge = |edge: &[[f32; LANES]; 3]| Vec3::new(edge[0][k], edge[1][k], edge[2][k]);
            let normal = edge(&block.edge2).cross(edge(&block.edge1));
            vector::splat(simd, if self.turned >> k & 1 == 1 { -normal } else { normal })
        };
        Planes {
            planes: [
                pick(simd, &self.planes[0], k),
                pick(simd, &self.planes[1], k),
                pick(simd, &self.planes[2], k),
            ],
            height: simd.splat(self.height[k]),
            rounding: simd.splat(self.rounding[k]),
            normal: (self.amid >> k & 1 == 0).then(normal),
        }
    }
}

/// The planes of one triangle, repeated in every lane; see [`Fans`].
struct Planes<S: Simd> {
    planes: [Vector<S>; 3],
    height: S::F,
    rounding: S::F,
    /// If a segment may end on the triangle. The product with the direction is the determinant, without the rounding of products with
    /// the distance in the sum of the three planes' products.
    normal: Option<Vector<S>>,
}

impl<S: Simd> Planes<S> {
    /// Active lanes of a packet that the triangle blocks.
    #[inline(always)]
    fn hits(&self, simd: S, packet: &Packet) -> u32 {
        let FromReceiver { direction: d, near, far, .. } = FromReceiver::of(simd, packet);
        let [a, b, c] = &self.planes;
        let [a, b, c] = [vector::dot(simd, a, &d), vector::dot(simd, b, &d), vector::dot(simd, c, &d)];
        // All three products are >= 0 where the smallest is; an edge-on triangle blocks nothing.
        let det = simd.add(simd.add(a, b), c);
        let beside = simd.sub(simd.splat(0.0), self.rounding);
        let inside = simd.le(beside, simd.min(simd.min(a, b), c));
        let mut hit = simd.and(inside, simd.lt(self.rounding, det));
        if let Some(normal) = &self.normal {
            let det = vector::dot(simd, normal, &d);
            let beyond = simd.le(simd.mul(near, det), self.height);
            let before = simd.le(self.height, simd.mul(far, det));
            hit = simd.and(hit, simd.and(beyond, before));
        }
        simd.bits(hit) & packet.active
    }
}

/// Vector `k` of sixteen, repeated in every lane.
#[inline(always)]
fn pick<S: Simd>(simd: S, v: &[[f32; LANES]; 3], k: usize) -> Vector<S> {
    vector::splat(simd, Vec3::new(v[0][k], v[1][k], v[2][k]))
}

/// Products of planes with the pyramid's edges.
#[inline(always)]
fn at_corners<S: Simd>(simd: S, plane: &Vector<S>, pyramid: &Pyramid) -> [S::F; 4] {
    let [a, b, c, d] = pyramid.corners;
    [
        vector::dot(simd, plane, &vector::splat(simd, a)),
        vector::dot(simd, plane, &vector::splat(simd, b)),
        vector::dot(simd, plane, &vector::splat(simd, c)),
        vector::dot(simd, plane, &vector::splat(simd, d)),
    ]
}

/// Smallest and largest of four values, per lane.
#[inline(always)]
fn extremes<S: Simd>(simd: S, [i, j, k, l]: [S::F; 4]) -> (S::F, S::F) {
    (simd.min(simd.min(i, j), simd.min(k, l)), simd.max(simd.max(i, j), simd.max(k, l)))
}

/// Widening of edges relative to the determinant, so that no segment passes between adjacent triangles. An edge
/// function rounds at most 6 times (difference 1, cross product 2, dot product 3) by 2⁻²⁴ = 6e-8, which is 3.6e-7; the
/// value leaves a factor of nearly 3.
const EDGE_WIDENING: f32 = 1e-6;

/// A triangle for tests against segments without a common end.
struct Triangle {
    corner: Vec3,
    edge1: Vec3,
    edge2: Vec3,
    /// e2 × e1.
    normal: Vec3,
}

impl Triangle {
    #[inline(always)]
    pub fn of(block: &WideBlock, k: usize) -> Triangle {
        let pick = |v: &[[f32; LANES]; 3]| Vec3::new(v[0][k], v[1][k], v[2][k]);
        let (corner, edge1, edge2) = (pick(&block.corner), pick(&block.edge1), pick(&block.edge2));
        Triangle { corner, edge1, edge2, normal: edge2.cross(edge1) }
    }

    /// Lanes that the triangle blocks.
    #[inline(always)]
    pub fn blocks<S: Simd>(&self, simd: S, packet: &Packet) -> u32 {
        let (e1, e2) = (vector::splat(simd, self.edge1), vector::splat(simd, self.edge2));
        let d = vector::load(simd, &packet.direction);
        let v = vector::sub(simd, &vector::load(simd, &packet.origin), &vector::splat(simd, self.corner));
        let (p, q) = (vector::cross(simd, &e2, &v), vector::cross(simd, &v, &e1));
        let det = vector::dot(simd, &d, &vector::splat(simd, self.normal));
        // All volumes are multiplied by the sign of the determinant.
        let zero = simd.splat(0.0);
        let back = simd.lt(det, zero);
        let sign = simd.select(back, simd.splat(-1.0), simd.splat(1.0));
        let a = simd.mul(sign, vector::dot(simd, &d, &p));
        let b = simd.mul(sign, vector::dot(simd, &d, &q));
        let t = simd.mul(sign, vector::dot(simd, &e2, &q));
        let det = simd.mul(sign, det);
        let slack = simd.mul(det, simd.splat(-EDGE_WIDENING));
        let inside = simd.and(simd.le(slack, a), simd.le(slack, b));
        let inside = simd.and(inside, simd.le(simd.add(simd.add(a, b), slack), det));
        let reach = simd.and(
            simd.le(simd.mul(simd.load(&packet.near), det), t),
            simd.le(t, simd.mul(simd.load(&packet.far), det)),
        );
        simd.bits(simd.and(simd.and(inside, reach), simd.lt(zero, det)))
    }
}

// Boxes around the directions of the packets of a bundle.

/// Bounds of the directions of sixteen packets.
struct TileRow {
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
pub(super) struct Tiles {
    rows: Vec<TileRow>,
}

impl Tiles {
    /// Removes the tiles of the last bundle.
    pub fn clear(&mut self) {
        self.rows.clear();
    }

    #[inline(always)]
    pub fn make<S: Simd>(&mut self, simd: S, packets: &[Packet], blocked: &[u32]) {
        for (packets, blocked) in packets.chunks(LANES).zip(blocked.chunks(LANES)) {
            let mut row = TileRow { lo: [[0.0; LANES]; 3], hi: [[0.0; LANES]; 3], open: 0 };
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

impl TileRow {
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
