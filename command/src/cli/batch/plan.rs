//! Plan of a batch: jobs with their command lines, checked before any job starts.

use super::command_line::{Grammar, Line};
use super::estimates::{Corrections, Estimate};
use crate::batch::{
    Entries, Entry, HashedFile, Hashes, Job, Listed, Places, Status, TomlSource, check, expand, hash_file,
    key, order, parse, publish_left, read_journals, suggestion, work,
};
use crate::cli::one_line;
use mrvis::internals::error::quote;
use mrvis::internals::math::Sets;
use mrvis::internals::model::embree_version;
use mrvis::internals::plot::number;
use mrvis::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A checked batch.
pub struct Plan {
    /// Output folder.
    pub out: PathBuf,
    /// Folders to which paths in journals are relative.
    pub places: Places,
    /// All jobs of the file.
    pub jobs: Vec<Job>,
    /// Their command lines, which write into work folders.
    pub lines: Vec<Line>,
    /// The command lines as a user would write them.
    pub shown: Vec<String>,
    /// Keys of the jobs; see [`key`].
    pub keys: Vec<String>,
    /// The names and keys of all jobs for the output folder.
    pub listed: Listed,
    /// Files that the command lines name.
    pub inputs: Vec<Vec<HashedFile>>,
    /// Estimated memory and time of the jobs.
    pub estimates: Vec<Estimate>,
    /// Indices of the jobs to be run, in an order that dependencies allow.
    pub chosen: Vec<usize>,
}

/// Results of earlier runs.
pub struct Earlier {
    /// The last line of each job.
    pub entries: Entries,
    /// By job, whether it is done.
    pub done: Vec<bool>,
    /// Jobs whose outputs have changed since they were written, and how.
    pub spoilt: Vec<(usize, String)>,
}

impl Plan {
    /// Reads a job file and checks all of it.
    ///
    /// # Errors
    /// With file, line and column.
    pub fn new(path: &Path, out: &Path, only: &[String], hashes: &Hashes) -> Result<Plan> {
        let source = TomlSource::read(path)?;
        let mut jobs = expand(&source, &parse(&source)?)?;
        check(&source, &mut jobs)?;
        let (grammar, count) = (Grammar::new(), jobs.len());
        grammar.drop_foreign_defaults(&source, &mut jobs)?;
        let (mut lines, mut shown) = (Vec::new(), Vec::new());
        let (mut inputs, mut estimates) = (Vec::new(), Vec::new());
        for job in &mut jobs {
            let line = grammar.line(&source, job, out, &work(out, &job.name))?;
            Grammar::fix_camera(job, &line);
            let line = grammar.line(&source, job, out, &work(out, &job.name))?;
            let command = grammar.check(&source, job, &line)?;
            shown.push(grammar.line(&source, job, out, &out.join(&job.name))?.shown());
            estimates.push(Estimate::of(job, &line, &command));
            inputs.push(line.files.iter().map(|file| hashes.read(file)).collect::<Result<Vec<_>>>()?);
            lines.push(line);
        }
        let (wanted, order) = (selected(&jobs, only)?, order(&jobs));
        let programs = programs()?;
        let keys_of = |programs: &str| {
            let mut keys = vec![String::new(); count];
            for &k in &order {
                let needs: Vec<&str> = jobs[k].needs.iter().map(|&need| keys[need].as_str()).collect();
                keys[k] = key(programs, &jobs[k], &inputs[k], &needs);
            }
            keys
        };
        let keys = keys_of(&programs);
        let names = || jobs.iter().map(|job| job.name.clone());
        // Parts of a batch on machines with other versions of the program have the same job file.
        let file = names().zip(keys_of("")).fold(blake3::Hasher::new(), |mut hasher, (name, key)| {
            hasher.update(format!("{name}\n{key}\n").as_bytes());
            hasher
        });
        let listed = Listed::new(&file.finalize().to_hex(), names().zip(keys.iter().cloned()));
        let chosen = order.into_iter().filter(|k| wanted.contains(k)).collect();
        let places = Places { jobs: source.folder().into(), out: out.into() };
        Ok(Plan { out: out.into(), places, jobs, lines, shown, keys, listed, inputs, estimates, chosen })
    }

    /// Memory of a job, bytes: that of an earlier run as a process of its own, else an estimate if its scene is there.
    pub fn memory(&self, job: usize, entries: &Entries) -> Option<u64> {
        let known = entries.get(&self.jobs[job].name).and_then(|entry| entry.peak_bytes);
        known.or(self.estimates[job].memory)
    }

    /// Seconds that an earlier run of a job took.
    fn seconds(&self, job: usize, entries: &Entries) -> Option<f64> {
        let ran = entries.get(&self.jobs[job].name).filter(|entry| entry.status != Status::Skipped);
        ran.map(|entry| entry.seconds)
    }

    /// Expected seconds of all jobs, which determine the order of their starts and the time left: those of an earlier run, else an estimate
    /// for this number of threads, or 0 without one.
    pub fn work(&self, entries: &Entries, threads: usize) -> Vec<f64> {
        let corrections = Corrections::of(&self.jobs, &self.estimates, entries);
        let estimated = |k: usize| corrections.seconds(&self.jobs[k], &self.estimates[k], threads);
        let expected = |k: usize| self.seconds(k, entries).or_else(|| estimated(k)).unwrap_or(0.0);
        (0..self.jobs.len()).map(expected).collect()
    }

    /// Fingerprints of the jobs that a job needs.
    pub fn fingerprints(&self, job: usize, entries: &Entries) -> Vec<String> {
        let needs = self.jobs[job].needs.iter();
        needs.filter_map(|&need| Some(entries.get(&self.jobs[need].name)?.fingerprint())).collect()
    }

    /// The line of a job that would make the same outputs again.
    fn current<'a>(&self, job: usize, entries: &'a Entries, hashes: &Hashes) -> Option<&'a Entry> {
        let entry = entries.get(&self.jobs[job].name).filter(|e| e.key == self.keys[job])?;
        let same = |file: &HashedFile| {
            let now = hashes.of(&self.places.found(&file.path));
            (now.bytes, &now.blake3) == (file.bytes, &file.blake3)
        };
        let is_current = entry.has_outputs()
            && entry.inputs.iter().all(same)
            && entry.needs == self.fingerprints(job, entries);
        is_current.then_some(entry)
    }

    /// What earlier runs have done. Finishes what a crash left between the journal and the renaming of a folder, if it may.
    ///
    /// # Errors
    /// A journal cannot be read.
    pub fn earlier(&self, hashes: &Hashes, may_finish: bool) -> Result<Earlier> {
        let entries = read_journals(&self.out)?.whole()?;
        let (mut done, mut spoilt) = (vec![false; self.jobs.len()], Vec::new());
        for &k in &self.chosen {
            // Outputs of a job that runs again are new inputs.
            if !self.jobs[k].needs.iter().all(|&need| done[need]) {
                continue;
            }
            let Some(entry) = self.current(k, &entries, hashes) else { continue };
            match publish_left(&self.out, &entry.job, &entry.outputs, may_finish) {
                Ok(()) => done[k] = true,
                Err(what) => spoilt.push((k, what)),
            }
        }
        Ok(Earlier { entries, done, spoilt })
    }

    /// The lines of the journal that are about jobs of this file as it is now: those of jobs that had other options are left out.
    pub fn own_entries<'a>(&'a self, entries: &'a Entries) -> impl Iterator<Item = &'a Entry> {
        let own = self.jobs.iter().zip(&self.keys);
        own.filter_map(|(job, key)| entries.get(&job.name).filter(|entry| entry.key == *key))
    }

    /// Refuses to replace folders that no batch made.
    ///
    /// # Errors
    /// [`Error::File`] with the folders.
    pub fn check_folders(&self, entries: &Entries, done: &[bool]) -> Result<()> {
        /// Largest number of folders that a message names: it fits a screen of 80 x 24.
        const MAX_NAMES: usize = 20;
        let made = |name: &str| entries.get(name).is_some_and(|entry| entry.made);
        let names = self.chosen.iter().filter(|&&k| !done[k]).map(|&k| self.jobs[k].name.as_str());
        let foreign: Vec<&str> =
            names.filter(|name| !made(name) && self.out.join(name).symlink_metadata().is_ok()).collect();
        let Some((first, others)) = foreign.split_first() else { return Ok(()) };
        let what = "exists and was not made by this batch, as far as its journal says";
        let cure = "or choose another output folder";
        let what = match others {
            [] => format!("{what}; remove it, {cure}"),
            _ => {
                let named = others.iter().take(MAX_NAMES).copied().collect::<Vec<_>>().join(", ");
                let more = if others.len() > MAX_NAMES { ", ..." } else { "" };
                format!("{what}, as do {} more: {named}{more}; remove them, {cure}", others.len())
            }
        };
        Err(Error::format(self.out.join(first), None, what))
    }

    /// The chosen jobs as text, with estimates for this number of threads.
    pub fn listed(&self, earlier: &Earlier, threads: usize) -> String {
        let Earlier { entries, done, spoilt } = earlier;
        let mut text = String::new();
        let work = self.work(entries, threads);
        for &k in &self.chosen {
            let memory = self.memory(k, entries).map(|b| format!("{} MB", b.div_ceil(1_000_000)));
            let seconds = match self.seconds(k, entries) {
                Some(seconds) => Some(format!("{seconds:.1} s in an earlier run")),
                None => (work[k] > 0.0).then(|| format!("about {} s", rounded(work[k]))),
            };
            let what = spoilt.iter().find(|(job, _)| *job == k).map(|(_, what)| format!(" again: {what}"));
            let state = if done[k] { "done".into() } else { format!("to do{}", what.unwrap_or_default()) };
            let known: Vec<String> = [Some(state), memory, seconds].into_iter().flatten().collect();
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{} [{}]\n  {}", self.jobs[k].name, known.join(", "), self.shown[k]);
        }
        let left: Vec<usize> = self.chosen.iter().copied().filter(|&k| !done[k]).collect();
        let _ = write!(text, "{} of {} jobs, {} to do", self.chosen.len(), self.jobs.len(), left.len());
        let seconds: f64 = left.iter().map(|&k| work[k]).sum();
        if seconds > 0.0 {
            let _ = write!(text, ", about {} s", rounded(seconds));
        }
        text + "\n"
    }
}

/// Part of a job's key that identifies the programs: version and hash of this one, and the version of Embree, which is a separate
/// library file.
fn programs() -> Result<String> {
    let path = std::env::current_exe().map_err(|e| Error::io("this program", e))?;
    let hash = hash_file(&path).map_err(|e| Error::Unsupported(one_line(&e)))?;
    Ok(format!("{} {hash} Embree {}", env!("CARGO_PKG_VERSION"), embree_version()?))
}

/// An estimate of a time with one digit, or in whole seconds.
fn rounded(seconds: f64) -> String {
    if seconds < 10.0 {
        number(format!("{seconds:.0e}").parse().unwrap_or(seconds))
    } else {
        format!("{seconds:.0}")
    }
}

/// The jobs with these tags or names, and all that they need; all jobs without a choice.
fn selected(jobs: &[Job], only: &[String]) -> Result<BTreeSet<usize>> {
    if only.is_empty() {
        return Ok((0..jobs.len()).collect());
    }
    let mut waiting = Vec::new();
    for wanted in only {
        let is_meant = |job: &Job| job.name == *wanted || job.tags.contains(wanted);
        let before = waiting.len();
        waiting.extend((0..jobs.len()).filter(|&k| is_meant(&jobs[k])));
        if waiting.len() == before {
            let known = jobs.iter().flat_map(|job| job.tags.iter().chain([&job.name])).map(String::as_str);
            let similar = suggestion(wanted, known);
            return Err(Error::arguments(format!(
                "--only {}: no job has this tag or name{similar}",
                quote(wanted)
            )));
        }
    }
    let mut chosen = BTreeSet::new();
    while let Some(k) = waiting.pop() {
        if chosen.insert(k) {
            waiting.extend(&jobs[k].needs);
        }
    }
    Ok(chosen)
}

/// One part of several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 1.
    part: usize,
    of: usize,
}

/// Largest number of parts: a part has a journal of its own, and all are read at the start.
const MAX_PARTS: usize = 10_000;

/// The value of `--shard`.
pub fn read_shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    let shard = numbers.map(|(part, of)| Shard { part, of });
    shard
        .filter(|s| (1..=MAX_PARTS).contains(&s.of) && (1..=s.of).contains(&s.part))
        .ok_or_else(|| "a part and the number of parts, such as 2/8".into())
}

impl Shard {
    /// Number of parts.
    pub fn parts(self) -> usize {
        self.of
    }

    /// Ending of the names of its journal and its lock.
    pub fn suffix(self) -> String {
        format!("-{}of{}", self.part, self.of)
    }

    /// The chosen jobs of this part. Jobs that need each other are in one part; these groups are dealt out in turn.
    pub fn jobs(self, jobs: &[Job], chosen: &[usize]) -> Vec<usize> {
        let mut linked = Sets::new(jobs.len());
        for &k in chosen {
            jobs[k].needs.iter().for_each(|&need| linked.join(k as u32, need as u32));
        }
        let mut parts = BTreeMap::new();
        let mut own = Vec::new();
        for &k in chosen {
            let groups = parts.len();
            let part = *parts.entry(linked.root(k as u32)).or_insert(groups % self.of);
            own.extend((part + 1 == self.part).then_some(k));
        }
        own
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{TomlSource, check, expand, parse as parse_file};

    #[test]
    fn parts_are_complete_and_keep_groups_together() {
        let text = "[[job]]\nname = 'a{count}'\ncommand = 'generate'\ninputs = 'cubes'\n\
                    [job.sweep]\ncount = [1, 2, 3, 4, 5]\n\
                    [[job]]\nname = 'i{seed}'\ncommand = 'info'\nscene = '{out:a{seed}}/scene.obj'\n[job.sweep]\nseed = [1, 2]\n";
        let source = TomlSource { path: "jobs.toml".into(), text: text.into() };
        let mut jobs = expand(&source, &parse_file(&source).expect("parsed")).expect("jobs");
        check(&source, &mut jobs).expect("checked");
        let chosen: Vec<usize> = (0..jobs.len()).collect();
        let part = |text: &str| read_shard(text).expect("a part").jobs(&jobs, &chosen);
        assert_eq!([part("1/2"), part("2/2")], [vec![0, 2, 4, 5], vec![1, 3, 6]]);
        assert_eq!(part("1/1"), chosen);
        for wrong in ["0/2", "3/2", "1", "1/0", "a/b", "1/20000"] {
            assert!(read_shard(wrong).is_err(), "{wrong}");
        }
    }
}
