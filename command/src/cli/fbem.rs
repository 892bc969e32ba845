//! `mrvis fbem REFERENCE APPROXIMATION`: feature-based error of an image.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use super::args::Common;
use super::inputs::{Inputs, Output};
use super::values::{Values, name_of, one_of, tolerance};
use serde_json::json;

use mrvis::internals::files::WholeFile;
use mrvis::internals::image_io::{Channel, difference, mask_overlay, read_image, write_exr, write_png};
use mrvis::internals::metrics::{FeatureSet, Norms, norms, spectrum_sizes};
use mrvis::internals::plot::{Marks, Plot, PlotPoint, Scale, Series, number};
use mrvis::metrics::{Fbem, FbemOptions, FeatureOptions, Features, Filter, Image, Morphology, fbem};
use mrvis::{Error, Result};

/// Compare two images by the feature-based error metric: features larger than s are compared texel by texel, the rest
/// on average. PNG, EXR, HDR, JPEG; 8- and 16-bit images are converted from sRGB to linear values.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The reference image
    pub reference: PathBuf,
    /// The image to be compared, of the same size
    pub approximation: PathBuf,
    /// Feature size in scene units (in texels without --texel); repeatable [default: a spectrum]
    #[arg(short, long = "s", visible_alias = "feature-size", value_name = "S")]
    pub sizes: Vec<f64>,
    /// Side of a texel in scene units
    #[arg(long, value_name = "T", default_value_t = 1.0)]
    pub texel: f64,
    /// Measure of feature sizes
    #[arg(long, value_parser = one_of(MODES), default_value = name_of(MODES, FeatureOptions::default().morphology))]
    pub mode: Morphology,
    /// Regions that are features
    #[arg(long, value_parser = one_of(KINDS), default_value = name_of(KINDS, FeatureOptions::default().features))]
    pub features: Features,
    /// Exclude features from the averages outside of them
    #[arg(long)]
    pub unmasked_filter: bool,
    /// Exponent of the norm
    #[arg(long, default_value_t = FbemOptions::default().exponent)]
    pub p: f64,
    /// Value of an unoccluded texel [default: 1, or the reference's maximum if that is larger]
    #[arg(long, value_name = "W")]
    pub white: Option<f32>,
    /// Smallest relative darkening that counts as shadow
    #[arg(long, default_value_t = FeatureOptions::default().threshold)]
    pub threshold: f32,
    /// Channel of the pixels that is compared
    #[arg(long, value_parser = one_of(COMPONENTS), default_value = "luminance")]
    pub channel: Channel,
    /// Folder for feature masks, difference image and spectrum (created if missing)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// File for the results as JSON; - is the standard output, and the text then goes to standard error
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Exit with code 1 if the error at any size exceeds E (in image values)
    #[arg(long, value_name = "E", value_parser = tolerance)]
    pub tolerance: Option<f64>,
    /// Print nothing
    #[arg(long)]
    pub quiet: bool,
}

const MODES: Values<Morphology> = &[
    ("euclid", "Largest disc inside the feature (independent of direction)", Morphology::Euclid),
    ("paper8", "Erosions with 8 neighbours, as in the paper's program", Morphology::Paper8),
    ("paper4", "Erosions with 4 neighbours, as in the paper's definition", Morphology::Paper4),
];

const KINDS: Values<Features> = &[
    ("both", "Shadows and lit regions", Features::Both),
    ("shadow", "Shadows only, as in the paper", Features::Shadow),
];

const COMPONENTS: Values<Channel> = &[
    ("luminance", "", Channel::Luminance),
    ("red", "", Channel::Red),
    ("green", "", Channel::Green),
    ("blue", "", Channel::Blue),
];

/// Runs the command. Exit code 0, or 1 when a tolerance was given and missed.
///
/// # Errors
/// An image cannot be read, the images differ in size, an option is out of range, or an output is not writable.
pub fn run(args: &Args) -> Result<ExitCode> {
    let inputs = Inputs::of([&args.reference, &args.approximation]);
    // Other common options have no effect here.
    let common = Common { json: args.json.clone(), quiet: args.quiet, ..Common::default() };
    common.check_outputs(&inputs, [])?;
    let reference = read_image(&args.reference, args.channel, args.texel)?;
    let approximation = read_image(&args.approximation, args.channel, args.texel)?;
    let white = args.white.unwrap_or_else(|| reference.data().iter().copied().fold(1.0, f32::max));
    let features = feature_options(args, white);
    let filter = if args.unmasked_filter { Filter::Unmasked } else { Filter::Whole };
    let mut options = FbemOptions::default();
    (options.exponent, options.features, options.filter) = (args.p, features, filter);
    let sizes = if args.sizes.is_empty() { spectrum_sizes(&reference, 8) } else { args.sizes.clone() };
    if let Some(folder) = &args.out {
        let pictures =
            FIXED_PICTURES.map(String::from).into_iter().chain(sizes.iter().map(|&s| mask_name(s)));
        common.check_outputs(&inputs, Output::within("--out", folder, pictures))?;
    }
    let norms = norms(&reference, &approximation)?;
    let rows = fbem(&reference, &approximation, &sizes, &options)?;
    // A closed pipe (`| head`) is not an error.
    let _ = common.print(&table(args, &reference, white, &norms, &rows));
    common.write_json(&report(args, &reference, white, &norms, &rows))?;
    if let Some(folder) = &args.out {
        write_pictures(folder, &reference, &approximation, &features, &rows)?;
    }
    let missed = args.tolerance.is_some_and(|t| rows.iter().any(|row| row.value > t));
    Ok(ExitCode::from(u8::from(missed)))
}

/// What counts as a feature.
fn feature_options(args: &Args, white: f32) -> FeatureOptions {
    let mut options = FeatureOptions::default();
    (options.features, options.morphology) = (args.features, args.mode);
    (options.white, options.threshold) = (white, args.threshold);
    options
}

/// The results as text.
fn table(args: &Args, image: &Image, white: f32, norms: &Norms, rows: &[Fbem]) -> String {
    let mode = name_of(MODES, args.mode);
    let mut text = format!(
        "{} x {} texels of side {}, unoccluded value {}, feature sizes by --mode {mode}\n\n",
        image.width(),
        image.height(),
        number(args.texel),
        number(f64::from(white)),
    );
    text += &format!("{:>10} {:>11} {:>9} {:>11}\n", "s", "FBEM", "FBEM %", "masked %");
    for row in rows {
        let percent = 100.0 * row.value / f64::from(white);
        let masked = 100.0 * row.masked_fraction;
        text += &format!("{:>10} {:>11.6} {percent:>9.3} {masked:>11.2}\n", number(row.size), row.value);
    }
    let Norms { l1, l2, bias, max, .. } = norms;
    text + &format!("\nL1 {l1:.6}   L2 {l2:.6}   bias {bias:+.6}   largest {max:.6}\n")
}

/// The results as JSON.
fn report(args: &Args, image: &Image, white: f32, norms: &Norms, rows: &[Fbem]) -> serde_json::Value {
    let row = |row: &Fbem| {
        json!({
            "feature_size": row.size,
            "fbem": row.value,
            "percent": 100.0 * row.value / f64::from(white),
            "masked_fraction": row.masked_fraction,
        })
    };
    json!({
        "mrvis": env!("CARGO_PKG_VERSION"),
        "reference": args.reference.display().to_string(),
        "approximation": args.approximation.display().to_string(),
        "width": image.width(),
        "height": image.height(),
        "texel": args.texel,
        "mode": name_of(MODES, args.mode),
        "features": name_of(KINDS, args.features),
        "channel": name_of(COMPONENTS, args.channel),
        "filter": if args.unmasked_filter { "unmasked" } else { "whole" },
        "p": args.p,
        "white": white,
        "threshold": args.threshold,
        "l1": norms.l1,
        "l2": norms.l2,
        "bias": norms.bias,
        "max": norms.max,
        "fbem": rows.iter().map(row).collect::<Vec<_>>(),
        "tolerance": args.tolerance,
    })
}

/// Names of the pictures besides masks.
const FIXED_PICTURES: [&str; 3] = ["difference.png", "difference.exr", "spectrum.svg"];

/// Name of the mask of a feature size.
fn mask_name(size: f64) -> String {
    format!("mask-{size}.png")
}

/// Writes masks over the reference, the difference and the spectrum.
fn write_pictures(
    folder: &Path,
    reference: &Image,
    approximation: &Image,
    features: &FeatureOptions,
    rows: &[Fbem],
) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    let mut set = FeatureSet::new(reference, features)?;
    for row in rows {
        let picture = mask_overlay(reference, features.white, &set.mask(row.size))?;
        write_png(&folder.join(mask_name(row.size)), &picture)?;
    }
    let [difference_png, difference_exr, svg] = FIXED_PICTURES.map(|name| folder.join(name));
    write_png(&difference_png, &difference(reference, approximation, features.white)?)?;
    let values: Vec<f32> = reference.data().iter().zip(approximation.data()).map(|(r, a)| a - r).collect();
    let signed = Image::new(reference.width(), reference.height(), reference.texel(), values)?;
    write_exr(&difference_exr, &signed)?;
    let point = |row: &Fbem| PlotPoint { x: row.size, y: row.value, label: String::new() };
    let plot = Plot::new(
        ("feature size s", Scale::Linear),
        ("error that features larger than s see", Scale::Linear),
        vec![Series::new("FBEM(s)", rows.iter().map(point).collect(), Marks::Joined)],
    );
    WholeFile::write(&svg, plot.svg(720, 420)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        args: Args,
    }

    /// Runs the command on a shadow and an image without it, with further arguments.
    fn run_on(folder: &Path, more: &[&str]) -> Result<ExitCode> {
        let shadow =
            |x: usize, y: usize| if (20..40).contains(&x) && (20..40).contains(&y) { 0.0 } else { 1.0 };
        let (a, b) = (folder.join("a.exr"), folder.join("b.exr"));
        write_exr(&a, &Image::from_fn(64, 64, 1.0, shadow)?)?;
        write_exr(&b, &Image::from_fn(64, 64, 1.0, |_, _| 1.0)?)?;
        let files = [Path::new("fbem"), &a, &b].map(|p| p.display().to_string());
        let words = files.into_iter().chain(more.iter().map(|w| w.to_string()));
        run(&Command::try_parse_from(words.chain(["--quiet".to_string()])).unwrap().args)
    }

    #[test]
    fn figures_and_pictures_are_written() {
        let folder = tempfile::tempdir().unwrap();
        let (out, json) = (folder.path().join("new/out"), folder.path().join("figures.json"));
        let paths = [out.display().to_string(), json.display().to_string()];
        let more = ["--s", "0", "--s", "2.5", "--texel", "0.1", "--out", &paths[0], "--json", &paths[1]];
        assert_eq!(run_on(folder.path(), &more).unwrap(), ExitCode::SUCCESS);
        for name in ["mask-0.png", "mask-2.5.png", "difference.png", "difference.exr", "spectrum.svg"] {
            assert!(out.join(name).is_file(), "{name}");
        }
        let figures: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
        let expected = (400.0f64 / 4096.0).sqrt();
        assert!((figures["l2"].as_f64().unwrap() - expected).abs() < 1e-12);
        assert_eq!(figures["fbem"][0]["fbem"], figures["l2"]);
        assert!(figures["fbem"][1]["fbem"].as_f64().unwrap() < 0.9 * expected);
    }

    #[test]
    fn bad_options_and_outputs_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let code = |more: &[&str]| run_on(folder.path(), more);
        for bad in [["--s", "nan"], ["--texel", "0"], ["--p", "0"], ["--white", "0"]] {
            assert!(code(&bad).is_err(), "{bad:?}");
        }
        let unwritable = folder.path().join("a.exr/x").display().to_string();
        assert!(code(&["--out", &unwritable]).is_err());
        assert!(code(&["--json", &unwritable]).is_err());
    }
}
