//! The finished tree: flat arrays, siblings adjacent, the triangles of each cluster contiguous.

use super::FAN_OUT;
use super::draft::{Draft, Member};
use crate::math::Aabb;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// A node of the tree: an inner cluster or a leaf.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cluster {
    /// Smallest box around its triangles; scene units.
    pub bounds: Aabb,
    /// Index of the parent; the root is its own parent.
    pub parent: u32,
    /// Index of the first child; siblings are adjacent and come after their parent.
    pub first_child: u32,
    /// Number of children, 0 for a leaf, at most [`FAN_OUT`].
    pub children: u32,
    /// Index of its first triangle in [`Tree::order`].
    pub first_triangle: u32,
    /// Number of triangles in the cluster and its descendants; at most [`FAN_OUT`] in a leaf.
    pub triangles: u32,
}

impl Cluster {
    /// Whether the cluster has no children.
    pub fn is_leaf(&self) -> bool {
        self.children == 0
    }

    /// Indices of the children in [`Tree::clusters`].
    pub fn child_range(&self) -> Range<usize> {
        self.first_child as usize..(self.first_child + self.children) as usize
    }

    /// Range of its triangles in [`Tree::order`].
    pub fn triangle_range(&self) -> Range<usize> {
        self.first_triangle as usize..(self.first_triangle + self.triangles) as usize
    }
}

/// Clusters in breadth-first order: a parent comes before its children, so a reverse pass is bottom-up.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tree {
    /// The clusters; the first is the root. Empty if there are no triangles.
    pub clusters: Vec<Cluster>,
    /// Triangle indices of the scene, each once, leaf by leaf in depth-first order.
    pub order: Vec<u32>,
}

impl Tree {
    /// Lays out a draft in flat arrays. Boxes are set by [`Tree::fit`].
    pub(super) fn arrange(mut draft: Draft) -> Tree {
        let mut tree = Tree::default();
        let Some(root) = draft.clusters.len().checked_sub(1) else { return tree };
        // Boxes and ranges are set later, when the topology is known.
        let blank = |parent| Cluster {
            bounds: Aabb::EMPTY,
            parent,
            first_child: 0,
            children: 0,
            first_triangle: 0,
            triangles: 0,
        };
        tree.clusters.push(blank(0));
        // Members of each placed cluster, parallel to `tree.clusters`.
        let mut members_of = |c: usize| std::mem::take(&mut draft.clusters[c].members);
        let mut contents: Vec<Vec<Member>> = vec![members_of(root)];
        let mut next = 0;
        while next < contents.len() {
            let (mut faces, mut parts) = (Vec::new(), Vec::new());
            for member in &contents[next] {
                match member {
                    Member::Face(_) => faces.push(*member),
                    Member::Cluster(c) => parts.push(*c),
                }
            }
            if !parts.is_empty() {
                tree.clusters[next].first_child = tree.clusters.len() as u32;
                let stray = (!faces.is_empty()).then(|| std::mem::take(&mut faces));
                tree.clusters[next].children = (parts.len() + usize::from(stray.is_some())) as u32;
                let children: Vec<Vec<Member>> =
                    parts.into_iter().map(|c| members_of(c as usize)).chain(stray).collect();
                for members in children {
                    tree.clusters.push(blank(next as u32));
                    contents.push(members);
                }
            }
            next += 1;
        }
        tree.place_triangles(&contents);
        tree
    }

    fn place_triangles(&mut self, contents: &[Vec<Member>]) {
        let mut stack = vec![0u32];
        while let Some(c) = stack.pop() {
            let cluster = self.clusters[c as usize];
            self.clusters[c as usize].first_triangle = self.order.len() as u32;
            if cluster.is_leaf() {
                self.order.extend(contents[c as usize].iter().filter_map(|m| match m {
                    Member::Face(t) => Some(*t),
                    Member::Cluster(_) => None,
                }));
            }
            self.clusters[c as usize].triangles =
                self.order.len() as u32 - self.clusters[c as usize].first_triangle;
            stack.extend(cluster.child_range().rev().map(|i| i as u32));
        }
        for c in (1..self.clusters.len()).rev() {
            let (parent, triangles) = (self.clusters[c].parent as usize, self.clusters[c].triangles);
            self.clusters[parent].triangles += triangles;
        }
        debug_assert!(self.clusters.iter().all(|c| c.children as usize <= FAN_OUT));
    }

    /// Sets every box to the smallest around its triangles; `boxes` are those of the scene's triangles.
    pub(super) fn fit(mut self, boxes: &[Aabb]) -> Tree {
        for c in (0..self.clusters.len()).rev() {
            let cluster = self.clusters[c];
            self.clusters[c].bounds = if cluster.is_leaf() {
                let faces = &self.order[cluster.triangle_range()];
                faces.iter().fold(Aabb::EMPTY, |b, &t| b.union(boxes[t as usize]))
            } else {
                self.clusters[cluster.child_range()].iter().fold(Aabb::EMPTY, |b, c| b.union(c.bounds))
            };
        }
        self
    }

    /// Triangle indices (of the scene) in a cluster.
    pub fn triangles_of(&self, cluster: usize) -> &[u32] {
        &self.order[self.clusters[cluster].triangle_range()]
    }

    /// Number of levels: 1 for a single leaf, 0 for an empty tree.
    pub fn levels(&self) -> usize {
        let mut depth = vec![1usize; self.clusters.len()];
        for c in 1..self.clusters.len() {
            depth[c] = depth[self.clusters[c].parent as usize] + 1;
        }
        depth.into_iter().max().unwrap_or(0)
    }

    /// Size of the arrays in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.clusters.as_slice()) + size_of_val(self.order.as_slice())
    }
}
