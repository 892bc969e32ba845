//! Cameras and pictures as the command and users of the crate ask for them.

use super::camera::Pixel;
use super::visible_points;
use super::{Camera, Frame, Lightmap, PageView, Stage, Tone, light_of, lightmap, render, unwrapped_lightmap};
use crate::Result;
use crate::image_io::Picture;
use crate::points::Point;
use crate::progress::Progress;
use crate::radiosity::mesh::RadiosityMesh;
use crate::scene::{Scene, StoredCamera};
use glam::{DVec3, Vec3, Vec3Swizzles};
use rayon::prelude::*;

/// Largest number of pixels: limits memory to about 1 GB during rendering.
pub const MAX_PIXELS: usize = 1 << 25;
/// Largest numbers of columns and of rows.
pub const MAX_SIDE: usize = 16_384;
/// Columns and rows of pictures by default.
pub const SIZE: [usize; 2] = [800, 600];
/// Rays per pixel along either side: 4 rays give edges 5 levels. Pictures only.
const SAMPLES_PER_SIDE: usize = 2;

/// Bytes that a pixel takes while its picture is drawn, at most.
pub const fn bytes_per_pixel(gathers: bool) -> usize {
    // Rows of pixels, and the picture that they become.
    let drawn = 2 * size_of::<Pixel>();
    // The picture, and of each pixel its point, that in single precision, its irradiance and the radiance of that.
    let gathered = size_of::<Pixel>()
        + size_of::<Point>()
        + size_of::<(Vec3, Vec3)>()
        + size_of::<[f64; 3]>()
        + size_of::<[f32; 3]>();
    if gathers && gathered > drawn { gathered } else { drawn }
}

/// Irradiance at points; `None` if there is no time.
pub type Gather<'a> = &'a dyn Fn(&[Point]) -> Option<Vec<[f64; 3]>>;

impl Camera {
    /// A camera at `eye` that looks at `target`, both in coordinates of the file; `angle`: from top to bottom, radians. Where it looks
    /// straight along `up`, another axis of the ground is the picture's top.
    pub fn towards([eye, target]: [DVec3; 2], up: Vec3, angle: f64, origin: DVec3) -> Camera {
        let forward = (target - eye).normalize().as_vec3();
        let up = if up.normalize().cross(forward).length() > 1e-3 { up } else { up.yzx() };
        Camera { name: super::VIEW.into(), eye: (eye - origin).as_vec3(), forward, up, angle: angle as f32 }
    }

    /// A camera of the file; its pictures get the name.
    pub fn stored(c: &StoredCamera, name: String, origin: DVec3) -> Camera {
        Camera {
            name,
            eye: (c.eye - origin).as_vec3(),
            forward: c.forward.as_vec3(),
            up: c.up.as_vec3(),
            angle: c.angle as f32,
        }
    }
}

/// The picture of a camera: with the irradiance of each pixel by `gather`, if that is given and there is time, else interpolated.
pub fn picture(
    stage: &Stage,
    (camera, size): (&Camera, [usize; 2]),
    solution: &RadiosityMesh,
    gather: Option<Gather>,
    progress: &dyn Progress,
) -> Frame {
    if let Some(gather) = gather {
        let mut frame = render(stage, camera, size, 1, progress);
        if progress.stopped() {
            return frame;
        }
        if let Some(light) = gather(&visible_points(&frame, solution)) {
            frame.radiance = light_of(&frame, solution, &light);
            for (first, light) in frame.first.iter_mut().flatten().zip(light) {
                first.irradiance = light.map(|e| e as f32);
            }
            return frame;
        }
    }
    render(stage, camera, size, SAMPLES_PER_SIDE, progress)
}

/// The lightmap in the texture coordinates of the file if they are suitable; else one with a chart for each plane, and why.
///
/// # Errors
/// The charts do not fit into an image; [`Error::Cancelled`](crate::Error::Cancelled) if `progress` stops it.
pub fn suitable_lightmap(
    stage: &Stage,
    solution: &RadiosityMesh,
    scene: &Scene,
    texels: usize,
    progress: &dyn Progress,
) -> Result<(Lightmap, Option<String>)> {
    match unwrapped_lightmap(stage, scene, texels, progress)? {
        Ok(map) => Ok((map, None)),
        Err(why) => Ok((lightmap(stage.mesh, solution, scene, texels, progress)?, Some(why))),
    }
}

/// Tone-mapped colours of light.
pub fn developed(width: usize, light: &[[f32; 3]]) -> Picture {
    let tone = Tone::of(light.iter().copied());
    let pixels = light.par_iter().map(|&r| tone.srgb(r)).collect();
    Picture { width, height: light.len() / width.max(1), pixels }
}

impl PageView {
    /// The picture of a camera on the page.
    pub fn of(camera: &Camera, width: usize, frame: &Frame) -> PageView {
        let irradiance = frame.first.iter().map(|f| f.map(|f| f.irradiance)).collect();
        PageView { name: camera.name.clone(), picture: developed(width, &frame.radiance), irradiance }
    }
}
