//! Files that show the solution of `mrvis solve`.

use super::args::Common;
use crate::{
    Result,
    export::{
        Camera, Mesh, Stage, Tone, best_view, light_of, lightmap, render, unwrapped_lightmap, visible_points,
        write_glb, write_lightmap, write_ply, write_vtu,
    },
    image_io::{Picture, write_exr_rgb, write_png},
    points::Point,
    radiosity::mesh::RadiosityMesh,
    scene::{Photometry, Scene, StoredCamera},
};
use glam::Vec3Swizzles;
use std::path::{Path, PathBuf};

/// Options of the files that show a solution.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Outputs")]
pub struct Outputs {
    /// Files besides solution.json, separated by commas [default: glb,vtu,image; none with --points]
    #[arg(long = "output", value_name = "WHAT", value_enum, value_delimiter = ',')]
    outputs: Option<Vec<Kind>>,
    /// Columns and rows of images.
    #[arg(long, value_name = "WxH", default_value = "800x600", value_parser = size)]
    image_size: [usize; 2],
    /// Camera instead of those of the file or the automatic one: eye, target, vertical angle of view in degrees.
    #[arg(long, value_name = "X,Y,Z,X,Y,Z,DEG", value_parser = camera, allow_hyphen_values = true)]
    pub camera: Option<[f64; 7]>,
    /// Compute the irradiance of every pixel by final gathering instead of interpolation: slower and sharper.
    #[arg(long)]
    gather: bool,
    /// Approximate number of texels of a lightmap.
    #[arg(long, value_name = "N", default_value_t = 1 << 20,
          value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=1 << 26))]
    lightmap_texels: usize,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// solution.ply: mesh with colours, radiosity and irradiance at the vertices.
    Ply,
    /// solution.glb: binary glTF with vertex colours.
    Glb,
    /// solution.vtu: elements with their fields, for ParaView.
    Vtu,
    /// lightmap.exr, .png: irradiance in the texture coordinates of the file (fronts only) if they are suitable;
    /// otherwise one chart per plane, with lightmap.obj, the mesh of the charts.
    Lightmap,
    /// A picture per camera (those of a glTF file, or an automatic one): .png tone-mapped, .exr radiance.
    Image,
    /// No files.
    None,
}

/// Irradiance at points within a part of the remaining time; `None` if the time does not suffice.
pub type Gather<'a> = &'a dyn Fn(&[Point], f64) -> Option<Vec<[f64; 3]>>;

/// Largest number of pixels: limits memory to about 1 GB during rendering.
const MAX_PIXELS: usize = 1 << 25;
/// Rays per pixel along either side: 4 rays give edges 5 levels. Pictures only.
const SAMPLES_PER_SIDE: usize = 2;

impl Outputs {
    /// Writes the requested files into a folder; returns their paths. `irradiance` computes the light of pixels for
    /// `--gather`; where it returns `None`, light is interpolated.
    ///
    /// # Errors
    /// A file cannot be written, or the scene does not fit into a lightmap.
    pub fn write(
        &self,
        common: &Common,
        scene: &Scene,
        solution: &RadiosityMesh,
        folder: &Path,
        with_points: bool,
        irradiance: Gather,
        photometry: Option<Photometry>,
    ) -> Result<Vec<PathBuf>> {
        let wants = |kind| self.wants(kind, with_points);
        let mut written = Vec::new();
        let mut file = |name: String| {
            written.push(folder.join(name));
            written[written.len() - 1].clone()
        };
        if wants(Kind::Vtu) {
            let _spinner = common.spinner("writing solution.vtu");
            write_vtu(&file("solution.vtu".into()), solution, photometry)?;
        }
        if ![Kind::Ply, Kind::Glb, Kind::Lightmap, Kind::Image].into_iter().any(wants) {
            return Ok(written);
        }
        let spinner = common.spinner("smoothing");
        let mesh = Mesh::new(solution);
        let tone = Tone::of(mesh.radiosity.iter().copied());
        drop(spinner);
        if wants(Kind::Ply) {
            let _spinner = common.spinner("writing solution.ply");
            write_ply(&file("solution.ply".into()), &mesh, solution.origin, tone)?;
        }
        if wants(Kind::Glb) {
            let _spinner = common.spinner("writing solution.glb");
            write_glb(&file("solution.glb".into()), &mesh, solution.origin, scene.up_axis(), tone)?;
        }
        if wants(Kind::Lightmap) {
            let spinner = common.spinner("writing lightmap.exr");
            let stage = Stage::new(&mesh, solution)?;
            let image = file("lightmap.exr".into());
            let map = match unwrapped_lightmap(&stage, scene, self.lightmap_texels) {
                Ok(map) => {
                    write_exr_rgb(&image, map.width, &map.irradiance)?;
                    map
                }
                Err(why) => {
                    spinner.clear();
                    common.print(&format!("note: lightmap with a chart for each plane: {why}\n"))?;
                    let map = lightmap(&mesh, solution, scene, self.lightmap_texels)?;
                    write_lightmap(&image, &file("lightmap.obj".into()), &map, &mesh, solution)?;
                    map
                }
            };
            write_png(&file("lightmap.png".into()), &developed(map.width, &map.irradiance))?;
        }
        if wants(Kind::Image) {
            let _spinner = common.spinner("rendering");
            let stage = Stage::new(&mesh, solution)?;
            let cameras = self.cameras(scene, solution, &stage);
            for (k, camera) in cameras.iter().enumerate() {
                let part = 1.0 / (cameras.len() - k) as f64;
                let [width, height] = self.image_size;
                let gathered =
                    self.gather.then(|| render(&stage, camera, width, height, 1)).and_then(|frame| {
                        Some(light_of(
                            &frame,
                            solution,
                            &irradiance(&visible_points(&frame, solution), part)?,
                        ))
                    });
                let radiance = gathered
                    .unwrap_or_else(|| render(&stage, camera, width, height, SAMPLES_PER_SIDE).radiance);
                write_exr_rgb(&file(format!("{}.exr", camera.name)), width, &radiance)?;
                write_png(&file(format!("{}.png", camera.name)), &developed(width, &radiance))?;
            }
        }
        Ok(written)
    }

    fn wants(&self, kind: Kind, with_points: bool) -> bool {
        let default: &[Kind] = if with_points { &[] } else { &[Kind::Glb, Kind::Vtu, Kind::Image] };
        let wanted = self.outputs.as_deref().unwrap_or(default);
        wanted.contains(&kind) && !wanted.contains(&Kind::None)
    }

    /// Whether irradiance of pixels will be computed.
    pub fn gathers(&self, with_points: bool) -> bool {
        self.gather && self.wants(Kind::Image, with_points)
    }

    fn cameras(&self, scene: &Scene, solution: &RadiosityMesh, stage: &Stage) -> Vec<Camera> {
        let up = scene.up_axis().vector();
        let Some([x, y, z, u, v, w, degrees]) = self.camera else {
            let stored: Vec<Camera> = scene.cameras.iter().map(|c| stored(c, solution)).collect();
            return if stored.is_empty() { vec![best_view(stage, solution, up)] } else { stored };
        };
        let eye = (glam::DVec3::new(x, y, z) - solution.origin).as_vec3();
        let forward = (glam::DVec3::new(u, v, w) - glam::DVec3::new(x, y, z)).normalize().as_vec3();
        // Straight up or down: the picture's top is the other axis of the ground.
        let up = if up.cross(forward).length() > 1e-3 { up } else { up.yzx() };
        vec![Camera { name: "view".into(), eye, forward, up, angle: degrees.to_radians() as f32 }]
    }
}

/// A camera of the file; its pictures get its name.
fn stored(c: &StoredCamera, solution: &RadiosityMesh) -> Camera {
    let plain = |c: char| if c.is_alphanumeric() || "-_".contains(c) { c } else { '_' };
    Camera {
        name: format!("view-{}", c.name.chars().take(60).map(plain).collect::<String>()),
        eye: (c.eye - solution.origin).as_vec3(),
        forward: c.forward.as_vec3(),
        up: c.up.as_vec3(),
        angle: c.angle as f32,
    }
}

/// Tone-mapped colours of light.
fn developed(width: usize, light: &[[f32; 3]]) -> Picture {
    let tone = Tone::of(light.iter().copied());
    let pixels = light.iter().map(|&r| tone.srgb(r)).collect();
    Picture { width, height: light.len() / width.max(1), pixels }
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    sides
        .filter(|s: &[usize; 2]| s.iter().all(|n| (1..=16_384).contains(n)) && s[0] * s[1] <= MAX_PIXELS)
        .ok_or_else(|| "columns x rows, 1 to 16384 each and at most 2^25 pixels, such as 800x600".into())
}

fn camera(text: &str) -> Result<[f64; 7], String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|w| w.trim().parse().ok()).collect();
    let bad = || "seven numbers: eye x,y,z, target x,y,z, angle of view in degrees (1 to 170)".to_owned();
    let camera: [f64; 7] = numbers.try_into().map_err(|_| bad())?;
    let distinct = (0..3).any(|k| camera[k] != camera[k + 3]);
    let fine = camera.iter().all(|v| v.is_finite()) && distinct && (1.0..=170.0).contains(&camera[6]);
    if fine { Ok(camera) } else { Err(bad()) }
}
