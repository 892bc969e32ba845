//! glTF 2.0 and GLB: the document through the crate `gltf`; buffers are read here, with every access checked,
//! because the crate's own readers panic on accessors that lie.

use super::{Soup, SoupMaterial, StoredCamera, texture::Texture};
use crate::{Error, Result};
use base64::{Engine, engine::general_purpose::STANDARD};
use glam::{DMat4, DVec3};
use gltf::{
    Accessor, Gltf, Node, Primitive,
    accessor::{DataType, Dimensions},
    mesh::{Mode, Semantic},
};
use std::{collections::HashMap, path::Path};

/// More corners than this are refused: a file of a few kilobytes can refer to one mesh very often.
const MAX_CORNERS: usize = 1 << 29;

/// Reads a glTF or GLB file: one object a node, coordinates as in the file (glTF is y up).
pub(super) fn read(path: &Path) -> Result<Soup> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    let wrong = |what: String| Error::format(path, None, what);
    if bytes.starts_with(b"glTF") {
        let length = bytes.get(8..12).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
        if length.is_none_or(|l| l < 12 || l as usize > bytes.len()) {
            return Err(wrong(
                "the GLB header states a length that the file does not have: it is cut off".into(),
            ));
        }
    }
    let unusable = |e: gltf::Error| wrong(format!("not a usable glTF file: {e}"));
    let Gltf { document, mut blob } = Gltf::from_slice_without_validation(&bytes).map_err(unusable)?;
    // The crate's validation panics on a mesh whose accessor does not exist: that is looked for first.
    let json = document.into_json();
    let primitives = json.meshes.iter().flat_map(|m| &m.primitives);
    if primitives.flat_map(|p| p.attributes.values()).any(|a| a.value() >= json.accessors.len()) {
        return Err(wrong("a mesh refers to an accessor that does not exist".into()));
    }
    let document = gltf::Document::from_json(json).map_err(unusable)?;
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let data = match buffer.source() {
            gltf::buffer::Source::Bin => {
                blob.take().ok_or_else(|| wrong("the GLB has no binary chunk".into()))?
            }
            gltf::buffer::Source::Uri(uri) => resource(path, uri).map_err(wrong)?,
        };
        buffers.push(data);
    }
    let (names, camera_names) = Default::default();
    let mut reader = Reader { path, buffers, soup: Soup::new(path), names, camera_names };
    reader.materials(&document);
    reader.nodes(&document)?;
    Ok(reader.soup)
}

/// Bytes behind a URI: `data:` or a file beside `path`; the reason as one phrase if there are none.
fn resource(path: &Path, uri: &str) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let encoded = data.split_once(";base64,").ok_or("a data URI that is not base64")?.1;
        return STANDARD.decode(encoded).map_err(|e| format!("a data URI that is damaged: {e}"));
    }
    if uri.contains(':') {
        return Err(format!("`{}`: only files beside the scene are read", super::mtl::shorten(uri, 40)));
    }
    let file = path.with_file_name("").join(percent_decoded(uri));
    std::fs::read(&file).map_err(|e| format!("{}: {e}", file.display()))
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
    buffers: Vec<Vec<u8>>,
    soup: Soup,
    names: UniqueNames,
    camera_names: UniqueNames,
}

impl Reader<'_> {
    fn wrong(&self, what: impl Into<String>) -> Error {
        Error::format(self.path, None, what)
    }

    /// All materials in order, then the stand-in for faces that have none.
    fn materials(&mut self, document: &gltf::Document) {
        let mut emissive_textures = 0;
        for material in document.materials() {
            let pbr = material.pbr_metallic_roughness();
            let [r, g, b, a] = pbr.base_color_factor();
            let name = self.names.of(material.name().unwrap_or("material"));
            let strength = material.emissive_strength().unwrap_or(1.0);
            let texture = pbr.base_color_texture().and_then(|t| self.texture(t.texture().source().source()));
            emissive_textures += usize::from(material.emissive_texture().is_some());
            self.soup.material(SoupMaterial {
                emission: material.emissive_factor().map(|e| e * strength),
                opacity: if material.alpha_mode() == gltf::material::AlphaMode::Opaque { 1.0 } else { a },
                texture,
                ..SoupMaterial::diffuse(name, [r, g, b])
            });
        }
        if emissive_textures > 0 {
            let what = "emissive textures are not read: these materials emit evenly";
            self.soup.repairs.messages.push(format!("{emissive_textures} {what}"));
        }
        self.soup.material(SoupMaterial::missing("(none)"));
        self.names = UniqueNames::default();
    }

    fn texture(&mut self, source: gltf::image::Source) -> Option<Texture> {
        let bytes = match source {
            gltf::image::Source::Uri { uri, .. } => resource(self.path, uri),
            gltf::image::Source::View { view, .. } => {
                let end = view.offset().checked_add(view.length());
                let range =
                    end.and_then(|end| self.buffers.get(view.buffer().index())?.get(view.offset()..end));
                range.map(<[u8]>::to_vec).ok_or_else(|| "it lies outside its buffer".into())
            }
        };
        let texture = bytes.and_then(|b| Texture::decode(&b));
        if let Err(why) = &texture {
            self.soup.repairs.missing_files += 1;
            self.soup.repairs.messages.push(format!("a texture could not be read: {why}"));
        }
        texture.ok()
    }

    /// Walks the default scene, or the first, or all nodes if there is none. Each node is entered once, so that a
    /// cycle ends.
    fn nodes(&mut self, document: &gltf::Document) -> Result<()> {
        let mut entered = vec![false; document.nodes().count()];
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let mut stack: Vec<(Node, DMat4)> = match scene {
            Some(scene) => scene.nodes().map(|n| (n, DMat4::IDENTITY)).collect(),
            None => document.nodes().map(|n| (n, DMat4::IDENTITY)).collect(),
        };
        stack.reverse();
        while let Some((node, parent)) = stack.pop() {
            if std::mem::replace(&mut entered[node.index()], true) {
                continue;
            }
            let local = DMat4::from_cols_array_2d(&node.transform().matrix().map(|c| c.map(f64::from)));
            let world = parent * local;
            if let Some(mesh) = node.mesh() {
                let name =
                    node.name().or(mesh.name()).map_or(format!("object {}", node.index()), str::to_owned);
                let object = self.soup.object(self.names.of(&name));
                for primitive in mesh.primitives() {
                    self.primitive(object, &primitive, world)?;
                }
            }
            if let Some(camera) = node.camera() {
                self.camera(&camera, node.name(), world);
            }
            let children: Vec<_> = node.children().map(|c| (c, world)).collect();
            stack.extend(children.into_iter().rev());
        }
        Ok(())
    }

    /// Cameras look along -z with y up (glTF 2.0, section 3.10); those that make no picture are left out.
    fn camera(&mut self, camera: &gltf::Camera, node: Option<&str>, world: DMat4) {
        let gltf::camera::Projection::Perspective(lens) = camera.projection() else { return };
        let name = camera.name().or(node).map_or(format!("camera {}", camera.index()), str::to_owned);
        let (eye, angle) = (world.transform_point3(DVec3::ZERO), f64::from(lens.yfov()));
        let along = |v: DVec3| world.transform_vector3(v).try_normalize();
        let (Some(forward), Some(up)) = (along(DVec3::NEG_Z), along(DVec3::Y)) else { return };
        let upright = eye.is_finite() && forward.cross(up).length() > 1e-6;
        if upright && angle > 0.0 && angle < std::f64::consts::PI {
            let name = self.camera_names.of(&name);
            self.soup.cameras.push(StoredCamera { name, eye, forward, up, angle });
        }
    }

    fn primitive(&mut self, object: u32, primitive: &Primitive, world: DMat4) -> Result<()> {
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            return Ok(());
        }
        let Some(accessor) = primitive.get(&Semantic::Positions) else { return Ok(()) };
        let first = self.soup.positions.len();
        let positions: Vec<[f64; 3]> = self.values(&accessor)?;
        let count = positions.len();
        if self.soup.corners.len() + 3 * count > MAX_CORNERS {
            return Err(self.wrong("more faces than can be handled: split the scene"));
        }
        self.soup
            .positions
            .extend(positions.into_iter().map(|p| world.transform_point3(DVec3::from_array(p))));
        let indices: Vec<u32> = match primitive.indices() {
            None => (0..count as u32).collect(),
            Some(accessor) => self.values(&accessor)?.into_iter().map(|[i]: [f64; 1]| i as u32).collect(),
        };
        if let Some(bad) = indices.iter().find(|&&i| i as usize >= count) {
            return Err(self.wrong(format!("a face uses vertex {bad} of a mesh that has {count}")));
        }
        if self.soup.corners.len() + 3 * indices.len() > MAX_CORNERS {
            return Err(self.wrong("more faces than can be handled: split the scene"));
        }
        let stand_in = self.soup.materials.len() - 1;
        let material = primitive.material().index().unwrap_or(stand_in) as u32;
        let uv = self.texcoords(primitive, count)?;
        // A mirroring transform turns the winding round (glTF 2.0, section 3.7.4).
        let mirrored = world.determinant() < 0.0;
        for [a, b, c] in triangles(&indices, primitive.mode()) {
            let corners = if mirrored { [a, c, b] } else { [a, b, c] };
            self.soup.indexed_polygon(object, material, corners.map(|i| first as u32 + i));
            self.soup.corner_texcoords.extend(corners.map(|i| uv.map_or(0, |start| start + i)));
        }
        Ok(())
    }

    /// Appends the texture coordinates of the primitive; where they start, or `None` without a texture.
    fn texcoords(&mut self, primitive: &Primitive, count: usize) -> Result<Option<u32>> {
        if self.soup.texcoords.is_empty() {
            // For corners without any.
            self.soup.texcoords.push([0.0; 2]);
        }
        let Some(info) = primitive.material().pbr_metallic_roughness().base_color_texture() else {
            return Ok(None);
        };
        let transform = info.texture_transform();
        let set = transform.as_ref().and_then(|t| t.tex_coord()).unwrap_or(info.tex_coord());
        let Some(accessor) = primitive.get(&Semantic::TexCoords(set)) else { return Ok(None) };
        let values: Vec<[f64; 2]> = self.values(&accessor)?;
        if values.len() < count {
            return Err(self.wrong("a mesh has fewer texture coordinates than vertices"));
        }
        let start = self.soup.texcoords.len() as u32;
        self.soup.texcoords.extend(values.iter().map(|&[u, v]| {
            let (u, v) = match &transform {
                None => (u, v),
                Some(t) => {
                    let ([su, sv], [ou, ov]) = (t.scale().map(f64::from), t.offset().map(f64::from));
                    let (sin, cos) = f64::from(t.rotation()).sin_cos();
                    let (u, v) = (u * su, v * sv);
                    (cos * u + sin * v + ou, cos * v - sin * u + ov)
                }
            };
            // glTF counts v from the top.
            [u as f32, (1.0 - v) as f32]
        }));
        Ok(Some(start))
    }

    /// The numbers of an accessor, `N` an item.
    fn values<const N: usize>(&self, accessor: &Accessor) -> Result<Vec<[f64; N]>> {
        let wrong = |what: &str| self.wrong(format!("accessor {}: {what}", accessor.index()));
        let wide = match accessor.dimensions() {
            Dimensions::Scalar => 1,
            Dimensions::Vec2 => 2,
            Dimensions::Vec3 => 3,
            _ => 0,
        };
        if wide != N {
            return Err(wrong("of the wrong kind for its use"));
        }
        if accessor.sparse().is_some() {
            return Err(wrong("sparse accessors are not read; export the scene without them"));
        }
        let view =
            accessor.view().ok_or_else(|| wrong("has no data; export the scene without compression"))?;
        let buffer = self.buffers.get(view.buffer().index()).ok_or_else(|| wrong("has no buffer"))?;
        let size = accessor.data_type().size();
        let stride = view.stride().unwrap_or(N * size);
        let end = view.offset().checked_add(view.length()).filter(|&end| end <= buffer.len());
        let data =
            end.map(|end| &buffer[view.offset()..end]).ok_or_else(|| wrong("lies outside its buffer"))?;
        let last = accessor.count().checked_sub(1).and_then(|n| n.checked_mul(stride));
        let needed = last.and_then(|l| l.checked_add(N * size)?.checked_add(accessor.offset()));
        if stride < N * size || needed.is_none_or(|n| n > data.len()) {
            return Err(wrong("lies outside its buffer view"));
        }
        let scale = if accessor.normalized() { normal_scale(accessor.data_type()) } else { 1.0 };
        let item = |i: usize| {
            let start = accessor.offset() + i * stride;
            std::array::from_fn(|c| number(&data[start + c * size..], accessor.data_type()) * scale)
        };
        Ok((0..accessor.count()).map(item).collect())
    }
}

/// Factor that turns a normalized integer into `[0, 1]` or `[-1, 1]`.
fn normal_scale(kind: DataType) -> f64 {
    match kind {
        DataType::I8 => 1.0 / 127.0,
        DataType::U8 => 1.0 / 255.0,
        DataType::I16 => 1.0 / 32767.0,
        DataType::U16 => 1.0 / 65535.0,
        DataType::U32 | DataType::F32 => 1.0,
    }
}

/// The number at the start of `bytes` (little-endian), which the caller has checked to be long enough.
fn number(bytes: &[u8], kind: DataType) -> f64 {
    match kind {
        DataType::I8 => f64::from(bytes[0] as i8),
        DataType::U8 => f64::from(bytes[0]),
        DataType::I16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
        DataType::U16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        DataType::U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        DataType::F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
    }
}

/// Triangles of a list, strip or fan; every second one of a strip is wound the other way.
fn triangles(indices: &[u32], mode: Mode) -> Vec<[u32; 3]> {
    match mode {
        Mode::Triangles => indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        Mode::TriangleFan => match indices.split_first() {
            Some((&hub, rim)) => rim.windows(2).map(|e| [hub, e[0], e[1]]).collect(),
            None => Vec::new(),
        },
        _ => {
            let odd =
                |(i, t): (usize, &[u32])| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[0], t[2], t[1]] };
            indices.windows(3).enumerate().map(odd).collect()
        }
    }
}

/// Gives out names, each once.
#[derive(Default)]
struct UniqueNames(HashMap<String, usize>);

impl UniqueNames {
    /// `name`, with a number behind it if it is taken.
    fn of(&mut self, name: &str) -> String {
        let mut n = self.0.get(name).copied().unwrap_or(0);
        loop {
            n += 1;
            let candidate = if n == 1 { name.to_owned() } else { format!("{name} {n}") };
            if n == 1 || !self.0.contains_key(&candidate) {
                self.0.insert(candidate.clone(), 1);
                self.0.insert(name.to_owned(), n);
                return candidate;
            }
        }
    }
}
