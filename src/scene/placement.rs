//! A placement of a shared mesh.

use crate::math::Aabb;
use glam::{DAffine3, DVec3};

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
    /// units. The box encloses the eight transformed corners; for a rotated mesh it is larger than the box of the
    /// transformed vertices.
    pub fn bounds(&self, mesh_bounds: Aabb) -> Aabb {
        let (min, max) = (mesh_bounds.min.as_dvec3(), mesh_bounds.max.as_dvec3());
        let corner = |i: u32| {
            let pick = |bit: u32, axis: usize| if i >> bit & 1 == 0 { min[axis] } else { max[axis] };
            self.transform.transform_point3(DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2))).as_vec3()
        };
        Aabb::of((0..8).map(corner))
    }
}
