//! The journal: one line of JSON for each job that ended, on disk before its outputs appear.

use super::folders::sync_up;
use super::hashes::HashedFile;
use super::job::Job;
use super::names::{FOLDER, fault};
use mrvis::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Component, Path, PathBuf};
use std::time::SystemTime;

/// Version of the journal's lines.
const VERSION: u32 = 2;

/// How a job ended.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// All outputs are there.
    Done,
    /// All outputs are there, but a stated tolerance was missed.
    Missed,
    /// There are no outputs.
    Failed,
    /// It was not run because a job that it needs failed; there are no outputs.
    Skipped,
}

/// A line of the journal.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Entry {
    /// Version of the line.
    pub version: u32,
    /// Name of the job.
    pub job: String,
    /// When it ended, seconds since 1970: of the last lines of several journals the latest counts.
    pub time: f64,
    /// See [`super::key`].
    pub key: String,
    /// How it ended.
    pub status: Status,
    /// The error of a failed job, or why it was skipped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Its place among the jobs of its file.
    pub index: usize,
    /// Columns of the table of results that say what the job is.
    pub about: serde_json::Map<String, serde_json::Value>,
    /// Its record in its folder; see [`super::CommandKind`].
    pub record: String,
    /// Its command line.
    pub command: String,
    /// Seconds.
    pub seconds: f64,
    /// Threads it ran on.
    pub threads: usize,
    /// 1 for the first run.
    pub attempt: u32,
    /// Largest resident size of a job that was a process of its own, bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_bytes: Option<u64>,
    /// All files that it read or looked for, with paths of [`super::Places`].
    pub inputs: Vec<HashedFile>,
    /// Fingerprints of the jobs that it needs; see [`Entry::fingerprint`].
    #[serde(default)]
    pub needs: Vec<String>,
    /// All files in its folder.
    pub outputs: Vec<HashedFile>,
    /// Whether a job without outputs has no folder any more: that of an earlier run was taken away.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub withdrawn: bool,
    /// Whether this run or an earlier one made the folder that may be in the place of the job.
    #[serde(skip)]
    pub made: bool,
}

impl Entry {
    /// Whether the job has outputs.
    pub fn has_outputs(&self) -> bool {
        matches!(self.status, Status::Done | Status::Missed)
    }

    /// See `made`, from whether earlier runs had made the folder.
    fn made_after(&self, former: bool) -> bool {
        self.has_outputs() || former && !self.withdrawn
    }

    /// A hash of all outputs: another one after the job has run again.
    pub fn fingerprint(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        for file in &self.outputs {
            hasher.update(file.blake3.as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }

    /// A line without files.
    pub fn new(index: usize, job: &Job, key: &str, status: Status, command: String) -> Entry {
        Entry {
            version: VERSION,
            job: job.name.clone(),
            time: SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_secs_f64(),
            index,
            about: job.about(),
            record: job.command.record.into(),
            key: key.into(),
            status,
            error: None,
            command,
            seconds: 0.0,
            threads: 0,
            attempt: 1,
            peak_bytes: None,
            inputs: Vec::new(),
            needs: Vec::new(),
            outputs: Vec::new(),
            withdrawn: false,
            made: matches!(status, Status::Done | Status::Missed),
        }
    }
}

/// The journal of an output folder, open for more lines.
pub struct Journal {
    path: PathBuf,
    file: File,
    /// Length up to the last whole line on disk.
    end: u64,
}

/// The last line of each job.
pub type Entries = HashMap<String, Entry>;

/// Contents of the journals of an output folder.
#[derive(Debug, Default)]
pub struct Journals {
    /// The last line of each job.
    pub entries: Entries,
    /// By damaged line, which is left out, its journal and what is wrong.
    pub damaged: Vec<Error>,
}

impl Journals {
    /// The lines, if all are whole.
    ///
    /// # Errors
    /// The first damaged line.
    pub fn whole(self) -> Result<Entries> {
        self.damaged.into_iter().next().map_or(Ok(self.entries), Err)
    }
}

/// Reads all journals of an output folder.
///
/// # Errors
/// A journal cannot be read, is of another version, or names files outside of the folder.
pub fn read_journals(out: &Path) -> Result<Journals> {
    let (mut entries, mut damaged) = (Entries::new(), Vec::new());
    for path in journals(out)? {
        let lines = read(&path)?;
        damaged.extend(lines.damaged);
        for (job, entry) in lines.entries {
            let former = entries.remove(&job);
            let made = entry.made || former.as_ref().is_some_and(|former| former.made);
            let last = former.filter(|former| former.time > entry.time).unwrap_or(entry);
            let made = last.made_after(made);
            entries.insert(job, Entry { made, ..last });
        }
    }
    Ok(Journals { entries, damaged })
}

/// Refuses a folder in which no batch has begun.
///
/// # Errors
/// It has no journal, or cannot be read.
pub fn check_has_journal(out: &Path) -> Result<()> {
    match journals(out)?.is_empty() {
        true => Err(Error::format(out, None, "is no output folder of a batch: it has no journal")),
        false => Ok(()),
    }
}

/// The journals of an output folder.
fn journals(out: &Path) -> Result<Vec<PathBuf>> {
    let folder = out.join(FOLDER);
    let list = match std::fs::read_dir(&folder) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        list => list.map_err(|e| Error::io(&folder, e))?,
    };
    let mut found = Vec::new();
    for entry in list {
        let path = entry.map_err(|e| Error::io(&folder, e))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        found.extend((name.starts_with("journal") && name.ends_with(".jsonl")).then_some(path));
    }
    found.sort();
    Ok(found)
}

/// The last line of each job, whatever the clock said.
fn read(path: &Path) -> Result<Journals> {
    let mut journals = Journals::default();
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    for (k, line) in bytes[..whole(&bytes)].split_inclusive(|b| *b == b'\n').enumerate() {
        let at = |what: String| Error::format(path, Some(k + 1), what);
        let value: serde_json::Result<serde_json::Value> = serde_json::from_slice(line);
        if let Some(version) = value.as_ref().ok().and_then(|v| v.get("version")).filter(|v| **v != VERSION) {
            return Err(at(format!(
                "is of version {version}, this program writes {VERSION}: choose another output folder, or the program that wrote it"
            )));
        }
        let mut entry: Entry = match value.and_then(serde_json::from_value) {
            Ok(entry) => entry,
            Err(_) => {
                let what = "is damaged; remove the line, then run the batch again for its job";
                journals.damaged.push(at(what.into()));
                continue;
            }
        };
        let inside = |path: &Path| path.components().all(|c| matches!(c, Component::Normal(_)));
        let outputs = entry.outputs.iter().map(|file| Path::new(&file.path));
        if fault(&entry.job).is_some() || !outputs.chain([Path::new(&entry.record)]).all(inside) {
            return Err(at(
                "names files outside of the output folder; remove the line to run its job again".into()
            ));
        }
        let former = journals.entries.get(&entry.job);
        entry.made = entry.made_after(former.is_some_and(|former| former.made));
        journals.entries.insert(entry.job.clone(), entry);
    }
    Ok(journals)
}

/// The length of a journal up to the last whole line. One that is not whole is the last and was being written when the program or the
/// machine stopped.
fn whole(bytes: &[u8]) -> usize {
    bytes.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1)
}

impl Journal {
    /// Opens the journal `name` of an output folder for more lines and cuts off a line that is not whole.
    ///
    /// # Errors
    /// It cannot be read or written.
    pub fn open(out: &Path, name: &str) -> Result<Journal> {
        let path = out.join(FOLDER).join(name);
        let at = |e| Error::io(&path, e);
        let mut options = File::options();
        let file = options.create(true).truncate(false).read(true).write(true).open(&path).map_err(at)?;
        let end = whole(&std::fs::read(&path).map_err(at)?) as u64;
        // The name of a new journal is on disk before its lines are.
        sync_up(&path, out)?;
        Ok(Journal { path, file, end })
    }

    /// Writes lines and waits until they are on disk.
    ///
    /// # Errors
    /// [`Error::Io`], and the file is then as before.
    pub fn append(&mut self, entries: &[&Entry]) -> Result<()> {
        let mut text = Vec::new();
        for entry in entries {
            serde_json::to_writer(&mut text, entry)
                .map_err(|e| Error::format(&self.path, None, e.to_string()))?;
            text.push(b'\n');
        }
        let written = self.file.set_len(self.end).and_then(|()| {
            self.file.seek(SeekFrom::Start(self.end))?;
            self.file.write_all(&text)?;
            self.file.sync_data()
        });
        match written {
            Ok(()) => self.end += text.len() as u64,
            Err(_) => drop(self.file.set_len(self.end)),
        }
        written.map_err(|e| Error::io(&self.path, e))
    }
}

#[cfg(test)]
mod tests {
    use super::super::job::{COMMANDS, Limits};
    use super::*;

    fn entry(job: &str) -> Entry {
        let job = Job {
            name: job.into(),
            command: &COMMANDS[0],
            inputs: Vec::new(),
            options: Vec::new(),
            tags: Vec::new(),
            after: Vec::new(),
            needs: Vec::new(),
            limits: Limits::default(),
            retry: 0,
            span: 0..0,
        };
        Entry::new(0, &job, "k", Status::Done, "mrvis".into())
    }

    fn entries(out: &Path) -> Entries {
        read_journals(out).and_then(Journals::whole).expect("read")
    }

    #[test]
    fn a_half_line_is_ignored_and_replaced() {
        let out = tempfile::tempdir().expect("a folder");
        std::fs::create_dir(out.path().join(FOLDER)).expect("made");
        let mut journal = Journal::open(out.path(), "journal.jsonl").expect("opened");
        journal.append(&[&entry("a"), &entry("b")]).expect("written");
        let path = out.path().join(FOLDER).join("journal.jsonl");
        let text = std::fs::read_to_string(&path).expect("read");
        let line = text.lines().next().expect("a line");
        // Wherever the last line was cut, the others count.
        for cut in 0..line.len() {
            std::fs::write(&path, format!("{text}{}", &line[..cut])).expect("written");
            assert_eq!(entries(out.path()).len(), 2);
        }
        Journal::open(out.path(), "journal.jsonl").expect("opened").append(&[&entry("c")]).expect("written");
        assert_eq!(entries(out.path()).len(), 3);
    }

    #[test]
    fn the_last_line_of_a_job_counts_whatever_the_clock_said() {
        let out = tempfile::tempdir().expect("a folder");
        std::fs::create_dir(out.path().join(FOLDER)).expect("made");
        let at = |status, time| Entry { status, time, ..entry("a") };
        let mut own = Journal::open(out.path(), "journal.jsonl").expect("opened");
        own.append(&[&at(Status::Done, 20.0), &at(Status::Failed, 10.0)]).expect("written");
        let status = || entries(out.path())["a"].status;
        assert_eq!(status(), Status::Failed, "the clock was set back");
        // Of several journals the latest last line counts.
        let mut part = Journal::open(out.path(), "journal-1of2.jsonl").expect("opened");
        part.append(&[&at(Status::Missed, 15.0)]).expect("written");
        assert_eq!(status(), Status::Missed);
        let made = || entries(out.path())["a"].made;
        assert!(made());
        part.append(&[&at(Status::Failed, 30.0)]).expect("written");
        assert!(made(), "its folder may still be there");
        part.append(&[&Entry { withdrawn: true, ..at(Status::Failed, 40.0) }]).expect("written");
        assert!(!made(), "a folder that is there now is not that of the job");
    }

    #[test]
    fn lines_of_foreign_files_are_refused() {
        let out = tempfile::tempdir().expect("a folder");
        std::fs::create_dir(out.path().join(FOLDER)).expect("made");
        let path = out.path().join(FOLDER).join("journal-1of2.jsonl");
        for change in [
            |e: &mut Entry| e.job = "../victim".into(),
            |e: &mut Entry| e.job = "/victim".into(),
            |e: &mut Entry| e.record = "../victim.json".into(),
            |e: &mut Entry| {
                e.outputs = vec![HashedFile {
                    path: "/victim".into(),
                    bytes: 1,
                    blake3: String::new(),
                    changed: None,
                }];
            },
        ] {
            let mut line = entry("a");
            change(&mut line);
            let text = serde_json::to_string(&line).expect("a line");
            std::fs::write(&path, text + "\n").expect("written");
            let found = read_journals(out.path()).and_then(Journals::whole).expect_err("refused").to_string();
            assert!(found.contains("names files outside of the output folder"), "{found}");
        }
        assert!(entries(&out.path().join("missing")).is_empty());
    }
}
