//! glTF 2.0 and GLB: documents by the crate `gltf`; buffers are read here with every access checked, because the
//! crate's readers panic on invalid accessors.
//!
//! Nodes that place the same mesh share it (`sharing.rs`), including those of the extension
//! `EXT_mesh_gpu_instancing`. A file may have at most [`MAX_PLACEMENTS`] nodes, and as many placements.

mod accessors;
mod lights;
mod nodes;
mod primitives;
mod sharing;

use super::{
    LoadOptions, MAX_PLACEMENTS, Repairs, Scene, SoupMaterial, StoredCamera,
    names::UniqueNames,
    sources::{Sources, TextureKey},
    texture::Texture,
    up::from_y_to_z,
};
use crate::error::{in_words, quote, shown};
use crate::{Error, Result};
use base64::{Engine, engine::general_purpose::STANDARD};
use glam::DMat4;
use gltf::Gltf;
use serde::de::IgnoredAny;
use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Largest number of corners, whose indices alone take 2 GiB: a file of a few kilobytes can refer to one mesh very often.
const MAX_CORNERS: usize = 1 << 29;
/// Extension whose nodes place a mesh many times.
const GPU_INSTANCING: &str = "EXT_mesh_gpu_instancing";
/// Extension of materials that light passes through.
const TRANSMISSION: &str = "KHR_materials_transmission";

/// Reads a glTF or GLB file, of which `path` is the name: one object per node, coordinates as in the file (y up), or turned to the upward
/// axis z if height fields are added.
pub(super) fn read(path: &Path, bytes: &[u8], sources: &mut Sources, options: &LoadOptions) -> Result<Scene> {
    let (document, buffers) = open(path, bytes, sources)?;
    let (repairs, materials, cameras, lights) = Default::default();
    let mut reader = Reader { path, buffers, materials, cameras, lights, hard_spots: 0, repairs };
    reader.read_materials(&document, sources)?;
    let root = match options.added.has_grid {
        true => DMat4::from_mat3(from_y_to_z()),
        false => DMat4::IDENTITY,
    };
    let mut nodes = reader.nodes(&document, &nodes::transforms(json_of(bytes)), root)?;
    sharing::scene(&mut reader, &document, &mut nodes, options)
}

/// The checked document, and the bytes of its buffers.
fn open(path: &Path, bytes: &[u8], sources: &mut Sources) -> Result<(gltf::Document, Vec<Arc<Vec<u8>>>)> {
    let wrong = |what: String| Error::format(path, None, what);
    if bytes.starts_with(b"glTF") {
        let length = bytes.get(8..12).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
        if length.is_none_or(|l| l < 12 || l as usize > bytes.len()) {
            return Err(wrong(
                "the GLB header states a length that the file does not have: it is cut off".into(),
            ));
        }
    }
    let nodes = count_nodes(bytes);
    if nodes > MAX_PLACEMENTS {
        return Err(wrong(format!(
            "{nodes} nodes, more than {MAX_PLACEMENTS}: join meshes that belong together or split the scene"
        )));
    }
    let unusable =
        |e: gltf::Error| wrong(format!("not a usable glTF file: {}", quote(&in_words(&e.to_string()))));
    let Gltf { document, mut blob } = Gltf::from_slice_without_validation(bytes).map_err(unusable)?;
    // The crate's validation panics on a mesh whose accessor does not exist, so that is checked first.
    let mut json = document.into_json();
    let primitives = json.meshes.iter().flat_map(|m| &m.primitives);
    if primitives.flat_map(|p| p.attributes.values()).any(|a| a.value() >= json.accessors.len()) {
        return Err(wrong("a mesh refers to an accessor that does not exist".into()));
    }
    // The crate rejects files that require an unknown extension; this one is supported here.
    json.extensions_required.retain(|e| e != GPU_INSTANCING);
    let document = gltf::Document::from_json(json).map_err(unusable)?;
    let mut buffers = Vec::new();
    // Buffers with one URI share its bytes.
    let mut by_uri = HashMap::<&str, Arc<Vec<u8>>>::new();
    for buffer in document.buffers() {
        let data = match buffer.source() {
            gltf::buffer::Source::Bin => {
                blob.take().ok_or_else(|| wrong("the GLB has no binary chunk".into()))?.into()
            }
            gltf::buffer::Source::Uri(uri) => match by_uri.get(uri) {
                Some(data) => data.clone(),
                None => by_uri.entry(uri).or_insert(resource(path, uri, sources)?.into()).clone(),
            },
        };
        buffers.push(data);
    }
    drop(by_uri);
    Ok((document, buffers))
}

/// Number of nodes, counted without building them; 0 if the file is too short for too many or is not JSON (reported
/// elsewhere).
fn count_nodes(bytes: &[u8]) -> usize {
    /// Ignored items take no memory.
    #[derive(serde::Deserialize)]
    struct Root {
        nodes: Vec<IgnoredAny>,
    }
    // The shortest node is `{}` and a comma.
    if bytes.len() < 3 * MAX_PLACEMENTS {
        return 0;
    }
    serde_json::from_slice(json_of(bytes)).map_or(0, |root: Root| root.nodes.len())
}

/// The JSON text of a file; empty if a GLB is too short.
fn json_of(bytes: &[u8]) -> &[u8] {
    if !bytes.starts_with(b"glTF") {
        return bytes;
    }
    let length = bytes.get(12..16).and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes);
    bytes.get(20..20 + length as usize).unwrap_or_default()
}

/// Bytes of a URI: `data:`, or a file whose place is relative to the scene's.
fn resource(path: &Path, uri: &str, sources: &mut Sources) -> Result<Vec<u8>> {
    let wrong = |what: String| Error::format(path, None, what);
    if let Some(data) = uri.strip_prefix("data:") {
        let encoded =
            data.split_once(";base64,").ok_or_else(|| wrong("a data URI that is not base64".into()))?.1;
        return STANDARD.decode(encoded).map_err(|e| wrong(format!("a data URI that is damaged: {e}")));
    }
    if uri.contains(':') {
        return Err(wrong(format!("`{}`: only files are read", quote(uri))));
    }
    let file = file_of(path, uri);
    sources.bytes(&file).map_err(|e| match e {
        Error::Io { source, .. } => wrong(format!("{}: {source}", shown(&file))),
        other => other,
    })
}

/// The file of a URI that is relative to the scene's place.
fn file_of(path: &Path, uri: &str) -> PathBuf {
    path.with_file_name("").join(percent_decoded(uri))
}

fn percent_decoded(uri: &str) -> String {
    let (mut out, mut rest) = (Vec::new(), uri.as_bytes());
    while let Some((&byte, tail)) = rest.split_first() {
        let hex = tail.get(..2).and_then(|h| std::str::from_utf8(h).ok());
        match hex.and_then(|h| u8::from_str_radix(h, 16).ok()).filter(|_| byte == b'%') {
            Some(code) => {
                out.push(code);
                rest = &tail[2..];
            }
            None => {
                out.push(byte);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}

struct Reader<'a> {
    path: &'a Path,
    buffers: Vec<Arc<Vec<u8>>>,
    /// All materials of the file in order, then the substitute for faces without one.
    materials: Vec<SoupMaterial>,
    cameras: Vec<StoredCamera>,
    lights: Vec<lights::PlacedLight>,
    /// Spot lights without a gradual edge.
    hard_spots: usize,
    repairs: Repairs,
}

impl Reader<'_> {
    fn wrong(&self, what: impl Into<String>) -> Error {
        Error::format(self.path, None, what)
    }

    /// Fills the table of materials.
    fn read_materials(&mut self, document: &gltf::Document, sources: &mut Sources) -> Result<()> {
        let (mut emissive_textures, mut transmitting, mut names) = (0, 0, UniqueNames::default());
        let images = image_keys(self.path, document);
        for material in document.materials() {
            let pbr = material.pbr_metallic_roughness();
            let [r, g, b, a] = pbr.base_color_factor();
            let name = names.of(material.name().unwrap_or("material"));
            let strength = material.emissive_strength().unwrap_or(1.0);
            let image = pbr.base_color_texture().map(|t| t.texture().source());
            let texture = image.map(|i| self.texture(&i, &images, sources)).transpose()?.flatten();
            emissive_textures += usize::from(material.emissive_texture().is_some());
            let transmission =
                material.extension_value(TRANSMISSION).and_then(|t| t.get("transmissionFactor"));
            transmitting += usize::from(transmission.and_then(|f| f.as_f64()).is_some_and(|f| f > 0.0));
            self.materials.push(SoupMaterial {
                emission: material.emissive_factor().map(|e| e * strength),
                opacity: if material.alpha_mode() == gltf::material::AlphaMode::Opaque { 1.0 } else { a },
                texture,
                ..SoupMaterial::diffuse(name, [r, g, b])
            });
        }
        if emissive_textures > 0 {
            let what = "emissive textures are not read: these materials emit evenly";
            self.repairs.messages.push(format!("{emissive_textures} {what}"));
        }
        if transmitting > 0 {
            let what =
                "materials transmit light in the file (KHR_materials_transmission): they are opaque here";
            self.repairs.messages.push(format!("{transmitting} {what}"));
        }
        self.materials.push(SoupMaterial::missing("(none)"));
        Ok(())
    }

    /// The decoded image; `keys` are those of all images.
    fn texture(
        &mut self,
        image: &gltf::Image,
        keys: &HashMap<usize, TextureKey>,
        sources: &mut Sources,
    ) -> Result<Option<Texture>> {
        let Reader { path, buffers, repairs, .. } = self;
        let key = &keys[&image.index()];
        sources.texture(path, key, repairs, |sources| match (key, image.source()) {
            (TextureKey::File(file), _) => sources.bytes(file),
            (_, gltf::image::Source::Uri { uri, .. }) => resource(path, uri, sources),
            (_, gltf::image::Source::View { view, .. }) => {
                let end = view.offset().checked_add(view.length());
                let range = end.and_then(|end| buffers.get(view.buffer().index())?.get(view.offset()..end));
                let outside = || Error::format(*path, None, "a texture lies outside its buffer");
                range.map(<[u8]>::to_vec).ok_or_else(outside)
            }
        })
    }
}

/// The place of the encoded bytes of each image that a material has, by its index. Images of the same file, the same bytes of a buffer
/// or the same `data:` URI have the same place.
fn image_keys(path: &Path, document: &gltf::Document) -> HashMap<usize, TextureKey> {
    #[derive(PartialEq, Eq, Hash)]
    enum Inside<'a> {
        Uri(&'a str),
        /// Buffer, first byte and number of bytes.
        View(usize, usize, usize),
    }
    let (mut keys, mut first) = (HashMap::new(), HashMap::new());
    for material in document.materials() {
        let Some(texture) = material.pbr_metallic_roughness().base_color_texture() else { continue };
        let image = texture.texture().source();
        let number = image.index();
        keys.entry(number).or_insert_with(|| match image.source() {
            gltf::image::Source::Uri { uri, .. } if !uri.contains(':') => {
                TextureKey::File(file_of(path, uri))
            }
            gltf::image::Source::Uri { uri, .. } => {
                TextureKey::Image(*first.entry(Inside::Uri(uri)).or_insert(number))
            }
            gltf::image::Source::View { view, .. } => {
                let place = Inside::View(view.buffer().index(), view.offset(), view.length());
                TextureKey::Image(*first.entry(place).or_insert(number))
            }
        });
    }
    keys
}
