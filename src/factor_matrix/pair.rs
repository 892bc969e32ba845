//! Two facets: a closed form times sampled transmittance.

use super::Settings;
use super::facets::{Facet, Facets};
use super::rays::{Table, Traced};
use crate::form_factor::{point_to_polygon, polygon_to_polygon};
use crate::ray::{EndRule, LANES, Packet};
use glam::DVec3;

/// The pairs of one facet with those of higher numbers.
#[derive(Default)]
pub struct Row {
    /// The other facet, ascending.
    pub partner: Vec<u32>,
    /// `A F` of the pair, scene units squared.
    pub exchange: Vec<f32>,
    /// Upper bound of its standard error.
    pub error: Vec<f32>,
    /// Rays traced.
    pub rays: u64,
}

/// What all pairs share.
pub struct Pairs<'a> {
    pub traced: &'a Traced,
    pub facets: &'a Facets,
    pub settings: &'a Settings,
    pub ends: EndRule,
}

/// Kept from row to row.
#[derive(Default)]
pub struct Buffers {
    first: Option<Table>,
    more: Option<Table>,
}

/// Two facets nearer than this many times the sum of their radii get the double integral over both.
const NEAR: f64 = 1.5;
/// Two facets farther than this many times the sum of their radii need no more than one point on the smaller.
const FAR: f64 = 12.0;

impl Pairs<'_> {
    /// All pairs of facet `i` with `partners`.
    pub fn row(&self, i: u32, partners: &[u32], buffers: &mut Buffers) -> Row {
        let Settings { bundle, largest_bundle, seed, .. } = *self.settings;
        let first = buffers.first.get_or_insert_with(|| Table::new(bundle, seed as u32));
        let a = self.facets.get(i);
        let mut row = Row::default();
        for &j in partners {
            let b = self.facets.get(j);
            let open = exchange(a, b);
            if open <= 0.0 {
                continue;
            }
            let key = mix_pair(seed, i, j);
            let mut found = self.transmittance(a, b, first, key);
            row.rays += u64::from(bundle);
            let mixed = found.value > 0.0 && found.value < 1.0;
            if mixed && largest_bundle > bundle {
                let more = buffers.more.get_or_insert_with(|| Table::new(largest_bundle, !seed as u32));
                found = self.transmittance(a, b, more, !key);
                row.rays += u64::from(largest_bundle);
            }
            if found.value > 0.0 {
                row.partner.push(j);
                row.exchange.push((open * found.value) as f32);
                row.error.push((open * found.error) as f32);
            }
        }
        row
    }

    /// The mean of the visibility between two facets, weighted by what rays transport.
    fn transmittance(&self, a: &Facet, b: &Facet, table: &Table, key: u64) -> Transmittance {
        let (mut clear, mut all, mut squares) = (0.0, 0.0, 0.0);
        let mut any_blocked = false;
        let mut packet = Packet::EMPTY;
        let mut weights = [0f64; LANES];
        let mut trace = |packet: &mut Packet, weights: &mut [f64; LANES]| {
            let mut blocked = [0];
            self.traced.blocked(std::slice::from_ref(packet), &mut blocked);
            any_blocked |= blocked[0] != 0;
            for (lane, w) in weights.iter_mut().enumerate() {
                all += *w;
                squares += *w * *w;
                clear += if blocked[0] >> lane & 1 == 0 { *w } else { 0.0 };
                *w = 0.0;
            }
            *packet = Packet::EMPTY;
        };
        for (k, [s, t, u, v]) in table.shifted(key).enumerate() {
            let ((p, m), (q, n)) = (a.point(s, t), b.point(u, v));
            let to = (q - p).as_dvec3();
            let (here, there) = (a.normal(m).dot(to), -b.normal(n).dot(to));
            if here > 0.0 && there > 0.0 {
                let lane = k % LANES;
                weights[lane] = here * there / to.length_squared().powi(2);
                packet.set(lane, p, q, self.ends);
            }
            if k % LANES == LANES - 1 && !packet.is_empty() {
                trace(&mut packet, &mut weights);
            }
        }
        if !packet.is_empty() {
            trace(&mut packet, &mut weights);
        }
        // Facets that face each other in a corner that no sample met have nothing in between that is known.
        if all == 0.0 || !any_blocked {
            return Transmittance { value: 1.0, error: 0.0 };
        }
        let value = clear / all;
        Transmittance { value, error: (value * (1.0 - value) * squares).sqrt() / all }
    }
}

struct Transmittance {
    value: f64,
    /// Standard error if the rays were independent.
    error: f64,
}

/// `A F` of two facets with nothing in between.
fn exchange(a: &Facet, b: &Facet) -> f64 {
    let apart = a.centre.distance(b.centre) / (a.radius + b.radius);
    if apart < NEAR {
        return a
            .pieces
            .iter()
            .map(|p| area(p) * b.pieces.iter().map(|q| polygon_to_polygon(p, q)).sum::<f64>())
            .sum();
    }
    // Points on the smaller, the whole of the larger.
    let (small, large) = if a.area <= b.area { (a, b) } else { (b, a) };
    let seen = |point: DVec3, normal: DVec3| -> f64 {
        large.pieces.iter().map(|q| point_to_polygon(point, normal, q).max(0.0)).sum()
    };
    if apart > FAR && small.pieces.len() == 1 {
        return small.area * seen(centroid(&small.pieces[0]), small.nodes[0].1);
    }
    small.area * small.nodes.iter().map(|&(p, n, w)| w * seen(p, n)).sum::<f64>()
}

fn area(polygon: &[DVec3]) -> f64 {
    let fan = polygon.windows(2).skip(1).map(|w| (w[0] - polygon[0]).cross(w[1] - polygon[0]));
    0.5 * fan.sum::<DVec3>().length()
}

/// Centre of the area of a convex polygon.
fn centroid(polygon: &[DVec3]) -> DVec3 {
    let mut sum = (DVec3::ZERO, 0.0);
    for w in polygon.windows(2).skip(1) {
        let weight = (w[0] - polygon[0]).cross(w[1] - polygon[0]).length();
        sum = (sum.0 + weight * (polygon[0] + w[0] + w[1]) / 3.0, sum.1 + weight);
    }
    sum.0 / sum.1
}

fn mix_pair(seed: u64, i: u32, j: u32) -> u64 {
    super::rays::mix(seed ^ super::rays::mix(u64::from(i) << 32 | u64::from(j)))
}
