//! The resolved scene: geometry, materials, emitters and cameras, checked once.
//!
//! File formats, defaults, units and repairs are handled here; later rooms do not check again.

mod added;
mod bent;
mod box_grid;
mod compact;
mod connect;
mod continuations;
mod divide;
mod duplicates;
mod emitter_sampler;
mod emitters;
mod faces;
mod fine_ground;
mod flatten;
pub mod generate;
mod generate_options;
mod instances;
mod keep;
mod limits;
mod load;
mod load_options;
mod luminaires;
mod magnitudes;
mod measuring_grid;
mod moves;
mod mtl;
mod names;
mod overlap;
mod part_shapes;
mod photometry;
mod placement;
mod planar;
mod plane_order;
mod power;
mod profile;
mod read_gltf;
mod read_grid;
mod read_luminaire;
mod read_obj;
mod read_ply;
mod resolve;
mod seams;
mod size;
mod soup;
mod sources;
mod stack;
mod strength;
mod stretch;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
mod texture;
mod triangulate;
mod up;
mod write_gltf;
mod write_obj;

pub(crate) use connect::badly_wound;
pub use emitter_sampler::EmitterSampler;
pub(crate) use fine_ground::{FineGround, Piece};
pub use flatten::InstanceTriangles;
pub use generate_options::GenerateOptions;
pub(crate) use instances::resolve_placed;
pub use limits::{MAX_COORDINATE, MAX_REFLECTANCE, MIN_EXTENT};
pub use load_options::LoadOptions;
pub(crate) use magnitudes::magnitude;
pub use photometry::{Channels, Photometry};
pub use placement::{MAX_PLACEMENTS, Placement};
pub use power::unit_in_metres;
pub use profile::Profile;
#[cfg(test)]
pub(crate) use read_grid::add_coarse;
pub use resolve::resolve;
pub use soup::{PlacedSoup, Soup, SoupMaterial};
pub use strength::Strength;
pub use stretch::{MAX_STRETCH, stretch};
pub use up::UpAxis;
#[cfg(feature = "reports")]
pub use write_gltf::write_glb;
pub use {
    added::{AddedFiles, read_added},
    load::read_from_memory,
    load_options::Placements,
    luminaires::{lit_from_memory, read_placements},
    measuring_grid::MeasuringGrid,
    moves::Move,
    mtl::read_materials,
    power::parse_emitter,
    write_gltf::write_gltf,
    write_obj::{mtl_path, write_obj},
};

use crate::Result;
use crate::error::in_own_words;
use crate::math::{Aabb, triangle_area, triangle_normal};
use crate::sky::{Environment, SkyOptions, Sun};
use glam::{DVec3, Vec3};
use std::{collections::HashSet, path::PathBuf, sync::Arc};

/// A named range of faces: an OBJ object or group, a glTF node, a PLY file.
#[derive(Clone, Debug)]
pub struct Object {
    /// Name in the file, or a generated one (`object 3`).
    pub name: String,
}

/// Material of a surface.
#[derive(Clone, Debug)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// Diffuse reflectance of both sides, linear RGB in `[0, 1)`.
    pub reflectance: [f32; 3],
    /// Emitted radiance on the front side, W/(m² sr), linear RGB, `>= 0`; with a profile its mean over directions, weighted by the
    /// cosine.
    pub emission: [f32; 3],
    /// Directions in which the front sends its light; none for diffuse emission.
    pub profile: Option<Arc<Profile>>,
}

/// A camera of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredCamera {
    /// Name in the file, or a generated one (`camera 0`).
    pub name: String,
    /// Position in the file's coordinates.
    pub eye: DVec3,
    /// Viewing direction, a unit vector.
    pub forward: DVec3,
    /// Upward direction of the picture, a unit vector.
    pub up: DVec3,
    /// Angle of view from top to bottom, radians in `(0, π)`.
    pub angle: f64,
}

/// A connected set of faces of one emissive material.
#[derive(Clone, Debug)]
pub struct Emitter {
    /// Object name, with a number where one object has several emissive surfaces.
    pub name: String,
    /// Faces of the emitter: ascending indices into `Scene::triangles`.
    pub triangles: Vec<u32>,
    /// One-sided area of the faces, scene units squared.
    pub area: f64,
    /// Area-weighted mean of the face normals: unit length if planar, shorter if curved, zero if closed.
    pub normal: Vec3,
    /// Minimum width, scene units: for a planar surface the smallest distance of two parallel lines in its plane that
    /// enclose it; otherwise the smallest sampled width of its convex hull. Width e of the umbra criterion
    /// (docs/method.md, Umbra criterion: the smallest width misses no umbra).
    pub min_width: f32,
    /// Radiance, W/(m² sr), linear RGB (area-weighted mean over the faces).
    pub emission: [f32; 3],
}

/// Counts of repairs and assumptions made while reading. All zero for a clean file.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Repairs {
    /// Polygons without area or with fewer than three corners; dropped.
    pub zero_area_faces: usize,
    /// Polygons with the vertices of an earlier polygon; dropped. Two that face each other in different objects
    /// remain (solids in contact).
    pub duplicate_faces: usize,
    /// Polygons with more than three corners that were triangulated.
    pub polygons_triangulated: usize,
    /// Of these, the concave or non-planar ones.
    pub concave_polygons: usize,
    /// Polygons without a triangulation (planar and self-intersecting); dropped.
    pub broken_polygons: usize,
    /// Merged vertices with equal positions.
    pub welded_vertices: usize,
    /// Faces without a material; they got the default (reflectance 0.5, no emission).
    pub faces_without_material: usize,
    /// Unreadable material libraries or textures; defaults were used.
    pub missing_files: usize,
    /// Materials with a reflectance outside `[0, 1)`, clamped to [`MAX_REFLECTANCE`].
    pub clamped_reflectances: usize,
    /// Vertices without a face.
    pub unused_vertices: usize,
    /// Faces of a material that is more transparent than opaque (`d` below 0.5) and does not emit; dropped.
    pub transparent_faces: usize,
    /// Pairs of objects with overlapping faces in one plane that face the same way and differ in part or material: the face of the
    /// smaller part is treated as the upper one, of equal parts the one later in the file.
    pub overlapping_objects: usize,
    /// Nodes that place a shared mesh with shear or unequal scale, so that its triangles were copied. Not serialised
    /// if zero.
    #[serde(skip_serializing_if = "is_zero")]
    pub copied_placements: usize,
    /// Triangles that were added where faces are too large for the precision that small things near them need. Not serialised if zero.
    #[serde(skip_serializing_if = "is_zero")]
    pub divided_faces: usize,
    /// One line for each kind of repair, with names where they help.
    #[serde(serialize_with = "in_own_words")]
    pub messages: Vec<String>,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// An immutable, checked scene of triangles. Vectors that start with `triangle_` have one entry per triangle.
///
/// Positions are relative to [`Scene::origin`], so that scenes far from zero (map coordinates) keep f32 precision.
#[derive(Clone, Debug)]
pub struct Scene {
    /// File or generator of the scene.
    pub(crate) path: PathBuf,
    /// Name of the unit of length; default `m`.
    pub(crate) unit: String,
    /// Emissive faces emit from both sides instead of only from the front.
    pub(crate) two_sided_emission: bool,
    /// Upward axis as given by the options.
    pub(crate) up: Option<UpAxis>,
    /// Offset subtracted from the file's coordinates, in f64.
    pub(crate) origin: DVec3,
    /// Vertex positions relative to `origin`, distinct and finite.
    pub(crate) positions: Vec<Vec3>,
    /// Corner indices into `positions`, each triangle with non-zero area.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Index into `objects`.
    pub(crate) triangle_object: Vec<u32>,
    /// Index into `materials`.
    pub(crate) triangle_material: Vec<u32>,
    /// Polygon of the file that contains the triangle, numbered from 0 in file order, ascending.
    pub(crate) triangle_polygon: Vec<u32>,
    /// Diffuse reflectance of the face: `Kd`, or the mean linear colour of the texture over the face.
    pub(crate) triangle_reflectance: Vec<[f32; 3]>,
    /// 1: the face bounds a closed solid and is visible from outside only; 2: sheet, visible from both sides.
    pub(crate) triangle_sides: Vec<u8>,
    /// Edge-connected component of the face, numbered from 0 in order of first face.
    pub(crate) triangle_component: Vec<u32>,
    /// Number of closed components: every edge has exactly two faces (of one object, where more meet).
    pub(crate) closed_parts: usize,
    /// Number of the other components.
    pub(crate) sheet_parts: usize,
    /// Objects in file order.
    pub(crate) objects: Vec<Object>,
    /// Materials in file order.
    pub(crate) materials: Vec<Material>,
    /// Emissive surfaces, in order of their first face.
    pub(crate) emitters: Vec<Emitter>,
    /// Sky and suns.
    pub(crate) environment: Option<Arc<Environment>>,
    /// Curvature of the earth below the scene; none for a flat one.
    pub(crate) curved: Option<added::Curved>,
    /// Ground that rays meet in full resolution, in place of its faces.
    pub(crate) fine_ground: Option<Arc<fine_ground::Resolved>>,
    /// Suns of the file.
    pub(crate) suns: Vec<Sun>,
    /// Index into `emitters`; `u32::MAX` for faces that do not emit.
    pub(crate) triangle_emitter: Vec<u32>,
    /// Texture coordinates of the corners of each face, from the lower left corner of the image; empty if the file
    /// has none.
    pub(crate) triangle_texcoords: Vec<[[f32; 2]; 3]>,
    /// Perspective cameras of the file.
    pub(crate) cameras: Vec<StoredCamera>,
    /// Bounding box of all vertices of faces.
    pub(crate) bounds: Aabb,
    /// How triangles in one plane were moved off each other.
    pub(crate) stack_moves: stack::StackMoves,
    /// Parts of these triangles that were closed and consistently wound before the triangles were moved.
    pub(crate) wound_parts: HashSet<u32>,
    /// Pairs of objects with overlapping faces in one plane that face the same way or none of which is of a body such as furniture;
    /// ascending.
    pub(crate) contacts: Vec<[u32; 2]>,
    /// Repairs made while reading.
    pub(crate) repairs: Repairs,
    /// Files that were read: the scene, its material libraries, textures and buffers, placed luminaires; empty for generated scenes.
    pub(crate) files: Vec<PathBuf>,
    /// Files that the scene names and that could not be opened: with them it would be another scene.
    pub(crate) unread_files: Vec<PathBuf>,
    /// Meshes that are stored once and placed by `placements`; each is a scene in its own frame, without emitters,
    /// shared meshes or placements. Empty if every mesh occurs once.
    pub(crate) shared: Vec<Arc<Scene>>,
    /// Placements of the shared meshes, in file order.
    pub(crate) placements: Vec<Placement>,
    /// The triangles of each instance in a scene that [`Scene::flattened`] made; empty for others, which are one instance.
    pub(crate) instances: Vec<InstanceTriangles>,
}

impl Scene {
    /// Lights the scene by a sky and suns, instead of those that it has. Suns of the scene's file stay where the description has none and
    /// does not say `sun = "none"`. Below a sky with [`SkyOptions::photometric`], which is in lux, all other light of the scene must be
    /// in lumens and lux.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) if the values of the description do not fit together, such as a sky that needs a sun
    /// above the horizon and has none; [`Error::Io`](crate::Error::Io) or [`Error::File`](crate::Error::File) of a map.
    pub fn set_sky(&mut self, sky: &SkyOptions) -> Result<()> {
        let environment = sky.environment_with(self.up_vector(), &self.suns)?;
        self.environment = Some(Arc::new(environment));
        self.files.extend(sky.files());
        Ok(())
    }

    /// The largest distance by which faces of the stack of overlapping faces of a triangle were moved off each other, scene units.
    pub(crate) fn stack_distance(&self, triangle: u32) -> f32 {
        self.stack_moves.get(&triangle).map_or(0.0, |of| of.largest)
    }

    /// The largest of these distances in the scene, scene units.
    pub(crate) fn largest_stack_distance(&self) -> f32 {
        self.stack_moves.values().map(|of| of.largest).fold(0.0, f32::max)
    }

    /// Lights the scene by the suns of its file, if there are any.
    fn light_by_suns(&mut self) -> Result<()> {
        if !self.suns.is_empty() {
            let environment = Environment::of_suns(self.up_vector(), self.suns.clone())?;
            self.environment = Some(Arc::new(environment));
        }
        Ok(())
    }

    /// Position and normal of a point of the map where it lies on a curved earth: lowered and turned as the surfaces of the scene are.
    #[doc(hidden)]
    pub fn lowered(&self, position: DVec3, normal: DVec3) -> (DVec3, DVec3) {
        self.curved.map_or((position, normal), |curved| curved.place(position, normal))
    }

    /// The upward direction.
    fn up_vector(&self) -> glam::DVec3 {
        self.up_axis().vector().as_dvec3()
    }

    /// The sky and the suns that light the scene, if there are any.
    pub(crate) fn sky(&self) -> Option<&Environment> {
        self.environment.as_deref()
    }

    /// Length of rays that leave the scene from any of its points, scene units: its diagonal, with one per cent for rounding.
    pub(crate) fn ray_length(&self) -> f32 {
        1.01 * self.bounds.diagonal()
    }

    #[inline]
    #[doc(hidden)]
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    /// Unit normal of a triangle's front.
    pub(crate) fn face_normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        triangle_normal(a, b, c)
    }

    /// Area of a triangle, of one side.
    pub(crate) fn face_area(&self, triangle: u32) -> f64 {
        let [a, b, c] = self.corners(triangle);
        triangle_area(a, b, c)
    }

    /// The scene's own faces of the objects, groups or materials called `name`, ascending. Placements are not
    /// searched.
    ///
    /// # Errors
    /// Nothing has this name; the message lists some names.
    pub(crate) fn faces_named(&self, name: &str) -> Result<Vec<u32>> {
        let faces = self.faces_with_name(name);
        if faces.is_empty() { Err(names::unknown(name, self.names())) } else { Ok(faces) }
    }

    /// The scene's own faces of the objects, groups or materials called `name`, ascending; maybe none.
    fn faces_with_name(&self, name: &str) -> Vec<u32> {
        let objects: Vec<bool> = self.objects.iter().map(|o| o.name == name).collect();
        let materials: Vec<bool> = self.materials.iter().map(|m| m.name == name).collect();
        (0..self.triangles.len())
            .filter(|&t| {
                objects[self.triangle_object[t] as usize] || materials[self.triangle_material[t] as usize]
            })
            .map(|t| t as u32)
            .collect()
    }

    /// Names of objects and materials.
    fn names(&self) -> impl Iterator<Item = &str> {
        let materials = self.materials.iter().map(|m| m.name.as_str());
        self.objects.iter().map(|o| o.name.as_str()).chain(materials)
    }

    /// Memory of vertices, faces, objects, materials and placements, bytes; each shared mesh counts once.
    #[doc(hidden)]
    pub fn bytes(&self) -> usize {
        fn of<T>(list: &[T]) -> usize {
            size_of_val(list)
        }
        of(&self.positions)
            + of(&self.triangles)
            + of(&self.triangle_object)
            + of(&self.triangle_material)
            + of(&self.triangle_reflectance)
            + of(&self.triangle_sides)
            + of(&self.triangle_component)
            + of(&self.triangle_emitter)
            + of(&self.triangle_texcoords)
            + of(&self.objects)
            + of(&self.materials)
            + self.emitters.iter().map(|e| of(&e.triangles)).sum::<usize>()
            + of(&self.placements)
            + of(&self.instances)
            + self.shared.iter().map(|m| m.bytes()).sum::<usize>()
    }

    /// Power of an emitter in watts, per channel: π L A, twice that for two-sided emission. Unknown units of length
    /// count as metres.
    #[doc(hidden)]
    pub fn power(&self, emitter: &Emitter) -> [f64; 3] {
        let metres = unit_in_metres(&self.unit).unwrap_or(1.0);
        let material = self.triangle_material[emitter.triangles[0] as usize] as usize;
        let both = self.two_sided_emission && self.materials[material].profile.is_none();
        let sides = if both { 2.0 } else { 1.0 };
        emitter.emission.map(|l| std::f64::consts::PI * f64::from(l) * emitter.area * metres * metres * sides)
    }
}
