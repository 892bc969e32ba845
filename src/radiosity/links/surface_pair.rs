//! The unoccluded exchange of two surfaces.
//!
//! Three rules by distance: Gauss points of both ends for distant surfaces; Lambert's formula from the Gauss points of the smaller
//! surface for near ones; the contour integral for touching ones. All three are deterministic: a noisy exchange would be refined
//! where it is too large and kept where it is too small.

use super::VisibilityQuery;
use super::accuracy::{Accuracy, FEW_SEGMENTS_ERROR, LinkDraft};
use super::blocker_certificate::{BlockerCertificate, certify};
use super::end_samples::{Quadrature, gauss_points, kernel, stratified_points};
use crate::form_factors::analytic::{clip, point_to_polygon, polygon_to_polygon};
use crate::math::sampling::mix;
use crate::radiosity::elements::{Element, Elements};
use crate::ray::{EndRule, LANES, Packet};
use glam::{DVec3, Vec3};

/// Distance in units of the sum of the radii below which Lambert's formula replaces Gauss points: the error of four
/// points falls with the fourth power of the distance, to 1/4⁴ = 0.4 % here. 2 or 8 instead change irradiance without a
/// local pass by less than 0.01 % (`constants.py solve`).
pub(super) const LAMBERT_DISTANCE: f32 = 4.0;
/// Distance in the same units below which the contour integral replaces Lambert's formula. 0.6 or 2.4 instead change
/// irradiance without a local pass by less than 0.02 % (`constants.py solve`).
const CONTOUR_DISTANCE: f32 = 1.2;
/// Smallest error, in units of the tolerated error, that the exchange must be able to cause for the contour integral to
/// be used: this integral costs more than the rays of a link. 0.1 or 1 instead change irradiance without a local pass
/// by about 0.01 % (`constants.py solve`).
const CONTOUR_WORTH: f32 = 0.3;
/// Smallest relative deviation of the exchange over an end is this times (radius / distance)²: the order of the
/// deviation of a kernel that falls as the fourth power of a cosine. Half or twice as much change irradiance without a
/// local pass by less than 0.07 % (`constants.py solve`).
const MIN_DEVIATION: f32 = 0.5;
/// Smallest distance between points in units of the sum of the radii; shorter ones are clamped, which bounds the kernel
/// where surfaces touch. 1e-4 or 1e-2 instead change irradiance by less than 0.001 % (`constants.py solve`).
const MIN_DISTANCE: f32 = 1e-3;

/// Two surfaces that face each other.
pub(super) struct SurfacePair<'a> {
    pub ids: [u32; 2],
    pub ends: [&'a Element; 2],
    pub corners: [&'a [Vec3; 4]; 2],
    pub normals: [Vec3; 2],
    /// End rules of the surfaces.
    pub rules: [EndRule; 2],
}

/// The unoccluded exchange area of two surfaces and its standard deviation over each, scene units squared.
struct Exchange {
    free: f32,
    deviation: [f32; 2],
}

impl SurfacePair<'_> {
    /// The link without visibility, and the query for sixteen or four segments.
    pub fn draft(
        &self,
        elements: &Elements,
        accuracy: Accuracy,
        seed: u64,
    ) -> Option<(LinkDraft, VisibilityQuery)> {
        let ([ca, cb], [na, nb]) = (self.corners, self.normals);
        let Exchange { free, deviation } = self.exchange(accuracy)?;
        let widths = [shortest_edge(ca), shortest_edge(cb)];
        let draft = |weights, certificate| LinkDraft {
            ids: self.ids,
            swapped: false,
            free,
            scale: free,
            deviation,
            weights,
            certificate,
        };
        // The certificate comes first: it costs no ray and holds for all parts.
        let certificate =
            certify(elements, self.corners, self.normals, self.rules, accuracy.certificate, accuracy.blocked);
        if certificate == BlockerCertificate::BLOCKED {
            return None;
        }
        if certificate == BlockerCertificate::CLEAR {
            return Some((draft([0.0; LANES], certificate), accuracy.query(Packet::EMPTY, widths)));
        }
        // Lane i + 4 j joins point i of a and point j of b.
        let nearest = self.min_distance();
        let (pa, pb) = (stratified_points(ca, seed), stratified_points(cb, mix(seed)));
        let weights: [f32; LANES] =
            std::array::from_fn(|l| kernel(pa[l & 3], Some(na), pb[l >> 2], Some(nb), nearest));
        let few = accuracy.worth * free * accuracy.deviation < FEW_SEGMENTS_ERROR;
        let packet = accuracy.segments(few, &weights, seed, |l| {
            [(pa[l & 3], na, self.rules[0]), (pb[l >> 2], nb, self.rules[1])]
        });
        Some((draft(weights, certificate), accuracy.query(packet, widths)))
    }

    fn min_distance(&self) -> f32 {
        MIN_DISTANCE * (self.ends[0].radius + self.ends[1].radius)
    }

    /// The unoccluded exchange; `None` if the surfaces exchange no light.
    fn exchange(&self, accuracy: Accuracy) -> Option<Exchange> {
        let ([ea, eb], [ca, cb], [na, nb]) = (self.ends, self.corners, self.normals);
        let nearest = self.min_distance();
        let distance = (ea.centre - eb.centre).length();
        let reach = ea.radius + eb.radius;
        let gauss = [gauss_points(ca), gauss_points(cb)];
        let mut exchange = self.distant_exchange(gauss);
        // Of a surface that reaches behind the other, only a corner without any Gauss point may be visible.
        let cut = [reaches_behind(ca, cb, nb, nearest), reaches_behind(cb, ca, na, nearest)];
        if distance < LAMBERT_DISTANCE * reach || cut[0] || cut[1] {
            let contour =
                |free: f32| distance < CONTOUR_DISTANCE * reach && accuracy.worth * free > CONTOUR_WORTH;
            self.near_exchange(&mut exchange, gauss, cut, contour);
        }
        if exchange.free <= 0.0 {
            return None;
        }
        // Four points may lie symmetrically, as below the centre of a lamp, so that their values have no deviation.
        for (d, e) in exchange.deviation.iter_mut().zip([ea, eb]) {
            *d = d.max(MIN_DEVIATION * exchange.free * (e.radius / distance).powi(2).min(1.0));
        }
        Some(exchange)
    }

    /// The exchange by Gauss points of both ends.
    fn distant_exchange(&self, [ga, gb]: [Quadrature; 2]) -> Exchange {
        let ([ea, eb], [na, nb], nearest) = (self.ends, self.normals, self.min_distance());
        let rows: [f32; 4] = std::array::from_fn(|i| {
            (0..4)
                .map(|j| gb.weights[j] * kernel(ga.points[i], Some(na), gb.points[j], Some(nb), nearest))
                .sum::<f32>()
        });
        let columns: [f32; 4] = std::array::from_fn(|j| {
            (0..4)
                .map(|i| ga.weights[i] * kernel(ga.points[i], Some(na), gb.points[j], Some(nb), nearest))
                .sum::<f32>()
        });
        let over_both = |v: f32| (f64::from(v) * ea.area * eb.area) as f32;
        let (mean, of_a) = moments(rows, ga.weights);
        Exchange {
            free: over_both(mean),
            deviation: [over_both(of_a), over_both(moments(columns, gb.weights).1)],
        }
    }

    /// Replaces the exchange by Lambert's formula or, if `contour` is true for the exchange found, by the contour integral.
    /// `cut` states for each end whether it reaches behind the other.
    fn near_exchange(
        &self,
        exchange: &mut Exchange,
        [ga, gb]: [Quadrature; 2],
        cut: [bool; 2],
        contour: impl Fn(f32) -> bool,
    ) {
        let ([ea, eb], [ca, cb], [na, nb]) = (self.ends, self.corners, self.normals);
        let small_is_a = ea.area <= eb.area;
        let (small, from, normal, large) = if small_is_a { (ea, ca, na, cb) } else { (eb, cb, nb, ca) };
        let (polygon, other) = (doubles(large), doubles(from));
        let corners = if large[2] == large[3] { &polygon[..3] } else { &polygon[..] };
        let first = if from[2] == from[3] { &other[..3] } else { &other[..] };
        let Quadrature { points, weights } = if small_is_a { ga } else { gb };
        let factors =
            points.map(|p| point_to_polygon(p.as_dvec3(), normal.as_dvec3(), corners).max(0.0) as f32);
        let (factor, of_small) = moments(factors, weights);
        let Exchange { free, deviation } = exchange;
        *free = small.area as f32 * factor;
        deviation[usize::from(!small_is_a)] = small.area as f32 * of_small;
        if cut[usize::from(!small_is_a)] {
            *free = exchange_in_front(first, normal.as_dvec3(), corners) as f32;
        }
        if cut[0] || cut[1] {
            *deviation = deviation.map(|d| d.max(*free));
        }
        if contour(*free) {
            *free = (small.area * polygon_to_polygon(first, corners)) as f32;
        }
    }
}

/// Mean and standard deviation of values with weights whose sum is 1.
fn moments(v: [f32; 4], weights: [f32; 4]) -> (f32, f32) {
    let mean: f32 = v.iter().zip(weights).map(|(v, w)| v * w).sum();
    // Squares in double precision: kernels of small surfaces are large numbers whose squares overflow 32 bits.
    let squares: f64 = v.iter().zip(weights).map(|(v, w)| f64::from(w) * f64::from(v - mean).powi(2)).sum();
    (mean, squares.sqrt() as f32)
}

/// Whether a surface lies partly in front of and partly behind the plane of another one, by more than a distance.
fn reaches_behind(corners: &[Vec3; 4], other: &[Vec3; 4], normal: Vec3, distance: f32) -> bool {
    let heights = corners.map(|p| normal.dot(p - other[0]));
    heights.iter().any(|&h| h < -distance) && heights.iter().any(|&h| h > distance)
}

/// Exchange area of the part of a surface in front of the plane of another one: three points in each triangle of that part.
fn exchange_in_front(surface: &[DVec3], normal: DVec3, other: &[DVec3]) -> f64 {
    let facing = (other[1] - other[0]).cross(other[2] - other[0]).normalize_or_zero();
    let part = clip(surface, other[0], facing);
    let triangle = |k: usize| {
        let [a, b, c] = [part[0], part[k], part[k + 1]];
        let seen = |p: DVec3| point_to_polygon(p, normal, other).max(0.0);
        let points = [(4.0 * a + b + c) / 6.0, (a + 4.0 * b + c) / 6.0, (a + b + 4.0 * c) / 6.0];
        0.5 * (b - a).cross(c - a).length() * points.into_iter().map(seen).sum::<f64>() / 3.0
    };
    (1..part.len().saturating_sub(1)).map(triangle).sum()
}

fn doubles(corners: &[Vec3; 4]) -> [DVec3; 4] {
    corners.map(|p| p.as_dvec3())
}

/// Length of the shortest edge that is not a point.
fn shortest_edge(c: &[Vec3; 4]) -> f32 {
    let edges = [(0, 1), (1, 2), (2, 3), (3, 0)].map(|(i, j)| c[i].distance(c[j]));
    edges.into_iter().filter(|&l| l > 0.0).fold(f32::MAX, f32::min)
}
