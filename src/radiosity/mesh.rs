//! The light in a scene as plain data: the leaf elements of all surfaces with their radiosity and irradiance.
//!
//! The solver makes it; outputs and comparisons read it. Neither the method nor the file formats appear here.

use glam::{DVec3, Vec3};

/// One side of a piece of a surface, with constant light; see [`Solution::elements`](crate::Solution::elements).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Element {
    /// Indices into [`Solution::vertices`](crate::Solution::vertices), counterclockwise seen from the lit side; a triangle repeats its
    /// third corner as the fourth.
    pub corners: [u32; 4],
    /// Radiosity, emission included, W/m², linear RGB.
    pub radiosity: [f64; 3],
    /// Irradiance, W/m², linear RGB.
    pub irradiance: [f64; 3],
    /// Standard uncertainty of the irradiance, W/m², linear RGB.
    pub error: [f64; 3],
    /// Diffuse reflectance, linear RGB in `[0, 1)`.
    pub albedo: [f32; 3],
    /// Exitance, W/m², linear RGB.
    pub exitance: [f64; 3],
    /// Area, scene units squared.
    pub area: f64,
    /// Number of subdivisions of the input surface above the element; 0 for the whole surface.
    pub level: u8,
    /// Links that end at the element or at its ancestors.
    pub links: u32,
    /// A triangle of the scene that the element lies on.
    pub triangle: u32,
    /// Index into [`Scene::object_names`](crate::Scene::object_names).
    pub object: u32,
    /// Index into [`Scene::material_names`](crate::Scene::material_names).
    pub material: u32,
    /// Whether the element is on the front of the face, from which its corners turn counterclockwise.
    pub front: bool,
    /// Whether another surface stands across the element, as the foot of a thin wall does: its light is the mean of both sides of that.
    pub crossed: bool,
    /// Whether another surface covers all of the element at a distance less than the element's size: light ends where such a gap ends.
    pub narrow: bool,
    /// Edges along which another surface stands or ends above, by bit, the first from the first corner to the second: light may differ
    /// abruptly there.
    pub walls: u8,
}

impl Element {
    /// Whether the element has three corners.
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn is_triangle(&self) -> bool {
        self.corners[2] == self.corners[3]
    }

    /// The corners, each once.
    #[cfg(any(test, feature = "reports"))]
    pub(crate) fn outline(&self) -> &[u32] {
        &self.corners[..if self.is_triangle() { 3 } else { 4 }]
    }
}

/// The instance of an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedElement {
    /// Index into the instances of the scene: 0 for its own triangles, then the placed meshes in their order.
    pub instance: u32,
    /// Id of the surface and its part; other instances do not change it when they move, hide or are removed.
    pub id: u64,
}

/// The light in a scene.
#[derive(Clone, Debug, Default)]
pub struct RadiosityMesh {
    /// Offset that turns vertices into the coordinates of the input.
    pub origin: DVec3,
    /// Corners of elements, each position once; scene units relative to `origin`.
    pub vertices: Vec<Vec3>,
    /// The leaves of all surfaces, which cover each lit side once, then the sides that no light reaches, whole and black.
    pub elements: Vec<Element>,
    /// Number of these dark sides.
    pub dark: usize,
    /// The instance of each element; empty in scenes without placed meshes.
    pub instances: Vec<PlacedElement>,
}

impl RadiosityMesh {
    /// Number of the leaves, which are the first elements.
    pub fn lit(&self) -> usize {
        self.elements.len() - self.dark
    }
}
