//! Which builder of clusters is best for which kind of scene: FBEM at equal time.

use super::builder_statistics::{UNDECIDED, best, measurement_error, never_worse, ratio};
use super::equal_time::{Compared, EQUAL_TIME_RAYS, MAX_RAYS, MIN_RAYS, SIZES, compare};
use super::item::Item;
use super::table::{Table, count, number};
use super::{Context, fixed};
use mrvis::Builder;
use mrvis::Result;
use mrvis::internals::BuilderParts;
use mrvis::internals::page::file_name;
use mrvis::internals::scene::generate::{self, Spec};
use mrvis::{LoadOptions, Scene};
use std::path::PathBuf;
use std::sync::Arc;

/// Generated scenes, at least two of each kind: name, generator, kind, count (of a forest its trees) and seed.
const SCENES: [(&str, &str, &str, Option<usize>, u64); 11] = [
    ("cubes", "cubes", SOLIDS, None, 1),
    ("office", "office", FURNITURE, None, 1),
    ("800 cubes", "cubes", SOLIDS, Some(800), 2),
    ("bookshelf", "bookshelf", SOLIDS, None, 1),
    ("desk room", "desk-room", FURNITURE, None, 1),
    ("louvres", "louvres", SHEETS, None, 1),
    ("12 louvres", "louvres", SHEETS, Some(12), 1),
    ("urban block", "urban-block", WALLS, None, 1),
    ("brick wall", "brick-wall", WALLS, None, 1),
    ("forest", "forest", LEAVES, None, 1),
    ("forest of few trees", "forest", LEAVES, Some(12), 2),
];
/// Trees of a forest without a count.
const TREES: usize = 60;
/// Leaves of all trees of a forest together.
const ALL_LEAVES: usize = 30_000;
/// Kinds of scenes.
const LEAVES: &str = "leaves";
const SOLIDS: &str = "solids";
const SHEETS: &str = "aligned sheets";
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
             errors are FBEM at the time of {EQUAL_TIME_RAYS} exact rays, without preparation, interpolated, without the noise of the \
             reference; geometric means over feature sizes. The engine hands runs of segments over to exact rays where these cost less, so \
             that errors may compare this decision instead of clusters; a table shows how many. Each measurement is made twice, from the preparation on, with other segments; the differences, pooled over all scenes, \
             tell its standard error, and the scatter between scenes that of a kind of scene, if it is larger. One rule decides everywhere: a \
             builder is worse than another one if the mean logarithm of the ratio of their errors exceeds the 95 % interval of Student's t and \
             what the noise of the reference can change. Best are the builder with the smallest error and those that are not worse; one scene \
             does not decide about its kind, and two do only if builders differ alike in both. Beside stand the builders that are among the best \
             in each scene of a kind. {}",
            SIZES.map(|part| format!("1/{:.0}", 1.0 / part)).join(" and "),
            match context.scenes.len() {
                0 => "Generated scenes only.".into(),
                n => format!("Generated scenes, and {n} that were given."),
            }
        ),
        ..Item::default()
    };
    item.warnings.extend(missing(&context.scenes));
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
    item.tables.push(handed_over(&found));
    item.tables.push(preparation(&found));
    judge(&mut item, &compared(&found), &left_out);
    Ok(item)
}

/// The scenes of `make scenes` that were not given.
fn missing(given: &[PathBuf]) -> Option<String> {
    let is_given = |name: &str| given.iter().any(|path| path.file_stem().is_some_and(|stem| stem == name));
    let missing: Vec<&str> = ASSEMBLED.iter().map(|(name, _)| *name).filter(|name| !is_given(name)).collect();
    (!missing.is_empty()).then(|| {
        format!(
            "Scenes of `make scenes` were not given, on which the choice of the default rests: {}. \
             `mrvis reproduce --only builders --scenes scenes/real/*.obj --out DIR` compares the builders on them as well.",
            missing.join(", ")
        )
    })
}

/// What was measured, without names.
fn compared(rows: &[Row]) -> Vec<&Compared> {
    rows.iter().map(|row| &row.compared).collect()
}

/// Whether the default is right, and all scenes were compared.
fn judge(item: &mut Item, all: &[&Compared], left_out: &[String]) {
    let ratios = [1, 2, 3].map(|k| (Builder::ALL[k].name(), ratio(all, all, k, 0)));
    let shown = ratios.map(|(name, ratio)| {
        format!("{name} {} ± {} %", fixed(ratio.mean.exp(), 2), fixed(100.0 * ratio.error, 0))
    });
    let better: Vec<&str> =
        ratios.iter().filter(|(_, ratio)| ratio.is_better()).map(|(name, _)| *name).collect();
    item.check_time(
        "no other builder is certainly better than the default over all scenes, by the rule above",
        format!("FBEM relative to the default, with standard errors: {}", shown.join(", ")),
        !all.is_empty() && ratios.iter().all(|(_, ratio)| ratio.mean.is_finite()) && better.is_empty(),
        || match better.is_empty() {
            true => "no scene, or an error that is not a number".into(),
            false => format!("{} has smaller errors", better.join(" and ")),
        },
    );
    let is_finite = |scene: &&Compared| scene.logs.iter().flatten().all(|log| log.is_finite());
    item.check(
        "all builders were compared in all scenes",
        format!("{} of {} scenes", all.len(), all.len() + left_out.len()),
        !all.is_empty() && left_out.is_empty() && all.iter().all(is_finite),
        || match left_out {
            [] => "no scene, or an error that is not a number".into(),
            names => format!("{}: no emitter, or no surface with shadows", names.join(", ")),
        },
    );
}

/// Columns of a table: some, then one for each builder with this unit, then others.
fn columns(first: &[&str], unit: &str, last: &[&str]) -> Vec<String> {
    let words = |names: &[&str]| names.iter().map(|name| name.to_string()).collect::<Vec<_>>();
    let builders = Builder::ALL.map(|builder| format!("{}, {unit}", builder.name())).to_vec();
    [words(first), builders, words(last)].concat()
}

/// Errors of the builders in each scene.
fn by_scene(found: &[Row]) -> Table {
    let columns = columns(
        &["scene", "kind", "exact rays, %"],
        "%",
        &["noise of reference, %", "best builder", "better"],
    );
    let all = compared(found);
    let title = format!(
        "FBEM at the time of {EQUAL_TIME_RAYS} exact rays; standard error of a ratio between builders in one scene {} %",
        fixed(100.0 * measurement_error(&all), 1)
    );
    let mut table = Table::new(title, &columns);
    for row in found {
        let errors = (0..4).map(|k| row.compared.error(k));
        let smallest = errors.clone().fold(f64::INFINITY, f64::min);
        let better = if smallest < row.compared.exact { "clusters" } else { "exact rays" };
        let numbers = [row.compared.exact].into_iter().chain(errors).map(|e| number(100.0 * e, 2));
        let last =
            [number(100.0 * row.compared.noise, 3), best(&[&row.compared], &all).into(), better.into()];
        table.push([row.name.as_str().into(), row.kind.into()].into_iter().chain(numbers).chain(last));
    }
    table
}

/// Parts of the segments that the engine hands over to exact rays.
fn handed_over(found: &[Row]) -> Table {
    let title = format!("Segments that the engine hands over to exact rays, {MIN_RAYS} a pair");
    let mut table = Table::new(title, &columns(&["scene"], "%", &[]));
    for row in found {
        let parts = row.compared.handed_over.map(|part| number(100.0 * part, 0));
        table.push([row.name.as_str().into()].into_iter().chain(parts));
    }
    table
}

/// Seconds of the preparation of each scene.
fn preparation(found: &[Row]) -> Table {
    let columns = columns(&["scene", "triangles"], "s", &[]);
    let mut table = Table::new("Time of clusters and optics", &columns);
    for row in found {
        let seconds = row.compared.preparation.map(|seconds| number(seconds, 2));
        table.push([row.name.as_str().into(), count(row.compared.triangles)].into_iter().chain(seconds));
    }
    table
}

/// The best builder for each kind of scene, and over all scenes.
fn by_kind(found: &[Row]) -> Table {
    let title = "By kind of scene: ratio of the FBEM at equal time to that of the default, geometric means with standard errors";
    let mut columns = vec!["kind".to_owned(), "scenes".to_owned()];
    for builder in &Builder::ALL[1..] {
        columns.push(builder.name().to_owned());
        columns.push(format!("± of {}", builder.name()));
    }
    columns.extend(["best", "not worse in any of them"].map(str::to_owned));
    let mut table = Table::new(title, &columns);
    let mut kinds: Vec<&str> = Vec::new();
    for row in found {
        if !kinds.contains(&row.kind) {
            kinds.push(row.kind);
        }
    }
    let all = compared(found);
    let mut push = |kind: &str, own: &[&Row]| {
        let of_kind: Vec<&Compared> = own.iter().map(|row| &row.compared).collect();
        let scenes: Vec<&str> = own.iter().map(|row| row.name.as_str()).collect();
        let ratios = (1..Builder::ALL.len()).map(|k| ratio(&of_kind, &all, k, 0));
        let numbers = ratios.flat_map(|r| [r.mean.exp(), r.mean.exp() * r.error]).map(|v| number(v, 2));
        let best = if of_kind.len() < 2 { UNDECIDED.into() } else { best(&of_kind, &all) };
        let words = [kind.into(), scenes.join(", ").into()];
        let last = [best.into(), never_worse(&of_kind, &all).into()];
        table.push(words.into_iter().chain(numbers).chain(last));
    };
    for kind in kinds {
        push(kind, &found.iter().filter(|row| row.kind == kind).collect::<Vec<_>>());
    }
    push("all", &found.iter().collect::<Vec<_>>());
    table
}

/// A scene with name and kind.
type Given = (Arc<Scene>, String, &'static str);

/// Generated scenes, then those given, each made or read when its turn comes.
fn scenes<'a>(context: &'a Context) -> impl Iterator<Item = Result<Given>> + 'a {
    let number = if context.small { 2 } else { SCENES.len() };
    let generated = SCENES.iter().take(number).map(|&(name, generator, kind, count, seed)| {
        let mut spec = Spec { seed, count, ..Spec::new(generator) };
        if kind == LEAVES {
            let trees = count.unwrap_or(TREES);
            spec = Spec { count: None, trees, leaves: ALL_LEAVES / trees, ..spec };
        }
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
    fn scenes_that_were_not_given_are_named() {
        let given = ["a/orchard.obj", "garden.obj", "other.obj"].map(PathBuf::from);
        let warning = missing(&given).expect("a warning");
        assert!(warning.contains("park, kitchen") && !warning.contains("orchard"), "{warning}");
        assert!(missing(&ASSEMBLED.map(|(name, _)| PathBuf::from(format!("{name}.obj")))).is_none());
    }

    /// Kinds are judged by at least two scenes without any that are given.
    #[test]
    fn each_kind_has_two_generated_scenes() {
        for (_, _, kind, ..) in SCENES {
            assert!(SCENES.iter().filter(|scene| scene.2 == kind).count() > 1, "{kind}");
        }
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
