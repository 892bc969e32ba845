//! Faces in one plane that overlap: which of them a ray hits would depend on rounding.
//!
//! They get an order (`plane_order.rs`), and faces behind others are moved by a few rounding errors, so that they get no light where they
//! are covered (`stack.rs`). Examples are a rug at the height of the floor, a poster in the plane of its wall, walls of two rooms in one
//! place, and a crate on a slab. A closed solid in contact with another one, or with a wall of the closed room in which it stands, is
//! excluded: nothing between them is visible.
//!
//! A plane is described by two slopes and an intercept along the axis nearest to its normal. Faces with nearly equal
//! descriptions are adjacent after sorting. Within such a group, faces with overlapping boxes are tested, found by a
//! grid of cells of the size of each face. The number of tests per face is limited, so the time is O(n log n), and of
//! many stacked faces only some are reported.

use super::{Object, Repairs, box_grid::BoxGrid, magnitudes::largest_distance, part_shapes::PartShape};
use crate::error::{figure, quote};
use crate::math::Aabb;
use crate::math::parallel;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Triangles for the detection.
pub(super) struct Faces<'a> {
    pub positions: &'a [Vec3],
    pub triangles: &'a [[u32; 3]],
    pub properties: &'a FaceProperties<'a>,
}

/// Properties of triangles that determine which of them may overlap, and their order.
pub(super) struct FaceProperties<'a> {
    /// Object of each triangle.
    pub object: &'a [u32],
    /// Emitter of each triangle, or `u32::MAX`.
    pub emitter: &'a [u32],
    /// Whether a triangle is visible from both sides.
    pub two_sided: &'a (dyn Fn(usize) -> bool + Sync),
    /// Part (connected faces) of a triangle.
    pub part: &'a (dyn Fn(usize) -> u32 + Sync),
    pub shapes: &'a [PartShape],
    /// Whether two triangles reflect and emit alike.
    pub appear_alike: &'a (dyn Fn(usize, usize) -> bool + Sync),
}

impl FaceProperties<'_> {
    /// Part of a triangle.
    pub fn part(&self, t: u32) -> u32 {
        (self.part)(t as usize)
    }

    /// Shape of the part of a triangle.
    pub fn shape(&self, t: u32) -> &PartShape {
        &self.shapes[self.part(t) as usize]
    }

    pub fn is_two_sided(&self, t: u32) -> bool {
        (self.two_sided)(t as usize)
    }
}

/// Two overlapping triangles, the smaller index first, and the area of their overlap, scene units squared.
pub(super) type Overlap = (u32, u32, f64);

/// Pairs of objects that the message names: it stays below three lines of a terminal.
const MAX_NAMED_PAIRS: usize = 4;

/// Counts overlaps and names the largest in a message.
pub(super) fn report(
    faces: &Faces,
    found: impl Iterator<Item = Overlap>,
    objects: &[Object],
    unit: &str,
    repairs: &mut Repairs,
) {
    let mut by_objects = BTreeMap::<[u32; 2], f64>::new();
    for (a, b, area) in found {
        let [a, b] = [a, b].map(|t| faces.properties.object[t as usize]);
        *by_objects.entry([a.min(b), a.max(b)]).or_default() += area;
    }
    repairs.overlapping_objects += by_objects.len();
    if by_objects.is_empty() {
        return;
    }
    let mut largest: Vec<_> = by_objects.into_iter().collect();
    largest.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let one = |&([a, b], area): &([u32; 2], f64)| {
        let [first, second] = [a, b].map(|k| quote(&objects[k as usize].name));
        let other = if a == b { "itself".to_owned() } else { format!("`{second}`") };
        format!("`{first}` and {other} {} {unit}²", figure(format!("{area:.2e}").parse().unwrap_or(area)))
    };
    let mut list: Vec<String> = largest.iter().take(MAX_NAMED_PAIRS).map(one).collect();
    if largest.len() > MAX_NAMED_PAIRS {
        list.push(format!("{} more", largest.len() - MAX_NAMED_PAIRS));
    }
    repairs.messages.push(format!(
        "faces in the same plane cover each other ({}): the smaller surface is taken to lie on the larger one (of equal ones the later in the \
         file on the earlier), which neither receives nor emits light where it is covered; if that is wrong, move one of them or delete it",
        list.join(", ")
    ));
}

/// Whether two coplanar triangles face the same way.
pub(super) fn faces_alike(faces: &Faces, pair: [u32; 2]) -> bool {
    let [n, m] = pair.map(|t| normal(&corners(faces, t as usize)));
    n.dot(m) > 0.0
}

/// Whether it does not matter which of two coplanar triangles a ray hits: they belong to one part, face the same way and look alike.
fn makes_no_difference(faces: &Faces, s: u32, t: u32) -> bool {
    let of = faces.properties;
    let same = of.part(s) == of.part(t) && (of.appear_alike)(s as usize, t as usize);
    same && faces_alike(faces, [s, t])
}

/// Normal of a triangle, of twice its area's length.
fn normal([a, b, c]: &[DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

/// Pairs of overlapping triangles, ascending.
pub(super) fn find(faces: &Faces) -> Vec<Overlap> {
    let tolerance = Tolerance::of(&Aabb::of(faces.positions.iter().copied()));
    let mut keys: Vec<(u64, u32)> =
        parallel::flat_map(parallel::at_least(4096, 0..faces.triangles.len()), |t| {
            tolerance.keys(corners(faces, t)).map(move |key| (key, t as u32))
        });
    keys.par_sort_unstable();
    let groups = keys.chunk_by(|a, b| a.0 == b.0).filter(|group| {
        let first = group[0].1;
        group.len() > 1 && group[1..].iter().any(|&(_, t)| !makes_no_difference(faces, first, t))
    });
    let groups: Vec<&[(u64, u32)]> = groups.collect();
    // A face near the border of its cell is in several groups; each pair counts once.
    let mut pairs: Vec<Overlap> = parallel::flat_map(&groups, |group| within(faces, group, &tolerance));
    parallel::sort_by_key(&mut pairs, |&(a, b, _)| (a.into(), b));
    pairs.dedup_by_key(|&mut (a, b, _)| (a, b));
    pairs
}

/// Tolerances of coplanarity.
#[derive(Clone, Copy)]
struct Tolerance {
    middle: DVec3,
    /// Largest difference of heights, scene units.
    height: f64,
}

/// Largest difference of slopes: 84 roundings of f32 (2⁻²³), and an angle of 0.0006 degrees, which nobody models.
const MAX_SLOPE_DIFFERENCE: f64 = 1e-5;
/// Size of the cells of slopes and intercepts relative to their tolerances: 2 tolerances of 32 are near a border, so
/// that 1 face in 16 enters a second cell per axis. Does not change results.
const CELL_TOLERANCES: f64 = 32.0;
/// Smallest reported overlap relative to the smaller face: excludes rounding along common edges. Affects warnings only.
const MIN_OVERLAP_PART: f64 = 1e-3;

impl Tolerance {
    fn of(bounds: &Aabb) -> Tolerance {
        Tolerance { middle: bounds.center().as_dvec3(), height: largest_distance(bounds) }
    }

    /// Hashes of the cells that contain a triangle's plane within the tolerance: slopes and intercept of `x_axis =
    /// intercept + slopes · (other two)` about the centre of the scene; the last two bits are the axis. Planes
    /// between two axes have cells for both.
    fn keys(&self, [a, b, c]: [DVec3; 3]) -> impl Iterator<Item = u64> + use<> {
        let n = (b - a).cross(c - a);
        let (from, sizes) = (
            a - self.middle,
            [MAX_SLOPE_DIFFERENCE, MAX_SLOPE_DIFFERENCE, 2.0 * self.height].map(|t| CELL_TOLERANCES * t),
        );
        let min_component = (1.0 - MAX_SLOPE_DIFFERENCE) * n.abs().max_element();
        (0..3).filter(move |&axis| n[axis].abs() >= min_component && min_component > 0.0).flat_map(
            move |axis| {
                let [i, j] = others(axis);
                let slopes = [-n[i] / n[axis], -n[j] / n[axis]];
                let intercept = from[axis] - slopes[0] * from[i] - slopes[1] * from[j];
                let numbers = [slopes[0], slopes[1], intercept];
                // Offset by half a cell, so that 0 is in the middle of a cell.
                let cells: [[i64; 2]; 3] = std::array::from_fn(|k| {
                    let place = numbers[k] / sizes[k] + 0.5;
                    [-1.0, 1.0].map(|off| (place + off / CELL_TOLERANCES).floor() as i64)
                });
                (0..8usize).filter_map(move |upper| {
                    let is_upper = |k: usize| upper >> k & 1;
                    let distinct = (0..3).all(|k| is_upper(k) == 0 || cells[k][0] != cells[k][1]);
                    distinct.then(|| mixed(std::array::from_fn(|k| cells[k][is_upper(k)])) << 2 | axis as u64)
                })
            },
        )
    }
}

/// Hash of a cell; collisions are resolved by the exact test.
fn mixed(cell: [i64; 3]) -> u64 {
    cell.iter().fold(0u64, |h, &c| {
        let h = (h ^ c as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        h ^ h >> 29
    })
}

fn others(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
}

fn corners(faces: &Faces, t: usize) -> [DVec3; 3] {
    faces.triangles[t].map(|v| faces.positions[v as usize].as_dvec3())
}

/// Largest group whose pairs are all tested: at most 66 tests, without a grid in memory. Does not change results.
const MAX_UNGRIDDED_FACES: usize = 12;
/// Largest number of tests per face, and the cost in tests of a candidate whose box does not overlap: limit the time to
/// 32 tests or 512 boxes per face. Without them, parallel needles and stacked faces would take quadratic time.
const MAX_TESTS_PER_FACE: f64 = 32.0;
const MISS_COST: f64 = 1.0 / 16.0;

/// The overlapping pairs of a group, with their areas.
fn within(faces: &Faces, group: &[(u64, u32)], tolerance: &Tolerance) -> Vec<Overlap> {
    let [i, j] = others((group[0].0 & 3) as usize);
    let flat_box = |t: u32| {
        let [a, b, c] = corners(faces, t as usize).map(|p| DVec2::new(p[i], p[j]));
        [a.min(b).min(c), a.max(b).max(c)]
    };
    let boxes: Vec<[DVec2; 2]> = group.iter().map(|&(_, t)| flat_box(t)).collect();
    let boxes_overlap = |k: usize, m: usize| {
        let ([low, high], [from, to]) = (boxes[k], boxes[m]);
        low.cmplt(to).all() && from.cmplt(high).all()
    };
    let test_pair = |k: usize, m: usize| {
        let (s, t) = (group[k].1, group[m].1);
        let area = overlap(faces, [s, t], tolerance);
        (area > 0.0).then_some((s.min(t), s.max(t), area))
    };
    if group.len() <= MAX_UNGRIDDED_FACES {
        let pairs = (0..group.len()).flat_map(|m| (0..m).map(move |k| (k, m)));
        return pairs.filter(|&(k, m)| boxes_overlap(k, m)).filter_map(|(k, m)| test_pair(k, m)).collect();
    }
    let grid = BoxGrid::new(&boxes);
    let overlaps_of = |k: usize| {
        let mut left = MAX_TESTS_PER_FACE;
        let near = grid.near(k, &boxes[k]).take_while(move |&m| {
            let goes_on = left > 0.0;
            left -= if boxes_overlap(k, m) { 1.0 } else { MISS_COST };
            goes_on
        });
        near.filter(move |&m| boxes_overlap(k, m)).filter_map(move |m| test_pair(k, m))
    };
    parallel::flat_map(parallel::at_least(1024, 0..boxes.len()), overlaps_of)
}

/// Largest distance of the planes of two overlapping faces, by their own coordinates.
fn distance_of(p: &[DVec3; 3], q: &[DVec3; 3]) -> f64 {
    largest_distance(&Aabb::of(p.iter().chain(q).map(|c| c.as_vec3())))
}

/// Area of the overlap of two nearly coplanar faces; 0 if it is below the limits.
fn overlap(faces: &Faces, [s, t]: [u32; 2], tolerance: &Tolerance) -> f64 {
    if makes_no_difference(faces, s, t) {
        return 0.0;
    }
    let of = faces.properties;
    let [p, q] = [s, t].map(|t| corners(faces, t as usize));
    let [n, m] = [&p, &q].map(normal);
    let is_sheet = of.part(s) == of.part(t) || of.shape(s).share_wall(of.shape(t), n.dot(m) > 0.0);
    let from_one_side = n.dot(m) > 0.0 || is_sheet || of.is_two_sided(s) || of.is_two_sided(t);
    if !from_one_side || beside(&p, &q, m) || beside(&q, &p, n) {
        return 0.0;
    }
    let part = clipped(&p, &q, m);
    let turns = part.windows(2).skip(1).map(|w| (w[0] - part[0]).cross(w[1] - part[0]).length());
    let area = 0.5 * turns.sum::<f64>();
    let normal = m.normalize_or_zero();
    let apart = part.iter().map(|c| normal.dot(*c - q[0]).abs()).fold(0.0, f64::max);
    let matters = area > MIN_OVERLAP_PART * 0.5 * n.length().min(m.length());
    if matters && apart <= distance_of(&p, &q).min(tolerance.height) { area } else { 0.0 }
}

/// Whether a triangle lies outside of an edge of another one with this normal.
fn beside(p: &[DVec3; 3], q: &[DVec3; 3], normal: DVec3) -> bool {
    (0..3).any(|k| {
        let inward = normal.cross(q[(k + 1) % 3] - q[k]);
        p.iter().all(|c| inward.dot(*c - q[k]) <= 0.0)
    })
}

/// The part of a triangle above another one with this normal (Sutherland and Hodgman 1974).
fn clipped(p: &[DVec3; 3], q: &[DVec3; 3], normal: DVec3) -> Vec<DVec3> {
    let mut part = p.to_vec();
    for k in 0..3 {
        let inward = normal.cross(q[(k + 1) % 3] - q[k]);
        let height = |c: DVec3| inward.dot(c - q[k]);
        let mut kept = Vec::with_capacity(part.len() + 1);
        for (l, &from) in part.iter().enumerate() {
            let to = part[(l + 1) % part.len()];
            let (a, b) = (height(from), height(to));
            if a >= 0.0 {
                kept.push(from);
            }
            if (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0) {
                kept.push(from.lerp(to, a / (a - b)));
            }
        }
        part = kept;
        if part.len() < 3 {
            return Vec::new();
        }
    }
    part
}
