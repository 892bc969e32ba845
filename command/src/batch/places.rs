//! Paths of inputs in journals: the same after the folder of a project has been moved, and from any working folder.

use std::path::{Path, PathBuf};

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
