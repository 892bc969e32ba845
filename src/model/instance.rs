//! Instances: placed meshes, and changes of them.

use crate::math::Aabb;
use crate::scene::{MAX_COORDINATE, MIN_EXTENT, Material, Scene};
use crate::{Error, Result};
use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};
use std::sync::Arc;

/// A placed mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Index of the mesh: 0 holds the scene's own triangles, meshes that nodes of the file share follow in its order.
    pub mesh: u32,
    /// From the frame of the mesh to that of the model, scene units relative to `Scene::origin`.
    pub transform: DAffine3,
    /// Material that replaces those of the mesh, an index into `Scene::materials`; `None` keeps them.
    pub material: Option<u32>,
    /// Name of the node in the file, or a made-up one.
    pub name: Arc<str>,
    /// Whether the instance blocks and receives light.
    pub visible: bool,
    /// Removed instances keep their place, so that the indices of others do not change.
    pub removed: bool,
}

/// Largest ratio of the longest to the shortest image of a unit vector. Sizes and extinctions of clusters scale with one
/// factor, so that they are off by no more than this: a fifth of the default tolerance of cluster optics, 5 %.
pub const MAX_STRETCH: f64 = 1.01;

impl Instance {
    /// The scene's own triangles, placed once and as they are.
    pub(super) fn own(name: String) -> Instance {
        let transform = DAffine3::IDENTITY;
        Instance { mesh: 0, transform, material: None, name: name.into(), visible: true, removed: false }
    }

    /// Whether rays see it.
    pub fn is_present(&self) -> bool {
        self.visible && !self.removed
    }

    /// The transform in single precision.
    pub(super) fn transform_f32(&self) -> Affine3A {
        self.transform.as_affine3a()
    }

    /// The box around the eight transformed corners of the box of its mesh.
    pub(crate) fn bounds(&self, mesh: &Scene) -> Aabb {
        let Aabb { min, max } = mesh.bounds;
        Aabb::of((0..8).map(|i| {
            let pick = |k: usize| f64::from(if i >> k & 1 == 0 { min[k] } else { max[k] });
            self.transform.transform_point3(DVec3::new(pick(0), pick(1), pick(2))).as_vec3()
        }))
    }

    /// The unit normal of a face whose normal in the frame of the mesh is `normal`.
    pub(crate) fn turned(&self, normal: Vec3) -> Vec3 {
        // The scene's own triangles are not turned: their normals keep all bits.
        if self.mesh == 0 { normal } else { turned(self.transform.matrix3, normal) }
    }

    /// # Errors
    /// [`Error::Argument`] if the transform is not finite, falsifies measured clusters of the mesh, or places it beyond the range of
    /// coordinates; if the material is none of `materials` or emits.
    pub(super) fn check(&self, index: usize, mesh: &Scene, materials: &[Material]) -> Result<()> {
        if let Some(m) = self.material
            && materials.get(m as usize).is_none_or(|material| material.emission != [0.0; 3])
        {
            return Err(Error::Argument(format!(
                "instance {index}: material {m} must be one of the scene's {} materials and must not emit: emitters are \
                 triangles of the scene's own",
                materials.len()
            )));
        }
        if !self.transform.is_finite() {
            return Err(Error::Argument(format!(
                "instance {index}: its transform holds a value that is not finite"
            )));
        }
        let stretch = stretch(self.transform.matrix3);
        if stretch > MAX_STRETCH {
            return Err(Error::Argument(format!(
                "instance {index}: its transform has shear or unequal scale (ratio {stretch:.3}, at most {MAX_STRETCH}): its \
                 clusters would be wrong; place a mesh of its own, with the transform applied to its vertices"
            )));
        }
        let bounds = self.bounds(mesh);
        let farthest = f64::from(bounds.min.abs().max(bounds.max.abs()).max_element());
        let least = MIN_EXTENT.max(f64::from(f32::EPSILON) * farthest);
        if farthest.is_nan() || farthest > MAX_COORDINATE || f64::from(bounds.extent().max_element()) < least
        {
            return Err(Error::Argument(format!(
                "instance {index}: its transform places the mesh beyond {MAX_COORDINATE:e} or shrinks it below {least:.1e}"
            )));
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

/// Ratio of the largest to the smallest singular value of a matrix; infinite for singular ones.
fn stretch(matrix: DMat3) -> f64 {
    // Eigenvalues of MᵀM (symmetric), in closed form (Smith 1961).
    let m = matrix.transpose() * matrix;
    let q = (m.x_axis.x + m.y_axis.y + m.z_axis.z) / 3.0;
    let off = m.y_axis.x.powi(2) + m.z_axis.x.powi(2) + m.z_axis.y.powi(2);
    let spread = (m.x_axis.x - q).powi(2) + (m.y_axis.y - q).powi(2) + (m.z_axis.z - q).powi(2) + 2.0 * off;
    let p = (spread / 6.0).sqrt();
    if p <= 1e-15 * q.abs() {
        return if q > 0.0 { 1.0 } else { f64::INFINITY };
    }
    let b = (m - DMat3::from_diagonal(DVec3::splat(q))) * (1.0 / p);
    let phi = (0.5 * b.determinant()).clamp(-1.0, 1.0).acos() / 3.0;
    let largest = q + 2.0 * p * phi.cos();
    let smallest = q + 2.0 * p * (phi + 2.0 * std::f64::consts::FRAC_PI_3).cos();
    if smallest > 0.0 { (largest / smallest).sqrt() } else { f64::INFINITY }
}

/// A change of one instance; see [`super::Model::update`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum InstanceChange {
    /// Places an instance elsewhere.
    Move {
        /// Index into [`super::Model::instances`].
        instance: u32,
        /// From the frame of the mesh to that of the model: rotation, reflection, uniform scale.
        transform: DAffine3,
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn stretch_is_the_ratio_of_singular_values() {
        let turn = DMat3::from_quat(DQuat::from_rotation_y(0.7) * DQuat::from_rotation_x(0.3));
        for (scale, want) in
            [(DVec3::ONE, 1.0), (DVec3::new(2.0, 2.0, -2.0), 1.0), (DVec3::new(1.0, 2.0, 3.0), 3.0)]
        {
            let found = stretch(turn * DMat3::from_diagonal(scale) * turn.transpose());
            assert!((found - want).abs() < 1e-6, "{scale}: {found} instead of {want}");
        }
        assert_eq!(stretch(DMat3::ZERO), f64::INFINITY);
        assert!(stretch(DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0))) > 1e6);
    }
}
