//! Clusters: a strict partition of the scene's triangles into a tree, built as a hierarchy of uniform grids
//! [SD95 sec 4.1] or by one of three other [`Builder`]s; docs/method.md, Clusters.
//!
//! Large planar surfaces (walls, floors, table tops) form a second tree, so that no extinction is ever computed from
//! them. This room stores geometry and topology only: no rays, no radiosity.

mod builders;
mod draft;
mod grids;
mod large;
pub mod placed;
#[cfg(test)]
mod tests;
mod tree;

use crate::math::Aabb;
use crate::math::parallel;
use crate::scene::Scene;
use draft::{Draft, Item, Member};
use serde::{Deserialize, Serialize};
pub use tree::{Cluster, Tree};

/// Largest number of children of a cluster and of triangles of a leaf: the number of f32 lanes of a SIMD register.
pub const FAN_OUT: usize = 16;

/// Objects with more triangles than this get clusters of their own; smaller ones are clustered with the rest: a leaf.
const LARGE_OBJECT_TRIANGLES: usize = FAN_OUT;

/// Objects whose longest extent exceeds this fraction of the scene's (such as all leaves of a forest in one group) are
/// split: their connected parts are clustered one by one, and parts as large as that by their faces. In a forest 0.125,
/// 0.25 and 0.5 leave errors of 0.030, 0.026 and 0.026 at a feature size of 0.25 m, and 0.050, 0.039 and 0.039 at 1 m
/// (`constants.py bench`).
const SPREAD_OBJECT_FRACTION: f32 = 0.25;

/// Algorithm that builds the clusters of a [`Model`](crate::Model), which multi-resolution visibility may average.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Builder {
    /// Hierarchy of uniform grids: objects of similar size that leave little space empty [SD95 sec 4.1].
    #[default]
    Grids,
    /// k-d tree: space is halved, what a plane cuts stays in the smallest cell that holds it [Sillion 94].
    #[serde(rename = "kdtree")]
    KdTree,
    /// Bounding boxes by insertion, each triangle where a ray's box tests grow least [Goldsmith and Salmon 1987].
    GoldsmithSalmon,
    /// Divisions into two by the surface area heuristic, as in trees for ray tracing.
    Sah,
}

impl Builder {
    /// All builders, the default first.
    #[doc(hidden)]
    pub const ALL: [Builder; 4] = [Builder::Grids, Builder::KdTree, Builder::GoldsmithSalmon, Builder::Sah];

    /// Name on the command line and in JSON.
    #[doc(hidden)]
    pub fn name(self) -> &'static str {
        match self {
            Builder::Grids => "grids",
            Builder::KdTree => "kdtree",
            Builder::GoldsmithSalmon => "goldsmith-salmon",
            Builder::Sah => "sah",
        }
    }
}

options! {
    /// Options of [`build`].
    #[derive(Clone, Copy, Debug)]
    pub struct Options {
        /// The algorithm.
        pub builder: Builder = Builder::default();
        /// Planar surfaces whose inscribed disc has a diameter of at least this fraction of the scene's diagonal are kept
        /// outside the clusters; above 0, infinite for none.
        pub large_surface: f32 = 1.0 / 32.0;
    }
}

/// The clusters of a scene. Every triangle is in exactly one leaf of exactly one of the two trees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hierarchy {
    /// Clusters that may be aggregated.
    pub micro: Tree,
    /// Large planar surfaces: always tested exactly, never aggregated.
    pub large: Tree,
}

/// Builds the clusters of a scene. Parallel; the result does not depend on the number of threads; O(n log n).
pub fn build(scene: &Scene, options: &Options) -> Hierarchy {
    build_unless(scene, options, &|| false).expect("nothing stops it")
}

/// Like [`build`]; none soon after `stopped` returns true, which must not change back.
pub fn build_unless(
    scene: &Scene,
    options: &Options,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Option<Hierarchy> {
    let large = large::surfaces(scene, options.large_surface);
    if stopped() {
        return None;
    }
    let mut is_large = vec![false; scene.triangles.len()];
    large.iter().for_each(|&t| is_large[t as usize] = true);
    let boxes: Vec<Aabb> = parallel::map(0..scene.triangles.len(), |t| Aabb::of(scene.corners(t as u32)));
    let small: Vec<u32> = (0..scene.triangles.len() as u32).filter(|&t| !is_large[t as usize]).collect();
    let micro = match options.builder {
        _ if small.is_empty() => Draft::default(),
        Builder::Grids => by_objects(scene, &boxes, small, stopped)?,
        Builder::KdTree => builders::halve_space(&small, &boxes, stopped)?,
        Builder::GoldsmithSalmon => builders::insert_all(&small, &boxes, stopped)?,
        Builder::Sah => builders::split_by_cost(&small, &boxes, stopped)?,
    };
    Some(Hierarchy {
        micro: Tree::arrange(micro).fit(&boxes),
        large: Tree::arrange(grids::cluster(Draft::default(), faces(&large, &boxes), stopped)?).fit(&boxes),
    })
}

fn faces(triangles: &[u32], boxes: &[Aabb]) -> Vec<Item> {
    triangles.iter().map(|&t| Item::new(Member::Face(t), boxes[t as usize])).collect()
}

/// Clusters the inside of each large object first, then objects, faces of small objects and single faces together.
fn by_objects(
    scene: &Scene,
    boxes: &[Aabb],
    mut triangles: Vec<u32>,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Option<Draft> {
    let spread = SPREAD_OBJECT_FRACTION * scene.bounds.extent().max_element();
    // Sort into runs of one object, and inside spread objects into runs of one connected part.
    parallel::sort_by_key(&mut triangles, |&t| (scene.triangle_object[t as usize].into(), t));
    let mut parts: Vec<Vec<u32>> = Vec::new();
    let is_spread = |part: &[u32]| {
        part.iter().fold(Aabb::EMPTY, |b, &t| b.union(boxes[t as usize])).extent().max_element() > spread
    };
    let mut loose: Vec<u32> = Vec::new();
    for object in
        triangles.chunk_by(|&a, &b| scene.triangle_object[a as usize] == scene.triangle_object[b as usize])
    {
        if !is_spread(object) {
            parts.push(object.to_vec());
            continue;
        }
        let mut object = object.to_vec();
        parallel::sort_by_key(&mut object, |&t| (scene.triangle_component[t as usize].into(), t));
        for part in object
            .chunk_by(|&a, &b| scene.triangle_component[a as usize] == scene.triangle_component[b as usize])
        {
            if is_spread(part) || part.len() <= LARGE_OBJECT_TRIANGLES {
                loose.extend_from_slice(part);
            } else {
                parts.push(part.to_vec());
            }
        }
    }
    let (own, rest): (Vec<_>, Vec<_>) =
        parts.into_iter().partition(|part| part.len() > LARGE_OBJECT_TRIANGLES);
    loose.extend(rest.into_iter().flatten());
    let of_part = |part: &Vec<u32>| grids::cluster(Draft::default(), faces(part, boxes), stopped);
    let inner: Vec<Draft> = parallel::some_map(&own, of_part)?;
    let mut draft = Draft::default();
    let mut items: Vec<Item> = inner.into_iter().map(|inner| draft.adopt(inner)).collect();
    items.extend(faces(&loose, boxes));
    grids::cluster(draft, items, stopped)
}

// Validation of cluster hierarchies: topology, boxes, and the partition of the triangles.

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
