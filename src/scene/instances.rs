//! Shared meshes and their placements.

use glam::DAffine3;

/// One placement of a shared mesh.
#[derive(Clone, Debug)]
pub struct Placement {
    /// Index into [`super::Scene::shared`].
    pub mesh: u32,
    /// From the mesh's coordinates (relative to its own `origin` field) to the scene's coordinates (relative to
    /// `Scene::origin`), scene units.
    pub transform: DAffine3,
    /// Name of the node in the file, or a made-up one.
    pub name: String,
    /// Material that replaces those of the mesh: index into `Scene::materials`; `None` keeps them.
    pub material: Option<u32>,
    /// Whether it blocks and receives light.
    pub visible: bool,
}
