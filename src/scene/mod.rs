//! The resolved scene: everything that later rooms need, checked once at the door.
//!
//! Input formats, defaults, units and repairs end here; no later room re-checks. This room does not know that
//! rays, hierarchies or radiosity exist.

mod bent;
mod compact;
mod connect;
mod emitters;
mod flatten;
pub mod generate;
mod instances;
mod keep;
mod load;
mod mtl;
mod overlap;
mod power;
mod read_gltf;
mod read_obj;
mod read_ply;
mod resolve;
mod soup;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
mod texture;
mod triangulate;
mod weld;
mod write_gltf;
mod write_obj;

pub use flatten::MAX_FLATTENED_TRIANGLES;
pub use instances::{MAX_PLACEMENTS, Placement};
pub use load::LoadOptions;
pub use power::{parse_emitter, unit_in_metres};
pub use resolve::{MAX_COORDINATE, MAX_REFLECTANCE, MIN_EXTENT, resolve};
pub use soup::{PlacedSoup, Soup, SoupMaterial};
pub use texture::Texture;
pub use write_gltf::write_gltf;
pub use write_obj::{mtl_path, write_obj};

use crate::{Result, math::Aabb};
use glam::{DVec3, Vec3};
use std::{path::PathBuf, sync::Arc};

/// A named run of faces: an OBJ object or group, a glTF node, a PLY file.
#[derive(Clone, Debug)]
pub struct Object {
    /// The name in the file, or a made-up one (`object 3`).
    pub name: String,
}

/// A surface description.
#[derive(Clone, Debug)]
pub struct Material {
    /// The name in the file.
    pub name: String,
    /// Diffuse reflectance of both sides, linear RGB in `[0, 1)`.
    pub reflectance: [f32; 3],
    /// Emitted radiance on the front side, W/(m² sr), linear RGB, `>= 0`.
    pub emission: [f32; 3],
}

/// A camera that the file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredCamera {
    /// Its name in the file, or a made-up one (`camera 0`).
    pub name: String,
    /// Where it is, in the file's coordinates.
    pub eye: DVec3,
    /// Where it looks, a unit vector.
    pub forward: DVec3,
    /// What is up in its picture, a unit vector.
    pub up: DVec3,
    /// Angle of view from top to bottom, radians in `(0, π)`.
    pub angle: f64,
}

/// A connected set of faces of one emissive material.
#[derive(Clone, Debug)]
pub struct Emitter {
    /// Object name, with a number where one object has several emissive surfaces.
    pub name: String,
    /// Its faces, ascending indices into [`Scene::triangles`].
    pub triangles: Vec<u32>,
    /// One-sided area of those faces, scene units squared.
    pub area: f64,
    /// Area-weighted mean of the face normals: unit length if planar, shorter if curved, zero if closed.
    pub normal: Vec3,
    /// Minimum width: for a planar surface the smallest distance of two parallel lines in its plane that hold
    /// it; for others the smallest width of its convex hull over the sampled directions. Scene units. This is
    /// width e of the umbra criterion (docs/method.md, Umbra criterion: the smallest width misses no umbra).
    pub min_width: f32,
    /// Radiance, W/(m² sr), linear RGB (area-weighted mean over the faces).
    pub emission: [f32; 3],
}

/// What was repaired or assumed while reading, counted. All zero for a clean file.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Repairs {
    /// Polygons dropped because they have no area, or fewer than three corners.
    pub zero_area_faces: usize,
    /// Polygons dropped because their vertices occurred before as one polygon; two that face each other in
    /// different objects stay (solids that touch).
    pub duplicate_faces: usize,
    /// Polygons with more than three corners that were triangulated.
    pub polygons_triangulated: usize,
    /// Of those, the concave or bent ones.
    pub concave_polygons: usize,
    /// Polygons that no triangulation could be found for (flat and self-crossing); dropped.
    pub broken_polygons: usize,
    /// Vertices merged because they have the same position.
    pub welded_vertices: usize,
    /// Faces whose material is missing; they got the default (reflectance 0.5, no emission).
    pub faces_without_material: usize,
    /// Material libraries or textures that could not be read; defaults were used.
    pub missing_files: usize,
    /// Materials whose reflectance lay outside `[0, 1)` and was clamped to [`MAX_REFLECTANCE`].
    pub clamped_reflectances: usize,
    /// Vertices that no face uses.
    pub unused_vertices: usize,
    /// Faces dropped because their material is more transparent than opaque (`d` below 0.5) and does not emit.
    pub transparent_faces: usize,
    /// Pairs of objects of which faces lie in one plane, overlap, face the same way and do not look the same: which of them
    /// is seen is chance.
    pub overlapping_objects: usize,
    /// Nodes that place a shared mesh with shear or unequal scale, so that its triangles were copied. Not written if zero.
    #[serde(skip_serializing_if = "is_zero")]
    pub copied_placements: usize,
    /// One readable line for each kind of repair, with names where they help.
    pub messages: Vec<String>,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// An immutable, checked scene of triangles. All vectors that start with `triangle_` have one entry a triangle.
///
/// Positions are relative to [`Scene::origin`] so that scenes far from zero (map coordinates) keep f32 precision.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The file or generator it came from.
    pub path: PathBuf,
    /// Name of the length unit, `m` unless told otherwise.
    pub unit: String,
    /// Emissive faces emit from both sides instead of only from the front.
    pub two_sided_emission: bool,
    /// What was subtracted from the file's coordinates, in f64.
    pub origin: DVec3,
    /// Welded vertex positions relative to `origin`, finite.
    pub positions: Vec<Vec3>,
    /// Corner indices into `positions`, each triangle with non-zero area.
    pub triangles: Vec<[u32; 3]>,
    /// Index into `objects`.
    pub triangle_object: Vec<u32>,
    /// Index into `materials`.
    pub triangle_material: Vec<u32>,
    /// Polygon of the file that it is a part of, numbered from 0 in file order, ascending.
    pub triangle_polygon: Vec<u32>,
    /// Diffuse reflectance of the face: `Kd`, or the mean linear colour of its texture over the face.
    pub triangle_reflectance: Vec<[f32; 3]>,
    /// 1: the face bounds a closed solid, only its outside is seen; 2: sheet, seen from both sides.
    pub triangle_sides: Vec<u8>,
    /// Edge-connected component of the face, numbered from 0 in order of first face.
    pub triangle_component: Vec<u32>,
    /// Number of components that are closed: every edge has exactly two faces (of one object, where more meet).
    pub closed_parts: usize,
    /// Number of the other components.
    pub sheet_parts: usize,
    /// Objects in file order.
    pub objects: Vec<Object>,
    /// Materials in file order.
    pub materials: Vec<Material>,
    /// Emissive surfaces, in order of their first face.
    pub emitters: Vec<Emitter>,
    /// Index into `emitters` of each face, `u32::MAX` for faces that do not emit.
    pub triangle_emitter: Vec<u32>,
    /// Texture coordinates of the corners of each face, from the lower left corner of an image; empty if the file has none.
    pub triangle_texcoords: Vec<[[f32; 2]; 3]>,
    /// Perspective cameras of the file.
    pub cameras: Vec<StoredCamera>,
    /// Box of all positions that faces use.
    pub bounds: Aabb,
    /// What was repaired.
    pub repairs: Repairs,
    /// Meshes that are stored once and placed by `placements`: each a scene of its own in its own frame, without
    /// emitters, shared meshes or placements. Empty for a scene whose meshes all occur once.
    pub shared: Vec<Arc<Scene>>,
    /// Where the shared meshes stand, in file order.
    pub placements: Vec<Placement>,
}

impl Scene {
    /// The three corners of a triangle.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    /// The scene's own faces of the objects, groups or materials called `name`, ascending. Placements are not searched.
    ///
    /// # Errors
    /// Nothing has that name; the message lists the first few that there are.
    pub fn faces_named(&self, name: &str) -> Result<Vec<u32>> {
        let objects: Vec<bool> = self.objects.iter().map(|o| o.name == name).collect();
        let materials: Vec<bool> = self.materials.iter().map(|m| m.name == name).collect();
        let faces: Vec<u32> = (0..self.triangles.len())
            .filter(|&t| {
                objects[self.triangle_object[t] as usize] || materials[self.triangle_material[t] as usize]
            })
            .map(|t| t as u32)
            .collect();
        if faces.is_empty() {
            return Err(power::unknown(
                name,
                self.objects.iter().map(|o| &o.name).chain(self.materials.iter().map(|m| &m.name)),
            ));
        }
        Ok(faces)
    }

    /// Bytes of all that there is a vertex, a face, an object, a material or a placement of; of each shared mesh once.
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
            + self.shared.iter().map(|m| m.bytes()).sum::<usize>()
    }

    /// Total power of an emitter in watts, one value a channel: π L A, twice that for two-sided emission.
    /// Units of length that are not known count as metres.
    pub fn power(&self, emitter: &Emitter) -> [f64; 3] {
        let metres = unit_in_metres(&self.unit).unwrap_or(1.0);
        let sides = if self.two_sided_emission { 2.0 } else { 1.0 };
        emitter.emission.map(|l| std::f64::consts::PI * f64::from(l) * emitter.area * metres * metres * sides)
    }
}
