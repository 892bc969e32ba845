//! Binary glTF.

use super::{Mesh, Tone};
use crate::image_io::Stoppable;
use crate::math::Aabb;
use crate::math::parallel;
use crate::progress::Progress;
use crate::scene::{UpAxis, write_glb as write_parts};
use crate::{Result, files::WholeFile};
use gltf::json::accessor::{FLOAT, UNSIGNED_INT};
use gltf::json::buffer::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER};
use serde_json::json;
use std::path::Path;

/// Writes a mesh as binary glTF 2.0, with linear vertex colours by `tone` and an unlit material
/// (`KHR_materials_unlit`). Coordinates are relative to the solution's origin, which is in the node's `extras`; the node
/// turns a scene whose `up` is z, because y is up in glTF.
///
/// # Errors
/// The file cannot be written, the mesh exceeds the 4 GiB of the format, or `progress` has stopped.
pub fn write_glb(
    path: &Path,
    mesh: &Mesh,
    origin: glam::DVec3,
    up: UpAxis,
    tone: Tone,
    progress: &dyn Progress,
) -> Result<()> {
    let colours: Vec<[f32; 3]> = parallel::map(&mesh.radiosity, |&r| tone.linear(r));
    let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
    let normals: Vec<[f32; 3]> = mesh.normals.iter().map(|n| n.to_array()).collect();
    let parts: [&[u8]; 4] = [
        bytemuck::cast_slice(&positions),
        bytemuck::cast_slice(&normals),
        bytemuck::cast_slice(&colours),
        bytemuck::cast_slice(&mesh.triangles),
    ];
    let mut views = Vec::new();
    let mut binary: Vec<u8> = Vec::new();
    for (i, part) in parts.iter().enumerate() {
        let target = if i == 3 { ELEMENT_ARRAY_BUFFER } else { ARRAY_BUFFER };
        views.push(
            json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": part.len(), "target": target }),
        );
        binary.extend_from_slice(part);
    }
    let vertices = positions.len();
    let bounds = Aabb::of(mesh.positions.iter().copied());
    let vector = |view: usize| json!({ "bufferView": view, "componentType": FLOAT, "count": vertices, "type": "VEC3" });
    let mut place = vector(0);
    place["min"] = json!(bounds.min.to_array());
    place["max"] = json!(bounds.max.to_array());
    let mut node = json!({ "mesh": 0, "extras": { "origin": origin.to_array() } });
    if up == UpAxis::Z {
        // A quarter turn about x, from z to y.
        node["rotation"] =
            json!([-std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2]);
    }
    let root = json!({
        "asset": { "version": "2.0", "generator": concat!("mrvis ", env!("CARGO_PKG_VERSION")) },
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [node],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0, "NORMAL": 1, "COLOR_0": 2 }, "indices": 3, "material": 0
        }] }],
        "materials": [{
            "name": "radiosity", "extensions": { "KHR_materials_unlit": {} },
            "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 }
        }],
        "accessors": [place, vector(1), vector(2), {
            "bufferView": 3, "componentType": UNSIGNED_INT, "count": 3 * mesh.triangles.len(), "type": "SCALAR"
        }],
        "bufferViews": views,
        "buffers": [{ "byteLength": binary.len() }],
    });
    let mut file = WholeFile::create(path)?;
    let out = Stoppable { out: &mut file, progress };
    let parts = [root.to_string().into_bytes(), binary];
    write_parts(path, out, parts, "more than 4 GiB: write .ply instead")?;
    file.commit()
}
