//! Builders of cluster trees from the literature, besides the [`grids`](super::grids) of the paper. Each makes a
//! [`Sketch`](super::draft::Sketch) of triangles.

use super::FAN_OUT;
use super::draft::{Draft, Sketch, SketchNode};
use crate::math::{Aabb, parallel};
use glam::Vec3;
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

// Surface area heuristic: each division into two minimises the number of triangles times the surface of their box,
// summed over both parts, over planes between bins of the triangles' centres (Wald 2007).

/// Bins per axis: with 16 the cost of trees is within 1 % of that of a full sweep (Wald 2007).
const BINS: usize = 16;
/// Parts with more triangles are built in parallel: with fewer, starting a task takes a notable share of its time. Does not change
/// results.
const PARALLEL_TRIANGLES: usize = 4096;

/// The tree of these triangles; none soon after `stopped` returns true.
pub(super) fn split_by_cost(
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
        sketch.add(SketchNode::Faces(faces));
        return Some(sketch);
    }
    let parallel = faces.len() > PARALLEL_TRIANGLES;
    let [a, b] = divide(faces, boxes);
    let (a, b) = match parallel {
        true => parallel::join(|| part(a, boxes, stopped), || part(b, boxes, stopped)),
        false => (part(a, boxes, stopped), part(b, boxes, stopped)),
    };
    let parts = vec![sketch.append(a?), sketch.append(b?)];
    sketch.add(SketchNode::Parts(parts));
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
        let cost = |side: (usize, Aabb)| side.0 as f32 * side.1.half_area();
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

// k-d tree [Sillion 94]: the cell is halved in the middle of its longest edge; what a plane cuts stays in the smallest cell that holds it.
//
// Choice of ours where the paper gives no details: what a plane cuts is divided by the two other axes, so that a
// cluster does not hold more than [`FAN_OUT`] parts.

/// Number of halvings of a cell, at most: 20 per axis, as for the finest grid.
const MAX_HALVINGS: usize = 60;

/// The k-d tree of these triangles; none soon after `stopped` returns true.
pub(super) fn halve_space(faces: &[u32], boxes: &[Aabb], stopped: &dyn Fn() -> bool) -> Option<Draft> {
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
        Some(self.sketch.add(SketchNode::Parts(parts)))
    }
}

// Hierarchy of bounding boxes by insertion [Goldsmith and Salmon 1987]: triangles come one after the other; each descends
// to the child whose box grows least, and is added where the expected number of box tests of a ray grows least.
//
// The expected number of tests is the sum over nodes of surface times number of children, relative to the surface of the
// root. Triangles come in random order, as the paper recommends.

/// Seed of the order of insertion.
const SEED: u128 = 1;

/// The hierarchy of these triangles; none soon after `stopped` returns true.
pub(super) fn insert_all(faces: &[u32], boxes: &[Aabb], stopped: &dyn Fn() -> bool) -> Option<Draft> {
    let mut order = faces.to_vec();
    let mut random = Pcg64Mcg::new(SEED);
    for k in (1..order.len()).rev() {
        order.swap(k, (random.next_u64() % (k as u64 + 1)) as usize);
    }
    let mut tree = Boxes::default();
    for &t in &order {
        if stopped() {
            return None;
        }
        tree.insert(t, boxes[t as usize]);
    }
    let (sketch, root) = tree.sketch();
    Some(sketch.into_draft(root, boxes))
}

/// A node: a triangle, or a box around children.
struct BoxNode {
    bounds: Aabb,
    parent: u32,
    face: Option<u32>,
    children: Vec<u32>,
}

#[derive(Default)]
struct Boxes {
    nodes: Vec<BoxNode>,
    root: u32,
}

/// Position in the tree at which a triangle is added.
#[derive(Clone, Copy)]
enum Place {
    /// As another child of this node.
    Child(u32),
    /// As the sibling of this node, in a new box around both.
    Sibling(u32),
}

impl Boxes {
    fn insert(&mut self, face: u32, bounds: Aabb) {
        let new = self.nodes.len() as u32;
        let place = (new > 0).then(|| self.best_place(bounds));
        self.nodes.push(BoxNode { bounds, parent: new, face: Some(face), children: Vec::new() });
        let mut above = match place {
            None => return,
            Some(Place::Child(parent)) => parent,
            Some(Place::Sibling(old)) => self.joint(old),
        };
        self.nodes[above as usize].children.push(new);
        self.nodes[new as usize].parent = above;
        loop {
            let node = &mut self.nodes[above as usize];
            node.bounds = node.bounds.union(bounds);
            if above == self.root {
                return;
            }
            above = node.parent;
        }
    }

    /// A new node in the place of `old`, with `old` as its child.
    fn joint(&mut self, old: u32) -> u32 {
        let new = self.nodes.len() as u32;
        let BoxNode { bounds, parent, .. } = self.nodes[old as usize];
        let is_root = old == self.root;
        let parent = if is_root { new } else { parent };
        self.nodes.push(BoxNode { bounds, parent, face: None, children: vec![old] });
        self.nodes[old as usize].parent = new;
        if is_root {
            self.root = new;
        } else if let Some(slot) = self.nodes[parent as usize].children.iter_mut().find(|c| **c == old) {
            *slot = new;
        }
        new
    }

    /// The place that adds least to the cost, on the way down to the children whose boxes grow least.
    fn best_place(&self, bounds: Aabb) -> Place {
        let (mut node, mut inherited) = (self.root, 0.0f32);
        let mut best = (f32::INFINITY, Place::Sibling(node));
        while inherited < best.0 {
            let BoxNode { bounds: own, face, children, .. } = &self.nodes[node as usize];
            let (before, after) = (own.half_area(), own.union(bounds).half_area());
            let sibling = inherited + 2.0 * after;
            if sibling < best.0 {
                best = (sibling, Place::Sibling(node));
            }
            if face.is_some() {
                break;
            }
            let count = children.len() as f32;
            let child = inherited + after * (count + 1.0) - before * count;
            if children.len() < FAN_OUT && child < best.0 {
                best = (child, Place::Child(node));
            }
            inherited += (after - before) * count;
            let growth = |c: u32| {
                let own = self.nodes[c as usize].bounds;
                (own.union(bounds).half_area() - own.half_area(), own.half_area())
            };
            let least = children.iter().map(|&c| (growth(c), c)).reduce(|a, b| if b.0 < a.0 { b } else { a });
            match least {
                Some((_, c)) => node = c,
                None => break,
            }
        }
        best.1
    }

    /// The tree with parts before the nodes that hold them.
    fn sketch(&self) -> (Sketch, u32) {
        let mut order = vec![self.root];
        let mut next = 0;
        while let Some(&node) = order.get(next) {
            order.extend(&self.nodes[node as usize].children);
            next += 1;
        }
        let (mut sketch, mut made) = (Sketch::default(), vec![0u32; self.nodes.len()]);
        for &node in order.iter().rev() {
            let BoxNode { face, children, .. } = &self.nodes[node as usize];
            let parts = || children.iter().map(|&c| made[c as usize]).collect();
            made[node as usize] = match face {
                Some(t) => sketch.add(SketchNode::Faces(vec![*t])),
                None => sketch.add(SketchNode::Parts(parts())),
            };
        }
        (sketch, made[self.root as usize])
    }
}
