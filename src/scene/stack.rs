//! Overlapping faces of one plane are stacked: moved off each other, so that rays meet them in one order.

use super::overlap::{Overlap, largest_distance};
use crate::math::{Aabb, triangle_normal};
use glam::Vec3;
use std::collections::HashMap;

/// Distance between stacked faces beyond that of the faces themselves, relative to the largest coordinate: twice the height at
/// which rays start above surfaces (5 × 4e-7, see the end rule), which so start below the next face, with as much again for rounding.
const GAP: f32 = 4e-6;

/// Moves the upper one of each two overlapping triangles along its normal. `order` ascends from the bottom to the top, by triangle.
/// Moved triangles get vertices of their own.
pub(super) fn stack(
    found: &[Overlap],
    order: impl Fn(u32) -> (f64, u32),
    positions: &mut Vec<Vec3>,
    triangles: &mut [[u32; 3]],
) {
    let mut pairs: Vec<[u32; 2]> =
        found.iter().map(|&(s, t, _)| if above(order(s), order(t)) { [t, s] } else { [s, t] }).collect();
    // From the bottom: the level of the lower face is known when the upper one is reached.
    pairs.sort_by(|a, b| compared(order(a[1]), order(b[1])));
    let mut levels = HashMap::<u32, u32>::new();
    for [lower, upper] in &pairs {
        let level = 1 + levels.get(lower).copied().unwrap_or(0);
        let of_upper = levels.entry(*upper).or_default();
        *of_upper = level.max(*of_upper);
    }
    let bounds = Aabb::of(positions.iter().copied());
    let magnitude = bounds.min.abs().max(bounds.max.abs()).max_element();
    let step = largest_distance(&bounds) as f32 + GAP * magnitude;
    let mut moved: Vec<(u32, u32)> = levels.into_iter().collect();
    moved.sort_unstable();
    // Neighbours in one plane share their moved vertices: planes of one vertex differ in the largest axis of their normals.
    let mut vertices = HashMap::<(u32, u32, usize, bool), u32>::new();
    for (t, level) in moved {
        let corners = triangles[t as usize];
        let [a, b, c] = corners.map(|v| positions[v as usize]);
        let normal = triangle_normal(a, b, c);
        let axis = normal.abs().max_position();
        triangles[t as usize] = corners.map(|v| {
            *vertices.entry((v, level, axis, normal[axis] > 0.0)).or_insert_with(|| {
                positions.push(positions[v as usize] + level as f32 * step * normal);
                positions.len() as u32 - 1
            })
        });
    }
}

fn compared(a: (f64, u32), b: (f64, u32)) -> std::cmp::Ordering {
    a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
}

fn above(a: (f64, u32), b: (f64, u32)) -> bool {
    compared(a, b).is_gt()
}
