//! Emitters: grouping, area, normal, minimum width.

use super::Emitter;
use crate::math::Sets;
use crate::math::parallel;
use glam::{DVec2, DVec3, Vec3};
use rustc_hash::FxHashMap;
use std::collections::HashMap;

/// Triangles for the grouping.
pub(super) struct Faces<'a> {
    pub positions: &'a [Vec3],
    pub triangles: &'a [[u32; 3]],
    /// Polygon of each triangle.
    pub polygon: &'a [u32],
}

impl Faces<'_> {
    fn corners(&self, t: u32) -> [DVec3; 3] {
        self.triangles[t as usize].map(|v| self.positions[v as usize].as_dvec3())
    }
}

/// Groups the emissive triangles by `sets` (of polygons), in order of the first face.
pub(super) fn group(
    faces: &Faces,
    sets: &mut Sets,
    emission: impl Fn(u32) -> [f32; 3] + Sync,
    object: impl Fn(u32) -> String,
) -> (Vec<Emitter>, Vec<u32>) {
    let mut of_triangle = vec![u32::MAX; faces.triangles.len()];
    let mut of_root = FxHashMap::default();
    let mut members: Vec<Vec<u32>> = Vec::new();
    for t in 0..faces.triangles.len() as u32 {
        if emission(t).iter().all(|&e| e <= 0.0) {
            continue;
        }
        let root = sets.root(faces.polygon[t as usize]);
        let e = *of_root.entry(root).or_insert_with(|| {
            members.push(Vec::new());
            members.len() as u32 - 1
        });
        members[e as usize].push(t);
        of_triangle[t as usize] = e;
    }
    let mut emitters: Vec<Emitter> =
        parallel::map(parallel::at_least(256, &members), |m| measure(faces, m.clone(), &emission));
    name(&mut emitters, object);
    (emitters, of_triangle)
}

/// Names emitters after their object, numbered from 1 where an object has several.
fn name(emitters: &mut [Emitter], object: impl Fn(u32) -> String) {
    // Names are the file's: the standard hasher cannot be made to collide.
    let mut count = HashMap::<String, [usize; 2]>::new();
    for e in emitters.iter_mut() {
        e.name = object(e.triangles[0]);
        match count.get_mut(&e.name) {
            Some([all, _]) => *all += 1,
            None => _ = count.insert(e.name.clone(), [1, 0]),
        }
    }
    for e in emitters.iter_mut() {
        if let Some([all, number]) = count.get_mut(&e.name)
            && *all > 1
        {
            *number += 1;
            e.name = format!("{} {number}", e.name);
        }
    }
}

impl Emitter {
    /// A part of this emitter: some of its faces, ascending.
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn part(&self, scene: &super::Scene, mut triangles: Vec<u32>) -> Emitter {
        triangles.sort_unstable();
        let super::Scene { positions, triangles: all, triangle_polygon: polygon, .. } = scene;
        let part = measure(&Faces { positions, triangles: all, polygon }, triangles, &|_| self.emission);
        Emitter { name: self.name.clone(), ..part }
    }
}

fn measure(faces: &Faces, triangles: Vec<u32>, emission: &impl Fn(u32) -> [f32; 3]) -> Emitter {
    let (mut area, mut normal, mut radiance) = (0.0, DVec3::ZERO, [0.0; 3]);
    for &t in &triangles {
        let [a, b, c] = faces.corners(t);
        let vector_area = 0.5 * (b - a).cross(c - a);
        let size = vector_area.length();
        area += size;
        normal += vector_area;
        for (sum, e) in radiance.iter_mut().zip(emission(t)) {
            *sum += size * f64::from(e);
        }
    }
    Emitter {
        name: String::new(),
        area,
        normal: (normal / area).as_vec3(),
        min_width: min_width(faces, &triangles, (normal / area).length()) as f32,
        emission: radiance.map(|r| (r / area) as f32),
        triangles,
    }
}

/// Smallest length of the mean normal of a planar surface, whose normals then spread by about arccos 0.9999 = 0.8
/// degrees: above the rounding of coordinates in files with four digits.
const MIN_PLANAR_NORMAL: f64 = 0.9999;
/// Sampled directions for surfaces that are not planar, besides the axes and the faces' normals: every direction is
/// within about 11 degrees of one, so widths are at most 1 / cos 11° − 1 = 2 % too large (see the test).
const DIRECTIONS: usize = 64;

fn min_width(faces: &Faces, triangles: &[u32], mean_normal: f64) -> f64 {
    let mut vertices: Vec<u32> = triangles.iter().flat_map(|&t| faces.triangles[t as usize]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let origin = faces.positions[vertices[0] as usize].as_dvec3();
    let points: Vec<DVec3> =
        vertices.iter().map(|&v| faces.positions[v as usize].as_dvec3() - origin).collect();
    let normals = triangles.iter().map(|&t| {
        let [a, b, c] = faces.corners(t);
        (b - a).cross(c - a).normalize_or_zero()
    });
    if mean_normal > MIN_PLANAR_NORMAL {
        let (u, v) = normals.sum::<DVec3>().normalize().any_orthonormal_pair();
        return width_of_hull(&hull(points.iter().map(|p| DVec2::new(p.dot(u), p.dot(v))).collect()));
    }
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    axes.into_iter()
        .chain(hemisphere())
        .chain(normals.take(DIRECTIONS))
        .filter(|d| *d != DVec3::ZERO)
        .map(|d| {
            let along = points.iter().map(|p| p.dot(d));
            let (lo, hi) = along.fold((f64::MAX, f64::MIN), |(lo, hi), x| (lo.min(x), hi.max(x)));
            hi - lo
        })
        .fold(f64::MAX, f64::min)
}

/// Nearly uniform directions of a hemisphere: a spiral by the golden angle.
fn hemisphere() -> impl Iterator<Item = DVec3> {
    (0..DIRECTIONS).map(|i| {
        let z = (i as f64 + 0.5) / DIRECTIONS as f64;
        let (sin, cos) = (i as f64 * std::f64::consts::PI * (3.0 - 5f64.sqrt())).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z)
    })
}

/// Convex hull, counterclockwise, without collinear points (Andrew's monotone chain).
pub(super) fn hull(mut p: Vec<DVec2>) -> Vec<DVec2> {
    p.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    p.dedup();
    let mut hull: Vec<DVec2> = Vec::new();
    let mut half = |points: &mut dyn Iterator<Item = DVec2>| {
        let start = hull.len();
        for q in points {
            while hull.len() >= start + 2 {
                let (a, b) = (hull[hull.len() - 2], hull[hull.len() - 1]);
                if (b - a).perp_dot(q - a) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(q);
        }
        // The last point is the first of the other half.
        hull.pop();
    };
    half(&mut p.iter().copied());
    half(&mut p.iter().rev().copied());
    hull
}

/// Smallest distance of two parallel lines that enclose the hull; one of them contains an edge (rotating calipers,
/// Toussaint 1983).
fn width_of_hull(hull: &[DVec2]) -> f64 {
    let n = hull.len();
    if n < 3 {
        return 0.0;
    }
    let (mut width, mut far) = (f64::MAX, 1);
    for i in 0..n {
        let (a, edge) = (hull[i], hull[(i + 1) % n] - hull[i]);
        let height = |k: usize| edge.perp_dot(hull[k % n] - a);
        // At most n steps per edge, so that rounding cannot cause an endless loop.
        for _ in 0..n {
            if height(far + 1) <= height(far) {
                break;
            }
            far = (far + 1) % n;
        }
        width = width.min(height(far) / edge.length());
    }
    width
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn width_of_polygons() {
        let check = |points: &[[f64; 2]], want: f64| {
            let (sin, cos) = 0.7f64.sin_cos();
            let turned =
                points.iter().map(|&[x, y]| DVec2::new(cos * x - sin * y + 3.0, sin * x + cos * y - 5.0));
            let got = width_of_hull(&hull(turned.collect()));
            assert!((got - want).abs() < 1e-12, "{points:?}: {got} instead of {want}");
        };
        check(&[[0.0, 0.0], [4.0, 0.0], [4.0, 1.5], [0.0, 1.5], [2.0, 0.7]], 1.5);
        check(&[[0.0, 0.0], [1.0, 0.0], [0.5, 3f64.sqrt() / 2.0]], 3f64.sqrt() / 2.0);
        let hexagon: Vec<[f64; 2]> =
            (0..6).map(|i| (f64::from(i) * std::f64::consts::FRAC_PI_3).sin_cos().into()).collect();
        check(&hexagon, 3f64.sqrt());
        check(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]], 0.0);
    }

    #[test]
    fn directions_are_unit_and_spread() {
        let d: Vec<DVec3> = hemisphere().collect();
        assert!(d.iter().all(|v| (v.length() - 1.0).abs() < 1e-12));
        // Every direction is within about 11 degrees of a sample: the error of a width is at most 2 %.
        let probes = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(-3.0, 1.0, 0.2), DVec3::new(0.1, -0.1, 1.0)];
        for p in probes.map(DVec3::normalize) {
            assert!(d.iter().any(|v| v.dot(p).abs() > 0.97), "{p}");
        }
    }
}
