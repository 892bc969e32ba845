//! `mrvis solve --scaling`: growth of time with the size of the scene.

use super::super::args::{Common, grouped};
use super::super::progress::Bar;
use super::watch::Watch;
use mrvis::internals::bench::solve_scaling::{LARGEST, solve_scaling};
use mrvis::internals::radiosity::Options;
use mrvis::{Error, Result};
use std::fmt::Write as _;
use std::process::ExitCode;

/// Solves a series of growing scenes; prints a table of times and the exponent of their growth.
pub fn scaling(common: &Common, options: &Options, largest: usize) -> Result<ExitCode> {
    if !LARGEST.contains(&largest) {
        let (min, max) = (LARGEST.start(), LARGEST.end());
        return Err(Error::Argument(format!("--scaling={largest}: must lie in {min}..{max} triangles")));
    }
    common.check_json()?;
    let watch = Watch { bar: Bar::new(common.quiet) };
    let found = solve_scaling(options, largest, &watch)?;
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
         all of them (rays of the local pass) counts min",
        found.slope, found.slope_last
    );
    common.print(&text)?;
    Ok(ExitCode::SUCCESS)
}
