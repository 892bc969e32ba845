//! `mrvis generate NAME --out FILE`: procedural scenes.

use super::args::{Common, file_name, grouped};
use crate::{
    Error, Result,
    scene::{
        generate::{KINDS, Spec, soup},
        mtl_path, write_obj,
    },
};
use std::{fmt::Write, path::PathBuf, process::ExitCode};

#[derive(clap::Args, Debug)]
pub struct Args {
    /// What to generate (see --list).
    #[arg(value_name = "NAME", required_unless_present = "list")]
    name: Option<String>,
    /// The OBJ file to write; its materials go to an .mtl file beside it.
    #[arg(long, value_name = "FILE", required_unless_present = "list")]
    out: Option<PathBuf>,
    /// List what can be generated.
    #[arg(long)]
    list: bool,
    /// How many cubes, slats, courses of bricks, boards.
    #[arg(long, value_name = "N")]
    count: Option<usize>,
    /// Trees of the forest.
    #[arg(long, value_name = "N", default_value_t = 100)]
    trees: usize,
    /// Leaves of each tree.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    leaves: usize,
    /// Give the trees trunks.
    #[arg(long)]
    trunks: bool,
    /// Edge length of the light in scene units.
    #[arg(long, value_name = "L")]
    light_size: Option<f64>,
    #[command(flatten)]
    common: Common,
}

pub fn run(args: &Args) -> Result<ExitCode> {
    let (name, out) = match (&args.name, &args.out) {
        (Some(name), Some(out)) if !args.list => (name, out),
        _ => {
            super::print(&list())?;
            return Ok(ExitCode::SUCCESS);
        }
    };
    let spec = Spec {
        seed: args.common.seed,
        count: args.count,
        trees: args.trees,
        leaves: args.leaves,
        trunks: args.trunks,
        light_size: args.light_size,
        ..Spec::new(name)
    };
    let kind = spec.kind()?;
    if out.extension().is_none_or(|e| !e.eq_ignore_ascii_case("obj")) {
        return Err(Error::Argument(format!("--out {}: must end in .obj", out.display())));
    }
    let spinner = args.common.spinner(format!("generating {}", kind.name));
    let soup = soup(&spec)?;
    write_obj(
        out,
        &soup,
        &[&format!("mrvis {} generate {}: {}", env!("CARGO_PKG_VERSION"), kind.name, kind.about)],
    )?;
    drop(spinner);
    args.common.write_json(&serde_json::json!({
        "mrvis": env!("CARGO_PKG_VERSION"),
        "path": out,
        "unit": kind.unit,
        "polygons": soup.polygons(),
        "objects": soup.objects.len(),
        "seed": spec.seed,
    }))?;
    let unit = if kind.unit == "m" { String::new() } else { format!("; read it with --unit {}", kind.unit) };
    args.common.print(&format!(
        "{} and {}: {} polygons, {} objects{unit}\n",
        out.display(),
        file_name(&mtl_path(out)),
        grouped(soup.polygons()),
        grouped(soup.objects.len()),
    ))?;
    Ok(ExitCode::SUCCESS)
}

fn list() -> String {
    let mut text = String::new();
    for kind in KINDS {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{:12} {}", kind.name, kind.about);
    }
    text
}
