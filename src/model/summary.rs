//! Summary of a scene in the records of commands.

use super::Model;
use serde::Serialize;

/// Summary of a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SceneSummary {
    /// Path of the file as given.
    pub path: String,
    /// Stored triangles after repairs; those of a mesh count once.
    pub triangles: usize,
    /// Named objects.
    pub objects: usize,
    /// Emitters.
    pub emitters: usize,
    /// Connected parts that bound a solid; visible from outside only. Those of a mesh count once.
    pub closed_parts: usize,
    /// Connected parts that are sheets; visible from both sides. Those of a mesh count once.
    pub sheet_parts: usize,
    /// Clusters of all hierarchies.
    pub clusters: usize,
    /// Levels of the deepest hierarchy.
    pub levels: usize,
    /// The upward axis, `y` or `z`.
    pub up: String,
    /// Source of the upward axis: `given`, `that of glTF`, or `guessed from` something.
    pub up_from: String,
    /// Sky and sun: axes and north, the sky, the sun; one line each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sky: Vec<String>,
    /// Number of visible instances of shared meshes; absent in scenes without instances.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instances: Option<usize>,
    /// Number of visible triangles, counted once per instance; absent in scenes without instances.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub visible_triangles: Option<u64>,
}

impl SceneSummary {
    /// Summary of a model with clusters.
    ///
    /// # Panics
    /// The model was prepared without clusters.
    pub fn of(model: &Model) -> SceneSummary {
        let scene = model.scene();
        let hierarchies = || model.meshes().iter().map(|mesh| mesh.hierarchy());
        let (up, up_from) = scene.up_from();
        let placed = model.instances().len() > 1;
        SceneSummary {
            path: scene.path.display().to_string(),
            triangles: model.meshes().iter().map(|mesh| mesh.scene().triangles.len()).sum(),
            objects: scene.objects.len(),
            emitters: scene.emitters.len(),
            closed_parts: model.meshes().iter().map(|mesh| mesh.scene().closed_parts).sum(),
            sheet_parts: model.meshes().iter().map(|mesh| mesh.scene().sheet_parts).sum(),
            clusters: hierarchies().map(|h| h.micro.clusters.len() + h.large.clusters.len()).sum(),
            levels: hierarchies().map(|h| h.micro.levels().max(h.large.levels())).max().unwrap_or(0),
            up: up.name().into(),
            up_from: up_from.words().into(),
            sky: model.scene().sky().map(|sky| sky.notes.clone()).unwrap_or_default(),
            instances: placed.then(|| model.instances().iter().skip(1).filter(|i| i.is_present()).count()),
            visible_triangles: placed.then(|| model.visible_triangles()),
        }
    }
}
