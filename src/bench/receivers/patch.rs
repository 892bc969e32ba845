//! Planar patches of surfaces and their bounding rectangles.

use super::inscribed::inscribed;
use super::relief;
use crate::bench::workload::ReceiverPoint;
use crate::clusters::MIN_COPLANAR_COSINE;
use crate::math::{triangle_area, triangle_normal};
use crate::scene::Scene;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

/// Part of its rectangle that a nearly rectangular patch covers at least; the image of any other lies in a rectangle
/// inside it. A disc covers π/4 = 0.785 of its square.
pub(super) const MIN_FILLED_PART: f64 = 0.8;
/// Smallest rectangle inside a patch, relative to the patch: a disc has one of 2/π, a triangle one of 1/2.
const MIN_INSCRIBED_PART: f64 = 0.3;
/// An object without a patch of at least this part of its area may be a relief. The sides of a cube (1/6) pass as well;
/// their normals cancel, which [`super::relief`] tests. Selects receivers only.
pub(super) const MIN_PATCH_PART: f64 = 0.25;

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

/// Connected triangles in one plane, or a relief.
#[derive(Clone)]
pub(super) struct Patch {
    pub(super) triangles: Vec<u32>,
    /// Area projected along the rectangle's normal.
    pub(super) area: f64,
    pub(super) rectangle: Rectangle,
    pub(super) relief: bool,
}

impl Patch {
    pub(super) fn filled(&self) -> f64 {
        self.area / (self.rectangle.width * self.rectangle.height)
    }

    /// The patch, or a rectangle inside it if it is not nearly rectangular; `None` if the largest such rectangle is a
    /// small part of it.
    pub(super) fn rectangular(self, scene: &Scene) -> Option<Patch> {
        if self.filled() >= MIN_FILLED_PART {
            return Some(self);
        }
        let rectangle = inscribed(scene, &self.triangles, &self.rectangle)?;
        let area = rectangle.width * rectangle.height;
        (area >= MIN_INSCRIBED_PART * self.area).then_some(Patch { area, rectangle, ..self })
    }

    /// Centres of texels in a rectangle of the patch's plane, row by row from the top left: columns, rows, side.
    pub(super) fn points(
        &self,
        scene: &Scene,
        rectangle: &Rectangle,
        (width, height, texel): (usize, usize, f64),
    ) -> Vec<ReceiverPoint> {
        if self.relief {
            return relief::points(scene, &self.triangles, rectangle, (width, height, texel));
        }
        let Rectangle { right, normal, .. } = *rectangle;
        // A thousandth of a texel above the surface, so that coplanar faces of other objects do not block.
        let centre = rectangle.lifted() + 1e-3 * texel * normal;
        let up = normal.cross(right);
        let at = move |i: usize, n: usize| (i as f64 + 0.5 - 0.5 * n as f64) * texel;
        let texel = move |x, y| ReceiverPoint {
            position: (centre + at(x, width) * right - at(y, height) * up).as_vec3(),
            normal: normal.as_vec3(),
        };
        (0..height).flat_map(|y| (0..width).map(move |x| texel(x, y))).collect()
    }

    /// Test points in a rectangle: columns and rows, `longer` along the longer side, and the points.
    pub(super) fn spread(
        &self,
        scene: &Scene,
        rectangle: &Rectangle,
        longer: usize,
    ) -> ([usize; 2], Vec<ReceiverPoint>) {
        let texel = rectangle.width / longer as f64;
        let rows = (rectangle.height / texel).round().max(1.0) as usize;
        ([longer, rows], self.points(scene, rectangle, (longer, rows, texel)))
    }
}

/// Planar edge-connected patches, each of one object, grown from the largest triangles. The normals of all members
/// agree with that of the first triangle, so that finely tessellated curves are not planes.
pub(super) fn patches(scene: &Scene, triangles: &[u32]) -> Vec<Patch> {
    let normals: Vec<Vec3> = triangles
        .par_iter()
        .map(|&t| {
            let [a, b, c] = scene.corners(t);
            triangle_normal(a, b, c)
        })
        .collect();
    let areas: Vec<f64> = triangles
        .par_iter()
        .map(|&t| {
            let [a, b, c] = scene.corners(t);
            triangle_area(a, b, c)
        })
        .collect();
    let neighbours = neighbours(scene, triangles);
    let mut seeds: Vec<u32> = (0..triangles.len() as u32).collect();
    seeds.par_sort_by(|&a, &b| areas[b as usize].total_cmp(&areas[a as usize]).then(a.cmp(&b)));
    let object = |i: u32| scene.triangle_object[triangles[i as usize] as usize];
    let mut taken = vec![false; triangles.len()];
    let mut patches = Vec::new();
    for seed in seeds {
        if std::mem::replace(&mut taken[seed as usize], true) {
            continue;
        }
        let normal = normals[seed as usize];
        let mut members = vec![seed];
        let mut next = 0;
        while next < members.len() {
            let i = members[next];
            next += 1;
            let first = neighbours.partition_point(|n| n.0 < i);
            for &(_, j) in neighbours[first..].iter().take_while(|n| n.0 == i) {
                let joins =
                    object(j) == object(seed) && normals[j as usize].dot(normal).abs() > MIN_COPLANAR_COSINE;
                if joins && !std::mem::replace(&mut taken[j as usize], true) {
                    members.push(j);
                }
            }
        }
        let area = members.iter().map(|&i| areas[i as usize]).sum();
        let triangles: Vec<u32> = members.iter().map(|&i| triangles[i as usize]).collect();
        if let Some(rectangle) = fit(scene, &triangles, normal.as_dvec3()) {
            patches.push(Patch { triangles, area, rectangle, relief: false });
        }
    }
    patches
}

/// Pairs of indices into `triangles` that share an edge, in both orders, ascending.
fn neighbours(scene: &Scene, triangles: &[u32]) -> Vec<(u32, u32)> {
    let mut pairs: Vec<(u32, u32)> = edges(scene, triangles)
        .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
        .flat_map(|run| {
            // More than eight faces at one edge form a fan; each is joined to its next neighbour only.
            let reach = if run.len() <= 8 { run.len() } else { 2 };
            run.iter().enumerate().flat_map(move |(k, a)| {
                run[k + 1..].iter().take(reach - 1).flat_map(move |b| [(a.2, b.2), (b.2, a.2)])
            })
        })
        .collect();
    pairs.par_sort_unstable();
    pairs
}

/// Edges as pairs of vertices with the index of their triangle, ascending.
fn edges(scene: &Scene, triangles: &[u32]) -> Vec<(u32, u32, u32)> {
    let mut edges: Vec<(u32, u32, u32)> = triangles
        .iter()
        .enumerate()
        .flat_map(|(i, &t)| {
            let [a, b, c] = scene.triangles[t as usize];
            [(a, b), (b, c), (c, a)].map(|(p, q)| (p.min(q), p.max(q), i as u32))
        })
        .collect();
    edges.par_sort_unstable();
    edges
}

/// The smallest rectangle around the triangles in their plane with a side along one of their outer edges. (The
/// smallest of all rectangles has a side along the convex hull.) `None` if it has no area.
pub(super) fn fit(scene: &Scene, triangles: &[u32], normal: DVec3) -> Option<Rectangle> {
    /// Number of longest outer edges that are tried: limits the time for finely tessellated outlines to 64 rectangles.
    const DIRECTIONS: usize = 64;
    let (u, v) = normal.any_orthonormal_pair();
    let flat = |p: Vec3| DVec2::new(p.as_dvec3().dot(u), p.as_dvec3().dot(v));
    let mut outer: Vec<DVec2> = edges(scene, triangles)
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
