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
