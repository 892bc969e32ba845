//! Primitives of a mesh as polygons of a soup.

use super::{MAX_CORNERS, Reader};
use crate::{Result, error::quote, scene::Soup};
use glam::{DAffine3, DVec3};
use gltf::{
    Primitive,
    mesh::{Mode, Semantic},
};

impl Reader<'_> {
    /// Adds a mesh to `soup` as the object `name`, transformed; materials are numbered as in the reader's table.
    pub fn mesh(&self, soup: &mut Soup, name: &str, mesh: &gltf::Mesh, world: DAffine3) -> Result<()> {
        let object = soup.object(name);
        mesh.primitives().try_for_each(|p| self.primitive(soup, object, &p, world))
    }

    /// Index of the primitive's material in the reader's table, whose last entry is the substitute for a missing one.
    pub fn material_of(&self, primitive: &Primitive) -> usize {
        primitive.material().index().unwrap_or(self.materials.len() - 1)
    }

    fn primitive(&self, soup: &mut Soup, object: u32, primitive: &Primitive, world: DAffine3) -> Result<()> {
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            return Ok(());
        }
        let Some(accessor) = primitive.get(&Semantic::Positions) else { return Ok(()) };
        let first = soup.positions.len();
        let positions: Vec<[f64; 3]> = self.values(&accessor)?;
        let count = positions.len();
        if soup.corners.len() + 3 * count > MAX_CORNERS {
            return Err(self.wrong("more faces than can be handled: split the scene"));
        }
        soup.positions.extend(positions.into_iter().map(|p| world.transform_point3(DVec3::from_array(p))));
        let indices: Vec<u32> = match primitive.indices() {
            None => (0..count as u32).collect(),
            Some(accessor) => self.values(&accessor)?.into_iter().map(|[i]: [f64; 1]| i as u32).collect(),
        };
        if let Some(bad) = indices.iter().find(|&&i| i as usize >= count) {
            let name = quote(&soup.objects[object as usize]);
            return Err(
                self.wrong(format!("a face of `{name}` uses vertex {bad} of {count} (numbers start at 0)"))
            );
        }
        if soup.corners.len() + 3 * indices.len() > MAX_CORNERS {
            return Err(self.wrong("more faces than can be handled: split the scene"));
        }
        let material = self.material_of(primitive) as u32;
        let uv = self.texcoords(soup, primitive, count)?;
        // A mirroring transform reverses the orientation of faces (glTF 2.0, section 3.7.4).
        let mirrored = world.matrix3.determinant() < 0.0;
        for [a, b, c] in triangles(&indices, primitive.mode()) {
            let corners = if mirrored { [a, c, b] } else { [a, b, c] };
            soup.indexed_polygon(object, material, corners.map(|i| first as u32 + i));
            soup.corner_texcoords.extend(corners.map(|i| uv.map_or(0, |start| start + i)));
        }
        Ok(())
    }

    /// Appends the texture coordinates of the primitive; their first index, or `None` without a texture.
    fn texcoords(&self, soup: &mut Soup, primitive: &Primitive, count: usize) -> Result<Option<u32>> {
        if soup.texcoords.is_empty() {
            // For corners without texture coordinates.
            soup.texcoords.push([0.0; 2]);
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
        let start = soup.texcoords.len() as u32;
        soup.texcoords.extend(values.iter().map(|&[u, v]| {
            let (u, v) = match &transform {
                None => (u, v),
                Some(t) => {
                    let ([su, sv], [ou, ov]) = (t.scale().map(f64::from), t.offset().map(f64::from));
                    let (sin, cos) = f64::from(t.rotation()).sin_cos();
                    let (u, v) = (u * su, v * sv);
                    (cos * u + sin * v + ou, cos * v - sin * u + ov)
                }
            };
            // In glTF v points downwards.
            [u as f32, (1.0 - v) as f32]
        }));
        Ok(Some(start))
    }
}

/// Triangles of a list, strip or fan; every second triangle of a strip has the opposite orientation.
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
