//! Every pair of facets that face each other, where there are few: none is left to chance.
//!
//! Small pairs get one ray or four, which share packets with those of the facet's other pairs: the points of all of them
//! are one evenly spread sequence, so that errors of neighbours cancel in sums. Large pairs get bundles of their own.

use super::facets::Facet;
use super::pair::{Buffers, CHANCES, Pairs, Row, Transmittance, exchange, mix_pair};
use super::rays::mix;
use crate::ray::{LANES, Packet};

/// Rays of discovery that a pair would expect, from which on it gets a bundle of its own.
const OWN: f64 = 2.5;
/// From which on it gets four rays rather than one.
const FOUR: f64 = 0.6;
/// Rays in the smallest bundle: a whole packet.
const BUNDLE: f64 = LANES as f64;
/// Heights above a plane up to this part of the distance are in the plane: coordinates are in single precision.
const FLAT: f64 = 1e-6;
/// Middles nearer than this part of the sum of their radii, or than all of it where one is as slim as that (its area by its
/// radius squared, 2 for a square), say little of two facets.
const NEAR: f64 = 0.5;
const SLIM: f64 = 0.3;
/// Points that are drawn for a ray until two see each other's fronts.
const DRAWS: u32 = 8;

/// A pair, and what its rays say.
struct Candidate {
    partner: u32,
    /// Rays of discovery that it would expect if nothing were in between, roughly.
    expected: f64,
    tally: Tally,
}

/// Rays, and those that are clear, by number and by what they transport.
#[derive(Clone, Copy, Default)]
struct Tally {
    rays: u32,
    clear_rays: u32,
    all: f64,
    clear: f64,
}

impl Tally {
    fn add(&mut self, weight: f64, clear: bool) {
        self.rays += 1;
        self.all += weight;
        if clear {
            self.clear_rays += 1;
            self.clear += weight;
        }
    }

    /// The transmittance. Most pairs see all or nothing of each other; that is all that is known before (a beta
    /// distribution with both parameters `PRIOR`), and the error is what that leaves after the rays.
    fn transmittance(&self) -> Transmittance {
        const PRIOR: f64 = 0.1;
        if self.rays == 0 {
            // Only corners face each other, and nothing is known to be in between.
            return Transmittance { value: 1.0, error: 0.0 };
        }
        let (clear, blocked) =
            (f64::from(self.clear_rays) + PRIOR, f64::from(self.rays - self.clear_rays) + PRIOR);
        let all = clear + blocked;
        Transmittance {
            value: self.clear / self.all,
            error: (clear * blocked / (all * all * (all + 1.0))).sqrt(),
        }
    }
}

/// Points of a pair of facets, evenly spread in four dimensions: an additive recurrence with powers of the root of
/// `x⁵ = x + 1` (Roberts 2018), begun at random.
struct Sequence([u32; 4]);

impl Sequence {
    fn new(key: u64) -> Sequence {
        let (a, b) = (mix(key), mix(!key));
        Sequence([a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32])
    }

    fn next(&mut self) -> [f32; 4] {
        const STEPS: [u32; 4] = [3_679_390_609, 3_152_041_523, 2_700_274_805, 2_313_257_605];
        for (x, step) in self.0.iter_mut().zip(STEPS) {
            *x = x.wrapping_add(step);
        }
        self.0.map(|x| (x >> 8) as f32 / (1 << 24) as f32)
    }
}

impl Pairs<'_> {
    /// All pairs of facet `i` with facets of higher numbers that it faces.
    pub fn every(&self, i: u32, buffers: &mut Buffers) -> Row {
        let a = self.facets.get(i);
        let mut candidates: Vec<Candidate> = (i + 1..self.facets.len() as u32)
            .filter_map(|j| {
                let b = self.facets.rising(a, j)?;
                let expected = self.expected(a, b, rough(a, b)?);
                Some(Candidate { partner: j, expected, tally: Tally::default() })
            })
            .collect();
        let mut row = Row::with_capacity(candidates.len());
        self.few_rays(i, &mut candidates, &mut row.rays);
        for c in &candidates {
            let b = self.facets.get(c.partner);
            let seen = if c.expected < OWN {
                c.tally.transmittance()
            } else {
                let key = mix_pair(self.settings.seed, i, c.partner);
                self.sampled((a, b), (c.expected, c.expected.max(BUNDLE)), buffers, key, &mut row.rays)
            };
            if seen.value > 0.0 {
                let open = exchange(a, b);
                row.push(c.partner, open * seen.value, open * seen.error, CHANCES);
            }
        }
        row
    }

    /// The rays of all but the large pairs of facet `i`.
    fn few_rays(&self, i: u32, candidates: &mut [Candidate], rays: &mut u64) {
        let a = self.facets.get(i);
        let mut sequence = Sequence::new(self.settings.seed << 32 ^ u64::from(i));
        let (mut packet, mut owners, mut used) = (Packet::EMPTY, [(0usize, 0f64); LANES], 0);
        let mut trace = |packet: &mut Packet, owners: &[(usize, f64)], candidates: &mut [Candidate]| {
            let mut blocked = [0];
            self.traced.blocked(std::slice::from_ref(packet), &mut blocked);
            for (lane, &(k, weight)) in owners.iter().enumerate() {
                candidates[k].tally.add(weight, blocked[0] >> lane & 1 == 0);
            }
            *rays += owners.len() as u64;
            *packet = Packet::EMPTY;
        };
        for k in 0..candidates.len() {
            let Candidate { partner, expected, .. } = candidates[k];
            let b = self.facets.get(partner);
            let wanted = match expected {
                e if e >= OWN => 0,
                e if e >= FOUR => 4,
                _ => 1,
            };
            for _ in 0..wanted {
                let Some(weight) = self.segment((a, b), &mut sequence, &mut packet, used) else { continue };
                owners[used] = (k, weight);
                used += 1;
                if used == LANES {
                    trace(&mut packet, &owners, candidates);
                    used = 0;
                }
            }
        }
        if used > 0 {
            trace(&mut packet, &owners[..used], candidates);
        }
    }

    /// A ray from front to front in a lane of a packet, and its weight: what it transports.
    #[inline]
    fn segment(
        &self,
        (a, b): (&Facet, &Facet),
        sequence: &mut Sequence,
        packet: &mut Packet,
        lane: usize,
    ) -> Option<f64> {
        for _ in 0..DRAWS {
            let [s, t, u, v] = sequence.next();
            let ((p, m), (q, n)) = (a.point(s, t), b.point(u, v));
            let to = (q - p).as_dvec3();
            let (here, there) = (a.normal(m).dot(to), -b.normal(n).dot(to));
            if here > 0.0 && there > 0.0 {
                packet.set(lane, p, q, self.ends);
                return Some(here * there / to.length_squared().powi(2));
            }
        }
        None
    }
}

/// About what two facets exchange if nothing is in between; nothing if they do not face each other.
fn rough(a: &Facet, b: &Facet) -> Option<f64> {
    let square = a.centre.distance_squared(b.centre);
    let size = a.radius + b.radius;
    let least = FLAT * (square.sqrt() + size);
    let (here, there) = (a.rise(b, least)?, b.rise(a, least)?);
    // Plates close to each other exchange far more than their middles say, slim ones beside each other too.
    let slim = |f: &Facet| f.area < SLIM * f.radius * f.radius;
    let near = if slim(a) || slim(b) { 1.0 } else { NEAR };
    if square < (near * size).powi(2) {
        return Some(exchange(a, b)).filter(|&open| open > 0.0);
    }
    Some(a.area * b.area * (here * there / square).min(1.0) / (std::f64::consts::PI * square))
}
