//! Axis-aligned boxes, triangle areas and normals, transforms as arrays; loops on several threads.

pub mod parallel;
pub mod sampling;
mod sets;
pub mod weld;

pub use sets::Sets;

use glam::{BVec3, DAffine3, DVec3, Vec3};
use serde::{Deserialize, Serialize};

/// Largest radiance, W/(m² sr), and irradiance, W/m², of what emits: squares of sums of light stay within single precision.
pub const MAX_RADIANCE: f64 = 1e15;

/// Luminance of the linear RGB primaries of sRGB and glTF (ITU-R BT.709).
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// The linear value of an sRGB component, both in [0, 1] (IEC 61966-2-1).
pub fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// An axis-aligned box, `min <= max` on every axis unless it is [`Aabb::EMPTY`]. Scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// The corner with the smallest coordinates.
    pub min: Vec3,
    /// The corner with the largest coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// The box without points: the neutral element of [`Aabb::union`].
    pub const EMPTY: Aabb = Aabb { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box that contains all `points`; [`Aabb::EMPTY`] without points.
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Aabb {
        points.into_iter().fold(Aabb::EMPTY, |b, p| Aabb { min: b.min.min(p), max: b.max.max(p) })
    }

    /// The smallest box that contains both.
    #[must_use]
    pub fn union(self, other: Aabb) -> Aabb {
        Aabb { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Edge lengths along the axes; zero for the empty box.
    pub fn extent(self) -> Vec3 {
        (self.max - self.min).max(Vec3::ZERO)
    }

    /// Centre point; not a number for the empty box.
    pub fn center(self) -> Vec3 {
        0.5 * (self.min + self.max)
    }

    /// Length of the diagonal; zero for the empty box.
    pub fn diagonal(self) -> f32 {
        self.extent().length()
    }

    /// Half of the surface, length²; 0 for the empty box.
    pub fn half_area(self) -> f32 {
        let e = self.extent();
        e.x * e.y + e.y * e.z + e.z * e.x
    }

    /// Largest absolute coordinate of a corner.
    pub fn magnitude(self) -> f32 {
        self.min.abs().max(self.max.abs()).max_element()
    }

    /// The eight corners.
    pub fn corners(self) -> [Vec3; 8] {
        std::array::from_fn(|k| Vec3::select(BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), self.max, self.min))
    }

    /// The box around the eight transformed corners, which is larger than the box of transformed contents if they are turned.
    #[must_use]
    pub fn transformed(self, transform: &DAffine3) -> Aabb {
        Aabb::of(self.corners().map(|corner| transform.transform_point3(corner.as_dvec3()).as_vec3()))
    }

    /// Distance of a point from the box; zero inside.
    pub fn distance(self, point: Vec3) -> f32 {
        (self.min - point).max(point - self.max).max(Vec3::ZERO).length()
    }

    /// Volume, length³; zero for flat boxes.
    pub fn volume(self) -> f64 {
        let e = self.extent().as_dvec3();
        e.x * e.y * e.z
    }

    /// The box with every extent enlarged to at least 1e-3 of the diagonal and 16 rounding errors of its coordinates,
    /// so that path lengths through flat boxes are positive (docs/method.md, Extinction). The first is a fifteenth of a
    /// pixel of the silhouettes, the second keeps neighbouring f32 coordinates apart.
    #[must_use]
    pub fn thickened(self) -> Aabb {
        let rounding = f32::EPSILON * self.magnitude();
        let minimum = (1e-3 * self.diagonal()).max(16.0 * rounding);
        let missing = (Vec3::splat(minimum) - self.extent()).max(Vec3::ZERO);
        Aabb { min: self.min - 0.5 * missing, max: self.max + 0.5 * missing }
    }

    /// Whether `other` lies inside; shared boundaries count as inside.
    #[cfg(test)]
    pub fn contains(self, other: Aabb) -> bool {
        self.min.cmple(other.min).all() && self.max.cmpge(other.max).all()
    }
}

/// Area of triangle `a b c`, length². Computed in f64, accurate for slivers.
pub fn triangle_area(a: Vec3, b: Vec3, c: Vec3) -> f64 {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    0.5 * (b - a).cross(c - a).length()
}

/// Quantile of the normal distribution for an interval that holds 95 %.
pub const NORMAL_95: f64 = 1.959_964;

/// Unit normal of triangle `a b c` by the right-hand rule; zero if the triangle has no area.
pub fn triangle_normal(a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    (b - a).cross(c - a).normalize_or_zero().as_vec3()
}

/// Distance by which points are moved off the edges of a face with this largest coordinate: twice the height at which rays start above
/// faces in the path tracer (2e-6 of the coordinate), so that a wall through the edge is met like any other; scene units.
pub fn edge_distance(magnitude: f32) -> f32 {
    4e-6 * magnitude
}

/// A point on a triangle or its edge; one nearer to an edge than `distance` is moved by that distance towards the centre of the triangle,
/// at most half of the way: the light at an edge or in a corner is the limit from inside the face.
pub fn off_edges([a, b, c]: [Vec3; 3], point: Vec3, distance: f32) -> Vec3 {
    let is_near = |p: Vec3, q: Vec3| {
        let edge = q - p;
        edge.cross(point - p).length() < distance * edge.length()
    };
    if ![(a, b), (b, c), (c, a)].into_iter().any(|(p, q)| is_near(p, q)) {
        return point;
    }
    let inward = (a + b + c) / 3.0 - point;
    point + inward * (distance / inward.length()).min(0.5)
}

/// Places at which the face of a point is searched for: the point, and, for points on an edge that rays miss, places around it in the
/// plane of `normal`.
pub fn places_around(point: Vec3, normal: Vec3, distance: f32) -> [Vec3; 9] {
    let (x, y) = normal.any_orthonormal_pair();
    let around = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)];
    around.map(|(u, v)| point + distance * (u as f32 * x + v as f32 * y))
}

/// Winding number of triangles around a point: the sum of their signed solid angles over 4π (van Oosterom and Strackee 1983). In a closed
/// surface 1 if its normals point out, -1 if they point in, and 0 outside.
pub fn winding_number(triangles: impl Iterator<Item = [Vec3; 3]>, from: Vec3) -> f64 {
    let from = from.as_dvec3();
    let angle = |corners: [Vec3; 3]| {
        let [a, b, c] = corners.map(|p| (p.as_dvec3() - from).normalize_or(DVec3::X));
        2.0 * a.dot(b.cross(c)).atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))
    };
    triangles.map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

/// A point that rounding moved off the plane of a triangle, moved back onto it along the triangle's normal.
pub fn on_plane([a, b, c]: [Vec3; 3], point: Vec3) -> Vec3 {
    let normal = triangle_normal(a, b, c);
    point - normal.dot(point - a) * normal
}

/// The transform with these rows, of which the last column is the translation.
pub fn affine(rows: &[[f64; 4]; 3]) -> DAffine3 {
    let column = |i: usize| DVec3::new(rows[0][i], rows[1][i], rows[2][i]);
    DAffine3 { matrix3: glam::DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
}

/// The rows of a transform.
pub fn rows(transform: &DAffine3) -> [[f64; 4]; 3] {
    let DAffine3 { matrix3: m, translation: t } = transform;
    std::array::from_fn(|i| [m.x_axis[i], m.y_axis[i], m.z_axis[i], t[i]])
}
