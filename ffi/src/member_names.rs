//! C names of the options and arguments of the crate, for messages: the crate's `origins` are a member of the record that the call has
//! read, `segments.origins`.

use mrvis::internals::error::parts_of;
use smallvec::SmallVec;
use std::cell::RefCell;

/// Names of the members of a record.
pub type Members = &'static [&'static str];

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

/// Words that differ in the header: the crate's word, that of the header.
const WORDS: [(&str, &str); 7] = [
    ("Detail::Optics", "MRV_DETAIL_OPTICS"),
    ("Detail::Clusters", "MRV_DETAIL_CLUSTERS"),
    ("Detail::Rays", "MRV_DETAIL_RAYS"),
    ("Engine::MultiResolution", "MRV_ENGINE_MULTI_RESOLUTION"),
    ("Engine::Average", "MRV_ENGINE_AVERAGE"),
    ("Scene::flattened", "the scene of mrv_scene_flatten"),
    ("size", "`options.width`, `options.height`"),
];

/// Members whose names differ: the crate's name, that of the header.
const MEMBERS: [(&str, &str); 4] = [
    ("bundles", "offsets"),
    ("to_source", "source"),
    ("to_point", "point"),
    ("feature_size", "feature_sizes"),
];

/// C name of an option or argument of the crate, in the running call or in another one.
pub fn c_name(name: &str) -> String {
    if let Some((_, word)) = WORDS.iter().find(|(own, _)| *own == name) {
        return (*word).into();
    }
    let (base, entry) = parts_of(name);
    // Points are one array in Rust and two in C.
    let (base, entry) = match entry.split_once("].") {
        Some((index, part)) if base == "points" => (format!("{part}s"), format!("{index}]")),
        _ => (base.to_owned(), entry.to_owned()),
    };
    let load_option = base.strip_prefix("LoadOptions::");
    let member = load_option.unwrap_or(&base);
    let others = MEMBERS.iter().filter(|(own, _)| *own == member).map(|(_, other)| *other);
    let in_record = |member| argument_of(member).map(|argument| format!("{argument}.{member}"));
    let found = std::iter::once(member).chain(others).find_map(in_record);
    let whole = found.or_else(|| load_option.map(|option| format!("mrv_load_options.{option}")));
    format!("`{}`{entry}", whole.unwrap_or(base))
}

/// The record with the member `word` among those of the running call.
fn argument_of(word: &str) -> Option<&'static str> {
    let found = RECORDS.try_with(|records| {
        let records = records.borrow();
        let is_it = |(_, members): &&(&str, Members)| members.contains(&word);
        records.iter().find(is_it).map(|(argument, _)| *argument)
    });
    found.ok().flatten()
}

#[cfg(test)]
mod tests {
    use super::{Members, Records, c_name, exchange_records};

    #[test]
    fn names_are_those_of_the_header() {
        let records: [(&str, Members); 2] = [
            ("segments", &["origins", "targets", "offsets"]),
            ("options", &["max_links", "feature_sizes", "unit"]),
        ];
        exchange_records(Records::from_iter(records));
        for (name, want) in [
            ("bundles", "`segments.offsets`"),
            ("targets[3]", "`segments.targets`[3]"),
            ("max_links", "`options.max_links`"),
            ("feature_size", "`options.feature_sizes`"),
            ("LoadOptions::unit", "`options.unit`"),
            ("LoadOptions::emitters", "`mrv_load_options.emitters`"),
            ("points[7].normal", "`normals`[7]"),
            ("changes[2].instance", "`changes`[2].instance"),
            ("Engine::Average", "MRV_ENGINE_AVERAGE"),
            ("folder", "`folder`"),
        ] {
            assert_eq!(c_name(name), want);
        }
    }
}
