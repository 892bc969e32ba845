//! Which builder of clusters is best for which kind of scene: FBEM at equal time.

use super::groups::range;
use super::item::{Item, Table};
use super::shadow::{Grid, Rendered};
use super::{Context, fixed};
use crate::Result;
use crate::bench::{receivers, sizes};
use crate::clusters::{self, Builder};
use crate::embree::Traversal;
use crate::metrics::{FbemOptions, Image, fbem};
use crate::model::{Model, PrepareOptions};
use crate::page::file_name;
use crate::scene::generate::{self, Spec};
use crate::scene::{LoadOptions, Scene};
use crate::visibility::{Exact, LeafMode};
use std::path::PathBuf;
use std::sync::Arc;

/// Generated scenes, and their kind.
const SCENES: [(&str, &str); 6] = [
    ("forest", LEAVES),
    ("cubes", SOLIDS),
    ("office", FURNITURE),
    ("bookshelf", SOLIDS),
    ("louvres", "aligned sheets"),
    ("urban-block", WALLS),
];
/// Kinds of scenes.
const LEAVES: &str = "leaves";
const SOLIDS: &str = "solids";
const FURNITURE: &str = "furniture";
const WALLS: &str = "walls and terrain";
/// Kinds of the assembled scenes (scenes/README.md), by the names of their files.
const ASSEMBLED: [(&str, &str); 8] = [
    ("garden", LEAVES),
    ("orchard", LEAVES),
    ("park", LEAVES),
    ("kitchen", FURNITURE),
    ("livingroom", FURNITURE),
    ("office", FURNITURE),
    ("sponza", WALLS),
    ("valley", WALLS),
];
/// Segments a pair of the MR rows; exact rays of the row whose time is the equal time: so many that few-segment rows take less time
/// and the others more, and errors at the equal time are interpolated.
const SEGMENTS: [usize; 3] = [4, 16, 64];
const EQUAL_TIME_RAYS: usize = 64;
/// Pairs of texels and emitters that are timed, and rays of the reference.
const PAIRS: usize = 4000;
const REFERENCE_RAYS: usize = 512;
/// Errors of the builders in one scene.
struct Compared {
    name: String,
    kind: &'static str,
    triangles: usize,
    /// FBEM of exact rays at the equal time, and of the builders at the same time: geometric means over feature sizes.
    exact: f64,
    by: [f64; 4],
}

/// The builders on generated scenes, and on those given.
pub fn builders(context: &Context) -> Result<Item> {
    let mut item = Item {
        here: format!(
            "Shadow images of the largest surfaces (the receivers of `mrvis bench`), multi-resolution visibility with clusters by each \
             builder; two feature sizes from the scene's statistics; 4, 16 and 64 segments. The errors are FBEM at the time of \
             {EQUAL_TIME_RAYS} exact rays, interpolated, per cent; geometric means over feature sizes. {}",
            match context.scenes.len() {
                0 => "Generated scenes only.".into(),
                n => format!("Generated scenes, and {n} that were given."),
            }
        ),
        ..Item::default()
    };
    let mut found = Vec::new();
    for (scene, name, kind) in scenes(context)? {
        context.progress.stage(&format!("builders: {name}"), 0);
        found.extend(compare(context, scene, name, kind)?);
    }
    let names = Builder::ALL.map(Builder::name);
    let mut columns = vec!["scene", "kind", "triangles", "exact rays"];
    columns.extend(names);
    columns.push("best");
    let mut table = Table::new(format!("FBEM at the time of {EQUAL_TIME_RAYS} exact rays, %"), &columns);
    for c in &found {
        let errors = [c.exact].into_iter().chain(c.by).map(|e| fixed(100.0 * e, 3));
        let words = [c.name.clone(), c.kind.into(), c.triangles.to_string()];
        table.push(words.into_iter().chain(errors).chain([best_of(c.by).to_owned()]));
    }
    item.tables.push(table);
    item.tables.push(by_kind(&found));
    let all: Vec<&Compared> = found.iter().collect();
    let logs = relative_to_default(&all);
    let ratio =
        |[mean, deviation]: [f64; 2]| format!("{} ± {} %", fixed(mean.exp(), 2), fixed(100.0 * deviation, 0));
    let ratios = names.iter().zip(logs).skip(1).map(|(name, log)| format!("{name} {}", ratio(log)));
    item.check_time(
        "no other builder beats the default clearly: by more than two standard errors of the geometric mean over all scenes",
        format!("FBEM relative to the default, with standard errors: {}", ratios.collect::<Vec<_>>().join(", ")),
        logs[1..].iter().all(|[mean, deviation]| *mean >= -2.0 * deviation),
    );
    item.check(
        "all builders were compared",
        format!("{} scenes", found.len()),
        !found.is_empty() && found.iter().all(|c| c.by.iter().all(|e| e.is_finite())),
    );
    Ok(item)
}

/// The best builder for each kind of scene.
fn by_kind(found: &[Compared]) -> Table {
    let names = Builder::ALL.map(Builder::name);
    let mut columns = vec!["kind", "scenes"];
    columns.extend(names);
    columns.push("best");
    let mut table = Table::new(
        "By kind of scene: FBEM at equal time relative to the default's, geometric means",
        &columns,
    );
    let mut kinds: Vec<&str> = Vec::new();
    for c in found {
        if !kinds.contains(&c.kind) {
            kinds.push(c.kind);
        }
    }
    for kind in kinds {
        let own: Vec<&Compared> = found.iter().filter(|c| c.kind == kind).collect();
        let ratios = relative_to_default(&own).map(|[mean, _]| mean.exp());
        let scenes: Vec<&str> = own.iter().map(|c| c.name.as_str()).collect();
        let words = [kind.to_owned(), scenes.join(", ")];
        let numbers = ratios.map(|ratio| fixed(ratio, 2));
        table.push(words.into_iter().chain(numbers).chain([best_of(ratios).to_owned()]));
    }
    table
}

/// By builder, mean and standard error over scenes of the logarithm of the FBEM relative to that of the default.
fn relative_to_default(found: &[&Compared]) -> [[f64; 2]; 4] {
    let n = found.len() as f64;
    std::array::from_fn(|k| {
        let logs = || found.iter().map(|c| (c.by[k] / c.by[0]).ln());
        let mean = logs().sum::<f64>() / n;
        let square = logs().map(|log| (log - mean).powi(2)).sum::<f64>();
        [mean, (square / (n * (n - 1.0).max(1.0))).sqrt()]
    })
}

/// Part by which errors differ from run to run, as times do: builders whose errors differ by less are alike.
const ALIKE: f64 = 0.03;

/// The name of the builder with the smallest error.
fn best_of(errors: [f64; 4]) -> &'static str {
    let (least, most) = range(&errors);
    match Builder::ALL.into_iter().zip(errors).find(|(_, error)| *error == least) {
        Some((builder, _)) if most > least * (1.0 + ALIKE) => builder.name(),
        _ => "all alike",
    }
}

/// Scenes with name and kind: generated ones, then those given.
fn scenes(context: &Context) -> Result<Vec<(Arc<Scene>, String, &'static str)>> {
    let count = if context.small { 2 } else { SCENES.len() };
    let generated = SCENES.iter().skip(1).chain(&SCENES[..1]).take(count).map(|&(name, kind)| {
        let spec = Spec { trees: 60, leaves: 500, ..Spec::new(name) };
        Ok((Arc::new(generate::build(&spec)?), name.to_owned(), kind))
    });
    let read = |path: &PathBuf| {
        let scene = Scene::load_with(path, &LoadOptions::default())?;
        let name = file_name(&path.to_string_lossy()).to_owned();
        let stem = path.file_stem().unwrap_or_default();
        let kind =
            ASSEMBLED.iter().find(|(assembled, _)| stem == *assembled).map_or("given", |(_, kind)| kind);
        Ok((Arc::new(scene), name, kind))
    };
    generated.chain(context.scenes.iter().map(read)).collect()
}

/// `None` if the scene has no emitter or no receiver.
fn compare(
    context: &Context,
    scene: Arc<Scene>,
    name: String,
    kind: &'static str,
) -> Result<Option<Compared>> {
    if scene.emitters.is_empty() {
        return Ok(None);
    }
    let repeat = if context.small { 1 } else { 2 };
    let triangles = scene.visible_triangles() as usize;
    let (mut exact, mut by) = (f64::NAN, [f64::NAN; 4]);
    let mut common: Option<Common> = None;
    for (k, builder) in Builder::ALL.into_iter().enumerate() {
        let clusters = clusters::Options { builder, ..Default::default() };
        let options = PrepareOptions { clusters, ..PrepareOptions::default() };
        let model = Model::prepare(scene.clone(), &options, context.progress)?;
        let common = match &mut common {
            Some(common) => common,
            none => match Common::new(&model, repeat)? {
                Some(made) => none.insert(made),
                None => return Ok(None),
            },
        };
        let grids = common.grids(&model);
        let engine = model.engine(model.widest_packets(), LeafMode::Exact).expect("optics");
        let engines: Vec<_> = grids.iter().map(|grid| grid.with_budget(engine.clone())).collect();
        let mut errors = Vec::new();
        for &s in &common.sizes {
            let mut curve = Vec::new();
            for rays in SEGMENTS {
                let rows = grids
                    .iter()
                    .zip(&engines)
                    .map(|(grid, engine)| grid.by_clusters(engine, s, (rays, repeat)));
                curve.push(common.point(rows.collect::<Result<_>>()?, s)?);
            }
            errors.push(at_time(&curve, common.seconds));
        }
        by[k] = geometric_mean(&errors);
        exact = geometric_mean(&common.exact);
    }
    Ok(Some(Compared { name, kind, triangles, exact, by }))
}

/// What all builders are compared with.
struct Common {
    receivers: Vec<receivers::ReceiverGrid>,
    references: Vec<Image<'static>>,
    sizes: Vec<f64>,
    /// Seconds of the exact rays, and their FBEM by size.
    seconds: f64,
    exact: Vec<f64>,
}

impl Common {
    fn new(model: &Model, repeat: usize) -> Result<Option<Common>> {
        let all = sizes::default_sizes(model);
        let sizes = vec![all[1], all[3]];
        let single =
            Exact { scene: model.traced().clone(), traversal: Traversal { width: 1, coherent: false } };
        let chosen = receivers::choose(model, &single, &[])?.grids(model, &single, [sizes[0], sizes[1]]);
        let texels: usize = chosen.iter().map(|r| r.points.len()).sum();
        let part = PAIRS as f64 / (texels * model.scene().emitters.len()).max(1) as f64;
        let receivers: Vec<_> = chosen.iter().map(|r| r.only(r.middle(part))).collect();
        let mut common = Common { receivers, references: Vec::new(), sizes, seconds: 0.0, exact: Vec::new() };
        if common.receivers.is_empty() {
            return Ok(None);
        }
        let by = |rays: usize, stream: u64, repeat: usize| -> Result<Vec<Rendered>> {
            common.grids(model).iter().map(|grid| grid.by_rays(rays, stream, repeat)).collect()
        };
        let (references, exact) = (by(REFERENCE_RAYS, 1, 1)?, by(EQUAL_TIME_RAYS, 0, repeat)?);
        common.references = references.into_iter().map(|r| r.image).collect();
        for s in common.sizes.clone() {
            let (seconds, error) = common.point(exact.clone(), s)?;
            common.seconds = seconds;
            common.exact.push(error);
        }
        Ok(Some(common))
    }

    fn grids<'a>(&self, model: &'a Model) -> Vec<Grid<'a>> {
        let grid =
            |r: &receivers::ReceiverGrid| Grid::new(model, r.points.clone(), [r.width, r.height], r.texel);
        self.receivers.iter().map(grid).collect()
    }

    /// Seconds and FBEM of images of all receivers, a root mean square over their area.
    fn point(&self, rows: Vec<Rendered>, s: f64) -> Result<(f64, f64)> {
        let (mut seconds, mut sum, mut area) = (0.0, 0.0, 0.0);
        for (reference, row) in self.references.iter().zip(rows) {
            let own = reference.data().len() as f64 * reference.texel().powi(2);
            let error = fbem(reference, &row.image, &FbemOptions::default().with_size(s))?.value;
            (seconds, sum, area) = (seconds + row.seconds, sum + own * error * error, area + own);
        }
        Ok((seconds, (sum / area).sqrt().max(MIN_ERROR)))
    }
}

/// Errors below this visible fraction count as it: a hundredth of a step of 8-bit grey, so that logarithms exist.
const MIN_ERROR: f64 = 4e-5;

/// The error at a time, interpolated between logarithms; beyond the ends that of the nearest line.
fn at_time(curve: &[(f64, f64)], seconds: f64) -> f64 {
    let logs: Vec<(f64, f64)> = curve.iter().map(|(t, e)| (t.ln(), e.ln())).collect();
    let t = seconds.ln();
    let k = logs[1..logs.len() - 1].iter().filter(|point| point.0 < t).count();
    let ((a, e), (b, f)) = (logs[k], logs[k + 1]);
    // Errors of more segments are no larger than those of fewer; noise must not be extrapolated.
    let slope = ((f - e) / (b - a).max(1e-9)).clamp(-0.5, 0.0);
    (e + slope * (t - a)).exp()
}

fn geometric_mean(values: &[f64]) -> f64 {
    (values.iter().map(|v| v.ln()).sum::<f64>() / values.len() as f64).exp()
}
