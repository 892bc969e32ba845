//! What users of the crate make and ask of a scene.

use super::{Scene, generate};
use crate::Result;
use crate::threads::Threads;

impl Scene {
    /// Generates a scene by name, with the defaults of its kind: `cube-groups`, `forest`, `cubes`, `brick-wall`, `louvres`,
    /// `bookshelf`, `desk-room`, `urban-block` or `cornell`. Metres, but `cornell` is in millimetres. Every scene has an emitter.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) if no kind has this name; the message lists the kinds.
    pub fn generate(name: &str) -> Result<Scene> {
        Threads::new(0)?.run(|| generate::build(&generate::Spec::new(name)))?
    }

    /// Name of the length unit, as given when the scene was loaded: `m`, `cm`, `mm`, `km`, `in`, `ft` or another.
    pub fn unit(&self) -> &str {
        &self.unit
    }

    /// Point that coordinates are stored relative to, in the coordinates of the file. Batches whose positions are relative to it
    /// are not rounded again, see [`Segments::relative_to`](crate::Segments::relative_to).
    pub fn origin(&self) -> [f64; 3] {
        self.origin.to_array()
    }

    /// Smallest and largest corner of the box around all faces and placements, in the coordinates of the file, scene units.
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        let bounds = self.world_bounds();
        [bounds.min, bounds.max].map(|corner| (self.origin + corner.as_dvec3()).to_array())
    }

    /// Number of triangles stored; those of a mesh that several placements share count once.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len() + self.shared.iter().map(|mesh| mesh.triangles.len()).sum::<usize>()
    }

    /// Number of triangles seen; those of a shared mesh count once for each visible placement.
    pub fn visible_triangle_count(&self) -> u64 {
        self.visible_triangles()
    }

    /// Names of the objects (OBJ objects and groups, glTF nodes), in the order of the file. Not unique in every file.
    pub fn object_names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.objects.iter().map(|object| object.name.as_str())
    }

    /// Names of the materials, in the order of the file.
    pub fn material_names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.materials.iter().map(|material| material.name.as_str())
    }

    /// Names of the emitters, the connected emissive surfaces; the position is the index of the source.
    pub fn emitter_names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.emitters.iter().map(|emitter| emitter.name.as_str())
    }

    /// Repairs and assumptions made while reading, one sentence each; empty for a clean file.
    pub fn repairs(&self) -> &[String] {
        &self.repairs.messages
    }
}
