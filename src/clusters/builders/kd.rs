//! k-d tree [Sillion 94]: the cell is halved in the middle of its longest edge; what a plane cuts stays in the smallest
//! cell that holds it.
//!
//! Choice of ours where the paper gives no details: what a plane cuts is divided by the two other axes, so that a
//! cluster does not hold more than [`FAN_OUT`] parts.

use super::super::FAN_OUT;
use super::super::draft::Draft;
use super::super::sketch::{Node, Sketch};
use crate::math::Aabb;

/// Number of halvings of a cell, at most: 20 per axis, as for the finest grid.
const MAX_HALVINGS: usize = 60;

/// The k-d tree of these triangles; none soon after `stopped` returns true.
pub(in super::super) fn halve_space(
    faces: &[u32],
    boxes: &[Aabb],
    stopped: &dyn Fn() -> bool,
) -> Option<Draft> {
    let cell = faces.iter().fold(Aabb::EMPTY, |b, &t| b.union(boxes[t as usize]));
    let mut builder = Halving { boxes, stopped, sketch: Sketch::default() };
    let root = builder.divide(faces.to_vec(), cell, [true; 3], MAX_HALVINGS)?;
    Some(builder.sketch.into_draft(root, boxes))
}

struct Halving<'a> {
    boxes: &'a [Aabb],
    stopped: &'a dyn Fn() -> bool,
    sketch: Sketch,
}

impl Halving<'_> {
    /// The node of the triangles of a cell; `axes` may be divided.
    fn divide(&mut self, faces: Vec<u32>, cell: Aabb, axes: [bool; 3], left: usize) -> Option<u32> {
        if (self.stopped)() {
            return None;
        }
        let edge = |k: usize| if axes[k] { cell.extent()[k] } else { -1.0 };
        let axis = (1..3).fold(0, |best, k| if edge(k) > edge(best) { k } else { best });
        if faces.len() <= FAN_OUT || left == 0 || edge(axis) <= 0.0 {
            return Some(self.sketch.add_faces(&faces));
        }
        let middle = 0.5 * (cell.min[axis] + cell.max[axis]);
        let (mut sides, mut cut) = ([Vec::new(), Vec::new()], Vec::new());
        for t in faces {
            let Aabb { min, max } = self.boxes[t as usize];
            match (max[axis] <= middle, min[axis] >= middle) {
                (true, _) => sides[0].push(t),
                (_, true) => sides[1].push(t),
                _ => cut.push(t),
            }
        }
        let (mut lower, mut upper) = (cell, cell);
        (lower.max[axis], upper.min[axis]) = (middle, middle);
        let mut others = axes;
        others[axis] = false;
        let [below, above] = sides;
        let mut parts = Vec::new();
        for (faces, cell, axes) in [(below, lower, axes), (above, upper, axes), (cut, cell, others)] {
            if !faces.is_empty() {
                parts.push(self.divide(faces, cell, axes, left - 1)?);
            }
        }
        Some(self.sketch.add(Node::Parts(parts)))
    }
}
