//! Messages of the crate in the words of the header.
//!
//! The crate names its own arguments: `` `origins` ``, a leading `max_links 0`, or option `` `emitters` `` within a sentence. A C program
//! reads the members of the records that it gave: `` `segments.origins` ``, `` `options.max_links` ``.

use mrvis::Error;
use smallvec::SmallVec;
use std::cell::RefCell;

/// Names and offsets of the members of a record.
pub type Members = &'static [(&'static str, usize)];

/// Records: the argument that each is, and its members. No call reads more than two, so that noting them takes no memory.
pub type Records = SmallVec<[(&'static str, Members); 2]>;

thread_local! {
    /// Records that the running call has read.
    static RECORDS: RefCell<Records> = RefCell::default();
}

/// The running call reads a record.
pub fn add_record(argument: &'static str, members: Members) {
    // At the end of a thread nothing is kept.
    let _ = RECORDS.try_with(|records| records.borrow_mut().push((argument, members)));
}

/// Takes the records of the running call, and begins with these.
pub fn exchange_records(records: Records) -> Records {
    RECORDS.try_with(|all| all.replace(records)).unwrap_or_default()
}

/// Options of `mrv_load_options`, which messages about scenes name in all calls.
const LOAD_OPTIONS: [&str; 9] = [
    "unit",
    "emitters",
    "two_sided_emission",
    "sides",
    "threads",
    "luminaires",
    "up",
    "channels",
    "max_memory",
];

/// Words that have another name in C: function (empty: all), word of the crate, word of the header. Words without backticks begin a
/// message or a part of it behind a colon.
const WORDS: &[(&str, &str, &str)] = &[
    ("", "`Detail::Optics`", "MRV_DETAIL_OPTICS"),
    ("", "`Detail::Clusters`", "MRV_DETAIL_CLUSTERS"),
    ("", "`Detail::Rays`", "MRV_DETAIL_RAYS"),
    ("", "the engine `MultiResolution`", "MRV_ENGINE_MULTI_RESOLUTION"),
    ("", "the engine `Average`", "MRV_ENGINE_AVERAGE"),
    ("", "prepare `Scene::flattened`", "prepare the scene of mrv_scene_flatten"),
    ("mrv_visibility_answer", "`bundles`", "`segments.offsets`"),
    ("mrv_visibility_query", "`to_source`", "`query.source`"),
    ("mrv_visibility_query", "`to_point`", "`query.point`"),
    ("mrv_visibility_answer", "segment ", "`segments.targets`: segment "),
    ("mrv_scene_builder_add_material", "material ", "`name`: material "),
    ("mrv_scene_generate", "no scene ", "`name`: no scene "),
    ("mrv_scene_generate_with", "no scene ", "`name`: no scene "),
    ("mrv_scene_load", "no object, group ", "`options.emitters`: no object, group "),
    ("mrv_scene_from_memory", "no object, group ", "`options.emitters`: no object, group "),
    ("mrv_scene_builder_finish", "no object, group ", "`options.emitters`: no object, group "),
    (
        "mrv_model_solve",
        "no object, group ",
        "`options.feature_size_names` or `options.importance`: no object, group ",
    ),
    ("mrv_model_solve", "feature size ", "`options.feature_sizes` "),
    ("mrv_model_bench", "feature_size ", "`options.feature_sizes` "),
    ("mrv_solution_image", "`size` ", "`options.width`, `options.height` "),
    ("mrv_solution_image", "`eye`", "`camera.eye`"),
    ("mrv_fbem", "the exponent", "`images.exponent`"),
    ("mrv_fbem", "the unoccluded value", "`images.white`"),
    ("mrv_fbem", "the shadow threshold", "`images.threshold`"),
    ("mrv_fbem", "the texel size", "`images.texel`"),
    ("mrv_fbem", "the feature size", "`sizes`"),
    ("mrv_fbem", "an image of ", "`images.width`, `images.height`: an image of "),
];

/// What stands before an argument in a sentence, besides a number. What the user named stands behind a noun: material `...`.
const BEFORE_ARGUMENTS: [&str; 12] = [
    ": ",
    "and ",
    "away from ",
    "both ",
    "but ",
    "give ",
    "lower ",
    "number of ",
    "option ",
    "or ",
    "raise ",
    "with ",
];

/// Whether a word in backticks is an argument, by the text before it.
fn is_argument(before: &str) -> bool {
    let counted = before.strip_suffix(' ').is_some_and(|text| text.ends_with(|c: char| c.is_ascii_digit()));
    before.is_empty() || counted || BEFORE_ARGUMENTS.iter().any(|word| before.ends_with(word))
}

/// The text with the first words `from` exchanged: anywhere if they have backticks, else at the beginning or behind a colon.
fn exchanged(text: String, from: &str, to: &str) -> String {
    if from.contains('`') {
        return text.replace(from, to);
    }
    match text.strip_prefix(from) {
        Some(rest) => format!("{to}{rest}"),
        None => text.replacen(&format!(": {from}"), &format!(": {to}"), 1),
    }
}

/// The message of an error of the crate, as the C function `name` gives it.
pub fn error_in_c(name: &str, error: &Error) -> String {
    let text = error.to_string();
    match error {
        // What these quote is the file's, but for options.
        Error::Format { .. } | Error::Io { .. } => arguments_in_c(&text, |_| false),
        _ => in_c(name, &text),
    }
}

/// A message or warning of the crate, as the C function `name` gives it.
pub fn in_c(name: &str, text: &str) -> String {
    let own = |function: &str| function.is_empty() || function == name;
    let words = WORDS.iter().filter(|(function, ..)| own(function));
    let text = words.fold(text.to_owned(), |text, (_, from, to)| exchanged(text, from, to));
    let text = points_as_arrays(&text);
    // A leading `max_links 0`.
    let leading = text.split_once(' ').and_then(|(word, rest)| {
        let value = rest.split([' ', ':']).next().unwrap_or_default();
        let argument = argument_of(word).filter(|_| value.parse::<f64>().is_ok())?;
        Some(format!("`{argument}.{word}` {rest}"))
    });
    arguments_in_c(&leading.unwrap_or(text), is_argument)
}

/// The record with the member `word` among those of the running call.
fn argument_of(word: &str) -> Option<&'static str> {
    let found = RECORDS.try_with(|records| {
        let records = records.borrow();
        let is_it = |(_, members): &&(&str, Members)| members.iter().any(|(member, _)| *member == word);
        records.iter().find(is_it).map(|(argument, _)| *argument)
    });
    found.ok().flatten()
}

/// The text with the records of members that it names in backticks, where `is_argument` says by the text before that these are arguments.
fn arguments_in_c(text: &str, is_argument: impl Fn(&str) -> bool) -> String {
    let mut out = String::new();
    for (i, part) in text.split('`').enumerate() {
        if i % 2 == 0 {
            out += part;
            continue;
        }
        let is_option = out.ends_with("option ");
        if is_option {
            out.truncate(out.len() - "option ".len());
        }
        match argument_of(part).filter(|_| is_option || is_argument(&out)) {
            Some(argument) => out += &format!("`{argument}.{part}`"),
            None if is_option && LOAD_OPTIONS.contains(&part) => {
                out += &format!("`mrv_load_options.{part}`");
            }
            None if is_option => out += &format!("option `{part}`"),
            None => out += &format!("`{part}`"),
        }
    }
    // The last backtick of an odd number opens nothing.
    if text.matches('`').count() % 2 == 1 { text.to_owned() } else { out }
}

/// Points are one array in Rust and two in C: `` `points`[3].normal `` becomes `` `normals`[3] ``.
fn points_as_arrays(text: &str) -> String {
    let Some((before, rest)) = text.split_once("`points`[") else { return text.to_owned() };
    for (end, name) in [("].position", "positions"), ("].normal", "normals")] {
        if let Some((index, after)) = rest.split_once(end) {
            return format!("{before}`{name}`[{index}]{after}");
        }
    }
    text.to_owned()
}

#[cfg(test)]
mod tests {
    use super::{Members, Records, error_in_c, exchange_records, in_c};
    use mrvis::Error;

    /// Records that have these members.
    fn reading(argument: &'static str, members: Members) {
        exchange_records(Records::from_iter([(argument, members)]));
    }

    const LOAD: Members =
        &[("unit", 0), ("emitters", 0), ("threads", 0), ("luminaires", 0), ("max_memory", 0)];

    #[test]
    fn names_of_the_user_stay() {
        reading("options", LOAD);
        for text in [
            "no object, group or material is called `sofa`; did you mean `luminaires`?",
            "no object, group or material is called `sofa`; there are `threads`, `luminaires`",
            "mesh `positions` has no usable face",
            "material `emitters` emits",
            "instance `unit`: its transform is not finite",
        ] {
            for function in ["mrv_scene_builder_finish", "mrv_scene_builder_add_object"] {
                let found = error_in_c(function, &Error::Scene(text.into()));
                assert!(found.ends_with(text), "{found}");
            }
        }
        let text = "feature size 0 of `error`: must be a number above 0";
        let want = "`options.feature_sizes` 0 of `error`: must be a number above 0";
        assert_eq!(in_c("mrv_model_solve", text), want);
        let texture =
            Error::format("a.gltf", None, "`threads`: only files are read; or raise option `max_memory`");
        let want = "a.gltf: `threads`: only files are read; or raise `options.max_memory`";
        assert_eq!(error_in_c("mrv_scene_load", &texture), want);
    }

    #[test]
    fn names_are_those_of_the_header() {
        let segments: Members = &[("origins", 0), ("targets", 0), ("offsets", 0)];
        let options: Members =
            &[("max_links", 0), ("error", 0), ("points", 0), ("max_bytes", 0), ("rays", 0)];
        let mesh: Members = &[("positions", 0), ("indices", 0)];
        for (function, text, want) in [
            ("mrv_visibility_answer", "`bundles`: the last 3", "`segments.offsets`: the last 3"),
            (
                "mrv_visibility_answer",
                "`targets` has 2 for 3 `origins`",
                "`segments.targets` has 2 for 3 `segments.origins`",
            ),
            ("mrv_visibility_answer", "the engine `Average` needs optics", "MRV_ENGINE_AVERAGE needs optics"),
            ("mrv_visibility_query", "`to_source` 9: there are 2", "`query.source` 9: there are 2"),
            ("mrv_model_solve", "max_links 0: must lie in 1..9", "`options.max_links` 0: must lie in 1..9"),
            ("mrv_model_solve", "error bars: 3", "error bars: 3"),
            (
                "mrv_model_bench",
                "points 9: lower option `points`",
                "`options.points` 9: lower `options.points`",
            ),
            ("mrv_model_bench", "dark; add option `emitters`", "dark; add `mrv_load_options.emitters`"),
            (
                "mrv_model_bench",
                "prepare the model with `Detail::Optics`",
                "prepare the model with MRV_DETAIL_OPTICS",
            ),
            ("mrv_solution_irradiance", "`points`[7].normal [0]: is 0", "`normals`[7] [0]: is 0"),
            (
                "mrv_scene_builder_add_object",
                "mesh `indices`: `indices`[3] 9: must be below 8, the number of `positions`",
                "mesh `indices`: `mesh.indices`[3] 9: must be below 8, the number of `mesh.positions`",
            ),
            (
                "mrv_model_form_factors",
                "1 byte: raise `max_bytes` (now 1) or lower `rays`",
                "1 byte: raise `options.max_bytes` (now 1) or lower `options.rays`",
            ),
            ("mrv_scene_load", "no emitter `sofa`", "no emitter `sofa`"),
            ("mrv_scene_load", "an odd ` `threads`", "an odd ` `threads`"),
        ] {
            match function {
                "mrv_visibility_answer" => reading("segments", segments),
                "mrv_scene_builder_add_object" => reading("mesh", mesh),
                "mrv_scene_load" => reading("options", LOAD),
                _ => reading("options", options),
            }
            assert_eq!(in_c(function, text), want);
        }
    }
}
