//! Cluster trees under construction: the common input of [`super::tree::Tree::arrange`].

use super::FAN_OUT;
use crate::math::Aabb;

/// A member of a cluster: a triangle of the scene or another cluster of the draft.
#[derive(Clone, Copy, Debug)]
pub(super) enum Member {
    Face(u32),
    Cluster(u32),
}

/// A member with its box and the data that grouping needs.
#[derive(Clone, Debug)]
pub(super) struct Item {
    pub member: Member,
    pub bounds: Aabb,
    /// Smallest triangle index, to break ties: the result must not depend on the number of threads.
    pub first_face: u32,
    /// Sum of the volumes of the triangles' own boxes, length³; used for the empty fraction.
    pub occupied: f64,
    /// Number of triangles of a triangle or of a leaf; `None` for clusters of clusters.
    pub faces: Option<usize>,
}

/// Number of triangles of two items together if both are leaves (or triangles) and the sum fits into one leaf.
pub(super) fn one_leaf(a: Option<usize>, b: Option<usize>) -> Option<usize> {
    Some(a? + b?).filter(|&faces| faces <= FAN_OUT)
}

impl Item {
    pub fn new(member: Member, bounds: Aabb) -> Item {
        let (first_face, faces) = match member {
            Member::Face(t) => (t, Some(1)),
            Member::Cluster(_) => (0, None),
        };
        Item { member, bounds, first_face, occupied: 0.0, faces }
    }
}

#[derive(Clone, Debug)]
pub(super) struct DraftCluster {
    pub bounds: Aabb,
    pub members: Vec<Member>,
}

/// An arena of clusters; the last one is the root.
#[derive(Clone, Debug, Default)]
pub(super) struct Draft {
    pub clusters: Vec<DraftCluster>,
}

impl Draft {
    /// Makes a cluster of these items. Small leaves that fit together become one leaf.
    pub fn group(&mut self, items: &[Item]) -> Item {
        let bounds = items.iter().fold(Aabb::EMPTY, |b, i| b.union(i.bounds));
        let faces = items.iter().map(|i| i.faces).reduce(one_leaf).flatten();
        let mut members = Vec::with_capacity(items.len());
        for item in items {
            match item.member {
                Member::Cluster(c) if faces.is_some() => {
                    members.extend_from_slice(&self.clusters[c as usize].members);
                }
                member => members.push(member),
            }
        }
        self.clusters.push(DraftCluster { bounds, members });
        Item {
            member: Member::Cluster(self.clusters.len() as u32 - 1),
            bounds,
            first_face: items.iter().map(|i| i.first_face).min().unwrap_or(0),
            occupied: items.iter().map(|i| i.occupied).sum(),
            faces,
        }
    }

    /// Appends the clusters of another draft and returns its root as an item.
    pub fn adopt(&mut self, other: Draft) -> Item {
        let offset = self.clusters.len() as u32;
        let root = other.clusters.len() as u32 - 1 + offset;
        let first_face = other.first_face();
        self.clusters.extend(other.clusters.into_iter().map(|mut cluster| {
            for member in &mut cluster.members {
                if let Member::Cluster(c) = member {
                    *c += offset;
                }
            }
            cluster
        }));
        let bounds = self.clusters[root as usize].bounds;
        let occupied = bounds.volume();
        Item { member: Member::Cluster(root), bounds, first_face, occupied, faces: None }
    }

    fn first_face(&self) -> u32 {
        let faces = self.clusters.iter().flat_map(|c| &c.members).filter_map(|m| match m {
            Member::Face(t) => Some(*t),
            Member::Cluster(_) => None,
        });
        faces.min().unwrap_or(0)
    }
}

// Trees of any fan-out, as builders other than the grids make them, and their conversion to clusters.

/// A node of a [`Sketch`].
#[derive(Clone, Debug)]
pub(super) enum SketchNode {
    /// Triangles.
    Faces(Vec<u32>),
    /// Indices of at least two nodes before this one.
    Parts(Vec<u32>),
}

/// A tree over triangles; parts come before the node that holds them.
#[derive(Clone, Debug, Default)]
pub(super) struct Sketch {
    nodes: Vec<SketchNode>,
}

impl Sketch {
    /// Adds a node; a node of one part is that part.
    pub fn add(&mut self, node: SketchNode) -> u32 {
        match node {
            SketchNode::Parts(parts) if parts.len() == 1 => parts[0],
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
            faces.chunks(FAN_OUT).map(|some| self.add(SketchNode::Faces(some.to_vec()))).collect();
        while parts.len() > 1 {
            parts = parts.chunks(FAN_OUT).map(|some| self.add(SketchNode::Parts(some.to_vec()))).collect();
        }
        parts[0]
    }

    /// Appends another sketch and returns its last node.
    pub fn append(&mut self, other: Sketch) -> u32 {
        let offset = self.nodes.len() as u32;
        self.nodes.extend(other.nodes.into_iter().map(|mut node| {
            if let SketchNode::Parts(parts) = &mut node {
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
                SketchNode::Faces(faces) => {
                    (faces.len(), faces.iter().fold(Aabb::EMPTY, |b, &t| b.union(boxes[t as usize])))
                }
                SketchNode::Parts(parts) => parts.iter().fold((0, Aabb::EMPTY), |(n, b), &part| {
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
                SketchNode::Parts(parts) if counts[node as usize] > FAN_OUT => parts,
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
                SketchNode::Faces(own) => faces.extend(own.iter().map(|&t| Member::Face(t))),
                SketchNode::Parts(parts) => stack.extend(parts.iter().rev()),
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
                    SketchNode::Parts(own) if counts[part as usize] > FAN_OUT && own.len() <= room => own,
                    _ => return None,
                };
                Some((k, bounds[part as usize].half_area(), own))
            });
            // The first of equals.
            let Some((k, _, own)) = openable.reduce(|a, b| if b.1 > a.1 { b } else { a }) else {
                return parts;
            };
            parts.splice(k..=k, own.iter().copied());
        }
    }
}
