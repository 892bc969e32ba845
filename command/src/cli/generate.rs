//! `mrvis generate NAME --out FILE`: procedural scenes.

use super::args::{Common, file_name, grouped};
use super::inputs::{Inputs, Output};
use mrvis::internals::scene::generate::{KINDS, Kind, Spec, placed, soup};
use mrvis::internals::scene::{mtl_path, write_gltf, write_obj};
use mrvis::internals::terrain::{Layer, mountains, write_geotiff};
use mrvis::{Error, Result};
use std::{
    fmt::Write,
    path::{Path, PathBuf},
    process::ExitCode,
};

/// Name of the height field, which is no scene of polygons.
const TERRAIN: &str = "terrain";
/// Its samples along a side, unless --count is given.
const TERRAIN_SIDE: usize = 400;

#[derive(clap::Args, Debug)]
pub struct Args {
    /// Name of the scene (see --list).
    #[arg(value_name = "NAME", required_unless_present = "list")]
    name: Option<String>,
    /// The .obj file (its materials go to an .mtl file beside it); with --instances a .gltf or .glb file, for terrain a .tif file.
    #[arg(long, value_name = "FILE", required_unless_present = "list")]
    out: Option<PathBuf>,
    /// List all scenes.
    #[arg(long)]
    list: bool,
    /// Number of cubes, slats, courses of bricks, boards, facets (of urban-block), samples along a side (of terrain).
    #[arg(long, value_name = "N")]
    count: Option<usize>,
    /// Number of trees of the forest.
    #[arg(long, value_name = "N", default_value_t = 100)]
    trees: usize,
    /// Leaves per tree.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    leaves: usize,
    /// Add trunks to the trees.
    #[arg(long)]
    trunks: bool,
    /// Write a forest of instances, one tree mesh per species and one node per tree, as .gltf or .glb.
    #[arg(long)]
    instances: bool,
    /// Number of species in a forest of instances.
    #[arg(long, value_name = "N", default_value_t = 1, requires = "instances")]
    species: usize,
    /// Edge length of the emitter in scene units.
    #[arg(long, value_name = "L")]
    light_size: Option<f64>,
    #[command(flatten)]
    pub common: Common,
}

impl Args {
    /// Refuses a file of another format than the command writes.
    ///
    /// # Errors
    /// [`Error::Argument`] with the extensions that are right.
    pub fn check_extension(&self) -> Result<()> {
        let Some(out) = &self.out else { return Ok(()) };
        let (right, what) = if self.is_terrain() {
            (has_extension(out, &["tif", "tiff"]), ".tif")
        } else if self.instances {
            (has_extension(out, &["gltf", "glb"]), ".gltf or .glb, because only these hold instances")
        } else {
            (has_extension(out, &["obj"]), ".obj")
        };
        let message = || Error::arguments(format!("--out {}: must end in {what}", out.display()));
        if right { Ok(()) } else { Err(message()) }
    }

    fn is_terrain(&self) -> bool {
        self.name.as_deref() == Some(TERRAIN)
    }
}

pub fn run(args: &Args) -> Result<ExitCode> {
    args.check_extension()?;
    let (name, out) = match (&args.name, &args.out) {
        (Some(name), Some(out)) if !args.list => (name, out),
        _ => {
            super::print(&list())?;
            return Ok(ExitCode::SUCCESS);
        }
    };
    if args.is_terrain() {
        return terrain(args, out);
    }
    let spec = Spec {
        seed: args.common.seed,
        count: args.count,
        trees: args.trees,
        leaves: args.leaves,
        trunks: args.trunks,
        instances: args.instances,
        species: args.species,
        light_size: args.light_size,
        ..Spec::new(name)
    };
    let kind = spec.kind()?;
    if args.instances { with_instances(args, &spec, kind, out) } else { flat(args, &spec, kind, out) }
}

/// Writes a height field.
fn terrain(args: &Args, out: &Path) -> Result<ExitCode> {
    args.common.check_outputs(&Inputs::default(), [Output::new("--out", out)])?;
    let spinner = args.common.spinner("generating terrain");
    let grid = mountains(args.count.unwrap_or(TERRAIN_SIDE), args.common.seed)?;
    write_geotiff(out, &grid, &[Layer { name: "height", values: grid.heights() }])?;
    drop(spinner);
    let [columns, rows] = [grid.columns(), grid.rows()];
    args.common.write_json(&serde_json::json!({
        "mrvis": env!("CARGO_PKG_VERSION"),
        "path": out,
        "unit": "m",
        "columns": columns,
        "rows": rows,
        "cell": grid.cell(),
        "seed": args.common.seed,
    }))?;
    let [cell, _] = grid.cell();
    args.common.print(&format!(
        "{}: {} x {} samples, {cell} m apart\n",
        out.display(),
        grouped(columns),
        grouped(rows)
    ))?;
    Ok(ExitCode::SUCCESS)
}

/// Writes an OBJ file.
fn flat(args: &Args, spec: &Spec, kind: &Kind, out: &Path) -> Result<ExitCode> {
    let files = [out.to_owned(), mtl_path(out)].map(|path| Output::new("--out", path));
    args.common.check_outputs(&Inputs::default(), files)?;
    let spinner = args.common.spinner(format!("generating {}", kind.name));
    let soup = soup(spec)?;
    write_obj(out, &soup, &[&format!("{}: {}", origin(kind), kind.about)])?;
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

/// Writes a glTF file with shared meshes.
fn with_instances(args: &Args, spec: &Spec, kind: &Kind, out: &Path) -> Result<ExitCode> {
    args.common.check_outputs(&Inputs::default(), [Output::new("--out", out)])?;
    let spinner = args.common.spinner(format!("generating {}", kind.name));
    let placed = placed(spec)?.with_y_up();
    write_gltf(out, &placed, &origin(kind))?;
    drop(spinner);
    let own = placed.soup.polygons();
    let stored = own + placed.meshes.iter().map(|m| m.polygons()).sum::<usize>();
    let visible = placed.placements.iter().map(|p| placed.meshes[p.mesh as usize].polygons() as u64);
    let visible = visible.fold(own as u64, |sum, n| sum + n);
    args.common.write_json(&serde_json::json!({
        "mrvis": env!("CARGO_PKG_VERSION"),
        "path": out,
        "unit": kind.unit,
        "polygons": stored,
        "objects": placed.soup.objects.len(),
        "species": placed.meshes.len(),
        "instances": placed.placements.len(),
        "visible_polygons": visible,
        "seed": spec.seed,
    }))?;
    args.common.print(&format!(
        "{}: {} polygons stored, {} visible, {} objects, {} instances of {} meshes\n",
        out.display(),
        grouped(stored),
        grouped(visible as usize),
        grouped(placed.soup.objects.len()),
        grouped(placed.placements.len()),
        grouped(placed.meshes.len()),
    ))?;
    Ok(ExitCode::SUCCESS)
}

fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    path.extension().is_some_and(|e| extensions.iter().any(|x| e.eq_ignore_ascii_case(x)))
}

/// Origin of the scene, for the header of the file.
fn origin(kind: &Kind) -> String {
    format!("mrvis {} generate {}", env!("CARGO_PKG_VERSION"), kind.name)
}

fn list() -> String {
    let mut text = String::new();
    for kind in KINDS {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{:12} {}", kind.name, kind.about);
    }
    let about = "mountains and valleys, a height field for `terrain` and, under a sky, for `solve` (count of samples along a side";
    let _ = writeln!(text, "{TERRAIN:12} {about}: {TERRAIN_SIDE})");
    text
}
