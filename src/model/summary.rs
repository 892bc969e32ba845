//! Summary of a scene in the records of commands.

use crate::clusters::Hierarchy;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};

/// Summary of a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneSummary {
    /// Path of the file as given.
    pub path: String,
    /// Triangles after repairs.
    pub triangles: usize,
    /// Named objects.
    pub objects: usize,
    /// Emitters.
    pub emitters: usize,
    /// Connected parts that bound a solid; visible from outside only.
    pub closed_parts: usize,
    /// Connected parts that are sheets; visible from both sides.
    pub sheet_parts: usize,
    /// Clusters of the hierarchy.
    pub clusters: usize,
    /// Levels of the hierarchy.
    pub levels: usize,
}

impl SceneSummary {
    /// Summary of a scene and its clusters.
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
