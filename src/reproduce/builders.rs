//! Which builder of clusters is best for which kind of scene: FBEM at equal time.

use super::equal_time::{Compared, EQUAL_TIME_RAYS, MAX_RAYS, MIN_RAYS, SIZES, compare};
use super::item::{Item, Table};
use super::{Context, fixed};
use crate::Result;
use crate::clusters::Builder;
use crate::page::file_name;
use crate::scene::generate::{self, Spec};
use crate::scene::{LoadOptions, Scene};
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
/// A scene with what was measured in it.
struct Row {
    name: String,
    kind: &'static str,
    compared: Compared,
}

/// The builders on generated scenes, and on those given.
pub fn builders(context: &Context) -> Result<Item> {
    let mut item = Item {
        here: format!(
            "A shadow image of the largest surface with shadows, or of the window of it with the most borders of shadows if those of the \
             smaller feature size would be narrower than two texels; feature sizes of {} of a fifth of the surface's longer side. Objects that \
             no segment between it and the emitters can meet are left out. {MIN_RAYS} to {MAX_RAYS} segments by clusters of each builder; the \
             errors are FBEM at the time of {EQUAL_TIME_RAYS} exact rays, without preparation, interpolated; geometric means over feature \
             sizes. The sampling error of a ratio between builders comes from two independent sets of segments, each with its own times; \
             that of a kind of scene from the scatter between scenes. {}",
            SIZES.map(|part| format!("1/{:.0}", 1.0 / part)).join(" and "),
            match context.scenes.len() {
                0 => "Generated scenes only.".into(),
                n => format!("Generated scenes, and {n} that were given."),
            }
        ),
        ..Item::default()
    };
    let mut found = Vec::new();
    for scene in scenes(context) {
        let (scene, name, kind) = scene?;
        context.progress.stage(&format!("builders: {name}"), 0);
        let compared = compare(context, scene)?;
        found.extend(compared.map(|compared| Row { name, kind, compared }));
    }
    item.tables.push(by_scene(&found));
    item.tables.push(by_kind(&found));
    item.tables.push(preparation(&found));
    let all: Vec<&Row> = found.iter().collect();
    let logs = relative_to_default(&all);
    let ratio = |(builder, [mean, deviation]): (Builder, [f64; 2])| {
        format!("{} {} ± {} %", builder.name(), fixed(mean.exp(), 2), fixed(100.0 * deviation, 0))
    };
    let ratios: Vec<String> = Builder::ALL.into_iter().zip(logs).skip(1).map(ratio).collect();
    item.check_time(
        "no other builder beats the default clearly: by more than two standard errors of the geometric mean over all scenes",
        format!("FBEM relative to the default, with standard errors: {}", ratios.join(", ")),
        logs[1..].iter().all(|[mean, deviation]| *mean >= -2.0 * deviation),
    );
    let errors = || found.iter().flat_map(|row| row.compared.by);
    item.check(
        "all builders were compared",
        format!("{} scenes", found.len()),
        !found.is_empty() && errors().all(f64::is_finite),
    );
    Ok(item)
}

/// Columns of a table: words, then a number for each builder, then words.
fn columns(first: &[&'static str], last: &[&'static str]) -> Vec<&'static str> {
    [first, &Builder::ALL.map(Builder::name), last].concat()
}

/// Errors of the builders in each scene.
fn by_scene(found: &[Row]) -> Table {
    let columns = columns(
        &["scene", "kind", "exact rays"],
        &["± of a ratio", "noise of reference", "best builder", "better"],
    );
    let mut table = Table::new(format!("FBEM at the time of {EQUAL_TIME_RAYS} exact rays, %"), &columns);
    for row in found {
        let Compared { exact, by, deviation, noise, .. } = row.compared;
        let errors = [exact].into_iter().chain(by).map(|e| fixed(100.0 * e, 2));
        let best = best_of(by.map(|e| [e.ln(), deviation]));
        let than_rays =
            if by.into_iter().fold(f64::INFINITY, f64::min) < exact { "clusters" } else { "exact rays" };
        let last = [fixed(100.0 * deviation, 1), fixed(100.0 * noise, 2), best, than_rays.into()];
        table.push([row.name.clone(), row.kind.into()].into_iter().chain(errors).chain(last));
    }
    table
}

/// Seconds of the preparation of each scene.
fn preparation(found: &[Row]) -> Table {
    let mut table = Table::new("Seconds of clusters and optics", &columns(&["scene", "triangles"], &[]));
    for row in found {
        let seconds = row.compared.preparation.map(|seconds| fixed(seconds, 2));
        table.push([row.name.clone(), row.compared.triangles.to_string()].into_iter().chain(seconds));
    }
    table
}

/// The best builder for each kind of scene.
fn by_kind(found: &[Row]) -> Table {
    let title =
        "By kind of scene: FBEM at equal time relative to the default's, geometric means ± standard errors";
    let mut table = Table::new(title, &columns(&["kind", "scenes"], &["best"]));
    let mut kinds: Vec<&str> = Vec::new();
    for row in found {
        if !kinds.contains(&row.kind) {
            kinds.push(row.kind);
        }
    }
    for kind in kinds {
        let own: Vec<&Row> = found.iter().filter(|row| row.kind == kind).collect();
        let logs = relative_to_default(&own);
        let scenes: Vec<&str> = own.iter().map(|row| row.name.as_str()).collect();
        let number = |[mean, deviation]: [f64; 2]| match deviation {
            0.0 => fixed(mean.exp(), 2),
            _ => format!("{} ± {}", fixed(mean.exp(), 2), fixed(mean.exp() * deviation, 2)),
        };
        let words = [kind.to_owned(), scenes.join(", ")];
        table.push(words.into_iter().chain(logs.map(number)).chain([best_of(logs)]));
    }
    table
}

/// By builder, mean and standard error over scenes of the logarithm of the FBEM relative to that of the default: from the scatter between
/// scenes, but at least the sampling error.
fn relative_to_default(found: &[&Row]) -> [[f64; 2]; 4] {
    let n = found.len() as f64;
    let sampling = found.iter().map(|row| row.compared.deviation.powi(2)).sum::<f64>().sqrt() / n;
    std::array::from_fn(|k| {
        let logs = || found.iter().map(|row| (row.compared.by[k] / row.compared.by[0]).ln());
        let mean = logs().sum::<f64>() / n;
        let square = logs().map(|log| (log - mean).powi(2)).sum::<f64>();
        let scatter = (square / (n * (n - 1.0).max(1.0))).sqrt();
        [mean, if k == 0 { 0.0 } else { scatter.max(sampling) }]
    })
}

/// The names of the builders whose logarithms of errors exceed the smallest by no more than two standard errors.
fn best_of(logs: [[f64; 2]; 4]) -> String {
    let smallest = logs.into_iter().fold([f64::INFINITY, 0.0], |a, b| if b[0] < a[0] { b } else { a });
    let is_best = |log: &[f64; 2]| log[0] - smallest[0] <= 2.0 * log[1].max(smallest[1]);
    let best: Vec<&str> =
        Builder::ALL.into_iter().zip(logs).filter(|(_, log)| is_best(log)).map(|(b, _)| b.name()).collect();
    if best.len() == logs.len() { "all alike".into() } else { best.join(", ") }
}

/// A scene with name and kind.
type Given = (Arc<Scene>, String, &'static str);

/// Generated scenes, then those given, each made or read when its turn comes.
fn scenes<'a>(context: &'a Context) -> impl Iterator<Item = Result<Given>> + 'a {
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
    generated.chain(context.scenes.iter().map(read))
}
