//! `mrvis bench SCENE`: exact against multi-resolution visibility on the same segments.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use mrvis::bench::page::{self, ReceiverImages};
use mrvis::bench::record::{MrRow, Record};
use mrvis::bench::{self, Options, Progress};
use mrvis::metrics::{FeatureOptions, FeatureSet, Image};
use mrvis::output::{difference, grey, mask_overlay, number, write_atomically, write_exr, write_png};
use mrvis::{Error, Result};

use super::args::{Common, SceneArgs};

/// Measure exact (Embree) against multi-resolution visibility on the same segments of a scene: table, JSON, images and
/// a report page.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Feature size in scene units, shadows smaller than this may be averaged; may be given several times [default:
    /// four sizes from the scene's statistics]
    #[arg(short = 's', long = "feature-size", value_name = "S")]
    pub feature_sizes: Vec<f64>,
    /// Segments from a point to an emitter; 4 and 16 times as many are measured too
    #[arg(long, value_name = "N", default_value_t = 16)]
    pub rays: usize,
    /// Receiver points, spread over all surfaces that do not emit
    #[arg(long, value_name = "N", default_value_t = 20_000)]
    pub points: usize,
    /// Object, group or material to make shadow images of; may be given several times [default: the largest planar
    /// ones]
    #[arg(long = "receiver", value_name = "NAME")]
    pub receivers: Vec<String>,
    /// Rays from a point to an emitter in the reference
    #[arg(long, value_name = "N", default_value_t = 1024)]
    pub reference_rays: usize,
    /// Folder for images and report.html (made if missing)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Threads of the timed sections; preparation and reference use all cores
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub threads: usize,
    /// Seed of every random choice
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// File for the figures as JSON; - is the standard output
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Print nothing but errors
    #[arg(long)]
    pub quiet: bool,
    /// Name of the scene's unit of length
    #[arg(long, value_name = "U", default_value = "m")]
    pub unit: String,
}

/// Runs the command. Exit code 0.
///
/// # Errors
/// An option is out of range, the scene cannot be used, a name is unknown, an output is not writable. Options and
/// outputs are checked before the work begins; every file is written whole or not at all.
pub fn run(args: &Args) -> Result<ExitCode> {
    let options = Options {
        feature_sizes: args.feature_sizes.clone(),
        rays: args.rays,
        points: args.points,
        receivers: args.receivers.clone(),
        reference_rays: args.reference_rays,
        threads: args.threads,
        seed: args.seed,
    };
    options.check()?;
    let to_stdout = args.json.as_deref() == Some(Path::new("-"));
    let json = args.json.as_deref().filter(|_| !to_stdout);
    if let Some(path) = json {
        check_file(path)?;
    }
    if let Some(folder) = &args.out {
        check_folder(folder)?;
    }

    let start = Instant::now();
    let common =
        Common { threads: None, seed: args.seed, json: None, quiet: args.quiet, unit: args.unit.clone() };
    let scene = args.scene.load(&common)?;
    let load_s = start.elapsed().as_secs_f64();
    let bar = Bar::new(args.quiet);
    let (mut record, images) = bench::run(&scene, &options, &bar)?;
    record.build.load_s = load_s;
    drop(scene);
    bar.stage("writing", 0);
    let text =
        serde_json::to_string_pretty(&record).map_err(|e| Error::Argument(format!("--json: {e}")))? + "\n";
    if let Some(folder) = &args.out {
        write_pictures(folder, &images)?;
        write_atomically(&folder.join("report.html"), page::render(&record, &images)?.as_bytes())?;
    }
    if let Some(path) = json {
        write_atomically(path, text.as_bytes())?;
    }
    bar.finish();

    let mut table = table(&record);
    if let Some(folder) = &args.out {
        let _ = writeln!(table, "report: {}", folder.join("report.html").display());
    }
    // A reader that went away (`| head`) is no error of this command.
    if to_stdout {
        let _ = std::io::stdout().write_all(text.as_bytes());
        if !args.quiet {
            let _ = std::io::stderr().write_all(table.as_bytes());
        }
    } else if !args.quiet {
        let _ = std::io::stdout().write_all(table.as_bytes());
    }
    Ok(ExitCode::SUCCESS)
}

/// Whether a file can be written, without touching it.
fn check_file(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::io(path, std::io::ErrorKind::IsADirectory.into()));
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(folder).map(drop).map_err(|e| Error::io(path, e))
}

/// Whether files can be written into a folder that exists, or one can be made.
fn check_folder(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    tempfile::tempfile_in(folder).map(drop).map_err(|e| Error::io(folder, e))
}

/// The progress bar: on a terminal only, from the second second on.
struct Bar {
    bar: ProgressBar,
    started: Instant,
    quiet: bool,
    /// Whether the bar is shown already.
    shown: Mutex<bool>,
}

impl Bar {
    fn new(quiet: bool) -> Bar {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        Bar { bar, started: Instant::now(), quiet, shown: Mutex::new(false) }
    }

    fn show(&self) {
        let mut shown = self.shown.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if !*shown && !self.quiet && self.started.elapsed() > Duration::from_secs(1) {
            *shown = true;
            self.bar.set_draw_target(ProgressDrawTarget::stderr_with_hz(5));
        }
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.finish();
    }
}

impl Progress for Bar {
    fn stage(&self, name: &str, steps: u64) {
        let template = if steps > 0 { "{msg:24} {wide_bar} {percent:>3} % {eta:>4}" } else { "{msg:24}" };
        self.bar.set_style(
            ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()),
        );
        self.bar.set_message(name.to_string());
        self.bar.set_length(steps.max(1));
        self.bar.reset();
        self.show();
        self.bar.tick();
    }

    fn advance(&self, steps: u64) {
        self.show();
        self.bar.inc(steps);
    }
}

/// Images as PNG (as the eye would see them) and EXR (values), differences and feature masks.
fn write_pictures(folder: &Path, receivers: &[ReceiverImages]) -> Result<()> {
    let mut used: Vec<String> = Vec::new();
    for receiver in receivers {
        let mut stem = file_stem(&receiver.name);
        let same = used.iter().filter(|u| **u == stem).count();
        used.push(stem.clone());
        if same > 0 {
            let _ = write!(stem, "-{}", same + 1);
        }
        let both = |what: &str, image: &Image| -> Result<()> {
            write_png(&folder.join(format!("{stem}-{what}.png")), &grey(image, 1.0))?;
            write_exr(&folder.join(format!("{stem}-{what}.exr")), image)
        };
        let reference = &receiver.reference;
        both("reference", reference)?;
        let compared = |what: &str, image: &Image| -> Result<()> {
            both(what, image)?;
            let picture = difference(reference, image, 0.5)?;
            write_png(&folder.join(format!("{stem}-{what}-difference.png")), &picture)
        };
        compared("exact16", &receiver.exact16)?;
        let mut features = FeatureSet::new(reference, &FeatureOptions::default())?;
        for (s, image) in &receiver.mr {
            compared(&format!("mr-{s}"), image)?;
            let mask = mask_overlay(reference, 1.0, &features.mask(f64::from(*s)))?;
            write_png(&folder.join(format!("{stem}-mask-{s}.png")), &mask)?;
        }
    }
    Ok(())
}

/// A name that every file system takes.
fn file_stem(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_".contains(c) { c } else { '_' };
    let stem: String = name.chars().take(60).map(plain).collect();
    if stem.is_empty() { "receiver".into() } else { stem }
}

/// The record for a terminal.
fn table(record: &Record) -> String {
    let Record { scene, build, workload, unit, .. } = record;
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{}: {} triangles, {} objects, {} emitters, {} closed parts, {} sheets, {} clusters in {} levels",
        scene.path,
        scene.triangles,
        scene.objects,
        scene.emitters,
        scene.closed_parts,
        scene.sheet_parts,
        scene.clusters,
        scene.levels
    );
    let _ = writeln!(
        text,
        "built in: reading {}, Embree {}, hierarchy {}, measuring clusters {}",
        seconds(build.load_s),
        seconds(build.embree_s),
        seconds(build.hierarchy_s),
        seconds(build.characterise_s)
    );
    let _ = writeln!(
        text,
        "{} points, {} segments at {} rays; reference of {} rays, its own noise {}; {} thread{}, {}",
        workload.points,
        workload.segments,
        workload.rays,
        workload.reference_rays,
        number(workload.reference_rms),
        record.threads,
        if record.threads == 1 { "" } else { "s" },
        record.isa
    );
    for warning in &record.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    let _ = writeln!(text, "\nexact    rays       time        RMS       bias  call");
    for row in &record.exact {
        let coherent = if row.coherent { ", coherent" } else { "" };
        let _ = writeln!(
            text,
            "{:>13} {:>10} {:>10.5} {:>+10.5}  {}{coherent}",
            row.rays,
            seconds(row.seconds),
            row.rms,
            row.bias,
            row.mode
        );
    }
    let _ = writeln!(text, "\nmulti-resolution                                           speed-up at same");
    let _ = writeln!(
        text,
        "       s   rays       time        RMS       bias       RMS      FBEM   segment  averaged  nodes"
    );
    for row in &record.mr {
        let _ = writeln!(
            text,
            "{:>8} {:>6} {:>10} {:>10.5} {:>+10.5} {:>9} {:>9} {:>9} {:>7.1} % {:>6}",
            number(row.feature_size),
            row.rays,
            seconds(row.seconds),
            row.rms,
            row.bias,
            times(row.speedup_at_same_rms, row.extrapolated),
            times(row.speedup_at_same_fbem, false),
            times(Some(row.speedup_per_segment), false),
            100.0 * row.aggregated_fraction,
            number(row.nodes_per_segment)
        );
    }
    if record.mr.iter().any(|row| row.extrapolated) {
        let _ = writeln!(text, "~ beyond the most exact rays measured, extrapolated");
    }
    let _ = writeln!(text, "\n{}", headline(record.best(), unit));
    text
}

/// The result in one sentence.
fn headline(best: Option<&MrRow>, unit: &str) -> String {
    let Some((row, speed)) = best.and_then(|row| Some((row, row.speedup_at_same_rms?))) else {
        return "no multi-resolution row could be compared with exact at the same error".into();
    };
    let speed = if speed >= 1.0 {
        format!("{} times faster than exact", number(speed))
    } else {
        format!("{} times slower than exact", number(1.0 / speed))
    };
    format!(
        "best: s = {} {unit} with {} segments is {speed} at the same RMS error of {} % (per segment {})",
        number(row.feature_size),
        row.rays,
        number(100.0 * row.rms),
        times(Some(row.speedup_per_segment), false)
    )
}

fn seconds(s: f64) -> String {
    if s < 0.1 { format!("{:.2} ms", 1000.0 * s) } else { format!("{s:.3} s") }
}

fn times(v: Option<f64>, about: bool) -> String {
    v.map_or("-".into(), |v| format!("{}{v:.2}x", if about { "~" } else { "" }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_file_names() {
        assert_eq!(file_stem("a/b: c"), "a_b__c");
        assert_eq!(file_stem(""), "receiver");
    }

    #[test]
    fn outputs_are_checked_without_being_touched() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.json");
        check_file(&file).unwrap();
        assert!(!file.exists());
        assert!(check_file(folder.path()).is_err());
        assert!(check_file(&folder.path().join("missing/a.json")).is_err());
        std::fs::write(&file, "x").unwrap();
        assert!(check_folder(&file).is_err());
        check_folder(&folder.path().join("new")).unwrap();
    }

    #[test]
    fn losses_are_said_plainly() {
        let row = |speed| MrRow {
            speedup_at_same_rms: Some(speed),
            rms: 0.01,
            feature_size: 0.1,
            ..MrRow::default()
        };
        assert!(headline(Some(&row(2.0)), "m").contains("2 times faster"));
        assert!(headline(Some(&row(0.5)), "m").contains("2 times slower"));
        assert!(headline(None, "m").contains("no multi-resolution row"));
    }
}
