//! Lightmaps: irradiance of all surfaces in one image, one chart per plane, or in the texture coordinates of the file.

use super::{Mesh, Stage};
use crate::math::{Aabb, triangle_normal};
use crate::progress::{self, Progress};
use crate::radiosity::mesh::RadiosityMesh;
use crate::ray::{LANES, Packet};
use crate::scene::{Scene, magnitude};
use crate::{Error, Result, error::quote, memory};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

use {super::write_file, std::io::Write, std::path::Path};

/// An image of irradiance and its texture coordinates.
#[derive(Clone, Debug)]
pub struct Lightmap {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Side of a texel, scene units.
    pub texel: f32,
    /// Irradiance, W/m², row by row from the top.
    pub irradiance: Vec<[f32; 3]>,
    /// Whether a texel has light of its own: its centre lies on a surface, or it contains the centre of a triangle
    /// without a texel. Other texels repeat a neighbour or are black.
    pub covered: Vec<bool>,
    /// Texture coordinates of the corners of each triangle of the mesh, from the lower left corner of the image;
    /// empty if those of the scene apply.
    pub texcoords: Vec<[Vec2; 3]>,
    /// Sides of the scene's triangles that lie in the image; empty if the texture coordinates of the scene apply.
    pub sides: Vec<MapSide>,
}

/// One side of a triangle of the scene in a lightmap.
#[derive(Clone, Copy, Debug)]
pub struct MapSide {
    /// Index into the scene's triangles.
    pub triangle: u32,
    /// Whether it is the front.
    pub front: bool,
    /// Texture coordinates of the corners of the triangle, from the lower left corner of the image.
    pub texcoords: [Vec2; 3],
}

impl MapSide {
    /// The vertices of the triangle, counterclockwise from this side, and their texture coordinates.
    pub fn turned(&self, scene: &Scene) -> ([u32; 3], [[f32; 2]; 3]) {
        let ([a, b, c], [s, t, u]) =
            (scene.triangles[self.triangle as usize], self.texcoords.map(|place| place.to_array()));
        if self.front { ([a, b, c], [s, t, u]) } else { ([a, c, b], [s, u, t]) }
    }
}

/// Width of the margin around each chart that repeats its border: bilinear filtering reads one texel beyond a chart,
/// also at half the resolution.
const MARGIN_TEXELS: usize = 2;
/// Largest side of an image, texels: the limit of common graphics hardware.
pub(super) const MAX_SIDE_TEXELS: usize = 16_384;

/// Largest memory of a texel, bytes: irradiance (12), three flags, and for the file a copy (12) and a buffer that doubles (24).
const BYTES_PER_TEXEL: u64 = 12 + 3 + 12 + 24;

/// Triangles that are drawn between two calls of the caller's progress: below a millisecond.
pub(super) const TRIANGLES_PER_CHECK: usize = 1 << 10;

struct Chart {
    triangles: Vec<u32>,
    u: Vec3,
    v: Vec3,
    low: Vec2,
    high: Vec2,
    at: [usize; 2],
}

impl Chart {
    fn plane(&self, p: Vec3) -> Vec2 {
        Vec2::new(p.dot(self.u), p.dot(self.v))
    }

    /// Columns and rows at a texel size, margins included.
    fn size(&self, texel: f32) -> [usize; 2] {
        let side = |x: f32| (x / texel).ceil().max(1.0) as usize + 2 * MARGIN_TEXELS;
        let extent = self.high - self.low;
        [side(extent.x), side(extent.y)]
    }
}

/// Lightmap of a mesh with about `texels` texels; with more if there are more charts.
///
/// # Errors
/// The charts do not fit into an image of 16,384 texels per side; [`Error::OutOfMemory`]; [`Error::Cancelled`] if `progress` stops it.
pub fn lightmap(
    mesh: &Mesh,
    solution: &RadiosityMesh,
    scene: &Scene,
    texels: usize,
    progress: &dyn Progress,
) -> Result<Lightmap> {
    let mut charts = charts(mesh, solution, scene);
    let area: f32 = charts.iter().map(|c| (c.high - c.low).element_product()).sum();
    let mut texel = (area / texels.max(1) as f32).sqrt().max(f32::MIN_POSITIVE);
    let filled = |charts: &[Chart], texel: f32| -> usize {
        charts.iter().map(|c| c.size(texel).iter().product::<usize>()).sum()
    };
    // Texels are enlarged until charts and margins fit. If even one texel per chart does not fit, margins dominate
    // the image, and it gets as much area for surfaces as for margins.
    let minimum = charts.len() * (1 + 2 * MARGIN_TEXELS).pow(2);
    let room = (texels + texels / 4).max(minimum + minimum / 2);
    while filled(&charts, texel) > room {
        texel *= 1.25;
    }
    let [width, height] = pack(&mut charts, texel).ok_or_else(|| {
        Error::Scene(format!(
            "{} charts do not fit into a lightmap of {MAX_SIDE_TEXELS} texels a side",
            charts.len()
        ))
    })?;
    check_room(width, height)?;
    let mut map = Lightmap {
        width,
        height,
        texel,
        irradiance: vec![[0.0; 3]; width * height],
        covered: vec![false; width * height],
        texcoords: vec![[Vec2::ZERO; 3]; mesh.triangles.len()],
        sides: Vec::new(),
    };
    map.sides = map.sides_of(&charts, mesh, solution, scene);
    let mut drawn = 0;
    for chart in &charts {
        for &t in &chart.triangles {
            map.draw(mesh, chart, t);
            drawn += 1;
            if drawn % TRIANGLES_PER_CHECK == 0 {
                go_on(progress)?;
            }
        }
        chart.triangles.iter().for_each(|&t| map.cover_small(mesh, t));
    }
    map.fill_margins(progress)?;
    Ok(map)
}

/// Refuses a lightmap that would not fit into the memory.
///
/// # Errors
/// [`Error::OutOfMemory`].
fn check_room(width: usize, height: usize) -> Result<()> {
    let texels = (width * height) as u64;
    memory::check_room(BYTES_PER_TEXEL * texels, || format!("{texels} texels of a lightmap (⟨texels⟩)"))
}

/// Column and row of the texels of an image of this size whose centres lie in a triangle, and the barycentric coordinates of these.
/// Centres on common edges belong to both triangles; the tolerance closes gaps of rounding.
pub(super) fn covered_texels(
    face: [Vec2; 3],
    [columns, rows]: [usize; 2],
) -> impl Iterator<Item = ([usize; 2], [f32; 3])> {
    let [a, b, c] = face;
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let span = |low: f32, high: f32, end: usize| {
        (low - 0.5).floor().max(0.0) as usize..((high + 0.5).ceil() as usize).min(end)
    };
    let (columns, rows) = (span(low.x, high.x, columns), span(low.y, high.y, rows));
    let texels = rows.flat_map(move |y| columns.clone().map(move |x| [x, y]));
    let weighted = texels.map(move |[x, y]| ([x, y], weights(face, middle(x, y))));
    weighted.filter(|(_, weights)| weights.iter().all(|&w| w >= -1e-4))
}

/// Barycentric coordinates of a point.
pub(super) fn weights([a, b, c]: [Vec2; 3], p: Vec2) -> [f32; 3] {
    let area = (b - a).perp_dot(c - a);
    [(c - b).perp_dot(p - b), (a - c).perp_dot(p - c), (b - a).perp_dot(p - a)].map(|e| e / area)
}

/// The centre of a texel.
pub(super) fn middle(x: usize, y: usize) -> Vec2 {
    Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
}

/// An error once the caller has stopped.
pub(super) fn go_on(progress: &dyn Progress) -> Result<()> {
    progress::go_on(progress, "the lightmap was")
}

/// Groups triangles in one plane and on one side of a connected surface.
fn charts(mesh: &Mesh, solution: &RadiosityMesh, scene: &Scene) -> Vec<Chart> {
    let size = scene.bounds.diagonal().max(f32::MIN_POSITIVE);
    let mut known: HashMap<(u32, bool, [i32; 4]), usize> = HashMap::new();
    let mut charts: Vec<Chart> = Vec::new();
    // Sides that no light reaches need no texels.
    let lit = (0..mesh.triangles.len()).filter(|&t| (mesh.element[t] as usize) < solution.lit());
    for t in lit {
        let element = &solution.elements[mesh.element[t] as usize];
        let normal = mesh.normals[mesh.triangles[t][0] as usize];
        let [a, b, c] = mesh.corners(t);
        let plane = (normal * 500.0).round().as_ivec3().to_array();
        let height = (normal.dot(a) / size * 20_000.0).round() as i32;
        let key = (
            scene.triangle_component[element.triangle as usize],
            element.front,
            [plane[0], plane[1], plane[2], height],
        );
        let i = *known.entry(key).or_insert_with(|| {
            // Aligned with an edge of the element, so that rectangles are upright.
            let [p, q] = [0, 1].map(|k| solution.vertices[element.corners[k] as usize]);
            let u = (q - p).reject_from(normal).normalize_or(normal.any_orthonormal_vector());
            charts.push(Chart {
                triangles: Vec::new(),
                u,
                v: normal.cross(u),
                low: Vec2::INFINITY,
                high: Vec2::NEG_INFINITY,
                at: [0; 2],
            });
            charts.len() - 1
        });
        let chart = &mut charts[i];
        chart.triangles.push(t as u32);
        for p in [a, b, c] {
            let place = chart.plane(p);
            (chart.low, chart.high) = (chart.low.min(place), chart.high.max(place));
        }
    }
    charts
}

/// Places charts on shelves, tallest first; columns and rows of the image, or `None` if the charts do not fit.
fn pack(charts: &mut [Chart], texel: f32) -> Option<[usize; 2]> {
    let sizes: Vec<[usize; 2]> = charts.iter().map(|c| c.size(texel)).collect();
    let mut order: Vec<usize> = (0..charts.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(sizes[i][1]), i));
    let total: usize = sizes.iter().map(|s| s[0] * s[1]).sum();
    let widest = sizes.iter().map(|s| s[0]).max().unwrap_or(1);
    let width = ((total as f64 * 1.1).sqrt().ceil() as usize).max(widest);
    let (mut x, mut y, mut shelf) = (0, 0, 0);
    for i in order {
        let [w, h] = sizes[i];
        if x + w > width {
            (x, y, shelf) = (0, y + shelf, 0);
        }
        charts[i].at = [x, y];
        x += w;
        shelf = shelf.max(h);
    }
    let height = y + shelf;
    (width <= MAX_SIDE_TEXELS && height <= MAX_SIDE_TEXELS).then_some([width, height])
}

impl Lightmap {
    /// Column and row of a point of a chart.
    fn place(&self, chart: &Chart, p: Vec3) -> Vec2 {
        let corner = Vec2::new(chart.at[0] as f32, chart.at[1] as f32) + MARGIN_TEXELS as f32;
        corner + (chart.plane(p) - chart.low) / self.texel
    }

    /// Texture coordinates of a column and row.
    fn texcoord(&self, place: Vec2) -> Vec2 {
        Vec2::new(place.x / self.width as f32, 1.0 - place.y / self.height as f32)
    }

    /// Texture coordinates of the sides of the scene's triangles that charts hold. The triangles of a polygon are in one chart.
    fn sides_of(
        &self,
        charts: &[Chart],
        mesh: &Mesh,
        solution: &RadiosityMesh,
        scene: &Scene,
    ) -> Vec<MapSide> {
        let mut chart_of: HashMap<(u32, bool), &Chart> = HashMap::new();
        for chart in charts {
            for &t in &chart.triangles {
                let element = &solution.elements[mesh.element[t as usize] as usize];
                let polygon = scene.triangle_polygon[element.triangle as usize];
                chart_of.entry((polygon, element.front)).or_insert(chart);
            }
        }
        let sides = (0..scene.triangles.len() as u32).flat_map(|t| [(t, true), (t, false)]);
        let held = sides.filter_map(|(triangle, front)| {
            let chart = chart_of.get(&(scene.triangle_polygon[triangle as usize], front))?;
            let texcoords = scene.corners(triangle).map(|p| self.texcoord(self.place(chart, p)));
            Some(MapSide { triangle, front, texcoords })
        });
        held.collect()
    }

    /// Draws a triangle into the texels whose centres it contains, and sets its texture coordinates.
    fn draw(&mut self, mesh: &Mesh, chart: &Chart, t: u32) {
        let [a, b, c] = mesh.corners(t as usize).map(|p| self.place(chart, p));
        self.texcoords[t as usize] = [a, b, c].map(|p| self.texcoord(p));
        if (b - a).perp_dot(c - a) == 0.0 {
            return;
        }
        let light = mesh.triangles[t as usize].map(|v| mesh.irradiance[v as usize]);
        for ([x, y], weights) in covered_texels([a, b, c], [self.width, self.height]) {
            let at = y * self.width + x;
            self.covered[at] = true;
            self.irradiance[at] =
                std::array::from_fn(|k| (0..3).map(|i| weights[i] * light[i][k]).sum::<f32>().max(0.0));
        }
    }

    /// Draws the mean light of a triangle into the texel at its centre if no surface covers that texel's centre.
    fn cover_small(&mut self, mesh: &Mesh, t: u32) {
        let [a, b, c] = self.texcoords[t as usize];
        let middle = (a + b + c) / 3.0;
        let place = |part: f32, count: usize| ((part * count as f32).max(0.0) as usize).min(count - 1);
        let at = place(1.0 - middle.y, self.height) * self.width + place(middle.x, self.width);
        if !self.covered[at] {
            self.covered[at] = true;
            let light = mesh.triangles[t as usize].map(|v| mesh.irradiance[v as usize]);
            self.irradiance[at] = std::array::from_fn(|k| light.iter().map(|l| l[k] / 3.0).sum());
        }
    }

    /// Fills texels beside covered ones with the mean of these, once per texel of the margin.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if `progress` stops it.
    pub(super) fn fill_margins(&mut self, progress: &dyn Progress) -> Result<()> {
        let mut known = self.covered.clone();
        for _ in 0..MARGIN_TEXELS {
            let before = known.clone();
            for y in 0..self.height {
                go_on(progress)?;
                for x in (0..self.width).filter(|x| !before[y * self.width + x]) {
                    let (mut sum, mut count) = ([0.0; 3], 0.0);
                    for j in y.saturating_sub(1)..(y + 2).min(self.height) {
                        for i in x.saturating_sub(1)..(x + 2).min(self.width) {
                            if before[j * self.width + i] {
                                let light = self.irradiance[j * self.width + i];
                                sum.iter_mut().zip(light).for_each(|(s, l)| *s += l);
                                count += 1.0;
                            }
                        }
                    }
                    if count > 0.0 {
                        self.irradiance[y * self.width + x] = sum.map(|s| s / count);
                        known[y * self.width + x] = true;
                    }
                }
            }
        }
        Ok(())
    }
}

/// Writes the triangles of the scene with the texture coordinates of a lightmap, in coordinates of the scene's file, as an OBJ file; back
/// sides are faces of their own. `image` is the name of the lightmap's file.
///
/// # Errors
/// The file cannot be written, or `progress` has stopped.
pub fn write_lightmap_mesh(
    path: &Path,
    map: &Lightmap,
    scene: &Scene,
    image: &str,
    progress: &dyn Progress,
) -> Result<()> {
    write_file(path, progress, |out| {
        writeln!(out, "# irradiance, W/m\u{b2}: {image}, {} x {} texels", map.width, map.height)?;
        for p in &scene.positions {
            let p = scene.origin + p.as_dvec3();
            writeln!(out, "v {} {} {}", p.x, p.y, p.z)?;
        }
        let texcoords = map.sides.iter().flat_map(|side| side.texcoords);
        texcoords.into_iter().try_for_each(|t| writeln!(out, "vt {} {}", t.x, t.y))?;
        for (i, side) in map.sides.iter().enumerate() {
            let corners = scene.triangles[side.triangle as usize];
            let [a, b, c] = [0, 1, 2].map(|k| format!("{}/{}", corners[k] + 1, 3 * i + k + 1));
            if side.front { writeln!(out, "f {a} {b} {c}")? } else { writeln!(out, "f {a} {c} {b}")? }
        }
        Ok(())
    })
}

/// Tolerance of texture coordinates outside 0..1: files with four digits round by half of it.
const TEXCOORD_TOLERANCE: f32 = 1e-4;
/// Index that means "no face" for a texel.
const NO_FACE: u32 = u32::MAX;

/// Irradiance of the fronts of all faces, in a square image of about `texels` texels; or a sentence that says why the coordinates are
/// unsuitable: they are missing, leave 0..1, have no area, or overlap.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled) if `progress` stops it, [`Error::OutOfMemory`](crate::Error::OutOfMemory) if the image
/// does not fit.
pub fn unwrapped_lightmap(
    stage: &Stage,
    scene: &Scene,
    texels: usize,
    progress: &dyn Progress,
) -> Result<Result<Lightmap, String>> {
    let side = ((texels as f64).sqrt().ceil() as usize).clamp(1, MAX_SIDE_TEXELS);
    let faces = match placed(scene, side) {
        Ok(faces) => faces,
        Err(why) => return Ok(Err(why)),
    };
    check_room(side, side)?;
    let owner = match owners(scene, &faces, side, progress)? {
        Ok(owner) => owner,
        Err(why) => return Ok(Err(why)),
    };
    let mut map = Lightmap {
        width: side,
        height: side,
        texel: texel(scene, &faces),
        irradiance: vec![[0.0; 3]; side * side],
        covered: vec![false; side * side],
        texcoords: Vec::new(),
        sides: Vec::new(),
    };
    let rows = map.irradiance.par_chunks_mut(side).zip(map.covered.par_chunks_mut(side));
    rows.zip(owner.par_chunks(side)).enumerate().try_for_each(|(y, ((light, covered), owner))| {
        go_on(progress)?;
        for left in (0..side).step_by(LANES) {
            let rays = probe_rays(scene, &faces, owner, [left, y]);
            for (lane, met) in stage.irradiance(&rays).into_iter().enumerate() {
                if let Some(found) = met {
                    (light[left + lane], covered[left + lane]) = (found, true);
                }
            }
        }
        Ok(())
    })?;
    map.fill_margins(progress)?;
    Ok(Ok(map))
}

/// Corners of each face in texels from the upper left corner.
fn placed(scene: &Scene, side: usize) -> std::result::Result<Vec<[Vec2; 3]>, String> {
    if scene.triangle_texcoords.is_empty() {
        return Err("the file has no texture coordinates".into());
    }
    let name = |t: usize| quote(&scene.objects[scene.triangle_object[t] as usize].name);
    let inside = |[u, v]: [f32; 2]| {
        [u, v].iter().all(|x| (-TEXCOORD_TOLERANCE..=1.0 + TEXCOORD_TOLERANCE).contains(x))
    };
    let place = |(t, uv): (usize, &[[f32; 2]; 3])| {
        if !uv.iter().all(|&uv| inside(uv)) {
            return Err(format!("texture coordinates of `{}` leave 0..1", name(t)));
        }
        let [a, b, c] = uv.map(|[u, v]| side as f32 * Vec2::new(u, 1.0 - v));
        match (b - a).perp_dot(c - a) {
            0.0 => Err(format!("faces of `{}` have no area in texture coordinates", name(t))),
            _ => Ok([a, b, c]),
        }
    };
    scene.triangle_texcoords.iter().enumerate().map(place).collect()
}

/// Index of the face at each texel's centre, or [`NO_FACE`].
fn owners(
    scene: &Scene,
    faces: &[[Vec2; 3]],
    side: usize,
    progress: &dyn Progress,
) -> Result<Result<Vec<u32>, String>> {
    let mut owner = vec![NO_FACE; side * side];
    let (mut all, mut taken) = (0.0, 0usize);
    // At least half a texel inside the face, where adjacent faces do not reach.
    let deep = |face: [Vec2; 3], p: Vec2| {
        let [a, b, c] = face;
        let area = (b - a).perp_dot(c - a).abs();
        let sides = [b.distance(c), c.distance(a), a.distance(b)];
        weights(face, p).iter().zip(sides).all(|(w, s)| w * area > 0.5 * s)
    };
    for (t, &face) in faces.iter().enumerate() {
        if t % TRIANGLES_PER_CHECK == 0 {
            go_on(progress)?;
        }
        let [a, b, c] = face;
        all += f64::from(0.5 * (b - a).perp_dot(c - a).abs());
        for ([x, y], _) in covered_texels(face, [side; 2]) {
            let (at, p) = (&mut owner[y * side + x], middle(x, y));
            if *at == NO_FACE {
                taken += 1;
                *at = t as u32;
            } else if deep(face, p) && deep(faces[*at as usize], p) {
                let name = |t: usize| quote(&scene.objects[scene.triangle_object[t] as usize].name);
                let (one, other) = (name(*at as usize), name(t));
                return Ok(Err(format!("faces of `{one}` and `{other}` overlap in texture coordinates")));
            }
        }
    }
    // Faces below the size of a texel: the number of centres inside is proportional to their area, up to chance.
    if all > 1.1 * taken as f64 + 4.0 * (faces.len() as f64).sqrt() {
        return Ok(Err("faces overlap in texture coordinates".into()));
    }
    Ok(Ok(owner))
}

/// Rays from just in front of the surface onto it, at up to sixteen texels of a row.
fn probe_rays(scene: &Scene, faces: &[[Vec2; 3]], owner: &[u32], [left, y]: [usize; 2]) -> Packet {
    let mut rays = Packet::EMPTY;
    for (lane, &t) in owner[left..].iter().take(LANES).enumerate().filter(|(_, t)| **t != NO_FACE) {
        let corners = scene.corners(t);
        let shares = weights(faces[t as usize], middle(left + lane, y));
        let place: Vec3 = corners.into_iter().zip(shares).map(|(p, w)| w * p).sum();
        let [a, b, c] = corners;
        let normal = triangle_normal(a, b, c);
        // Elements of the face may be off its plane by a part of its size, and by rounding.
        let off = 1e-5 * Aabb::of(corners).diagonal() + 2e-6 * magnitude(corners);
        rays.set_ray(lane, place + off * normal, -normal);
        rays.far[lane] = 2.0 * off;
    }
    rays
}

/// Mean side of a texel, scene units.
fn texel(scene: &Scene, faces: &[[Vec2; 3]]) -> f32 {
    let surface: f64 = (0..faces.len() as u32).map(|t| scene.face_area(t)).sum();
    let shown: f64 = faces.iter().map(|[a, b, c]| f64::from(0.5 * (*b - *a).perp_dot(*c - *a).abs())).sum();
    (surface / shown).sqrt() as f32
}
