//! What types of the public interface hold besides it: traits, so that the types themselves have no more names.

use crate::api::Reference;
use crate::api::{Solution, SurfacePoint};
use crate::clusters::{self, Builder};
use crate::math::Aabb;
use crate::model::cache::CacheLocation;
use crate::model::{Mesh, Model, PrepareOptions};
use crate::progress::Progress;
use crate::ranks::Ranks;
use crate::ray::EndRule;
use crate::scene::{
    AddedFiles, Emitter, LoadOptions, Material, MeasuringGrid, Move, Object, Placement, Placements, Repairs,
    Scene, StoredCamera, UpAxis, UpFrom,
};
use crate::sky::Environment;
use crate::terrain::ReadOptions;
use crate::visibility::{Exact, LeafMode, MultiResolution};
use crate::{Result, embree::Traversal, optics};
use glam::{DVec3, Vec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Defines the fields of a scene, as `SceneParts::parts` gives them.
macro_rules! scene_parts {
    (borrowed { $($field:ident: $of:ty,)+ } copied { $($copied:ident: $kind:ty,)+ }) => {
        /// The fields of a scene.
        #[allow(missing_docs)]
        pub struct Parts<'a> {
            $(pub $field: &'a $of,)+
            $(pub $copied: $kind,)+
            pub sky: Option<&'a Environment>,
        }

        impl Parts<'_> {
            fn of(scene: &Scene) -> Parts<'_> {
                Parts { $($field: &scene.$field,)+ $($copied: scene.$copied,)+ sky: scene.sky() }
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

/// Defines a trait with methods that the type itself has: by reference, by value, and others with their bodies.
macro_rules! methods {
    ($name:ident for $type:ident:
        $(fn $method:ident(&$this:ident $(, $argument:ident: $kind:ty)*) -> $result:ty;)*
        $(by value $(fn $by_value:ident($own:ident $(, $given:ident: $given_kind:ty)*) -> $made:ty;)+)?
        $(others $(fn $other:ident($($signature:tt)*) -> $other_result:ty $body:block)+)?
    ) => {
        #[allow(missing_docs)]
        pub trait $name: Sized {
            $(fn $method(&$this $(, $argument: $kind)*) -> $result;)*
            $($(fn $by_value($own $(, $given: $given_kind)*) -> $made;)+)?
            $($(fn $other($($signature)*) -> $other_result;)+)?
        }

        impl $name for $type {
            $(fn $method(&$this $(, $argument: $kind)*) -> $result {
                $type::$method($this $(, $argument)*)
            })*
            $($(fn $by_value($own $(, $given: $given_kind)*) -> $made {
                $type::$by_value($own $(, $given)*)
            })+)?
            $($(fn $other($($signature)*) -> $other_result $body)+)?
        }
    };
}

methods! { SceneParts for Scene:
    fn bytes(&self) -> usize;
    fn corners(&self, triangle: u32) -> [Vec3; 3];
    fn lowered(&self, position: DVec3, normal: DVec3) -> (DVec3, DVec3);
    fn measuring_grid(&self, name: &str, spacing: f64, height: f64) -> Result<MeasuringGrid>;
    fn power(&self, emitter: &Emitter) -> [f64; 3];
    fn size(&self) -> f32;
    fn up_axis(&self) -> UpAxis;
    fn up_from(&self) -> (UpAxis, UpFrom);
    fn visible_triangles(&self) -> u64;
    fn world_bounds(&self) -> Aabb;
    others
    fn parts(&self) -> Parts<'_> {
        Parts::of(self)
    }
}

methods! { ModelParts for Model:
    fn base(&self) -> &Mesh;
    fn bytes(&self) -> u64;
    fn cause_of_darkness(&self) -> String;
    fn end_rule(&self) -> EndRule;
    fn engine(&self, traversal: Traversal, leaf: LeafMode) -> Option<MultiResolution>;
    fn exact(&self) -> Exact;
    fn magnitude(&self) -> f32;
    fn note_of_coarse_coordinates(&self) -> Option<String>;
    fn notes_of_coarseness(&self) -> Vec<String>;
    fn notes_of_lost_light(&self) -> Vec<String>;
    fn prepared_again(&self, options: &PrepareOptions, progress: &dyn Progress) -> Result<Model>;
    fn reference_of(&self, count: usize, at: impl Fn(usize) -> SurfacePoint, samples: u32, direct_only: bool, seed: u64) -> Result<Reference>;
    fn shared_scene(&self) -> Arc<Scene>;
    fn widest_packets(&self) -> Traversal;
    by value
    fn on_ranks(self, ranks: Ranks) -> Model;
    others
    fn prepare_watched(scene: impl Into<Arc<Scene>>, options: &PrepareOptions, progress: &dyn Progress) -> Result<Model> {
        Model::prepare_watched(scene.into(), options, progress)
    }
}

methods! { SolutionParts for Solution:
    fn notes(&self) -> &[String];
    fn irradiance_of(&self, count: usize, at: impl Fn(usize) -> SurfacePoint) -> Result<Vec<[f64; 3]>>;
}

methods! { PrepareParts for PrepareOptions:
    others
    fn with_clusters(self, clusters: clusters::Options) -> PrepareOptions {
        PrepareOptions { builder: clusters.builder, clusters, ..self }
    }
    fn parts(&self) -> (clusters::Options, optics::Options, CacheLocation) {
        (self.clusters(), self.optics, self.cache())
    }
}

methods! { LoadParts for LoadOptions:
    others
    fn with_placements(self, luminaires: Placements) -> LoadOptions {
        LoadOptions { luminaires, ..self }
    }
    fn with_moves(self, moves: Vec<Move>) -> LoadOptions {
        LoadOptions { moves, ..self }
    }
    fn with_grid(self, grid: ReadOptions) -> LoadOptions {
        LoadOptions { grid, ..self }
    }
    fn with_added(self, added: AddedFiles, curvature: Option<f64>) -> LoadOptions {
        LoadOptions { added, curvature, ..self }
    }
}

/// Builders.
#[allow(missing_docs)]
pub trait BuilderParts {
    const ALL: [Builder; 4] = Builder::ALL;
    fn name(self) -> &'static str;
}

impl BuilderParts for Builder {
    fn name(self) -> &'static str {
        self.name()
    }
}

methods! { AxisParts for UpAxis:
    by value
    fn name(self) -> &'static str;
    fn vector(self) -> Vec3;
}
