//! Clusters: a strict partition of the scene's triangles into a tree, built by the paper's hierarchy of uniform
//! grids [SD95 sec 4.1]; method A.8.
//!
//! Large single surfaces (walls, floors, table tops) form a tree of their own, so that no extinction is ever
//! computed from them (method D.7, D.8). This room stores geometry and topology only: it does not know that rays
//! or radiosity exist.

mod check;
mod draft;
mod grids;
mod large;
#[cfg(test)]
mod tests;
mod tree;

pub use tree::{Cluster, Tree};

use crate::math::Aabb;
use crate::scene::Scene;
use draft::{Draft, Item, Member};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Most children of a cluster, and most triangles of a leaf: the width of a SIMD register.
pub const FAN_OUT: usize = 16;

/// Objects with more triangles than this get clusters of their own; smaller ones are clustered with the rest.
const LARGE_OBJECT: usize = FAN_OUT;

/// An object whose longest extent exceeds this part of the scene's is no local thing (all leaves of a forest
/// in one group, say): its connected parts are clustered one by one, and parts as large as that by their faces.
const SPREAD_OBJECT: f32 = 0.25;

/// How the clusters are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Builder {
    /// Hierarchy of uniform grids [SD95 sec 4.1].
    #[default]
    UniformGrids,
}

/// Options of [`build`].
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Which builder.
    pub builder: Builder,
    /// Planar surfaces whose inscribed disc is at least this part of the scene's diagonal are macro occluders.
    pub large_surface: f32,
}

impl Default for Options {
    fn default() -> Self {
        Options { builder: Builder::default(), large_surface: 1.0 / 32.0 }
    }
}

/// The clusters of a scene. Every triangle is in exactly one leaf of exactly one of the two trees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hierarchy {
    /// Everything that may be aggregated.
    pub micro: Tree,
    /// Large planar surfaces: always tested exactly.
    pub large: Tree,
}

/// Builds the clusters of a scene: deterministic, parallel, O(n log n).
pub fn build(scene: &Scene, options: &Options) -> Hierarchy {
    let large = large::surfaces(scene, options.large_surface);
    let mut is_large = vec![false; scene.triangles.len()];
    large.iter().for_each(|&t| is_large[t as usize] = true);
    let boxes: Vec<Aabb> =
        (0..scene.triangles.len()).into_par_iter().map(|t| Aabb::of(scene.corners(t as u32))).collect();
    let small: Vec<u32> = (0..scene.triangles.len() as u32).filter(|&t| !is_large[t as usize]).collect();
    let Builder::UniformGrids = options.builder;
    Hierarchy {
        micro: Tree::arrange(by_objects(scene, &boxes, small)).fit(&boxes),
        large: Tree::arrange(grids::cluster(Draft::default(), faces(&large, &boxes))).fit(&boxes),
    }
}

fn faces(triangles: &[u32], boxes: &[Aabb]) -> Vec<Item> {
    triangles.iter().map(|&t| Item::new(Member::Face(t), boxes[t as usize])).collect()
}

/// Clusters inside large objects first, then objects, small objects' faces and stray faces together.
fn by_objects(scene: &Scene, boxes: &[Aabb], mut triangles: Vec<u32>) -> Draft {
    let spread = SPREAD_OBJECT * scene.bounds.extent().max_element();
    // Runs of one object, and within spread objects runs of one connected part.
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
            if is_spread(part) || part.len() <= LARGE_OBJECT {
                loose.extend_from_slice(part);
            } else {
                parts.push(part.to_vec());
            }
        }
    }
    let (own, rest): (Vec<_>, Vec<_>) = parts.into_iter().partition(|part| part.len() > LARGE_OBJECT);
    loose.extend(rest.into_iter().flatten());
    let inner: Vec<Draft> =
        own.par_iter().map(|part| grids::cluster(Draft::default(), faces(part, boxes))).collect();
    let mut draft = Draft::default();
    let mut items: Vec<Item> = inner.into_iter().map(|inner| draft.adopt(inner)).collect();
    items.extend(faces(&loose, boxes));
    grids::cluster(draft, items)
}
