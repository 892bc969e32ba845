//! `mrvis bench SCENE`: exact against multi-resolution visibility on the same segments.

mod pictures;
mod table;

use super::args::{CacheArgs, Common, SceneArgs, command_line};
use super::inputs::{Inputs, Output};
use super::limits;
use super::progress::Bar;
use super::values::{ClusterArgs, Values, one_of};
use super::writable::check_folder;
use mrvis::internals::bench::{self, page};
use mrvis::internals::image_io::write_atomically;
use mrvis::internals::optics::Extinction;
use mrvis::internals::threads::Threads;
use mrvis::internals::{ModelParts, SceneParts};
use mrvis::{BenchOptions, Model, Progress, Result, Scene};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Compare exact and multi-resolution visibility on the same segments: table, JSON, images and
/// an HTML report.
#[derive(Clone, Debug, clap::Args)]
#[command(mut_arg("photometric", |a| a.hide(true)))]
pub struct Args {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Feature size in scene units: smaller shadows may be averaged; repeatable [default: four sizes, from two texels of
    /// the shadow images to a fifth of the largest receiver]
    #[arg(short = 's', long = "feature-size", value_name = "S")]
    pub feature_sizes: Vec<f64>,
    /// Segments from a point to an emitter; 4 and 16 times as many are measured as well
    #[arg(long, value_name = "N", default_value_t = 16)]
    pub rays: usize,
    /// Receiver points, uniform over all surfaces that do not emit
    #[arg(long, value_name = "N", default_value_t = 20_000)]
    pub points: usize,
    /// Object, group or material for shadow images; repeatable [default: the largest flat surfaces, and terrain]
    #[arg(long = "receiver", value_name = "NAME")]
    pub receivers: Vec<String>,
    /// Texels along the longer side of the maps, images of whole surfaces in which both engines interpolate; 0: no maps [default: 256, or
    /// fewer with more than eight emitters]
    #[arg(long, value_name = "N")]
    pub map: Option<usize>,
    /// Rays from a point to an emitter in the reference
    #[arg(long, value_name = "N", default_value_t = 1024)]
    pub reference_rays: usize,
    /// Largest number of runs of each timed row; tests that compare no times run each row once
    #[arg(long, value_name = "N", hide = true, default_value_t = BenchOptions::default().rounds)]
    pub rounds: usize,
    /// Check the stated intervals by independent exact rays on this part of the bundles; 0: no check [default: 0.05]
    #[arg(long, value_name = "FRACTION")]
    pub audit: Option<f64>,
    /// Tolerated error of a cluster's transmittance; clusters with a larger error are averaged only for beams wide
    /// enough to compensate
    #[arg(long, value_name = "TOL", default_value_t = 0.05)]
    pub tolerance: f32,
    /// Extinction of clusters
    #[arg(long, value_parser = one_of(EXTINCTION), default_value = "measured")]
    pub extinction: Extinction,
    #[command(flatten)]
    pub clusters: ClusterArgs,
    /// Folder for images and report.html (created if missing)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub cache: CacheArgs,
    #[command(flatten)]
    pub common: Common,
}

const EXTINCTION: Values<Extinction> = &[
    ("measured", "measured on silhouettes from several directions", Extinction::Measured),
    ("analytic", "from surface and volume, as in the paper", Extinction::Analytic),
];

/// Runs the command.
///
/// # Errors
/// An option is out of range, the scene is unusable, a name is unknown, or an output is not writable. Options and
/// outputs are checked before the work begins; files are written completely or not at all.
pub fn run(args: &Args) -> Result<ExitCode> {
    // All but the timed sections: those have `--threads` of their own.
    Threads::new(0)?.run(|| run_on_all_cores(args))?
}

fn run_on_all_cores(args: &Args) -> Result<ExitCode> {
    let common = &args.common;
    let mut options = BenchOptions::default();
    options.feature_sizes = args.feature_sizes.clone();
    options.rays = args.rays;
    options.points = args.points;
    options.receivers = args.receivers.clone();
    options.map = args.map;
    options.reference_rays = args.reference_rays;
    options.threads = common.threads.map_or(1, usize::from);
    options.rounds = args.rounds;
    options.seed = common.seed;
    options.audit = args.audit.unwrap_or(options.audit);
    options.clusters.extinction = args.extinction;
    options.clusters.tolerance = args.tolerance;
    options.builder = args.clusters.builder;
    options.cache = args.cache.place()?;
    options.max_memory = limits::bytes(common.max_memory);
    options.check()?;
    args.scene.without_light()?;
    let _folder = args.out.as_deref().map(check_folder).transpose()?;
    common.check_json()?;
    let start = Instant::now();
    let scene = args.scene.load(common)?;
    let load_s = start.elapsed().as_secs_f64();
    let bar = Bar::new(common.quiet);
    options.check_for(&scene)?;
    check_outputs(args, &scene)?;
    let model = Model::prepare_watched(scene, &options.prepare(), &bar)?;
    let (mut record, images) = bench::run(&model, &options, &bar)?;
    record.build.load_s = load_s;
    drop(model);
    bar.stage("writing", 0);
    let mut text = table::table(&record);
    if let Some(folder) = &args.out {
        pictures::write_pictures(folder, &images)?;
        text += &write_page(folder, &page::render(&record, &images, &command_line())?)?;
    }
    common.write_json(&record)?;
    bar.finish();
    common.print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// Refuses outputs that would replace an input or each other.
fn check_outputs(args: &Args, scene: &Scene) -> Result<()> {
    let inputs = Inputs::of(scene.parts().files);
    let Some(folder) = &args.out else { return args.common.check_outputs(&inputs, []) };
    // Which surfaces have pictures is not known yet: of other files, the names that a picture may get.
    let stems: Vec<String> = if args.receivers.is_empty() {
        scene.parts().objects.iter().map(|object| pictures::file_stem(&object.name)).collect()
    } else {
        args.receivers.iter().map(|name| pictures::file_stem(name)).collect()
    };
    let json = args.common.json.iter().filter_map(|json| json.file_name());
    let others = json.chain(scene.parts().files.iter().filter_map(|file| file.file_name()));
    let mut names: Vec<String> = others
        .map(|name| name.to_string_lossy().into_owned())
        .filter(|name| pictures::may_be_written(&stems, name))
        .collect();
    names.sort();
    names.dedup();
    names.push(REPORT.into());
    args.common.check_outputs(&inputs, Output::within("--out", folder, names))
}

/// Name of the report.
const REPORT: &str = "report.html";

/// Writes the report; returns a line with its path.
fn write_page(folder: &Path, page: &str) -> Result<String> {
    let path = folder.join(REPORT);
    write_atomically(&path, page.as_bytes())?;
    Ok(format!("report: {}\n", path.display()))
}
