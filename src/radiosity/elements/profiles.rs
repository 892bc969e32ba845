//! Light of faces that emit by a profile of directions.

use super::subdivision::{centroid, quarters};
use crate::scene::Profile;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// Longest side of a part of a face relative to its distance: the quadrature is exact for polynomials of degree 2 in each
/// part, so its error is about (1/4)⁴ / 24 = 2e-4 of a diffuse kernel.
const MAX_PART_SIZE: f64 = 0.25;
/// Largest number of subdivisions of a face, for points that lie on it: 4⁵ parts limit the time to 3,072 evaluations.
const MAX_LEVEL: u32 = 5;
/// Largest difference between the values at the centres of a receiver's quarters and their mean, relative to the mean over the
/// receiver: for a smooth kernel the error of a part is a quarter of this difference, 1 %; the error at edges of beams falls
/// with the number of parts that they cut.
const MAX_DIFFERENCE: f64 = 0.04;
/// Largest number of subdivisions of a receiver, at edges of beams: limits the time to the values of 4⁴ = 256 points.
const MAX_RECEIVER_LEVEL: u32 = 3;

/// Radiance of a face towards `from` seen from its point `at`, relative to a diffuse face of the same exitance; 1 without a profile.
pub fn emission_gain(profile: Option<&Profile>, at: Vec3, normal: Vec3, from: Vec3) -> f32 {
    let Some(profile) = profile else { return 1.0 };
    let direction = (from - at).normalize_or_zero();
    let cosine = normal.dot(direction);
    if cosine > 0.0 { profile.gain(direction, cosine) } else { 0.0 }
}

/// Irradiance at a point (position, unit normal) from a convex polygon that emits by a profile, relative to its exitance.
pub(super) fn profile_factor(profile: &Profile, at: DVec3, normal: DVec3, polygon: &[DVec3]) -> f64 {
    let flat = (polygon[1] - polygon[0]).cross(polygon[2] - polygon[0]);
    if flat.dot(at - polygon[0]) <= 0.0 {
        return 0.0;
    }
    let point = |y: DVec3| {
        let d = at - y;
        let r2 = d.length_squared().max(f64::MIN_POSITIVE);
        let direction = d / r2.sqrt();
        let cosine = (-normal.dot(direction)).max(0.0);
        cosine * f64::from(profile.projected(direction.as_vec3())) / (PI * r2)
    };
    (2..polygon.len()).map(|k| integral(&point, at, [polygon[0], polygon[k - 1], polygon[k]], 0)).sum()
}

/// Mean of `of` over a surface, from the values at the centres of its quarters; surfaces with differing values are subdivided.
pub fn mean_over(of: &dyn Fn(Vec3) -> f64, corners: [Vec3; 4]) -> f64 {
    mean_of_parts(of, corners, None, 0)
}

/// `whole`: the mean over the surface that this is a part of.
fn mean_of_parts(of: &dyn Fn(Vec3) -> f64, corners: [Vec3; 4], whole: Option<f64>, level: u32) -> f64 {
    let parts = quarters(corners);
    let values = parts.map(|part| of(centroid(&part)));
    let mean = 0.25 * values.iter().sum::<f64>();
    let whole = whole.unwrap_or(mean).max(mean);
    let differs = values.iter().any(|v| (v - mean).abs() > MAX_DIFFERENCE * whole);
    if !differs || level >= MAX_RECEIVER_LEVEL {
        return mean;
    }
    0.25 * parts.map(|part| mean_of_parts(of, part, Some(whole), level + 1)).iter().sum::<f64>()
}

/// Integral over a triangle from the values at the midpoints of its sides; triangles near the point are subdivided.
fn integral(of: &dyn Fn(DVec3) -> f64, at: DVec3, [a, b, c]: [DVec3; 3], level: u32) -> f64 {
    let middles = [0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)];
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    if level < MAX_LEVEL && longest > MAX_PART_SIZE * at.distance((a + b + c) / 3.0) {
        let [p, q, r] = middles;
        let parts = [[a, p, r], [p, b, q], [r, q, c], [p, q, r]];
        return parts.into_iter().map(|part| integral(of, at, part, level + 1)).sum();
    }
    0.5 * (b - a).cross(c - a).length() * middles.into_iter().map(of).sum::<f64>() / 3.0
}
