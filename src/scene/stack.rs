//! Overlapping faces of one plane are stacked: moved off each other, so that rays meet them in one order.

use super::overlap::{Overlap, largest_distance};
use crate::math::{Aabb, triangle_normal};
use glam::Vec3;
use std::collections::{HashMap, HashSet};

/// Distance between stacked faces beyond that of the faces themselves, relative to the largest coordinate: twice the height at
/// which rays start above surfaces (5 × 4e-7, see the end rule), so that rays of the lower face start below the upper one.
const GAP: f32 = 4e-6;
/// Most levels of a stack: faces move by at most 7 × 6e-6 of the largest coordinate, 0.4 mm in a room of 10 m. In longer chains, as of
/// shingles, the next face takes a level that is free beside those that it overlaps.
const MAX_LEVELS: u32 = 8;

/// Moves the lower one of each two overlapping triangles behind the upper one: that of the smaller part, of equal parts the later
/// one. Front is the front of the lowest face. `part_area` is the area of the part of each triangle. Moved triangles get vertices of
/// their own; points in the common plane lie on the uppermost face.
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
    let levels = levels(&pairs);
    let normals: HashMap<u32, Vec3> = levels
        .keys()
        .map(|&t| {
            let [a, b, c] = triangles[t as usize].map(|v| positions[v as usize]);
            (t, triangle_normal(a, b, c))
        })
        .collect();
    // From the bottom: faces turn their backs to the front of the face below.
    let mut fronts = HashMap::<u32, Vec3>::new();
    for [upper, lower] in pairs.iter().rev() {
        let below = *fronts.entry(*lower).or_insert(normals[lower]);
        let own = normals[upper];
        fronts.entry(*upper).or_insert(if own.dot(below) < 0.0 { -own } else { own });
    }
    let bounds = Aabb::of(positions.iter().copied());
    let magnitude = bounds.min.abs().max(bounds.max.abs()).max_element();
    let step = largest_distance(&bounds) as f32 + GAP * magnitude;
    let before = positions.len();
    let mut moved: Vec<(u32, u32)> = levels.into_iter().filter(|&(_, level)| level > 0).collect();
    moved.sort_unstable();
    // Neighbours in one plane share their moved vertices: planes of one vertex differ in the largest axis of their normals.
    let mut vertices = HashMap::<(u32, u32, usize, bool), u32>::new();
    for (t, level) in moved {
        let front = fronts[&t];
        let axis = front.abs().max_position();
        triangles[t as usize] = triangles[t as usize].map(|v| {
            *vertices.entry((v, level, axis, front[axis] > 0.0)).or_insert_with(|| {
                positions.push(positions[v as usize] - level as f32 * step * front);
                positions.len() as u32 - 1
            })
        });
    }
    if positions.len() > before {
        drop_unused(positions, triangles);
    }
}

/// Drops vertices of no triangle.
fn drop_unused(positions: &mut Vec<Vec3>, triangles: &mut [[u32; 3]]) {
    let mut number = vec![u32::MAX; positions.len()];
    triangles.iter().flatten().for_each(|&v| number[v as usize] = 0);
    for (new, number) in (0..).zip(number.iter_mut().filter(|number| **number == 0)) {
        *number = new;
    }
    let mut used = number.iter().map(|&number| number != u32::MAX);
    positions.retain(|_| used.next().unwrap_or(false));
    triangles.iter_mut().flatten().for_each(|v| *v = number[*v as usize]);
}

/// Number of steps by which each face lies below the top of its stack, from pairs of an upper and a lower face, sorted by the lower one
/// from top to bottom.
fn levels(pairs: &[[u32; 2]]) -> HashMap<u32, u32> {
    let mut levels = HashMap::<u32, u32>::new();
    for group in pairs.chunk_by(|a, b| a[1] == b[1]) {
        let taken: HashSet<u32> = group.iter().map(|[upper, _]| *levels.entry(*upper).or_default()).collect();
        let below = 1 + taken.iter().max().copied().unwrap_or(0);
        let free = || (0..MAX_LEVELS).find(|level| !taken.contains(level));
        let level = if below < MAX_LEVELS { below } else { free().unwrap_or(MAX_LEVELS - 1) };
        levels.insert(group[0][1], level);
    }
    levels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_face_lies_below_those_on_it_and_chains_are_bounded() {
        assert_eq!(levels(&[[2, 1], [1, 0], [2, 0]]), HashMap::from([(2, 0), (1, 1), (0, 2)]));
        let chain: Vec<[u32; 2]> = (0..100).rev().map(|k| [k + 1, k]).collect();
        let levels = levels(&chain);
        assert!(chain.iter().all(|[upper, lower]| levels[upper] != levels[lower]));
        assert!(levels.values().all(|&level| level < MAX_LEVELS));
    }
}
