//! Loading of scene files.

use super::{Scene, read_gltf, read_obj, read_ply, resolve};
use crate::{Error, Result};
use std::path::Path;

/// Properties that a file does not state or states wrongly.
#[derive(Clone, Debug)]
pub struct LoadOptions {
    /// Name of the unit of length; default `m`.
    pub unit: String,
    /// Objects, groups or materials that become emitters, with their total power in watts (per channel).
    pub emitters: Vec<(String, f64)>,
    /// Emissive faces emit from both sides; default: from the front only.
    pub two_sided_emission: bool,
    /// Overrides detection: 1: all faces bound solids, 2: all faces are sheets.
    pub sides: Option<u8>,
}

impl Default for LoadOptions {
    fn default() -> Self {
        LoadOptions { unit: "m".into(), emitters: Vec::new(), two_sided_emission: false, sides: None }
    }
}

impl Scene {
    /// Loads a scene; the extension of `path` selects the format: `obj`, `gltf`, `glb` or `ply`.
    ///
    /// Nodes of a glTF file that place the same mesh share it ([`Scene::placements`]), unless the mesh emits or a
    /// node's transform is more than 1 % off a similarity. A glTF file may have at most 2,097,152 nodes.
    ///
    /// # Errors
    /// The file cannot be read, has a wrong format, contains a value that is not finite or out of range, or has no
    /// face with an area; an emitter of the options does not exist. Repairable defects are repaired and counted in
    /// [`Scene::repairs`].
    pub fn load(path: &Path, options: &LoadOptions) -> Result<Scene> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let soup = match extension.as_str() {
            "obj" => read_obj::read(path)?,
            "gltf" | "glb" => return read_gltf::read(path, options),
            "ply" => read_ply::read(path)?,
            _ => {
                let what = "unknown kind of scene; the extension must be .obj, .gltf, .glb or .ply";
                // A wrong path is more likely than an unknown format.
                std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
                return Err(Error::format(path, None, what));
            }
        };
        resolve(soup, options)
    }
}
