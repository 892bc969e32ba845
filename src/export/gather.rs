//! Pictures with irradiance computed at each pixel instead of interpolated between elements.

use super::{First, Frame};
use crate::points::Point;
use crate::radiosity::mesh::RadiosityMesh;

/// First hits of a picture, in coordinates of the scene's file with the normals of their elements: the points whose
/// irradiance [`light_of`] needs. Pixels without a hit are skipped.
pub fn visible_points(frame: &Frame, solution: &RadiosityMesh) -> Vec<Point> {
    let point = |f: &First| {
        let element = &solution.elements[f.element as usize];
        let [a, b, c, d] = element.corners.map(|v| solution.vertices[v as usize].as_dvec3());
        let normal = (c - a).cross(d - b).normalize_or_zero();
        Point { position: solution.origin + f.position.as_dvec3(), normal }
    };
    frame.first.iter().flatten().map(point).collect()
}

/// Radiance of a picture's pixels, W/(m² sr), from the irradiance at its [`visible_points`].
///
/// # Panics
/// There are fewer values than points.
pub fn light_of(frame: &Frame, solution: &RadiosityMesh, irradiance: &[[f64; 3]]) -> Vec<[f32; 3]> {
    let mut next = irradiance.iter();
    let mut radiance = |f: &First| {
        let element = &solution.elements[f.element as usize];
        let e = next.next().expect("there is a value for each place");
        std::array::from_fn(|c| {
            let radiosity = element.exitance[c] + f64::from(element.albedo[c]) * e[c];
            (radiosity / std::f64::consts::PI) as f32
        })
    };
    // Pixels without a surface keep the sky.
    frame.first.iter().zip(&frame.radiance).map(|(f, own)| f.as_ref().map_or(*own, &mut radiance)).collect()
}
