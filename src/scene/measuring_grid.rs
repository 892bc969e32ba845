//! Regular grids of measuring points over plane surfaces.

use super::Scene;
use super::{emitters::hull, size::ends};
use crate::error::quote;
use crate::{Error, Result};
use glam::{DVec2, DVec3, Vec3};

/// Largest number of points of a grid: 2,000 in either direction. Of a finer grid, the spacing is most likely stated in another unit.
const MAX_POINTS: f64 = 4e6;
/// Largest distance of corners from the plane of their surface, relative to its extent: 1 mm in 10 m.
const MAX_PLANE_DISTANCE: f64 = 1e-4;
/// Smallest cosine between the upward axis and normals that look up: 1:7 is the steepest ramp.
const UPWARD: f64 = 0.99;
/// Fraction of a spacing by which sides are taken as multiples of it: rounding of coordinates.
const MULTIPLE_TOLERANCE: f64 = 1e-4;
/// Relative difference by which a turned rectangle must be smaller than one along the axes: rounding of coordinates turns no grid.
const MIN_AREA_GAIN: f64 = 1e-3;

/// A grid of points half a spacing from the edges of the rectangle around a plane surface, as EN 12464 has it.
#[derive(Clone, Debug)]
pub struct MeasuringGrid {
    /// Number of points along the rectangle's sides: horizontal in pictures, then vertical.
    pub counts: [usize; 2],
    /// Distances of neighbouring points along both sides, at most the spacing that was asked for.
    pub steps: [f64; 2],
    /// Unit normal of the side that is measured.
    pub normal: DVec3,
    /// Points whose foot is on the surface, in coordinates of the file; row by row from the bottom of pictures.
    pub points: Vec<DVec3>,
    /// The cell of each point: its column, and its row times the number of columns.
    pub cells: Vec<usize>,
}

/// The plane of a surface.
struct Plane {
    faces: Vec<u32>,
    /// Whether faces have their fronts on both sides.
    is_mixed: bool,
    /// The point that `axes` start from.
    origin: DVec3,
    /// Unit vectors to the right and to the top of pictures, and the normal.
    axes: [DVec3; 3],
}

impl Plane {
    /// A point in the axes of the plane.
    fn place(&self, p: DVec3) -> DVec3 {
        DVec3::from(self.axes.map(|axis| axis.dot(p - self.origin)))
    }
}

impl Scene {
    /// The grid with points at most `spacing` apart, `height` above the object, group or material `name`; scene units. The surface must
    /// be plane, or its faces that look up must lie in one plane. Points lie before its front, or before the back of a sheet if all
    /// emitters are on that side. Where its faces are wound both ways, points lie above a level surface, and on the side of more fronts
    /// otherwise, unless all emitters are on the other side.
    ///
    /// # Errors
    /// Nothing has this name, the surface is not plane, or the grid has no point or too many.
    #[doc(hidden)]
    pub fn measuring_grid(&self, name: &str, spacing: f64, height: f64) -> Result<MeasuringGrid> {
        let wrong = |what: String| Err(Error::argument("grid", format!("`{}`", quote(name)), what));
        let Some(mut plane) = self.plane_of(self.faces_named(name).map_err(|error| error.of("grid"))?) else {
            return wrong(
                "the surface is curved or lies in several planes; give points of your own with ⟨points⟩"
                    .into(),
            );
        };
        let corners: Vec<DVec2> =
            self.corners_of(&plane.faces).map(|corner| plane.place(corner).truncate()).collect();
        let (right, [low, high]) = smallest_rectangle(&corners);
        let [u, v, normal] = plane.axes;
        plane.axes = [right.x * u + right.y * v, right.x * v - right.y * u, normal];
        let sides = (high - low).to_array();
        let counts = sides.map(|side| (side / spacing - MULTIPLE_TOLERANCE).ceil().max(1.0));
        if counts[0] * counts[1] > MAX_POINTS {
            return wrong(format!(
                "{} x {} points are more than 4,000,000; widen the spacing {spacing}",
                counts[0], counts[1]
            ));
        }
        let steps = [sides[0] / counts[0], sides[1] / counts[1]];
        let feet = self.feet(&plane, low, counts.map(|n| n as usize), steps);
        if feet.is_empty() {
            return wrong(format!("no point is on the surface; narrow the spacing {spacing}"));
        }
        let (cells, points) = feet.into_iter().map(|(cell, foot)| (cell, foot + height * normal)).unzip();
        Ok(MeasuringGrid { counts: counts.map(|n| n as usize), steps, normal, points, cells })
    }

    fn corners_of(&self, faces: &[u32]) -> impl Iterator<Item = DVec3> {
        faces.iter().flat_map(|&t| self.corners(t)).map(|p| p.as_dvec3())
    }

    /// Twice the area of a face along its normal.
    fn area_vector(&self, face: u32) -> DVec3 {
        let [a, b, c] = self.corners(face).map(|p| p.as_dvec3());
        (b - a).cross(c - a)
    }

    /// The plane of all faces, or of those that look up.
    fn plane_of(&self, faces: Vec<u32>) -> Option<Plane> {
        let up = self.up_axis().vector().as_dvec3();
        let looks_up = |face: &u32| self.area_vector(*face).normalize_or_zero().dot(up) > UPWARD;
        let upward: Vec<u32> = faces.iter().copied().filter(looks_up).collect();
        let mut plane = self.common_plane(faces).or_else(|| self.common_plane(upward))?;
        let height = plane.axes[2].dot(up);
        if plane.is_mixed && height < -UPWARD {
            plane.axes[2] = -plane.axes[2];
        }
        if self.only_lit_from_behind(&plane) {
            plane.axes[2] = -plane.axes[2];
        }
        let normal = plane.axes[2];
        // Pictures of walls are upright; floors are seen from above.
        let top = up - up.dot(normal) * normal;
        let is_level = normal.dot(up).abs() > UPWARD;
        let top = if is_level { normal.cross(DVec3::X) } else { top }.normalize();
        plane.axes = [top.cross(normal), top, normal];
        Some(plane)
    }

    /// The plane in which all these faces lie, with its normal on the side of more fronts by area, or of the first face's front; axes
    /// other than the normal are arbitrary.
    fn common_plane(&self, faces: Vec<u32>) -> Option<Plane> {
        let first = self.area_vector(*faces.first()?);
        // Faces that are wound the other way count reversed.
        let [mut sum, mut reversed] = [DVec3::ZERO; 2];
        for vector in faces.iter().map(|&face| self.area_vector(face)) {
            if vector.dot(first) < 0.0 {
                reversed -= vector;
            } else {
                sum += vector;
            }
        }
        let corners = || self.corners_of(&faces);
        let (low, high) = ends(corners());
        let extent = high.distance(low);
        let side = if reversed.length() > sum.length() { -1.0 } else { 1.0 };
        let normal = side * (sum + reversed).try_normalize()?;
        let origin = corners().next()?;
        let is_flat =
            corners().all(|corner| (corner - origin).dot(normal).abs() <= MAX_PLANE_DISTANCE * extent);
        let is_mixed = reversed != DVec3::ZERO;
        is_flat.then_some(Plane { faces, is_mixed, origin, axes: [normal; 3] })
    }

    /// Whether these are sheets, or their fronts are on both sides, and emitters lie behind the plane alone.
    fn only_lit_from_behind(&self, plane: &Plane) -> bool {
        // What an emitter's height above the plane may be by rounding of coordinates.
        let slack = 4e-7 * f64::from(self.bounds.magnitude());
        let mut sides = [false; 2];
        for emitter in &self.emitters {
            for corner in self.corners_of(&emitter.triangles) {
                let distance = (corner - plane.origin).dot(plane.axes[2]);
                sides[0] |= distance > slack;
                sides[1] |= distance < -slack;
            }
        }
        let is_sheet = || plane.faces.iter().all(|&face| self.triangle_sides[face as usize] == 2);
        sides == [false, true] && (plane.is_mixed || is_sheet())
    }

    /// The cells of a grid whose points are on the faces of the plane, and these points; ascending.
    fn feet(&self, plane: &Plane, low: DVec2, counts: [usize; 2], steps: [f64; 2]) -> Vec<(usize, DVec3)> {
        let [u, v, normal] = plane.axes;
        let mut height = vec![f64::NAN; counts[0] * counts[1]];
        let middle = |cell: usize, axis: usize| low[axis] + (cell as f64 + 0.5) * steps[axis];
        for &face in &plane.faces {
            // Points lie in the plane of the file, not in that to which a face below others was moved.
            let moved = self.stack_moves.get(&face).map_or(Vec3::ZERO, |of| of.by);
            let corners = self.corners(face).map(|p| plane.place((p - moved).as_dvec3()));
            let range = |axis: usize| {
                let at = corners.map(|corner| (corner[axis] - low[axis]) / steps[axis]);
                let [first, last] = [at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2])];
                first.floor().max(0.0) as usize..(last.ceil() as usize).min(counts[axis])
            };
            for row in range(1) {
                for column in range(0) {
                    let at = DVec2::new(middle(column, 0), middle(row, 1));
                    if let Some(above) = height_at(&corners, at) {
                        height[row * counts[0] + column] = above;
                    }
                }
            }
        }
        let point = |(cell, above): (usize, f64)| {
            let at = [middle(cell % counts[0], 0), middle(cell / counts[0], 1)];
            (cell, self.origin + plane.origin + at[0] * u + at[1] * v + above * normal)
        };
        height.into_iter().enumerate().filter(|(_, above)| !above.is_nan()).map(point).collect()
    }
}

/// Height above the plane of a point on a triangle; `None` beside it.
fn height_at(corners: &[DVec3; 3], at: DVec2) -> Option<f64> {
    let [a, b, c] = corners.map(DVec3::truncate);
    let area = (b - a).perp_dot(c - a);
    let parts =
        [(c - b).perp_dot(at - b), (a - c).perp_dot(at - c), (b - a).perp_dot(at - a)].map(|p| p / area);
    // Points on the common edge of two triangles are on at least one of them.
    let is_inside = parts.iter().all(|part| *part >= -1e-9);
    is_inside.then(|| (0..3).map(|k| parts[k] * corners[k].z).sum())
}

/// Direction of the lower side of the smallest rectangle around points, turned by at most 45 degrees, and its corners in axes along
/// its sides; one along the axes of the points unless another is smaller.
fn smallest_rectangle(points: &[DVec2]) -> (DVec2, [DVec2; 2]) {
    let hull = hull(points.to_vec());
    let around = |right: DVec2| {
        let places = hull.iter().map(|p| DVec2::new(right.dot(*p), right.perp_dot(*p)));
        let none = [DVec2::INFINITY, DVec2::NEG_INFINITY];
        (right, places.fold(none, |[low, high], p| [low.min(p), high.max(p)]))
    };
    let area = |&(_, [low, high]): &(DVec2, [DVec2; 2])| (high - low).element_product();
    let mut best = around(DVec2::X);
    for k in 0..hull.len() {
        let edge = (hull[(k + 1) % hull.len()] - hull[k]).normalize_or_zero();
        let turns = [edge, edge.perp(), -edge, -edge.perp()];
        let found = around(turns.into_iter().max_by(|a, b| a.x.total_cmp(&b.x)).unwrap_or(DVec2::X));
        if area(&found) < (1.0 - MIN_AREA_GAIN) * area(&best) {
            best = found;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{LoadOptions, read_from_memory};

    fn scene(text: &str) -> Scene {
        read_from_memory(None, "obj", text.as_bytes(), &LoadOptions::default()).expect("a scene")
    }

    /// A floor of 4 x 3 m that lacks a corner of 2 x 1 m, turned by `angle`; a bowl; and a table.
    fn furnished(angle: f64) -> Scene {
        let (sin, cos) = angle.sin_cos();
        let mut text = String::new();
        for [x, y] in [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 2.0], [2.0, 3.0], [0.0, 3.0]] {
            text += &format!("v {} {} 0\n", cos * x - sin * y, sin * x + cos * y);
        }
        text += "o floor\nf 1 2 3 4 5 6\nv 9 0 0\nv 10 0 .5\nv 10 1 1\nv 9 1 .5\nv 11 0 2\no bowl\nf 7 8 9 10\nf 8 11 9\n";
        text += "v 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nv 0 0 2\nv 1 0 2\nv 1 1 2\nv 0 1 2\no table\n\
                 f 15 14 13 12\nf 16 17 18 19\nf 12 13 17 16\nf 13 14 18 17\nf 14 15 19 18\nf 15 12 16 19\n";
        scene(&text)
    }

    #[test]
    fn points_are_centred_in_cells_on_the_surface() {
        for angle in [0.0f64, 0.3] {
            let scene = furnished(angle);
            let grid = scene.measuring_grid("floor", 1.0, 0.5).expect("a grid");
            assert_eq!((grid.counts, grid.points.len()), ([4, 3], 10), "angle {angle}");
            assert_eq!(grid.cells, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
            let (sin, cos) = angle.sin_cos();
            let want = DVec3::new(0.5 * cos - 0.5 * sin, 0.5 * sin + 0.5 * cos, 0.5);
            assert!(grid.points[0].distance(want) < 1e-5, "{} instead of {want}", grid.points[0]);
            assert!(grid.normal.distance(DVec3::Z) < 1e-6 && (grid.steps[1] - 1.0).abs() < 1e-5);
        }
        // A spacing that does not divide the sides becomes smaller.
        let grid = furnished(0.0).measuring_grid("floor", 0.9, 0.0).expect("a grid");
        assert_eq!(grid.counts, [5, 4]);
        // Of a solid the upward plane counts.
        let grid = furnished(0.0).measuring_grid("table", 0.5, 0.0).expect("a grid");
        assert!(grid.points.len() == 4 && grid.points.iter().all(|p| (p.z - 2.0).abs() < 1e-6));
    }

    #[test]
    fn points_below_a_rug_lie_in_the_plane_of_the_file() {
        let text = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\no floor\nf 1 2 3 4\n\
                    v 1 1 0\nv 2 1 0\nv 2 2 0\nv 1 2 0\no rug\nf 5 6 7 8\n";
        let grid = scene(text).measuring_grid("floor", 1.0, 0.0).expect("a grid");
        assert!(
            grid.points.len() == 16 && grid.points.iter().all(|p| p.z.abs() < 1e-12),
            "{:?}",
            grid.points
        );
    }

    #[test]
    fn sheets_are_measured_on_the_side_of_the_emitters() {
        let text = |height: f64| {
            format!(
                "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\no sheet\nf 1 2 3 4\n\
                     v 0 0 {height}\nv 1 0 {height}\nv 0 1 {height}\no lamp\nf 5 6 7\n"
            )
        };
        for (height, want) in [(2.0, 1.0), (-2.0, -1.0)] {
            let options = LoadOptions {
                emitters: vec![("lamp".into(), crate::Strength::Watts(1.0))],
                ..LoadOptions::default()
            };
            let scene = read_from_memory(None, "obj", text(height).as_bytes(), &options).expect("a scene");
            let grid = scene.measuring_grid("sheet", 1.0, 0.1).expect("a grid");
            assert!((grid.normal.z - want).abs() < 1e-6 && (grid.points[0].z - 0.1 * want).abs() < 1e-6);
        }
    }

    /// A surface of three quads side by side, of which the last is wound the other way; level or upright, with a lamp at this distance.
    fn wound_both_ways(is_level: bool, windings: [bool; 3], lamp: f64) -> Scene {
        let place = |x: f64, y: f64, z: f64| {
            if is_level { format!("v {x} {y} {z}\n") } else { format!("v {x} {} {y}\n", -z) }
        };
        let mut text = String::from("o surface\n");
        for x in 0..4 {
            text += &(place(f64::from(x), 0.0, 0.0) + &place(f64::from(x), 2.0, 0.0));
        }
        for (k, is_forward) in windings.into_iter().enumerate() {
            let [a, b, c, d] = [1, 3, 4, 2].map(|n| n + 2 * k);
            text += &if is_forward { format!("f {a} {b} {c} {d}\n") } else { format!("f {d} {c} {b} {a}\n") };
        }
        text += &[[1.0, 1.0], [2.0, 1.0], [1.0, 1.5]].map(|[x, y]| place(x, y, lamp)).concat();
        text += "o lamp\nf 9 10 11\n";
        let options = LoadOptions {
            emitters: vec![("lamp".into(), crate::Strength::Watts(1.0))],
            up: Some(crate::scene::UpAxis::Z),
            ..LoadOptions::default()
        };
        read_from_memory(None, "obj", text.as_bytes(), &options).expect("a scene")
    }

    #[test]
    fn surfaces_wound_both_ways_are_measured_whole_on_one_side() {
        for (is_level, windings, lamp, side) in [
            (true, [true, true, false], 2.0, 1.0),
            // The upper side of floors, whatever the side of more fronts.
            (true, [false, true, false], 2.0, 1.0),
            // The lit side of a ceiling.
            (true, [true, true, false], -2.0, -1.0),
            (false, [true, true, false], 2.0, 1.0),
            (false, [true, true, false], -2.0, -1.0),
            (false, [false, true, false], 2.0, 1.0),
        ] {
            let scene = wound_both_ways(is_level, windings, lamp);
            let grid = scene.measuring_grid("surface", 1.0, 0.1).expect("a grid");
            let normal = side * if is_level { DVec3::Z } else { -DVec3::Y };
            let case = format!("level {is_level}, wound {windings:?}, lamp {lamp}");
            assert_eq!((grid.counts, grid.points.len()), ([3, 2], 6), "{case}");
            assert!(grid.normal.distance(normal) < 1e-6, "{case}: {}", grid.normal);
            assert!(grid.points.iter().all(|p| (p.dot(normal) - 0.1).abs() < 1e-5), "{case}");
        }
    }

    #[test]
    fn what_is_not_plane_or_too_fine_is_refused_with_the_cure() {
        let scene = furnished(0.0);
        for (name, spacing, words) in [
            ("flor", 1.0, "did you mean `floor`?"),
            ("bowl", 1.0, "`points`"),
            ("floor", 1e-3, "more than 4,000,000; widen the spacing"),
        ] {
            let error = scene.measuring_grid(name, spacing, 0.0).expect_err("refused").to_string();
            assert!(error.contains(words), "{name}: {error}");
        }
    }
}
