//! `mrvis reference SCENE --points FILE`: irradiance by path tracing.

use super::args::{Common, SceneArgs, counted, file_name, warn};
use super::flags::with_flags;
use super::inputs::{Inputs, Output, check_file};
use super::job_context;
use super::mpi::MpiArgs;
use super::progress::Bar;
use super::values::lower;
use mrvis::internals::path_tracer::{Settings, irradiance};
use mrvis::internals::plot::number;
use mrvis::internals::points::{Irradiance, Point, read_points, write_irradiance};
use mrvis::{Model, Result};
use std::{path::PathBuf, process::ExitCode, time::Instant};

/// Irradiance at points by path tracing, with standard errors: independent values for comparison with solutions.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Points on surfaces: CSV with the header x,y,z,nx,ny,nz; scene units, unit normals.
    #[arg(long, value_name = "FILE")]
    pub points: PathBuf,
    /// Paths per point, at least 2.
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(2..))]
    pub samples: u32,
    /// Direct light from emitters only, without reflections.
    #[arg(long)]
    direct_only: bool,
    /// File for the irradiance: columns of the points, then Er,Eg,Eb, Er_se,Eg_se,Eb_se (standard errors).
    #[arg(long, value_name = "FILE", default_value = "irradiance.csv")]
    out: PathBuf,
    #[command(flatten)]
    pub mpi: MpiArgs,
    #[command(flatten)]
    pub common: Common,
}

pub fn run(args: &Args) -> Result<ExitCode> {
    let common = &args.common;
    args.mpi.on_first(|| check_file(&args.out))?;
    common.check_json()?;
    let mut points = read_points(&args.points)?;
    let scene = args.scene.with_light()?.load(common)?;
    lower(&scene, &mut points);
    let inputs = Inputs::of(scene.parts().files.iter().chain([&args.points]));
    common.check_outputs(&inputs, [Output::new("--out", &args.out)])?;
    warn(common, &scene.parts().repairs.messages);
    if scene.parts().emitters.is_empty() && scene.parts().sky.is_none() {
        warn(common, &["the scene has no light: all irradiance is zero (see --emitter NAME=W)".into()]);
    }
    let settings = Settings { samples: args.samples, direct_only: args.direct_only, seed: common.seed };
    let bar = Bar::new(common.quiet);
    let start = Instant::now();
    let (model, found) = common.on_threads(|| {
        let model = job_context::prepare_rays(scene, &bar)?.on_ranks(args.mpi.ranks());
        let found = irradiance(&model, &points, settings, &bar)?;
        Ok((model, found))
    })?;
    let scene = model.scene();
    let seconds = start.elapsed().as_secs_f64();
    drop(bar);
    if !args.mpi.is_first() {
        return Ok(ExitCode::SUCCESS);
    }
    let photometry = args.scene.photometry();
    let lux = |rgb| photometry.unwrap_or_default().of(rgb);
    write_irradiance(&args.out, &found, photometry.map(|_| &lux as _))?;
    let (mean, noise) = (mean(&found), noise(&found));
    let mut warnings = scene.parts().repairs.messages.clone();
    let notes = notes(&model, &points, mean > 0.0);
    warn(common, &notes);
    warnings.extend(notes);
    let mut json = serde_json::json!({
        "mrvis": env!("CARGO_PKG_VERSION"),
        "scene": args.scene.scene,
        "unit": scene.parts().unit,
        "triangles": scene.parts().triangles.len(),
        "emitters": scene.parts().emitters.len(),
        "points": points.len(),
        "samples": args.samples,
        "direct_only": args.direct_only,
        "seed": common.seed,
        "seconds": seconds,
        "mean": mean,
        "noise": noise,
        "warnings": with_flags(&warnings),
    });
    let luminous = photometry
        .map(|p| (p, found.values.iter().map(|v| p.of(*v)).sum::<f64>() / points.len().max(1) as f64));
    if let Some((photometry, lx)) = luminous {
        json["photometric"] = serde_json::json!({
            "weights": photometry.weights, "lumens_per_watt": photometry.lumens_per_watt, "mean_illuminance_lx": lx,
        });
    }
    args.mpi.add_sharing(&mut json);
    common.write_json(&json)?;
    common.print(&format!(
        "{}: {}, {} paths each, {} s; mean irradiance {} W/m\u{b2}, RMS standard error {} % of it\n{}",
        file_name(&args.out),
        counted(points.len(), "point"),
        args.samples,
        number(seconds),
        number(mean),
        number(100.0 * noise),
        luminous.map_or(String::new(), |(_, lx)| format!("mean illuminance {} lx\n", number(lx))),
    ))?;
    Ok(ExitCode::SUCCESS)
}

/// Notes on the model for these points.
fn notes(model: &Model, points: &[Point], is_lit: bool) -> Vec<String> {
    let mut notes = model.notes_of_lost_light();
    if !is_lit && notes.is_empty() {
        let why = "the points lie behind surfaces, or their normals point away from the light";
        notes.push(format!("no light arrives at any point: {why}"));
    }
    notes.extend(model.notes_of_coarseness());
    let origin = model.scene().parts().origin;
    let local = |p: &Point| ((p.position - origin).as_vec3(), p.normal.as_vec3());
    notes.extend(model.notes_of_points(&points.iter().map(local).collect::<Vec<_>>()));
    notes
}

/// Mean over points and channels.
fn mean(e: &Irradiance) -> f64 {
    e.values.iter().flatten().sum::<f64>() / (3 * e.values.len()).max(1) as f64
}

/// Root mean square of the standard errors relative to the mean; 0 without light.
fn noise(e: &Irradiance) -> f64 {
    let count = (3 * e.standard_errors.len()).max(1) as f64;
    let rms = (e.standard_errors.iter().flatten().map(|s| s * s).sum::<f64>() / count).sqrt();
    if rms == 0.0 { 0.0 } else { rms / mean(e) }
}
