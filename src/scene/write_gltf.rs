//! Output of a soup with placed meshes as glTF 2.0: one `.glb`, or one `.gltf` with an embedded buffer.
//!
//! Coordinates are written unchanged. In glTF y is up, so viewers show scenes with z up lying on their side without
//! [`PlacedSoup::with_y_up`]. Textures are not written.

use super::{PlacedSoup, Soup, SoupMaterial, up::from_y_to_z};
use crate::{Error, Result, error::quote, files::WholeFile, math::Aabb};
use base64::{Engine, engine::general_purpose::STANDARD};
use glam::{DAffine3, Vec3};
use gltf::binary::{Glb, Header};
use gltf::json::accessor::{FLOAT, UNSIGNED_INT};
use gltf::json::buffer::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER};
use serde_json::{Value, json};
use std::{borrow::Cow, collections::HashMap, io::Write, path::Path};

impl PlacedSoup {
    /// A scene whose upward axis is z with the upward axis y of glTF files.
    pub fn with_y_up(mut self) -> PlacedSoup {
        let turn = DAffine3::from_mat3(from_y_to_z().inverse());
        self.soup.positions.iter_mut().for_each(|p| *p = turn.transform_point3(*p));
        self.placements.iter_mut().for_each(|p| p.transform = turn * p.transform);
        self
    }
}

/// Writes `placed` to `path`: binary if its extension is `glb`, otherwise text with the buffer in base64. Each object
/// of the soup becomes a node with a mesh, each placed mesh is written once, each visible placement becomes a node.
/// Positions are rounded to f32. Polygons must be convex: they are written as fans of triangles. `generator` names
/// the program. The file is written completely or not at all.
///
/// # Errors
/// The file cannot be written; the buffer exceeds the 4 GiB of the format; a placement has a material of its own or
/// refers to a mesh that does not exist.
pub fn write_gltf(path: &Path, placed: &PlacedSoup, generator: &str) -> Result<()> {
    let mut out = Output::default();
    let mut nodes = Vec::new();
    let soup = &placed.soup;
    let mut order: Vec<usize> = (0..soup.polygons()).collect();
    order.sort_by_key(|&i| soup.polygon_object[i]);
    for polygons in order.chunk_by(|&a, &b| soup.polygon_object[a] == soup.polygon_object[b]) {
        let name = &soup.objects[soup.polygon_object[polygons[0]] as usize];
        let mesh = out.mesh(name, soup, polygons);
        nodes.push(GltfNode { name, mesh, matrix: None });
    }
    let meshes: Vec<usize> = placed.meshes.iter().map(|mesh| out.whole_mesh(mesh)).collect();
    for p in placed.placements.iter().filter(|p| p.visible) {
        let wrong = |what: &str| Error::Scene(format!("placement `{}` {what}", quote(&p.name)));
        if p.material.is_some() {
            return Err(wrong("has a material of its own, which glTF files cannot hold"));
        }
        let mesh =
            meshes.get(p.mesh as usize).ok_or_else(|| wrong("refers to a mesh that does not exist"))?;
        let matrix = glam::DMat4::from(p.transform).to_cols_array();
        nodes.push(GltfNode { name: &p.name, mesh: *mesh, matrix: Some(matrix) });
    }
    out.write(path, nodes, generator)
}

/// JSON of the file. Nodes have a type of their own: there may be millions, and a `serde_json` value takes 3 KB.
#[derive(serde::Serialize)]
struct Root<'a> {
    asset: Value,
    #[serde(rename = "extensionsUsed", skip_serializing_if = "Vec::is_empty")]
    extensions: Vec<&'a str>,
    scene: u32,
    scenes: [SceneNodes; 1],
    nodes: Vec<GltfNode<'a>>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    accessors: Vec<Value>,
    #[serde(rename = "bufferViews")]
    views: Value,
    buffers: [Value; 1],
}

#[derive(serde::Serialize)]
struct SceneNodes {
    nodes: Vec<usize>,
}

#[derive(serde::Serialize)]
struct GltfNode<'a> {
    name: &'a str,
    mesh: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    matrix: Option<[f64; 16]>,
}

const EMISSIVE_STRENGTH: &str = "KHR_materials_emissive_strength";

/// Contents of a file under construction.
#[derive(Default)]
struct Output {
    positions: Vec<Vec3>,
    indices: Vec<u32>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    /// Index of each material by its JSON.
    known: HashMap<String, usize>,
}

impl Output {
    /// Adds all polygons of `soup` as one mesh with the name of the first object; its index.
    fn whole_mesh(&mut self, soup: &Soup) -> usize {
        let polygons: Vec<usize> = (0..soup.polygons()).collect();
        self.mesh(soup.objects.first().map_or("mesh", String::as_str), soup, &polygons)
    }

    /// Adds these polygons as one mesh with a primitive per material; its index.
    fn mesh(&mut self, name: &str, soup: &Soup, polygons: &[usize]) -> usize {
        let mut order = polygons.to_vec();
        order.sort_by_key(|&i| soup.polygon_material[i]);
        let runs = order.chunk_by(|&a, &b| soup.polygon_material[a] == soup.polygon_material[b]);
        let primitives: Vec<Value> = runs.map(|run| self.primitive(soup, run)).collect();
        self.meshes.push(json!({ "name": name, "primitives": primitives }));
        self.meshes.len() - 1
    }

    /// Polygons of one material.
    fn primitive(&mut self, soup: &Soup, polygons: &[usize]) -> Value {
        let (first, first_index) = (self.positions.len(), self.indices.len());
        let mut place = HashMap::new();
        let mut corners = Vec::new();
        for &i in polygons {
            corners.clear();
            corners.extend(soup.corners[soup.span(i)].iter().map(|&v| {
                *place.entry(v).or_insert_with(|| {
                    self.positions.push(soup.positions[v as usize].as_vec3());
                    (self.positions.len() - 1 - first) as u32
                })
            }));
            for k in 1..corners.len().saturating_sub(1) {
                self.indices.extend([corners[0], corners[k], corners[k + 1]]);
            }
        }
        let bounds = Aabb::of(self.positions[first..].iter().copied());
        self.accessors.push(json!({
            "bufferView": 0, "byteOffset": 12 * first, "componentType": FLOAT, "type": "VEC3",
            "count": self.positions.len() - first, "min": bounds.min.to_array(), "max": bounds.max.to_array(),
        }));
        self.accessors.push(json!({
            "bufferView": 1, "byteOffset": 4 * first_index, "componentType": UNSIGNED_INT, "type": "SCALAR",
            "count": self.indices.len() - first_index,
        }));
        let material = self.material(&soup.materials[soup.polygon_material[polygons[0]] as usize]);
        let accessor = self.accessors.len() - 2;
        json!({ "attributes": { "POSITION": accessor }, "indices": accessor + 1, "material": material })
    }

    /// Index of a material; equal ones are written once.
    fn material(&mut self, m: &SoupMaterial) -> usize {
        let [r, g, b] = m.reflectance;
        let mut value = json!({
            "name": m.name, "doubleSided": true,
            "pbrMetallicRoughness": {
                "baseColorFactor": [r, g, b, m.opacity], "metallicFactor": 0.0, "roughnessFactor": 1.0,
            },
        });
        if m.opacity < 1.0 {
            value["alphaMode"] = json!("BLEND");
        }
        if m.emission != [0.0; 3] {
            // The factor is at most 1; the extension has the rest.
            let strength = m.emission.into_iter().fold(1.0, f32::max);
            value["emissiveFactor"] = json!(m.emission.map(|e| e / strength));
            value["extensions"] = json!({ EMISSIVE_STRENGTH: { "emissiveStrength": strength } });
        }
        let next = self.materials.len();
        let number = *self.known.entry(value.to_string()).or_insert(next);
        if number == next {
            self.materials.push(value);
        }
        number
    }

    fn write(self, path: &Path, nodes: Vec<GltfNode>, generator: &str) -> Result<()> {
        let (positions, indices): (&[u8], &[u8]) =
            (bytemuck::cast_slice(&self.positions), bytemuck::cast_slice(&self.indices));
        let binary = [positions, indices].concat();
        let views = json!([
            { "buffer": 0, "byteLength": positions.len(), "target": ARRAY_BUFFER },
            { "buffer": 0, "byteOffset": positions.len(), "byteLength": indices.len(), "target": ELEMENT_ARRAY_BUFFER },
        ]);
        let as_text = !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
        let mut buffer = json!({ "byteLength": binary.len() });
        if as_text {
            let data = STANDARD.encode(&binary);
            buffer["uri"] = json!(format!("data:application/octet-stream;base64,{data}"));
        }
        let emissive = self.known.keys().any(|m| m.contains(EMISSIVE_STRENGTH));
        let root = Root {
            asset: json!({ "version": "2.0", "generator": generator }),
            extensions: if emissive { vec![EMISSIVE_STRENGTH] } else { Vec::new() },
            scene: 0,
            scenes: [SceneNodes { nodes: (0..nodes.len()).collect() }],
            nodes,
            meshes: self.meshes,
            materials: self.materials,
            accessors: self.accessors,
            views,
            buffers: [buffer],
        };
        let json = serde_json::to_vec(&root).map_err(|e| Error::format(path, None, e.to_string()))?;
        let mut file = WholeFile::create(path)?;
        if as_text {
            file.write_all(&json).map_err(|e| Error::io(path, e))?;
            return file.commit();
        }
        write_glb(path, &mut file, [json, binary], "more than the 4 GiB that the format has room for")?;
        file.commit()
    }
}

/// Writes a binary glTF 2.0 file, the one at `path`, to `out`: its JSON text and its buffer.
///
/// # Errors
/// The file cannot be written; it exceeds the 4 GiB of the format, which the message `too_large` says.
pub fn write_glb(path: &Path, out: impl Write, [json, binary]: [Vec<u8>; 2], too_large: &str) -> Result<()> {
    let length = u32::try_from(json.len() + binary.len() + 64);
    let length = length.map_err(|_| Error::format(path, None, too_large))?;
    let header = Header { magic: *b"glTF", version: 2, length };
    let glb = Glb { header, json: Cow::Owned(json), bin: Some(Cow::Owned(binary)) };
    glb.to_writer(out).map_err(|e| match e {
        gltf::Error::Io(e) => Error::io(path, e),
        other => Error::format(path, None, other.to_string()),
    })
}
