//! Polygon soup: unchecked input of [`resolve`](super::resolve()).

use super::{FineGround, Placement, Profile, Repairs, StoredCamera, seams::Tile, texture::Texture};
use crate::sky::Sun;
use glam::DVec3;
use std::{collections::HashMap, path::PathBuf, sync::Arc};

/// Polygons of a file or a generator: not merged, triangulated or checked.
///
/// Polygon `i` has the corners `corners[ends[i - 1]..ends[i]]` (from 0 for the first).
#[derive(Clone, Debug, Default)]
pub struct Soup {
    /// File or generator of the soup.
    pub path: PathBuf,
    /// Vertex positions, in scene units.
    pub positions: Vec<DVec3>,
    /// Indices into `positions` of all polygons in order.
    pub corners: Vec<u32>,
    /// End of each polygon in `corners`.
    pub ends: Vec<u32>,
    /// Index into `objects` of each polygon.
    pub polygon_object: Vec<u32>,
    /// Index into `materials` of each polygon.
    pub polygon_material: Vec<u32>,
    /// Texture coordinates, v up.
    pub texcoords: Vec<[f32; 2]>,
    /// Index into `texcoords` of each corner; empty if the soup has none.
    pub corner_texcoords: Vec<u32>,
    /// Names of objects, unique.
    pub objects: Vec<String>,
    /// Materials, names unique.
    pub materials: Vec<SoupMaterial>,
    /// Perspective cameras.
    pub cameras: Vec<StoredCamera>,
    /// Lights that are infinitely far away.
    pub suns: Vec<Sun>,
    /// Luminous fluxes of its lamps and luminaires, lm.
    pub fluxes: Vec<f64>,
    /// Height fields of which the polygons are a simpler form.
    pub ground: Option<FineGround>,
    /// Its height fields.
    pub tiles: Vec<Tile>,
    /// Metres of a degree of longitude and of latitude from which positions of height fields in degrees follow.
    pub metres_of_degree: Option<[f64; 2]>,
    /// Repairs made while reading.
    pub repairs: Repairs,
}

/// A soup with placements of shared meshes.
#[derive(Clone, Debug, Default)]
pub struct PlacedSoup {
    /// Polygons that occur once.
    pub soup: Soup,
    /// Shared meshes, without emitters.
    pub meshes: Vec<Soup>,
    /// Placements; transforms map coordinates of the mesh's soup to those of `soup`.
    pub placements: Vec<Placement>,
}

/// A material as stated in the file.
#[derive(Clone, Debug)]
pub struct SoupMaterial {
    /// Name.
    pub name: String,
    /// Diffuse reflectance (`Kd`), linear RGB, unchecked.
    pub reflectance: [f32; 3],
    /// Emitted radiance (`Ke`), W/(m² sr), linear RGB, unchecked.
    pub emission: [f32; 3],
    /// `d`: 1 opaque, 0 fully transparent.
    pub opacity: f32,
    /// Image that multiplies the reflectance.
    pub texture: Option<Texture>,
    /// Whether this is the substitute of a missing material.
    pub missing: bool,
    /// Directions in which an emitter sends its light; none for a diffuse one.
    pub profile: Option<Arc<Profile>>,
}

impl SoupMaterial {
    /// Reflectance of a face whose material is missing.
    pub const DEFAULT_REFLECTANCE: [f32; 3] = [0.5; 3];

    /// An opaque surface without texture or emission.
    pub fn diffuse(name: impl Into<String>, reflectance: [f32; 3]) -> Self {
        let name = name.into();
        let emission = [0.0; 3];
        SoupMaterial {
            name,
            reflectance,
            emission,
            opacity: 1.0,
            texture: None,
            missing: false,
            profile: None,
        }
    }

    /// An emitter: radiance in W/(m² sr) on the front side, reflectance 0.
    pub fn light(name: impl Into<String>, emission: [f32; 3]) -> Self {
        SoupMaterial { emission, ..SoupMaterial::diffuse(name, [0.0; 3]) }
    }

    /// The substitute of a missing material.
    pub fn missing(name: impl Into<String>) -> Self {
        SoupMaterial { missing: true, ..SoupMaterial::diffuse(name, Self::DEFAULT_REFLECTANCE) }
    }
}

impl Soup {
    /// An empty soup with its origin.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Soup { path: path.into(), ..Soup::default() }
    }

    /// Number of polygons.
    pub fn polygons(&self) -> usize {
        self.ends.len()
    }

    /// Range of polygon `i` in `corners`.
    pub fn span(&self, i: usize) -> std::ops::Range<usize> {
        let start = if i == 0 { 0 } else { self.ends[i - 1] as usize };
        start..self.ends[i] as usize
    }

    /// Name of the object of the first polygon with this vertex.
    pub(super) fn object_with(&self, vertex: usize) -> Option<&str> {
        let corner = self.corners.iter().position(|&corner| corner as usize == vertex)?;
        let polygon = self.ends.partition_point(|&end| end as usize <= corner);
        Some(self.objects.get(*self.polygon_object.get(polygon)? as usize)?)
    }

    /// Adds a material; returns its index.
    pub fn material(&mut self, material: SoupMaterial) -> u32 {
        self.materials.push(material);
        self.materials.len() as u32 - 1
    }

    /// Adds copies of the materials that polygons name by their place in `all`, in order of their first use.
    pub fn copy_materials(&mut self, all: &[SoupMaterial]) {
        let mut place = vec![None; all.len()];
        for i in 0..self.polygons() {
            let k = self.polygon_material[i] as usize;
            self.polygon_material[i] = *place[k].get_or_insert_with(|| self.material(all[k].clone()));
        }
    }

    /// Adds an object with a unique name; returns its index.
    pub fn object(&mut self, name: impl Into<String>) -> u32 {
        self.objects.push(name.into());
        self.objects.len() as u32 - 1
    }

    /// Adds a polygon with new vertices, counterclockwise as seen from its front.
    pub fn polygon(&mut self, object: u32, material: u32, corners: &[DVec3]) {
        let first = self.positions.len() as u32;
        self.positions.extend_from_slice(corners);
        self.indexed_polygon(object, material, first..first + corners.len() as u32);
    }

    /// Adds the faces of a box. Corner `i` lies at the upper end of axis `k` if bit `k` of `i` is set.
    pub fn closed_box(&mut self, object: u32, material: u32, corner: impl Fn(u32) -> DVec3) {
        let first = self.positions.len() as u32;
        self.positions.extend((0..8).map(corner));
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            self.indexed_polygon(object, material, face.map(|i| first + i));
        }
    }

    /// Gives all corners without texture coordinates the first of them, if there are any.
    pub fn fill_texcoords(&mut self) {
        if !self.texcoords.is_empty() {
            self.corner_texcoords.resize(self.corners.len(), 0);
        }
    }

    /// Adds a polygon of existing vertices.
    pub fn indexed_polygon(&mut self, object: u32, material: u32, corners: impl IntoIterator<Item = u32>) {
        self.corners.extend(corners);
        self.ends.push(self.corners.len() as u32);
        self.polygon_object.push(object);
        self.polygon_material.push(material);
    }
}

/// Numbers names in order of their first appearance.
#[derive(Clone, Debug, Default)]
pub(super) struct Names {
    index: HashMap<String, u32>,
    /// The names in order.
    pub list: Vec<String>,
}

impl Names {
    /// The number of `name`; a new one if the name is new.
    pub fn of(&mut self, name: &str) -> u32 {
        if let Some(&i) = self.index.get(name) {
            return i;
        }
        let i = self.list.len() as u32;
        self.index.insert(name.to_owned(), i);
        self.list.push(name.to_owned());
        i
    }
}
