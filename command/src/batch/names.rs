//! Paths of inputs in journals, the same after the folder of a project has been moved; and names: of the batch's
//! own folder, of jobs, and the nearest known one of a misspelled key.

use std::path::{Component, Path, PathBuf};

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

/// Begins paths in the output folder of the batch.
const OUT: &str = "{out}";

/// The folders that paths in journals are relative to.
#[derive(Clone, Debug)]
pub struct Places {
    /// The folder of the job file.
    pub jobs: PathBuf,
    /// The output folder.
    pub out: PathBuf,
}

impl Places {
    /// The path of a journal for a path as the program reads it: relative to the output folder, else to that of the job file; absolute if
    /// the file is in neither.
    pub fn stored(&self, path: &Path) -> PathBuf {
        if let Ok(rest) = path.strip_prefix(&self.out) {
            return Path::new(OUT).join(rest);
        }
        match path.strip_prefix(&self.jobs) {
            Ok(rest) => rest.into(),
            // Without a working folder no relative path can be read either.
            Err(_) => std::path::absolute(path).unwrap_or_else(|_| path.into()),
        }
    }

    /// The path as the program reads it.
    pub fn found(&self, stored: &Path) -> PathBuf {
        match stored.strip_prefix(OUT) {
            Ok(rest) => self.out.join(rest),
            Err(_) => self.jobs.join(stored),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_move_with_their_folders() {
        for (jobs, out, path, want) in [
            ("", "out", "rooms/a.obj", "rooms/a.obj"),
            ("", "out", "/rooms/a.obj", "/rooms/a.obj"),
            ("", "out", "out/gen/a.obj", "{out}/gen/a.obj"),
            ("", ".", "rooms/a.obj", "rooms/a.obj"),
            ("project/", "project/out", "project/../rooms/a.obj", "../rooms/a.obj"),
            ("project", "project/out", "project/out/gen/a.obj", "{out}/gen/a.obj"),
            ("/home/project", "/tmp/out", "/home/project/a.obj", "a.obj"),
            ("/home/project", "/tmp/out", "/rooms/a.obj", "/rooms/a.obj"),
        ] {
            let places = Places { jobs: jobs.into(), out: out.into() };
            assert_eq!(places.stored(Path::new(path)), Path::new(want), "{path}");
            assert_eq!(places.found(Path::new(want)), Path::new(path), "{path}");
        }
        let places = Places { jobs: "project".into(), out: "project/out".into() };
        assert!(places.stored(Path::new("rooms/a.obj")).is_absolute());
    }
}
