//! `mrvis solve SCENE --out DIR`: light in a scene.

mod grids;
mod summary;
mod watch;

use super::args::{CacheArgs, Common, SceneArgs, command_line, counted};
use super::flags::with_flags;
use super::inputs::{Inputs, Output, check_folder};
use super::interruption;
use super::mpi::MpiArgs;
use super::outputs::{Files, Outputs, Written};
use super::progress::Bar;
use super::values::{ClusterArgs, ENGINES, lower, name_of, one_of, set_fields};
use crate::cli::mpi::Sharing;
use glam::DVec3;
use grids::{GridArg, Grids, MeasuredGrid, section};
use mrvis::internals::bench::side_by_side::{ComparedRecord, SideBySide, side_by_side};
use mrvis::internals::error::{in_words, quote};
use mrvis::internals::export::{SurfaceLight, solve_page, surfaces};
use mrvis::internals::files::{WholeFile, input, write_json};
use mrvis::internals::image_io::{Picture, write_png};
use mrvis::internals::plot::number;
use mrvis::internals::points::{Irradiance, Point, read_points, write_irradiance};
use mrvis::internals::radiosity::{self, Options, Outcome, PointLight, Powers, Record, Solution, View};
use mrvis::internals::scene::{Photometry, StoredCamera};
use mrvis::{Engine, Error, Progress, Result, Scene};
use serde::Serialize;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use summary::summary;
use watch::{Watch, prepare};

/// Compute the light in a scene: radiosity of all surfaces, irradiance at points.
#[derive(clap::Args, Debug)]
#[command(group = clap::ArgGroup::new("measured").args(["points", "grids"]).multiple(true))]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Folder for the results (created if missing).
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Points x,y,z,nx,ny,nz for irradiance.csv.
    #[arg(long, value_name = "FILE.csv")]
    points: Option<PathBuf>,
    /// A regular grid of points over a plane surface (repeatable): SURFACE:SPACING or SURFACE:SPACING:HEIGHT; an object, group or material
    /// (of a solid the faces that look up), points at most SPACING apart and HEIGHT above it, in scene units. Writes irradiance.csv as
    /// --points does and grid-SURFACE.png; minimum, mean, maximum and uniformity are in the summary.
    #[arg(long = "grid", value_name = "SURFACE:SPACING")]
    grids: Vec<GridArg>,
    /// Leave out reflected light, at points and in pictures with --gather.
    #[arg(long)]
    direct_only: bool,
    /// Target error of links relative to the mean irradiance; their total error is estimated and audited.
    #[arg(long, value_name = "E", default_value_t = Options::default().error, allow_negative_numbers = true)]
    pub error: f64,
    /// Smallest element relative to the scene's area.
    #[arg(long, value_name = "PART", default_value_t = Options::default().min_area, allow_negative_numbers = true)]
    min_area: f64,
    /// Engine for visibility.
    #[arg(long, value_parser = one_of(ENGINES), default_value = name_of(ENGINES, Options::default().engine))]
    visibility: Engine,
    /// Solve again with this engine and report times of both and the difference at the points; needs --points or --grid.
    #[arg(long, value_parser = one_of(ENGINES), value_name = "ENGINE", requires = "measured")]
    compare: Option<Engine>,
    /// Feature size in scene units: smaller shadows may be averaged [default: each receiver's diameter]. With
    /// --importance or --importance-camera it is up to 7 times larger on surfaces that matter only by the light they
    /// reflect.
    #[arg(short = 's', long, value_name = "S", allow_negative_numbers = true)]
    feature_size: Option<f32>,
    /// Feature sizes of objects, groups or materials: a TOML file with lines `name = size`.
    #[arg(long, value_name = "FILE.toml")]
    feature_sizes: Option<PathBuf>,
    /// Object, group or material whose light matters; repeatable [default: all].
    #[arg(long, value_name = "NAME")]
    importance: Vec<String>,
    /// Light seen by cameras matters (--camera, or those of the file): errors count by their effect there, and
    /// features smaller than a few pixels may be averaged.
    #[arg(long)]
    importance_camera: bool,
    /// Number of elements whose error bars are checked by independent paths; 0: no check.
    #[arg(long, value_name = "N", default_value_t = Options::default().audit)]
    audit: usize,
    /// Shadow rays from a point to a partly visible emitter; up to 16 times as many where a bright emitter is mostly hidden [default:
    /// by the error].
    #[arg(long, value_name = "N")]
    light_rays: Option<usize>,
    /// Rays per point for reflected light [default: by the error].
    #[arg(long, value_name = "N")]
    gather_rays: Option<usize>,
    /// Largest number of rays by which elements gather their light; 0: light along links alone [default: by the error].
    #[arg(long, value_name = "N")]
    local_rays: Option<usize>,
    /// Refine in steps of this many seconds.
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    step_seconds: Option<f64>,
    /// Limit the time to about T seconds, reading and preparation included (at least for preparation and a first coarse
    /// solution): refine less and trace fewer rays. Pixels of --gather beyond the time show the light of elements.
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    max_seconds: Option<f64>,
    /// Trace more rays until independent paths find an RMS error of the elements of at most E, relative to the mean irradiance;
    /// exit code 1 if that is not reached. Not with --local-rays.
    #[arg(long, value_name = "E", allow_negative_numbers = true)]
    target_error: Option<f64>,
    /// Stop refinement at this number of links.
    #[arg(long, value_name = "N", default_value_t = Options::default().max_links)]
    max_links: usize,
    #[command(flatten)]
    clusters: ClusterArgs,
    #[command(flatten)]
    cache: CacheArgs,
    #[command(flatten)]
    pub outputs: Outputs,
    #[command(flatten)]
    pub mpi: MpiArgs,
    #[command(flatten)]
    pub common: Common,
}

impl Args {
    /// Whether pictures are drawn by a camera that the options do not state.
    pub fn choose_camera(&self) -> bool {
        self.outputs.choose_camera(self.has_points())
    }

    /// Whether light at points is asked for.
    fn has_points(&self) -> bool {
        self.points.is_some() || !self.grids.is_empty()
    }
}

/// Options of the solver. The views of cameras and the points of grids are added when the scene is loaded.
fn options(args: &Args) -> Result<Options> {
    if args.direct_only && !args.has_points() && !args.outputs.gathers(false) {
        return Err(Error::arguments(
            "--direct-only applies to points and to pictures with --gather, and none are asked for: give --points or --grid, or --gather with \
             --output image"
                .into(),
        ));
    }
    let mut options = Options::default();
    if let Some(file) = &args.feature_sizes {
        options.feature_sizes = read_feature_sizes(file)?;
    }
    options.engine = args.visibility;
    options.elements = args.outputs.need_elements(args.has_points()) || args.target_error.is_some();
    options.more_points = args.outputs.gathers(args.has_points());
    options.builder = args.clusters.builder;
    options.cache = args.cache.place()?;
    options.seed = args.common.seed;
    set_fields! {
        options = args: error, min_area, feature_size, importance, audit, direct_only, light_rays,
        gather_rays, local_rays, step_seconds, max_seconds, target_error, max_links
    }
    Ok(options)
}

/// Checks all options that need no scene.
///
/// # Errors
/// As the command itself.
pub fn check(args: &Args) -> Result<()> {
    options(args)?.check_ranges()
}

pub fn run(args: &Args) -> Result<ExitCode> {
    args.common.on_threads(|| run_on_threads(args))
}

fn run_on_threads(args: &Args) -> Result<ExitCode> {
    let mut options = options(args)?;
    options.check_ranges()?;
    for (option, is_given) in
        [("--max-seconds", args.max_seconds.is_some()), ("--step-seconds", args.step_seconds.is_some())]
    {
        args.mpi.refuse(option, is_given)?;
    }
    let (scene, out) = (&args.scene, &args.out);
    let _folder = args.mpi.on_first(|| check_folder(out))?;
    args.common.check_json()?;
    let mut points = args.points.as_deref().map(read_points).transpose()?.unwrap_or_default();
    let start = Instant::now();
    let scene = scene.with_light()?.load_flat(&args.common)?;
    lower(&scene, &mut points);
    let grids = Grids::of(&args.grids, &scene)?;
    points.extend(grids.points());
    // Grids without a height are on their surfaces.
    options.points_in_space = grids.points().count();
    let read = scene.parts().files.iter().chain(&args.points).chain(&args.feature_sizes);
    let inputs = Inputs::of(read);
    let mut written = args.outputs.names(&scene, args.has_points());
    written.push("solution.json".into());
    written.extend(args.has_points().then(|| "irradiance.csv".into()));
    written.extend(grids.pictures());
    args.common.check_outputs(&inputs, Output::within("--out", out, written))?;
    if args.importance_camera {
        options.views = views(&scene, args.outputs.stated_camera())?;
    }
    let load = start.elapsed().as_secs_f64();
    options.seconds_spent = load;
    let bar = Bar::new(args.common.quiet);
    let watch = Watch::new(&bar);
    // Ranks that stop at different places would wait for each other: an interruption ends them at once.
    if !args.mpi.mpi {
        let quiet = args.common.quiet;
        interruption::watch((!quiet).then_some("stopping with the light there is; once more ends at once"));
    }
    watch.stage("preparing", 0);
    let model = prepare(scene, &options, &watch)?.on_ranks(args.mpi.ranks());
    options.seconds_spent = start.elapsed().as_secs_f64();
    let (mut outcome, solution) = radiosity::solve(&model, &points, &options, &watch)?;
    let other = args.compare.filter(|_| !outcome.record.interrupted);
    let versus = other.map(|other| side_by_side(&model, &points, &outcome, other, &watch)).transpose()?;
    bar.finish();
    if !args.mpi.is_first() {
        return Ok(ExitCode::SUCCESS);
    }
    let met = outcome.record.target_met != Some(false);
    outcome.record.seconds.load = load;
    write(args, &points, &grids, outcome, versus, &solution, &watch)?;
    Ok(if met { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// Writes all files and prints the summary.
fn write(
    args: &Args,
    points: &[Point],
    grids: &Grids,
    outcome: Outcome,
    versus: Option<SideBySide>,
    solution: &Solution,
    watch: &Watch,
) -> Result<()> {
    let (out, photometry) = (&args.out, args.scene.photometry());
    let Outcome { mesh, mut record, irradiance } = outcome;
    if record.interrupted {
        record.warnings.push("interrupted: this is the consistent solution reached so far".into());
    }
    record.warnings = with_flags(&record.warnings);
    let photometric = photometry.map(|p| Luminous::of(p, &record));
    let scene = solution.model().scene();
    let surfaces = if record.options.elements { surfaces(scene, photometry, &mesh) } else { Vec::new() };
    let compared = ComparedRecord { record, versus };
    let (of_file, of_grids) = irradiance.split_at(points.len() - grids.points().count());
    let at_points = AtPoints::of(of_file, photometry);
    let (measured, pictures): (_, Vec<Picture>) = grids.measured(of_grids, photometry).into_iter().unzip();
    let sharing = args.mpi.sharing();
    let mut record = Reported { compared, photometric, at_points, grids: measured, surfaces, sharing };
    let save = |record: &Reported| write_json(&out.join("solution.json"), record);
    save(&record)?;
    if args.has_points() {
        let file = Irradiance { points: points.to_vec(), values: irradiance, standard_errors: Vec::new() };
        let lux = |rgb| photometry.unwrap_or_default().of(rgb);
        write_irradiance(&out.join("irradiance.csv"), &file, photometry.map(|_| &lux as _))?;
    }
    let mut written: Vec<PathBuf> = grids.pictures().into_iter().map(|name| out.join(name)).collect();
    written.iter().zip(&pictures).try_for_each(|(path, picture)| write_png(path, picture))?;
    let notes = RefCell::new(Vec::new());
    let gather = |points: &[Point], part: f64| {
        let PointLight { irradiance, note } = solution.irradiance_within(points, part, watch);
        notes.borrow_mut().extend(with_flags(note.as_slice()));
        irradiance
    };
    let with_points = args.has_points();
    let pixels = args.outputs.pixels(with_points);
    let progress = watch.for_files(pixels, mesh.elements.len());
    let files = Files::new(&args.common, out, &progress);
    let Written { files, views, notes: of_files } =
        args.outputs.write(files, scene, photometry, &mesh, with_points, &gather)?;
    watch.bar.finish();
    let mut notes = notes.into_inner();
    notes.extend(of_files);
    if !notes.is_empty() {
        record.compared.record.warnings.extend(notes);
        save(&record)?;
    }
    written.extend(files);
    if args.outputs.wants_page() {
        let grids = section(&record.grids, &pictures, scene.parts().unit)?;
        let solved = &record.compared.record;
        let page = solve_page(solved, scene, photometry, &mesh, &views, &grids, &command_line())?;
        written.push(out.join("solution.html"));
        WholeFile::write(&written[written.len() - 1], page)?;
    }
    args.common.write_json(&record)?;
    args.common.print(&summary(&record))?;
    for file in written {
        args.common.print(&format!("wrote {}\n", file.display()))?;
    }
    Ok(())
}

/// Smallest, mean and largest light at points.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AtPoints {
    /// Number of points.
    pub count: usize,
    /// lx, or W/m² (mean of the channels).
    pub unit: &'static str,
    pub minimum: f64,
    pub mean: f64,
    pub maximum: f64,
    /// Points without any light, as those below furniture.
    pub dark: usize,
    /// Uniformity U0 of EN 12464: the minimum divided by the mean; `null` in the dark.
    pub uniformity: Option<f64>,
}

impl AtPoints {
    /// Of irradiances, W/m²; none without points.
    pub fn of(irradiance: &[[f64; 3]], photometry: Option<Photometry>) -> Option<AtPoints> {
        let values = || irradiance.iter().map(|e| AtPoints::value(*e, photometry));
        let mean = values().sum::<f64>() / irradiance.len() as f64;
        let minimum = values().reduce(f64::min)?;
        Some(AtPoints {
            count: irradiance.len(),
            unit: if photometry.is_some() { "lx" } else { "W/m\u{b2}" },
            minimum,
            mean,
            maximum: values().fold(minimum, f64::max),
            dark: values().filter(|&light| light == 0.0).count(),
            uniformity: (mean > 0.0).then_some(minimum / mean),
        })
    }

    /// Reported value of an irradiance, W/m²: lx, or the mean of the channels.
    pub fn value(irradiance: [f64; 3], photometry: Option<Photometry>) -> f64 {
        photometry
            .map_or_else(|| irradiance.iter().sum::<f64>() / 3.0, |photometry| photometry.of(irradiance))
    }

    /// The points in the dark, in words.
    pub fn dark_in_words(&self) -> String {
        let verb = if self.dark == 1 { "receives" } else { "receive" };
        format!("{} that {verb} no light", counted(self.dark, "point"))
    }

    /// The numbers in words.
    pub fn words(&self) -> String {
        let AtPoints { count, unit, minimum, mean, maximum, dark, uniformity } = self;
        if *count == 1 {
            return format!("1 point: {} {unit}", number(*mean));
        }
        let mut line = format!(
            "{}: minimum {}, mean {}, maximum {} {unit}",
            counted(*count, "point"),
            number(*minimum),
            number(*mean),
            number(*maximum),
        );
        // Writing to a string cannot fail.
        if let Some(uniformity) = uniformity {
            let _ = write!(line, ", uniformity U0 (minimum / mean) {uniformity:.2}");
        }
        if *dark > 0 {
            let _ = write!(line, ", with {} (below or inside of things?)", self.dark_in_words());
        }
        line
    }
}

/// The record with luminous quantities, and what the ranks have shared.
#[derive(Serialize)]
pub struct Reported {
    #[serde(flatten)]
    pub compared: ComparedRecord,
    /// Only with `--photometric`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub photometric: Option<Luminous>,
    /// Light at the points of `--points`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_points: Option<AtPoints>,
    /// Light on the grids of `--grid`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub grids: Vec<MeasuredGrid>,
    /// Light of the largest surfaces, where the light of elements is asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<SurfaceLight>,
    /// Only with `--mpi`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sharing: Option<Sharing>,
}

/// Luminous quantities of the whole scene.
#[derive(Serialize)]
pub struct Luminous {
    #[serde(flatten)]
    pub photometry: Photometry,
    /// Mean illuminance of the elements, lx.
    pub mean_illuminance_lx: f64,
    /// Powers of the energy ledger.
    pub ledger: LuminousLedger,
}

/// Luminous powers, summed over all surfaces.
#[derive(Serialize)]
pub struct LuminousLedger {
    /// lm, or lx times scene units squared where the length of a scene unit is not known.
    pub unit: String,
    #[serde(flatten)]
    pub powers: Powers<f64>,
}

impl Luminous {
    /// From the record of a solution.
    pub fn of(photometry: Photometry, record: &Record) -> Luminous {
        let (powers, unit) = record.ledger.shown(Some(photometry));
        Luminous {
            photometry,
            mean_illuminance_lx: photometry.of(record.mean_irradiance),
            ledger: LuminousLedger { unit, powers },
        }
    }
}

/// Reads feature sizes by name.
///
/// # Errors
/// The file cannot be read or is no such file.
pub fn read_feature_sizes(path: &Path) -> Result<Vec<(String, f32)>> {
    parse_feature_sizes(path, &input::read(path, input::MAX_SMALL_FILE)?)
}

/// Feature sizes by name from the content of a file.
///
/// # Errors
/// It is no TOML, or has something else than numbers.
pub fn parse_feature_sizes(path: &Path, bytes: &[u8]) -> Result<Vec<(String, f32)>> {
    let text = str::from_utf8(bytes).map_err(|_| Error::format(path, None, "not text in UTF-8"))?;
    let sizes: BTreeMap<String, f32> = toml::from_str(text).map_err(|e| {
        let line = e.span().map(|s| 1 + text[..s.start].matches('\n').count());
        Error::format(
            path,
            line,
            format!("{}; write lines like `sofa = 0.05`", quote(&in_words(e.message()))),
        )
    })?;
    Ok(sizes.into_iter().collect())
}

/// The cameras of `--importance-camera`.
pub fn views(scene: &Scene, given: Option<[f64; 7]>) -> Result<Vec<View>> {
    let views: Vec<View> = match given {
        Some([x, y, z, u, v, w, degrees]) => {
            let eye = DVec3::new(x, y, z);
            let forward = (DVec3::new(u, v, w) - eye).normalize();
            vec![View { eye, forward, angle: degrees.to_radians() }]
        }
        None => {
            let of = |c: &StoredCamera| View { eye: c.eye, forward: c.forward, angle: c.angle };
            scene.parts().cameras.iter().map(of).collect()
        }
    };
    if views.is_empty() {
        return Err(Error::arguments(
            "--importance-camera: the scene has no camera; give one with --camera".into(),
        ));
    }
    Ok(views)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniformity_is_minimum_over_mean() {
        let found = AtPoints::of(&[[1.0, 2.0, 3.0], [6.0; 3]], None).expect("points");
        assert_eq!((found.count, found.minimum, found.mean, found.maximum), (2, 2.0, 4.0, 6.0));
        assert_eq!((found.uniformity, found.dark), (Some(0.5), 0));
        let found = AtPoints::of(&[[0.0; 3], [6.0; 3]], None).expect("points");
        assert!(
            found.words().ends_with("0.00, with 1 point that receives no light (below or inside of things?)")
        );
        assert_eq!(AtPoints::of(&[[0.0; 3]], None).expect("a point").uniformity, None);
        assert_eq!(AtPoints::of(&[], None), None);
    }
}
