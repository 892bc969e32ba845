//! Overlapping faces of one plane are stacked: moved off each other, so that rays meet them in one order.

use super::compact::drop_unused;
use super::connect::Sets;
use super::magnitudes::{GAP, face_magnitudes, largest_distance};
use super::overlap::{FaceProperties, Overlap};
use super::wall_sides::WallSides;
use crate::math::{Aabb, triangle_normal};
use glam::Vec3;
use std::collections::{HashMap, HashSet, hash_map::Entry};

/// Largest number of levels below the uppermost face: faces move by at most 8 × 9e-6 of the largest coordinate, .7 mm in a room of
/// 10 m. In longer chains, as of shingles, the next face takes a level that is free beside those that it overlaps.
const MAX_LEVELS: i32 = 8;
/// Smallest cosine between the normals of faces in one plane that share moved vertices: 2.6 degrees; a sheet that is
/// bent by more has an edge there.
const MIN_COSINE: f32 = 0.999;

/// Largest number of triangles at a vertex over which lower faces are continued, so that the time is in proportion to the triangles.
const MAX_FAN: usize = 64;
/// Largest number of tests whether a vertex lies on a moved triangle: half a second. A ceiling over a million vertices has fifty triangles for that many.
const MAX_TESTS: usize = 100_000_000;

/// Smallest fraction of the area of faces turned away from each other that overlaps if they are the two sides of one sheet. Borders that
/// were rounded or drawn by hand leave less than a hundredth.
const MIN_SHEET_COVER: f64 = 0.99;

/// By triangle, the largest distance by which faces of its stack were moved off each other, scene units. Triangles that do not overlap with others have none.
pub(crate) type StackDistances = HashMap<u32, f32>;

/// Moves the lower one of each two overlapping triangles behind the upper one: that of the smaller part, of equal parts the later
/// one. Front is the front of an emitting face, so that lamps in the plane of a ceiling stay in front of it, or else the front of the
/// lowest face. A closed solid on a larger sheet that it faces stays: the sheet hides its face.
/// Faces that are turned away from each other and cover each other are the two sides of one sheet: each stays on its own side. So do all faces on walls that
/// two rooms share ([`WallSide`]).
/// Moved triangles get vertices of their own; points in the common plane lie on the uppermost face. Faces that touch a moved face, such as the walls below a
/// ceiling, follow it ([`keep_contact`]). Returns the largest distance by which faces of the stack of each triangle were moved, scene units.
pub(super) fn stack(
    found: &[Overlap],
    of: &FaceProperties,
    walls: &WallSides,
    positions: &mut Vec<Vec3>,
    triangles: &mut [[u32; 3]],
) -> StackDistances {
    let (part, emitter) = (|t: usize| of.part(t as u32), of.emitter);
    let normal = |t: u32| {
        let [a, b, c] = triangles[t as usize].map(|v| positions[v as usize]);
        triangle_normal(a, b, c)
    };
    // Beyond a shared wall the smallest face is the lowest.
    let compared = |s: u32, t: u32| {
        let [side_of_s, side_of_t] = [s, t].map(|t| walls.get(&t).is_some_and(|side| side.is_beyond));
        let area = |t: u32| walls.get(&t).map_or(of.shape(t).area, |side| side.area);
        let by_area = area(s).total_cmp(&area(t)).then(t.cmp(&s));
        side_of_s.cmp(&side_of_t).then(if side_of_s { by_area.reverse() } else { by_area })
    };
    let is_stacked = |&[upper, lower]: &[u32; 2]| {
        let hides = of.is_two_sided(upper) && emitter[upper as usize] == u32::MAX;
        hides
            || walls.contains_key(&upper)
            || of.is_two_sided(lower) == of.is_two_sided(upper)
            || normal(upper).dot(normal(lower)) > 0.0
    };
    let pairs = found.iter().map(|&(s, t, _)| if compared(s, t).is_lt() { [s, t] } else { [t, s] });
    let mut pairs: Vec<[u32; 2]> = pairs.filter(is_stacked).collect();
    if pairs.is_empty() {
        return StackDistances::new();
    }
    // From the top: the level of the upper face is known when the lower one is reached.
    pairs.sort_by(|a, b| compared(a[1], b[1]));
    let mut levels = levels(&pairs);
    centre(&mut levels, walls);
    let normals: HashMap<u32, Vec3> = levels.keys().map(|&t| (t, normal(t))).collect();
    let sheets = sheets(found, of, &normal);
    let mut fronts = fronts(&pairs, &normals, emitter, &sheets, walls);
    let mut stacks = Sets::new(triangles.len());
    pairs.iter().for_each(|&[s, t]| stacks.join(s, t));
    let stacked: Vec<u32> = levels.keys().copied().collect();
    widen(&mut levels, &mut fronts, &mut stacks, &part, positions, triangles);
    let steps = steps(&stacked, &mut stacks, positions, triangles);
    let before = positions.len();
    let mut moved: Vec<(u32, i32)> =
        levels.iter().map(|(&t, &level)| (t, level)).filter(|of| of.1 != 0).collect();
    moved.sort_unstable();
    let mut shift_of = |t: u32, level: i32| -(level as f32) * steps[&stacks.root(t)] * fronts[&t];
    let shifted =
        |&(t, level): &(u32, i32)| Shifted { corners: triangles[t as usize], by: shift_of(t, level) };
    let shifts: Vec<Shifted> = moved.iter().map(shifted).collect();
    // Neighbours in one plane share their moved vertices.
    let mut vertices = HashMap::<(u32, u32, i32), Vec<(Vec3, u32)>>::new();
    for (&(t, level), shift) in moved.iter().zip(&shifts) {
        let (front, stack) = (fronts[&t], stacks.root(t));
        triangles[t as usize] = triangles[t as usize].map(|v| {
            let made = vertices.entry((v, stack, level)).or_default();
            if let Some((_, same)) = made.iter().find(|(other, _)| other.dot(front) > MIN_COSINE) {
                return *same;
            }
            positions.push(positions[v as usize] + shift.by);
            made.push((front, positions.len() as u32 - 1));
            positions.len() as u32 - 1
        });
    }
    keep_contact(&shifts, &levels, &part, positions, triangles);
    if positions.len() > before {
        drop_unused(positions, triangles, 0);
    }
    distances(&levels, &mut stacks, &steps)
}

/// The largest distance by which faces of the stack of each triangle were moved.
fn distances(levels: &HashMap<u32, i32>, stacks: &mut Sets, steps: &HashMap<u32, f32>) -> StackDistances {
    let mut deepest = HashMap::<u32, u32>::new();
    for (&t, level) in levels {
        let of_stack = deepest.entry(stacks.root(t)).or_default();
        *of_stack = level.unsigned_abs().max(*of_stack);
    }
    let distance = |&t: &u32| (t, deepest[&stacks.root(t)] as f32 * steps[&stacks.root(t)]);
    levels.keys().map(distance).collect()
}

/// Lowers the levels of the faces on each shared wall by half of the largest one, so that faces on both sides are near to the common plane: points there find
/// them.
fn centre(levels: &mut HashMap<u32, i32>, walls: &WallSides) {
    let mut deepest = HashMap::<u32, i32>::new();
    for (t, &level) in &*levels {
        if let Some(side) = walls.get(t) {
            let of_wall = deepest.entry(side.wall).or_default();
            *of_wall = level.max(*of_wall);
        }
    }
    for (t, level) in levels {
        *level -= walls.get(t).map_or(0, |side| deepest[&side.wall] / 2);
    }
}

/// Adds the triangles that continue lower faces in their plane, with the level and the front of these: a ceiling stays flat. Stacks on faces of one part in one
/// plane become one.
fn widen(
    levels: &mut HashMap<u32, i32>,
    fronts: &mut HashMap<u32, Vec3>,
    stacks: &mut Sets,
    part: &dyn Fn(usize) -> u32,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
) {
    let mut lower: Vec<(u32, i32)> =
        levels.iter().map(|(&t, &level)| (t, level)).filter(|of| of.1 != 0).collect();
    lower.sort_unstable();
    let parts: HashSet<u32> = lower.iter().map(|of| part(of.0 as usize)).collect();
    let mut at_vertex = HashMap::<u32, Vec<u32>>::new();
    for t in (0..triangles.len()).filter(|&t| parts.contains(&part(t))) {
        triangles[t].iter().for_each(|&v| at_vertex.entry(v).or_default().push(t as u32));
    }
    at_vertex.retain(|_, all| all.len() <= MAX_FAN);
    let corners = |t: u32| triangles[t as usize].map(|v| positions[v as usize]);
    let distance = largest_distance(&Aabb::of(lower.iter().flat_map(|of| corners(of.0)))) as f32;
    for (seed, level) in lower {
        let (start, front, mut open) = (corners(seed)[0], fronts[&seed], vec![seed]);
        while let Some(t) = open.pop() {
            for &u in triangles[t as usize].iter().filter_map(|v| at_vertex.get(v)).flatten() {
                let is_flat = corners(u).iter().all(|p| (*p - start).dot(front).abs() <= distance);
                if part(u as usize) != part(seed as usize) || !is_flat {
                    continue;
                }
                stacks.join(seed, u);
                if let Entry::Vacant(place) = levels.entry(u) {
                    place.insert(level);
                    fronts.insert(u, front);
                    open.push(u);
                }
            }
        }
    }
}

/// A triangle before it was moved, and how it was moved.
struct Shifted {
    corners: [u32; 3],
    by: Vec3,
}

/// Moves the vertices of faces outside the stacks that lie on a moved triangle with it: otherwise light would pass between a moved ceiling and the walls and
/// partitions below it. Faces connected with the uppermost face of a stack stay with it.
fn keep_contact(
    shifts: &[Shifted],
    levels: &HashMap<u32, i32>,
    part: &dyn Fn(usize) -> u32,
    positions: &mut Vec<Vec3>,
    triangles: &mut [[u32; 3]],
) {
    let is_other = |t: usize| !levels.contains_key(&(t as u32));
    let top = levels.iter().filter(|&(_, &level)| level == 0).map(|(&t, _)| t as usize);
    let stays: HashSet<(u32, u32)> = top.flat_map(|t| triangles[t].map(|v| (v, part(t)))).collect();
    let mut others: Vec<u32> = triangles
        .iter()
        .enumerate()
        .filter(|&(t, _)| is_other(t))
        .flat_map(|(_, corners)| *corners)
        .collect();
    others.sort_unstable();
    others.dedup();
    // By vertex, the longest shift of a triangle there.
    let mut shift_of = HashMap::<u32, Vec3>::new();
    let mut shift = |v: u32, by: Vec3| {
        let known = shift_of.entry(v).or_insert(by);
        if by.length_squared() > known.length_squared() {
            *known = by;
        }
    };
    shifts.iter().for_each(|of| of.corners.into_iter().for_each(|v| shift(v, of.by)));
    for (of, v) in touching(shifts, others, positions) {
        shift(v, of.by);
    }
    let mut copies = HashMap::<u32, u32>::new();
    for t in (0..triangles.len()).filter(|&t| is_other(t)) {
        triangles[t] =
            triangles[t].map(|v| match shift_of.get(&v).filter(|_| !stays.contains(&(v, part(t)))) {
                None => v,
                Some(&by) => *copies.entry(v).or_insert_with(|| {
                    positions.push(positions[v as usize] + by);
                    positions.len() as u32 - 1
                }),
            });
    }
}

/// The vertices among `others` that lie on triangles where these were before they moved. Of many large triangles, those with the fewest vertices in reach are
/// tested.
fn touching<'a>(shifts: &'a [Shifted], mut others: Vec<u32>, positions: &[Vec3]) -> Vec<(&'a Shifted, u32)> {
    let corners = |of: &Shifted| of.corners.map(|v| positions[v as usize]);
    // Along this axis the triangles are shortest.
    let extents: Vec3 = shifts.iter().map(|of| Aabb::of(corners(of)).extent()).sum();
    let axis = extents.min_position();
    let along = |v: u32| positions[v as usize][axis];
    others.sort_by(|&a, &b| along(a).total_cmp(&along(b)).then(a.cmp(&b)));
    let reach = |of: &'a Shifted| {
        let bounds = Aabb::of(corners(of));
        let distance = largest_distance(&bounds) as f32;
        let first = others.partition_point(|&v| along(v) < bounds.min[axis] - distance);
        let end = others.partition_point(|&v| along(v) <= bounds.max[axis] + distance);
        (end - first, first..end, distance, of)
    };
    let mut reaches: Vec<_> = shifts.iter().map(reach).collect();
    reaches.sort_by_key(|(count, ..)| *count);
    let (mut tests, mut found) = (0, Vec::new());
    for (count, range, distance, of) in reaches {
        tests += count;
        if tests > MAX_TESTS {
            break;
        }
        let on = |v: &&u32| is_on(corners(of), positions[**v as usize], distance);
        found.extend(others[range].iter().filter(on).map(|&v| (of, v)));
    }
    found
}

/// Whether a point is within this distance of a triangle, measured along its normal and beyond its edges.
fn is_on([a, b, c]: [Vec3; 3], point: Vec3, distance: f32) -> bool {
    let normal = triangle_normal(a, b, c);
    let beyond = |from: Vec3, to: Vec3| (to - from).cross(normal).normalize_or_zero().dot(point - from);
    (point - a).dot(normal).abs() <= distance && beyond(a, b).max(beyond(b, c)).max(beyond(c, a)) <= distance
}

/// Distance between the faces of each stack, by its first triangle: by the coordinates of these faces and, as rays start above them by those, of their neighbours.
fn steps(
    stacked: &[u32],
    stacks: &mut Sets,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
) -> HashMap<u32, f32> {
    let magnitudes = face_magnitudes(positions, triangles);
    let mut sizes = HashMap::<u32, (Aabb, f32)>::new();
    for &t in stacked {
        let (bounds, magnitude) = sizes.entry(stacks.root(t)).or_insert((Aabb::EMPTY, 0.0));
        *bounds = bounds.union(Aabb::of(triangles[t as usize].map(|v| positions[v as usize])));
        *magnitude = magnitudes[t as usize].max(*magnitude);
    }
    let step = |(bounds, magnitude): (Aabb, f32)| largest_distance(&bounds) as f32 + GAP * magnitude;
    sizes.into_iter().map(|(stack, size)| (stack, step(size))).collect()
}

/// The pairs of overlapping triangles, the smaller index first, that are two sides of one sheet: they are turned away from each other, and
/// belong to one part or to two that such triangles cover.
fn sheets(found: &[Overlap], of: &FaceProperties, normal: &dyn Fn(u32) -> Vec3) -> HashSet<[u32; 2]> {
    let away = |&&(s, t, _): &&Overlap| normal(s).dot(normal(t)) < 0.0;
    let mut covered = HashMap::<u32, f64>::new();
    for &(s, t, area) in found.iter().filter(away) {
        [s, t].into_iter().for_each(|t| *covered.entry(of.part(t)).or_default() += area);
    }
    let is_covered = |part: u32| covered[&part] >= MIN_SHEET_COVER * of.shapes[part as usize].area;
    let is_sheet = |s: u32, t: u32| {
        let [a, b] = [s, t].map(|t| of.part(t));
        a == b || is_covered(a) && is_covered(b)
    };
    found.iter().filter(away).filter(|&&(s, t, _)| is_sheet(s, t)).map(|&(s, t, _)| [s, t]).collect()
}

/// The fronts of all faces of pairs of an upper and a lower face, sorted by the lower one from top to bottom.
fn fronts(
    pairs: &[[u32; 2]],
    normals: &HashMap<u32, Vec3>,
    emitter: &[u32],
    sheets: &HashSet<[u32; 2]>,
    walls: &WallSides,
) -> HashMap<u32, Vec3> {
    let turned = |t: u32, front: Vec3| if normals[&t].dot(front) < 0.0 { -normals[&t] } else { normals[&t] };
    let stacked = walls.iter().filter(|(t, _)| normals.contains_key(t));
    let mut fronts: HashMap<u32, Vec3> = stacked.map(|(&t, side)| (t, turned(t, side.axis))).collect();
    // Seen from the front of the upper side of a sheet, the lower one lies behind it and faces away.
    for &[upper, lower] in pairs.iter().filter(|[s, t]| sheets.contains(&[*s.min(t), *s.max(t)])) {
        [upper, lower].into_iter().for_each(|t| {
            fronts.entry(t).or_insert(turned(t, normals[&upper]));
        });
    }
    for &pair in pairs {
        if let Some(lamp) = pair.into_iter().find(|&t| emitter[t as usize] != u32::MAX) {
            pair.into_iter().for_each(|t| {
                fronts.entry(t).or_insert(turned(t, normals[&lamp]));
            });
        }
    }
    // From the bottom: the other faces turn their backs to the front of the face below.
    for &[upper, lower] in pairs.iter().rev() {
        let known = fronts.get(&lower).or(fronts.get(&upper)).copied().unwrap_or(normals[&lower]);
        for t in [lower, upper] {
            fronts.entry(t).or_insert(turned(t, known));
        }
    }
    fronts
}

/// Number of steps by which each face lies below the top of its stack, from pairs of an upper and a lower face, sorted by the lower one
/// from top to bottom.
fn levels(pairs: &[[u32; 2]]) -> HashMap<u32, i32> {
    let mut levels = HashMap::<u32, i32>::new();
    for group in pairs.chunk_by(|a, b| a[1] == b[1]) {
        let taken: HashSet<i32> = group.iter().map(|[upper, _]| *levels.entry(*upper).or_default()).collect();
        let below = 1 + taken.iter().max().copied().unwrap_or(0);
        let free = || (0..MAX_LEVELS).rev().find(|level| !taken.contains(level));
        let level = if below < MAX_LEVELS { below } else { free().unwrap_or(MAX_LEVELS) };
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
