//! `mrvis terrain GRID --out DIR`: what all samples of a height field see of sky and sun.

use super::args::{Common, GridArgs, SkyArgs, grouped, warn};
use super::flags::with_flags;
use super::inputs::{Inputs, Output, check_folder};
use super::mesh_grid;
use super::values::{Values, name_of, one_of};
use mrvis::internals::plot::number;
use mrvis::internals::sky::{DVec3, Environment, SkyModel};
use mrvis::internals::terrain::{
    EARTH_RADIUS, Grid, Layer, Light, Sun, SweepOptions, horizon, irradiance, read, sky_view_factor, sunlit,
    write_geotiff, write_npz, write_png,
};
use mrvis::{Error, Result, SkyOptions};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Compute what the samples of a height field see of sky and sun: sky view factor, horizon, whether the sun shines, and the
/// irradiance of sky and sun, without light from other ground; `solve` computes all light.
#[derive(clap::Args, Clone, Debug)]
#[command(mut_arg("seed", |a| a.hide(true)))]
#[command(mut_arg("unit", |a| a.hide(true)))]
pub struct Args {
    /// The height field: .asc, .tif, .png, .npy or .npz, or .obj or .ply with vertices on a regular grid of x and y.
    #[arg(value_name = "GRID")]
    grid: PathBuf,
    /// Folder for the results (created if missing).
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What is computed, separated by commas.
    #[arg(
        long = "output",
        value_name = "WHAT",
        value_parser = one_of(QUANTITIES),
        value_delimiter = ',',
        default_value = "sky-view-factor"
    )]
    outputs: Vec<Quantity>,
    /// Kinds of files, separated by commas.
    #[arg(long, value_name = "KIND", value_parser = one_of(FORMATS), value_delimiter = ',', default_value = "tif")]
    format: Vec<Format>,
    /// Directions in which the horizon is found, 4 to 1024.
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(4..=1024))]
    azimuths: usize,
    /// The earth curves: with N times its radius; 7/6 = 1.1667 allows for refraction.
    #[arg(long, value_name = "N", num_args = 0..=1, require_equals = true, default_missing_value = "1")]
    curvature: Option<f64>,
    #[command(flatten)]
    samples: GridArgs,
    #[command(flatten)]
    light: SkyArgs,
    /// Sum of irradiance over the day of --time, in Wh/m2 (J/m2 divided by 3600), in steps of MINUTES; with --sky clear:TURBIDITY the
    /// light changes with it.
    #[arg(long, value_name = "MINUTES", num_args = 0..=1, require_equals = true, default_missing_value = "30",
          value_parser = clap::value_parser!(u32).range(1..=240))]
    day: Option<u32>,
    #[command(flatten)]
    pub common: Common,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Quantity {
    SkyViewFactor,
    Horizon,
    Sunlit,
    Irradiance,
}

const QUANTITIES: Values<Quantity> = &[
    (
        "sky-view-factor",
        "Irradiance of the sloping sample under a uniform sky as part of that of a level plane without horizon",
        Quantity::SkyViewFactor,
    ),
    ("horizon", "Elevation of the horizon, degrees: a band for each azimuth", Quantity::Horizon),
    ("sunlit", "Part of the sun's disc that is seen, 0 to 1", Quantity::Sunlit),
    ("irradiance", "Irradiance of sky and sun, W/m2; with --day Wh/m2", Quantity::Irradiance),
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Tif,
    Npz,
    Png,
}

/// Formats by their extensions.
const FORMATS: Values<Format> = &[
    ("tif", "GeoTIFF, georeferenced as the input", Format::Tif),
    ("npz", "NumPy arrays", Format::Npz),
    ("png", "A picture with a colour scale, of the horizon one for each azimuth", Format::Png),
];

impl Quantity {
    fn name(self) -> &'static str {
        name_of(QUANTITIES, self)
    }

    /// The files of this quantity in a format: pictures show one azimuth each.
    fn files(self, format: Format, azimuths: usize) -> Vec<String> {
        let (name, extension) = (self.name(), name_of(FORMATS, format));
        match (self, format) {
            (Quantity::Horizon, Format::Png) => {
                let degrees = |k: usize| 360.0 * k as f64 / azimuths as f64;
                (0..azimuths).map(|k| format!("{name}-{:05.1}.{extension}", degrees(k))).collect()
            }
            _ => vec![format!("{name}.{extension}")],
        }
    }
}

/// A computed quantity: its bands with their names.
type Bands = Vec<(String, Vec<f32>)>;

pub fn run(args: &Args) -> Result<ExitCode> {
    let common = &args.common;
    let _folder = check_folder(&args.out)?;
    common.check_json()?;
    check_light(args)?;
    let files = |q: &Quantity| {
        args.format.iter().flat_map(|format| q.files(*format, args.azimuths)).collect::<Vec<_>>()
    };
    let names = args.outputs.iter().flat_map(files);
    common.check_outputs(&Inputs::of([&args.grid]), Output::within("--out", &args.out, names))?;
    let options = args.samples.options()?;
    let sky = args.light.options()?;
    let note_of_day = note_of_day(args, &sky)?;
    let sweep = SweepOptions { earth_radius: args.curvature.map(|factor| factor * EARTH_RADIUS) };
    let start = Instant::now();
    let spinner = common.spinner("reading the height field");
    let kind = args.grid.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let mut loaded = match kind.as_str() {
        "obj" | "ply" => mesh_grid::read(&args.grid, &options)?,
        _ => read(&args.grid, &options)?,
    };
    drop(spinner);
    loaded.notes.extend(note_of_day);
    warn(common, &loaded.notes);
    let grid = &loaded.grid;
    let [dx, dy] = grid.cell();
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{} x {} samples every {dx} x {dy} m, read in {:.2} s",
        grouped(grid.columns()),
        grouped(grid.rows()),
        start.elapsed().as_secs_f64()
    );
    let mut records = Vec::new();
    for quantity in &args.outputs {
        let _spinner = common.spinner(format!("computing {}", quantity.name()));
        let start = Instant::now();
        let bands = common.on_threads(|| compute(args, *quantity, grid, &sky, &sweep))?;
        let seconds = start.elapsed().as_secs_f64();
        write(args, *quantity, grid, &bands)?;
        let record = summary(*quantity, unit(*quantity, args), &bands, seconds, &mut text);
        records.push(record);
    }
    let _ = writeln!(text, "wrote {}", args.out.display());
    common.print(&text)?;
    common.write_json(&json!({
        "grid": args.grid, "columns": grid.columns(), "rows": grid.rows(), "cell_m": grid.cell(),
        "holes": grid.holes(), "azimuths": args.azimuths, "quantities": records, "notes": with_flags(&loaded.notes),
    }))?;
    Ok(ExitCode::SUCCESS)
}

fn compute(
    args: &Args,
    quantity: Quantity,
    grid: &Grid,
    sky: &SkyOptions,
    sweep: &SweepOptions,
) -> Result<Bands> {
    let name = quantity.name().to_owned();
    Ok(match quantity {
        Quantity::SkyViewFactor => vec![(name, sky_view_factor(grid, args.azimuths, sweep)?)],
        Quantity::Horizon => {
            let found = horizon(grid, args.azimuths, sweep)?;
            let degrees = |mut values: Vec<f32>| {
                values.iter_mut().for_each(|v| *v = v.to_degrees());
                values
            };
            let named = |(azimuth, values): (f64, Vec<f32>)| {
                (format!("horizon at azimuth {:.1}", azimuth.to_degrees()), degrees(values))
            };
            found.azimuths.into_iter().zip(found.elevations).map(named).collect()
        }
        Quantity::Sunlit => {
            let environment = sky.with_any_sun().environment(DVec3::Z)?;
            let sun = suns_of(&environment).next().ok_or_else(|| {
                Error::arguments("`sunlit` needs a sun: give --sun, or --place and --time".into())
            })?;
            vec![(name, sunlit(grid, &sun.0, sweep)?)]
        }
        Quantity::Irradiance => vec![(name, light(args, grid, sweep, sky)?)],
    })
}

/// Refuses options of light that no output needs.
pub fn check_light(args: &Args) -> Result<()> {
    let Args { light, day, outputs, .. } = args;
    let needs = |q: &Quantity| matches!(q, Quantity::Sunlit | Quantity::Irradiance);
    let unused = if outputs.contains(&Quantity::Irradiance) {
        None
    } else if outputs.iter().any(needs) {
        day.map(|_| ("--day", "irradiance"))
    } else {
        let light = light.first_given().map(|name| (name, "sunlit or --output irradiance"));
        light.or(day.map(|_| ("--day", "irradiance")))
    };
    let what =
        |(name, outputs)| format!("{name} has no effect without --output {outputs}: add it, or omit {name}");
    unused.map_or(Ok(()), |unused| Err(Error::arguments(what(unused))))
}

/// What is assumed about the light of a day.
///
/// # Errors
/// As [`SkyOptions::at_minute`].
fn note_of_day(args: &Args, sky: &SkyOptions) -> Result<Option<String>> {
    let Some(minutes) = args.day.filter(|_| args.outputs.contains(&Quantity::Irradiance)) else {
        return Ok(None);
    };
    let mut computed = 0;
    for (minute, _) in intervals(minutes) {
        computed += usize::from(sky.at_minute(minute)?.is_some());
    }
    if computed == 0 {
        let what = "the sun is below the horizon at all times of this day that are computed: the irradiance is 0 (⟨day⟩ sets the minutes between)";
        return Ok(Some(what.into()));
    }
    let is_clear = matches!(sky.sky.0, SkyModel::Clear { .. });
    let what = "the sun moves, but the irradiances of sky and sun are the same at all times of the day; with --sky clear:TURBIDITY they change";
    Ok((!is_clear).then(|| what.into()))
}

/// The suns, by azimuths from the first row of the grid, and their normal irradiances, means of the channels.
fn suns_of(environment: &Environment) -> impl Iterator<Item = (Sun, f64)> + '_ {
    environment.suns().iter().map(|sun| {
        let DVec3 { x, y, z } = sun.direction;
        let (azimuth, elevation) = (x.atan2(y), z.clamp(-1.0, 1.0).asin());
        let half_angle = 0.5 * sun.diameter;
        (Sun { azimuth, elevation, half_angle }, sun.irradiance.iter().sum::<f64>() / 3.0)
    })
}

/// Minutes of a day.
const DAY: u32 = 24 * 60;

/// The middle and the length of each interval of a day, minutes; the last interval ends with the day.
fn intervals(minutes: u32) -> impl Iterator<Item = (u32, u32)> {
    (0..DAY).step_by(minutes as usize).map(move |start| {
        let length = minutes.min(DAY - start);
        (start + length / 2, length)
    })
}

/// Irradiance at the time of the options, or added up over its day.
fn light(args: &Args, grid: &Grid, sweep: &SweepOptions, sky: &SkyOptions) -> Result<Vec<f32>> {
    if args.light.sky.is_none() && args.light.sun.is_none() {
        return Err(Error::arguments("`irradiance` needs light: give --sky, --sun or both".into()));
    }
    let Some(minutes) = args.day else {
        return light_at(args, grid, sweep, sky);
    };
    let mut sums = vec![0.0f32; grid.heights().len()];
    for (minute, minutes) in intervals(minutes) {
        // Below the horizon there is neither sun nor sky.
        let Some(sky) = sky.at_minute(minute)? else { continue };
        let found = light_at(args, grid, sweep, &sky)?;
        let hours = minutes as f32 / 60.0;
        sums.iter_mut().zip(found).for_each(|(sum, e)| *sum += hours * e);
    }
    Ok(sums)
}

fn light_at(args: &Args, grid: &Grid, sweep: &SweepOptions, sky: &SkyOptions) -> Result<Vec<f32>> {
    let environment = sky.environment(DVec3::Z)?;
    let sky = |direction: DVec3| environment.radiance(direction).iter().sum::<f64>() / 3.0;
    let none = (Sun { azimuth: 0.0, elevation: -1.0, half_angle: 0.0 }, 0.0);
    let mut suns = suns_of(&environment);
    let (sun, direct_normal) = suns.next().unwrap_or(none);
    let mut sums = irradiance(grid, &Light { sun, direct_normal, sky: &sky }, args.azimuths, sweep)?;
    // Bright spots of a map.
    for (sun, direct_normal) in suns {
        let found = irradiance(grid, &Light { sun, direct_normal, sky: &|_| 0.0 }, args.azimuths, sweep)?;
        sums.iter_mut().zip(found).for_each(|(sum, e)| *sum += e);
    }
    Ok(sums)
}

fn write(args: &Args, quantity: Quantity, grid: &Grid, bands: &Bands) -> Result<()> {
    let layers: Vec<Layer> = bands.iter().map(|(name, values)| Layer { name, values }).collect();
    for format in &args.format {
        let files = quantity.files(*format, bands.len());
        let paths: Vec<PathBuf> = files.iter().map(|name| args.out.join(name)).collect();
        match format {
            Format::Tif => write_geotiff(&paths[0], grid, &layers)?,
            Format::Npz => write_npz(&paths[0], grid, &layers)?,
            Format::Png => {
                let range = range(quantity, bands);
                paths
                    .iter()
                    .zip(&layers)
                    .try_for_each(|(path, layer)| write_png(path, grid, *layer, range))?;
            }
        }
    }
    Ok(())
}

/// The values at the ends of the colour scale.
fn range(quantity: Quantity, bands: &Bands) -> [f32; 2] {
    let values = bands.iter().flat_map(|(_, values)| values).copied().filter(|v| v.is_finite());
    match quantity {
        Quantity::SkyViewFactor | Quantity::Sunlit => [0.0, 1.0],
        _ => [0.0, values.fold(f32::MIN_POSITIVE, f32::max)],
    }
}

/// The unit of a quantity in text.
fn unit(quantity: Quantity, args: &Args) -> &'static str {
    match quantity {
        Quantity::SkyViewFactor | Quantity::Sunlit => "",
        Quantity::Horizon => "\u{b0}",
        Quantity::Irradiance if args.day.is_some() => " Wh/m\u{b2}",
        Quantity::Irradiance => " W/m\u{b2}",
    }
}

/// Adds a line on a quantity; returns the same as JSON.
fn summary(quantity: Quantity, unit: &str, bands: &Bands, seconds: f64, text: &mut String) -> Value {
    let known = || bands.iter().flat_map(|(_, values)| values).copied().filter(|v| v.is_finite());
    let (mut sum, mut count) = (0.0f64, 0usize);
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for value in known() {
        (sum, count) = (sum + f64::from(value), count + 1);
        (low, high) = (low.min(value), high.max(value));
    }
    let mean = sum / count.max(1) as f64;
    let name = quantity.name();
    let [least, middle, most] = [low.into(), mean, high.into()].map(number);
    let _ = writeln!(
        text,
        "{name:<16} minimum {least}, mean {middle}, maximum {most}{unit}; computed in {seconds:.2} s"
    );
    json!({ "name": name, "bands": bands.len(), "min": low, "mean": mean, "max": high, "seconds": seconds })
}
