//! What lies around receiver points.
//!
//! From each point 64 stratified rays, with the density of the cosine over its hemisphere, find what they meet first. A surface is large
//! if its smooth part is at least a 64th of the scene wide, as in the distance cut, which never averages it. A point is
//! * `interior` if large surfaces enclose it: less than a quarter of the rays leave the scene or end on an emitter, and more than half
//!   end on large surfaces;
//! * else `inside` if it lies on a surface that is not large: a leaf, a twig, a blade of grass;
//! * else `near` if a ray ends within a 64th of the scene on a surface that is neither large nor emits;
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

/// Surfaces of a model by size.
pub(super) struct Surroundings<'a> {
    model: &'a Model,
    /// Width of the smooth surface of each triangle of each mesh, in the frame of the mesh.
    widths: Vec<Vec<f32>>,
    /// Smallest width of a large surface, and distance of what is near; scene units.
    large: f32,
}

/// What a ray meets first.
enum Met {
    Nothing,
    Emitter,
    Large,
    /// A surface that is not large.
    Small,
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
        let rule = EndRule::new(point.magnitude);
        let from = rule.lifted(point.position, point.normal);
        let mut packets = [Packet::EMPTY; RAYS / LANES + 1];
        for k in 0..RAYS {
            let [u, v, ..] = numbers(seed, k as u64);
            let place = |cell: usize, within: f32| (cell as f32 + within) / ACROSS as f32;
            let towards = cosine_direction(point.normal, place(k % ACROSS, u), place(k / ACROSS, v));
            packets[k / LANES].set_ray(k % LANES, from, towards);
        }
        // The last ray leads back to the surface that the point lies on.
        packets[RAYS / LANES].set_ray(0, from, -point.normal);
        packets[RAYS / LANES].far[0] = 2.0 * rule.height();
        let mut hits = [Hits::NONE; RAYS / LANES + 1];
        self.model.traced().first_hits(self.model.widest_packets(), &packets, &mut hits);
        let (mut lit, mut large, mut near) = (0, 0, false);
        for k in 0..RAYS {
            let (hits, lane) = (&hits[k / LANES], k % LANES);
            match self.met(hits, lane) {
                Met::Nothing | Met::Emitter => lit += 1,
                Met::Large => large += 1,
                Met::Small => near |= hits.t[lane] <= self.large,
            }
        }
        if 4 * lit < RAYS && 2 * large > RAYS {
            ReceiverClass::Interior
        } else if matches!(self.met(&hits[RAYS / LANES], 0), Met::Small) {
            ReceiverClass::Inside
        } else if near {
            ReceiverClass::Near
        } else {
            ReceiverClass::Open
        }
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
    instance.transform.matrix3.determinant().abs().cbrt() as f32
}
