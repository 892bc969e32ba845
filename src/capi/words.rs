//! Messages of the crate in the words of the header.
//!
//! The crate names its own arguments: `` `origins` ``, a leading `max_links 0`, or option `` `emitters` `` within a sentence. A C program
//! reads the members of the records that it gave: `` `segments.origins` ``, `` `options.max_links` ``.

/// A record: its name and its members, those of [`super::record::Record`]. A test compares them; the files of records use this one.
pub type Members = (&'static str, &'static [&'static str]);

const LOAD: Members = (
    "mrv_load_options",
    &[
        "struct_size",
        "unit",
        "emitters",
        "emitter_watts",
        "emitter_count",
        "two_sided_emission",
        "sides",
        "threads",
        "reserved",
        "emitter_units",
        "luminaires",
        "up",
        "channels",
        "max_memory",
    ],
);
const GENERATE_OPTIONS: Members = (
    "mrv_generate_options",
    &["struct_size", "seed", "count", "trees", "leaves", "light_size", "trunks", "reserved"],
);
const MESH: Members = (
    "mrv_mesh",
    &[
        "struct_size",
        "name",
        "positions",
        "positions_f64",
        "position_stride",
        "vertex_count",
        "indices",
        "index_count",
        "polygon_sizes",
        "polygon_count",
        "face_materials",
        "material",
        "reserved",
    ],
);
const PREPARE_OPTIONS: Members =
    ("mrv_prepare_options", &["struct_size", "detail", "threads", "cache", "progress", "user"]);
const SEGMENTS: Members = (
    "mrv_segments",
    &[
        "struct_size",
        "origins",
        "targets",
        "segment_count",
        "offsets",
        "bundle_count",
        "feature_sizes",
        "emitter_sizes",
        "feature_size",
        "emitter_size",
        "relative_to",
    ],
);
const ANSWERS: Members =
    ("mrv_answers", &["struct_size", "transmittance", "lo", "hi", "methods", "segment_transmittance"]);
const QUERY: Members = (
    "mrv_query",
    &["struct_size", "position", "normal", "point", "source", "target", "feature_size", "rays", "seed"],
);
const SOLVE_OPTIONS: Members = (
    "mrv_solve_options",
    &[
        "struct_size",
        "engine",
        "direct_only",
        "error",
        "target_error",
        "min_area",
        "max_seconds",
        "max_links",
        "seed",
        "feature_size",
        "feature_size_names",
        "feature_sizes",
        "feature_size_count",
        "importance",
        "importance_count",
        "progress",
        "user",
        "audit",
        "no_audit",
        "light_rays",
        "gather_rays",
    ],
);
const FORM_FACTOR_OPTIONS: Members = (
    "mrv_form_factor_options",
    &["struct_size", "grouping", "no_closure", "rays", "pair_rays", "max_bytes", "seed", "progress", "user"],
);
const BENCH_OPTIONS: Members = (
    "mrv_bench_options",
    &[
        "struct_size",
        "points",
        "rays",
        "reference_rays",
        "feature_sizes",
        "feature_size_count",
        "receivers",
        "receiver_count",
        "audit",
        "target_error",
        "target_seconds",
        "seed",
        "threads",
        "unbiased",
        "no_audit",
        "reserved",
        "progress",
        "user",
        "max_memory",
    ],
);
const REFERENCE_OPTIONS: Members =
    ("mrv_reference_options", &["struct_size", "seed", "samples", "direct_only", "progress", "user"]);
const IMAGE_OPTIONS: Members =
    ("mrv_image_options", &["struct_size", "width", "height", "gather", "reserved", "progress", "user"]);
const LIGHTMAP_OPTIONS: Members = ("mrv_lightmap_options", &["struct_size", "texels", "progress", "user"]);
const FBEM_IMAGES: Members = (
    "mrv_fbem_images",
    &[
        "struct_size",
        "reference",
        "approximation",
        "width",
        "height",
        "texel",
        "exponent",
        "white",
        "threshold",
        "features",
        "morphology",
        "unmasked_filter",
        "reserved",
    ],
);

/// Functions, their arguments that are records, and the members of these.
pub const RECORDS: &[(&str, &str, Members)] = &[
    ("mrv_scene_load", "options", LOAD),
    ("mrv_scene_from_memory", "options", LOAD),
    ("mrv_scene_generate_with", "options", GENERATE_OPTIONS),
    ("mrv_scene_builder_finish", "options", LOAD),
    ("mrv_scene_builder_add_object", "mesh", MESH),
    ("mrv_scene_builder_add_shared_mesh", "mesh", MESH),
    ("mrv_model_prepare", "options", PREPARE_OPTIONS),
    ("mrv_visibility_answer", "segments", SEGMENTS),
    ("mrv_visibility_answer", "answers", ANSWERS),
    ("mrv_visibility_query", "query", QUERY),
    ("mrv_model_solve", "options", SOLVE_OPTIONS),
    ("mrv_model_form_factors", "options", FORM_FACTOR_OPTIONS),
    ("mrv_model_bench", "options", BENCH_OPTIONS),
    ("mrv_model_reference", "options", REFERENCE_OPTIONS),
    ("mrv_solution_image", "options", IMAGE_OPTIONS),
    ("mrv_solution_lightmap", "options", LIGHTMAP_OPTIONS),
    ("mrv_fbem", "images", FBEM_IMAGES),
];

/// Words that have another name in C: function (empty: all), word of the crate, word of the header.
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

/// A message or warning of the crate, as the C function `name` gives it.
pub fn in_c(name: &str, text: &str) -> String {
    let own = |function: &str| function.is_empty() || function == name;
    let words = WORDS.iter().filter(|(function, ..)| own(function));
    let text = words.fold(text.to_owned(), |text, (_, from, to)| text.replace(from, to));
    let text = points_as_arrays(&text);
    let argument_of = |word: &str| {
        let mut records = RECORDS.iter().filter(|(function, ..)| *function == name);
        records.find(|(.., members)| members.1.contains(&word)).map(|(_, argument, _)| argument)
    };
    // A leading `max_links 0`.
    let leading = text.split_once(' ').and_then(|(word, rest)| {
        let value = rest.split([' ', ':']).next().unwrap_or_default();
        let argument = argument_of(word).filter(|_| value.parse::<f64>().is_ok())?;
        Some(format!("`{argument}.{word}` {rest}"))
    });
    let text = leading.unwrap_or(text);
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
        match argument_of(part) {
            Some(argument) => out += &format!("`{argument}.{part}`"),
            None if is_option && LOAD.1.contains(&part) => {
                out += &format!("`mrv_load_options.{part}`");
            }
            None if is_option => out += &format!("option `{part}`"),
            None => out += &format!("`{part}`"),
        }
    }
    // The last backtick of an odd number opens nothing.
    if text.matches('`').count() % 2 == 1 { text } else { out }
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
    use super::in_c;

    #[test]
    fn names_are_those_of_the_header() {
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
            ("mrv_scene_load", "no emitter `sofa`", "no emitter `sofa`"),
            ("mrv_scene_load", "an odd ` `threads`", "an odd ` `threads`"),
        ] {
            assert_eq!(in_c(function, text), want);
        }
    }
}
