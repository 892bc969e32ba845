//! Hashes of inputs, and the key by which a finished job is recognised.

use super::job::{Job, Value};
use mrvis::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

/// Replaces the hash of a file that cannot be read, so that a file that appears later counts as a change.
const UNREADABLE: &str = "unreadable";

/// A file with its content.
#[derive(Clone, Debug, Deserialize, PartialEq, Eq, Serialize)]
pub struct HashedFile {
    /// Its path: of inputs as the program reads them, in journals as [`super::Places`] keeps them; of outputs relative to the folder of
    /// the job.
    pub path: PathBuf,
    /// Size.
    pub bytes: u64,
    /// BLAKE3 of the content, hexadecimal; `unreadable` for an input that is missing or cannot be read.
    pub blake3: String,
    /// Of outputs: when the system last noted a change, nanoseconds since 1970 (`ctime`, which programs cannot set). With the same size and
    /// time a file has its content still, so that outputs are read again only where they were copied or changed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub changed: Option<i64>,
}

/// Size and time of modification, by which a replaced file is recognised without reading it while the batch runs.
type Stamp = (u64, Option<SystemTime>);

fn stamp(about: &Metadata) -> Stamp {
    (about.len(), about.modified().ok())
}

/// Hashes of files, each computed once as long as its size and time stay the same while the batch runs.
#[derive(Default)]
pub struct Hashes {
    known: Mutex<HashMap<PathBuf, (Stamp, String)>>,
}

impl Hashes {
    /// The file with its hash, also if it cannot be read.
    pub fn of(&self, path: &Path) -> HashedFile {
        let unreadable =
            |_| HashedFile { path: path.into(), bytes: 0, blake3: UNREADABLE.into(), changed: None };
        self.read(path).unwrap_or_else(unreadable)
    }

    /// The file with its hash.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read or is no regular file.
    pub fn read(&self, path: &Path) -> Result<HashedFile> {
        let at = |e| Error::io(path, e);
        let about = std::fs::metadata(path).map_err(at)?;
        if !about.is_file() {
            return Err(at(std::io::ErrorKind::InvalidInput.into()));
        }
        let now = stamp(&about);
        let lock = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let known = lock().get(path).filter(|(stamp, _)| *stamp == now).map(|(_, hash)| hash.clone());
        let blake3 = match known {
            Some(hash) => hash,
            None => {
                let hash = hash_file(path)?;
                lock().insert(path.into(), (now, hash.clone()));
                hash
            }
        };
        Ok(HashedFile { path: path.into(), bytes: now.0, blake3, changed: None })
    }
}

/// BLAKE3 of a file, hexadecimal.
///
/// # Errors
/// [`Error::Io`] if it cannot be read.
pub fn hash_file(path: &Path) -> Result<String> {
    let at = |e| Error::io(path, e);
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(std::fs::File::open(path).map_err(at)?).map_err(at)?;
    Ok(hasher.finalize().to_hex().to_string())
}

/// The key of a job: a hash of the programs, the command, its options, the files they name and the keys of jobs whose outputs it reads.
/// Paths are those of the job file, so that the key is the same from any working folder.
pub fn key(program: &str, job: &Job, files: &[HashedFile], needs: &[&str]) -> String {
    let mut hasher = blake3::Hasher::new();
    // Lengths in front keep fields apart.
    let mut add = |text: &str| {
        hasher.update(&(text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    };
    add(program);
    add(job.command.name);
    job.inputs.iter().for_each(|input| add(input));
    for option in &job.options {
        add(&option.name);
        match &option.value {
            Value::Flag(set) => add(if *set { "+" } else { "-" }),
            Value::Text(text) => add(text),
            Value::List(list) => list.iter().for_each(|text| add(text)),
        }
    }
    add("files");
    files.iter().for_each(|file| add(&file.blake3));
    add("needs");
    needs.iter().for_each(|key| add(key));
    hasher.finalize().to_hex().to_string()
}
