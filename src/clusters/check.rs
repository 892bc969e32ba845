//! Validation of cluster hierarchies: topology, boxes, and the partition of the triangles.

use super::tree::Tree;
use super::{FAN_OUT, Hierarchy};
use crate::math::Aabb;
use crate::scene::Scene;

impl Hierarchy {
    /// Checks topology, boxes and the strict partition of the scene's triangles. Accepts hierarchies with arbitrary
    /// values, such as those read from a cache.
    ///
    /// # Errors
    /// A description of the first violation.
    pub fn check(&self, scene: &Scene) -> Result<(), String> {
        let mut seen = vec![0u8; scene.triangles.len()];
        for (name, tree) in [("micro", &self.micro), ("large", &self.large)] {
            check_tree(tree, scene).map_err(|e| format!("{name} tree: {e}"))?;
            tree.order.iter().for_each(|&t| seen[t as usize] = seen[t as usize].saturating_add(1));
        }
        match seen.iter().position(|&n| n != 1) {
            Some(t) => Err(format!("triangle {t} is in {} leaves", seen[t])),
            None => Ok(()),
        }
    }
}

fn check_tree(tree: &Tree, scene: &Scene) -> Result<(), String> {
    let Some(root) = tree.clusters.first() else {
        return if tree.order.is_empty() { Ok(()) } else { Err("triangles without a root".into()) };
    };
    let inside = |first: u32, count: u32, all: usize| u64::from(first) + u64::from(count) <= all as u64;
    for (c, k) in tree.clusters.iter().enumerate() {
        if !inside(k.first_triangle, k.triangles, tree.order.len())
            || !inside(k.first_child, k.children, tree.clusters.len())
        {
            return Err(format!("cluster {c} reaches beyond the end"));
        }
    }
    if let Some(c) = tree.clusters.iter().position(|k| k.is_leaf() && k.first_child != 0) {
        return Err(format!("leaf {c} has a first child"));
    }
    if let Some(&t) = tree.order.iter().find(|&&t| t as usize >= scene.triangles.len()) {
        return Err(format!("there is no triangle {t}"));
    }
    if root.parent != 0 {
        return Err("the root is not its own parent".into());
    }
    if root.triangle_range() != (0..tree.order.len()) {
        return Err("the root does not hold all triangles".into());
    }
    let mut parents = vec![0u32; tree.clusters.len()];
    for (c, cluster) in tree.clusters.iter().enumerate() {
        let children = cluster.child_range();
        if cluster.is_leaf() {
            let count = cluster.triangles as usize;
            if count == 0 || count > FAN_OUT {
                return Err(format!("leaf {c} holds {count} triangles"));
            }
            let tight = Aabb::of(tree.triangles_of(c).iter().flat_map(|&t| scene.corners(t)));
            if tight != cluster.bounds {
                return Err(format!("leaf {c} has a box that is not that of its triangles"));
            }
            continue;
        }
        if children.start <= c || children.end > tree.clusters.len() || cluster.children as usize > FAN_OUT {
            return Err(format!("cluster {c} has children {children:?}"));
        }
        let mut next = cluster.first_triangle;
        let mut bounds = Aabb::EMPTY;
        for k in children {
            let child = &tree.clusters[k];
            parents[k] += 1;
            if child.parent as usize != c {
                return Err(format!("cluster {k} does not know its parent {c}"));
            }
            if child.first_triangle != next {
                return Err(format!("triangles of cluster {k} do not follow those of its elder sibling"));
            }
            next += child.triangles;
            bounds = bounds.union(child.bounds);
        }
        if next as usize != cluster.triangle_range().end {
            return Err(format!("cluster {c} does not hold its children's triangles"));
        }
        if bounds != cluster.bounds {
            return Err(format!("cluster {c} has a box that is not that of its children"));
        }
    }
    match parents.iter().skip(1).position(|&n| n != 1) {
        Some(c) => Err(format!("cluster {} has {} parents", c + 1, parents[c + 1])),
        None => Ok(()),
    }
}
