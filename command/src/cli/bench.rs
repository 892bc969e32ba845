//! `mrvis bench SCENE`: exact against multi-resolution visibility on the same segments.

use super::args::{CacheArgs, Common, SceneArgs, command_line, distinct, plain};
use super::inputs::{Inputs, Output, check_folder};
use super::limits;
use super::progress::Bar;
use super::values::{ClusterArgs, Values, name_of, one_of, set_fields};
use mrvis::internals::bench;
use mrvis::internals::bench::page::{self, MrImage, ReceiverImages};
use mrvis::internals::files::WholeFile;
use mrvis::internals::image_io::{difference, grey, mask_overlay, write_exr, write_png};
use mrvis::internals::metrics::FeatureSet;
use mrvis::internals::optics::Extinction;
use mrvis::internals::threads::Threads;
use mrvis::metrics::{FeatureOptions, Image};
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
    #[arg(long, value_name = "N", default_value_t = BenchOptions::default().rays)]
    pub rays: usize,
    /// Receiver points, uniform over all surfaces that do not emit
    #[arg(long, value_name = "N", default_value_t = BenchOptions::default().points)]
    pub points: usize,
    /// Object, group or material for shadow images; repeatable [default: the largest flat surfaces, and terrain]
    #[arg(long = "receiver", value_name = "NAME")]
    pub receivers: Vec<String>,
    /// Texels along the longer side of the maps, images of whole surfaces in which both engines interpolate; 0: no maps [default: 256, or
    /// fewer with more than eight emitters]
    #[arg(long, value_name = "N")]
    pub map: Option<usize>,
    /// Rays from a point to an emitter in the reference
    #[arg(long, value_name = "N", default_value_t = BenchOptions::default().reference_rays)]
    pub reference_rays: usize,
    /// Largest number of runs of each timed row; tests that compare no times run each row once
    #[arg(long, value_name = "N", hide = true, default_value_t = BenchOptions::default().rounds)]
    pub rounds: usize,
    /// Check the stated intervals by independent exact rays on this part of the bundles; 0: no check
    #[arg(long, value_name = "FRACTION", default_value_t = BenchOptions::default().audit)]
    pub audit: f64,
    /// Tolerated error of a cluster's transmittance; clusters with a larger error are averaged only for beams wide
    /// enough to compensate
    #[arg(long, value_name = "TOL", default_value_t = BenchOptions::default().clusters.tolerance)]
    pub tolerance: f32,
    /// Extinction of clusters
    #[arg(long, value_parser = one_of(EXTINCTION), default_value = name_of(EXTINCTION, Extinction::default()))]
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
    set_fields!(options = args: feature_sizes, rays, points, receivers, map, reference_rays, rounds, audit);
    options.threads = common.threads.map_or(options.threads, usize::from);
    options.seed = common.seed;
    (options.clusters.extinction, options.clusters.tolerance) = (args.extinction, args.tolerance);
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
    let mut text = bench::text(&record);
    if let Some(folder) = &args.out {
        write_pictures(folder, &images)?;
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
        scene.parts().objects.iter().map(|object| file_stem(&object.name)).collect()
    } else {
        args.receivers.iter().map(|name| file_stem(name)).collect()
    };
    let json = args.common.json.iter().filter_map(|json| json.file_name());
    let others = json.chain(scene.parts().files.iter().filter_map(|file| file.file_name()));
    let mut names: Vec<String> = others
        .map(|name| name.to_string_lossy().into_owned())
        .filter(|name| may_be_written(&stems, name))
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
    WholeFile::write(&path, page)?;
    Ok(format!("report: {}\n", path.display()))
}

/// Writes images as PNG (tone-mapped) and EXR (values), differences and feature masks.
pub fn write_pictures(folder: &Path, receivers: &[ReceiverImages]) -> Result<()> {
    let stems = distinct(receivers.iter().map(|receiver| file_stem(&receiver.name)));
    for (receiver, stem) in receivers.iter().zip(stems) {
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
        for MrImage { size: s, image, .. } in &receiver.mr {
            compared(&format!("mr-{s}"), image)?;
            let mask = mask_overlay(reference, 1.0, &features.mask(f64::from(*s)))?;
            write_png(&folder.join(format!("{stem}-mask-{s}.png")), &mask)?;
        }
    }
    Ok(())
}

/// Whether a picture of a receiver with one of the stems may get the name `file`.
fn may_be_written(stems: &[String], file: &str) -> bool {
    let Some((name, _)) = file.rsplit_once('.').filter(|(_, end)| ["png", "exr"].contains(end)) else {
        return false;
    };
    let number = |text: &str| text.parse::<f32>().is_ok();
    let is_picture = |what: &str| {
        let of_size = what.strip_prefix("mr-").map(|s| s.strip_suffix("-difference").unwrap_or(s));
        ["reference", "exact16", "exact16-difference"].contains(&what)
            || of_size.or(what.strip_prefix("mask-")).is_some_and(number)
    };
    // Of equal stems the later ones are numbered.
    let numbered = |rest: &str| rest.split_once('-').is_some_and(|(n, what)| number(n) && is_picture(what));
    let of_stem = |stem: &String| name.strip_prefix(stem).and_then(|rest| rest.strip_prefix('-'));
    stems.iter().filter_map(of_stem).any(|rest| is_picture(rest) || numbered(rest))
}

/// A name that is valid in every file system.
pub fn file_stem(name: &str) -> String {
    let stem = plain(name);
    if stem.is_empty() { "receiver".into() } else { stem }
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
    fn names_of_pictures_are_known() {
        let stems = ["floor".to_string()];
        for name in ["floor-reference.exr", "floor-2-mask-0.5.png", "floor-mr-0.25-difference.png"] {
            assert!(may_be_written(&stems, name), "{name}");
        }
        for name in ["wood.png", "floor.png", "wall-reference.exr", "floor-reference.obj", "floor-mask-a.png"]
        {
            assert!(!may_be_written(&stems, name), "{name}");
        }
    }
}
