//! Which facets see which: rays from each, spread by the cosine.

use super::Settings;
use super::facets::Facets;
use super::rays::{SampleTable, Traced};
use crate::embree::Hits;
use crate::ray::{LANES, Packet};
use glam::Vec3;

/// A facet whose front was met, and how often, up to [`Partner::MOST`], in one number: there are very many of them.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Partner(u32);

impl Partner {
    const BITS: u32 = 6;
    /// Hits that are told apart.
    pub const MOST: u32 = (1 << Partner::BITS) - 1;
    /// Facets that there can be.
    pub const FACETS: usize = 1 << (32 - Partner::BITS);

    fn new(facet: u32, hits: u32) -> Partner {
        Partner(facet << Partner::BITS | hits.min(Partner::MOST))
    }

    /// The facet.
    pub fn facet(self) -> u32 {
        self.0 >> Partner::BITS
    }

    /// How often it was met.
    pub fn hits(self) -> u32 {
        self.0 & Partner::MOST
    }

    /// Adds the hits of equal facets in a sorted list.
    fn merge(list: &mut Vec<Partner>) {
        list.sort_unstable();
        list.dedup_by(|next, first| {
            let same = next.facet() == first.facet();
            if same {
                *first = Partner::new(first.facet(), first.hits() + next.hits());
            }
            same
        });
    }
}

/// What the rays of a facet found.
pub struct Found {
    /// Facets whose fronts were met, ascending.
    pub partners: Vec<Partner>,
    /// Share of the rays that met nothing.
    pub escaped: f32,
    /// Share that met a back side, or the facet itself.
    pub lost: f32,
}

/// Kept from facet to facet.
#[derive(Default)]
pub struct Buffers {
    tables: Option<[SampleTable; 2]>,
    packets: Vec<Packet>,
    hits: Vec<Hits>,
    seen: Vec<Partner>,
}

/// Rays that tell a closed row from an open one: what they overlook is a stray share ([`super::Report::STRAY`]).
const FEW: u32 = 512;
/// Rays that go to Embree at once.
const BATCH: usize = 64;

/// The partners of a facet, unless every pair is tried, and its escaped and lost shares. Without partners to find, a few
/// rays say whether there are such shares, and only if so all go to measure them.
pub fn partners(
    traced: &Traced,
    facets: &Facets,
    settings: &Settings,
    facet: u32,
    buffers: &mut Buffers,
) -> Found {
    let Buffers { tables, packets, hits, seen } = buffers;
    let [few, all] = tables.get_or_insert_with(|| {
        [settings.rays.min(FEW), settings.rays].map(|rays| SampleTable::new(rays, settings.seed as u32))
    });
    let mut shares = [0.0; 2];
    let tables: &[&SampleTable] = if settings.every { &[few, all] } else { &[all] };
    for table in tables {
        seen.clear();
        shares = spread(traced, facets, settings, facet, table, (packets, hits, seen));
        if shares == [0.0; 2] {
            break;
        }
    }
    if settings.every {
        seen.clear();
    }
    Partner::merge(seen);
    Found { partners: seen.clone(), escaped: shares[0], lost: shares[1] }
}

/// Sends out the rays of a table; adds to the partners seen, and gives the shares that escaped and that were lost.
fn spread(
    traced: &Traced,
    facets: &Facets,
    settings: &Settings,
    facet: u32,
    table: &SampleTable,
    (packets, hits, seen): (&mut Vec<Packet>, &mut Vec<Hits>, &mut Vec<Partner>),
) -> [f32; 2] {
    let from = facets.get(facet);
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
                    seen.push(Partner::new(other, 1));
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
    [escaped, lost].map(|n| n as f32 / table.len() as f32)
}

/// For each facet the partners with a higher number, ascending: found by either of the two, with the hits of both.
pub fn upper(found: &[Found]) -> Vec<Vec<Partner>> {
    let mut upper: Vec<Vec<Partner>> = vec![Vec::new(); found.len()];
    for (i, f) in (0u32..).zip(found) {
        for p in &f.partners {
            upper[i.min(p.facet()) as usize].push(Partner::new(p.facet().max(i), p.hits()));
        }
    }
    upper.iter_mut().for_each(|u| {
        Partner::merge(u);
        u.shrink_to_fit();
    });
    upper
}
