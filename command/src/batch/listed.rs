//! The jobs whose lines in the journals count: those of the job file as it was when the last batch began.
//!
//! Journals keep the lines of all runs, also of values that a sweep does not have any more. Each batch lists the names and keys of all jobs
//! of its file in a small file of the output folder; the page and merged tables leave the lines of other jobs out.

use super::folders::wait_for_lock;
use super::journal::{Entry, Journals, read_journals};
use super::names::FOLDER;
use mrvis::internals::files::WholeFile;
use mrvis::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Name of the list below the batch's own folder.
const NAME: &str = "jobs.json";

/// Names and keys of jobs.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Eq, Serialize)]
pub struct Listed {
    /// By hash of a job file and its inputs. Machines with other versions of the program have other keys for the same job.
    files: BTreeMap<String, BTreeSet<(String, String)>>,
}

impl Listed {
    /// The jobs of the file with this hash.
    pub fn new(file: &str, jobs: impl Iterator<Item = (String, String)>) -> Listed {
        Listed { files: BTreeMap::from([(file.into(), jobs.collect())]) }
    }

    /// Whether a line of a journal is about one of these jobs.
    pub fn has(&self, entry: &Entry) -> bool {
        let job = (entry.job.clone(), entry.key.clone());
        self.files.values().any(|jobs| jobs.contains(&job))
    }

    /// Names of all jobs.
    pub fn names(&self) -> BTreeSet<&str> {
        self.files.values().flatten().map(|(name, _)| name.as_str()).collect()
    }

    /// Adds the jobs of `other`.
    pub fn add(&mut self, other: Listed) {
        for (file, jobs) in other.files {
            self.files.entry(file).or_default().extend(jobs);
        }
    }

    /// Adds the jobs that `other` has of the same job files.
    pub fn add_same_files(&mut self, other: Listed) {
        for (file, jobs) in other.files {
            self.files.entry(file).and_modify(|own| own.extend(jobs));
        }
    }

    /// Writes the list of an output folder.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, out: &Path) -> Result<()> {
        let path = out.join(FOLDER).join(NAME);
        let text = serde_json::to_string(self).map_err(|e| Error::format(&path, None, e.to_string()))?;
        WholeFile::write(&path, text)
    }

    /// Writes the list of an output folder for a part of a batch. Jobs of the same file that other parts have listed stay.
    ///
    /// # Errors
    /// The list cannot be read or written.
    pub fn write_part(mut self, out: &Path) -> Result<()> {
        let _lock = wait_for_lock(out, "list-lock")?;
        self.add_same_files(read(out)?.unwrap_or_default());
        self.write(out)
    }
}

/// The list of an output folder; none before its first batch.
fn read(out: &Path) -> Result<Option<Listed>> {
    let path = out.join(FOLDER).join(NAME);
    match std::fs::read(&path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(Error::io(path, e)),
        Ok(bytes) => serde_json::from_slice(&bytes).map(Some).map_err(|e| {
            Error::format(path, None, format!("is damaged ({e}); remove it and run the batch again"))
        }),
    }
}

/// The lines of the journals of an output folder that count, and its list.
///
/// # Errors
/// A journal or the list cannot be read. The list of a folder with jobs is missing: the result would leave out jobs that have not run.
pub fn read_listed(out: &Path) -> Result<(Journals, Listed)> {
    let mut journals = read_journals(out)?;
    let listed = match read(out)? {
        Some(listed) => listed,
        None if journals.entries.is_empty() && journals.damaged.is_empty() => Listed::default(),
        None => {
            let path = out.join(FOLDER).join(NAME);
            let what = "is missing: it lists the jobs of the batch; run the batch again";
            return Err(Error::format(path, None, what));
        }
    };
    journals.entries.retain(|_, entry| listed.has(entry));
    Ok((journals, listed))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list(file: &str, jobs: &[(&str, &str)]) -> Listed {
        Listed::new(file, jobs.iter().map(|(name, key)| ((*name).into(), (*key).into())))
    }

    #[test]
    fn parts_of_one_file_share_the_list() {
        let out = tempfile::tempdir().expect("a folder");
        let found = || read(out.path()).expect("read");
        assert_eq!(found(), None);
        list("old", &[("a", "1")]).write_part(out.path()).expect("written");
        list("new", &[("a", "2")]).write_part(out.path()).expect("written");
        // A machine with another version of the program.
        list("new", &[("a", "3")]).write_part(out.path()).expect("written");
        assert_eq!(found(), Some(list("new", &[("a", "2"), ("a", "3")])));
        std::fs::write(out.path().join(FOLDER).join(NAME), "{").expect("written");
        let refused = read(out.path()).expect_err("refused").to_string();
        assert!(refused.contains("jobs.json") && refused.contains("run the batch again"), "{refused}");
    }
}
