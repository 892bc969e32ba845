//! Discovery of facets that see each other, by cosine-distributed rays.

use super::facets::Partner;
use super::go_on;
use super::pair::Pairs;
use super::rays::SampleTable;
use crate::Result;
use crate::embree::Hits;
use crate::math::parallel;
use crate::progress::Progress;
use crate::ray::{LANES, Packet};
use glam::Vec3;

/// Result of the rays of one facet.
#[derive(serde::Deserialize, serde::Serialize)]
pub struct FacetRays {
    /// Facets whose fronts were hit, ascending.
    pub partners: Vec<Partner>,
    /// Fraction of the rays that hit nothing.
    pub escaped: f32,
    /// Fraction of the rays that hit a back side or the facet itself.
    pub lost: f32,
}

/// Working memory of a thread.
#[derive(Default)]
pub struct Buffers {
    tables: Option<[SampleTable; 2]>,
    packets: Vec<Packet>,
    hits: Vec<Hits>,
    seen: Vec<Partner>,
}

/// Number of rays that separate closed rows from open ones: 1 / [`super::Report::MAX_CLOSED_LOSS`] = 500, rounded up to a power
/// of two, so that a share that counts as open is expected to lose a ray.
const STRAY_CHECK_RAYS: u32 = 512;
/// Packets per call of Embree: limits the buffers of a thread to 1,024 rays. Does not change results.
const BATCH_PACKETS: usize = 64;

impl Pairs<'_> {
    /// The partners of a facet with its escaped and lost shares. If all pairs are tried anyway, partners are not collected:
    /// [`STRAY_CHECK_RAYS`] rays are traced, and the full number only if some of them escaped or were lost.
    pub fn partners(&self, facet: u32, buffers: &mut Buffers) -> FacetRays {
        let settings = self.settings;
        let Buffers { tables, packets, hits, seen } = buffers;
        let [few, all] = tables.get_or_insert_with(|| {
            [settings.rays.min(STRAY_CHECK_RAYS), settings.rays]
                .map(|rays| SampleTable::new(rays, settings.seed as u32))
        });
        let mut shares = [0.0; 2];
        let tables: &[&SampleTable] = if settings.every { &[few, all] } else { &[all] };
        for table in tables {
            seen.clear();
            shares = self.spread(facet, table, packets, hits, seen);
            if shares == [0.0; 2] {
                break;
            }
        }
        if settings.every {
            seen.clear();
        }
        Partner::merge(seen);
        FacetRays { partners: seen.clone(), escaped: shares[0], lost: shares[1] }
    }

    /// Traces the rays of a table; appends hit facets to `seen` and returns the escaped and lost shares. Ends early once
    /// `progress` has stopped.
    fn spread(
        &self,
        facet: u32,
        table: &SampleTable,
        packets: &mut Vec<Packet>,
        hits: &mut Vec<Hits>,
        seen: &mut Vec<Partner>,
    ) -> [f32; 2] {
        let Pairs { traced, facets, settings, progress } = *self;
        let from = facets.get(facet);
        let (mut escaped, mut lost) = (0u32, 0u32);
        let mut trace = |packets: &mut Vec<Packet>| {
            hits.resize(packets.len(), Hits::NONE);
            traced.first_hits(packets, hits);
            for (packet, hits) in packets.iter().zip(&*hits) {
                for lane in packet.lanes() {
                    let t = hits.triangle[lane];
                    if t == Hits::NO_HIT {
                        escaped += 1;
                        continue;
                    }
                    let direction = Vec3::from(packet.direction.map(|axis| axis[lane]));
                    let other = facets.of_triangle(t);
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
            let normal = from.normals[k].as_vec3();
            // Density cos θ / π (Malley): a point on the disc, projected to the hemisphere.
            let (sin, cos) = (std::f32::consts::TAU * t).sin_cos();
            let (x, y) = normal.any_orthonormal_pair();
            let direction = (x * cos + y * sin) * s.sqrt() + normal * (1.0 - s).sqrt();
            let lane = i % LANES;
            if lane == 0 {
                if packets.len() == BATCH_PACKETS {
                    trace(packets);
                    if progress.stopped() {
                        break;
                    }
                }
                packets.push(Packet::EMPTY);
            }
            if let Some(packet) = packets.last_mut() {
                packet.set_ray(lane, from.end.lifted(point, normal), direction);
            }
        }
        trace(packets);
        [escaped, lost].map(|n| n as f32 / table.len() as f32)
    }
}

/// For each facet the partners with higher numbers, ascending, found from either side, with the hits of both.
pub fn upper(found: &[FacetRays], progress: &dyn Progress) -> Result<Vec<Vec<Partner>>> {
    let mut upper: Vec<Vec<Partner>> = vec![Vec::new(); found.len()];
    for (i, f) in (0u32..).zip(found) {
        go_on(progress)?;
        for p in &f.partners {
            upper[i.min(p.facet()) as usize].push(Partner::new(p.facet().max(i), p.hits()));
        }
    }
    parallel::try_for_each_mut(&mut upper, |u| {
        go_on(progress)?;
        Partner::merge(u);
        u.shrink_to_fit();
        Ok(())
    })?;
    Ok(upper)
}
