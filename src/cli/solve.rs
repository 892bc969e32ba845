//! `mrvis solve SCENE --out DIR`: the light in a scene.

use super::args::{CacheArgs, Common, SceneArgs, Spinner, check_folder, grouped};
use super::outputs::Outputs;
use crate::files::WholeFile;
use crate::model::Model;
use crate::plot::number;
use crate::points::{Irradiance, Point, read_points, write_irradiance};
use crate::progress::Progress;
use crate::radiosity::{
    self, Answer, Inside, More, Options, Oracle, Outcome, Record, Rows, Versus, View, Visibility,
};
use crate::scene::{Scene, StoredCamera};
use crate::{Error, Result};
use glam::DVec3;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Compute the light in a scene: radiosity of all surfaces, irradiance at points.
#[derive(clap::Args, Debug)]
#[command(mut_arg("scene", |a| a.required(false).required_unless_present("scaling")))]
pub struct Args {
    #[command(flatten)]
    scene: Option<SceneArgs>,
    /// Folder for the results (made if missing).
    #[arg(long, value_name = "DIR", required_unless_present = "scaling")]
    out: Option<PathBuf>,
    /// Measure how time grows instead: scenes of a thousand triangles and ten times more each, up to N [default: a
    /// million], solved to the same error; table and --json.
    #[arg(long, value_name = "N", num_args = 0..=1, require_equals = true, default_missing_value = "1000000", conflicts_with = "scene")]
    scaling: Option<usize>,
    /// Points x,y,z,nx,ny,nz at which irradiance is computed, to irradiance.csv.
    #[arg(long, value_name = "FILE.csv")]
    points: Option<PathBuf>,
    /// Leave the bounces out at points; with --points nothing else is computed.
    #[arg(long)]
    direct_only: bool,
    /// Error that links are refined to, relative to the mean irradiance; what they leave together is estimated and audited.
    #[arg(long, value_name = "E", default_value_t = Options::default().error, allow_negative_numbers = true)]
    error: f64,
    /// Smallest element as part of the scene's area.
    #[arg(long, value_name = "PART", default_value_t = Options::default().min_area, allow_negative_numbers = true)]
    min_area: f64,
    /// What links are refined for.
    #[arg(long, value_enum, default_value = "error")]
    oracle: Criterion,
    /// What is done so that form factors of elements in closed scenes sum up to 1.
    #[arg(long, value_enum, default_value = "balanced")]
    rows: RowSums,
    /// How visibility is answered.
    #[arg(long, value_enum, default_value = "exact")]
    visibility: Engine,
    /// Solve once more with this engine, side by side: time of both and the difference at the points.
    #[arg(long, value_enum, value_name = "ENGINE", requires = "points")]
    compare: Option<Engine>,
    /// Feature size in scene units: shadows smaller than this may be averaged [default: each receiver's diameter]. With
    /// --importance or --importance-camera it grows, up to 7 times, where surfaces matter only by the light they send on.
    #[arg(short = 's', long, value_name = "S", allow_negative_numbers = true)]
    feature_size: Option<f32>,
    /// Feature sizes of objects, groups or materials: a TOML file with lines `name = size`.
    #[arg(long, value_name = "FILE.toml")]
    feature_sizes: Option<PathBuf>,
    /// What light does inside the clusters that links end at.
    #[arg(long, value_enum, default_value = "visible")]
    inside: Clusters,
    /// Object, group or material whose light matters; may be given several times [default: all].
    #[arg(long, value_name = "NAME")]
    importance: Vec<String>,
    /// What cameras see matters (--camera, or those of the file): errors count by what they do there, and features smaller
    /// than a few pixels need no resolving.
    #[arg(long)]
    importance_camera: bool,
    /// Elements whose error bars are checked by paths of their own; 0 for none.
    #[arg(long, value_name = "N", default_value_t = Options::default().audit)]
    audit: usize,
    /// Shadow rays from a point to an emitter that is partly visible [default: by the error].
    #[arg(long, value_name = "N")]
    light_rays: Option<usize>,
    /// Rays from a point that gather reflected light [default: by the error].
    #[arg(long, value_name = "N")]
    gather_rays: Option<usize>,
    /// Rays by which elements of scenes with clusters gather their light in the end, in all; 0 for none [default: by the
    /// error].
    #[arg(long, value_name = "N")]
    local_rays: Option<usize>,
    /// Refine in steps of this many seconds.
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    step_seconds: Option<f64>,
    /// Do with about so many seconds, from the triangles to the light (at least for preparing the scene and a first coarse
    /// solution): refine less, and trace fewer rays. Pixels of --gather for which it is not enough show the light of elements.
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    max_seconds: Option<f64>,
    /// Stop refining when the estimated error is no larger; exit code 1 if it is larger in the end.
    #[arg(long, value_name = "E", allow_negative_numbers = true)]
    target_error: Option<f64>,
    /// Stop refining at so many links.
    #[arg(long, value_name = "N", default_value_t = Options::default().max_links)]
    max_links: usize,
    #[command(flatten)]
    cache: CacheArgs,
    #[command(flatten)]
    outputs: Outputs,
    #[command(flatten)]
    common: Common,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Clusters {
    /// Surfaces face all directions alike and hide nothing.
    Isotropic,
    /// Surfaces have orientations and hide nothing.
    Oriented,
    /// Surfaces hide each other.
    Visible,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Criterion {
    /// The error of the light they carry.
    Error,
    /// The light they carry (BF refinement).
    Bf,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum RowSums {
    /// Nothing.
    Sampled,
    /// What each element gathers is scaled.
    Closed,
    /// What each element gathers and sends is scaled alike: exactly reciprocal.
    Balanced,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Engine {
    /// Embree rays.
    Exact,
    /// Multi-resolution: clusters with small features are averaged.
    Mr,
    /// Extinction only.
    Average,
}

impl From<Engine> for Visibility {
    fn from(engine: Engine) -> Visibility {
        match engine {
            Engine::Exact => Visibility::Exact,
            Engine::Mr => Visibility::Mr,
            Engine::Average => Visibility::Average,
        }
    }
}

/// Exit code of a program that an interruption has ended, as shells count.
const INTERRUPTED: i32 = 130;

pub fn run(args: &Args) -> Result<ExitCode> {
    let mut options = Options {
        error: args.error,
        min_area: args.min_area,
        oracle: match args.oracle {
            Criterion::Error => Oracle::Error,
            Criterion::Bf => Oracle::Bf,
        },
        rows: match args.rows {
            RowSums::Sampled => Rows::Sampled,
            RowSums::Closed => Rows::Closed,
            RowSums::Balanced => Rows::Balanced,
        },
        visibility: args.visibility.into(),
        feature_size: args.feature_size,
        feature_sizes: args.feature_sizes.as_deref().map(read_sizes).transpose()?.unwrap_or_default(),
        inside: match args.inside {
            Clusters::Isotropic => Inside::Isotropic,
            Clusters::Oriented => Inside::Oriented,
            Clusters::Visible => Inside::Visible,
        },
        importance: args.importance.clone(),
        views: Vec::new(),
        audit: args.audit,
        direct_only: args.direct_only,
        light_rays: args.light_rays,
        gather_rays: args.gather_rays,
        local_rays: args.local_rays,
        step_seconds: args.step_seconds,
        max_seconds: args.max_seconds,
        more_points: args.outputs.gathers(args.points.is_some()),
        target_error: args.target_error,
        max_links: args.max_links,
        cache: args.cache.place()?,
        seed: args.common.seed,
    };
    options.check()?;
    if let Some(threads) = args.common.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads.into())
            .build_global()
            .map_err(|e| Error::Argument(format!("--threads {threads}: {e}")))?;
    }
    if let Some(largest) = args.scaling {
        return scaling(&args.common, &options, largest);
    }
    let (Some(scene), Some(out)) = (&args.scene, &args.out) else {
        return Err(Error::Argument("give a scene and --out DIR, or --scaling".into()));
    };
    check_folder(out)?;
    args.common.check_json()?;
    let points = args.points.as_deref().map(read_points).transpose()?.unwrap_or_default();
    let start = Instant::now();
    let scene = scene.load(&args.common)?;
    if args.importance_camera {
        options.views = views(&scene, args.outputs.camera)?;
    }
    let load = start.elapsed().as_secs_f64();
    let watch = Watch { spinner: args.common.spinner("solving"), stopped: Arc::default() };
    let stopped = watch.stopped.clone();
    let quiet = args.common.quiet;
    // Where handlers cannot be set, interruption ends the program as it always did.
    let _ = ctrlc::set_handler(move || {
        if stopped.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPTED);
        }
        if !quiet {
            // There may be nobody who reads it.
            let _ = writeln!(
                std::io::stderr(),
                "mrvis: stopping with the light there is; once more ends at once"
            );
        }
    });
    watch.stage("preparing", 0);
    let model = prepare(scene, &options, &watch)?;
    let met = radiosity::run_then(&model, &points, &options, &watch, |mut outcome, more| {
        if let Some(other) = args.compare.filter(|_| !outcome.record.interrupted) {
            outcome.record.versus = Some(radiosity::versus(&model, &points, &outcome, other.into(), &watch)?);
        }
        watch.spinner.clear();
        outcome.record.seconds.load = load;
        if outcome.record.interrupted {
            let note = "interrupted: this is the consistent solution reached so far";
            outcome.record.warnings.push(note.into());
        }
        let met = outcome.record.target_met != Some(false);
        write(args, out, (model.scene(), &points), outcome, more).map(|()| met)
    })?;
    Ok(if met { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// Writes all files and says so.
fn write(
    args: &Args,
    out: &Path,
    (scene, points): (&Scene, &[Point]),
    outcome: Outcome,
    more: &More,
) -> Result<()> {
    let Outcome { solution, mut record, irradiance } = outcome;
    let save = |record: &Record| {
        let text = serde_json::to_string_pretty(record)
            .map_err(|e| Error::format(out.join("solution.json"), None, e.to_string()))?;
        WholeFile::write(&out.join("solution.json"), text + "\n")
    };
    save(&record)?;
    if args.points.is_some() {
        let file = Irradiance { points: points.to_vec(), values: irradiance, standard_errors: Vec::new() };
        write_irradiance(&out.join("irradiance.csv"), &file)?;
    }
    let notes = RefCell::new(Vec::new());
    let gather = |points: &[Point], part: f64| {
        let Answer { irradiance, note } = more.irradiance(points, part);
        notes.borrow_mut().extend(note);
        irradiance
    };
    let with_points = args.points.is_some();
    let shown = args.outputs.write(&args.common, scene, &solution, out, with_points, &gather)?;
    let notes = notes.into_inner();
    if !notes.is_empty() {
        record.warnings.extend(notes);
        save(&record)?;
    }
    args.common.write_json(&record)?;
    args.common.print(&summary(&record))?;
    for file in shown {
        args.common.print(&format!("wrote {}\n", file.display()))?;
    }
    Ok(())
}

/// Solves the series of scenes and shows how time grows.
fn scaling(common: &Common, options: &Options, largest: usize) -> Result<ExitCode> {
    radiosity::check_scaling(largest)?;
    common.check_json()?;
    let watch = Watch { spinner: common.spinner("solving"), stopped: Arc::default() };
    let found = radiosity::scaling(options, largest, &watch)?;
    drop(watch);
    common.write_json(&found)?;
    let mut text =
        String::from("triangles    elements       links        rays     memory     error        time\n");
    for r in &found.rows {
        let _ = writeln!(
            text,
            "{:>9} {:>11} {:>11} {:>11} {:>7.1} MB {:>9} {:>9.2} s",
            grouped(r.triangles),
            grouped(r.elements),
            grouped(r.links),
            grouped(r.exact_rays as usize),
            r.bytes as f64 / 1e6,
            r.rms_error.map_or_else(|| "-".into(), |e| format!("{e:.4}")),
            r.seconds
        );
    }
    let _ = writeln!(
        text,
        "time grows as triangles to the power of {:.3} over all scenes, {:.3} over the last two, where what costs the same in \
         all of them (rays of the local pass) counts least",
        found.slope, found.slope_last
    );
    common.print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// The cameras whose pictures matter.
fn views(scene: &Scene, given: Option<[f64; 7]>) -> Result<Vec<View>> {
    let views: Vec<View> = match given {
        Some([x, y, z, u, v, w, degrees]) => {
            let eye = DVec3::new(x, y, z);
            let forward = (DVec3::new(u, v, w) - eye).normalize();
            vec![View { eye, forward, angle: degrees.to_radians() }]
        }
        None => {
            let of = |c: &StoredCamera| View { eye: c.eye, forward: c.forward, angle: c.angle };
            scene.cameras.iter().map(of).collect()
        }
    };
    if views.is_empty() {
        return Err(Error::Argument(
            "--importance-camera: the scene has no camera; give one with --camera".into(),
        ));
    }
    Ok(views)
}

/// Shows what is going on, and passes an interruption on.
struct Watch {
    spinner: Spinner,
    stopped: Arc<AtomicBool>,
}

impl Progress for Watch {
    fn stage(&self, name: &str, _: u64) {
        self.spinner.say(name);
    }

    fn stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

/// Prepares the model within the time that the options allow for the whole solve.
fn prepare(scene: Scene, options: &Options, watch: &Watch) -> Result<Model> {
    let until = Until { watch, start: Instant::now(), seconds: options.max_seconds.unwrap_or(f64::INFINITY) };
    Model::prepare(scene, &options.prepare(), &until).map_err(|error| match (error, options.max_seconds) {
        (Error::Cancelled(_), Some(seconds)) if !watch.stopped() => Error::Argument(format!(
            "--max-seconds {seconds}: the time was up before the clusters were measured; allow more (they are kept for the \
             next run) or take --visibility exact"
        )),
        (error, _) => error,
    })
}

/// Stops a preparation when the time of the solve is up.
struct Until<'a> {
    watch: &'a Watch,
    start: Instant,
    seconds: f64,
}

impl Progress for Until<'_> {
    fn stage(&self, name: &str, steps: u64) {
        self.watch.stage(name, steps);
    }

    fn stopped(&self) -> bool {
        self.watch.stopped() || self.start.elapsed().as_secs_f64() >= self.seconds
    }
}

/// Feature sizes by name.
fn read_sizes(path: &Path) -> Result<Vec<(String, f32)>> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    let sizes: BTreeMap<String, f32> = toml::from_str(&text).map_err(|e| {
        let line = e.span().map(|s| 1 + text[..s.start].matches('\n').count());
        Error::format(path, line, format!("{}; write lines like `sofa = 0.05`", e.message()))
    })?;
    Ok(sizes.into_iter().collect())
}

fn summary(r: &Record) -> String {
    let mut text = String::new();
    let s = &r.seconds;
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{} elements, {} links, {} exact rays",
        grouped(r.elements),
        grouped(r.links),
        grouped(r.exact_rays as usize)
    );
    if r.unlit.sides > 0 {
        let _ = writeln!(
            text,
            "{} of {} sides, {:.1} % of the surface, are reached by no light",
            grouped(r.unlit.sides),
            grouped(r.unlit.of),
            100.0 * r.unlit.area
        );
    }
    let _ = writeln!(
        text,
        "read {:.2} s, Embree {:.2} s, clusters {:.2} s, measured {:.2} s, elements {:.2} s, solved {:.2} s, local {:.2} s, points {:.2} s",
        s.load, s.embree, s.hierarchy, s.characterise, s.elements, s.solve, s.local, s.points
    );
    let l = &r.ledger;
    let _ = writeln!(
        text,
        "emitted {0} {unit}, absorbed {1} {unit}, escaped {2} {unit}, created {3:.1e} {unit} (mean of the channels)",
        number(l.emitted),
        number(l.absorbed),
        number(l.escaped),
        l.created,
        unit = l.unit
    );
    if let Some([low, high]) = l.row_sums {
        let _ = writeln!(
            text,
            "row sums of closed elements {low:.4} to {high:.4}, off by {:.1e} in the mean (as sampled {:.1e})",
            l.row_sum_error, l.row_sum_error_sampled
        );
    }
    let [red, green, blue] = r.mean_irradiance.map(number);
    let _ = writeln!(
        text,
        "mean irradiance {red}, {green}, {blue} W/m\u{b2} (red, green, blue); estimated error {} %",
        number(100.0 * r.error_estimate)
    );
    if let Some(v) = &r.versus {
        text += &side_by_side(r, v);
    }
    if let Some(a) = &r.audit {
        let _ = writeln!(
            text,
            "error bars: {:.0} % of {} elements within one, {:.0} % within two; RMS error {:.3} of the mean, bars say {:.3}",
            100.0 * a.within_one,
            a.elements,
            100.0 * a.within_two,
            a.rms_error,
            a.rms_bar
        );
    }
    for warning in &r.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    text
}

/// A table of both engines.
fn side_by_side(r: &Record, v: &Versus) -> String {
    let name = |visibility| match visibility {
        Visibility::Exact => "exact",
        Visibility::Mr => "mr",
        Visibility::Average => "average",
    };
    let mut text = format!(
        "{:<9}{:>11}{:>11}{:>11}{:>11}{:>11}{:>12}\n",
        "", "clusters s", "solved s", "points s", "all s", "links", "exact rays"
    );
    for (visibility, s, links, rays) in [
        (r.options.visibility, &r.seconds, r.links, r.bundles.exact_rays),
        (v.visibility, &v.seconds, v.links, v.bundles.exact_rays),
    ] {
        let clusters = s.hierarchy + s.characterise;
        let _ = writeln!(
            text,
            "{:<9}{clusters:>11.2}{:>11.2}{:>11.2}{:>11.2}{:>11}{:>12}",
            name(visibility),
            s.solve,
            s.points,
            s.work(),
            grouped(links),
            grouped(rays as usize)
        );
    }
    let (own, other) = (name(r.options.visibility), name(v.visibility));
    let _ = writeln!(
        text,
        "{other} took {:.2} times as long as {own}; at the points they differ by {:.2} % RMS, {:+.2} % in the mean",
        v.speedup,
        100.0 * v.difference.rms,
        100.0 * v.difference.bias
    );
    text
}
