//! `mrvis compare REF.csv TEST.csv`: difference of two irradiance files.

use super::args::{Common, counted};
use super::inputs::Inputs;
use super::values::tolerance;
use mrvis::Result;
use mrvis::internals::plot::number;
use mrvis::internals::points::{Comparison, compare, read_irradiance};
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
    #[arg(long, value_name = "R", value_parser = tolerance)]
    tolerance: Option<f64>,
    #[command(flatten)]
    pub common: Common,
}

pub fn run(args: &Args) -> Result<ExitCode> {
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
        "{}, mean of the reference {} W/m\u{b2}; relative to it:\n\
         RMS {} (red {r}, green {g}, blue {b}){}\n\
         bias {}\n{}\n",
        counted(c.points, "point"),
        number(c.mean),
        percent(c.rms),
        noise(c),
        percent(c.bias),
        shares.join(", "),
    )
}

/// What the noise of the reference means for the RMS; nothing if it is unknown.
fn noise(c: &Comparison) -> String {
    let Comparison { rms, reference_noise, .. } = *c;
    let noise = number(100.0 * reference_noise);
    match rms * rms - reference_noise * reference_noise {
        _ if reference_noise == 0.0 => String::new(),
        rest if rest > 0.0 => {
            format!(", {} % without the reference's noise of {noise} %", number(100.0 * rest.sqrt()))
        }
        _ => format!(": no difference is found, as the reference's noise is {noise} %"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_below_the_noise_is_none() {
        let words = |rms, reference_noise| {
            let (percentiles, rms_by_channel) = ([0.0; 4], [rms; 3]);
            noise(&Comparison {
                points: 2,
                mean: 1.0,
                rms,
                reference_noise,
                bias: 0.0,
                percentiles,
                rms_by_channel,
            })
        };
        assert_eq!(words(0.021, 0.032), ": no difference is found, as the reference's noise is 3.2 %");
        assert_eq!(words(0.05, 0.03), ", 4 % without the reference's noise of 3 %");
        assert_eq!(words(0.05, 0.0), "");
    }
}
