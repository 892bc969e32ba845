//! Which facets see which: rays from each, spread by the cosine.

use super::Settings;
use super::facets::Facets;
use super::rays::{Table, Traced};
use crate::embree::Hits;
use crate::ray::{LANES, Packet};
use glam::Vec3;

/// What the rays of a facet found.
pub struct Found {
    /// Facets whose fronts were met, ascending.
    pub partners: Vec<u32>,
    /// Share of the rays that met nothing.
    pub escaped: f32,
    /// Share that met a back side, or the facet itself.
    pub lost: f32,
}

/// Kept from facet to facet.
#[derive(Default)]
pub struct Buffers {
    table: Option<Table>,
    packets: Vec<Packet>,
    hits: Vec<Hits>,
    seen: Vec<u32>,
}

/// Rays that go to Embree at once.
const BATCH: usize = 64;

pub fn partners(
    traced: &Traced,
    facets: &Facets,
    settings: &Settings,
    facet: u32,
    buffers: &mut Buffers,
) -> Found {
    let Buffers { table, packets, hits, seen } = buffers;
    let table = table.get_or_insert_with(|| Table::new(settings.rays, settings.seed as u32));
    let from = facets.get(facet);
    seen.clear();
    let (mut escaped, mut lost) = (0u32, 0u32);
    let mut trace = |packets: &mut Vec<Packet>| {
        hits.resize(packets.len(), Hits::NONE);
        traced.first_hits(packets, hits);
        for (packet, hits) in packets.iter().zip(&*hits) {
            for lane in packet.lanes() {
                let t = hits.triangle[lane];
                if t == Hits::NOTHING {
                    escaped += 1;
                    continue;
                }
                let direction = Vec3::from(packet.direction.map(|axis| axis[lane]));
                let other = traced.facet[t as usize];
                if traced.normals[t as usize].dot(direction) >= 0.0 || other == facet {
                    lost += 1;
                } else {
                    seen.push(other);
                }
            }
        }
        packets.clear();
    };
    packets.clear();
    for (i, [u, v, s, t]) in table.shifted(settings.seed << 32 ^ u64::from(facet)).enumerate() {
        let (point, k) = from.point(u, v);
        let normal = from.normal(k).as_vec3();
        // A direction with density cos θ / π: a point of the disc, lifted.
        let (sin, cos) = (std::f32::consts::TAU * t).sin_cos();
        let (x, y) = normal.any_orthonormal_pair();
        let direction = (x * cos + y * sin) * s.sqrt() + normal * (1.0 - s).sqrt();
        let lane = i % LANES;
        if lane == 0 {
            if packets.len() == BATCH {
                trace(packets);
            }
            packets.push(Packet::EMPTY);
        }
        if let Some(packet) = packets.last_mut() {
            packet.set_ray(lane, point + traced.skin * normal, direction);
        }
    }
    trace(packets);
    seen.sort_unstable();
    seen.dedup();
    let share = |n: u32| n as f32 / settings.rays as f32;
    Found { partners: seen.clone(), escaped: share(escaped), lost: share(lost) }
}

/// For each facet the partners with a higher number, ascending: found by either of the two.
pub fn upper(found: &[Found]) -> Vec<Vec<u32>> {
    let mut upper: Vec<Vec<u32>> = vec![Vec::new(); found.len()];
    for (i, f) in found.iter().enumerate() {
        for &j in &f.partners {
            upper[i.min(j as usize)].push(j.max(i as u32));
        }
    }
    upper.iter_mut().for_each(|u| {
        u.sort_unstable();
        u.dedup();
        u.shrink_to_fit();
    });
    upper
}
