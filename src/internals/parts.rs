//! Fields of types of the public interface, hidden from its documentation as `internals` is.

use crate::clusters;
use crate::math::Aabb;
use crate::model::PrepareOptions;
use crate::model::cache::CacheLocation;
use crate::optics;
use crate::scene::{
    AddedFiles, Emitter, LoadOptions, Material, Move, Object, Placement, Placements, Repairs, Scene,
    StoredCamera,
};
use crate::sky::Environment;
use crate::terrain::ReadOptions;
use glam::{DVec3, Vec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Defines the fields of a scene, as [`Scene::parts`] gives them.
macro_rules! scene_parts {
    (borrowed { $($field:ident: $of:ty,)+ } copied { $($copied:ident: $kind:ty,)+ }) => {
        /// The fields of a scene.
        #[allow(missing_docs)]
        pub struct Parts<'a> {
            $(pub $field: &'a $of,)+
            $(pub $copied: $kind,)+
            pub sky: Option<&'a Environment>,
        }

        impl Scene {
            /// Its fields.
            #[doc(hidden)]
            pub fn parts(&self) -> Parts<'_> {
                Parts { $($field: &self.$field,)+ $($copied: self.$copied,)+ sky: self.sky() }
            }
        }
    };
}

scene_parts! {
    borrowed {
        path: Path,
        unit: str,
        positions: [Vec3],
        triangles: [[u32; 3]],
        triangle_object: [u32],
        triangle_material: [u32],
        triangle_polygon: [u32],
        triangle_reflectance: [[f32; 3]],
        triangle_sides: [u8],
        objects: [Object],
        materials: [Material],
        emitters: [Emitter],
        triangle_emitter: [u32],
        cameras: [StoredCamera],
        repairs: Repairs,
        files: [PathBuf],
        unread_files: [PathBuf],
        shared: [Arc<Scene>],
        placements: [Placement],
    } copied {
        two_sided_emission: bool,
        origin: DVec3,
        closed_parts: usize,
        sheet_parts: usize,
        bounds: Aabb,
    }
}

#[doc(hidden)]
impl PrepareOptions {
    /// With these options of clusters.
    pub fn with_clusters(self, clusters: clusters::Options) -> PrepareOptions {
        PrepareOptions { builder: clusters.builder, clusters, ..self }
    }

    /// Options of clusters and of their optics, and where measured clusters are kept.
    pub fn parts(&self) -> (clusters::Options, optics::Options, CacheLocation) {
        (self.clusters(), self.optics, self.cache())
    }
}

#[doc(hidden)]
impl LoadOptions {
    /// With these luminaires.
    pub fn with_placements(self, luminaires: Placements) -> LoadOptions {
        LoadOptions { luminaires, ..self }
    }

    /// With these movements of objects.
    pub fn with_moves(self, moves: Vec<Move>) -> LoadOptions {
        LoadOptions { moves, ..self }
    }

    /// With these options of height fields.
    pub fn with_grid(self, grid: ReadOptions) -> LoadOptions {
        LoadOptions { grid, ..self }
    }

    /// With these files, on a ground with this radius of curvature.
    pub fn with_added(self, added: AddedFiles, curvature: Option<f64>) -> LoadOptions {
        LoadOptions { added, curvature, ..self }
    }
}
