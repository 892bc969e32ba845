//! Shared meshes and their placements.
//!
//! A mesh with several placements in a file is stored once ([`Scene::shared`]); each of its nodes is a [`Placement`](super::Placement).
//! Parts and sides are determined within the shared mesh: faces of different placements are never connected, so six
//! placements of a square that bound a box are six sheets.

use super::{
    LoadOptions, MAX_COORDINATE, MIN_EXTENT, PlacedSoup, Placement, Repairs, Scene,
    resolve::{resolve, resolve_mesh},
};
use crate::{Error, Result, error::quote, math::Aabb};
use glam::DAffine3;
use std::sync::Arc;

impl Scene {
    /// Number of triangles that block and receive light: the scene's own and those of each visible placement.
    #[doc(hidden)]
    pub fn visible_triangles(&self) -> u64 {
        let count = |p: &Placement| self.shared.get(p.mesh as usize).map_or(0, |m| m.triangles.len() as u64);
        let placed = self.placements.iter().filter(|p| p.visible).map(count);
        placed.fold(self.triangles.len() as u64, u64::saturating_add)
    }

    /// Box around the own triangles and the visible placements, relative to [`Scene::origin`], scene units; see
    /// [`Placement::bounds`] for how tight it is. Equal to [`Scene::bounds`] for a scene without placements.
    #[doc(hidden)]
    pub fn world_bounds(&self) -> Aabb {
        self.placed_bounds(self.bounds)
    }

    /// Union of a box and those of the visible placements.
    pub(super) fn placed_bounds(&self, own: Aabb) -> Aabb {
        let placed = self.placements.iter().filter(|p| p.visible);
        let boxes = placed.filter_map(|p| Some(p.bounds(self.shared.get(p.mesh as usize)?.bounds)));
        boxes.fold(own, Aabb::union)
    }

    /// The faces called `name` here or in a mesh of `placed` (names of placements with their meshes): the scene's own faces of
    /// this name; else all faces of the first placement of this name; else the faces of this name in the first mesh that has
    /// any. Also returns the place in `placed`, `None` for the scene's own faces.
    ///
    /// # Errors
    /// Nothing has this name; the message lists some names.
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn faces_named_placed<'a>(
        &'a self,
        placed: impl Iterator<Item = (&'a str, &'a Scene)> + Clone,
        name: &str,
    ) -> Result<(Option<usize>, Vec<u32>)> {
        let own = self.faces_with_name(name);
        if !own.is_empty() {
            return Ok((None, own));
        }
        if let Some((place, (_, mesh))) = placed.clone().enumerate().find(|(_, (n, _))| *n == name) {
            return Ok((Some(place), (0..mesh.triangles.len() as u32).collect()));
        }
        let mut searched = std::collections::HashSet::<*const Scene>::new();
        for (place, (_, mesh)) in placed.clone().enumerate() {
            // A mesh is searched once, however often it is placed.
            if !searched.insert(mesh) {
                continue;
            }
            let faces = mesh.faces_with_name(name);
            if !faces.is_empty() {
                return Ok((Some(place), faces));
            }
        }
        Err(super::names::unknown(name, self.names().chain(placed.map(|(name, _)| name))))
    }

    /// The names of the visible placements with their meshes.
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn placed(&self) -> impl Iterator<Item = (&str, &Scene)> + Clone {
        let visible = self.placements.iter().filter(|p| p.visible);
        visible.map(|p| (p.name.as_str(), self.shared[p.mesh as usize].as_ref()))
    }

    /// This scene, a shared mesh, where `transform` places it; a reflection keeps the front the front.
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn transformed(&self, transform: &DAffine3) -> Scene {
        let mirrored = transform.matrix3.determinant() < 0.0;
        let mut scene = self.clone();
        scene.positions.iter_mut().for_each(|p| *p = transform.transform_point3(p.as_dvec3()).as_vec3());
        if mirrored {
            scene.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
            scene.triangle_texcoords.iter_mut().for_each(|uv| uv.swap(1, 2));
        }
        scene.bounds = Aabb::of(scene.positions.iter().copied());
        scene
    }

    /// Largest absolute coordinate of what is visible, scene units: the scale of rounding errors.
    pub(crate) fn magnitude(&self) -> f32 {
        self.world_bounds().magnitude()
    }

    /// Adds shared meshes and their placements, whose transforms refer to coordinates of the file and become relative
    /// to the origins. Placements that shrink their mesh to a point are omitted and counted.
    pub(super) fn place(&mut self, shared: Vec<Scene>, placements: Vec<Placement>) -> Result<()> {
        let mut vanished = 0;
        for mut p in placements {
            let mesh = shared.get(p.mesh as usize).ok_or_else(|| {
                Error::Scene(format!("placement `{}` refers to a mesh that does not exist", quote(&p.name)))
            })?;
            let replaced = p.material.map(|m| self.materials.get(m as usize));
            if !mesh.emitters.is_empty() || replaced.is_some_and(|m| m.is_none_or(|m| m.emission != [0.0; 3]))
            {
                return Err(Error::Scene(format!(
                    "placement `{}` emits or has a material that does not exist: emitters must be triangles of the scene's \
                     own",
                    p.name
                )));
            }
            let from_mesh = DAffine3::from_translation(mesh.origin);
            p.transform = DAffine3::from_translation(-self.origin) * p.transform * from_mesh;
            let bounds = p.bounds(mesh.bounds);
            let farthest = bounds.magnitude();
            // A box of NaN corners is empty: its ends are infinite.
            if !p.transform.is_finite() || f64::from(farthest) > MAX_COORDINATE {
                let what = format!("not finite or beyond {MAX_COORDINATE:e}");
                let text =
                    format!("node `{}` places its mesh at coordinates that are {what}", quote(&p.name));
                return Err(Error::format(&self.path, None, text));
            }
            let min_extent = MIN_EXTENT.max(f64::from(f32::EPSILON * farthest));
            if f64::from(bounds.extent().max_element()) < min_extent {
                vanished += 1;
            } else {
                self.placements.push(p);
            }
        }
        if vanished > 0 {
            let what = "nodes scale their mesh to a size of zero: left out";
            self.repairs.messages.push(format!("{vanished} {what}"));
        }
        if !self.placements.is_empty() {
            self.shared = shared.into_iter().map(Arc::new).collect();
        }
        Ok(())
    }
}

/// Resolves a soup and each of its shared meshes.
///
/// # Errors
/// As [`Scene::load`], for the soup and for each mesh.
pub(crate) fn resolve_placed(placed: PlacedSoup, options: &LoadOptions) -> Result<Scene> {
    let PlacedSoup { mut soup, meshes, placements } = placed;
    let shared = meshes.into_iter().map(|m| resolve_mesh(m, options)).collect::<Result<Vec<_>>>()?;
    shared.iter().for_each(|m| soup.repairs.add_counts(&m.repairs));
    let mut scene = resolve(soup, options)?;
    scene.repairs.messages.extend(shared.iter().flat_map(|m| m.repairs.messages.iter().cloned()));
    scene.place(shared, placements)?;
    Ok(scene)
}

impl Repairs {
    /// Adds the counts of `other`, without its messages.
    pub(super) fn add_counts(&mut self, other: &Repairs) {
        // All fields are named, so that a new field does not compile before it is considered here.
        let Repairs {
            zero_area_faces,
            duplicate_faces,
            polygons_triangulated,
            concave_polygons,
            broken_polygons,
            welded_vertices,
            faces_without_material,
            missing_files,
            clamped_reflectances,
            unused_vertices,
            transparent_faces,
            overlapping_objects,
            copied_placements,
            divided_faces,
            messages: _,
        } = other;
        self.zero_area_faces += zero_area_faces;
        self.duplicate_faces += duplicate_faces;
        self.polygons_triangulated += polygons_triangulated;
        self.concave_polygons += concave_polygons;
        self.broken_polygons += broken_polygons;
        self.welded_vertices += welded_vertices;
        self.faces_without_material += faces_without_material;
        self.missing_files += missing_files;
        self.clamped_reflectances += clamped_reflectances;
        self.unused_vertices += unused_vertices;
        self.transparent_faces += transparent_faces;
        self.overlapping_objects += overlapping_objects;
        self.copied_placements += copied_placements;
        self.divided_faces += divided_faces;
    }
}
