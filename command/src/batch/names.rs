//! Names: of the batch's own folder, of jobs, and the nearest known one of a misspelled key.

use std::path::{Component, Path};

/// Folder of the batch below its output folder: journals, lock and unfinished jobs.
pub const FOLDER: &str = ".mrvis-batch";

/// Tables of all jobs in the output folder.
pub const TABLES: [&str; 2] = ["results.csv", "results.jsonl"];

/// Similarity (Jaro-Winkler) from which a known name is suggested: that of clap for options and commands.
const MIN_SIMILARITY: f64 = 0.7;

/// A sentence that suggests the known name that is most similar to an unknown one, empty if none is similar.
pub fn suggestion<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let similar = known.into_iter().map(|k| (strsim::jaro_winkler(name, k), k));
    let nearest =
        similar.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(similarity, _)| *similarity >= MIN_SIMILARITY);
    nearest.map_or(String::new(), |(_, k)| format!("; did you mean `{k}`?"))
}

/// Why a job cannot have this name, which is that of its folder.
pub fn fault(name: &str) -> Option<String> {
    let path = Path::new(name);
    if name.is_empty() || name.len() > 200 {
        return Some("must have 1 to 200 characters".into());
    }
    if let Some(c) = name.chars().find(|c| c.is_control() || "\\:*?\"<>|{}".contains(*c)) {
        return Some(format!(
            "has `{}`, which is not valid in names of folders everywhere",
            c.escape_default()
        ));
    }
    let inside = path.components().all(|c| matches!(c, Component::Normal(_)));
    if !inside || name.contains("//") || name.ends_with('/') || name.split('/').any(|part| part == ".") {
        return Some("leaves the output folder, or is no plain path below it".into());
    }
    let first = name.split('/').next().unwrap_or_default();
    // Some file systems do not distinguish cases.
    let is_own = |own: &&'static str| own.eq_ignore_ascii_case(first);
    let own = [FOLDER, "report.html"].into_iter().chain(TABLES).find(is_own);
    own.map(|own| format!("begins with `{own}`, a file or folder of the batch itself"))
}

/// A value as a part of a name: other characters than letters, digits and `-_.+=,` become `_`.
pub fn plain(value: &str) -> String {
    let valid = |c: char| if c.is_alphanumeric() || "-_.+=,".contains(c) { c } else { '_' };
    value.chars().map(valid).collect()
}
