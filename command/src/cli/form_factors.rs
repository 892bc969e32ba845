//! `mrvis form-factors SCENE --out FILE`: the matrix of obstructed form factors.

use super::args::{Common, SceneArgs, file_name, grouped, warn};
use super::flags::with_flags;
use super::inputs::{Inputs, Output, check_file};
use super::job_context;
use super::limits::{self, GIB};
use super::mpi::MpiArgs;
use super::progress::Bar;
use super::values::{Values, name_of, one_of, set_fields, tolerance};
use mrvis::internals::form_factors::{
    Facets, Format, Grouping, Report, Settings, by_groups, compute, memory_bound, write,
};
use mrvis::internals::plot::number;
use mrvis::{Error, FormFactorOptions, FormFactors, Result};
use std::{fmt::Write as _, path::PathBuf, process::ExitCode, time::Instant};

/// Form factors between polygons, objects or materials, with visibility.
///
/// F(from, to) is the fraction of the light from the front of `from` that arrives at the front of `to`. Row sums,
/// escaped light and light lost on back sides are reported; A F is symmetric by construction.
#[derive(clap::Args, Debug)]
#[command(mut_args(|a| if ["photometric", "sky", "sun", "place", "time"].contains(&a.get_id().as_str()) { a.hide(true) } else { a }))]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// The matrix: .npz (scipy.sparse.load_npz), .csv (from,to,factor) or .mtx (Matrix Market).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Rows and columns: polygons of the file, objects (and groups), or materials.
    #[arg(long, value_name = "WHAT", value_parser = one_of(ROWS), default_value = name_of(ROWS, FormFactorOptions::default().grouping))]
    by: Grouping,
    /// Rays per polygon that search for visible polygons; the rays per pair are proportional [default: 2048, more for few polygons]
    #[arg(long, value_name = "N")]
    rays: Option<u32>,
    /// Largest number of rays between two polygons that are partly hidden from each other [default: 256, more for few polygons]
    #[arg(long, value_name = "N")]
    pair_rays: Option<u32>,
    /// Adjustment of the matrix: `closure` makes rows without escape sum to 1, each entry according to its
    /// uncertainty, and keeps A F symmetric; `none` leaves the estimates unchanged.
    #[arg(long, value_name = "WHAT", value_parser = one_of(ENFORCE), default_value = "closure", num_args = 0..=1,
          default_missing_value = "closure", require_equals = true)]
    enforce: bool,
    /// Largest accepted mean |row sum + escaped + lost - 1| of closed rows (exit code 1 above).
    #[arg(long, value_name = "R", value_parser = tolerance)]
    tolerance: Option<f64>,
    #[command(flatten)]
    pub mpi: MpiArgs,
    #[command(flatten)]
    pub common: Common,
}

const ROWS: Values<Grouping> = &[
    ("face", "", Grouping::Polygon),
    ("object", "", Grouping::Object),
    ("material", "", Grouping::Material),
];

const ENFORCE: Values<bool> = &[("closure", "", true), ("none", "", false)];

impl Args {
    /// The format of the matrix; options are checked.
    ///
    /// # Errors
    /// The extension of the file is that of no format, or an option is out of its range.
    pub fn format(&self) -> Result<Format> {
        let mut options = FormFactorOptions::default();
        set_fields!(options = self: rays, pair_rays);
        options.check_ranges()?;
        Format::of(&self.out)
    }

    /// Settings of the command for this number of facets.
    fn settings(&self, facets: usize) -> Settings {
        let settings = Settings { enforce: self.enforce, seed: self.common.seed, ..Settings::new(facets) };
        settings.with_rays(self.rays, self.pair_rays)
    }

    /// Largest memory of the matrix of this number of facets, bytes.
    pub fn matrix_bytes(&self, facets: usize) -> u64 {
        memory_bound(facets, &self.settings(facets))
    }
}

pub fn run(args: &Args) -> Result<ExitCode> {
    let common = &args.common;
    args.scene.without_light()?;
    args.scene.without_sky()?;
    let format = args.format()?;
    args.mpi.on_first(|| check_file(&args.out))?;
    common.check_json()?;
    let scene = args.scene.load_flat(common)?;
    let inputs = Inputs::of(scene.parts().files);
    common.check_outputs(&inputs, [Output::new("--out", &args.out)])?;
    warn(common, &scene.parts().repairs.messages);
    let facets = Facets::new_unless(&scene, &())?;
    let settings = args.settings(facets.count());
    let bound = memory_bound(facets.count(), &settings);
    if limits::bytes(common.max_memory).is_some_and(|limit| bound > limit) {
        return Err(Error::arguments(format!(
            "the matrix of {} facets could take {}: raise --max-memory{}",
            grouped(facets.count()),
            size(bound),
            // If every pair is computed, the memory does not depend on rays.
            if settings.every { String::new() } else { format!(" or lower --rays (now {})", settings.rays) }
        )));
    }
    let count = grouped(facets.count());
    common.print(&format!("{count} facets, at most {} for their matrix\n", size(bound)))?;
    let bar = Bar::new(common.quiet);
    let start = Instant::now();
    let (model, (faces, report)) = common.on_threads(|| {
        let model = job_context::prepare_rays(scene, &bar)?.on_ranks(args.mpi.ranks());
        let found = compute(&model, &facets, &settings, &bar)?;
        Ok((model, found))
    })?;
    let scene = model.scene();
    let seconds = start.elapsed().as_secs_f64();
    drop(bar);
    if !args.mpi.is_first() {
        return Ok(ExitCode::SUCCESS);
    }
    let matrix = by_groups(faces, scene, &facets, args.by, &())?;
    let spinner = common.spinner(format!("writing {}", file_name(&args.out)));
    let labels = (args.by == Grouping::Polygon).then(|| facets.labels(scene));
    write(&args.out, &matrix, format, labels.as_ref())?;
    drop(spinner);
    let mut json = serde_json::json!({
        "mrvis": env!("CARGO_PKG_VERSION"),
        "scene": args.scene.scene,
        "unit": scene.parts().unit,
        "seconds": seconds,
        "memory_bound": bound,
        "rows": matrix.areas.len(),
        "entries": matrix.columns.len(),
        "settings": {
            "rays": settings.rays, "bundle": settings.bundle, "largest_bundle": settings.largest_bundle,
            "every": settings.every, "enforce": settings.enforce, "seed": settings.seed,
        },
        "report": report,
        "warnings": with_flags(&scene.parts().repairs.messages),
    });
    args.mpi.add_sharing(&mut json);
    common.write_json(&json)?;
    common.print(&text(args, &matrix, &report, seconds))?;
    let missed = args.tolerance.is_some_and(|t| report.closed_row_sum_error > t);
    Ok(if missed { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

fn size(bytes: u64) -> String {
    let (bytes, mib) = (bytes as f64, GIB / 1024.0);
    if bytes < GIB { format!("{:.0} MiB", (bytes / mib).ceil()) } else { format!("{:.2} GiB", bytes / GIB) }
}

fn text(args: &Args, matrix: &FormFactors, r: &Report, seconds: f64) -> String {
    let Report { row_sum_error, worst_row_sum_error, row_standard_error, .. } = r;
    let Report { closed_row_sum_error, row_sums: [low, high], reciprocity_residual, .. } = r;
    let (file, seconds) = (file_name(&args.out), number(seconds));
    let [rows, entries, rays] = [matrix.areas.len(), matrix.columns.len(), r.rays as usize].map(grouped);
    let mut out = format!("{file}: {rows} rows, {entries} entries; {seconds} s, {rays} rays\n");
    let before = if r.closure_steps > 0 { " (before closure)" } else { "" };
    let percent = |part: f64| format!("{} %", number(100.0 * part));
    let [off, worst, noise] = [*row_sum_error, *worst_row_sum_error, *row_standard_error].map(percent);
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "light that a facet sends to others, out of the scene and to back sides adds up to 100 % within {off} in the mean, {worst} at \
         most{before}; standard error {noise}"
    );
    if r.closed_rows > 0 {
        let [closed, of] = [r.closed_rows, r.facets].map(grouped);
        let off = percent(*closed_row_sum_error);
        let _ = writeln!(
            out,
            "{closed} of {of} facets lose no light: their rows sum to 1 with a mean error of {off}"
        );
    }
    let (off, residual) =
        (percent((1.0 - low).abs().max((high - 1.0).abs())), percent(*reciprocity_residual));
    let _ = writeln!(
        out,
        "sums of rows differ from 1 by up to {off}; A_i F_ij and A_j F_ji differ by {residual} in the mean"
    );
    let _ = writeln!(
        out,
        "of all light {} leaves the scene, {} falls on back sides",
        percent(r.escaped),
        percent(r.lost)
    );
    for (facet, why) in &r.bad {
        let _ = writeln!(out, "  facet {facet} {why}");
    }
    if r.bad_facets > r.bad.len() {
        let _ = writeln!(out, "  and {} more", r.bad_facets - r.bad.len());
    }
    out
}
