//! A placement of a shared mesh.

use crate::math::Aabb;
use glam::DAffine3;

/// Largest number of placements of a scene and of nodes of a glTF file: limits memory while reading to 600 MB, at some
/// 300 bytes each.
pub const MAX_PLACEMENTS: usize = 1 << 21;

/// One placement of a shared mesh.
#[derive(Clone, Debug)]
pub struct Placement {
    /// Index into [`super::Scene::shared`].
    pub mesh: u32,
    /// From the mesh's coordinates (relative to its own `origin` field) to the scene's coordinates (relative to
    /// [`super::Scene::origin`]), scene units.
    pub transform: DAffine3,
    /// Name of the node in the file, or a made-up one.
    pub name: String,
    /// Material that replaces those of the mesh: index into [`Scene::materials`]; `None` keeps them.
    pub material: Option<u32>,
    /// Whether the placement blocks and receives light.
    pub visible: bool,
}

impl Placement {
    /// Box around the image of `mesh_bounds` (relative to the mesh's origin), relative to [`super::Scene::origin`], scene
    /// units; see [`Aabb::transformed`] for how tight it is.
    pub fn bounds(&self, mesh_bounds: Aabb) -> Aabb {
        mesh_bounds.transformed(&self.transform)
    }
}
