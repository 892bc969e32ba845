//! Makes the outputs of finished jobs permanent: files to disk, a line in the journal, then the folder gets its place.
//!
//! All files and the line are on disk before the folder is renamed. After a crash between the two, the next run finds the folder complete
//! in the work folder and renames it. What goes wrong with the outputs of one job makes that job fail; others are kept.

use super::job_run::{JobResult, is_full};
use super::plan::Plan;
use crate::batch::{
    Entry, HashedFile, Hashes, Journal, Status, publish, remove, seal, sync_up, withdraw, work,
};
use crate::cli::one_line;
use mrvis::{Error, Result};
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender};

/// A job whose command has ended.
pub struct Finished {
    /// Its index.
    pub job: usize,
    /// 1 for the first run.
    pub attempt: u32,
    /// Its threads.
    pub threads: usize,
    /// Seconds.
    pub seconds: f64,
    /// How it ended.
    pub ended: JobResult,
    /// Fingerprints of the jobs that it needs.
    pub needs: Vec<String>,
}

/// A job that gets its line in the journal.
pub enum JobEnd {
    /// Its command has ended.
    Ran(Finished),
    /// It will not run, for this reason.
    Skipped(usize, String),
}

/// An event that the runner of a batch handles.
pub enum Event {
    /// The command of a job has ended.
    Ran(Finished),
    /// The outputs of jobs are permanent, or they failed.
    JournalLines(Vec<(usize, Entry)>),
    /// No more jobs may start; the number of jobs that ended without a line in the journal.
    Broken(Error, usize),
    /// All finished jobs are permanent.
    Closed,
}

/// Largest number of jobs that are made permanent together, each by a thread of its own, so that waits for a slow disk overlap: limits
/// these threads.
const MAX_GROUP: usize = 16;

/// Makes jobs permanent until the sender of `closing` is dropped. Those that wait at the same time share one write of the journal.
pub fn commit(
    plan: &Plan,
    hashes: &Hashes,
    mut journal: Journal,
    closing: &Receiver<JobEnd>,
    events: &Sender<Event>,
) {
    while let Ok(first) = closing.recv() {
        let group: Vec<JobEnd> =
            std::iter::once(first).chain(closing.try_iter().take(MAX_GROUP - 1)).collect();
        // File systems write at once what several threads force to disk at the same time.
        let lines: Vec<JournalLine> = std::thread::scope(|scope| {
            let sealing: Vec<_> = group.iter().map(|c| scope.spawn(|| line(plan, hashes, c))).collect();
            sealing.into_iter().map(|line| line.join().expect("sealing does not panic")).collect()
        });
        let count = lines.len();
        let (kept, full) = match keep(plan, &mut journal, lines) {
            Ok((kept, full)) => {
                let what = full.first().map(|what| Event::Broken(make_room(what), full.len()));
                (Event::JournalLines(kept), what)
            }
            Err(error) if is_full(&error) => (Event::Broken(make_room(&one_line(&error)), count), None),
            Err(error) => (Event::Broken(error, count), None),
        };
        for event in full.into_iter().chain([kept]) {
            // Without a receiver the batch has ended.
            let _ = events.send(event);
        }
    }
    let _ = events.send(Event::Closed);
}

/// The error of a batch that stops because a file could not be written for lack of space.
pub fn make_room(what: &str) -> Error {
    Error::arguments(format!(
        "{what}: make room and run the same command again, which goes on where it stopped"
    ))
}

/// The line of a job for the journal.
struct JournalLine {
    job: usize,
    entry: Entry,
    /// The error, if there was no space for its outputs: the job counts as not run.
    full: Option<String>,
}

impl JournalLine {
    /// The job has failed with this error.
    fn fail(&mut self, error: &Error) {
        let what = one_line(error);
        self.full = self.full.take().or(is_full(error).then(|| what.clone()));
        (self.entry.status, self.entry.error) = (Status::Failed, Some(what));
        (self.entry.inputs, self.entry.outputs) = Default::default();
    }
}

/// The line of a job, whose outputs are on disk.
fn line(plan: &Plan, hashes: &Hashes, closing: &JobEnd) -> JournalLine {
    let entry = |k: usize, status| Entry::new(k, &plan.jobs[k], &plan.keys[k], status, plan.shown[k].clone());
    match closing {
        JobEnd::Skipped(job, why) => {
            let entry = Entry { error: Some(why.clone()), attempt: 0, ..entry(*job, Status::Skipped) };
            JournalLine { job: *job, entry, full: None }
        }
        JobEnd::Ran(finished) => {
            let Finished { job, ended, .. } = finished;
            let status = match (&ended.error, ended.missed) {
                (Some(_), _) => Status::Failed,
                (None, true) => Status::Missed,
                (None, false) => Status::Done,
            };
            let entry = Entry {
                error: ended.error.clone(),
                seconds: finished.seconds,
                threads: finished.threads,
                attempt: finished.attempt,
                peak_bytes: ended.peak_bytes,
                needs: finished.needs.clone(),
                ..entry(*job, status)
            };
            let mut line = JournalLine { job: *job, entry, full: None };
            if line.entry.has_outputs() {
                match files(plan, hashes, finished) {
                    Ok(files) => (line.entry.inputs, line.entry.outputs) = files,
                    Err(error) => line.fail(&error),
                }
            }
            line
        }
    }
}

/// Inputs, which must be those of the beginning, and outputs of a job.
fn files(plan: &Plan, hashes: &Hashes, finished: &Finished) -> Result<(Vec<HashedFile>, Vec<HashedFile>)> {
    let mut inputs = [plan.inputs[finished.job].clone(), finished.ended.read.clone()].concat();
    inputs.sort_by(|a, b| a.path.cmp(&b.path));
    inputs.dedup();
    for file in &mut inputs {
        if hashes.of(&file.path) != *file {
            return Err(Error::format(
                &file.path,
                None,
                "was changed while the batch ran; run the batch again",
            ));
        }
        file.path = plan.places.stored(&file.path);
    }
    Ok((inputs, seal(&plan.out, &plan.jobs[finished.job].name)?))
}

/// Lines that count, and the errors of jobs without space for their outputs.
type JournalLines = (Vec<(usize, Entry)>, Vec<String>);

/// Writes the lines of jobs and gives their folders their places. Takes those of former runs away if a job has none now, but not if a file
/// system without space is the reason: what an earlier run has made stays until the job has run.
///
/// # Errors
/// The journal cannot be written.
fn keep(plan: &Plan, journal: &mut Journal, mut lines: Vec<JournalLine>) -> Result<JournalLines> {
    let out = &plan.out;
    lines.iter_mut().filter(|line| !line.entry.has_outputs()).for_each(|line| clear(out, line));
    let of_ran = |line: &&JournalLine| line.full.is_none();
    journal.append(&lines.iter().filter(of_ran).map(|line| &line.entry).collect::<Vec<_>>())?;
    let each_with_outputs = |lines: &mut [JournalLine], act: &dyn Fn(&str) -> Result<()>| -> Vec<usize> {
        let mut failed = Vec::new();
        for (k, line) in lines.iter_mut().enumerate().filter(|(_, line)| line.entry.has_outputs()) {
            if let Err(error) = act(&line.entry.job) {
                line.fail(&error);
                failed.push(k);
            }
        }
        failed
    };
    let mut failed = each_with_outputs(&mut lines, &|job| publish(out, job));
    // After all have been renamed: the first write of a shared folder serves all.
    failed.extend(each_with_outputs(&mut lines, &|job| sync_up(&out.join(job), out)));
    // The next run finishes those that had no space.
    failed.retain(|&k| lines[k].full.is_none());
    if !failed.is_empty() {
        failed.iter().for_each(|&k| clear(out, &mut lines[k]));
        journal.append(&failed.iter().map(|&k| &lines[k].entry).collect::<Vec<_>>())?;
    }
    let (full, ran): (Vec<JournalLine>, Vec<JournalLine>) =
        lines.into_iter().partition(|line| line.full.is_some());
    let kept = ran.into_iter().map(|line| (line.job, line.entry)).collect();
    Ok((kept, full.into_iter().filter_map(|line| line.full).collect()))
}

/// Removes what a job without outputs has written, and what an earlier run has made with other options or inputs: it must not pass for a
/// result of this run. Outputs of an earlier run stay if there was no space.
fn clear(out: &Path, line: &mut JournalLine) {
    // What cannot be removed takes space, nothing else.
    let _ = remove(&work(out, &line.entry.job));
    if line.full.is_none() {
        let former = withdraw(out, &line.entry.job);
        line.entry.withdrawn = former.is_ok();
        let _ = former.and_then(|former| remove(&former));
    }
}
