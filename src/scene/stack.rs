//! Overlapping faces of one plane are stacked: moved off each other, so that rays meet them in one order.

use super::compact::drop_unused;
use super::connect::badly_wound;
use super::magnitudes::{GAP, face_magnitudes, largest_distance};
use super::overlap::{FaceProperties, Overlap};
use super::part_shapes::PartKind;
use super::plane_order::{Place, PlaneOrder, Rank};
use crate::math::Sets;
use crate::math::{Aabb, triangle_normal};
use glam::Vec3;
use rustc_hash::{FxHashMap, FxHashSet};
use std::collections::hash_map::Entry;

/// Largest number of levels below the uppermost face: faces move by at most 8 × 9e-6 of the largest coordinate, .7 mm in a room of
/// 10 m. In longer chains, as of shingles, the next face takes a level that is free beside those that it overlaps.
const MAX_LEVELS: i32 = 8;
/// Smallest cosine between the normals of faces in one plane that share moved vertices: 2.6 degrees; a sheet that is
/// bent by more has an edge there.
const MIN_COSINE: f32 = 0.999;

/// Largest number of triangles at a vertex over which lower faces are continued, so that the time is in proportion to the triangles.
const MAX_FAN: usize = 64;
/// Largest distance by which faces of a body move into it, relative to its thickness: faces on both sides leave half of it.
const MAX_DEPTH: f32 = 0.25;
/// Largest number of tests whether a vertex lies on a moved triangle: half a second. A ceiling over a million vertices has fifty triangles
/// for that many.
const MAX_TESTS: usize = 100_000_000;

/// How a triangle was moved as one of a stack, or with one ([`keep_contact`]); scene units.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StackMove {
    /// The largest distance by which faces of the stack were moved off each other, or by which a corner follows one of them along the
    /// normal of its face.
    pub largest: f32,
    /// By what the triangle was moved; 0 if its corners were moved differently.
    pub by: Vec3,
}

/// The moves of the triangles that overlap with others or follow these.
pub(crate) type StackMoves = FxHashMap<u32, StackMove>;

/// What [`stack`] did.
#[derive(Default)]
pub(super) struct Stacks {
    pub moves: StackMoves,
    /// Parts of moved triangles that were closed and consistently wound before.
    pub wound: FxHashSet<u32>,
    /// Pairs of objects with overlapping faces that face the same way or none of which is of a body; ascending.
    pub contacts: Vec<[u32; 2]>,
}

/// Moves the lower one of each two overlapping triangles behind the upper one, in the order of their plane ([`PlaneOrder`]).
/// Moved triangles get vertices of their own; points in the common plane lie on the uppermost face. Faces that touch a moved face, such as
/// the walls below a ceiling, follow it ([`keep_contact`]).
pub(super) fn stack(
    found: &[Overlap],
    of: &FaceProperties,
    order: &PlaneOrder,
    positions: &mut Vec<Vec3>,
    triangles: &mut [[u32; 3]],
) -> Stacks {
    if found.is_empty() {
        return Stacks::default();
    }
    let part = |t: usize| of.part(t as u32);
    let normal = |t: u32| {
        let [a, b, c] = triangles[t as usize].map(|v| positions[v as usize]);
        triangle_normal(a, b, c)
    };
    let compared = |s: u32, t: u32| order[&s].compare(s, &order[&t], t);
    let pair = |&(s, t, _): &Overlap| if compared(s, t).is_lt() { [s, t] } else { [t, s] };
    let mut pairs: Vec<[u32; 2]> = found.iter().map(pair).collect();
    let contacts = contacts(found, of, order, |s, t| normal(s).dot(normal(t)) > 0.0);
    // From the top: the level of the upper face is known when the lower one is reached.
    pairs.sort_by(|a, b| {
        let by_plane = order[&a[1]].plane.cmp(&order[&b[1]].plane);
        by_plane.then_with(|| compared(a[1], b[1]))
    });
    let mut levels = levels(&pairs);
    shift_levels(&mut levels, order);
    let front = |&t: &u32| {
        let (normal, axis) = (normal(t), order[&t].axis);
        (t, if normal.dot(axis) < 0.0 { -normal } else { normal })
    };
    let mut fronts: FxHashMap<u32, Vec3> = levels.keys().map(front).collect();
    let mut stacks = Sets::new(triangles.len());
    pairs.iter().for_each(|&[s, t]| stacks.join(s, t));
    let stacked: Vec<u32> = levels.keys().copied().collect();
    let is_of_body = |t: &u32| order[t].rank.is_of_body();
    let mut bodies: FxHashSet<u32> = stacked.iter().copied().filter(is_of_body).collect();
    widen(&mut levels, &mut fronts, &mut bodies, &mut stacks, &part, positions, triangles);
    let steps = steps(&stacked, &mut stacks, positions, triangles);
    let mut wound: FxHashSet<u32> = levels.keys().map(|&t| part(t as usize)).collect();
    let of_stacks = (0..triangles.len()).filter(|&t| wound.contains(&part(t)));
    let open = badly_wound(of_stacks.map(|t| (part(t), triangles[t])));
    wound.retain(|part| !open.contains(part));
    // Bodies thinner than that stay.
    let mut is_moved = |t: u32, level: i32| {
        let (distance, shape) = (level.unsigned_abs() as f32 * steps[&stacks.root(t)], of.shape(t));
        let is_thin = || distance > MAX_DEPTH * shape.thickness(fronts[&t]);
        level != 0 && !(bodies.contains(&t) && shape.kind == PartKind::Solid && is_thin())
    };
    let mut moved: Vec<(u32, i32)> =
        levels.iter().map(|(&t, &level)| (t, level)).filter(|of| is_moved(of.0, of.1)).collect();
    moved.sort_unstable();
    let mut shift_of = |t: u32, level: i32| -(level as f32) * steps[&stacks.root(t)] * fronts[&t];
    let shifted = |&(t, level): &(u32, i32)| Shifted {
        triangle: t,
        corners: triangles[t as usize],
        by: shift_of(t, level),
        body: bodies.contains(&t).then(|| Body { part: part(t as usize), is_closed: !of.is_two_sided(t) }),
    };
    let shifts: Vec<Shifted> = moved.iter().map(shifted).collect();
    // Neighbours in one plane share their moved vertices.
    let mut vertices = FxHashMap::<(u32, u32, i32), Vec<(Vec3, u32)>>::default();
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
    let mut moves = moves(&levels, &mut stacks, &steps, &shifts);
    keep_contact(&shifts, &levels, &part, positions, triangles, &mut moves);
    if !shifts.is_empty() {
        drop_unused(positions, triangles, 0);
    }
    Stacks { moves, wound, contacts }
}

/// The pairs of objects with overlapping faces that face the same way or none of which is of a body.
fn contacts(
    found: &[Overlap],
    of: &FaceProperties,
    order: &PlaneOrder,
    are_alike: impl Fn(u32, u32) -> bool,
) -> Vec<[u32; 2]> {
    let objects = |&(s, t, _): &Overlap| {
        let [a, b] = [s, t].map(|face| of.object[face as usize]);
        let are_visible = || are_alike(s, t) || [s, t].iter().all(|face| !order[face].rank.is_of_body());
        (a != b && are_visible()).then_some([a.min(b), a.max(b)])
    };
    let mut pairs: Vec<[u32; 2]> = found.iter().filter_map(objects).collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// The moves of the triangles of stacks.
fn moves(
    levels: &FxHashMap<u32, i32>,
    stacks: &mut Sets,
    steps: &FxHashMap<u32, f32>,
    shifts: &[Shifted],
) -> StackMoves {
    let mut deepest = FxHashMap::<u32, u32>::default();
    for (&t, level) in levels {
        let of_stack = deepest.entry(stacks.root(t)).or_default();
        *of_stack = level.unsigned_abs().max(*of_stack);
    }
    let of = |&t: &u32| {
        let largest = deepest[&stacks.root(t)] as f32 * steps[&stacks.root(t)];
        (t, StackMove { largest, by: Vec3::ZERO })
    };
    let mut moves: StackMoves = levels.keys().map(of).collect();
    shifts.iter().for_each(|shift| moves.entry(shift.triangle).or_default().by = shift.by);
    moves
}

/// Changes the levels of each plane so that the uppermost visible face stays or, if faces are visible from both sides, the plane is in
/// their middle: points of files, which lie in the plane, find these faces. Faces of a body move inwards.
fn shift_levels(levels: &mut FxHashMap<u32, i32>, order: &PlaneOrder) {
    /// Levels of the faces of a plane.
    struct Range {
        first_visible: i32,
        last_visible: i32,
        /// Whether some are visible from the back.
        has_back: bool,
        last_before: i32,
        first_behind: i32,
    }
    let mut ranges = FxHashMap::<u32, Range>::default();
    for (t, &level) in &*levels {
        let Place { plane, rank, .. } = &order[t];
        let none = Range {
            first_visible: i32::MAX,
            last_visible: i32::MIN,
            has_back: false,
            last_before: i32::MIN,
            first_behind: i32::MAX,
        };
        let of = ranges.entry(*plane).or_insert(none);
        match rank {
            Rank::BodyBefore => of.last_before = level.max(of.last_before),
            Rank::BodyBehind => of.first_behind = level.min(of.first_behind),
            Rank::Front | Rank::Back => {
                of.first_visible = level.min(of.first_visible);
                of.last_visible = level.max(of.last_visible);
                of.has_back |= *rank == Rank::Back;
            }
        }
    }
    for (t, level) in levels {
        let of = &ranges[&order[t].plane];
        *level -= match of.first_visible <= of.last_visible {
            true if of.has_back => of.first_visible + (of.last_visible - of.first_visible) / 2,
            true => of.first_visible,
            // Of two bodies in contact the larger one, before the plane, stays.
            false if of.last_before > i32::MIN => of.last_before,
            false => of.first_behind,
        };
    }
}

/// Adds the triangles that continue lower faces in their plane, with the level and the front of these: a ceiling stays flat. Stacks on
/// faces of one part in one plane become one.
fn widen(
    levels: &mut FxHashMap<u32, i32>,
    fronts: &mut FxHashMap<u32, Vec3>,
    bodies: &mut FxHashSet<u32>,
    stacks: &mut Sets,
    part: &dyn Fn(usize) -> u32,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
) {
    let mut lower: Vec<(u32, i32)> =
        levels.iter().map(|(&t, &level)| (t, level)).filter(|of| of.1 != 0).collect();
    lower.sort_unstable();
    let parts: FxHashSet<u32> = lower.iter().map(|of| part(of.0 as usize)).collect();
    let mut at_vertex = FxHashMap::<u32, Vec<u32>>::default();
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
                    if bodies.contains(&seed) {
                        bodies.insert(u);
                    }
                    open.push(u);
                }
            }
        }
    }
}

/// A triangle before it was moved, and how it was moved.
#[derive(Clone, Copy)]
struct Shifted {
    triangle: u32,
    corners: [u32; 3],
    by: Vec3,
    body: Option<Body>,
}

/// A body whose face moves into it.
#[derive(Clone, Copy)]
struct Body {
    part: u32,
    is_closed: bool,
}

/// Moves the vertices of faces outside the stacks that lie on a moved triangle with it: otherwise light would pass between a moved ceiling
/// and the walls and partitions below it. Faces connected with the uppermost face of a stack stay with it. So do those on the inner side of
/// a moved face of a body, which would leave a gap below it, except those of an open body: light would enter it. Adds the moves of
/// these faces.
fn keep_contact(
    shifts: &[Shifted],
    levels: &FxHashMap<u32, i32>,
    part: &dyn Fn(usize) -> u32,
    positions: &mut Vec<Vec3>,
    triangles: &mut [[u32; 3]],
    moves: &mut StackMoves,
) {
    let is_other = |t: usize| !levels.contains_key(&(t as u32));
    let top = levels.iter().filter(|&(_, &level)| level == 0).map(|(&t, _)| t as usize);
    let stays: FxHashSet<(u32, u32)> = top.flat_map(|t| triangles[t].map(|v| (v, part(t)))).collect();
    let mut others: Vec<u32> = triangles
        .iter()
        .enumerate()
        .filter(|&(t, _)| is_other(t))
        .flat_map(|(_, corners)| *corners)
        .collect();
    others.sort_unstable();
    others.dedup();
    // By vertex, the longest shift of a triangle there.
    let mut shift_of = FxHashMap::<u32, Shifted>::default();
    let mut shift = |v: u32, of: &Shifted| {
        let known = shift_of.entry(v).or_insert(*of);
        if of.by.length_squared() > known.by.length_squared() {
            *known = *of;
        }
    };
    shifts.iter().for_each(|of| of.corners.into_iter().for_each(|v| shift(v, of)));
    for (of, v) in touching(shifts, others, positions) {
        shift(v, of);
    }
    let mut copies = FxHashMap::<u32, u32>::default();
    for t in (0..triangles.len()).filter(|&t| is_other(t)) {
        let corners = triangles[t].map(|v| positions[v as usize]);
        let mut by = [Vec3::ZERO; 3];
        // Bodies move inwards.
        let is_outside = |from: Vec3, inwards: Vec3| {
            let height = |p: &Vec3| (*p - from).dot(inwards);
            corners.iter().map(height).fold(0.0, f32::min) < -inwards.length_squared()
        };
        for (v, by) in triangles[t].iter_mut().zip(&mut by) {
            match shift_of.get(v) {
                Some(Shifted { body: Some(body), by, .. })
                    if (body.is_closed || body.part != part(t))
                        && !is_outside(positions[*v as usize], *by) => {}
                Some(of) if !stays.contains(&(*v, part(t))) => {
                    *by = of.by;
                    *v = *copies.entry(*v).or_insert_with(|| {
                        positions.push(positions[*v as usize] + of.by);
                        positions.len() as u32 - 1
                    });
                }
                _ => {}
            }
        }
        // Walls on a ground that moves down stay in their planes.
        let normal = triangle_normal(corners[0], corners[1], corners[2]);
        let largest = by.map(|by| by.dot(normal).abs()).into_iter().fold(0.0, f32::max);
        if largest > 0.0 {
            let is_one = by[1] == by[0] && by[2] == by[0];
            moves.insert(t as u32, StackMove { largest, by: if is_one { by[0] } else { Vec3::ZERO } });
        }
    }
}

/// The vertices among `others` that lie on triangles where these were before they moved. Of many large triangles, those with the fewest
/// vertices in reach are tested.
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
        let (corners, bounds) = (corners(of), Aabb::of(corners(of)));
        let is_near = |point: Vec3| bounds.distance(point) <= distance;
        let on = |v: &&u32| {
            let point = positions[**v as usize];
            is_near(point) && is_on(corners, point, distance)
        };
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

/// Distance between the faces of each stack, by its first triangle: from the largest coordinate of these faces and their neighbours, which
/// sets the height at which rays start.
fn steps(
    stacked: &[u32],
    stacks: &mut Sets,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
) -> FxHashMap<u32, f32> {
    let magnitudes = face_magnitudes(positions, triangles);
    let mut sizes = FxHashMap::<u32, (Aabb, f32)>::default();
    for &t in stacked {
        let (bounds, magnitude) = sizes.entry(stacks.root(t)).or_insert((Aabb::EMPTY, 0.0));
        *bounds = bounds.union(Aabb::of(triangles[t as usize].map(|v| positions[v as usize])));
        *magnitude = magnitudes[t as usize].max(*magnitude);
    }
    let step = |(bounds, magnitude): (Aabb, f32)| largest_distance(&bounds) as f32 + GAP * magnitude;
    sizes.into_iter().map(|(stack, size)| (stack, step(size))).collect()
}

/// Number of steps by which each face lies below the top of its stack, from pairs of an upper and a lower face, sorted by the lower one
/// from top to bottom.
fn levels(pairs: &[[u32; 2]]) -> FxHashMap<u32, i32> {
    let mut levels = FxHashMap::<u32, i32>::default();
    for group in pairs.chunk_by(|a, b| a[1] == b[1]) {
        let taken: FxHashSet<i32> =
            group.iter().map(|[upper, _]| *levels.entry(*upper).or_default()).collect();
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
        assert_eq!(levels(&[[2, 1], [1, 0], [2, 0]]), FxHashMap::from_iter([(2, 0), (1, 1), (0, 2)]));
        let chain: Vec<[u32; 2]> = (0..100).rev().map(|k| [k + 1, k]).collect();
        let levels = levels(&chain);
        assert!(chain.iter().all(|[upper, lower]| levels[upper] != levels[lower]));
        assert!(levels.values().all(|&level| level < MAX_LEVELS));
    }
}
