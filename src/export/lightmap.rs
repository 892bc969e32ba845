//! Lightmaps: irradiance of all surfaces in one image, one chart per plane. See `unwrapped` for lightmaps in the
//! texture coordinates of the file.

use super::Mesh;
use crate::progress::{self, Progress};
use crate::radiosity::mesh::RadiosityMesh;
use crate::scene::Scene;
use crate::{Error, Result, memory};
use glam::{Vec2, Vec3};
use std::collections::HashMap;
#[cfg(any(test, feature = "internals"))]
use {
    crate::files::WholeFile,
    crate::progress::Stoppable,
    std::io::{BufWriter, Write},
    std::path::Path,
};

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

/// Triangles that are drawn between two looks at the caller: below a millisecond.
pub(super) const TRIANGLES_BETWEEN_LOOKS: usize = 1 << 10;

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
            if drawn % TRIANGLES_BETWEEN_LOOKS == 0 {
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
pub(super) fn check_room(width: usize, height: usize) -> Result<()> {
    let texels = (width * height) as u64;
    memory::check_room(BYTES_PER_TEXEL * texels, || {
        format!("{texels} texels of a lightmap (⟨lightmap_texels⟩)")
    })
}

/// Column and row of the texels of an image of so many columns and rows whose centres lie in a triangle, and the barycentric coordinates
/// of these. Centres on common edges belong to both triangles; the tolerance closes gaps of rounding.
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
#[cfg(any(test, feature = "internals"))]
pub fn write_lightmap_mesh(
    path: &Path,
    map: &Lightmap,
    (scene, image): (&Scene, &str),
    progress: &dyn Progress,
) -> Result<()> {
    let mut file = WholeFile::create(path)?;
    let mut out = BufWriter::with_capacity(1 << 16, Stoppable { out: &mut file, progress });
    let mut write = || -> std::io::Result<()> {
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
        out.flush()
    };
    write().map_err(|e| Error::io(path, e))?;
    drop(out);
    file.commit()
}
