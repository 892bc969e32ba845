//! Parts of large faces near a point, to which shadow rays go in proportion to their light.

use crate::form_factors::analytic::point_to_polygon;
use crate::math::sampling::pick;
use crate::radiosity::elements::quarters;
use glam::Vec3;

/// Ratio of a part's radius to its distance from a point above which the part is divided into quarters: the light varies over a part by
/// about twice the ratio.
const MAX_RADIUS_RATIO: f32 = 0.5;
/// Largest number of times that a face is quartered: a point at a thousandth of the face's size below the face is below a part of about
/// that size.
const MAX_QUARTERED: usize = 12;

/// A part of a face in which shadow rays end, the remainder of the random number that has chosen it, and the probability of the choice.
pub(super) struct Part {
    pub corners: [Vec3; 4],
    pub u: f32,
    pub probability: f32,
}

/// Chooses, by the random number `u`, a part of a face that is small relative to its distance from a point, in proportion to its light at
/// the point. Samples spread evenly over a luminous ceiling would rarely lie above the table that hides most of its light.
pub(super) fn part_of(face: &[Vec3; 4], mut u: f32, at: Vec3, normal: Vec3) -> Part {
    let (mut corners, mut probability) = (*face, 1.0);
    for _ in 0..MAX_QUARTERED {
        let middle = 0.25 * corners.iter().sum::<Vec3>();
        let radius = corners.iter().map(|c| c.distance(middle)).fold(0.0, f32::max);
        if radius <= MAX_RADIUS_RATIO * middle.distance(at) {
            break;
        }
        let quarters = quarters(corners);
        let mut sum = 0.0;
        let shares = quarters.map(|part| {
            let polygon = part.map(|c| c.as_dvec3());
            let count = if part[2] == part[3] { 3 } else { 4 };
            sum += point_to_polygon(at.as_dvec3(), normal.as_dvec3(), &polygon[..count]).abs() as f32;
            sum
        });
        if sum <= 0.0 {
            break;
        }
        let (part, left, share) = pick(&shares, u);
        (corners, u, probability) = (quarters[part], left, probability * share / sum);
    }
    Part { corners, u, probability }
}
