//! Rays on from places: what one finds, and how far paths are followed before an element is taken at its word.

use super::field::{Rgb, add};
use super::receive::{Buffers, Receiver};
use crate::embree::Hits;
use crate::radiosity::elements::Elements;
use crate::radiosity::links::{Question, Sight, cosine_direction, mix, numbers};
use crate::ray::{LANES, Packet};
use glam::Vec3;

/// Bounces of a path at most: in narrow gaps all elements are near.
const BOUNCES: u64 = 8;
/// The same of one that is to be independent of the solution, and the bounce from which it ends by chance (Russian roulette,
/// Arvo and Kirk 1990).
const LAST: u64 = 256;
const CHANCE: u64 = 3;

/// A place on a surface.
#[derive(Clone, Copy)]
pub struct Place {
    /// Where.
    pub at: Vec3,
    /// Whose side it is; [`Elements::NONE`] if it is nowhere.
    pub side: u32,
    /// The element that holds it.
    pub leaf: u32,
    /// What becomes of a unit of light that leaves here, by channel.
    pub share: Vec3,
}

/// What a ray from a place has found.
#[derive(Clone, Copy)]
pub struct Found {
    /// What emitters send, an estimate of the irradiance, W/m².
    pub direct: Vec3,
    /// What the ray met.
    pub met: Place,
    /// How far away that is, scene units.
    pub distance: f32,
    /// The ray left the scene.
    pub gone: bool,
}

impl Found {
    const NOTHING: Found = Found {
        direct: Vec3::ZERO,
        met: Place { at: Vec3::ZERO, side: Elements::NONE, leaf: 0, share: Vec3::ZERO },
        distance: 0.0,
        gone: false,
    };
}

impl Receiver<'_> {
    /// Whether an element may stand for a place on it: it is met from further away than it is large. From nearby its mean
    /// light is not what is seen of it (secondary final gathers, Jensen 2001).
    fn trusted(&self, met: &Place, distance: f32) -> bool {
        distance >= self.sizes[met.leaf as usize]
    }

    /// Where a ray of a packet ended.
    pub(super) fn met(&self, packet: &Packet, hits: &Hits, lane: usize) -> Option<Place> {
        let triangle = hits.triangle[lane];
        if triangle == Hits::NOTHING {
            return None;
        }
        let (from, at) = (packet.point(lane, 0.0), packet.point(lane, hits.t[lane]));
        let side = self.solver.elements.met(triangle, at - from);
        if side == Elements::NONE {
            return None;
        }
        let leaf = self.lookup.leaf(side, at);
        Some(Place { at, side, leaf, share: Vec3::ONE })
    }

    /// One cosine-weighted ray and one shadow ray from each of `buffers.places`, to `buffers.found`. `of` gives four
    /// numbers in `[0, 1)` for each: the direction and the place on an emitter; `sight` says whether that is seen.
    pub(super) fn look_around(&self, sight: &Sight, of: impl Fn(usize) -> [f32; 4], buffers: &mut Buffers) {
        let Buffers { packets, hits, places, found, scratch, .. } = buffers;
        let elements = &self.solver.elements;
        packets.clear();
        for (i, place) in places.iter().enumerate() {
            if i % LANES == 0 {
                packets.push(Packet::EMPTY);
            }
            let [u, v, ..] = of(i);
            let normal = elements.sides[place.side as usize].normal;
            let from = place.at + 2e-6 * self.magnitude * normal;
            let to = from + self.length * cosine_direction(normal, u, v);
            let (packet, lane) = (&mut packets[i / LANES], i % LANES);
            packet.set(lane, from, to, self.solver.ends);
            packet.near[lane] = 0.0;
        }
        hits.clear();
        hits.resize(packets.len(), Hits::NONE);
        self.traced.first_hits(self.traversal, packets, hits);
        scratch.tally.segments += places.len() as u64;
        scratch.tally.exact_rays += places.len() as u64;
        found.clear();
        let scattered = sight.scattered();
        for (g, (group, (packet, hits))) in
            places.chunks(LANES).zip(packets.iter().zip(hits.iter())).enumerate()
        {
            let mut shadow = Packet::EMPTY;
            let mut light = [Vec3::ZERO; LANES];
            for (lane, place) in group.iter().enumerate() {
                let own = (place.at, elements.sides[place.side as usize].normal);
                let gone = hits.triangle[lane] == Hits::NOTHING;
                let mut here = Found { gone, ..Found::NOTHING };
                if let Some(met) = self.met(packet, hits, lane) {
                    (here.met, here.distance) = (met, hits.t[lane] * self.length);
                    let side = &elements.sides[met.side as usize];
                    if side.exitance.iter().any(|&m| m > 0.0) {
                        let q = self.lamps.ratio(own, (met.at, side.normal), side.exitance);
                        here.direct = q / (1.0 + q) * watts(side.exitance);
                    }
                }
                found.push(here);
                let [.., u, v] = of(g * LANES + lane);
                if let Some((at, face)) = self.lamps.pick(u, v) {
                    let q = self.lamps.ratio(own, (at, face.normal), face.exitance);
                    if q > 0.0 {
                        shadow.set(lane, place.at, at, self.solver.ends);
                        light[lane] = q / (1.0 + q) * watts(face.exitance);
                    }
                }
            }
            if shadow.is_empty() {
                continue;
            }
            // Rays of one element to one emitter lie together.
            let together = self.lamps.emitters.len() == 1 && group.iter().all(|p| p.leaf == group[0].leaf);
            let sight = if together { sight } else { &scattered };
            let given = self.solver.given_size(group[0].leaf as usize);
            let feature_size = given.unwrap_or(self.feature_size);
            let question = Question { packet: shadow, emitter_size: self.lamps.width, feature_size };
            let through = sight.transmittances(&question, scratch);
            for lane in question.packet.lanes() {
                found[g * LANES + lane].direct += through[lane] * light[lane];
            }
        }
    }

    /// Adds what all of `buffers.places` send on, each times its share: what emitters light it with, and what a ray finds,
    /// which is followed until what it meets may be trusted. With `doubting` nothing is, and exact rays answer.
    pub(super) fn follow(&self, seed: u64, doubting: bool, sum: &mut Rgb, buffers: &mut Buffers) {
        let (last, sight) = if doubting {
            (LAST, &Sight::Exact(self.solver.sight.exact()))
        } else {
            (BOUNCES, &self.solver.sight)
        };
        for bounce in 1..=last {
            if buffers.places.is_empty() {
                return;
            }
            let seed = mix(seed ^ bounce);
            self.look_around(sight, |i| numbers(seed, i as u64), buffers);
            let Buffers { places, found, beyond, .. } = buffers;
            beyond.clear();
            for (i, (place, found)) in places.iter().zip(found.iter()).enumerate() {
                let mut received = found.direct;
                if found.met.side != Elements::NONE {
                    if bounce == last || (!doubting && self.trusted(&found.met, found.distance)) {
                        received += Vec3::from(self.reflected[found.met.leaf as usize]);
                    } else {
                        let next = self.onward(found.met, place.share);
                        let stays = next.share.max_element().min(1.0);
                        let [chance, ..] = numbers(!seed, i as u64);
                        if !doubting || bounce < CHANCE {
                            beyond.push(next);
                        } else if chance < stays {
                            beyond.push(Place { share: next.share / stays, ..next });
                        }
                    }
                }
                add(sum, 1.0, (place.share * received).to_array().map(f64::from));
            }
            std::mem::swap(places, beyond);
        }
    }

    /// The place that a path goes on from, or what it reflects if that is known well enough.
    pub(super) fn taken(&self, met: Place, distance: f32) -> Result<Vec3, Place> {
        if self.trusted(&met, distance) {
            Ok(Vec3::from(self.reflected[met.leaf as usize]))
        } else {
            Err(self.onward(met, Vec3::ONE))
        }
    }

    fn onward(&self, met: Place, share: Vec3) -> Place {
        let reflectance = Vec3::from(self.solver.elements.sides[met.side as usize].reflectance);
        Place { share: share * reflectance, ..met }
    }
}

fn watts(exitance: Rgb) -> Vec3 {
    Vec3::from(exitance.map(|m| m as f32))
}
