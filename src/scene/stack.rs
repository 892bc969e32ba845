//! Overlapping faces of one plane are stacked: moved off each other, so that rays meet them in one order.

use super::overlap::{Overlap, largest_distance};
use crate::math::{Aabb, triangle_normal};
use glam::Vec3;
use std::collections::HashMap;

/// Distance between stacked faces beyond that of the faces themselves, relative to the largest coordinate: twice the height at
/// which rays start above surfaces (5 × 4e-7, see the end rule), which so start below the next face, with as much again for rounding.
const GAP: f32 = 4e-6;

/// Moves the lower one of each two overlapping triangles against its normal, so that points in their common plane lie on the upper
/// one: that of the smaller part, of equal parts the later one. `part_area` is the area of the part of each triangle. Moved
/// triangles get vertices of their own.
pub(super) fn stack(
    found: &[Overlap],
    part_area: &[f64],
    positions: &mut Vec<Vec3>,
    triangles: &mut [[u32; 3]],
) {
    if found.is_empty() {
        return;
    }
    let compared = |s: u32, t: u32| part_area[s as usize].total_cmp(&part_area[t as usize]).then(t.cmp(&s));
    let mut pairs: Vec<[u32; 2]> =
        found.iter().map(|&(s, t, _)| if compared(s, t).is_lt() { [s, t] } else { [t, s] }).collect();
    // From the top: the level of the upper face is known when the lower one is reached.
    pairs.sort_by(|a, b| compared(a[1], b[1]));
    let mut levels = HashMap::<u32, u32>::new();
    for [upper, lower] in &pairs {
        let level = 1 + levels.get(upper).copied().unwrap_or(0);
        let of_lower = levels.entry(*lower).or_default();
        *of_lower = level.max(*of_lower);
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
                positions.push(positions[v as usize] - level as f32 * step * normal);
                positions.len() as u32 - 1
            })
        });
    }
}
