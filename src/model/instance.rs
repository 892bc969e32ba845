//! Instances: placed meshes, and changes of them.

use super::mesh::Mesh;
use crate::math::{Aabb, affine, rows};
use crate::scene::{MAX_COORDINATE, MAX_STRETCH, MIN_EXTENT, Material, Scene, magnitude, stretch};
use crate::{Error, Result};
use glam::{Affine3A, DAffine3, DMat3, Vec3};
use std::sync::Arc;

/// A placed mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Index of the mesh: 0 holds the scene's own triangles, meshes that nodes of the file share follow in its order.
    pub mesh: u32,
    /// From the frame of the mesh to that of the model, scene units relative to [`Scene::origin`](crate::Scene::origin): rows of a 3 by 4
    /// matrix, of which the last column is the translation.
    pub transform: [[f64; 4]; 3],
    /// Material that replaces those of the mesh, an index into [`Scene::material_names`](crate::Scene::material_names); `None` keeps them.
    pub material: Option<u32>,
    /// Name of the node in the file, or a made-up one.
    pub name: Arc<str>,
    /// Whether the instance blocks and receives light.
    pub visible: bool,
    /// Removed instances keep their place, so that the indices of others do not change.
    pub removed: bool,
}

impl Instance {
    /// The scene's own triangles, placed once and as they are.
    pub(super) fn own(name: String) -> Instance {
        let transform = rows(&DAffine3::IDENTITY);
        Instance { mesh: 0, transform, material: None, name: name.into(), visible: true, removed: false }
    }

    /// Whether rays see it.
    pub(crate) fn is_present(&self) -> bool {
        self.visible && !self.removed
    }

    /// The transform.
    pub(crate) fn affine(&self) -> DAffine3 {
        affine(&self.transform)
    }

    /// The transform in single precision.
    pub(super) fn transform_f32(&self) -> Affine3A {
        self.affine().as_affine3a()
    }

    /// The box around the eight transformed corners of the box of its mesh.
    pub(crate) fn bounds(&self, mesh: &Scene) -> Aabb {
        mesh.bounds.transformed(&self.affine())
    }

    /// The unit normal of a face whose normal in the frame of the mesh is `normal`.
    pub(crate) fn turned(&self, normal: Vec3) -> Vec3 {
        // The scene's own triangles are not turned: their normals keep all bits.
        if self.mesh == 0 { normal } else { turned(self.affine().matrix3, normal) }
    }

    /// Largest coordinate magnitude of a face of its mesh and of that face's neighbours, scene units: in the frame of the model, and in
    /// that of the mesh, in which Embree meets them.
    pub(crate) fn magnitude_of(&self, mesh: &Mesh, triangle: u32) -> f32 {
        let own = mesh.magnitudes()[triangle as usize];
        if self.mesh == 0 {
            return own;
        }
        let placed =
            mesh.scene.corners(triangle).map(|p| self.affine().transform_point3(p.as_dvec3()).as_vec3());
        magnitude(placed).max(self.scale() * own)
    }

    /// Ratio of a length that the instance places to that in its mesh.
    pub(crate) fn scale(&self) -> f32 {
        self.affine().matrix3.determinant().abs().cbrt() as f32
    }

    /// # Errors
    /// [`Error::Argument`] if the transform is not finite, falsifies measured clusters of the mesh, or places it beyond the range of
    /// coordinates; if the material is none of `materials` or emits.
    pub(super) fn check(&self, index: usize, mesh: &Scene, materials: &[Material]) -> Result<()> {
        let wrong = |problem: String| Err(Error::argument("instance", index, problem));
        if let Some(m) = self.material
            && materials.get(m as usize).is_none_or(|material| material.emission != [0.0; 3])
        {
            return wrong(format!(
                "material {m} must be one of the scene's {} materials and must not emit: emitters are triangles of the scene's own",
                materials.len()
            ));
        }
        if !self.affine().is_finite() {
            return wrong("its transform holds a value that is not finite".into());
        }
        let stretch = stretch(self.affine().matrix3);
        if stretch > MAX_STRETCH {
            return wrong(format!(
                "its transform has shear or unequal scale (ratio {stretch:.3}, at most {MAX_STRETCH}): its clusters would be wrong; \
                 place a mesh of its own, with the transform applied to its vertices"
            ));
        }
        let bounds = self.bounds(mesh);
        let farthest = f64::from(bounds.magnitude());
        let min_extent = MIN_EXTENT.max(f64::from(f32::EPSILON) * farthest);
        if farthest.is_nan()
            || farthest > MAX_COORDINATE
            || f64::from(bounds.extent().max_element()) < min_extent
        {
            return wrong(format!(
                "its transform places the mesh beyond {MAX_COORDINATE:e} or shrinks it below {min_extent:.1e}"
            ));
        }
        Ok(())
    }
}

/// Whether rays see the first instance only, the scene's own triangles.
pub(super) fn is_single(instances: &[Instance]) -> bool {
    !instances.iter().skip(1).any(Instance::is_present)
}

/// The unit normal of a face that the matrix maps, by the inverse transpose; a reflection keeps the front the front.
fn turned(matrix: DMat3, normal: Vec3) -> Vec3 {
    (matrix.inverse().transpose() * normal.as_dvec3()).normalize_or_zero().as_vec3()
}

/// A change of one instance; see [`super::Model::update`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum InstanceChange {
    /// Places an instance elsewhere.
    Move {
        /// Index into [`super::Model::instances`].
        instance: u32,
        /// From the frame of the mesh to that of the model: rotation, reflection, uniform scale, translation. As in
        /// [`Instance::transform`].
        transform: [[f64; 4]; 3],
    },
    /// Adds an instance after all others.
    Add(Instance),
    /// Removes an instance; the indices of others do not change.
    Remove {
        /// Index into [`super::Model::instances`].
        instance: u32,
    },
    /// Shows or hides an instance.
    Show {
        /// Index into [`super::Model::instances`].
        instance: u32,
        /// Whether it blocks and receives light from now on.
        visible: bool,
    },
}
