//! What types of the public interface hold besides it: traits, so that the types themselves have no more names.

use crate::api::{Reference, Solution, SurfacePoint};
use crate::clusters::{self, Builder};
use crate::math::Aabb;
use crate::model::cache::CacheLocation;
use crate::model::{Mesh, Model, PrepareOptions};
use crate::optics;
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
use crate::{Result, embree::Traversal};
use glam::{DAffine3, DVec3, Vec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The fields of a scene.
#[allow(missing_docs)]
pub struct Parts<'a> {
    pub path: &'a Path,
    pub unit: &'a str,
    pub two_sided_emission: bool,
    pub origin: DVec3,
    pub positions: &'a [Vec3],
    pub triangles: &'a [[u32; 3]],
    pub triangle_object: &'a [u32],
    pub triangle_material: &'a [u32],
    pub triangle_polygon: &'a [u32],
    pub triangle_reflectance: &'a [[f32; 3]],
    pub triangle_sides: &'a [u8],
    pub triangle_component: &'a [u32],
    pub closed_parts: usize,
    pub sheet_parts: usize,
    pub objects: &'a [Object],
    pub materials: &'a [Material],
    pub emitters: &'a [Emitter],
    pub triangle_emitter: &'a [u32],
    pub triangle_texcoords: &'a [[[f32; 2]; 3]],
    pub cameras: &'a [StoredCamera],
    pub sky: Option<&'a Environment>,
    pub bounds: Aabb,
    pub repairs: &'a Repairs,
    pub files: &'a [PathBuf],
    pub unread_files: &'a [PathBuf],
    pub shared: &'a [Arc<Scene>],
    pub placements: &'a [Placement],
}

/// Scenes.
#[allow(missing_docs)]
pub trait SceneParts {
    fn parts(&self) -> Parts<'_>;
    fn bytes(&self) -> usize;
    fn corners(&self, triangle: u32) -> [Vec3; 3];
    fn lowered(&self, position: DVec3, normal: DVec3) -> (DVec3, DVec3);
    fn measuring_grid(&self, name: &str, spacing: f64, height: f64) -> Result<MeasuringGrid>;
    fn power(&self, emitter: &Emitter) -> [f64; 3];
    fn size(&self) -> f32;
    fn up_axis(&self) -> UpAxis;
    fn up_from(&self) -> (UpAxis, UpFrom);
    fn visible_triangles(&self) -> u64;
    fn with_objects(&self, kept: &[bool]) -> Scene;
    fn with_transform(&self, placement: usize, transform: DAffine3) -> Scene;
    fn world_bounds(&self) -> Aabb;
}

impl SceneParts for Scene {
    fn parts(&self) -> Parts<'_> {
        Parts {
            path: &self.path,
            unit: &self.unit,
            two_sided_emission: self.two_sided_emission,
            origin: self.origin,
            positions: &self.positions,
            triangles: &self.triangles,
            triangle_object: &self.triangle_object,
            triangle_material: &self.triangle_material,
            triangle_polygon: &self.triangle_polygon,
            triangle_reflectance: &self.triangle_reflectance,
            triangle_sides: &self.triangle_sides,
            triangle_component: &self.triangle_component,
            closed_parts: self.closed_parts,
            sheet_parts: self.sheet_parts,
            objects: &self.objects,
            materials: &self.materials,
            emitters: &self.emitters,
            triangle_emitter: &self.triangle_emitter,
            triangle_texcoords: &self.triangle_texcoords,
            cameras: &self.cameras,
            sky: self.sky(),
            bounds: self.bounds,
            repairs: &self.repairs,
            files: &self.files,
            unread_files: &self.unread_files,
            shared: &self.shared,
            placements: &self.placements,
        }
    }

    fn bytes(&self) -> usize {
        self.bytes()
    }

    fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.corners(triangle)
    }

    fn lowered(&self, position: DVec3, normal: DVec3) -> (DVec3, DVec3) {
        self.lowered(position, normal)
    }

    fn measuring_grid(&self, name: &str, spacing: f64, height: f64) -> Result<MeasuringGrid> {
        self.measuring_grid(name, spacing, height)
    }

    fn power(&self, emitter: &Emitter) -> [f64; 3] {
        self.power(emitter)
    }

    fn size(&self) -> f32 {
        self.size()
    }

    fn up_axis(&self) -> UpAxis {
        self.up_axis()
    }

    fn up_from(&self) -> (UpAxis, UpFrom) {
        self.up_from()
    }

    fn visible_triangles(&self) -> u64 {
        self.visible_triangles()
    }

    fn with_objects(&self, kept: &[bool]) -> Scene {
        self.with_objects(kept)
    }

    fn with_transform(&self, placement: usize, transform: DAffine3) -> Scene {
        let mut changed = self.clone();
        changed.placements[placement].transform = transform;
        changed
    }

    fn world_bounds(&self) -> Aabb {
        self.world_bounds()
    }
}

/// Models.
#[allow(missing_docs)]
pub trait ModelParts: Sized {
    fn base(&self) -> &Mesh;
    fn bytes(&self) -> u64;
    fn cause_of_darkness(&self) -> String;
    fn end_rule(&self) -> EndRule;
    fn engine(&self, traversal: Traversal, leaf: LeafMode) -> Option<MultiResolution>;
    fn exact(&self) -> Exact;
    fn magnitude(&self) -> f32;
    fn note_of_coarse_coordinates(&self) -> Option<String>;
    fn notes_of_emitters(&self) -> Vec<String>;
    fn on_ranks(self, ranks: Ranks) -> Self;
    fn prepare_watched(
        scene: impl Into<Arc<Scene>>,
        options: &PrepareOptions,
        progress: &dyn Progress,
    ) -> Result<Self>;
    fn prepared_again(&self, options: &PrepareOptions, progress: &dyn Progress) -> Result<Self>;
    fn reference_of(
        &self,
        count: usize,
        at: impl Fn(usize) -> SurfacePoint,
        how: (u32, bool, u64),
    ) -> Result<Reference>;
    fn shared_scene(&self) -> Arc<Scene>;
    fn widest_packets(&self) -> Traversal;
}

impl ModelParts for Model {
    fn base(&self) -> &Mesh {
        self.base()
    }

    fn bytes(&self) -> u64 {
        self.bytes()
    }

    fn cause_of_darkness(&self) -> String {
        self.cause_of_darkness()
    }

    fn end_rule(&self) -> EndRule {
        self.end_rule()
    }

    fn engine(&self, traversal: Traversal, leaf: LeafMode) -> Option<MultiResolution> {
        self.engine(traversal, leaf)
    }

    fn exact(&self) -> Exact {
        self.exact()
    }

    fn magnitude(&self) -> f32 {
        self.magnitude()
    }

    fn note_of_coarse_coordinates(&self) -> Option<String> {
        self.note_of_coarse_coordinates()
    }

    fn notes_of_emitters(&self) -> Vec<String> {
        self.notes_of_emitters()
    }

    fn on_ranks(self, ranks: Ranks) -> Model {
        self.on_ranks(ranks)
    }

    fn prepare_watched(
        scene: impl Into<Arc<Scene>>,
        options: &PrepareOptions,
        progress: &dyn Progress,
    ) -> Result<Model> {
        Model::prepare_watched(scene.into(), options, progress)
    }

    fn prepared_again(&self, options: &PrepareOptions, progress: &dyn Progress) -> Result<Model> {
        self.prepared_again(options, progress)
    }

    fn reference_of(
        &self,
        count: usize,
        at: impl Fn(usize) -> SurfacePoint,
        how: (u32, bool, u64),
    ) -> Result<Reference> {
        self.reference_of(count, at, how)
    }

    fn shared_scene(&self) -> Arc<Scene> {
        self.shared_scene()
    }

    fn widest_packets(&self) -> Traversal {
        self.widest_packets()
    }
}

/// Solutions.
#[allow(missing_docs)]
pub trait SolutionParts {
    fn irradiance_of(&self, count: usize, at: impl Fn(usize) -> SurfacePoint) -> Result<Vec<[f64; 3]>>;
}

impl SolutionParts for Solution {
    fn irradiance_of(&self, count: usize, at: impl Fn(usize) -> SurfacePoint) -> Result<Vec<[f64; 3]>> {
        self.irradiance_of(count, at)
    }
}

/// Options of preparation.
#[allow(missing_docs)]
pub trait PrepareParts {
    fn with_clusters(self, clusters: clusters::Options) -> Self;
    fn with_optics(self, optics: optics::Options) -> Self;
    fn parts(&self) -> (clusters::Options, optics::Options, CacheLocation);
}

impl PrepareParts for PrepareOptions {
    fn with_clusters(mut self, clusters: clusters::Options) -> PrepareOptions {
        (self.builder, self.clusters) = (clusters.builder, clusters);
        self
    }

    fn with_optics(mut self, optics: optics::Options) -> PrepareOptions {
        self.optics = optics;
        self
    }

    fn parts(&self) -> (clusters::Options, optics::Options, CacheLocation) {
        (self.clusters(), self.optics, self.cache())
    }
}

/// Options of reading.
#[allow(missing_docs)]
pub trait LoadParts {
    fn with_placements(self, luminaires: Placements) -> Self;
    fn with_moves(self, moves: Vec<Move>) -> Self;
    fn with_grid(self, grid: ReadOptions) -> Self;
    fn with_added(self, added: AddedFiles, curvature: Option<f64>) -> Self;
}

impl LoadParts for LoadOptions {
    fn with_placements(mut self, luminaires: Placements) -> LoadOptions {
        self.luminaires = luminaires;
        self
    }

    fn with_moves(mut self, moves: Vec<Move>) -> LoadOptions {
        self.moves = moves;
        self
    }

    fn with_grid(mut self, grid: ReadOptions) -> LoadOptions {
        self.grid = grid;
        self
    }

    fn with_added(mut self, added: AddedFiles, curvature: Option<f64>) -> LoadOptions {
        (self.added, self.curvature) = (added, curvature);
        self
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

/// Upward axes.
#[allow(missing_docs)]
pub trait AxisParts {
    fn name(self) -> &'static str;
    fn vector(self) -> Vec3;
}

impl AxisParts for UpAxis {
    fn name(self) -> &'static str {
        self.name()
    }

    fn vector(self) -> Vec3 {
        self.vector()
    }
}
