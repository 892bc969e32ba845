//! Scenes from arrays of the caller.

use super::mesh_arrays::MeshArrays;
use crate::error::quote;
use crate::math::{Aabb, affine};
use crate::scene::{
    LoadOptions, MAX_COORDINATE, MAX_PLACEMENTS, MAX_STRETCH, PlacedSoup, Placement, Scene, Soup,
    SoupMaterial, resolve_placed, stretch,
};
use crate::threads::Threads;
use crate::{Error, Result};
use std::collections::HashSet;

/// Name of scenes from arrays in messages and records.
const PATH: &str = "arrays";

/// Builds a [`Scene`] from arrays: materials first, then meshes that use them, then instances of shared meshes.
///
/// ```
/// use mrvis::{LoadOptions, MeshArrays, SceneBuilder};
///
/// let mut builder = SceneBuilder::default();
/// let grey = builder.add_material("grey", [0.5; 3], [0.0; 3])?;
/// let light = builder.add_material("light", [0.0; 3], [10.0; 3])?; // W/(m² sr)
/// let square = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// builder.add_object(&MeshArrays::new("floor", &square[..], &[0, 1, 2, 0, 2, 3]).material(grey))?;
/// let above = square.map(|[x, y, _]| [x, y, 2.0]);
/// builder.add_object(&MeshArrays::new("lamp", &above[..], &[3, 2, 1, 0]).polygon_sizes(&[4]).material(light))?;
/// let scene = builder.finish(&LoadOptions::default())?;
/// assert_eq!(scene.object_names().collect::<Vec<_>>(), ["floor", "lamp"]);
/// assert_eq!((scene.triangle_count(), scene.emitter_names().len()), (4, 1));
/// # Ok::<(), mrvis::Error>(())
/// ```
///
/// Everything is checked before it is copied; an error leaves the builder as it was. Defects that can be repaired (polygons without
/// area, vertices that occur twice, ...) are repaired by [`SceneBuilder::finish`] as those of files are.
#[derive(Clone, Debug, Default)]
pub struct SceneBuilder {
    placed: PlacedSoup,
    materials: HashSet<String>,
    /// Names of objects and of instances.
    objects: HashSet<String>,
    /// Names of shared meshes.
    meshes: HashSet<String>,
    /// Their boxes.
    boxes: Vec<Aabb>,
}

impl SceneBuilder {
    /// Adds a material with a unique name; returns its index, counted from 0. Linear RGB: diffuse reflectance of both sides in `[0, 1]`
    /// (above 0.999 becomes 0.999, as for files), and the radiance that the front emits, W/(m² sr), at least 0.
    ///
    /// # Errors
    /// [`Error::Argument`] if a value is out of its range or the name is empty or taken.
    pub fn add_material(&mut self, name: &str, reflectance: [f32; 3], emission: [f32; 3]) -> Result<u32> {
        for (what, values, max) in [("reflectance", reflectance, 1.0), ("emission", emission, f32::MAX)] {
            if let Some(value) = values.iter().find(|v| !(0.0..=max).contains(*v)) {
                let range = if max == 1.0 { "lie in 0..1" } else { "be finite and at least 0" };
                let value = format!("{value} of material `{}`", quote(name));
                return Err(Error::argument(what, value, format!("must {range}")));
            }
        }
        check_name("material", name, &self.materials)?;
        index("materials", self.placed.soup.materials.len())?;
        self.materials.insert(name.into());
        Ok(self.placed.soup.material(SoupMaterial { emission, ..SoupMaterial::diffuse(name, reflectance) }))
    }

    /// Adds a mesh as an object of the scene. Its name is unique among objects and instances.
    ///
    /// # Errors
    /// [`Error::Argument`] if an index, size, position or material is out of range or the name is empty or taken: the message names
    /// the array and the entry. [`Error::OutOfMemory`].
    pub fn add_object(&mut self, mesh: &MeshArrays) -> Result<()> {
        check_name("object", mesh.name, &self.objects)?;
        mesh.check(self.placed.soup.materials.len())?;
        append(&mut self.placed.soup, mesh)?;
        self.objects.insert(mesh.name.into());
        Ok(())
    }

    /// Adds a mesh that instances share; returns its index, counted from 0. It is not seen until an instance places it. Its name
    /// is unique among shared meshes, and its materials do not emit: emitters are objects.
    ///
    /// # Errors
    /// As [`SceneBuilder::add_object`], and if a material of it emits.
    pub fn add_shared_mesh(&mut self, mesh: &MeshArrays) -> Result<u32> {
        check_name("shared mesh", mesh.name, &self.meshes)?;
        let all = &self.placed.soup.materials;
        mesh.check(all.len())?;
        let number = index("shared meshes", self.placed.meshes.len())?;
        let mut soup = Soup::new(format!("{PATH}#{}", mesh.name.replace(['/', '\\'], "_")));
        append(&mut soup, mesh)?;
        soup.copy_materials(all);
        if let Some(used) = soup.materials.iter().find(|m| m.emission != [0.0; 3]) {
            return Err(Error::arguments(format!(
                "shared mesh `{}`: its material `{}` emits; add it as an object, emitters are not shared",
                quote(mesh.name),
                quote(&used.name)
            )));
        }
        self.boxes.push(Aabb::of(soup.corners.iter().map(|&v| soup.positions[v as usize].as_vec3())));
        self.placed.meshes.push(soup);
        self.meshes.insert(mesh.name.into());
        Ok(number)
    }

    /// Places a shared mesh in the scene: rotation, reflection, uniform scale and translation, from coordinates of the mesh to those of
    /// the scene, as rows of a 3 by 4 matrix of which the last column is the translation. The name is unique among objects and instances.
    ///
    /// # Errors
    /// [`Error::Argument`] if there is no such mesh, the name is empty or taken, or the transform is not finite, has the scale 0, leads
    /// beyond 1e12, or has shear or unequal scale of more than 1 %.
    pub fn add_instance(&mut self, mesh: u32, name: &str, transform: [[f64; 4]; 3]) -> Result<()> {
        let transform = affine(&transform);
        let of = format!("of instance `{}`", quote(name));
        check_name("instance", name, &self.objects)?;
        if mesh as usize >= self.placed.meshes.len() {
            let count = self.placed.meshes.len();
            let problem = format!("shared meshes of the scene: {count}; add a mesh before its instances");
            return Err(Error::argument("mesh", format!("{mesh} {of}"), problem));
        }
        if self.placed.placements.len() == MAX_PLACEMENTS {
            let problem = format!("a scene has at most {MAX_PLACEMENTS} instances: join some into meshes");
            return Err(Error::argument("mesh", of, problem));
        }
        if !transform.is_finite() {
            return Err(Error::argument("transform", of, "a value is not finite"));
        }
        if transform.matrix3.determinant() == 0.0 {
            let problem = "the mesh would be flat or a point: its scale must not be 0";
            return Err(Error::argument("transform", of, problem));
        }
        let reach = f64::from(self.boxes[mesh as usize].transformed(&transform).magnitude());
        // Where corners overflow, the box has infinite ends or none.
        if reach.is_nan() || reach > MAX_COORDINATE {
            let problem = format!("it would have coordinates beyond {MAX_COORDINATE:e}");
            return Err(
                Error::argument("transform", of, problem).with_cure("lower the scale or the translation")
            );
        }
        let ratio = stretch(transform.matrix3);
        if ratio > MAX_STRETCH {
            let problem = format!("shear or unequal scale (ratio {ratio:.3}, at most {MAX_STRETCH})");
            let cure = "transform the positions and add them as an object";
            return Err(Error::argument("transform", of, problem).with_cure(cure));
        }
        let placement = Placement { mesh, transform, name: name.into(), material: None, visible: true };
        self.placed.placements.push(placement);
        self.objects.insert(name.into());
        Ok(())
    }

    /// Makes the scene: merges vertices, triangulates, checks and repairs as for a file ([`Scene::repairs`] says what). Materials keep
    /// their indices; objects without a usable face are left out. If there are instances but no object, the first instance becomes
    /// one. Shared meshes of a scene without instances are left out.
    ///
    /// # Errors
    /// [`Error::File`] if no face has an area, of the scene or of a shared mesh, or its extent is too small; [`Error::Argument`] if an
    /// option is out of its range or names no emitter, or one that is shared.
    pub fn finish(self, options: &LoadOptions) -> Result<Scene> {
        let mut placed = self.placed;
        placed.soup.path = PATH.into();
        if placed.soup.ends.is_empty() && !placed.placements.is_empty() {
            let first = placed.placements.remove(0);
            let mesh = &placed.meshes[first.mesh as usize];
            copy_placed(&mut placed.soup, mesh, &first)?;
        }
        for (name, _) in &options.emitters {
            let named = |mesh: &Soup| {
                mesh.materials.iter().map(|m| &m.name).chain(&mesh.objects).any(|known| known == name)
            };
            let is_shared = |p: &Placement| p.name == *name || named(&placed.meshes[p.mesh as usize]);
            if let Some(instance) = placed.placements.iter().find(|p| is_shared(p)) {
                let problem = format!("the instance `{}` would emit", quote(&instance.name));
                let cure = "add it as an object, emitters are not shared";
                let name = format!("`{}`", quote(name));
                return Err(Error::argument("emitters", name, problem).with_cure(cure));
            }
        }
        Threads::new(options.threads)?.run(|| resolve_placed(placed, options))?
    }
}

fn check_name(what: &str, name: &str, known: &HashSet<String>) -> Result<()> {
    if name.is_empty() {
        return Err(Error::argument("name", format!("of the {what}"), "must not be empty"));
    }
    if known.contains(name) {
        let value = format!("`{}` of a second {what}", quote(name));
        return Err(Error::argument("name", value, "this name is taken; names are unique"));
    }
    Ok(())
}

/// The number of the next entry of a list.
fn index(what: &str, count: usize) -> Result<u32> {
    u32::try_from(count).map_err(|_| Error::arguments(format!("more than {} {what}", u32::MAX)))
}

/// Reserves memory for these numbers of vertices, corners and polygons.
fn reserve(soup: &mut Soup, name: &str, counts: [usize; 3]) -> Result<()> {
    let have = [soup.positions.len(), soup.corners.len(), soup.ends.len()];
    let what = ["positions", "indices", "polygon_sizes"];
    for ((what, have), more) in what.into_iter().zip(have).zip(counts) {
        if have.checked_add(more).is_none_or(|sum| sum > u32::MAX as usize) {
            return Err(Error::arguments(format!(
                "mesh `{}`: with {more} ⟨{what}⟩ the scene has more than {}: split it, or place shared meshes",
                quote(name),
                u32::MAX
            )));
        }
    }
    let [vertices, corners, polygons] = counts;
    let room = soup.positions.try_reserve(vertices).and_then(|()| {
        soup.corners.try_reserve(corners)?;
        soup.ends.try_reserve(polygons)?;
        soup.polygon_object.try_reserve(polygons)?;
        soup.polygon_material.try_reserve(polygons)
    });
    room.map_err(|_| {
        Error::OutOfMemory(format!("mesh `{}` of {vertices} vertices and {polygons} polygons", quote(name)))
    })
}

/// Copies a checked mesh as an object.
fn append(soup: &mut Soup, mesh: &MeshArrays) -> Result<()> {
    let polygons = mesh.polygons();
    reserve(soup, mesh.name, [mesh.positions.len(), mesh.indices.len(), polygons])?;
    let (first, mut end) = (soup.positions.len() as u32, soup.corners.len() as u32);
    let object = soup.object(mesh.name);
    soup.positions.extend(mesh.positions.iter());
    soup.corners.extend(mesh.indices.iter().map(|&v| first + v));
    for polygon in 0..polygons {
        end += mesh.size(polygon);
        soup.ends.push(end);
        soup.polygon_object.push(object);
        soup.polygon_material.push(mesh.materials.of(polygon));
    }
    Ok(())
}

/// Copies the polygons of a placed mesh into the soup that has all materials; a reflection keeps the front the front.
fn copy_placed(soup: &mut Soup, mesh: &Soup, placement: &Placement) -> Result<()> {
    reserve(soup, &placement.name, [mesh.positions.len(), mesh.corners.len(), mesh.polygons()])?;
    let first = soup.positions.len() as u32;
    let object = soup.object(placement.name.as_str());
    soup.positions.extend(mesh.positions.iter().map(|&p| placement.transform.transform_point3(p)));
    let is_mirrored = placement.transform.matrix3.determinant() < 0.0;
    let place =
        |m: &SoupMaterial| soup.materials.iter().position(|own| own.name == m.name).unwrap_or(0) as u32;
    let materials: Vec<u32> = mesh.materials.iter().map(place).collect();
    for i in 0..mesh.polygons() {
        let mut corners: Vec<u32> = mesh.corners[mesh.span(i)].iter().map(|&v| first + v).collect();
        if is_mirrored {
            corners.reverse();
        }
        soup.indexed_polygon(object, materials[mesh.polygon_material[i] as usize], corners);
    }
    Ok(())
}
