//! Which builder of clusters is best for which kind of scene: FBEM at equal time.

use super::builder_statistics::{Ratio, UNDECIDED, best, ratio, sampling_error};
use super::equal_time::{Compared, EQUAL_TIME_RAYS, MAX_RAYS, MIN_RAYS, SIZES, compare};
use super::item::Item;
use super::table::{Table, count, number};
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
             sizes. The sampling error of a ratio between builders comes from two independent sets of segments, each with its own times, \
             pooled over all scenes; that of a kind of scene from the scatter of the ratio between scenes, if it is larger. Best are the \
             builder with the smallest error and those whose ratio to it is within the 95 % interval of Student's t, or whose error is within \
             twice the noise of the reference; one scene does not decide about its kind. {}",
            SIZES.map(|part| format!("1/{:.0}", 1.0 / part)).join(" and "),
            match context.scenes.len() {
                0 => "Generated scenes only.".into(),
                n => format!("Generated scenes, and {n} that were given."),
            }
        ),
        ..Item::default()
    };
    if context.scenes.is_empty() {
        let warning = "The scenes of `make scenes` are missing, on which the choice of the default rests: \
             `mrvis reproduce --only builders --scenes scenes/real/*.obj --out DIR` compares the builders on them as well.";
        item.warnings.push(warning.into());
    }
    let (mut found, mut left_out) = (Vec::new(), Vec::new());
    for scene in scenes(context) {
        let (scene, name, kind) = scene?;
        context.progress.stage(&format!("builders: {name}"), 0);
        match compare(context, scene)? {
            Some(compared) => found.push(Row { name, kind, compared }),
            None => left_out.push(name),
        }
    }
    item.tables.push(by_scene(&found));
    item.tables.push(by_kind(&found));
    item.tables.push(preparation(&found));
    judge(&mut item, &compared(&found), &left_out);
    Ok(item)
}

/// What was measured, without names.
fn compared(rows: &[Row]) -> Vec<&Compared> {
    rows.iter().map(|row| &row.compared).collect()
}

/// Whether the default is right, and all scenes were compared.
fn judge(item: &mut Item, all: &[&Compared], left_out: &[String]) {
    let ratios = [1, 2, 3].map(|k| (Builder::ALL[k], ratio(all, all, k, 0)));
    let shown = |(builder, Ratio { mean, error, .. }): (Builder, Ratio)| {
        format!("{} {} ± {} %", builder.name(), fixed(mean.exp(), 2), fixed(100.0 * error, 0))
    };
    item.check_time(
        "no other builder beats the default clearly: by more than two standard errors of the geometric mean over all scenes",
        format!("FBEM relative to the default, with standard errors: {}", ratios.map(shown).join(", ")),
        !all.is_empty() && ratios.iter().all(|(_, ratio)| ratio.mean >= -2.0 * ratio.error),
    );
    let is_finite = |scene: &&Compared| scene.logs.iter().flatten().all(|log| log.is_finite());
    let check = item.check(
        "all builders were compared in all scenes",
        format!("{} of {} scenes", all.len(), all.len() + left_out.len()),
        !all.is_empty() && left_out.is_empty() && all.iter().all(is_finite),
    );
    check.if_not(|| match left_out {
        [] => "no scene, or an error that is not a number".into(),
        names => format!("{}: no emitter, or no surface with shadows", names.join(", ")),
    });
}

/// Columns of a table: words, then a number for each builder, then words.
fn columns(first: &[&'static str], last: &[&'static str]) -> Vec<&'static str> {
    [first, &Builder::ALL.map(Builder::name), last].concat()
}

/// Errors of the builders in each scene.
fn by_scene(found: &[Row]) -> Table {
    let columns =
        columns(&["scene", "kind", "exact rays"], &["noise of reference, %", "best builder", "better"]);
    let all = compared(found);
    let title = format!(
        "FBEM at the time of {EQUAL_TIME_RAYS} exact rays, %; standard error of a ratio between builders in one scene {} %",
        fixed(100.0 * sampling_error(&all), 1)
    );
    let mut table = Table::new(title, &columns);
    for row in found {
        let errors = (0..4).map(|k| row.compared.error(k));
        let smallest = errors.clone().fold(f64::INFINITY, f64::min);
        let better = if smallest < row.compared.exact { "clusters" } else { "exact rays" };
        let numbers = [row.compared.exact].into_iter().chain(errors).map(|e| number(100.0 * e, 2));
        let last =
            [number(100.0 * row.compared.noise, 2), best(&[&row.compared], &all).into(), better.into()];
        table.push([row.name.as_str().into(), row.kind.into()].into_iter().chain(numbers).chain(last));
    }
    table
}

/// Seconds of the preparation of each scene.
fn preparation(found: &[Row]) -> Table {
    let mut table = Table::new("Seconds of clusters and optics", &columns(&["scene", "triangles"], &[]));
    for row in found {
        let seconds = row.compared.preparation.map(|seconds| number(seconds, 2));
        table.push([row.name.as_str().into(), count(row.compared.triangles)].into_iter().chain(seconds));
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
    let all = compared(found);
    for kind in kinds {
        let own: Vec<&Row> = found.iter().filter(|row| row.kind == kind).collect();
        let of_kind: Vec<&Compared> = own.iter().map(|row| &row.compared).collect();
        let scenes: Vec<&str> = own.iter().map(|row| row.name.as_str()).collect();
        let shown = |k: usize| {
            let Ratio { mean, error, .. } = ratio(&of_kind, &all, k, 0);
            match k {
                0 => number(mean.exp(), 2),
                _ => format!("{} ± {}", fixed(mean.exp(), 2), fixed(mean.exp() * error, 2)).into(),
            }
        };
        let best = if of_kind.len() < 2 { UNDECIDED.into() } else { best(&of_kind, &all) };
        let words = [kind.into(), scenes.join(", ").into()];
        table.push(words.into_iter().chain((0..4).map(shown)).chain([best.into()]));
    }
    table
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

#[cfg(test)]
mod tests {
    use super::super::builder_statistics::tests::scene;
    use super::*;

    /// Which of the two checks hold.
    fn judged(errors: [f64; 4], left_out: &[String]) -> [bool; 2] {
        let scenes = [1.01, 1.02, 1.01].map(|factor| scene(errors, factor, 0.001));
        let mut item = Item::default();
        judge(&mut item, &scenes.iter().collect::<Vec<_>>(), left_out);
        assert!(item.checks[0].timed);
        [0, 1].map(|k| item.checks[k].holds)
    }

    #[test]
    fn better_builders_and_omitted_scenes_are_found() {
        assert_eq!(judged([0.1, 0.2, 0.1, 0.1], &[]), [true, true]);
        assert_eq!(judged([0.1, 0.2, 0.1, 0.05], &[]), [false, true]);
        assert_eq!(judged([0.1, 0.2, 0.1, 0.1], &["cave".into()]), [true, false]);
        assert_eq!(judged([0.1, 0.2, 0.1, f64::NAN], &[]), [false, false]);
        let mut item = Item::default();
        judge(&mut item, &[], &["cave".into()]);
        assert!(item.checks.iter().all(|check| !check.holds));
        assert!(item.checks[1].failure().contains("cave"), "{}", item.checks[1].failure());
    }
}
