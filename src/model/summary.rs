//! The facts of a scene that every output states.

use super::Model;
use serde::{Deserialize, Serialize};

/// Facts of the scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneSummary {
    /// The file, as given.
    pub path: String,
    /// Triangles stored, those of a mesh once.
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
    /// Placed meshes that are visible; only for scenes that place meshes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instances: Option<usize>,
    /// Triangles that rays see, each as often as it is placed; only for scenes that place meshes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub visible_triangles: Option<u64>,
}

impl SceneSummary {
    /// The summary of a model with clusters.
    ///
    /// # Panics
    /// If the model was prepared for rays alone.
    pub fn of(model: &Model) -> SceneSummary {
        let scene = model.scene();
        let hierarchies = || model.meshes().iter().map(|mesh| mesh.hierarchy());
        let placed = model.instances().len() > 1;
        SceneSummary {
            path: scene.path.display().to_string(),
            triangles: model.meshes().iter().map(|mesh| mesh.scene().triangles.len()).sum(),
            objects: scene.objects.len(),
            emitters: scene.emitters.len(),
            closed_parts: scene.closed_parts,
            sheet_parts: scene.sheet_parts,
            clusters: hierarchies().map(|h| h.micro.clusters.len() + h.large.clusters.len()).sum(),
            levels: hierarchies().map(|h| h.micro.levels().max(h.large.levels())).max().unwrap_or(0),
            instances: placed.then(|| model.instances().iter().skip(1).filter(|i| i.is_present()).count()),
            visible_triangles: placed.then(|| model.visible_triangles()),
        }
    }
}
