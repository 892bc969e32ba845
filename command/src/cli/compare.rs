//! `mrvis compare REF.csv TEST.csv`: difference of two irradiance files.

use super::args::Common;
use super::inputs::Inputs;
use mrvis::internals::plot::number;
use mrvis::internals::points::{Comparison, compare, read_irradiance};
use mrvis::{Error, Result};
use std::{path::PathBuf, process::ExitCode};

/// Compare irradiance at the same points: RMS relative to the mean, bias, percentiles. Exit code 1 above --tolerance.
#[derive(clap::Args, Debug)]
#[command(mut_args(|a| if ["seed", "unit", "threads", "max_memory"].contains(&a.get_id().as_str()) { a.hide(true) } else { a }))]
pub struct Args {
    /// The irradiance file of the reference.
    #[arg(value_name = "REF.csv")]
    reference: PathBuf,
    /// The irradiance file to be compared, with the same points in the same order.
    #[arg(value_name = "TEST.csv")]
    test: PathBuf,
    /// Largest accepted RMS difference relative to the mean (0.01 is one per cent).
    #[arg(long, value_name = "R")]
    tolerance: Option<f64>,
    #[command(flatten)]
    pub common: Common,
}

pub fn run(args: &Args) -> Result<ExitCode> {
    if let Some(t) = args.tolerance.filter(|t| !(t.is_finite() && *t >= 0.0)) {
        return Err(Error::arguments(format!("--tolerance {t}: must be a number not below 0")));
    }
    args.common.check_outputs(&Inputs::of([&args.reference, &args.test]), [])?;
    let found = compare(&read_irradiance(&args.reference)?, &read_irradiance(&args.test)?)?;
    args.common.write_json(&found)?;
    args.common.print(&text(&found))?;
    let missed = args.tolerance.is_some_and(|t| found.rms.is_nan() || found.rms > t);
    Ok(if missed { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

fn text(c: &Comparison) -> String {
    let percent = |x: f64| format!("{} %", number(100.0 * x));
    let shares: Vec<String> = Comparison::SHARES
        .iter()
        .zip(c.percentiles)
        .map(|(share, p)| format!("{share} % within {}", percent(p)))
        .collect();
    let [r, g, b] = c.rms_by_channel.map(percent);
    format!(
        "{} points, mean of the reference {} W/m\u{b2}; relative to it:\n\
         RMS {} (red {r}, green {g}, blue {b}), of which the reference's noise {}\n\
         bias {}\n{}\n",
        c.points,
        number(c.mean),
        percent(c.rms),
        percent(c.reference_noise),
        percent(c.bias),
        shares.join(", "),
    )
}
