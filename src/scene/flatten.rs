//! Conversion of placements to triangles.

use super::names::counted;
use super::{Material, Object, Placement, Scene, compact::drop_unused, faces::has_area, stack::StackMove};
use crate::{Error, Result, error::quote, math::Aabb};
use std::collections::HashMap;
use std::ops::Range;

/// Largest number of triangles of a flattened scene: arrays stay below 2^33 entries, and indices of corners fit into
/// u32.
pub const MAX_FLATTENED_TRIANGLES: u64 = 1 << 31;

/// The triangles of one instance in a flattened scene.
#[derive(Clone, Debug, PartialEq)]
pub struct InstanceTriangles {
    /// Its triangles, indices into [`Scene::triangles`]; empty if the instance is hidden.
    pub triangles: Range<u32>,
    /// Number of its first triangle among those of all instances. Hidden instances and dropped triangles count, so that numbers do
    /// not change when other instances move, hide or appear.
    pub first_number: u64,
}

impl Scene {
    /// The triangles of each instance: the scene's own first, then those of the placements that [`Scene::flattened`] copied.
    pub(crate) fn triangles_of_instances(&self) -> Vec<InstanceTriangles> {
        if !self.instances.is_empty() {
            return self.instances.clone();
        }
        vec![InstanceTriangles { triangles: 0..self.triangles.len() as u32, first_number: 0 }]
    }

    /// The same scene without placements: each visible placement becomes an object, after the scene's own objects and
    /// in the order of the placements. Hidden placements are omitted. A scene without placements is copied. For
    /// [`Model::solve`](crate::Model::solve) and [`Model::form_factors`](crate::Model::form_factors), which need triangles of the
    /// scene's own.
    ///
    /// Vertices are transformed in f64 and stored as f32 relative to the origin, which does not change. A
    /// mirroring transform reverses the orientation of faces, so that outsides stay outside. Vertices of different
    /// placements are not merged, and parts stay as they are in each shared mesh. Triangles that lose their area by
    /// rounding are dropped and counted. Materials of shared meshes are appended once, except those that the scene
    /// has already (equal name, reflectance and emission).
    ///
    /// # Errors
    /// The result would have more than `max_triangles` or 2³¹; a placement refers to a mesh or material that
    /// does not exist, has a material that emits, or a transform that is not finite.
    pub fn flattened(&self, max_triangles: u64) -> Result<Scene> {
        let max = max_triangles.min(MAX_FLATTENED_TRIANGLES);
        self.check_size(max)?;
        let instances = self.triangles_of_instances();
        let scene = Scene { shared: Vec::new(), placements: Vec::new(), instances, ..self.clone() };
        let polygons = scene.triangle_polygon.last().map_or(0, |&p| p + 1);
        let mut flat = Flat { scene, materials: Vec::new(), polygons };
        flat.merge_materials(self);
        let mut first_number = self.triangles.len() as u64;
        for p in &self.placements {
            let (mesh, start) = (&self.shared[p.mesh as usize], flat.scene.triangles.len() as u32);
            if p.visible {
                flat.append(mesh, p)?;
            }
            let triangles = start..flat.scene.triangles.len() as u32;
            flat.scene.instances.push(InstanceTriangles { triangles, first_number });
            first_number += mesh.triangles.len() as u64;
        }
        let dropped = flat.scene.repairs.zero_area_faces - self.repairs.zero_area_faces;
        if dropped > 0 {
            let what = "triangles of placed meshes left out: after rounding of their coordinates (32 bits) they have no area";
            flat.scene.repairs.messages.push(format!("{dropped} {what}"));
        }
        Ok(flat.scene)
    }

    /// Checks the limits, and that placements refer to existing meshes and materials.
    fn check_size(&self, max: u64) -> Result<()> {
        let (mut vertices, mut polygons) = (self.positions.len() as u64, 0u64);
        polygons += self.triangle_polygon.last().map_or(0, |&p| u64::from(p) + 1);
        for p in self.placements.iter().filter(|p| p.visible) {
            let wrong = |what: &str| Error::Scene(format!("placement `{}` {what}", quote(&p.name)));
            let mesh = self
                .shared
                .get(p.mesh as usize)
                .ok_or_else(|| wrong("refers to a mesh that does not exist"))?;
            if !mesh.placements.is_empty() || !mesh.emitters.is_empty() {
                return Err(wrong("refers to a mesh that emits or has placements of its own"));
            }
            let replaced = p.material.map(|m| self.materials.get(m as usize));
            match replaced {
                Some(None) => return Err(wrong("refers to a material that does not exist")),
                Some(Some(m)) if m.emission != [0.0; 3] => {
                    return Err(wrong("has a material that emits: emitters must be triangles of the scene"));
                }
                _ => {}
            }
            vertices = vertices.saturating_add(mesh.positions.len() as u64);
            polygons = polygons.saturating_add(mesh.triangle_polygon.last().map_or(0, |&p| u64::from(p) + 1));
        }
        let (triangles, indices) = (self.visible_triangles(), u64::from(u32::MAX));
        if !self.placements.is_empty() && (triangles > max || vertices > indices || polygons > indices) {
            return Err(Error::Scene(format!(
                "{} of {} would become {triangles} triangles with {vertices} vertices, more than \
                 ⟨max_triangles⟩ {max} or {indices} vertices: place fewer or simplify the meshes",
                counted(self.placements.len(), "placement"),
                if self.shared.len() == 1 {
                    "1 mesh".into()
                } else {
                    format!("{} meshes", self.shared.len())
                },
            )));
        }
        Ok(())
    }
}

/// A flattened scene under construction.
struct Flat {
    scene: Scene,
    /// For each shared mesh, the indices of its materials in the table of the scene.
    materials: Vec<Vec<u32>>,
    /// Number of polygons so far.
    polygons: u32,
}

impl Flat {
    fn merge_materials(&mut self, from: &Scene) {
        type Key = (String, [u32; 3], [u32; 3]);
        let key = |m: &Material| -> Key {
            (m.name.clone(), m.reflectance.map(f32::to_bits), m.emission.map(f32::to_bits))
        };
        let table = &mut self.scene.materials;
        let mut known: HashMap<Key, u32> = HashMap::new();
        for (i, m) in table.iter().enumerate() {
            known.entry(key(m)).or_insert(i as u32);
        }
        for mesh in &from.shared {
            let places = mesh.materials.iter().map(|m| {
                *known.entry(key(m)).or_insert_with(|| {
                    table.push(m.clone());
                    table.len() as u32 - 1
                })
            });
            self.materials.push(places.collect());
        }
    }

    /// Adds the triangles of one placement.
    fn append(&mut self, mesh: &Scene, p: &Placement) -> Result<()> {
        let s = &mut self.scene;
        let first = s.positions.len();
        s.positions
            .extend(mesh.positions.iter().map(|q| p.transform.transform_point3(q.as_dvec3()).as_vec3()));
        if !s.positions[first..].iter().all(|q| q.is_finite()) {
            return Err(Error::Scene(format!(
                "placement `{}` moves vertices to coordinates that are not finite",
                quote(&p.name)
            )));
        }
        let determinant = p.transform.matrix3.determinant();
        let (mirrored, scale) = (determinant < 0.0, determinant.abs().cbrt() as f32);
        let turn = |[a, b, c]: [u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        let (object, part) = (s.objects.len() as u32, (s.closed_parts + s.sheet_parts) as u32);
        let textured = !mesh.triangle_texcoords.is_empty();
        if textured {
            s.triangle_texcoords.resize(s.triangles.len(), Default::default());
        }
        let mut dropped = 0;
        for (t, &corners) in mesh.triangles.iter().enumerate() {
            let corners = turn(corners).map(|v| v + first as u32);
            if !has_area(corners.map(|v| s.positions[v as usize])) {
                dropped += 1;
                continue;
            }
            if let Some(&StackMove { largest, by }) = mesh.stack_moves.get(&(t as u32)) {
                let by = p.transform.transform_vector3(by.as_dvec3()).as_vec3();
                s.stack_moves.insert(s.triangles.len() as u32, StackMove { largest: scale * largest, by });
            }
            let own_part = mesh.triangle_component[t];
            if mesh.wound_parts.contains(&own_part) {
                s.wound_parts.insert(part + own_part);
            }
            s.triangles.push(corners);
            s.triangle_object.push(object);
            let own = self.materials[p.mesh as usize][mesh.triangle_material[t] as usize];
            s.triangle_material.push(p.material.unwrap_or(own));
            s.triangle_polygon.push(self.polygons + mesh.triangle_polygon[t]);
            let replaced = p.material.map(|m| s.materials[m as usize].reflectance);
            s.triangle_reflectance.push(replaced.unwrap_or(mesh.triangle_reflectance[t]));
            s.triangle_sides.push(mesh.triangle_sides[t]);
            s.triangle_component.push(part + own_part);
            s.triangle_emitter.push(u32::MAX);
            if textured {
                let uv = mesh.triangle_texcoords[t];
                s.triangle_texcoords.push(if mirrored { [uv[0], uv[2], uv[1]] } else { uv });
            }
        }
        if !textured && !s.triangle_texcoords.is_empty() {
            s.triangle_texcoords.resize(s.triangles.len(), Default::default());
        }
        s.objects.push(Object { name: p.name.clone() });
        s.closed_parts += mesh.closed_parts;
        s.sheet_parts += mesh.sheet_parts;
        if dropped > 0 {
            s.repairs.zero_area_faces += dropped;
            let start = s.triangles.len() + dropped - mesh.triangles.len();
            drop_unused(&mut s.positions, &mut s.triangles[start..], first);
        }
        s.bounds = s.bounds.union(Aabb::of(s.positions[first..].iter().copied()));
        self.polygons += mesh.triangle_polygon.last().map_or(0, |&p| p + 1);
        Ok(())
    }
}
