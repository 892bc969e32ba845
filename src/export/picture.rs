//! Cameras, pictures and tone mapping as the command and users of the crate ask for them.

use super::camera::{Pixel, samples_of_pixel};
use super::solve_page::PixelContent;
use super::{Camera, First, Frame, Lightmap, PageView, Stage, lightmap, render, unwrapped_lightmap};
use crate::Result;
use crate::image_io::{Picture, linear_to_srgb, luminance};
use crate::math::parallel;
use crate::points::Point;
use crate::progress::Progress;
use crate::radiosity::mesh::{Element, RadiosityMesh};
use crate::scene::{Scene, StoredCamera};
use glam::{DVec3, Vec3, Vec3Swizzles};

/// Largest number of pixels: limits memory to about 1 GB during rendering.
pub const MAX_PIXELS: usize = 1 << 25;
/// Largest numbers of columns and of rows: what common graphics hardware shows as one texture.
pub const MAX_SIDE: usize = 16_384;
/// Columns and rows of pictures by default: half the width of a usual screen.
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
    camera: &Camera,
    size: [usize; 2],
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
    developed_with(Tone::of(light.iter().copied()), width, light)
}

fn developed_with(tone: Tone, width: usize, light: &[[f32; 3]]) -> Picture {
    let pixels = parallel::map(light, |&r| tone.srgb(r));
    Picture { width, height: light.len() / width.max(1), pixels }
}

/// Luminance up to which a picture counts as dark, W/(m² sr): light that leaks between touching walls by rounding of coordinates, estimated
/// as the mean luminance of the surfaces times the spacing of f32.
fn luminance_of_rounding(solution: &RadiosityMesh) -> f32 {
    let of = |sum: (f64, f64), e: &Element| {
        let radiance = e.radiosity.map(|v| (v / std::f64::consts::PI) as f32);
        (sum.0 + e.area * f64::from(luminance(radiance)), sum.1 + e.area)
    };
    let (light, area) = solution.elements.iter().fold((0.0, f64::MIN_POSITIVE), of);
    f32::EPSILON * (light / area) as f32
}

/// Brightness of the screen, of 1, above which a face is bright: tone mapping leaves little of what the samples of a pixel on its edge
/// differ by.
const MIN_BRIGHT_FACE: f32 = 0.5;
/// Ratio of the luminances of neighbouring pixels from which on there is an edge between them. With a smaller ratio, averages of light
/// and of colours differ little, and more pixels would take further rays.
const MIN_EDGE_RATIO: f32 = 2.0;

/// The tone-mapped picture of a camera. On the edges of bright faces the colours of samples are averaged, not their light: a lamp
/// that is a hundred times brighter than white would fill all pixels that it touches.
fn smoothly_developed(
    stage: &Stage,
    solution: &RadiosityMesh,
    camera: &Camera,
    size: [usize; 2],
    frame: &Frame,
) -> Picture {
    let light = &frame.radiance;
    let tone = Tone::above(luminance_of_rounding(solution), light.iter().copied());
    let mut picture = developed_with(tone, size[0], light);
    let [columns, rows] = size;
    let is_edge = |k: usize| {
        let (x, y) = (k % columns, k / columns);
        let (across, down) =
            (x.saturating_sub(1)..(x + 2).min(columns), y.saturating_sub(1)..(y + 2).min(rows));
        let around = down.flat_map(|y| across.clone().map(move |x| light[y * columns + x]));
        let (darkest, brightest) = around.fold((light[k], light[k]), |(low, high), l| {
            (
                if luminance(l) < luminance(low) { l } else { low },
                if luminance(l) > luminance(high) { l } else { high },
            )
        });
        luminance(brightest) > MIN_EDGE_RATIO * luminance(darkest)
            && luminance(tone.linear(brightest)) > MIN_BRIGHT_FACE
    };
    parallel::for_each_mut(&mut picture.pixels, |k, colour| {
        if !is_edge(k) {
            return;
        }
        let samples = samples_of_pixel(stage, camera, size, k).map(|light| tone.linear(light));
        let mean: [f32; 3] =
            std::array::from_fn(|c| samples.iter().map(|s| s[c]).sum::<f32>() / samples.len() as f32);
        *colour = mean.map(|v| (linear_to_srgb(v) * 255.0).round() as u8);
    });
    picture
}

impl PageView {
    /// The picture of a camera on the page.
    pub fn of(
        stage: &Stage,
        solution: &RadiosityMesh,
        camera: &Camera,
        size: [usize; 2],
        frame: &Frame,
    ) -> PageView {
        let emits = |f: &First| solution.elements[f.element as usize].exitance != [0.0; 3];
        let seen = |f: &Option<First>| match f {
            None => PixelContent::Nothing,
            Some(f) if emits(f) => PixelContent::Emitter,
            Some(f) => PixelContent::Surface(f.irradiance),
        };
        PageView {
            name: camera.name.clone(),
            picture: smoothly_developed(stage, solution, camera, size, frame),
            seen: frame.first.iter().map(seen).collect(),
        }
    }
}

/// A tone curve: exposure by the mean logarithm of luminance, compressed highlights (Reinhard et al. 2002, equations 1 to 4).
#[derive(Clone, Copy, Debug)]
pub struct Tone {
    scale: f32,
    white: f32,
    /// Largest luminance that is shown as black.
    black: f32,
}

/// Luminance that the logarithmic mean is mapped to, of 1: Reinhard et al. 2002 (section 3.1) vary it from 0.18 up to
/// 0.36 and 0.72 for bright scenes. Pictures only.
const KEY: f32 = 0.25;

/// Fraction of the values that must not be black to decide on the exposure: ten of 480,000 pixels. By rounding, a few rays of a picture
/// may pass at the foot of a wall without thickness; their pixels alone would otherwise be shown as bright.
const MIN_LIT: f64 = 2e-5;

impl Tone {
    /// The curve for light like `values` (linear RGB, any unit); black values are ignored. If all but [`MIN_LIT`] of them are black,
    /// light of 1 is shown as 0.5.
    pub fn of(values: impl IntoIterator<Item = [f32; 3]>) -> Tone {
        Tone::above(0.0, values)
    }

    /// [`Tone::of`], where values of at most the luminance `black` are black.
    pub(super) fn above(black: f32, values: impl IntoIterator<Item = [f32; 3]>) -> Tone {
        let mut count = 0;
        let counted = values.into_iter().inspect(|_| count += 1);
        let mut lit: Vec<f32> = counted.map(luminance).filter(|l| l.is_finite() && *l > black).collect();
        if lit.len() as f64 <= MIN_LIT * f64::from(count) {
            return Tone { scale: 1.0, white: 1.0, black };
        }
        let logs: f64 = lit.iter().map(|l| f64::from(*l).ln()).sum();
        let scale = KEY / (logs / lit.len() as f64).exp() as f32;
        // The brightest 2 % are emitters and may be white.
        let place = (lit.len() * 98 / 100).min(lit.len() - 1);
        let bright = *lit.select_nth_unstable_by(place, f32::total_cmp).1 * scale;
        Tone { scale, white: bright.max(1.0), black }
    }

    /// Linear RGB in `[0, 1]` for display.
    pub fn linear(self, rgb: [f32; 3]) -> [f32; 3] {
        if luminance(rgb) <= self.black {
            return [0.0; 3];
        }
        let l = luminance(rgb) * self.scale;
        let shown = (1.0 + l / (self.white * self.white)) / (1.0 + l);
        rgb.map(|v| (v * self.scale * shown).clamp(0.0, 1.0))
    }

    /// The 8-bit sRGB colour.
    pub fn srgb(self, rgb: [f32; 3]) -> [u8; 3] {
        self.linear(rgb).map(|v| (linear_to_srgb(v) * 255.0).round() as u8)
    }
}

/// First hits of a picture, in coordinates of the scene's file with the normals of their elements: the points whose
/// irradiance [`light_of`] needs. Pixels without a hit are skipped.
fn visible_points(frame: &Frame, solution: &RadiosityMesh) -> Vec<Point> {
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
fn light_of(frame: &Frame, solution: &RadiosityMesh, irradiance: &[[f64; 3]]) -> Vec<[f32; 3]> {
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
