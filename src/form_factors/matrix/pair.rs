//! Exchange of two facets: closed form times sampled transmittance.

use super::facets::{Facet, Facets, Partner};
use super::rays::{SampleTable, Traced};
use super::{Settings, go_on};
use crate::Result;
use crate::form_factors::analytic::{point_to_polygon, polygon_to_polygon};
use crate::math::parallel;
use crate::math::sampling::mix;
use crate::progress::Progress;
use crate::ray::{LANES, Packet};
use glam::DVec3;

/// The pairs of one facet with facets of higher numbers.
#[derive(Default, serde::Deserialize, serde::Serialize)]
pub struct Row {
    /// The other facets, ascending.
    pub partner: Vec<u32>,
    /// Exchange areas `A F T`, scene units squared.
    pub exchange: Vec<f32>,
    /// Upper bounds of the standard errors of `exchange`, scene units squared.
    pub error: Vec<f32>,
    /// Classes by the probability of discovery, see [`chance`].
    pub chance: Vec<u8>,
    /// Discovery rays by class.
    pub tally: Tally,
    /// Number of rays traced.
    pub rays: u64,
}

impl Row {
    /// An empty row with this capacity, in pairs.
    pub fn with_capacity(pairs: usize) -> Row {
        Row {
            partner: Vec::with_capacity(pairs),
            exchange: Vec::with_capacity(pairs),
            error: Vec::with_capacity(pairs),
            chance: Vec::with_capacity(pairs),
            ..Row::default()
        }
    }

    /// Appends a pair: the other facet, exchange area, its standard error, and the class by [`chance`].
    pub fn push(&mut self, partner: u32, exchange: f64, error: f64, class: usize) {
        self.partner.push(partner);
        self.exchange.push(exchange as f32);
        self.error.push(error as f32);
        self.chance.push(class as u8);
    }
}

/// By class of [`chance`]: number of discovery rays that hit a pair, and number expected from the pairs' exchange areas.
pub type Tally = [[f64; 2]; CHANCE_CLASSES];

/// Number of classes of pairs by expected discovery rays: two per octave, from below 1/16 to 32. Pairs above are found
/// with certainty and have the class `CHANCE_CLASSES`.
pub const CHANCE_CLASSES: usize = 20;
/// Rays that are added to the met and the expected rays of a class, so that classes with few rays hardly change: a class
/// of as many rays, whose ratio has a standard error of 1/√1,000 = 3 %, changes by half of its ratio.
const BALANCE_PRIOR_RAYS: f64 = 1000.0;

fn chance(c: f64) -> usize {
    ((2.0 * c.log2()).floor() + 9.0).clamp(0.0, CHANCE_CLASSES as f64) as usize
}

/// Data shared by all facets and pairs.
pub struct Pairs<'a> {
    pub traced: &'a Traced,
    pub facets: &'a Facets,
    pub settings: &'a Settings,
    /// Rows end early once it has stopped.
    pub progress: &'a dyn Progress,
}

/// Working memory of a thread: sample tables of 1, 4, 16, 64 ... points.
#[derive(Default)]
pub struct Buffers(Vec<SampleTable>);

/// Facets with a distance of centres below this multiple of the sum of radii get the double contour integral. Row sums of a block of
/// houses are off by 0.072 % with 1, by 0.051 % with 1.5, by 0.044 % with 3 (`constants.py form-factors`).
const CONTOUR_DISTANCE: f64 = 1.5;
/// Form factors from here on get the double contour integral. With 0.005 or 0.1 row sums change by less than 0.002 %
/// (`constants.py form-factors`).
const CONTOUR_FACTOR: f64 = 0.02;
/// Above this multiple of the sum of radii, facets that see each other entirely get point-to-point quadrature. Any
/// value from 2 to 6 gives the same errors to 0.001 % (`constants.py form-factors`).
const POINTS_DISTANCE: f64 = 3.0;
/// Expected discovery rays from which a partly blocked pair gets more bundles. Half or twice as many change the error
/// of the matrix from 0.296 % to 0.278 % or 0.367 %, and the time by +11 % or −30 % (`constants.py form-factors`).
const MIN_MORE_BUNDLES_EXPECTED: f64 = 16.0;
/// Expected discovery rays above which the transmittance T of a found pair is sampled. Below, the estimate 1/c + T/2 of
/// `share` changes with T by at most c/2 = 12.5 % of itself.
const MIN_SAMPLED_EXPECTED: f64 = 0.25;
/// Transmittance assumed for found pairs that are not sampled; with the bound above, an error of 0.2 changes the value by at most 2.5 %.
const UNSAMPLED_TRANSMITTANCE: f64 = 0.8;

impl Pairs<'_> {
    /// All pairs of facet `i` with `partners`.
    ///
    /// Small pairs are found by chance, and each found pair represents similar ones that were not found: its value is divided by the
    /// probability `1 − exp(−c T)` of discovery, with `c` the expected number of discovery rays without occlusion (Horvitz and Thompson
    /// 1952). Large pairs are found with certainty. [`balance`] removes the remaining bias.
    pub fn row(&self, i: u32, partners: &[Partner], buffers: &mut Buffers) -> Row {
        let a = self.facets.get(i);
        let mut row = Row::with_capacity(partners.len());
        for partner in partners {
            if self.progress.stopped() {
                break;
            }
            let j = partner.facet();
            let b = self.facets.get(j);
            let open = exchange(a, b);
            let c = self.expected(a, b, open);
            if c <= 0.0 {
                continue;
            }
            let mut seen = Transmittance { value: UNSAMPLED_TRANSMITTANCE, error: 0.0 };
            if c > MIN_SAMPLED_EXPECTED {
                seen = self.sampled(i, j, c, c.max(4.0), buffers, &mut row.rays);
            }
            let found = -(-c * seen.value).exp_m1();
            let value = share(seen, c);
            let class = chance(c);
            if let Some([met, expected]) = row.tally.get_mut(class) {
                *met += f64::from(partner.hits());
                *expected += c * value;
            }
            let error = (seen.error * found.min(1.0)).hypot(value * (1.0 - found).max(0.0).sqrt());
            row.push(j, open * value, open * error, class);
        }
        row
    }

    /// Expected number of discovery rays, from either facet, between two facets with this exchange area.
    pub fn expected(&self, a: &Facet, b: &Facet, exchange: f64) -> f64 {
        f64::from(self.settings.rays) * (exchange / a.area + exchange / b.area)
    }

    /// Transmittance between facets `i` and `j`, which expect `c` discovery rays, from bundles of about `size` rays: from one if
    /// all or none of its rays are blocked or `c` is small; else the mean over many bundles, without those of which all or no
    /// rays are blocked. Each averaged bundle then has the distribution of a first bundle that was mixed, so that continuing only
    /// after mixed bundles adds no bias.
    pub fn sampled(
        &self,
        i: u32,
        j: u32,
        c: f64,
        size: f64,
        buffers: &mut Buffers,
        rays: &mut u64,
    ) -> Transmittance {
        let Settings { bundle, largest_bundle, seed, .. } = *self.settings;
        let (a, b, key) = (self.facets.get(i), self.facets.get(j), mix_pair(seed, i, j));
        let table = table(buffers, power_of_4(size.min(f64::from(bundle))), seed as u32);
        let size = table.len() as f64;
        let first = self.bundle(a, b, table, key);
        *rays += table.len() as u64;
        if first.error == 0.0 || c <= MIN_MORE_BUNDLES_EXPECTED {
            return first;
        }
        let wanted = (16.0 * c).min(f64::from(largest_bundle)) / size;
        let (mut sum, mut squares, mut count) = (first.value, first.error.powi(2), 1.0);
        for k in 1..wanted as u64 {
            if self.progress.stopped() {
                break;
            }
            *rays += table.len() as u64;
            let next = self.bundle(a, b, table, mix(key ^ k));
            if next.error > 0.0 {
                sum += next.value;
                squares += next.error.powi(2);
                count += 1.0;
            }
        }
        Transmittance { value: sum / count, error: squares.sqrt() / count }
    }

    /// Mean visibility between two facets, weighted by transported flux.
    fn bundle(&self, a: &Facet, b: &Facet, table: &SampleTable, key: u64) -> Transmittance {
        let (mut clear, mut all, mut squares) = (0.0, 0.0, 0.0);
        let mut any_blocked = false;
        let mut packet = Packet::EMPTY;
        let mut weights = [0f64; LANES];
        let mut trace = |packet: &mut Packet, weights: &mut [f64; LANES]| {
            let blocked = self.traced.blocked(packet);
            any_blocked |= blocked != 0;
            for (lane, w) in weights.iter_mut().enumerate() {
                all += *w;
                squares += *w * *w;
                clear += if blocked >> lane & 1 == 0 { *w } else { 0.0 };
                *w = 0.0;
            }
            *packet = Packet::EMPTY;
        };
        for (k, at) in table.shifted(key).enumerate() {
            let lane = k % LANES;
            weights[lane] = segment(a, b, at, &mut packet, lane).unwrap_or(0.0);
            if lane == LANES - 1 && !packet.is_empty() {
                trace(&mut packet, &mut weights);
            }
        }
        if !packet.is_empty() {
            trace(&mut packet, &mut weights);
        }
        // Facets that face each other only in a corner which no sample met count as unoccluded.
        if all == 0.0 || !any_blocked {
            return Transmittance { value: 1.0, error: 0.0 };
        }
        let value = clear / all;
        // Variance with n − 1 degrees of freedom, n the effective number of rays.
        let counted = squares / (all * all);
        Transmittance { value, error: (value * (1.0 - value) * counted / (1.0 - counted).max(0.5)).sqrt() }
    }
}

/// Puts a ray between points of the fronts of two facets into a lane of a packet; returns its weight (transported flux), or `None`
/// if the points do not face each other.
#[inline]
pub fn segment(
    a: &Facet,
    b: &Facet,
    [s, t, u, v]: [f32; 4],
    packet: &mut Packet,
    lane: usize,
) -> Option<f64> {
    let ((p, m), (q, n)) = (a.point(s, t), b.point(u, v));
    let to = (q - p).as_dvec3();
    let (here, there) = (a.normals[m].dot(to), -b.normals[n].dot(to));
    (here > 0.0 && there > 0.0).then(|| {
        let rules = [a.end, b.end.seen_from(a.end)];
        let start = rules[0].lifted(p, a.normals[m].as_vec3());
        let end = rules[1].lifted(q, b.normals[n].as_vec3());
        packet.set_lifted(lane, start, end, rules);
        here * there / to.length_squared().powi(2)
    })
}

#[derive(Clone, Copy)]
pub struct Transmittance {
    pub value: f64,
    /// Standard error for independent rays.
    pub error: f64,
}

/// Scales pairs that were found by chance so that, class by class, they expect as many discovery rays as hit them.
/// Discovery rays are stratified, which makes discovery more likely than with independent rays, by a few percent where
/// few rays are expected; the number of rays that hit a class is unbiased regardless (ratio estimator; Cochran 1977,
/// chapter 6). [`BALANCE_PRIOR_RAYS`] are added to both counts, so that classes with few hits hardly change.
pub fn balance(rows: &mut [Row], progress: &dyn Progress) -> Result<()> {
    let mut tally: Tally = Default::default();
    for row in &*rows {
        for (sum, [met, expected]) in tally.iter_mut().zip(row.tally) {
            *sum = [sum[0] + met, sum[1] + expected];
        }
    }
    let factors =
        tally.map(|[met, expected]| ((met + BALANCE_PRIOR_RAYS) / (expected + BALANCE_PRIOR_RAYS)) as f32);
    parallel::try_for_each_mut(rows, |row| {
        go_on(progress)?;
        for (exchange, class) in row.exchange.iter_mut().zip(std::mem::take(&mut row.chance)) {
            *exchange *= factors.get(usize::from(class)).copied().unwrap_or(1.0);
        }
        Ok(())
    })
}

/// The fraction of the unoccluded exchange area that a found pair represents: `f(T) = T / (1 − exp(−c T))`. f is
/// convex, so its mean over an uncertain `T` is too large; the second-order term `½ f″ σ²` is subtracted.
fn share(seen: Transmittance, c: f64) -> f64 {
    let t = seen.value;
    let x = c * t;
    if x < 1e-3 {
        return 1.0 / c + 0.5 * t;
    }
    let (gone, found) = ((-x).exp(), -(-x).exp_m1());
    let bend = c * gone * (x * (1.0 + gone) - 2.0 * found) / found.powi(3);
    t / found - 0.5 * bend * seen.error * seen.error
}

/// Unoccluded exchange area `A F` of two facets, length².
pub fn exchange(a: &Facet, b: &Facet) -> f64 {
    let exact = || {
        let all = |p: &[DVec3]| b.pieces.iter().map(|q| polygon_to_polygon(p, q)).sum::<f64>();
        a.pieces.iter().map(|p| area(p) * all(p)).sum::<f64>()
    };
    let apart = a.centre.distance(b.centre) / (a.radius + b.radius);
    if apart < CONTOUR_DISTANCE {
        return exact();
    }
    if apart > POINTS_DISTANCE && a.sees_all_of(b) && b.sees_all_of(a) {
        return by_points(a, b);
    }
    // Quadrature points on the smaller facet, closed form for the larger.
    let (less, more) = if a.area <= b.area { (a, b) } else { (b, a) };
    let seen = |point: DVec3, normal: DVec3| -> f64 {
        more.pieces.iter().map(|q| point_to_polygon(point, normal, q).max(0.0)).sum()
    };
    let fine = less.area * less.nodes.iter().map(|&(p, n, w)| w * seen(p, n)).sum::<f64>();
    // A ray connected the facets: if no quadrature point sees the other facet, a corner does.
    if fine > 0.0 && fine < CONTOUR_FACTOR * less.area { fine } else { exact() }
}

/// Exchange area by quadrature on both facets, length².
fn by_points(a: &Facet, b: &Facet) -> f64 {
    let mut sum = 0.0;
    for &(p, n, w) in &a.nodes {
        for &(q, m, v) in &b.nodes {
            let to = q - p;
            let square = to.length_squared();
            sum += w * v * n.dot(to) * -m.dot(to) / (square * square);
        }
    }
    a.area * b.area * sum / std::f64::consts::PI
}

fn table(buffers: &mut Buffers, size: u32, seed: u32) -> &SampleTable {
    while buffers.0.len() <= size as usize {
        let k = buffers.0.len() as u32;
        buffers.0.push(SampleTable::new(1 << (2 * k), seed.wrapping_add(k << 8)));
    }
    &buffers.0[size as usize]
}

/// The exponent of the largest power of 4 that is not above `x >= 1`.
fn power_of_4(x: f64) -> u32 {
    (x as u32).ilog2() / 2
}

fn area(polygon: &[DVec3]) -> f64 {
    let fan = polygon.windows(2).skip(1).map(|w| (w[0] - polygon[0]).cross(w[1] - polygon[0]));
    0.5 * fan.sum::<DVec3>().length()
}

fn mix_pair(seed: u64, i: u32, j: u32) -> u64 {
    mix(seed ^ mix(u64::from(i) << 32 | u64::from(j)))
}
