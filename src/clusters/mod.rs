//! Clusters: a strict partition of the scene's triangles into a tree, built as a hierarchy of uniform grids
//! [SD95 sec 4.1] or by one of three other [`Builder`]s; docs/method.md, Clusters.
//!
//! Large planar surfaces (walls, floors, table tops) form a second tree, so that no extinction is ever computed from
//! them. This room stores geometry and topology only: no rays, no radiosity.

mod builders;
mod check;
mod draft;
mod grids;
mod large;
pub mod placed;
mod sketch;
#[cfg(test)]
mod tests;
mod tree;

#[cfg(any(test, feature = "reports"))]
pub(crate) use large::MIN_COPLANAR_COSINE;
pub use tree::{Cluster, Tree};

use crate::math::Aabb;
use crate::scene::Scene;
use draft::{Draft, Item, Member};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

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
    #[cfg(any(test, feature = "internals"))]
    pub(crate) const ALL: [Builder; 4] =
        [Builder::Grids, Builder::KdTree, Builder::GoldsmithSalmon, Builder::Sah];

    /// Name on the command line and in JSON.
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn name(self) -> &'static str {
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
        pub builder: Builder = Builder::default(),
        /// Planar surfaces whose inscribed disc has a diameter of at least this fraction of the scene's diagonal are kept
        /// outside the clusters; above 0, infinite for none.
        pub large_surface: f32 = 1.0 / 32.0,
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
#[cfg(any(test, feature = "internals"))]
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
    let boxes: Vec<Aabb> =
        (0..scene.triangles.len()).into_par_iter().map(|t| Aabb::of(scene.corners(t as u32))).collect();
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
    triangles.par_sort_by_key(|&t| (scene.triangle_object[t as usize], t));
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
        object.par_sort_by_key(|&t| (scene.triangle_component[t as usize], t));
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
    let inner: Vec<Draft> = own.par_iter().map(of_part).collect::<Option<_>>()?;
    let mut draft = Draft::default();
    let mut items: Vec<Item> = inner.into_iter().map(|inner| draft.adopt(inner)).collect();
    items.extend(faces(&loose, boxes));
    grids::cluster(draft, items, stopped)
}
