//! What lies around receiver points.
//!
//! From each point 64 stratified rays, with the density of the cosine over its hemisphere, find what they meet. A surface is large if its
//! smooth part is at least a 64th of the scene wide, as in the distance cut, which never averages it; others that do not emit are small. A
//! point is
//! * `interior` if large surfaces enclose it: less than a quarter of the rays leave the scene or end on an emitter, and more than half
//!   end on large surfaces. The rays pass up to four small surfaces on the way, and from a point on a small surface as many start on its
//!   back: the underside of a leaf sees nothing but the lawn, and is not in a room;
//! * else `inside` if it lies on a small surface: a leaf, a twig, a blade of grass;
//! * else `near` if a ray meets a small surface within a 64th of the scene;
//! * else `open`.
//!
//! Classes are found before anything is timed, and are the same for both engines.

use crate::bench::record::ReceiverClass;
use crate::bench::workload::ReceiverPoint;
use crate::embree::Hits;
use crate::math::sampling::{cosine_direction, mix, numbers};
use crate::model::{Instance, Model};
use crate::ray::{EndRule, LANES, Packet};
use crate::visibility::{SURFACE_PART, surface_widths};
use rayon::prelude::*;

/// Rays along one side of the square that is mapped to the hemisphere. Shares of 64 stratified rays are known to less than
/// √(¼ / 64) = 6 %.
const ACROSS: usize = 8;
const RAYS: usize = ACROSS * ACROSS;
/// Small surfaces that a ray passes on its way to a large one: both sides of two objects of a room.
const MAX_PASSED: usize = 4;

/// Surfaces of a model by size.
pub(super) struct Surroundings<'a> {
    model: &'a Model,
    /// Width of the smooth surface of each triangle of each mesh, in the frame of the mesh.
    widths: Vec<Vec<f32>>,
    /// Smallest width of a large surface, and distance of what is near; scene units.
    large: f32,
}

/// What a ray meets first.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Met {
    Nothing,
    Emitter,
    Large,
    /// A surface that is not large.
    Small,
}

/// Counts of the rays of a point.
#[derive(Clone, Copy, Default)]
struct Seen {
    rays: usize,
    /// Rays that leave the scene or end on an emitter, small surfaces passed.
    lit: usize,
    /// Rays that end on a large surface, small ones passed.
    large: usize,
    /// Whether a ray meets a small surface near.
    near: bool,
}

impl Seen {
    fn add(&mut self, other: Seen) {
        self.rays += other.rays;
        self.lit += other.lit;
        self.large += other.large;
    }

    /// Whether large surfaces are around on nearly all sides.
    fn encloses(&self) -> bool {
        4 * self.lit < self.rays && 2 * self.large > self.rays
    }
}

impl<'a> Surroundings<'a> {
    pub fn of(model: &'a Model) -> Surroundings<'a> {
        let widths = model.meshes().iter().map(|mesh| surface_widths(mesh.scene())).collect();
        Surroundings { model, widths, large: SURFACE_PART * model.scene().size() }
    }

    /// The class of each point.
    pub fn classes(&self, points: &[ReceiverPoint], seed: u64) -> Vec<ReceiverClass> {
        let indexed = points.par_iter().enumerate();
        indexed.map(|(i, point)| self.class(point, mix(seed ^ i as u64))).collect()
    }

    fn class(&self, point: &ReceiverPoint, seed: u64) -> ReceiverClass {
        let own = self.surface_of(point);
        let front = self.seen(point, seed);
        let mut around = front;
        if own == Met::Small {
            let back = ReceiverPoint { normal: -point.normal, ..*point };
            around.add(self.seen(&back, mix(seed)));
        }
        if around.encloses() {
            ReceiverClass::Interior
        } else if own == Met::Small {
            ReceiverClass::Inside
        } else if front.near {
            ReceiverClass::Near
        } else {
            ReceiverClass::Open
        }
    }

    /// The surface that a point lies on.
    fn surface_of(&self, point: &ReceiverPoint) -> Met {
        let rule = EndRule::new(point.magnitude);
        let mut packet = Packet::EMPTY;
        packet.set_ray(0, rule.lifted(point.position, point.normal), -point.normal);
        packet.far[0] = 2.0 * rule.height();
        let mut hits = [Hits::NONE];
        self.model.traced().first_hits(self.model.widest_packets(), &[packet], &mut hits);
        self.met(&hits[0], 0)
    }

    /// What rays from a point see on the side of its normal.
    fn seen(&self, point: &ReceiverPoint, seed: u64) -> Seen {
        let rule = EndRule::new(point.magnitude);
        let from = rule.lifted(point.position, point.normal);
        let mut packets = [Packet::EMPTY; RAYS / LANES];
        for k in 0..RAYS {
            let [u, v, ..] = numbers(seed, k as u64);
            let place = |cell: usize, within: f32| (cell as f32 + within) / ACROSS as f32;
            let towards = cosine_direction(point.normal, place(k % ACROSS, u), place(k / ACROSS, v));
            packets[k / LANES].set_ray(k % LANES, from, towards);
        }
        let mut seen = Seen { rays: RAYS, ..Seen::default() };
        for passed in 0..=MAX_PASSED {
            let mut hits = [Hits::NONE; RAYS / LANES];
            self.model.traced().first_hits(self.model.widest_packets(), &packets, &mut hits);
            for (packet, hits) in packets.iter_mut().zip(&hits) {
                for lane in packet.lanes() {
                    match self.met(hits, lane) {
                        Met::Small => {
                            seen.near |= passed == 0 && hits.t[lane] <= self.large;
                            packet.near[lane] = hits.t[lane] + rule.left_out();
                            continue;
                        }
                        Met::Large => seen.large += 1,
                        Met::Nothing | Met::Emitter => seen.lit += 1,
                    }
                    packet.active &= !(1 << lane);
                }
            }
        }
        seen
    }

    fn met(&self, hits: &Hits, lane: usize) -> Met {
        let (triangle, instance) = (hits.triangle[lane], hits.instance[lane] as usize);
        if triangle == Hits::NOTHING {
            return Met::Nothing;
        }
        let instance = &self.model.instances()[instance];
        // Emitters are among the scene's own triangles, which mesh 0 holds.
        if instance.mesh == 0 && self.model.scene().triangle_emitter[triangle as usize] != u32::MAX {
            return Met::Emitter;
        }
        let width = self.widths[instance.mesh as usize][triangle as usize];
        if width * scale(instance) >= self.large { Met::Large } else { Met::Small }
    }
}

/// Ratio of a length that an instance places to that in its mesh.
fn scale(instance: &Instance) -> f32 {
    instance.affine().matrix3.determinant().abs().cbrt() as f32
}
