//! Files that show the solution of `mrvis solve`.

use super::args::{Common, distinct, plain};
use glam::DVec3;
use mrvis::internals::export::{
    Camera, MAX_PIXELS, MAX_SIDE, Mesh, PageView, Stage, Tone, VIEW, best_view, bytes_per_pixel, developed,
    picture, scene_view, suitable_lightmap, write_glb, write_lightmap_mesh, write_ply, write_vtu,
};
use mrvis::internals::image_io::{Picture, write_exr_rgb, write_png};
use mrvis::internals::plot::number;
use mrvis::internals::points::Point;
use mrvis::internals::radiosity::RadiosityMesh;
use mrvis::internals::scene::{Photometry, StoredCamera};
use mrvis::{Progress, Result, Scene};
use std::path::{Path, PathBuf};

/// Options of the files that show a solution.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Outputs")]
pub struct Outputs {
    /// Files besides solution.json, separated by commas [default: glb,vtu,image; none with --points or --grid]
    #[arg(long = "output", value_name = "WHAT", value_enum, value_delimiter = ',')]
    outputs: Option<Vec<Kind>>,
    /// Columns and rows of images.
    #[arg(long, value_name = "WxH", default_value = "800x600", value_parser = size)]
    image_size: [usize; 2],
    /// Camera instead of those of the file or the automatic one: eye, target, vertical angle of view in degrees.
    /// `scene`: where the file has none, an automatic one that does not depend on the light, so that pictures of
    /// several solutions can be compared.
    #[arg(long, value_name = "X,Y,Z,X,Y,Z,DEG|scene", value_parser = camera, allow_hyphen_values = true)]
    camera: Option<CameraArg>,
    /// Gather the light of every pixel by rays: slower and sharper than interpolation.
    #[arg(long)]
    gather: bool,
    /// Show rooms from outside: surfaces are transparent from sides that no light can reach, as the outside of a closed
    /// room, instead of black.
    #[arg(long)]
    look_inside: bool,
    /// Approximate number of texels of a lightmap.
    #[arg(long, value_name = "N", default_value_t = 1 << 20,
          value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=1 << 26))]
    lightmap_texels: usize,
}

/// `--camera`.
#[derive(Clone, Copy, Debug, PartialEq)]
enum CameraArg {
    /// Eye, target, vertical angle of view in degrees.
    Stated([f64; 7]),
    /// That of the file, or an automatic one by the scene alone.
    Scene,
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

/// All kinds of files.
const KINDS: [Kind; 6] = [Kind::Ply, Kind::Glb, Kind::Vtu, Kind::Lightmap, Kind::Image, Kind::Page];

/// Written files, and the pictures of the page if one is requested.
pub struct Written {
    /// Paths of the files.
    pub files: Vec<PathBuf>,
    /// Pictures, one per camera.
    pub views: Vec<PageView>,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// The files of a folder that are written unless the caller stops.
pub struct Files<'a> {
    common: &'a Common,
    folder: &'a Path,
    progress: &'a dyn Progress,
    /// Paths of the files so far.
    written: Vec<PathBuf>,
    /// Notes for the user about them.
    notes: Vec<String>,
}

impl<'a> Files<'a> {
    /// No files yet. Once `progress` has stopped, only `solution.vtu` is written; it does not stop for small solutions.
    pub fn new(common: &'a Common, folder: &'a Path, progress: &'a dyn Progress) -> Files<'a> {
        Files { common, folder, progress, written: Vec::new(), notes: Vec::new() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes a file, or notes that it is left out.
    fn write(&mut self, name: &str, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
        let spinner = self.common.spinner(format!("writing {name}"));
        let path = self.path(name);
        let done = (!self.progress.stopped()).then(|| write(&path));
        drop(spinner);
        match done {
            Some(Ok(())) => self.written.push(path),
            // A file that was stopped in its middle does not appear.
            Some(Err(error)) if !self.progress.stopped() => return Err(error),
            _ => drop(self.left_out(name)?),
        }
        Ok(())
    }

    /// Whether the caller has stopped; then notes that the file is left out.
    fn left_out(&self, name: &str) -> Result<bool> {
        if self.progress.stopped() {
            self.common.print(&format!("interrupted: no `{name}`\n"))?;
        }
        Ok(self.progress.stopped())
    }
}

/// Irradiance at points within a fraction of the remaining time; `None` if the time does not suffice.
pub type Gather<'a> = &'a dyn Fn(&[Point], f64) -> Option<Vec<[f64; 3]>>;

impl Outputs {
    /// Bytes that the pictures take while one of them is drawn, at most.
    pub fn picture_bytes(&self) -> u64 {
        let [columns, rows] = self.image_size.map(|n| n as u64);
        let wanted =
            self.outputs.as_ref().is_none_or(|o| o.contains(&Kind::Image) || o.contains(&Kind::Page));
        if wanted { columns * rows * bytes_per_pixel(self.gather) as u64 } else { 0 }
    }

    /// Writes the requested files into a folder, except the page, which needs the final record. `irradiance` computes the light of pixels
    /// for `--gather`; where it returns `None`, light is interpolated.
    ///
    /// # Errors
    /// A file cannot be written, or the scene does not fit into a lightmap.
    pub fn write(
        &self,
        mut files: Files,
        scene: &Scene,
        photometry: Option<Photometry>,
        solution: &RadiosityMesh,
        with_points: bool,
        irradiance: Gather,
    ) -> Result<Written> {
        let wants = |kind| self.wants(kind, with_points);
        let (common, progress) = (files.common, files.progress);
        if wants(Kind::Vtu) {
            let _spinner = common.spinner("writing solution.vtu");
            let file = files.path("solution.vtu");
            write_vtu(&file, solution, scene, photometry, &())?;
            files.written.push(file);
        }
        let mut views = Vec::new();
        if !KINDS.into_iter().any(|kind| kind != Kind::Vtu && wants(kind)) {
            return Ok(Written { files: files.written, views, notes: files.notes });
        }
        let spinner = common.spinner("smoothing");
        let mesh = Mesh::new_unless(solution, progress);
        let tone = Tone::of(mesh.iter().flat_map(|mesh| mesh.radiosity.iter().copied()));
        drop(spinner);
        // Without a mesh nothing is written: the caller has stopped.
        let mesh = mesh.unwrap_or_default();
        if wants(Kind::Ply) {
            files.write("solution.ply", |path| write_ply(path, &mesh, solution.origin, tone, progress))?;
        }
        if wants(Kind::Glb) {
            let (origin, up) = (solution.origin, scene.up_axis());
            files.write("solution.glb", |path| write_glb(path, &mesh, origin, up, tone, progress))?;
        }
        if wants(Kind::Lightmap) && !files.left_out("lightmap.exr")? {
            self.write_lightmap(&mut files, &mesh, solution, scene)?;
        }
        if wants(Kind::Image) || wants(Kind::Page) {
            let wants_images = wants(Kind::Image);
            views = self.write_views(&mut files, &mesh, solution, scene, wants_images, irradiance)?;
        }
        Ok(Written { files: files.written, views, notes: files.notes })
    }

    /// The lightmap, in the texture coordinates of the file if they are suitable.
    fn write_lightmap(
        &self,
        files: &mut Files,
        mesh: &Mesh,
        solution: &RadiosityMesh,
        scene: &Scene,
    ) -> Result<()> {
        let (common, progress) = (files.common, files.progress);
        let spinner = common.spinner("drawing the lightmap");
        let stage = Stage::new(mesh, solution)?.looking_inside(true);
        let (map, why) = match suitable_lightmap(&stage, solution, scene, self.lightmap_texels, progress) {
            Err(_) if files.left_out("lightmap.exr")? => return Ok(()),
            drawn => drawn?,
        };
        drop(spinner);
        if let Some(why) = &why {
            common.print(&format!("note: lightmap with a chart for each plane: {why}\n"))?;
        }
        let light = &map.irradiance;
        files.write("lightmap.exr", |path| write_exr_rgb(path, map.width, light, progress))?;
        if why.is_some() {
            let write = |path: &Path| write_lightmap_mesh(path, &map, scene, "lightmap.exr", progress);
            files.write("lightmap.obj", write)?;
        }
        let picture = if progress.stopped() { Picture::default() } else { developed(map.width, light) };
        files.write("lightmap.png", |path| write_png(path, &picture))
    }

    /// The pictures of all cameras, for the page and, if wanted, as files.
    fn write_views(
        &self,
        files: &mut Files,
        mesh: &Mesh,
        solution: &RadiosityMesh,
        scene: &Scene,
        wants_images: bool,
        irradiance: Gather,
    ) -> Result<Vec<PageView>> {
        let (common, progress) = (files.common, files.progress);
        let mut views = Vec::new();
        if progress.stopped() {
            common.print("interrupted: no pictures\n")?;
            return Ok(views);
        }
        // The automatic camera stands outside of closed rooms that are too low for it.
        let is_automatic = self.stated_camera().is_none() && scene.parts().cameras.is_empty();
        let stage = Stage::new(mesh, solution)?
            .looking_inside(self.look_inside || is_automatic)
            .under(scene.parts().sky);
        let cameras = self.cameras(scene, solution, &stage)?;
        for (k, camera) in cameras.iter().enumerate() {
            let part = 1.0 / (cameras.len() - k) as f64;
            let gather = |points: &[Point]| irradiance(points, part);
            let gather = self.gather.then_some(&gather as _);
            let frame = picture(&stage, camera, self.image_size, solution, gather, progress);
            if progress.stopped() {
                common.print(&format!("interrupted: no picture `{}`\n", camera.name))?;
                continue;
            }
            let width = self.image_size[0];
            if frame.radiance.iter().all(|l| *l == [0.0; 3]) {
                files.notes.push(self.sees_nothing(camera, scene));
            }
            let view = PageView::of(&stage, solution, camera, self.image_size, &frame);
            if wants_images {
                let name = |kind| format!("{}.{kind}", camera.name);
                files.write(&name("exr"), |path| write_exr_rgb(path, width, &frame.radiance, progress))?;
                files.write(&name("png"), |path| write_png(path, &view.picture))?;
            }
            if self.wants_page() {
                views.push(view);
            }
        }
        Ok(views)
    }

    /// The note on a camera whose picture is black.
    fn sees_nothing(&self, camera: &Camera, scene: &Scene) -> String {
        let bounds = scene.world_bounds();
        let [low, high] = [bounds.min, bounds.max].map(|corner| {
            let corner = scene.parts().origin + corner.as_dvec3();
            corner.to_array().map(number).join(", ")
        });
        let eye = (scene.parts().origin + camera.eye.as_dvec3()).to_array().map(number).join(", ");
        let cure = match self.stated_camera() {
            Some(_) => "give --camera another target, or leave it out for an automatic one",
            None => "give one with --camera",
        };
        let outside = if self.look_inside {
            ""
        } else {
            " (closed rooms are black from outside; --look-inside shows what is in them)"
        };
        format!(
            "{}.png, of a camera at {eye}, is black{outside}: the scene reaches from {low} to {high}; {cure}",
            camera.name
        )
    }

    /// Pixels of the largest image that is written.
    pub fn pixels(&self, with_points: bool) -> usize {
        let texels = if self.wants(Kind::Lightmap, with_points) { self.lightmap_texels } else { 0 };
        texels.max(self.image_size[0] * self.image_size[1])
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
            let views = match self.stated_camera() {
                None if !scene.parts().cameras.is_empty() => view_names(scene.parts().cameras),
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

    /// Whether files show the light of elements.
    pub fn need_elements(&self, with_points: bool) -> bool {
        !with_points || KINDS.into_iter().any(|kind| self.wants(kind, with_points))
    }

    /// Whether irradiance of pixels will be computed.
    pub fn gathers(&self, with_points: bool) -> bool {
        self.gather && (self.wants(Kind::Image, with_points) || self.wants_page())
    }

    /// Whether pictures are drawn by a camera that the options do not state.
    pub fn choose_camera(&self, with_points: bool) -> bool {
        self.camera.is_none() && (self.wants(Kind::Image, with_points) || self.wants_page())
    }

    /// Eye, target and angle of `--camera`.
    pub fn stated_camera(&self) -> Option<[f64; 7]> {
        match self.camera {
            Some(CameraArg::Stated(numbers)) => Some(numbers),
            Some(CameraArg::Scene) | None => None,
        }
    }

    fn cameras(&self, scene: &Scene, solution: &RadiosityMesh, stage: &Stage) -> Result<Vec<Camera>> {
        let up = scene.up_axis().vector();
        let Some([x, y, z, u, v, w, degrees]) = self.stated_camera() else {
            let names = view_names(scene.parts().cameras).into_iter();
            let stored: Vec<Camera> = (scene.parts().cameras.iter().zip(names))
                .map(|(c, name)| Camera::stored(c, name, solution.origin))
                .collect();
            return Ok(match self.camera {
                _ if !stored.is_empty() => stored,
                Some(CameraArg::Scene) => vec![scene_view(scene)?],
                _ => vec![best_view(stage, solution, up, scene.parts().unit)],
            });
        };
        let ends = [DVec3::new(x, y, z), DVec3::new(u, v, w)];
        Ok(vec![Camera::towards(ends, up, degrees.to_radians(), solution.origin)])
    }
}

/// Names of the pictures of the cameras of a file.
fn view_names(cameras: &[StoredCamera]) -> Vec<String> {
    distinct(cameras.iter().map(|c| format!("{VIEW}-{}", plain(&c.name))))
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    sides
        .filter(|s: &[usize; 2]| s.iter().all(|n| (1..=MAX_SIDE).contains(n)) && s[0] * s[1] <= MAX_PIXELS)
        .ok_or_else(|| "columns x rows, 1 to 16384 each and at most 2^25 pixels, such as 800x600".into())
}

fn camera(text: &str) -> Result<CameraArg, String> {
    if text == "scene" {
        return Ok(CameraArg::Scene);
    }
    let bad = || {
        "seven numbers: eye x,y,z, target x,y,z, angle of view in degrees (1 to 170); or `scene`".to_owned()
    };
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|w| w.trim().parse()).collect();
    let camera: [f64; 7] = numbers.map_err(|_| bad())?.try_into().map_err(|_| bad())?;
    if camera[..3] == camera[3..6] {
        return Err("eye and target are the same point, so that there is no direction of view".into());
    }
    let fine = camera.iter().all(|v| v.is_finite()) && (1.0..=170.0).contains(&camera[6]);
    if fine { Ok(CameraArg::Stated(camera)) } else { Err(bad()) }
}
