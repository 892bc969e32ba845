//! Surface area heuristic: each division into two minimises the number of triangles times the surface of their box,
//! summed over both parts, over planes between bins of the triangles' centres (Wald 2007).

use super::super::FAN_OUT;
use super::super::draft::Draft;
use super::super::sketch::{Node, Sketch, surface};
use crate::math::Aabb;
use glam::Vec3;

/// Bins per axis: with 16 the cost of trees is within 1 % of that of a full sweep (Wald 2007).
const BINS: usize = 16;
/// Parts with more triangles are built in parallel.
const PARALLEL_TRIANGLES: usize = 4096;

/// The tree of these triangles; none soon after `stopped` returns true.
pub(in super::super) fn split_by_cost(
    faces: &[u32],
    boxes: &[Aabb],
    stopped: &(dyn Fn() -> bool + Sync),
) -> Option<Draft> {
    let sketch = part(faces.to_vec(), boxes, stopped)?;
    let root = sketch.last();
    Some(sketch.into_draft(root, boxes))
}

/// The tree of a part, with its root last.
fn part(faces: Vec<u32>, boxes: &[Aabb], stopped: &(dyn Fn() -> bool + Sync)) -> Option<Sketch> {
    let mut sketch = Sketch::default();
    if stopped() {
        return None;
    }
    if faces.len() <= FAN_OUT {
        sketch.add(Node::Faces(faces));
        return Some(sketch);
    }
    let parallel = faces.len() > PARALLEL_TRIANGLES;
    let [a, b] = divide(faces, boxes);
    let (a, b) = match parallel {
        true => rayon::join(|| part(a, boxes, stopped), || part(b, boxes, stopped)),
        false => (part(a, boxes, stopped), part(b, boxes, stopped)),
    };
    let parts = vec![sketch.append(a?), sketch.append(b?)];
    sketch.add(Node::Parts(parts));
    Some(sketch)
}

/// The division of least cost; in halves if all centres coincide.
fn divide(faces: Vec<u32>, boxes: &[Aabb]) -> [Vec<u32>; 2] {
    let centre = |t: u32| boxes[t as usize].center();
    let around = Aabb::of(faces.iter().map(|&t| centre(t)));
    let scale = Vec3::splat(BINS as f32) / around.extent();
    let bin = |t: u32, axis: usize| (((centre(t) - around.min)[axis] * scale[axis]) as usize).min(BINS - 1);
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| scale[axis].is_finite()) {
        let mut bins = [(0usize, Aabb::EMPTY); BINS];
        for &t in &faces {
            let (count, bounds) = &mut bins[bin(t, axis)];
            (*count, *bounds) = (*count + 1, bounds.union(boxes[t as usize]));
        }
        let join = |a: (usize, Aabb), b: &(usize, Aabb)| (a.0 + b.0, a.1.union(b.1));
        let cost = |side: (usize, Aabb)| side.0 as f32 * surface(side.1);
        let mut above = [(0, Aabb::EMPTY); BINS + 1];
        for k in (0..BINS).rev() {
            above[k] = join(above[k + 1], &bins[k]);
        }
        let mut below = (0, Aabb::EMPTY);
        for k in 1..BINS {
            below = join(below, &bins[k - 1]);
            if below.0 == 0 || above[k].0 == 0 {
                continue;
            }
            let sum = cost(below) + cost(above[k]);
            if best.is_none_or(|(least, ..)| sum < least) {
                best = Some((sum, axis, k));
            }
        }
    }
    let Some((_, axis, plane)) = best else {
        let (a, b) = faces.split_at(faces.len() / 2);
        return [a.to_vec(), b.to_vec()];
    };
    let (a, b) = faces.into_iter().partition(|&t| bin(t, axis) < plane);
    [a, b]
}
