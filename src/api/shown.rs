//! Outputs of a solution: pictures, lightmaps, the page and the record.

use super::solve::{Solution, Solved};
use crate::bench::side_by_side::ComparedRecord;
use crate::error::shown;
use crate::export::{self, MAX_PIXELS, MAX_SIDE, Mesh, PageView, SIZE, Stage, Tone};
use crate::files::json_text;
use crate::points::Point;
use crate::progress::Progress;
use crate::scene::{Scene, StoredCamera};
use crate::{Error, Result, memory};
use glam::DVec3;
use std::path::Path;

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position in the coordinates of the file, scene units.
    pub eye: [f64; 3],
    /// A point in the middle of the picture, other than `eye`.
    pub target: [f64; 3],
    /// Direction that is upwards in the picture, of any length above 0. If the camera looks along it, another one is taken.
    pub up: [f64; 3],
    /// Angle of view from top to bottom, degrees, above 0 and below 180.
    pub angle: f64,
}

impl Camera {
    fn of(c: &StoredCamera) -> Camera {
        let ([eye, target], up) = ([c.eye, c.eye + c.forward].map(|p| p.to_array()), c.up.to_array());
        Camera { eye, target, up, angle: c.angle.to_degrees() }
    }

    fn checked(&self, origin: DVec3) -> Result<export::Camera> {
        let [eye, target, up] = [self.eye, self.target, self.up].map(DVec3::from_array);
        let wrong = |name: &str, value: String, must: &str| {
            Err(Error::argument(format!("camera.{name}"), value, format!("must {must}")))
        };
        let lies = |p: DVec3| {
            p.is_finite() && (p - origin).abs().max_element() <= f64::from(super::segments::MAX_COORDINATE)
        };
        if !lies(eye) {
            return wrong(
                "eye",
                format!("{:?}", self.eye),
                "be finite, at most 1e12 from the scene's origin",
            );
        }
        if !lies(target) || (target - eye).normalize_or_zero() == DVec3::ZERO {
            return wrong(
                "target",
                format!("{:?}", self.target),
                "be finite, at most 1e12 from the scene's origin, and away from ⟨camera.eye⟩",
            );
        }
        let up_unit = up.normalize_or_zero();
        if up_unit == DVec3::ZERO {
            return wrong("up", up.to_string(), "be a direction longer than 0");
        }
        if !(self.angle > 0.0 && self.angle < 180.0) {
            return wrong("angle", self.angle.to_string(), "lie between 0 and 180 degrees");
        }
        let ends = [eye, target];
        Ok(export::Camera::towards(ends, up_unit.as_vec3(), self.angle.to_radians(), origin))
    }
}

options! {
    /// Options of [`Solution::image`]: [`ImageOptions::default`] with other values of some fields.
    #[derive(Clone, Debug)]
    #[non_exhaustive]
    pub struct ImageOptions {
        /// Columns and rows, 1 to 16,384 each and at most 2²⁵ pixels; default 800 and 600.
        pub size: [usize; 2] = SIZE;
        /// Whether the irradiance of every pixel is computed by final gathering instead of interpolated: slower and sharper. Default false.
        pub gather: bool = false;
        /// Whether surfaces are transparent from sides that no light can reach, as the outside of a closed room, instead of black.
        /// Default false.
        pub look_inside: bool = false;
    }
}

impl ImageOptions {
    fn check(&self, numbers: usize) -> Result<()> {
        let [columns, rows] = self.size;
        if !self.size.iter().all(|n| (1..=MAX_SIDE).contains(n)) || columns * rows > MAX_PIXELS {
            let problem = format!("must lie in 1..{MAX_SIDE} each, at most {MAX_PIXELS} pixels");
            return Err(Error::argument("size", format!("{columns} x {rows}"), problem));
        }
        if numbers != 3 * columns * rows {
            let have = format!("of {numbers} entries");
            let problem =
                format!("must have {}: 3 for each of {columns} x {rows} pixels", 3 * columns * rows);
            return Err(Error::argument("radiance", have, problem));
        }
        Ok(())
    }
}

/// Irradiance of all surfaces in one image, and where each triangle lies in it.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Lightmap {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Irradiance, W/m², linear RGB, row by row from the top: `width * height` entries.
    pub irradiance: Vec<[f32; 3]>,
    /// Vertices in the coordinates of the file, scene units.
    pub positions: Vec<[f64; 3]>,
    /// Vertices of each triangle, counterclockwise from its lit side: lit sides are triangles of their own.
    pub triangles: Vec<[u32; 3]>,
    /// Texture coordinates of the corners of each triangle, from the lower left corner of the image.
    pub texcoords: Vec<[[f32; 2]; 3]>,
    /// Why the texture coordinates are those of a chart for each plane, and not those of the scene; `None` if they are the scene's, which
    /// show fronts alone.
    pub note: Option<String>,
}

impl Lightmap {
    fn of(map: export::Lightmap, note: Option<String>, scene: &Scene) -> Lightmap {
        let (triangles, texcoords) = match note {
            None => (scene.triangles.clone(), scene.triangle_texcoords.clone()),
            Some(_) => map.sides.iter().map(|side| side.turned(scene)).unzip(),
        };
        Lightmap {
            width: map.width,
            height: map.height,
            irradiance: map.irradiance,
            positions: scene.positions.iter().map(|p| (scene.origin + p.as_dvec3()).to_array()).collect(),
            triangles,
            texcoords,
            note,
        }
    }
}

impl Scene {
    /// The perspective cameras of the file with their names.
    pub fn cameras(&self) -> impl ExactSizeIterator<Item = (&str, Camera)> {
        self.cameras.iter().map(|camera| (camera.name.as_str(), Camera::of(camera)))
    }
}

impl Solved {
    fn scene(&self) -> &Scene {
        self.solved.model().scene()
    }

    /// The mesh of pictures.
    fn smooth(&self, progress: &dyn Progress) -> Result<&Mesh> {
        if let Some(mesh) = self.smooth.get() {
            return Ok(mesh);
        }
        progress.stage("smoothing", 0);
        let mesh = Mesh::new_unless(&self.mesh, progress).ok_or_else(|| stopped("the mesh"))?;
        Ok(self.smooth.get_or_init(|| mesh))
    }

    /// The cameras of the scene, or the automatic one, with the names of their pictures.
    fn cameras(&self, stage: &Stage) -> Vec<export::Camera> {
        let scene = self.scene();
        match &scene.cameras[..] {
            [] => vec![self.automatic_camera(stage)],
            stored => {
                stored.iter().map(|c| export::Camera::stored(c, c.name.clone(), scene.origin)).collect()
            }
        }
    }

    fn automatic_camera(&self, stage: &Stage) -> export::Camera {
        let scene = self.scene();
        export::best_view(stage, &self.mesh, scene.up_axis().vector(), &scene.unit)
    }
}

fn stopped(what: &str) -> Error {
    Error::Cancelled(format!("stopped before {what} was complete"))
}

impl Solution {
    /// The solution, and the progress that outputs report to.
    fn watched(&self) -> (&Solved, &dyn Progress) {
        (&self.inner, self.watcher.progress())
    }

    /// The record of the solution as JSON: the content of `solution.json`, with the options, times, energy, error estimate and warnings.
    pub fn json(&self) -> String {
        let record = ComparedRecord { record: self.inner.record.clone(), versus: None };
        json_text(&record).expect("numbers, texts and lists alone")
    }

    /// A camera that shows much of the scene: from inside at eye height if it is enclosed.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the caller's progress stops it; [`Error::Embree`] or [`Error::OutOfMemory`].
    pub fn automatic_camera(&self) -> Result<Camera> {
        let (inner, progress) = self.watched();
        let found = self.model().on_threads(|| {
            Ok::<_, Error>(inner.automatic_camera(&Stage::new(inner.smooth(progress)?, &inner.mesh)?))
        })??;
        let eye = inner.mesh.origin + found.eye.as_dvec3();
        Ok(Camera {
            eye: eye.to_array(),
            target: (eye + f64::from(inner.scene().size()) * found.forward.as_dvec3()).to_array(),
            up: found.up.as_dvec3().to_array(),
            angle: f64::from(found.angle).to_degrees(),
        })
    }

    /// The radiance that a camera sees, W/(m² sr), linear RGB, into `radiance`: three entries for each pixel, row by row from the top;
    /// black where it sees no side that light can reach ([`ImageOptions::look_inside`]). Written only if there is no error.
    ///
    /// # Errors
    /// [`Error::Argument`] if the camera or the size is out of range or `radiance` has another length, [`Error::Cancelled`] if
    /// the caller's progress stops it; [`Error::Embree`] or [`Error::OutOfMemory`].
    pub fn image(&self, camera: &Camera, options: &ImageOptions, radiance: &mut [f32]) -> Result<()> {
        options.check(radiance.len())?;
        let pixels = radiance.len() / 3;
        let bytes = export::bytes_per_pixel(options.gather) * pixels;
        memory::check_room(bytes as u64, || format!("{pixels} pixels"))?;
        let (inner, progress) = self.watched();
        let camera = camera.checked(inner.mesh.origin)?;
        let gather = |points: &[Point]| inner.solved.irradiance_unless(points, progress);
        let gather: Option<&(dyn Fn(&[Point]) -> _ + Sync)> = options.gather.then_some(&gather);
        let frame = self.model().on_threads(|| {
            let stage = Stage::new(inner.smooth(progress)?, &inner.mesh)?
                .looking_inside(options.look_inside)
                .under(inner.scene().sky());
            let gather = gather.map(|gather| gather as _);
            Ok::<_, Error>(export::picture(&stage, &camera, options.size, &inner.mesh, gather, progress))
        })??;
        if frame.radiance.len() * 3 != radiance.len() || progress.stopped() {
            return Err(stopped("the picture"));
        }
        radiance.copy_from_slice(frame.radiance.as_flattened());
        Ok(())
    }

    /// The irradiance of all surfaces in an image of about `texels` texels, 1 to 2²⁶: in the texture coordinates of the file (fronts
    /// alone) if they are suitable, else with a chart for each plane.
    ///
    /// # Errors
    /// [`Error::Argument`] if `texels` is out of range, [`Error::Scene`] if the charts do not fit into an image of 16,384 texels a side,
    /// [`Error::Cancelled`] if the caller's progress stops it; [`Error::Embree`] or [`Error::OutOfMemory`].
    pub fn lightmap(&self, texels: usize) -> Result<Lightmap> {
        if !(1..=1 << 26).contains(&texels) {
            return Err(Error::argument("texels", texels, format!("must lie in 1..{}", 1 << 26)));
        }
        let (inner, progress) = self.watched();
        self.model().on_threads(|| {
            let stage = Stage::new(inner.smooth(progress)?, &inner.mesh)?.looking_inside(true);
            let (map, note) =
                export::suitable_lightmap(&stage, &inner.mesh, inner.scene(), texels, progress)?;
            Ok(Lightmap::of(map, note, inner.scene()))
        })?
    }

    /// Writes the solution to a file, completely or not at all; the extension says the format: `vtu` (elements with all fields, for
    /// ParaView), `ply` or `glb` (smooth meshes with colours).
    ///
    /// # Errors
    /// [`Error::Argument`] for another extension, [`Error::Io`] if the file cannot be written, [`Error::Cancelled`] if the caller's
    /// progress stops it before the file is complete: then there is none.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let (path, (inner, progress)) = (path.as_ref(), self.watched());
        let (scene, mesh) = (inner.scene(), &inner.mesh);
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if !["vtu", "ply", "glb"].contains(&&*extension) {
            return Err(Error::argument("path", shown(path), "the extension must be .vtu, .ply or .glb"));
        }
        self.model().on_threads(|| {
            if progress.stopped() {
                return Err(stopped("the file"));
            }
            let written = if extension == "vtu" {
                progress.stage("writing", 0);
                export::write_vtu(path, mesh, scene, None, progress)
            } else {
                let smooth = inner.smooth(progress)?;
                progress.stage("writing", 0);
                let tone = Tone::of(smooth.radiosity.iter().copied());
                match &*extension {
                    "ply" => export::write_ply(path, smooth, mesh.origin, tone, progress),
                    _ => export::write_glb(path, smooth, mesh.origin, scene.up_axis(), tone, progress),
                }
            };
            // A stop after the file got its name comes too late: the file is complete.
            written.map_err(|error| if progress.stopped() { stopped("the file") } else { error })
        })?
    }

    /// One HTML page: pictures of the scene's cameras (or the automatic one), irradiance in false colours, energy, error bars and times. It
    /// refers to no other file.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the caller's progress stops it; [`Error::Embree`] or [`Error::OutOfMemory`].
    pub fn page(&self) -> Result<String> {
        let (inner, progress) = self.watched();
        self.model().on_threads(|| {
            let stage = Stage::new(inner.smooth(progress)?, &inner.mesh)?.under(inner.scene().sky());
            let mut views = Vec::new();
            for camera in inner.cameras(&stage) {
                let frame = export::picture(&stage, &camera, SIZE, &inner.mesh, None, progress);
                if progress.stopped() {
                    return Err(stopped("the page"));
                }
                views.push(PageView::of(&stage, &inner.mesh, &camera, SIZE, &frame));
            }
            export::solve_page(
                &inner.record,
                inner.scene(),
                None,
                &inner.mesh,
                &views,
                &Default::default(),
                "",
            )
        })?
    }
}
