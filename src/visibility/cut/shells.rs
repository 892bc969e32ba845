//! Shells: large surfaces that segments with both ends on one side cannot meet, such as ground, a sky, or the walls of a room.
//!
//! Most segments leave the ground and end on the sky, close to both. Without shells each would test triangles there. A plane that does
//! not separate the ends of any segment of a bundle meets none of them; a shell is left out if that holds for all of its planes.

use crate::math::Aabb;
use crate::math::parallel;
use crate::ray::Packet;
use crate::scene::Scene;
use crate::simd::{LANES, Simd, vector};
use crate::visibility::answer::Bundle;
use glam::Vec3;

/// Largest number of shells: half of the root's lanes, so that the other half divides the rest of the scene.
pub(super) const MAX_SHELLS: usize = 8;
/// Largest number of planes of a shell: limits the check of all vertices of a scene to 0.5 s for a million.
const MAX_PLANES: usize = 1024;
/// Number of the largest surfaces that may be shells: limits comparisons of their planes to 256².
const MAX_REGIONS: usize = 256;
/// Number of points by which planes are tested first: they refute most planes, so that few are compared with all vertices. Does not
/// change results.
const FIRST_TEST_POINTS: usize = 64;
/// Distance from a plane within which a point is on neither side, relative to the largest coordinate: the bound on rounding of
/// [`crate::ray::EndRule`] and a half of it. Ends of segments are lifted by five times that bound.
const ROUNDING: f32 = 6e-7;

/// The points x with `normal · x = offset`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    normal: Vec3,
    offset: f32,
}

impl Plane {
    fn of(scene: &Scene, triangle: u32) -> Plane {
        let [a, ..] = scene.corners(triangle);
        let normal = scene.face_normal(triangle);
        Plane { normal, offset: normal.dot(a) }
    }

    fn height(&self, p: Vec3) -> f32 {
        self.normal.dot(p) - self.offset
    }
}

/// A large surface.
#[derive(Clone)]
pub(super) struct Shell {
    /// Its first plane; the normals of all are directed towards the scene.
    plane: Plane,
    /// Sixteen planes in a row as x, y and z of the normal and the offset, those nearest to `centre` first. Unused lanes lie infinitely
    /// far below everything.
    rows: Vec<[[f32; LANES]; 4]>,
    /// Smallest height of `centre` over the planes of each row.
    heights: Vec<f32>,
    centre: Vec3,
    /// Whether the whole scene lies on one side of each plane, and the box around the scene.
    outermost: bool,
    scene: Aabb,
    margin: f32,
}

impl Shell {
    /// Whether no segment of a bundle can meet the shell.
    #[inline(always)]
    pub fn is_passive<S: Simd>(&self, simd: S, bundle: &Bundle) -> bool {
        if !self.outermost {
            return self.plane.separates_nothing(simd, bundle.packets, self.margin);
        }
        let Some(first) = bundle.packets.iter().find(|packet| !packet.is_empty()) else { return true };
        let receiver = first.point(first.active.trailing_zeros() as usize, 0.0);
        // Ends on an emitter of the scene lie on the inner side, as the whole scene does.
        let reach = receiver.distance(self.centre) * (1.0 + 1e-5) + self.margin;
        let near = self.heights.partition_point(|&height| height <= reach);
        if bundle.emitter.is_empty() {
            return false;
        }
        if !self.is_on_inner_side(simd, receiver, near) {
            return false;
        }
        // Other ends, as those on the sky, may lie beyond the shell.
        let inside = |p: &Vec3| p.cmpge(self.scene.min).all() && p.cmple(self.scene.max).all();
        bundle.emitter.iter().all(|p| inside(p) || self.is_on_inner_side(simd, *p, self.rows.len()))
    }

    /// Whether a point is on the scene's side of all planes of the first rows, by more than a margin.
    #[inline(always)]
    fn is_on_inner_side<S: Simd>(&self, simd: S, p: Vec3, rows: usize) -> bool {
        let at = vector::splat(simd, p);
        self.rows[..rows].iter().all(|row| {
            let normal = [simd.load(&row[0]), simd.load(&row[1]), simd.load(&row[2])];
            let height = simd.sub(vector::dot(simd, &normal, &at), simd.load(&row[3]));
            simd.bits(simd.le(height, simd.splat(self.margin))) == 0
        })
    }
}

impl Plane {
    /// Whether all ends of segments lie on one side, by more than a margin.
    #[inline(always)]
    fn separates_nothing<S: Simd>(&self, simd: S, packets: &[Packet], margin: f32) -> bool {
        let normal = vector::splat(simd, self.normal);
        let (offset, margin) = (simd.splat(self.offset), simd.splat(margin));
        let (mut above, mut below) = (true, true);
        for packet in packets {
            let from = vector::dot(simd, &normal, &vector::load(simd, &packet.origin));
            let along = vector::dot(simd, &normal, &vector::load(simd, &packet.direction));
            let a = simd.sub(from, offset);
            let b = simd.add(a, along);
            let (low, high) = (simd.min(a, b), simd.max(a, b));
            above &= packet.active & !simd.bits(simd.lt(margin, low)) == 0;
            below &= packet.active & !simd.bits(simd.lt(high, simd.sub(simd.splat(0.0), margin))) == 0;
        }
        above || below
    }
}

/// The shells of a scene, the largest first, and the shell of each triangle, `u32::MAX` for most.
pub(super) fn find(scene: &Scene, pieces: &Pieces) -> (Vec<Shell>, Vec<u32>) {
    let mut of_triangle = vec![u32::MAX; scene.triangles.len()];
    let mut shells = Vec::new();
    let margin = ROUNDING * scene.magnitude();
    let mut groups = flat_groups(scene, pieces, margin);
    groups.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let centres = enclosed_centres(scene, &groups);
    for ((_, triangles), centre) in groups.into_iter().zip(centres) {
        if shells.len() == MAX_SHELLS {
            break;
        }
        if let Some(shell) = shell(scene, &triangles, centre, margin) {
            triangles.iter().for_each(|&t| of_triangle[t as usize] = shells.len() as u32);
            shells.push(shell);
        }
    }
    (shells, of_triangle)
}

/// The largest smooth surfaces, those in one plane together, with their areas.
fn flat_groups(scene: &Scene, pieces: &Pieces, margin: f32) -> Vec<(f64, Vec<u32>)> {
    let mut members: Vec<(u32, u32)> = (0..)
        .zip(&pieces.region)
        .filter(|&(t, _)| pieces.surface[t as usize])
        .map(|(t, &r)| (r, t))
        .collect();
    parallel::sort_by_key(&mut members, |&(region, t)| (region.into(), t));
    let mut regions: Vec<&[(u32, u32)]> = members.chunk_by(|a, b| a.0 == b.0).collect();
    let width = |region: &[(u32, u32)]| pieces.width[region[0].1 as usize];
    regions.sort_by(|a, b| width(b).total_cmp(&width(a)).then(a[0].cmp(&b[0])));
    regions.truncate(MAX_REGIONS);
    let mut groups: Vec<(Option<Plane>, f64, Vec<u32>)> = Vec::new();
    for region in regions {
        let triangles: Vec<u32> = region.iter().map(|r| r.1).collect();
        let area = f64::from(width(region)).powi(2);
        let plane = Plane::of(scene, triangles[0]);
        let on = |plane: &Plane| {
            triangles.iter().flat_map(|&t| scene.corners(t)).all(|p| plane.height(p).abs() <= margin)
        };
        let plane = on(&plane).then_some(plane);
        let same = plane.and_then(|_| groups.iter_mut().find(|group| group.0.as_ref().is_some_and(on)));
        match same {
            Some((_, sum, all)) => {
                *sum += area;
                all.extend(triangles);
            }
            None => groups.push((plane, area, triangles)),
        }
    }
    groups.into_iter().map(|(_, area, triangles)| (area, triangles)).collect()
}

/// For each group of triangles the centre of the box of all others: receivers lie around the geometry that a shell encloses.
fn enclosed_centres(scene: &Scene, groups: &[(f64, Vec<u32>)]) -> Vec<Vec3> {
    let mut grouped = vec![false; scene.triangles.len()];
    groups.iter().flat_map(|group| &group.1).for_each(|&t| grouped[t as usize] = true);
    let others = (0..scene.triangles.len() as u32).filter(|&t| !grouped[t as usize]);
    let others = Aabb::of(others.flat_map(|t| scene.corners(t)));
    let boxes: Vec<Aabb> =
        groups.iter().map(|group| Aabb::of(group.1.iter().flat_map(|&t| scene.corners(t)))).collect();
    let except = |own: usize| {
        let rest = boxes.iter().enumerate().filter(|&(k, _)| k != own);
        let enclosed = rest.fold(others, |all, (_, &of_group)| all.union(of_group));
        if enclosed.diagonal() > 0.0 { enclosed.center() } else { scene.bounds.center() }
    };
    (0..groups.len()).map(except).collect()
}

/// The shell of a surface that lies in one plane or encloses the scene.
fn shell(scene: &Scene, triangles: &[u32], centre: Vec3, margin: f32) -> Option<Shell> {
    let mut planes: Vec<Plane> = Vec::new();
    for &t in triangles {
        if planes
            .last()
            .is_some_and(|plane| scene.corners(t).iter().all(|&p| plane.height(p).abs() <= margin))
        {
            continue;
        }
        planes.push(Plane::of(scene, t));
        if planes.len() > MAX_PLANES {
            return None;
        }
    }
    for plane in &mut planes {
        if plane.height(centre) < 0.0 {
            *plane = Plane { normal: -plane.normal, offset: -plane.offset };
        }
    }
    // A few points refute most planes.
    let inside = |plane: &Plane| {
        let is_inside = |p: &Vec3| plane.height(*p) >= -margin;
        let few = scene.positions.iter().step_by(scene.positions.len() / FIRST_TEST_POINTS + 1);
        few.clone().all(is_inside) && scene.positions.iter().all(is_inside)
    };
    let outermost = parallel::some_map(&planes, |plane| inside(plane).then_some(())).is_some();
    let flat = || {
        let first = planes[0];
        triangles.iter().flat_map(|&t| scene.corners(t)).all(|p| first.height(p).abs() <= margin)
    };
    if !outermost && !flat() {
        return None;
    }
    planes.sort_by(|a, b| a.height(centre).total_cmp(&b.height(centre)));
    let rows = planes.chunks(LANES).map(|planes| {
        let mut row = [[0.0; LANES], [0.0; LANES], [0.0; LANES], [f32::NEG_INFINITY; LANES]];
        for (lane, plane) in planes.iter().enumerate() {
            let Plane { normal, offset } = plane;
            [row[0][lane], row[1][lane], row[2][lane], row[3][lane]] =
                [normal.x, normal.y, normal.z, *offset];
        }
        row
    });
    let heights = planes.chunks(LANES).map(|planes| planes[0].height(centre)).collect();
    Some(Shell {
        plane: planes[0],
        rows: rows.collect(),
        heights,
        centre,
        outermost,
        scene: scene.bounds,
        margin,
    })
}

// Pieces of a scene: sizes of connected parts, and large surfaces, which are never aggregated.

/// Smallest cosine between the normals of neighbouring faces of one smooth surface: 26°, below the 60° between the sides of a
/// branch of six and above those of terrain.
const SMOOTH_COSINE: f32 = 0.9;
/// Smallest width (root of the area) of a large surface, relative to the diagonal of the scene: blockers of 1/64 of a scene cast shadows
/// that its images show. The value changes time and error, which the pilot measures, but not correctness.
pub const MIN_LARGE_SURFACE: f32 = 1.0 / 64.0;

/// Properties of each triangle that the tree needs.
pub(super) struct Pieces {
    /// Size of the connected part that the triangle belongs to: root of its area; length.
    pub size: Vec<f32>,
    /// The smooth surface that it belongs to, and the width of that: root of its area; length.
    pub region: Vec<u32>,
    pub width: Vec<f32>,
    /// Whether the triangle is never averaged: its surface is large, or it emits. Facets of a lamp lie before each other at grazing angles,
    /// where an extinction would make the lamp shade itself.
    pub surface: Vec<bool>,
}

impl Pieces {
    pub fn of(scene: &Scene) -> Pieces {
        let areas = areas(scene);
        let smallest = MIN_LARGE_SURFACE * scene.near_bounds().diagonal();
        let region = smooth_surfaces(scene);
        let width = widths(&region, &areas);
        let emits = scene.triangle_emitter.iter().map(|&emitter| emitter != u32::MAX);
        let surface = width.iter().zip(emits).map(|(&width, emits)| emits || width >= smallest).collect();
        Pieces { region, width, surface, size: widths(&scene.triangle_component, &areas) }
    }
}

/// The width of the smooth surface that each triangle belongs to: root of its area; length.
#[cfg(any(test, feature = "reports"))]
pub fn surface_widths(scene: &Scene) -> Vec<f32> {
    widths(&smooth_surfaces(scene), &areas(scene))
}

/// The area of each triangle.
fn areas(scene: &Scene) -> Vec<f64> {
    parallel::map(0..scene.triangles.len() as u32, |t| scene.face_area(t))
}

/// Root of the area of the group that each triangle belongs to.
fn widths(groups: &[u32], areas: &[f64]) -> Vec<f32> {
    let mut sums = vec![0.0; groups.iter().max().map_or(0, |&g| g as usize + 1)];
    groups.iter().zip(areas).for_each(|(&group, area)| sums[group as usize] += area);
    groups.iter().map(|&group| sums[group as usize].sqrt() as f32).collect()
}

/// The smooth surface of each triangle: faces that meet at an edge with similar planes.
fn smooth_surfaces(scene: &Scene) -> Vec<u32> {
    let triangles: Vec<u32> = (0..scene.triangles.len() as u32).collect();
    let normals: Vec<Vec3> = parallel::map(&triangles, |&t| scene.face_normal(t));
    scene.joined_across_edges(&triangles, |[i, j]| {
        normals[i as usize].dot(normals[j as usize]).abs() > SMOOTH_COSINE
    })
}
