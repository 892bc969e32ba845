//! Hierarchy of bounding boxes by insertion [Goldsmith and Salmon 1987]: triangles come one after the other; each descends
//! to the child whose box grows least, and is added where the expected number of box tests of a ray grows least.
//!
//! The expected number of tests is the sum over nodes of surface times number of children, relative to the surface of the
//! root. Triangles come in random order, as the paper recommends.

use super::super::FAN_OUT;
use super::super::draft::Draft;
use super::super::sketch::{Node, Sketch, surface};
use crate::math::Aabb;
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

/// Seed of the order of insertion.
const SEED: u128 = 1;
/// Insertions between two questions whether to stop.
const STOP_INTERVAL: usize = 1024;

/// The hierarchy of these triangles; none soon after `stopped` returns true.
pub(in super::super) fn insert_all(
    faces: &[u32],
    boxes: &[Aabb],
    stopped: &dyn Fn() -> bool,
) -> Option<Draft> {
    let mut order = faces.to_vec();
    let mut random = Pcg64Mcg::new(SEED);
    for k in (1..order.len()).rev() {
        order.swap(k, (random.next_u64() % (k as u64 + 1)) as usize);
    }
    let mut tree = Boxes::default();
    for (k, &t) in order.iter().enumerate() {
        if k % STOP_INTERVAL == 0 && stopped() {
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

/// Where a triangle is added.
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
            let (before, after) = (surface(*own), surface(own.union(bounds)));
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
                (surface(own.union(bounds)) - surface(own), surface(own))
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
                Some(t) => sketch.add(Node::Faces(vec![*t])),
                None => sketch.add(Node::Parts(parts())),
            };
        }
        (sketch, made[self.root as usize])
    }
}
