//! Selection of the surfaces with shadow images, and their grids of texels.
//!
//! A receiver is a planar patch (edge-connected triangles of one object in one plane) or a relief (all triangles of an object without a
//! large planar patch whose faces point into one half space, such as terrain). Its image lies in the smallest rectangle around it, the
//! longer side horizontal, or in the largest rectangle inside it if it covers less than 80 % of the former (discs, L shapes); a relief is
//! projected along its mean normal. Texels are at most half the smallest feature size wide; if the surface would need too many, the image
//! is a window of it, where most shadow borders are. By default the largest patches that see an emitter are taken, one per object before
//! any object gets two; patches without shadows come last. A name selects the largest such patch of the object, group or material, or of
//! the placed mesh (see [`faces_named`]); given k times it selects the k largest.

mod patch;
mod relief;
mod window;

use super::lights;
use super::workload::{ReceiverPoint, Workload};
use crate::math::parallel;
use crate::model::Model;
use crate::ray::{Occluder, Packet};
use crate::scene::Scene;
use crate::{Error, Result, error::quote};
use glam::{DVec2, DVec3, Vec3};
use patch::{MIN_FILLED_FRACTION, Patch, patches, relief};
use relief::highest;
use std::sync::Arc;

/// Number of receivers without names: their images fit on one page of the report.
const DEFAULT_COUNT: usize = 3;
/// Smallest longer side of a default receiver, relative to the scene's diagonal: excludes small objects. The same fraction
/// as the largest default feature size.
const MIN_EXTENT_FRACTION: f32 = 0.05;
/// Number of largest patches whose light is tested: limits the time of the selection to 24 · 1,024 rays per emitter.
const MAX_CANDIDATES: usize = 24;
/// Test points along each side of a candidate: 64 points, each with [`PROBE_RAYS`], are 1,024 rays per emitter.
const PROBES_PER_SIDE: usize = 8;
/// Rays from each test point to each emitter: one packet.
const PROBE_RAYS: usize = 16;
/// A patch is dark below this fraction of the unoccluded irradiance, and fully lit above one minus this: the default
/// threshold of shadows of `mrvis fbem`. Selects receivers only.
const SHADOW_THRESHOLD: f64 = 0.02;

/// Default feature sizes: a shadow of two texels is the smallest that an image shows, and of the largest five lie side by side.
const SMALLEST_FEATURE_TEXELS: f64 = 2.0;
const LARGEST_FEATURE_FRACTION: f64 = 0.2;

/// A receiver and its grid of texels.
#[derive(Clone, Debug)]
pub struct ReceiverGrid {
    /// Name of the object, or the name that was given.
    pub name: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Side of a texel, scene units.
    pub texel: f64,
    /// Sides of the rectangle that the texels are a window of, scene units.
    pub surface: [f64; 2],
    /// Whether light arrives at the test points.
    pub lit: bool,
    /// Centres of the texels, row by row from the top left as seen from the lit side.
    pub points: Vec<ReceiverPoint>,
}

/// Texels of an image: first column and row, number of columns and rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    first: [usize; 2],
    size: [usize; 2],
}

impl ReceiverGrid {
    /// The middle of the image with this fraction of its texels.
    pub fn middle(&self, part: f64) -> Crop {
        let size = [self.width, self.height]
            .map(|n| ((n as f64 * part.min(1.0).sqrt()).round() as usize).clamp(1, n));
        Crop { first: [(self.width - size[0]) / 2, (self.height - size[1]) / 2], size }
    }

    /// The receiver with a fraction of its texels.
    pub fn only(&self, part: Crop) -> ReceiverGrid {
        let points = part.of(&self.points, self.width);
        ReceiverGrid { width: part.size[0], height: part.size[1], points, ..self.clone() }
    }
}

impl Crop {
    /// These of the values of an image with `width` columns.
    fn of<T: Copy>(self, values: &[T], width: usize) -> Vec<T> {
        let Crop { first: [x, y], size: [columns, rows] } = self;
        let row = |row: usize| values[row * width + x..][..columns].iter().copied();
        (y..y + rows).flat_map(row).collect()
    }
}

/// The texels of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
struct TexelGrid {
    width: usize,
    height: usize,
    texel: f64,
}

/// A patch with the irradiance of its brighter side.
struct Candidate {
    patch: Patch,
    /// The scene that holds its triangles, in the frame of the model.
    surfaces: Arc<Scene>,
    object: u32,
    rectangle: Rectangle,
    lit: bool,
    shadowed: bool,
}

/// Surfaces that shadow images are made of.
pub struct Surfaces {
    chosen: Vec<(String, Candidate)>,
    /// Number of images times number of emitters.
    share: usize,
}

/// The surfaces with these `names`, or the default ones, which are of the scene's own triangles.
///
/// # Errors
/// No surface has one of the names, or it has fewer planar patches than times it was named.
pub fn choose(model: &Model, exact: &dyn Occluder, names: &[String]) -> Result<Surfaces> {
    let chosen = if names.is_empty() { by_size(model, exact) } else { by_name(model, exact, names)? };
    let share = chosen.len() * lights::shown(model.scene()).max(1);
    Ok(Surfaces { chosen, share })
}

impl Surfaces {
    /// Smallest and largest feature size that images of the whole surfaces show: two texels, and a fifth of the longest side. None
    /// without a surface.
    pub fn feature_sizes(&self) -> Option<[f64; 2]> {
        let largest = |of: &dyn Fn([f64; 2]) -> f64| {
            self.chosen.iter().map(|(_, c)| of([c.rectangle.width, c.rectangle.height])).reduce(f64::max)
        };
        let max = largest(&|[longer, _]| longer)? * LARGEST_FEATURE_FRACTION;
        let texel = largest(&|surface| TexelGrid::new(surface, [0.0, max], self.share).texel)?;
        Some([SMALLEST_FEATURE_TEXELS * texel, max])
    }

    /// Texels for feature sizes from `sizes[0]` to `sizes[1]`.
    pub fn grids(&self, model: &Model, exact: &dyn Occluder, sizes: [f64; 2]) -> Vec<ReceiverGrid> {
        self.each(model, exact, |surface| TexelGrid::new(surface, sizes, self.share))
    }

    /// Texels of maps: `side` along the longer side, at most half of the smallest feature size wide.
    pub fn maps(&self, model: &Model, exact: &dyn Occluder, side: usize, smallest: f64) -> Vec<ReceiverGrid> {
        let mut maps = self.each(model, exact, |surface| TexelGrid::map(surface, side, smallest));
        maps.retain(|map| map.lit);
        maps
    }

    fn each(
        &self,
        model: &Model,
        exact: &dyn Occluder,
        texels: impl Fn([f64; 2]) -> TexelGrid,
    ) -> Vec<ReceiverGrid> {
        let receiver = |(name, candidate): &(String, Candidate)| {
            let Candidate { patch, surfaces, rectangle, lit, .. } = candidate;
            let surface = [rectangle.width, rectangle.height];
            let grid = texels(surface);
            let rectangle = window::place(model, exact, surfaces, patch, *rectangle, &grid);
            let TexelGrid { width, height, texel } = grid;
            let points = patch.points(surfaces, &rectangle, &grid);
            ReceiverGrid { name: name.clone(), width, height, texel, surface, lit: *lit, points }
        };
        self.chosen.iter().map(receiver).collect()
    }
}

fn by_size(model: &Model, exact: &dyn Occluder) -> Vec<(String, Candidate)> {
    let scene = model.shared_scene();
    let min_extent = MIN_EXTENT_FRACTION * scene.size();
    let extent = scene.component_bounds();
    let large = |t: &u32| {
        scene.triangle_emitter[*t as usize] == u32::MAX
            && extent[scene.triangle_component[*t as usize] as usize].diagonal() >= min_extent
    };
    let triangles: Vec<u32> = (0..scene.triangles.len() as u32).filter(large).collect();
    let mut patches = patches(&scene, &triangles);
    let mut by_object = triangles;
    let object = |t: u32| scene.triangle_object[t as usize];
    by_object.sort_by_key(|&t| object(t));
    let relief_of = |own: &[u32]| {
        relief(&scene, own, patches.iter().filter(|p| object(p.triangles[0]) == object(own[0])))
    };
    let reliefs: Vec<Patch> =
        by_object.chunk_by(|&a, &b| object(a) == object(b)).filter_map(relief_of).collect();
    // Small flat parts of a relief are not receivers.
    let rough: Vec<u32> = reliefs.iter().map(|r| object(r.triangles[0])).collect();
    patches.retain(|p| !rough.contains(&object(p.triangles[0])));
    patches.extend(reliefs);
    patches.retain(|p| p.rectangle.width >= f64::from(min_extent));
    let mut patches: Vec<Patch> = patches.into_iter().filter_map(|p| p.rectangular(&scene)).collect();
    patches.retain(|p| p.rectangle.width >= f64::from(min_extent));
    let mut candidates = candidates(model, &scene, exact, patches);
    candidates.retain(|c| c.lit);
    let mut chosen: Vec<Candidate> = Vec::new();
    let mut others = Vec::new();
    for candidate in candidates {
        if chosen.iter().any(|c| c.object == candidate.object) {
            others.push(candidate);
        } else {
            chosen.push(candidate);
        }
    }
    // A second patch of an object with shadows precedes the first of another object without.
    chosen.extend(others);
    chosen.sort_by_key(|c| !c.shadowed);
    chosen.truncate(DEFAULT_COUNT);
    chosen.into_iter().map(|c| (scene.objects[c.object as usize].name.clone(), c)).collect()
}

fn by_name(model: &Model, exact: &dyn Occluder, names: &[String]) -> Result<Vec<(String, Candidate)>> {
    let mut distinct: Vec<&String> = Vec::new();
    names.iter().for_each(|n| {
        if !distinct.contains(&n) {
            distinct.push(n)
        }
    });
    let mut found = Vec::new();
    for name in distinct {
        let wanted = names.iter().filter(|n| *n == name).count();
        let (scene, faces) = faces_named(model, name)?;
        let mut patches = patches(&scene, &faces);
        patches.extend(relief(&scene, &faces, patches.iter()));
        if patches.len() < wanted {
            let problem = format!("named {wanted} times, but it has {} planar patches", patches.len());
            return Err(Error::argument("receivers", format!("`{}`", quote(name)), problem));
        }
        // Nearly rectangular patches only, if there are enough; else those with a rectangle inside.
        if patches.iter().filter(|p| p.filled() >= MIN_FILLED_FRACTION).count() >= wanted {
            patches.retain(|p| p.filled() >= MIN_FILLED_FRACTION);
        } else {
            patches = patches.into_iter().map(|p| p.clone().rectangular(&scene).unwrap_or(p)).collect();
        }
        let candidates = candidates(model, &scene, exact, patches);
        found.extend(candidates.into_iter().take(wanted).map(|c| (name.clone(), c)));
    }
    Ok(found)
}

/// The largest patches: partly shadowed ones first, then fully lit ones, then dark ones, each by area.
fn candidates(
    model: &Model,
    scene: &Arc<Scene>,
    exact: &dyn Occluder,
    mut patches: Vec<Patch>,
) -> Vec<Candidate> {
    patches.sort_by(|a, b| b.area.total_cmp(&a.area).then(a.triangles[0].cmp(&b.triangles[0])));
    patches.truncate(MAX_CANDIDATES);
    let mut candidates: Vec<Candidate> = parallel::map(&patches, |patch| {
        let object = scene.triangle_object[patch.triangles[0] as usize];
        let front = patch.rectangle;
        let (light, part) = light_on(model, scene, exact, patch, front);
        let sheet = scene.triangle_sides[patch.triangles[0] as usize] == 2;
        let (mut best, mut rectangle) = ((light, part), front);
        if sheet || part < SHADOW_THRESHOLD {
            let back = front.turned();
            let there = light_on(model, scene, exact, patch, back);
            if there.0 > best.0 {
                (best, rectangle) = (there, back);
            }
        }
        let lit = best.1 >= SHADOW_THRESHOLD;
        let (surfaces, shadowed) = (scene.clone(), lit && best.1 <= 1.0 - SHADOW_THRESHOLD);
        Candidate { patch: patch.clone(), surfaces, object, rectangle, lit, shadowed }
    });
    candidates.sort_by(|a, b| {
        (b.lit, b.shadowed).cmp(&(a.lit, a.shadowed)).then(b.patch.area.total_cmp(&a.patch.area))
    });
    candidates
}

/// Relative irradiance at a grid of test points, and its fraction of the unoccluded irradiance.
fn light_on(
    model: &Model,
    surfaces: &Scene,
    exact: &dyn Occluder,
    patch: &Patch,
    rectangle: Rectangle,
) -> (f64, f64) {
    let points = patch.spread(surfaces, &rectangle, PROBES_PER_SIDE).1;
    let (workload, values) = probe(model, exact, points);
    let (mut arrives, mut could) = (0.0, 0.0);
    for (pair, value) in workload.pairs.iter().zip(values) {
        could += f64::from(pair.weight);
        arrives += f64::from(pair.weight * value);
    }
    (arrives, if could > 0.0 { arrives / could } else { 0.0 })
}

/// Pairs of points and emitters, and the visible fraction of each by a few rays.
fn probe(model: &Model, exact: &dyn Occluder, points: Vec<ReceiverPoint>) -> (Workload, Vec<f32>) {
    let (scene, workload) = (model.scene(), Workload::shown(model, points, 0));
    let (mut packets, mut blocked): (Vec<Packet>, Vec<u32>) = (Vec::new(), Vec::new());
    let values = (0..workload.pairs.len()).map(|pair| {
        packets.clear();
        workload.add_bundle(scene, pair, PROBE_RAYS, 0, &mut packets);
        blocked.clear();
        blocked.resize(packets.len(), 0);
        exact.occluded(&packets, &mut blocked);
        let stopped: u32 = blocked.iter().map(|b| b.count_ones()).sum();
        1.0 - stopped as f32 / PROBE_RAYS as f32
    });
    let values = values.collect();
    (workload, values)
}

/// The faces of the objects, groups or materials with this name among the scene's own; else those of the first placed mesh of
/// this name; else those of the first placed mesh that has an object, group or material of this name. Also returns the scene
/// that holds them, in the frame of the model.
///
/// # Errors
/// Nothing has this name.
fn faces_named(model: &Model, name: &str) -> Result<(Arc<Scene>, Vec<u32>)> {
    let present: Vec<u32> =
        (1..model.instances().len() as u32).filter(|&i| model.instances()[i as usize].is_present()).collect();
    let placed = present.iter().map(|&i| (&*model.instances()[i as usize].name, model.mesh_of(i)));
    let scene = model.shared_scene();
    let (place, faces) = scene.faces_named_placed(placed, name).map_err(|error| error.of("receivers"))?;
    let surfaces = place.map(|place| {
        let i = present[place];
        Arc::new(model.mesh_of(i).transformed(&model.instances()[i as usize].affine()))
    });
    Ok((surfaces.unwrap_or(scene), faces))
}

/// Cells along the longer side of the rectangle around the patch: the rectangle inside is found to 2 %.
const CELLS: usize = 128;

/// The largest rectangle of covered cells, with sides parallel to those of `around`, which contains the triangles.
pub(super) fn inscribed(scene: &Scene, triangles: &[u32], around: &Rectangle) -> Option<Rectangle> {
    let cell = around.width / CELLS as f64;
    let rows = (around.height / cell).floor().max(1.0) as usize;
    let highest = highest(scene, triangles, around, &TexelGrid { width: CELLS, height: rows, texel: cell });
    let covered: Vec<bool> = highest.iter().map(Option::is_some).collect();
    let [left, top, right, bottom] = largest(&covered, CELLS)?;
    let up = around.normal.cross(around.right);
    let (width, height) = ((right - left) as f64 * cell, (bottom - top) as f64 * cell);
    let middle = |first: usize, last: usize, n: usize| (0.5 * (first + last) as f64 - 0.5 * n as f64) * cell;
    let centre = around.centre + middle(left, right, CELLS) * around.right - middle(top, bottom, rows) * up;
    let inside = Rectangle { centre, width, height, ..*around };
    Some(match width >= height {
        true => inside,
        false => Rectangle { right: up, width: height, height: width, ..inside }.upright(),
    })
}

/// The rectangle with the most cells that are all true: first column and row, one past the last column and row.
fn largest(cells: &[bool], width: usize) -> Option<[usize; 4]> {
    let mut high = vec![0usize; width];
    let mut best: Option<(usize, [usize; 4])> = None;
    for (y, row) in cells.chunks(width).enumerate() {
        for (high, &cell) in high.iter_mut().zip(row) {
            *high = if cell { *high + 1 } else { 0 };
        }
        for left in 0..width {
            let mut low = usize::MAX;
            for (right, &cells) in high.iter().enumerate().skip(left) {
                low = low.min(cells);
                if low == 0 {
                    break;
                }
                let area = low * (right + 1 - left);
                if best.is_none_or(|b| area > b.0) {
                    best = Some((area, [left, y + 1 - low, right + 1, y + 1]));
                }
            }
        }
    }
    best.map(|(_, rectangle)| rectangle)
}

/// Number of longest outer edges that are tried: limits the time for finely tessellated outlines to 64 rectangles.
const DIRECTIONS: usize = 64;

/// A rectangle in space; `width` is at least `height`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rectangle {
    pub(super) centre: DVec3,
    /// Unit vectors. `normal × right` points upwards in the image.
    pub(super) right: DVec3,
    pub(super) normal: DVec3,
    pub(super) width: f64,
    pub(super) height: f64,
    /// Largest height of the surface above the rectangle towards `normal`, and towards the other side, scene units.
    pub(super) rise: [f64; 2],
}

impl Rectangle {
    /// The rectangle seen from the other side.
    pub(super) fn turned(self) -> Rectangle {
        let [front, back] = self.rise;
        Rectangle { normal: -self.normal, right: -self.right, rise: [back, front], ..self }.upright()
    }

    /// The centre, raised so that the surface is nowhere above the rectangle.
    pub(super) fn lifted(self) -> DVec3 {
        self.centre + self.rise[0] * self.normal
    }

    /// Turns the rectangle by 180° in its plane if that points the image upwards.
    pub(super) fn upright(self) -> Rectangle {
        let up = self.normal.cross(self.right);
        let largest =
            [up.x, up.y, up.z].into_iter().fold(0.0f64, |m, v| if v.abs() > m.abs() { v } else { m });
        if largest < 0.0 { Rectangle { right: -self.right, ..self } } else { self }
    }
}

/// The smallest rectangle around the triangles in their plane with a side along one of their outer edges. (The
/// smallest of all rectangles has a side along the convex hull.) `None` if it has no area.
pub(super) fn fit(scene: &Scene, triangles: &[u32], normal: DVec3) -> Option<Rectangle> {
    let (u, v) = normal.any_orthonormal_pair();
    let flat = |p: Vec3| DVec2::new(p.as_dvec3().dot(u), p.as_dvec3().dot(v));
    let mut outer: Vec<DVec2> = scene
        .edges_of(triangles)
        .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
        .filter(|run| run.len() == 1)
        .map(|run| flat(scene.positions[run[0].1 as usize]) - flat(scene.positions[run[0].0 as usize]))
        .collect();
    outer.sort_by(|a, b| b.length_squared().total_cmp(&a.length_squared()));
    outer.truncate(DIRECTIONS);
    let points: Vec<DVec2> = triangles.iter().flat_map(|&t| scene.corners(t)).map(flat).collect();
    let mut best: Option<(f64, DVec2, DVec2, DVec2)> = None;
    for along in outer.into_iter().filter_map(DVec2::try_normalize) {
        let across = along.perp();
        let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
        for p in &points {
            let q = DVec2::new(p.dot(along), p.dot(across));
            (low, high) = (low.min(q), high.max(q));
        }
        let span = high - low;
        let area = span.x * span.y;
        // A later rectangle must be smaller by more than rounding, so that rounding does not decide.
        if area > 0.0 && best.is_none_or(|b| area < b.0 * (1.0 - 1e-6)) {
            best = Some((area, along, span, 0.5 * (low + high)));
        }
    }
    let (_, along, span, middle) = best?;
    let across = along.perp();
    let height = scene.corners(triangles[0])[0].as_dvec3().dot(normal);
    let space = |p: DVec2| p.x * u + p.y * v;
    let centre = space(middle.x * along + middle.y * across) + height * normal;
    let (right, width, height) =
        if span.x >= span.y { (space(along), span.x, span.y) } else { (space(across), span.y, span.x) };
    let off = triangles.iter().flat_map(|&t| scene.corners(t)).map(|p| (p.as_dvec3() - centre).dot(normal));
    let rise = off.fold([0.0f64; 2], |[front, back], d| [front.max(d), back.max(-d)]);
    Some(Rectangle { centre, right, normal, width, height, rise }.upright())
}

#[cfg(test)]
mod tests;
