//! Small geometry: axis-aligned boxes and what several rooms need of triangles.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// An axis-aligned box, `min <= max` on every axis unless it is [`Aabb::EMPTY`]. Scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// The corner with the smallest coordinates.
    pub min: Vec3,
    /// The corner with the largest coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// The box that holds nothing: the neutral element of [`Aabb::union`].
    pub const EMPTY: Aabb = Aabb { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box that holds all `points`.
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Aabb {
        points.into_iter().fold(Aabb::EMPTY, |b, p| Aabb { min: b.min.min(p), max: b.max.max(p) })
    }

    /// The smallest box that holds both.
    #[must_use]
    pub fn union(self, other: Aabb) -> Aabb {
        Aabb { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Extents along the axes, zero for the empty box.
    pub fn extent(self) -> Vec3 {
        (self.max - self.min).max(Vec3::ZERO)
    }

    /// The centre.
    pub fn center(self) -> Vec3 {
        0.5 * (self.min + self.max)
    }

    /// Length of the diagonal, zero for the empty box.
    pub fn diagonal(self) -> f32 {
        self.extent().length()
    }

    /// Volume, zero for flat boxes.
    pub fn volume(self) -> f64 {
        let e = self.extent().as_dvec3();
        e.x * e.y * e.z
    }

    /// The box with every extent at least a thousandth of the diagonal and sixteen roundings of its coordinates: what
    /// path lengths are measured in, so that flat boxes have a path (method A.5, D.2).
    #[must_use]
    pub fn thickened(self) -> Aabb {
        let rounding = f32::EPSILON * self.min.abs().max(self.max.abs()).max_element();
        let least = (1e-3 * self.diagonal()).max(16.0 * rounding);
        let missing = (Vec3::splat(least) - self.extent()).max(Vec3::ZERO);
        Aabb { min: self.min - 0.5 * missing, max: self.max + 0.5 * missing }
    }

    /// Whether `other` lies inside (touching allowed).
    pub fn contains(self, other: Aabb) -> bool {
        self.min.cmple(other.min).all() && self.max.cmpge(other.max).all()
    }
}

/// Area of the triangle `a b c`, in f64 so that sliver triangles keep their digits.
pub fn triangle_area(a: Vec3, b: Vec3, c: Vec3) -> f64 {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    0.5 * (b - a).cross(c - a).length()
}

/// Unit normal of the triangle `a b c` by the right-hand rule, zero if it has no area.
pub fn triangle_normal(a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    (b - a).cross(c - a).normalize_or_zero().as_vec3()
}
