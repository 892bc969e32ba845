//! The triangles of all polygons of a soup.

use super::{
    MAX_REFLECTANCE, Repairs, Soup, SoupMaterial,
    keep::KeptPolygons,
    size::twice_area,
    triangulate::{Shape, Triangulator},
};
use glam::Vec3;

/// Triangles; one entry each.
#[derive(Default)]
pub(super) struct Triangles {
    pub triangles: Vec<[u32; 3]>,
    /// Index of the polygon among the kept ones.
    pub polygon: Vec<u32>,
    pub object: Vec<u32>,
    pub material: Vec<u32>,
    pub reflectance: Vec<[f32; 3]>,
    /// Empty if the soup has none.
    pub texcoords: Vec<[[f32; 2]; 3]>,
}

/// Triangulates all kept polygons; also returns which of them are broken.
pub(super) fn triangulate(
    soup: &Soup,
    kept: &KeptPolygons,
    positions: &[Vec3],
    repairs: &mut Repairs,
) -> (Triangles, Vec<bool>) {
    let (mut out, mut broken) = (Triangles::default(), vec![false; kept.polygon.len()]);
    let mut triangulator = Triangulator::new();
    let mut points = Vec::new();
    for (i, broken) in broken.iter_mut().enumerate() {
        let span = kept.span(i);
        let corners = &kept.corners[span.clone()];
        points.clear();
        points.extend(corners.iter().map(|&v| positions[v as usize].as_dvec3()));
        match triangulator.polygon(&points) {
            Shape::NoArea => repairs.zero_area_faces += 1,
            Shape::Broken => {
                repairs.broken_polygons += 1;
                *broken = true;
            }
            Shape::Convex if corners.len() == 3 => {}
            Shape::Convex => repairs.polygons_triangulated += 1,
            Shape::Concave => {
                repairs.polygons_triangulated += 1;
                repairs.concave_polygons += 1;
            }
        }
        let polygon = kept.polygon[i] as usize;
        let (object, material) = (soup.polygon_object[polygon], soup.polygon_material[polygon]);
        let mut has_area = false;
        for ordinals in &triangulator.triangles {
            let triangle = ordinals.map(|k| corners[k as usize]);
            // Corners in the middle of an edge cause triangles without area; the other triangles fill the polygon.
            if !self::has_area(triangle.map(|v| positions[v as usize])) {
                continue;
            }
            has_area = true;
            out.triangles.push(triangle);
            out.polygon.push(i as u32);
            out.object.push(object);
            out.material.push(material);
            let sources = ordinals.map(|k| kept.source[span.start + k as usize]);
            if !soup.corner_texcoords.is_empty() {
                out.texcoords.push(texcoords(soup, sources));
            }
            out.reflectance.push(reflectance(soup, &soup.materials[material as usize], sources));
            repairs.faces_without_material += usize::from(soup.materials[material as usize].missing);
        }
        repairs.zero_area_faces += usize::from(!has_area && !triangulator.triangles.is_empty());
    }
    (out, broken)
}

/// Texture coordinates of corners of a soup with texture coordinates.
fn texcoords(soup: &Soup, corners: [u32; 3]) -> [[f32; 2]; 3] {
    corners.map(|k| soup.texcoords[soup.corner_texcoords[k as usize] as usize])
}

/// `Kd` times the mean of the texture over the face. A black `Kd` beside a texture counts as white, because exporters
/// write it for a texture alone.
fn reflectance(soup: &Soup, material: &SoupMaterial, corners: [u32; 3]) -> [f32; 3] {
    let kd = material.reflectance.map(|v| v.clamp(0.0, MAX_REFLECTANCE));
    let (Some(texture), false) = (&material.texture, soup.corner_texcoords.is_empty()) else { return kd };
    let uv = texcoords(soup, corners);
    let (mean, black) = (texture.mean(uv), kd == [0.0; 3]);
    std::array::from_fn(|c| if black { mean[c] } else { mean[c] * kd[c] }.clamp(0.0, MAX_REFLECTANCE))
}

/// Whether the height of the triangle exceeds the f32 resolution at its position and relative to its longest edge.
pub(super) fn has_area(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let place = a.abs().max(b.abs()).max(c.abs()).max_element();
    let quantum = 0.5 * f64::from(f32::EPSILON) * (longest + place);
    twice_area(corners) > quantum * longest
}
