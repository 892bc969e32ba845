//! H-elements: what exchanges light. Clusters of the hierarchy above, sides of surfaces below, split as quadtrees.
//!
//! One notion for both [Sillion 95; method C.2, C.3]: an element has an area and, towards a direction, a projected area.
//! A surface has one normal; a cluster keeps its projected area along six axes, `P(±k) = Σ A max(0, ±n_k)`, so that
//! towards ω it is `Σ_k |ω_k| P(sign ω_k)`: exact where all contents face ω alike, above the truth elsewhere, and the
//! samples that links are measured with take the difference into account.
//!
//! The elements of a scene are one tree in one arena, parents before children. Ids are ranges that are large enough for
//! every subdivision there can be (method B.3), so that "is a part of" is a comparison, and stays one while elements
//! come and go. Light is not kept here: vectors that are as long as the arena hold it.

mod build;
mod lookup;
mod sample;
mod sides;
mod split;
#[cfg(test)]
mod tests;

pub use lookup::Lookup;
pub use sample::{Samples, spread};
pub use sides::{Entered, lit_inside};

use crate::math::Aabb;
use glam::Vec3;

/// Axes with sign: +x, -x, +y, -y, +z, -z.
pub const DIRECTIONS: usize = 6;

/// A side of an input surface: a triangle, or two that make a convex planar quad.
#[derive(Clone, Debug)]
pub struct Side {
    /// Faces of the scene; twice the same for a triangle.
    pub triangles: [u32; 2],
    /// Unit normal towards the side that is seen.
    pub normal: Vec3,
    /// Whether that is the front, where the faces' corners turn counterclockwise.
    pub front: bool,
    /// Diffuse reflectance, RGB in `[0, 1)`.
    pub reflectance: [f32; 3],
    /// What it emits, W/m², RGB.
    pub exitance: [f64; 3],
    /// The element that is all of it.
    pub element: u32,
}

/// What an element is.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A group of surfaces: index into [`Elements::clusters`].
    Cluster(u32),
    /// A part of a side.
    Surface {
        /// Index into [`Elements::sides`].
        side: u32,
        /// Counterclockwise seen from the side; a triangle repeats its third corner as the fourth.
        corners: [Vec3; 4],
    },
}

/// One element.
#[derive(Clone, Debug)]
pub struct Element {
    /// What it is.
    pub shape: Shape,
    /// Its first id and the first one beyond its parts.
    pub ids: [u64; 2],
    /// Index of the parent; the root is its own.
    pub parent: u32,
    /// Index of the first child; children are neighbours. 0 if there are none.
    pub first_child: u32,
    /// Number of children.
    pub children: u16,
    /// How often the side was split to get here; 0 for clusters.
    pub level: u8,
    /// Area of all sides in it, scene units squared.
    pub area: f64,
    /// Middle of its box.
    pub centre: Vec3,
    /// Half of the diagonal of its box.
    pub radius: f32,
}

impl Element {
    /// Whether it is a cluster.
    pub fn is_cluster(&self) -> bool {
        matches!(self.shape, Shape::Cluster(_))
    }

    /// Whether nothing lies below.
    pub fn is_leaf(&self) -> bool {
        self.children == 0
    }

    /// Indices of the children.
    pub fn child_range(&self) -> std::ops::Range<usize> {
        self.first_child as usize..self.first_child as usize + self.children as usize
    }
}

/// What a cluster knows about the sides in it.
#[derive(Clone, Debug)]
pub struct Cluster {
    /// Box around its surfaces.
    pub bounds: Aabb,
    /// Its sides, a range of [`Elements::sides`].
    pub sides: [u32; 2],
    /// Projected areas along the six directions, scene units squared.
    pub projected: [f64; DIRECTIONS],
    /// Mean reflectance of its sides, weighted by area.
    pub reflectance: f32,
}

/// All elements of a scene.
#[derive(Clone, Debug)]
pub struct Elements {
    /// The arena; the root comes first, parents before children.
    pub elements: Vec<Element>,
    /// Clusters, in the order of their elements.
    pub clusters: Vec<Cluster>,
    /// Sides, so ordered that every cluster's are neighbours.
    pub sides: Vec<Side>,
    /// Indices of the front and back side of each face; [`Elements::NONE`] where it is not seen.
    pub sides_of_triangle: Vec<[u32; 2]>,
    /// Area of all sides.
    pub area: f64,
    /// The first side of the large surfaces; those before it are in clusters that may be averaged.
    pub large_from: u32,
    /// Smallest area of an element that comes from splitting.
    pub min_area: f64,
    samples: Samples,
}

impl Elements {
    /// Stands for no side.
    pub const NONE: u32 = u32::MAX;

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// Whether there is nothing.
    pub fn is_empty(&self) -> bool {
        self.elements.is_empty()
    }

    /// Whether `part` is `whole` or lies in it.
    pub fn is_part_of(&self, part: u32, whole: u32) -> bool {
        let (part, whole) = (self.elements[part as usize].ids, self.elements[whole as usize].ids);
        whole[0] <= part[0] && part[1] <= whole[1]
    }

    /// The side of a face that a ray of this direction meets; [`Elements::NONE`] if light cannot reach it.
    pub fn met(&self, triangle: u32, direction: Vec3) -> u32 {
        let [front, back] = self.sides_of_triangle[triangle as usize];
        let (known, sense) = if front == Self::NONE { (back, -1.0) } else { (front, 1.0) };
        let Some(side) = self.sides.get(known as usize) else { return Self::NONE };
        if sense * side.normal.dot(direction) < 0.0 { front } else { back }
    }

    /// Where a cluster's sides are drawn from.
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// Bytes of the arena and its tables.
    pub fn bytes(&self) -> usize {
        self.elements.capacity() * size_of::<Element>()
            + self.clusters.capacity() * size_of::<Cluster>()
            + self.sides.capacity() * size_of::<Side>()
            + self.sides_of_triangle.capacity() * 8
            + self.samples.bytes()
    }
}

/// How far a normal faces each of the six directions.
#[inline]
pub fn facing(normal: Vec3) -> [f32; DIRECTIONS] {
    let n = normal.to_array();
    std::array::from_fn(|k| if k & 1 == 0 { n[k / 2].max(0.0) } else { (-n[k / 2]).max(0.0) })
}
