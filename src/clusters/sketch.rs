//! Trees of any fan-out, as builders other than the grids make them, and their conversion to clusters.

use super::FAN_OUT;
use super::draft::{Draft, DraftCluster, Member};
use crate::math::Aabb;

/// A node of a [`Sketch`].
#[derive(Clone, Debug)]
pub(super) enum Node {
    /// Triangles.
    Faces(Vec<u32>),
    /// Indices of at least two nodes before this one.
    Parts(Vec<u32>),
}

/// A tree over triangles; parts come before the node that holds them.
#[derive(Clone, Debug, Default)]
pub(super) struct Sketch {
    nodes: Vec<Node>,
}

impl Sketch {
    /// Adds a node; a node of one part is that part.
    pub fn add(&mut self, node: Node) -> u32 {
        match node {
            Node::Parts(parts) if parts.len() == 1 => parts[0],
            node => {
                self.nodes.push(node);
                self.last()
            }
        }
    }

    /// The node that was added last.
    pub fn last(&self) -> u32 {
        self.nodes.len() as u32 - 1
    }

    /// A node of these triangles, however many, in parts of [`FAN_OUT`].
    pub fn add_faces(&mut self, faces: &[u32]) -> u32 {
        let mut parts: Vec<u32> =
            faces.chunks(FAN_OUT).map(|some| self.add(Node::Faces(some.to_vec()))).collect();
        while parts.len() > 1 {
            parts = parts.chunks(FAN_OUT).map(|some| self.add(Node::Parts(some.to_vec()))).collect();
        }
        parts[0]
    }

    /// Appends another sketch and returns its last node.
    pub fn append(&mut self, other: Sketch) -> u32 {
        let offset = self.nodes.len() as u32;
        self.nodes.extend(other.nodes.into_iter().map(|mut node| {
            if let Node::Parts(parts) = &mut node {
                parts.iter_mut().for_each(|part| *part += offset);
            }
            node
        }));
        self.last()
    }

    /// The clusters: nodes of at most [`FAN_OUT`] triangles become leaves, and the parts of inner nodes are replaced by
    /// their own parts, the one with the largest surface first, as long as a cluster can hold them. The engines test
    /// [`FAN_OUT`] boxes in the time of one, so that clusters of two parts would cost most of that time for nothing.
    pub fn into_draft(self, root: u32, boxes: &[Aabb]) -> Draft {
        let mut counts: Vec<usize> = Vec::with_capacity(self.nodes.len());
        let mut bounds: Vec<Aabb> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let (count, around) = match node {
                Node::Faces(faces) => {
                    (faces.len(), faces.iter().fold(Aabb::EMPTY, |b, &t| b.union(boxes[t as usize])))
                }
                Node::Parts(parts) => parts.iter().fold((0, Aabb::EMPTY), |(n, b), &part| {
                    (n + counts[part as usize], b.union(bounds[part as usize]))
                }),
            };
            counts.push(count);
            bounds.push(around);
        }
        // From the root down; a draft has its root last.
        let mut order = vec![root];
        let mut members: Vec<Vec<Member>> = Vec::new();
        while let Some(&node) = order.get(members.len()) {
            let parts = match &self.nodes[node as usize] {
                Node::Parts(parts) if counts[node as usize] > FAN_OUT => parts,
                _ => {
                    members.push(self.faces_below(node));
                    continue;
                }
            };
            let parts = self.widened(parts, &counts, &bounds);
            members.push((0..parts.len()).map(|k| Member::Cluster((order.len() + k) as u32)).collect());
            order.extend(parts);
        }
        let last = order.len() as u32 - 1;
        let clusters = order.iter().zip(members).rev().map(|(&node, mut members)| {
            for member in &mut members {
                if let Member::Cluster(c) = member {
                    *c = last - *c;
                }
            }
            DraftCluster { bounds: bounds[node as usize], members }
        });
        Draft { clusters: clusters.collect() }
    }

    fn faces_below(&self, node: u32) -> Vec<Member> {
        let (mut faces, mut stack) = (Vec::new(), vec![node]);
        while let Some(node) = stack.pop() {
            match &self.nodes[node as usize] {
                Node::Faces(own) => faces.extend(own.iter().map(|&t| Member::Face(t))),
                Node::Parts(parts) => stack.extend(parts.iter().rev()),
            }
        }
        faces
    }

    fn widened(&self, parts: &[u32], counts: &[usize], bounds: &[Aabb]) -> Vec<u32> {
        let mut parts = parts.to_vec();
        loop {
            let room = FAN_OUT + 1 - parts.len();
            let openable = parts.iter().enumerate().filter_map(|(k, &part)| {
                let own = match &self.nodes[part as usize] {
                    Node::Parts(own) if counts[part as usize] > FAN_OUT && own.len() <= room => own,
                    _ => return None,
                };
                Some((k, surface(bounds[part as usize]), own))
            });
            // The first of equals.
            let Some((k, _, own)) = openable.reduce(|a, b| if b.1 > a.1 { b } else { a }) else {
                return parts;
            };
            parts.splice(k..=k, own.iter().copied());
        }
    }
}

/// Half of the surface of a box, length²; 0 for an empty box.
pub(super) fn surface(bounds: Aabb) -> f32 {
    let e = bounds.extent();
    e.x * e.y + e.y * e.z + e.z * e.x
}
