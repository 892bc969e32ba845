//! Pictures of the irradiance of what a camera sees.

use crate::Result;
use crate::export::{Camera, Mesh, Stage, picture};
use crate::metrics::Image;
use crate::radiosity::mesh::RadiosityMesh;
use glam::{DVec3, Vec3};

/// Mean irradiance over the channels, 0 where nothing is seen; the ends are the eye and what it looks at, `angle` the vertical angle of view.
pub fn irradiance(
    light: &RadiosityMesh,
    ends: [DVec3; 2],
    angle: f64,
    size: [usize; 2],
) -> Result<Image<'static>> {
    let mesh = Mesh::new_unless(light, &()).unwrap_or_default();
    let stage = Stage::new(&mesh, light)?;
    let camera = Camera::towards(ends, Vec3::Z, angle, light.origin);
    let frame = picture(&stage, (&camera, size), light, None, &());
    let values =
        frame.first.iter().map(|first| first.map_or(0.0, |f| f.irradiance.iter().sum::<f32>() / 3.0));
    Image::new(size[0], size[1], 1.0, values.collect())
}
