//! Which surfaces get shadow images, and the grid of texels on each.
//!
//! A receiver is a planar patch: triangles that hang together by edges, belong to one object and have one normal; or a
//! relief: all of an object that has no such patch to speak of and faces one way by and large, as a terrain does. Its
//! image covers the smallest rectangle around it, the longer side across; a relief is seen from straight above. Without
//! names the largest patches are taken that are nearly rectangular and see an emitter, one an object before any object
//! gets two; those in full light, where there is nothing to see, come last. A name stands for the largest such patch of
//! the object, group or material; given k times it stands for the k largest.

mod relief;

use super::workload::{Order, Point, Workload};
use crate::math::{Aabb, triangle_area, triangle_normal};
use crate::ray::{Occluder, Packet};
use crate::scene::Scene;
use crate::{Error, Result};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

/// Receivers without names.
const DEFAULT_COUNT: usize = 3;
/// Texels on the longer side of an image, at most.
const SIDE: usize = 96;
/// Fewest texels on the longer side, however many emitters there are.
const LEAST_SIDE: usize = 32;
/// Questions of all images together, about: with many emitters images get fewer texels.
const PAIRS: usize = 60_000;
/// Normals that differ by less than about one degree belong to one plane.
const COPLANAR: f32 = 0.9998;
/// Part of its rectangle that a patch must cover to count as nearly rectangular.
const FILLED: f64 = 0.8;
/// Parts of the scene's diagonal: a default receiver's longer side is at least this.
const LEAST_EXTENT: f32 = 0.05;
/// The largest patches that are looked at.
const CANDIDATES: usize = 24;
/// Test points along each side of a candidate, and rays from each to each emitter.
const PROBES: usize = 8;
const PROBE_RAYS: usize = 16;
/// Less than this part of the light counts as none, more than the rest to 1 as all.
const TRACE: f64 = 0.02;

/// An object has no planar patch to speak of if its largest is below this part of its area.
const LITTLE: f64 = 0.25;

/// A receiver and its grid of texels.
#[derive(Clone, Debug)]
pub struct Receiver {
    /// Object, or the name that was asked for.
    pub name: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Side of a texel, scene units.
    pub texel: f64,
    /// Whether any light arrives at its test points.
    pub lit: bool,
    rectangle: Rectangle,
    /// The points of a relief.
    relief: Option<Vec<Point>>,
}

impl Receiver {
    /// The texels' centres, row by row from the top left as seen from the side that is lit.
    pub fn points(&self) -> Vec<Point> {
        if let Some(points) = &self.relief {
            return points.clone();
        }
        let Rectangle { right, normal, .. } = self.rectangle;
        // Off the surface by a thousandth of a texel: coplanar faces of other objects do not flicker.
        let centre = self.rectangle.lifted() + 1e-3 * self.texel * normal;
        let up = normal.cross(right);
        let at = move |i: usize, n: usize| (i as f64 + 0.5 - 0.5 * n as f64) * self.texel;
        let texel = move |x, y| Point {
            position: (centre + at(x, self.width) * right - at(y, self.height) * up).as_vec3(),
            normal: normal.as_vec3(),
        };
        (0..self.height).flat_map(|y| (0..self.width).map(move |x| texel(x, y))).collect()
    }
}

/// A rectangle in space, its first side at least as long as the second.
#[derive(Clone, Copy, Debug)]
struct Rectangle {
    centre: DVec3,
    /// Unit vectors; the third, upwards in the image, is `normal × right`.
    right: DVec3,
    normal: DVec3,
    width: f64,
    height: f64,
    /// How far the surface rises above the rectangle towards `normal`, and on the other side: planes are not perfect.
    rise: [f64; 2],
}

impl Rectangle {
    /// The same seen from the other side.
    fn turned(self) -> Rectangle {
        let [front, back] = self.rise;
        Rectangle { normal: -self.normal, right: -self.right, rise: [back, front], ..self }.upright()
    }

    /// Its middle, lifted so that no point is behind the surface.
    fn lifted(self) -> DVec3 {
        self.centre + self.rise[0] * self.normal
    }

    /// Half a turn in its plane, if that brings up what is up: a wall is not shown upside down.
    fn upright(self) -> Rectangle {
        let up = self.normal.cross(self.right);
        let largest =
            [up.x, up.y, up.z].into_iter().fold(0.0f64, |m, v| if v.abs() > m.abs() { v } else { m });
        if largest < 0.0 { Rectangle { right: -self.right, ..self } } else { self }
    }
}

/// Connected triangles in one plane, or a relief.
struct Patch {
    triangles: Vec<u32>,
    /// As seen from the front of the rectangle.
    area: f64,
    rectangle: Rectangle,
    relief: bool,
}

impl Patch {
    fn filled(&self) -> f64 {
        self.area / (self.rectangle.width * self.rectangle.height)
    }
}

/// A patch and the light on it, seen from its better side.
struct Candidate {
    patch: Patch,
    object: u32,
    rectangle: Rectangle,
    lit: bool,
    shadowed: bool,
}

/// The receivers called `names`, or by default those that the module describes.
///
/// # Errors
/// Nothing is called like one of the names, or it has fewer planar patches than it was named times.
pub fn choose(scene: &Scene, exact: &dyn Occluder, names: &[String]) -> Result<Vec<Receiver>> {
    let chosen = if names.is_empty() { by_size(scene, exact) } else { by_name(scene, exact, names)? };
    let area = |c: &Candidate| {
        let (w, h) = (c.rectangle.width, c.rectangle.height);
        h / w
    };
    let texels: f64 = chosen.iter().map(|(_, c)| area(c)).sum::<f64>() * (SIDE * SIDE) as f64;
    let pairs = texels * scene.emitters.len().max(1) as f64;
    let side = (SIDE as f64 * (PAIRS as f64 / pairs.max(1.0)).sqrt()).floor();
    let side = side.clamp(LEAST_SIDE as f64, SIDE as f64);
    Ok(chosen
        .into_iter()
        .map(|(name, candidate)| {
            let rectangle = candidate.rectangle;
            let texel = rectangle.width / side;
            let height = (rectangle.height / texel).round().max(1.0) as usize;
            let (width, Candidate { patch, lit, .. }) = (side as usize, candidate);
            let relief = patch
                .relief
                .then(|| relief::points(scene, &patch.triangles, &rectangle, (width, height, texel)));
            Receiver { name, width, height, texel, lit, rectangle, relief }
        })
        .collect())
}

fn by_size(scene: &Scene, exact: &dyn Occluder) -> Vec<(String, Candidate)> {
    let least = LEAST_EXTENT * scene.bounds.diagonal();
    let mut extent = vec![Aabb::EMPTY; scene.triangle_component.iter().max().map_or(0, |&c| c as usize + 1)];
    for (t, &c) in scene.triangle_component.iter().enumerate() {
        extent[c as usize] = extent[c as usize].union(Aabb::of(scene.corners(t as u32)));
    }
    let large = |t: &u32| {
        scene.triangle_emitter[*t as usize] == u32::MAX
            && extent[scene.triangle_component[*t as usize] as usize].diagonal() >= least
    };
    let triangles: Vec<u32> = (0..scene.triangles.len() as u32).filter(large).collect();
    let mut patches = patches(scene, &triangles);
    let mut by_object = triangles;
    let object = |t: u32| scene.triangle_object[t as usize];
    by_object.sort_by_key(|&t| object(t));
    let relief = |own: &[u32]| {
        relief::of(scene, own, patches.iter().filter(|p| object(p.triangles[0]) == object(own[0])))
    };
    let reliefs: Vec<Patch> =
        by_object.chunk_by(|&a, &b| object(a) == object(b)).filter_map(relief).collect();
    // What little is flat of an object that is not is no receiver of its own.
    let rough: Vec<u32> = reliefs.iter().map(|r| object(r.triangles[0])).collect();
    patches.retain(|p| !rough.contains(&object(p.triangles[0])));
    patches.extend(reliefs);
    patches.retain(|p| p.filled() >= FILLED && p.rectangle.width >= f64::from(least));
    let mut candidates = candidates(scene, exact, patches);
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
    // A second patch with shadows beats an object of its own without.
    chosen.extend(others);
    chosen.sort_by_key(|c| !c.shadowed);
    chosen.truncate(DEFAULT_COUNT);
    chosen.into_iter().map(|c| (scene.objects[c.object as usize].name.clone(), c)).collect()
}

fn by_name(scene: &Scene, exact: &dyn Occluder, names: &[String]) -> Result<Vec<(String, Candidate)>> {
    let mut distinct: Vec<&String> = Vec::new();
    names.iter().for_each(|n| {
        if !distinct.contains(&n) {
            distinct.push(n)
        }
    });
    let mut found = Vec::new();
    for name in distinct {
        let wanted = names.iter().filter(|n| *n == name).count();
        let faces = scene.faces_named(name)?;
        let mut patches = patches(scene, &faces);
        patches.extend(relief::of(scene, &faces, patches.iter()));
        if patches.len() < wanted {
            return Err(Error::Scene(format!(
                "receiver `{name}` is named {wanted} times but has {} planar patches",
                patches.len()
            )));
        }
        // Rectangular ones first if there are enough.
        if patches.iter().filter(|p| p.filled() >= FILLED).count() >= wanted {
            patches.retain(|p| p.filled() >= FILLED);
        }
        found.extend(candidates(scene, exact, patches).into_iter().take(wanted).map(|c| (name.clone(), c)));
    }
    Ok(found)
}

/// The largest patches: those in partial shadow first, then those in full light, then dark ones, each by size.
fn candidates(scene: &Scene, exact: &dyn Occluder, mut patches: Vec<Patch>) -> Vec<Candidate> {
    patches.sort_by(|a, b| b.area.total_cmp(&a.area).then(a.triangles[0].cmp(&b.triangles[0])));
    patches.truncate(CANDIDATES);
    let mut candidates: Vec<Candidate> = patches
        .into_par_iter()
        .map(|patch| {
            let object = scene.triangle_object[patch.triangles[0] as usize];
            let front = patch.rectangle;
            let (light, part) = light_on(scene, exact, &patch, front);
            let sheet = scene.triangle_sides[patch.triangles[0] as usize] == 2;
            let (mut best, mut rectangle) = ((light, part), front);
            if sheet || part < TRACE {
                let back = front.turned();
                let there = light_on(scene, exact, &patch, back);
                if there.0 > best.0 {
                    (best, rectangle) = (there, back);
                }
            }
            let lit = best.1 >= TRACE;
            Candidate { patch, object, rectangle, lit, shadowed: lit && best.1 <= 1.0 - TRACE }
        })
        .collect();
    candidates.sort_by(|a, b| {
        (b.lit, b.shadowed).cmp(&(a.lit, a.shadowed)).then(b.patch.area.total_cmp(&a.patch.area))
    });
    candidates
}

/// Irradiance (in units of the pairs' weights) and the part of the unoccluded irradiance that arrives at a grid of
/// test points.
fn light_on(scene: &Scene, exact: &dyn Occluder, patch: &Patch, rectangle: Rectangle) -> (f64, f64) {
    let n = PROBES as f64;
    let up = rectangle.normal.cross(rectangle.right);
    let at = |i: usize| (i as f64 + 0.5) / n - 0.5;
    let plane = (0..PROBES * PROBES).map(|i| {
        let (x, y) = (at(i % PROBES) * rectangle.width, at(i / PROBES) * rectangle.height);
        Point {
            position: (rectangle.lifted() + x * rectangle.right + y * up).as_vec3(),
            normal: rectangle.normal.as_vec3(),
        }
    });
    let points = if patch.relief {
        let texel = rectangle.width / n;
        let rows = (rectangle.height / texel).round().max(1.0) as usize;
        relief::points(scene, &patch.triangles, &rectangle, (PROBES, rows, texel))
    } else {
        plane.collect()
    };
    let workload = Workload::new(scene, points, 0);
    let (mut packets, mut blocked): (Vec<Packet>, Vec<u32>) = (Vec::new(), Vec::new());
    let (mut arrives, mut could) = (0.0, 0.0);
    for (i, pair) in workload.pairs.iter().enumerate() {
        packets.clear();
        workload.add_bundle(scene, i, (PROBE_RAYS, Order::Near), 0, &mut packets);
        blocked.clear();
        blocked.resize(packets.len(), 0);
        exact.occluded(&packets, &mut blocked);
        let stopped: u32 = blocked.iter().map(|b| b.count_ones()).sum();
        let weight = f64::from(pair.weight);
        could += weight;
        arrives += weight * (1.0 - f64::from(stopped) / PROBE_RAYS as f64);
    }
    (arrives, if could > 0.0 { arrives / could } else { 0.0 })
}

/// Planar edge-connected patches of one object each, grown from the largest triangles: every member's normal is that
/// of the triangle the patch started from, so that finely divided curves do not count as planes.
fn patches(scene: &Scene, triangles: &[u32]) -> Vec<Patch> {
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
                let joins = object(j) == object(seed) && normals[j as usize].dot(normal).abs() > COPLANAR;
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

/// Pairs of places in `triangles` that share an edge, both ways, ascending.
fn neighbours(scene: &Scene, triangles: &[u32]) -> Vec<(u32, u32)> {
    let mut pairs: Vec<(u32, u32)> = edges(scene, triangles)
        .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
        .flat_map(|run| {
            // More than a few faces at one edge are a fan whose neighbours are enough.
            let reach = if run.len() <= 8 { run.len() } else { 2 };
            run.iter().enumerate().flat_map(move |(k, a)| {
                run[k + 1..].iter().take(reach - 1).flat_map(move |b| [(a.2, b.2), (b.2, a.2)])
            })
        })
        .collect();
    pairs.par_sort_unstable();
    pairs
}

/// Edges as pairs of vertices with the place of their triangle, ascending.
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

/// The smallest rectangle around the triangles in their plane that has a side along one of their outer edges (the
/// smallest of all has one along the convex hull). `None` if it has no area.
fn fit(scene: &Scene, triangles: &[u32], normal: DVec3) -> Option<Rectangle> {
    /// The longest outer edges are enough.
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
        // Later ones must be better by more than rounding: the choice does not hang on the last bit.
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
