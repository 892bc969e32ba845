//! Pictures of the irradiance of what a camera sees.

use glam::{DVec3, Vec3};
use mrvis::Result;
use mrvis::internals::export::{Camera, Mesh, Stage, picture};
use mrvis::internals::radiosity::RadiosityMesh;
use mrvis::metrics::Image;

/// Image of a camera.
pub struct CameraImage {
    /// Mean irradiance over the channels, 0 where nothing is seen.
    pub image: Image<'static>,
    /// By pixel the object that is seen.
    pub objects: Vec<Option<u32>>,
}

/// What is seen from the first of two points towards the second; `angle` is the vertical angle of view.
pub fn seen(light: &RadiosityMesh, ends: [DVec3; 2], angle: f64, size: [usize; 2]) -> Result<CameraImage> {
    let mesh = Mesh::new_unless(light, &()).unwrap_or_default();
    let stage = Stage::new(&mesh, light)?;
    let camera = Camera::towards(ends, Vec3::Z, angle, light.origin);
    let frame = picture(&stage, &camera, size, light, None, &());
    let values =
        frame.first.iter().map(|first| first.map_or(0.0, |f| f.irradiance.iter().sum::<f32>() / 3.0));
    let object = |element: u32| light.elements[element as usize].object;
    Ok(CameraImage {
        image: Image::new(size[0], size[1], 1.0, values.collect::<Vec<f32>>())?,
        objects: frame.first.iter().map(|first| first.map(|f| object(f.element))).collect(),
    })
}

/// The irradiance that is seen.
pub fn irradiance(
    light: &RadiosityMesh,
    ends: [DVec3; 2],
    angle: f64,
    size: [usize; 2],
) -> Result<Image<'static>> {
    Ok(seen(light, ends, angle, size)?.image)
}
