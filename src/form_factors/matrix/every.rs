//! All pairs of facets that face each other, for small numbers of facets: no pair depends on discovery.
//!
//! Small pairs get one or four rays, which share packets with the facet's other pairs. The sample points of all these
//! pairs are one low-discrepancy sequence, so that errors cancel in row sums. Large pairs get bundles of their own.

use super::facets::Facet;
use super::pair::{Buffers, CHANCE_CLASSES, Pairs, Row, Transmittance, exchange, segment};
use crate::math::sampling::mix;
use crate::ray::{LANES, Packet};

/// Expected discovery rays from which a pair gets a bundle of its own. Any value from 1.25 to 5 changes the error of
/// the matrix by less than 0.005 % (`constants.py form-factors`).
const MIN_BUNDLE_EXPECTED: f64 = 2.5;
/// Both parameters of the beta distribution of a transmittance before any ray: small, because most pairs are entirely visible or
/// entirely blocked. 0.02 or 0.5 instead change the error of the matrix by less than 0.001 % (`constants.py form-factors`).
const BETA_PRIOR: f64 = 0.1;
/// Expected discovery rays from which a pair gets four rays instead of one. Any value from 0.3 to 1.2 changes the error
/// of the matrix by less than 0.001 % (`constants.py form-factors`).
const MIN_FOUR_RAYS_EXPECTED: f64 = 0.6;
/// Rays in the smallest bundle: one packet.
const MIN_BUNDLE_RAYS: f64 = LANES as f64;
/// Heights above a plane up to this fraction of the distance count as in the plane: rounding of f32 coordinates.
const COPLANAR_HEIGHT: f64 = 1e-6;
/// Facets whose centres are closer than this fraction of the sum of their radii, or than the whole sum if one facet is
/// slim, get the exact exchange already in the estimate that distributes rays. 0.25 or 1 instead change the error of
/// the matrix by less than 0.001 % (`constants.py form-factors`).
const NEAR_DISTANCE: f64 = 0.5;
/// Facets with a smaller area in units of radius² are slim: rectangles with sides 13 : 1 (a square has 2). Any value
/// from 0.1 to 1 changes the error of the matrix by less than 0.001 % (`constants.py form-factors`).
const SLIM_AREA: f64 = 0.3;
/// Largest number of point pairs drawn for a ray until the points see each other's fronts: limits the time of pairs that see each other
/// only in a corner. 2 or 32 instead change the error of the matrix by less than 0.001 % (`constants.py form-factors`).
const MAX_DRAWS: u32 = 8;

/// A pair with the results of its rays.
struct Candidate {
    partner: u32,
    /// Estimated number of discovery rays of the pair without occlusion.
    expected: f64,
    tally: Tally,
}

/// Number and weight (transported flux) of rays, in all and unoccluded.
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

    /// Transmittance with its error. Most pairs are entirely visible or entirely blocked: the prior is a beta
    /// distribution with both parameters [`BETA_PRIOR`], and the error is the standard deviation of the posterior.
    fn transmittance(&self) -> Transmittance {
        if self.rays == 0 {
            // Only corners face each other; nothing is known to block them.
            return Transmittance { value: 1.0, error: 0.0 };
        }
        let (clear, blocked) =
            (f64::from(self.clear_rays) + BETA_PRIOR, f64::from(self.rays - self.clear_rays) + BETA_PRIOR);
        let all = clear + blocked;
        Transmittance {
            value: self.clear / self.all,
            error: (clear * blocked / (all * all * (all + 1.0))).sqrt(),
        }
    }
}

/// Low-discrepancy points in four dimensions: an additive recurrence with powers of the root of `x⁵ = x + 1` (Roberts
/// 2018), with a random start.
struct Sequence([u32; 4]);

impl Sequence {
    fn new(key: u64) -> Sequence {
        let (a, b) = (mix(key), mix(!key));
        Sequence([a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32])
    }

    fn next(&mut self) -> [f32; 4] {
        const R4_STEPS: [u32; 4] = [3_679_390_609, 3_152_041_523, 2_700_274_805, 2_313_257_605];
        for (x, step) in self.0.iter_mut().zip(R4_STEPS) {
            *x = x.wrapping_add(step);
        }
        self.0.map(|x| (x >> 8) as f32 / (1 << 24) as f32)
    }
}

impl Pairs<'_> {
    /// All pairs of facet `i` with facets of higher numbers that face it.
    pub fn every(&self, i: u32, buffers: &mut Buffers) -> Row {
        let a = self.facets.get(i);
        let mut candidates: Vec<Candidate> = (i + 1..self.facets.count() as u32)
            .take_while(|_| !self.progress.stopped())
            .filter_map(|j| {
                let b = self.facets.rising(a, j)?;
                let expected = self.expected(a, b, rough(a, b)?);
                Some(Candidate { partner: j, expected, tally: Tally::default() })
            })
            .collect();
        let mut row = Row::with_capacity(candidates.len());
        self.few_rays(i, &mut candidates, &mut row.rays);
        for c in &candidates {
            if self.progress.stopped() {
                break;
            }
            let b = self.facets.get(c.partner);
            let seen = if c.expected < MIN_BUNDLE_EXPECTED {
                c.tally.transmittance()
            } else {
                let size = c.expected.max(MIN_BUNDLE_RAYS);
                self.sampled(i, c.partner, c.expected, size, buffers, &mut row.rays)
            };
            if seen.value > 0.0 {
                let open = exchange(a, b);
                row.push(c.partner, open * seen.value, open * seen.error, CHANCE_CLASSES);
            }
        }
        row
    }

    /// Traces the rays of all pairs of facet `i` without bundles of their own. Ends early once the caller has stopped.
    fn few_rays(&self, i: u32, candidates: &mut [Candidate], rays: &mut u64) {
        let a = self.facets.get(i);
        let mut sequence = Sequence::new(self.settings.seed << 32 ^ u64::from(i));
        let (mut packet, mut owners, mut used) = (Packet::EMPTY, [(0usize, 0f64); LANES], 0);
        let mut trace = |packet: &mut Packet, owners: &[(usize, f64)], candidates: &mut [Candidate]| {
            let blocked = self.traced.blocked(packet);
            for (lane, &(k, weight)) in owners.iter().enumerate() {
                candidates[k].tally.add(weight, blocked >> lane & 1 == 0);
            }
            *rays += owners.len() as u64;
            *packet = Packet::EMPTY;
        };
        for k in 0..candidates.len() {
            if self.progress.stopped() {
                return;
            }
            let Candidate { partner, expected, .. } = candidates[k];
            let b = self.facets.get(partner);
            let wanted = match expected {
                e if e >= MIN_BUNDLE_EXPECTED => 0,
                e if e >= MIN_FOUR_RAYS_EXPECTED => 4,
                _ => 1,
            };
            for _ in 0..wanted {
                let drawn = (0..MAX_DRAWS).find_map(|_| segment(a, b, sequence.next(), &mut packet, used));
                let Some(weight) = drawn else { continue };
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
}

/// Estimated unoccluded exchange area of two facets, length²; `None` if they do not face each other.
fn rough(a: &Facet, b: &Facet) -> Option<f64> {
    let square = a.centre.distance_squared(b.centre);
    let size = a.radius + b.radius;
    let min_rise = COPLANAR_HEIGHT * (square.sqrt() + size);
    let (here, there) = (a.rise(b, min_rise)?, b.rise(a, min_rise)?);
    // The estimate from centres is far too small for close parallel facets and for adjacent slim ones.
    let slim = |f: &Facet| f.area < SLIM_AREA * f.radius * f.radius;
    let near = if slim(a) || slim(b) { 1.0 } else { NEAR_DISTANCE };
    if square < (near * size).powi(2) {
        return Some(exchange(a, b)).filter(|&open| open > 0.0);
    }
    Some(a.area * b.area * (here * there / square).min(1.0) / (std::f64::consts::PI * square))
}
