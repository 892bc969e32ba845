//! The traced scene, and sample points on facets.

use super::facets::Facet;
use crate::embree::{CommittedScene, Hits, Traversal};
use crate::math::sampling::mix;
use crate::math::triangle_normal;
use crate::model::Model;
use crate::ray::Packet;
use glam::Vec3;
use sobol_burley::sample_4d;

/// Rays sorted by direction are coherent enough for packets.
const TRAVERSAL: Traversal = Traversal { width: 16, coherent: false };

/// Length of the sample sequence; longer tables continue with another seed.
const SEQUENCE_SAMPLES: u32 = 1 << 16;

/// The scene in Embree with per-triangle data.
pub struct Traced {
    scene: CommittedScene,
    /// Unit normals of triangles.
    pub normals: Vec<Vec3>,
}

impl Traced {
    pub fn new(model: &Model) -> Traced {
        let scene = model.scene();
        let corners = (0..scene.triangles.len() as u32).map(|t| scene.corners(t));
        Traced {
            scene: model.traced().clone(),
            normals: corners.map(|[a, b, c]| triangle_normal(a, b, c)).collect(),
        }
    }

    pub fn first_hits(&self, packets: &[Packet], hits: &mut [Hits]) {
        self.scene.first_hits(TRAVERSAL, packets, hits);
    }

    /// The lanes of a packet that are blocked.
    pub fn blocked(&self, packet: &Packet) -> u32 {
        let width = if packet.active >> 4 == 0 { 4 } else { TRAVERSAL.width };
        let mut blocked = [0];
        self.scene.occluded_by(Traversal { width, ..TRAVERSAL }, std::slice::from_ref(packet), &mut blocked);
        blocked[0]
    }
}

/// Low-discrepancy points in the four-dimensional unit cube, sorted by the last two coordinates so that consecutive
/// points have similar directions. One table serves all facets: each facet shifts the digits by its own random bits
/// (digital shift of a digital net), which keeps the discrepancy and the order.
pub struct SampleTable(Vec<[u32; 4]>);

impl SampleTable {
    /// A table of `count` points; after each 65,536 points a new sequence starts.
    pub fn new(count: u32, seed: u32) -> SampleTable {
        let mut points: Vec<[u32; 4]> = (0..count)
            .map(|i| {
                let seed = seed.wrapping_add(i / SEQUENCE_SAMPLES);
                // f32 has 24 bits below 1.
                sample_4d(i % SEQUENCE_SAMPLES, 0, seed).map(|x| ((x * (1 << 24) as f32) as u32) << 8)
            })
            .collect();
        points.sort_by_key(|p| interleaved(p[2] >> 16, p[3] >> 16));
        SampleTable(points)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// The points, shifted by the bits of `key`; coordinates in `[0, 1)`.
    pub fn shifted(&self, key: u64) -> impl Iterator<Item = [f32; 4]> + '_ {
        let (a, b) = (mix(key), mix(!key));
        let bits = [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32];
        self.0.iter().map(move |p| std::array::from_fn(|d| ((p[d] ^ bits[d]) >> 8) as f32 / (1 << 24) as f32))
    }
}

/// Interleaves the bits of two 16-bit numbers (Morton 1966).
fn interleaved(a: u32, b: u32) -> u32 {
    let spread = |x: u32| {
        let x = (x | (x << 8)) & 0x00ff_00ff;
        let x = (x | (x << 4)) & 0x0f0f_0f0f;
        let x = (x | (x << 2)) & 0x3333_3333;
        (x | (x << 1)) & 0x5555_5555
    };
    spread(a) | spread(b) << 1
}

impl Facet {
    /// Maps two numbers in `[0, 1)` to a point of the facet, uniform by area, with the index of its triangle in the
    /// facet.
    #[inline]
    pub fn point(&self, mut u: f32, v: f32) -> (Vec3, usize) {
        if let Some([corner, first, second]) = self.parallelogram {
            return (corner + first * u + second * v, 0);
        }
        let mut k = 0;
        if self.triangles.len() > 1 {
            k = self.triangles.partition_point(|t| t.1 <= u).min(self.triangles.len() - 1);
            let from = if k == 0 { 0.0 } else { self.triangles[k - 1].1 };
            u = ((u - from) / (self.triangles[k].1 - from)).clamp(0.0, 1.0);
        }
        let ([a, b, c], root) = (self.triangles[k].0, u.sqrt());
        (a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v), k)
    }
}
