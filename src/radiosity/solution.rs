//! The light in a scene as plain data: elements of surfaces with their radiosity and irradiance.
//!
//! What the solver makes and what outputs and comparisons read. Knows neither how it was computed nor where it goes.

use glam::{DVec3, Vec3};

/// One side of a piece of a surface, with constant light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// Indices into [`Solution::vertices`], counterclockwise seen from the lit side; a triangle repeats its third
    /// corner as the fourth.
    pub corners: [u32; 4],
    /// Radiosity (what leaves it, emission included), W/m², linear RGB.
    pub radiosity: [f64; 3],
    /// Irradiance, W/m², linear RGB.
    pub irradiance: [f64; 3],
    /// Standard uncertainty of the irradiance, W/m², linear RGB.
    pub error: [f64; 3],
    /// Diffuse reflectance, linear RGB in `[0, 1)`.
    pub albedo: [f32; 3],
    /// What the element emits, W/m², linear RGB.
    pub exitance: [f64; 3],
    /// Area, scene units squared.
    pub area: f64,
    /// How often the input surface was split to get here, 0 for the whole of it.
    pub level: u8,
    /// Links that end at the element itself or at what holds it (its ancestors).
    pub links: u32,
    /// A face of the scene on which the element lies, an index into `Scene::triangles`.
    pub triangle: u32,
    /// Index into the scene's objects.
    pub object: u32,
    /// Index into the scene's materials.
    pub material: u32,
    /// Seen from the front, where the face's corners turn counterclockwise.
    pub front: bool,
}

impl Element {
    /// Whether it has three corners.
    pub fn is_triangle(&self) -> bool {
        self.corners[2] == self.corners[3]
    }
}

/// The light in a scene.
#[derive(Clone, Debug, Default)]
pub struct Solution {
    /// Added to vertices this gives the input's coordinates.
    pub origin: DVec3,
    /// Name of the unit of length.
    pub unit: String,
    /// Corners of elements, each place once; scene units relative to `origin`.
    pub vertices: Vec<Vec3>,
    /// The leaves of all surfaces: together they cover each visible side once.
    pub elements: Vec<Element>,
}
