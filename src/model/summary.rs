//! The facts of a scene that every output states.

use crate::clusters::Hierarchy;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};

/// Facts of the scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneSummary {
    /// The file, as given.
    pub path: String,
    /// Triangles kept.
    pub triangles: usize,
    /// Named objects.
    pub objects: usize,
    /// Emissive surfaces.
    pub emitters: usize,
    /// Connected parts that bound a solid: seen from outside only.
    pub closed_parts: usize,
    /// Connected parts that are sheets: seen from both sides.
    pub sheet_parts: usize,
    /// Clusters of the hierarchy.
    pub clusters: usize,
    /// Levels of the hierarchy.
    pub levels: usize,
}

impl SceneSummary {
    /// Those of a scene and its clusters.
    pub fn of(scene: &Scene, hierarchy: &Hierarchy) -> SceneSummary {
        SceneSummary {
            path: scene.path.display().to_string(),
            triangles: scene.triangles.len(),
            objects: scene.objects.len(),
            emitters: scene.emitters.len(),
            closed_parts: scene.closed_parts,
            sheet_parts: scene.sheet_parts,
            clusters: hierarchy.micro.clusters.len() + hierarchy.large.clusters.len(),
            levels: hierarchy.micro.levels().max(hierarchy.large.levels()),
        }
    }
}
