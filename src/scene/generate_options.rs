//! Public functions of scenes: generation, and queries of properties.

use super::{Scene, generate};
use crate::Result;
use crate::error::{own_word, worded};
use crate::threads::Threads;
use generate::Spec;

options! {
    /// Parameters of [`Scene::generate_with`]; those that a kind has no use for are ignored.
    #[derive(Clone, Copy, Debug)]
    #[non_exhaustive]
    pub struct GenerateOptions {
        /// Seed of all random numbers; default 1.
        pub seed: u64 = 1;
        /// Number of cubes, slats, courses of bricks, boards or facets, 1 to 100 million; default: that of the kind.
        pub count: Option<usize> = None;
        /// Trees of the forest, 1 to 100 million; default 100.
        pub trees: Option<usize> = None;
        /// Leaves of each tree, 1 to 100 million, at most 100 million in all; default 1,000.
        pub leaves: Option<usize> = None;
        /// Whether the trees have trunks; default false.
        pub trunks: bool = false;
        /// Edge of the emitter, in the kind's unit, above 0, at most 1e6; default: that of the kind.
        pub light_size: Option<f64> = None;
    }
}

impl Scene {
    /// Generates a scene by name, with the defaults of its kind: `cube-groups`, `forest`, `cubes`, `brick-wall`, `louvres`,
    /// `bookshelf`, `desk-room`, `office`, `urban-block` or `cornell`. Metres, but `cornell` is in millimetres. Every scene has an emitter.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) if no kind has this name; the message lists the kinds.
    pub fn generate(name: &str) -> Result<Scene> {
        Threads::new(0)?.run(|| generate::build(&generate::Spec::new(name)))?
    }

    /// Generates a scene by name with other parameters than those of its kind.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) if no kind has this name or a number is out of its range.
    pub fn generate_with(name: &str, options: &GenerateOptions) -> Result<Scene> {
        let GenerateOptions { seed, count, trees, leaves, trunks, light_size } = *options;
        let spec = Spec::new(name);
        let spec = Spec {
            seed,
            count,
            trees: trees.unwrap_or(spec.trees),
            leaves: leaves.unwrap_or(spec.leaves),
            trunks,
            light_size,
            ..spec
        };
        Threads::new(0)?.run(|| generate::build(&spec))?
    }

    /// Name of the length unit, as given when the scene was loaded: `m`, `dm`, `cm`, `mm`, `km`, `in`, `ft` or another.
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
    pub fn repairs(&self) -> Vec<String> {
        self.repairs.messages.iter().map(|message| worded(message, own_word)).collect()
    }
}
