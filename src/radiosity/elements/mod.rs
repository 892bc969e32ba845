//! Elements, which exchange light. Clusters of the hierarchy above, sides of surfaces below, subdivided as quadtrees.
//!
//! Clusters and surfaces have one interface [Sillion 95]: an element has an area and, towards a direction, a projected area.
//! A surface has one normal. A cluster stores its projected area along six directions, `P(±k) = Σ A max(0, ±n_k)`, so that
//! its projected area towards ω is `Σ_k |ω_k| P(sign ω_k)`: exact where all surfaces face ω alike, an upper bound elsewhere.
//! The samples that links are measured with correct the difference.
//!
//! The elements of a scene are one tree in one arena, parents before children; indices never change. Each element owns a range
//! of ids that is large enough for every possible subdivision, so that "is a part of" is a comparison of ranges and stays
//! valid while elements are added. The solver's own data, [`ElementState`], are a column of the same arena. Indices and these ids
//! belong to one solution; ids of surfaces that outlast it are in `instances`.

mod build;
mod cuts;
pub mod emitter_tree;
pub mod emitters;
mod instances;
mod lit_sides;
mod lookup;
mod profiles;
mod side_sampling;
mod subdivision;
#[cfg(test)]
mod tests;

use super::rgb::Rgb;
use crate::math::Aabb;
use crate::ray::EndRule;
use crate::scene::{FineGround, InstanceTriangles, Profile};
pub use cuts::{ChildrenOutlines, CutPlane};
use glam::Vec3;
pub use lit_sides::{DarkSideHit, lit_inside};
pub use lookup::Lookup;
pub use profiles::{emission_gain, mean_over};
pub use side_sampling::SideSampler;
use std::sync::Arc;
pub use subdivision::{area as surface_area, centres_of_quarters, centroid, inner_radius, quarters};

/// Number of signed axes, in the order +x, -x, +y, -y, +z, -z.
pub const DIRECTIONS: usize = 6;

/// A side of an input surface: a triangle, or two that make a convex planar quad.
#[derive(Clone, Debug)]
pub struct Side {
    /// Faces of the scene; twice the same for a triangle.
    pub triangles: [u32; 2],
    /// Unit normal on the side that is seen.
    pub normal: Vec3,
    /// The rule for ends of segments on the side.
    pub end: EndRule,
    /// Whether this is the front, from which the corners of the faces turn counterclockwise.
    pub front: bool,
    /// Diffuse reflectance, RGB in `[0, 1)`.
    pub reflectance: [f32; 3],
    /// Exitance, W/m², RGB.
    pub exitance: [f64; 3],
    /// Directions in which the side emits; none for diffuse emission.
    pub profile: Option<Arc<Profile>>,
    /// The element that covers the whole side.
    pub element: u32,
}

impl Side {
    /// Radiosity under an irradiance, both W/m².
    pub fn radiosity(&self, irradiance: Rgb) -> Rgb {
        std::array::from_fn(|k| self.exitance[k] + f64::from(self.reflectance[k]) * irradiance[k])
    }
}

/// The kind of an element.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A group of surfaces: index into [`Elements::clusters`].
    Cluster(u32),
    /// A side or a part of a side.
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
    /// Cluster or surface.
    pub shape: Shape,
    /// First id of the element and first id beyond its parts.
    pub ids: [u64; 2],
    /// Index of the parent; the root is its own parent.
    pub parent: u32,
    /// Index of the first child; children have consecutive indices. 0 without children.
    pub first_child: u32,
    /// Number of children.
    pub children: u16,
    /// Number of subdivisions above the element; 0 for clusters and whole sides.
    pub level: u8,
    /// Whether its children are parts that a plane cuts it into ([`Elements::cut`]), or it is below such a part: the child that holds a
    /// point is found by the outlines of the children instead of the parameters of the side.
    pub is_irregular: bool,
    /// Area of all its sides, scene units squared.
    pub area: f64,
    /// Centre of its bounding box (surfaces: of its corners).
    pub centre: Vec3,
    /// Half of the diagonal of its bounding box, scene units.
    pub radius: f32,
}

impl Element {
    /// Whether the element is a cluster.
    pub fn is_cluster(&self) -> bool {
        matches!(self.shape, Shape::Cluster(_))
    }

    /// Whether the element has no children.
    pub fn is_leaf(&self) -> bool {
        self.children == 0
    }

    /// Indices of the children.
    pub fn child_range(&self) -> std::ops::Range<usize> {
        self.first_child as usize..self.first_child as usize + self.children as usize
    }
}

/// Properties of a cluster.
#[derive(Clone, Debug)]
pub struct Cluster {
    /// Bounding box of its surfaces.
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
    /// The arena: geometry of the elements. The root comes first, parents before children. [`Elements::split`] and [`Elements::cut`] add
    /// some, to both lists at once, so that an index means the same element in each. There are two lists because most loops need either
    /// geometry or light: with one list the solution of a living room of 377,000 faces by links took 3 % more CPU time (`mrvis solve
    /// livingroom.obj --local-rays 0`).
    pub elements: Vec<Element>,
    /// The arena: light, importance, feature size and row factors of each element.
    pub states: Vec<ElementState>,
    /// Clusters; cluster c belongs to element c.
    pub clusters: Vec<Cluster>,
    /// Sides, ordered so that those of every cluster are consecutive.
    pub sides: Vec<Side>,
    /// Indices of the front and back side of each face; [`Elements::NONE`] for a side that light cannot reach.
    pub sides_of_triangle: Vec<[u32; 2]>,
    /// Area of all sides.
    pub area: f64,
    /// First side of the large surfaces. Sides before it are in clusters that may be averaged.
    pub large_from: u32,
    /// Smallest area of an element that subdivision makes, scene units squared.
    pub min_area: f64,
    /// Sides without elements because no light reaches them, with their corners.
    pub dark: Vec<(Side, [Vec3; 4])>,
    samples: SideSampler,
    /// The triangles of each instance of the scene.
    instances: Vec<InstanceTriangles>,
}

impl Elements {
    /// Index that stands for no side.
    pub const NONE: u32 = u32::MAX;

    /// Whether any side emits by a profile of directions. Links take such emission as diffuse, rays do not.
    pub fn has_profiles(&self) -> bool {
        self.sides.iter().any(|side| side.profile.is_some())
    }

    /// The corners of a side, counterclockwise; a triangle repeats its third.
    pub fn corners(&self, side: &Side) -> &[Vec3; 4] {
        match &self.elements[side.element as usize].shape {
            Shape::Surface { corners, .. } => corners,
            Shape::Cluster(_) => unreachable!("sides are surfaces"),
        }
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// The side of a face that a ray of this direction meets; [`Elements::NONE`] if light cannot reach it.
    pub fn met(&self, triangle: u32, direction: Vec3) -> u32 {
        let [front, back] = self.sides_of_triangle[triangle as usize];
        let (known, sense) = if front == Self::NONE { (back, -1.0) } else { (front, 1.0) };
        let Some(side) = self.sides.get(known as usize) else { return Self::NONE };
        let cosine = sense * side.normal.dot(direction);
        // Front and back are the same side for fine ground.
        let is_back = front == back && cosine > FineGround::MAX_BACK * direction.length();
        match cosine < 0.0 {
            true => front,
            false if is_back => Self::NONE,
            false => back,
        }
    }

    /// Draws sides of clusters.
    pub fn samples(&self) -> &SideSampler {
        &self.samples
    }

    /// Bytes of the arena and its tables.
    pub fn bytes(&self) -> usize {
        self.elements.capacity() * size_of::<Element>()
            + self.states.capacity() * size_of::<ElementState>()
            + self.clusters.capacity() * size_of::<Cluster>()
            + self.sides.capacity() * size_of::<Side>()
            + self.sides_of_triangle.capacity() * 8
            + self.samples.bytes()
    }
}

/// Positive parts of the cosines between a unit vector and the six directions.
#[inline]
pub fn facing(normal: Vec3) -> [f32; DIRECTIONS] {
    let n = normal.to_array();
    std::array::from_fn(|k| if k & 1 == 0 { n[k / 2].max(0.0) } else { (-n[k / 2]).max(0.0) })
}

/// Light, importance, feature size and row factors of one element; the arena holds its geometry under the same index.
#[derive(Clone, Copy, Debug)]
pub struct ElementState {
    /// Radiosity, W/m²: for an element with children the mean by area.
    pub radiosity: Rgb,
    /// Irradiance of a surface element, W/m²; 0 for clusters.
    pub irradiance: Rgb,
    /// Statistics for the error oracle.
    pub statistics: LightStatistics,
    /// Row normalisation of a leaf.
    pub factors: RowFactors,
    /// Target sum of the form factors of a leaf: 1, or less where other surfaces cover part of the leaf.
    pub row_target: f32,
    /// Shadow features smaller than this on the element may be averaged, scene units.
    pub feature_size: f32,
    /// Weight of errors here relative to the most important element, in `(0, 1]`; 1 where everything is important.
    pub importance: f32,
    /// Whether another surface crosses the element, so that its mean light is wrong on both sides of that surface. Such an element does not
    /// exchange light, and paths that hit it continue from the hit point.
    pub crossed: bool,
    /// Whether the element lies in a gap narrower than itself, along which light decays within its size. Such an element exchanges no
    /// light either.
    pub narrow: bool,
    /// Width of the rim of an element that another surface crosses so near to an edge that it is not cut there, scene units; 0 of other
    /// elements. No rays start in the rim, as part of it lies beyond that surface.
    pub rim: f32,
}

impl ElementState {
    /// An element without light.
    pub const DARK: ElementState = ElementState {
        radiosity: [0.0; 3],
        irradiance: [0.0; 3],
        statistics: LightStatistics { mean: 0.0, deviation: 0.0, weight: 0.0 },
        factors: RowFactors::ONE,
        row_target: 1.0,
        feature_size: 0.0,
        importance: 1.0,
        crossed: false,
        narrow: false,
        rim: 0.0,
    };

    /// Whether the element does not exchange light, and paths that hit it continue from the hit point.
    pub fn is_excluded(&self) -> bool {
        self.crossed || self.narrow
    }

    /// The state of a quarter of an element with this state: the same light, which varies half as much over half the size.
    pub fn of_part(self) -> ElementState {
        let statistics = LightStatistics { deviation: 0.5 * self.statistics.deviation, ..self.statistics };
        ElementState { statistics, ..self }
    }
}

/// The light that an element sends out, as the error oracle needs it.
#[derive(Clone, Copy, Debug, Default)]
pub struct LightStatistics {
    /// Mean radiosity, W/m², mean over the channels.
    pub mean: f32,
    /// Standard deviation of the radiosity inside the element, W/m².
    pub deviation: f32,
    /// Weight of an error of the element's irradiance: reflectance times importance.
    pub weight: f32,
}

/// Row normalisation of a leaf: factors by which its light is multiplied so that its form factors have the right sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowFactors {
    /// Factor of the irradiance that arrives.
    pub gathers: f32,
    /// Factor of the radiosity that is sent.
    pub sends: f32,
}

impl RowFactors {
    /// No normalisation.
    pub const ONE: RowFactors = RowFactors { gathers: 1.0, sends: 1.0 };
}
