//! Files that show the solution of `mrvis solve`.

use super::args::{Common, distinct, plain};
use crate::{
    Result,
    export::{
        Camera, Frame, Mesh, PageView, Stage, Tone, VIEW, best_view, light_of, lightmap, render,
        unwrapped_lightmap, visible_points, write_glb, write_lightmap, write_ply, write_vtu,
    },
    image_io::{Picture, write_exr_rgb, write_png},
    points::Point,
    progress::Progress,
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
    /// solution.html: one page with pictures, irradiance in false colours, energy, error bars and times.
    Page,
    /// No files.
    None,
}

/// What was written, and the pictures of the page if one is wanted.
pub struct Written {
    /// Paths of the files.
    pub files: Vec<PathBuf>,
    /// Pictures, one per camera.
    pub views: Vec<PageView>,
}

/// Irradiance at points within a part of the remaining time; `None` if the time does not suffice.
pub type Gather<'a> = &'a dyn Fn(&[Point], f64) -> Option<Vec<[f64; 3]>>;

/// Largest number of pixels: limits memory to about 1 GB during rendering.
const MAX_PIXELS: usize = 1 << 25;
/// Rays per pixel along either side: 4 rays give edges 5 levels. Pictures only.
const SAMPLES_PER_SIDE: usize = 2;

impl Outputs {
    /// Writes the requested files into a folder, except the page, which needs the final record. `irradiance` computes the light of pixels for
    /// `--gather`; where it returns `None`, light is interpolated. Pictures are left out when `progress` has stopped.
    ///
    /// # Errors
    /// A file cannot be written, or the scene does not fit into a lightmap.
    pub fn write(
        &self,
        common: &Common,
        (scene, photometry): (&Scene, Option<Photometry>),
        solution: &RadiosityMesh,
        folder: &Path,
        with_points: bool,
        (irradiance, progress): (Gather, &dyn Progress),
    ) -> Result<Written> {
        let wants = |kind| self.wants(kind, with_points);
        let mut written = Vec::new();
        let mut file = |name: String| {
            written.push(folder.join(name));
            written[written.len() - 1].clone()
        };
        if wants(Kind::Vtu) {
            let _spinner = common.spinner("writing solution.vtu");
            write_vtu(&file("solution.vtu".into()), solution, scene, photometry)?;
        }
        if ![Kind::Ply, Kind::Glb, Kind::Lightmap, Kind::Image, Kind::Page].into_iter().any(wants) {
            return Ok(Written { files: written, views: Vec::new() });
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
                    write_lightmap(&image, &file("lightmap.obj".into()), &map, scene)?;
                    map
                }
            };
            write_png(&file("lightmap.png".into()), &developed(map.width, &map.irradiance))?;
        }
        let mut views = Vec::new();
        if wants(Kind::Image) || wants(Kind::Page) {
            let stage = Stage::new(&mesh, solution)?;
            let cameras = self.cameras(scene, solution, &stage);
            for (k, camera) in cameras.iter().enumerate() {
                let part = 1.0 / (cameras.len() - k) as f64;
                let frame = self.frame(&stage, camera, solution, (irradiance, part), progress);
                if progress.stopped() {
                    common.print(&format!("interrupted: no picture `{}`\n", camera.name))?;
                    continue;
                }
                let width = self.image_size[0];
                let picture = developed(width, &frame.radiance);
                if wants(Kind::Image) {
                    write_exr_rgb(&file(format!("{}.exr", camera.name)), width, &frame.radiance)?;
                    write_png(&file(format!("{}.png", camera.name)), &picture)?;
                }
                if wants(Kind::Page) {
                    let irradiance = frame.first.iter().map(|f| f.map(|f| f.irradiance)).collect();
                    views.push(PageView { name: camera.name.clone(), picture, irradiance });
                }
            }
        }
        Ok(Written { files: written, views })
    }

    /// The picture of a camera: by final gathering if that is asked for and there is time, else interpolated.
    fn frame(
        &self,
        stage: &Stage,
        camera: &Camera,
        solution: &RadiosityMesh,
        (irradiance, part): (Gather, f64),
        progress: &dyn Progress,
    ) -> Frame {
        if self.gather {
            let mut frame = render(stage, camera, self.image_size, 1, progress);
            if progress.stopped() {
                return frame;
            }
            if let Some(light) = irradiance(&visible_points(&frame, solution), part) {
                frame.radiance = light_of(&frame, solution, &light);
                for (first, light) in frame.first.iter_mut().flatten().zip(light) {
                    first.irradiance = light.map(|e| e as f32);
                }
                return frame;
            }
        }
        render(stage, camera, self.image_size, SAMPLES_PER_SIDE, progress)
    }

    /// Pixels of a picture.
    pub fn pixels(&self) -> usize {
        self.image_size[0] * self.image_size[1]
    }

    /// Whether the page is wanted.
    pub fn wants_page(&self) -> bool {
        self.wants(Kind::Page, true)
    }

    /// Names of the files that will be written, and of `lightmap.obj`, which depends on the texture coordinates.
    pub fn names(&self, scene: &Scene, with_points: bool) -> Vec<String> {
        let kinds: [(Kind, &[&str]); 5] = [
            (Kind::Ply, &["solution.ply"]),
            (Kind::Glb, &["solution.glb"]),
            (Kind::Vtu, &["solution.vtu"]),
            (Kind::Lightmap, &["lightmap.exr", "lightmap.png", "lightmap.obj"]),
            (Kind::Page, &["solution.html"]),
        ];
        let wanted = kinds.into_iter().filter(|(kind, _)| self.wants(*kind, with_points));
        let mut names: Vec<String> =
            wanted.flat_map(|(_, names)| names.iter().map(|name| name.to_string())).collect();
        if self.wants(Kind::Image, with_points) {
            let views = match &self.camera {
                None if !scene.cameras.is_empty() => view_names(&scene.cameras),
                _ => vec![VIEW.into()],
            };
            names.extend(views.iter().flat_map(|view| [format!("{view}.exr"), format!("{view}.png")]));
        }
        names
    }

    fn wants(&self, kind: Kind, with_points: bool) -> bool {
        let default: &[Kind] = if with_points { &[] } else { &[Kind::Glb, Kind::Vtu, Kind::Image] };
        let wanted = self.outputs.as_deref().unwrap_or(default);
        wanted.contains(&kind) && !wanted.contains(&Kind::None)
    }

    /// Whether irradiance of pixels will be computed.
    pub fn gathers(&self, with_points: bool) -> bool {
        self.gather && (self.wants(Kind::Image, with_points) || self.wants_page())
    }

    fn cameras(&self, scene: &Scene, solution: &RadiosityMesh, stage: &Stage) -> Vec<Camera> {
        let up = scene.up_axis().vector();
        let Some([x, y, z, u, v, w, degrees]) = self.camera else {
            let names = view_names(&scene.cameras).into_iter();
            let stored: Vec<Camera> =
                scene.cameras.iter().zip(names).map(|(c, name)| stored(c, name, solution)).collect();
            return if stored.is_empty() {
                vec![best_view(stage, solution, up, &scene.unit)]
            } else {
                stored
            };
        };
        let eye = (glam::DVec3::new(x, y, z) - solution.origin).as_vec3();
        let forward = (glam::DVec3::new(u, v, w) - glam::DVec3::new(x, y, z)).normalize().as_vec3();
        // Straight up or down: the picture's top is the other axis of the ground.
        let up = if up.cross(forward).length() > 1e-3 { up } else { up.yzx() };
        vec![Camera { name: VIEW.into(), eye, forward, up, angle: degrees.to_radians() as f32 }]
    }
}

/// Names of the pictures of the cameras of a file.
fn view_names(cameras: &[StoredCamera]) -> Vec<String> {
    distinct(cameras.iter().map(|c| format!("{VIEW}-{}", plain(&c.name))))
}

/// A camera of the file; its pictures get the name.
fn stored(c: &StoredCamera, name: String, solution: &RadiosityMesh) -> Camera {
    Camera {
        name,
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
