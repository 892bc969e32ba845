//! `mrvis generate NAME --out FILE`: procedural scenes.

use super::args::{Common, file_name, grouped};
use super::inputs::{Inputs, Output};
use super::values::set_fields;
use mrvis::internals::scene::generate::{KINDS, Kind, Spec, placed, soup};
use mrvis::internals::scene::{mtl_path, write_gltf, write_obj};
use mrvis::internals::terrain::{Layer, mountains, write_geotiff};
use mrvis::{Error, Result};
use serde_json::{Value, json};
use std::{
    fmt::Write,
    path::{Path, PathBuf},
    process::ExitCode,
};

/// Name of the height field, which is no scene of polygons.
const TERRAIN: &str = "terrain";
/// Its samples along a side, unless --count is given. Its 318,402 triangles all exchange light, as up to 2¹⁹ do, and `mrvis solve --sky
/// clear:3 --sun 135,40` of the file takes 8 s of processor time, with 800 samples 20 s.
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
    #[arg(long, value_name = "N", default_value_t = Spec::default().trees)]
    trees: usize,
    /// Leaves per tree.
    #[arg(long, value_name = "N", default_value_t = Spec::default().leaves)]
    leaves: usize,
    /// Add trunks to the trees.
    #[arg(long)]
    trunks: bool,
    /// Write a forest of instances, one tree mesh per species and one node per tree, as .gltf or .glb.
    #[arg(long)]
    instances: bool,
    /// Number of species in a forest of instances.
    #[arg(long, value_name = "N", default_value_t = Spec::default().species, requires = "instances")]
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
    let common = &args.common;
    let mut spec = Spec { seed: common.seed, ..Spec::new(name) };
    set_fields!(spec = args: count, trees, leaves, trunks, instances, species, light_size);
    // A height field is no scene of polygons.
    let kind = if args.is_terrain() { None } else { Some(spec.kind()?) };
    let materials = (kind.is_some() && !args.instances).then(|| mtl_path(out));
    let files = std::iter::once(out.to_owned()).chain(materials).map(|path| Output::new("--out", path));
    common.check_outputs(&Inputs::default(), files)?;
    let spinner = common.spinner(format!("generating {name}"));
    let (mut json, text) = match kind {
        None => terrain(args, out)?,
        Some(kind) if args.instances => with_instances(&spec, kind, out)?,
        Some(kind) => flat(&spec, kind, out)?,
    };
    drop(spinner);
    (json["mrvis"], json["path"]) = (env!("CARGO_PKG_VERSION").into(), json!(out));
    json["seed"] = common.seed.into();
    common.write_json(&json)?;
    common.print(&format!("{}{text}\n", out.display()))?;
    Ok(ExitCode::SUCCESS)
}

/// Writes a height field; returns facts for the JSON, and the text after the name of the file.
fn terrain(args: &Args, out: &Path) -> Result<(Value, String)> {
    let grid = mountains(args.count.unwrap_or(TERRAIN_SIDE), args.common.seed)?;
    write_geotiff(out, &grid, &[Layer { name: "height", values: grid.heights() }])?;
    let ([columns, rows], [cell, _]) = ([grid.columns(), grid.rows()], grid.cell());
    let json = json!({ "unit": "m", "columns": columns, "rows": rows, "cell": grid.cell() });
    Ok((json, format!(": {} x {} samples, {cell} m apart", grouped(columns), grouped(rows))))
}

/// Writes an OBJ file; returns as [`terrain`].
fn flat(spec: &Spec, kind: &Kind, out: &Path) -> Result<(Value, String)> {
    let soup = soup(spec)?;
    write_obj(out, &soup, &[&format!("{}: {}", origin(kind), kind.about)])?;
    let (polygons, objects) = (soup.polygons(), soup.objects.len());
    let unit = if kind.unit == "m" { String::new() } else { format!("; read it with --unit {}", kind.unit) };
    let (materials, [p, o]) = (file_name(&mtl_path(out)), [polygons, objects].map(grouped));
    let json = json!({ "unit": kind.unit, "polygons": polygons, "objects": objects });
    Ok((json, format!(" and {materials}: {p} polygons, {o} objects{unit}")))
}

/// Writes a glTF file with shared meshes; returns as [`terrain`].
fn with_instances(spec: &Spec, kind: &Kind, out: &Path) -> Result<(Value, String)> {
    let placed = placed(spec)?.with_y_up();
    write_gltf(out, &placed, &origin(kind))?;
    let own = placed.soup.polygons();
    let stored = own + placed.meshes.iter().map(|m| m.polygons()).sum::<usize>();
    let visible = placed.placements.iter().map(|p| placed.meshes[p.mesh as usize].polygons() as u64);
    let visible = visible.fold(own as u64, |sum, n| sum + n);
    let (objects, species) = (placed.soup.objects.len(), placed.meshes.len());
    let instances = placed.placements.len();
    let json = json!({
        "unit": kind.unit, "polygons": stored, "objects": objects, "species": species, "instances": instances,
        "visible_polygons": visible,
    });
    let [s, v, o, i, m] = [stored, visible as usize, objects, instances, species].map(grouped);
    Ok((json, format!(": {s} polygons stored, {v} visible, {o} objects, {i} instances of {m} meshes")))
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
