//! Makes the outputs of finished jobs permanent: files to disk, a line in the journal, then the folder gets its place.
//!
//! The line is on disk before the folder is renamed. After a crash between the two, the next run finds the folder complete in the work
//! folder and renames it.

use super::job_run::Ended;
use super::plan::Plan;
use crate::batch::{Entry, HashedFile, Hashes, Journal, Status, publish, remove, seal, work};
use crate::cli::one_line;
use crate::{Error, Result};
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
    pub ended: Ended,
    /// Fingerprints of the jobs that it needs.
    pub needs: Vec<String>,
}

/// What happened.
pub enum Event {
    /// The command of a job has ended.
    Ran(Finished),
    /// The outputs of jobs are permanent, or they failed.
    Kept(Vec<(usize, Entry)>),
    /// The journal cannot be written.
    Broken(Error),
    /// All finished jobs are permanent.
    Closed,
}

/// Largest number of jobs that are made permanent together: what waits for a slow disk is spread over so many threads.
const MAX_GROUP: usize = 16;

/// Makes jobs permanent until the sender of `finished` is dropped. Those that wait at the same time share one write of the journal.
pub fn commit(
    plan: &Plan,
    hashes: &Hashes,
    mut journal: Journal,
    finished: &Receiver<Finished>,
    events: &Sender<Event>,
) {
    while let Ok(first) = finished.recv() {
        let group: Vec<Finished> =
            std::iter::once(first).chain(finished.try_iter().take(MAX_GROUP - 1)).collect();
        // File systems write at once what several threads force to disk at the same time.
        let entries: Vec<(usize, Entry)> = std::thread::scope(|scope| {
            let sealing: Vec<_> =
                group.iter().map(|f| (f.job, scope.spawn(|| entry(plan, hashes, f)))).collect();
            let ended = sealing.into_iter();
            ended.map(|(job, entry)| (job, entry.join().expect("sealing does not panic"))).collect()
        });
        let event = keep(plan, &mut journal, entries).map_or_else(Event::Broken, Event::Kept);
        // Without a receiver the batch has ended.
        let _ = events.send(event);
    }
    let _ = events.send(Event::Closed);
}

/// The line of a job, whose outputs are on disk.
fn entry(plan: &Plan, hashes: &Hashes, finished: &Finished) -> Entry {
    let (k, job) = (finished.job, &plan.jobs[finished.job]);
    let sealed = match &finished.ended.error {
        Some(error) => Err(error.clone()),
        None => files(plan, hashes, finished).map_err(|e| one_line(&e)),
    };
    let status = match &sealed {
        Err(_) => Status::Failed,
        Ok(_) if finished.ended.missed => Status::Missed,
        Ok(_) => Status::Done,
    };
    let (error, (inputs, outputs)) = match sealed {
        Err(error) => (Some(error), Default::default()),
        Ok(files) => (None, files),
    };
    Entry {
        error,
        seconds: finished.seconds,
        threads: finished.threads,
        attempt: finished.attempt,
        peak_bytes: finished.ended.peak_bytes,
        inputs,
        needs: finished.needs.clone(),
        outputs,
        ..Entry::new((k, job), &plan.keys[k], status, plan.shown[k].clone())
    }
}

/// Inputs, which must be those of the beginning, and outputs of a job.
fn files(plan: &Plan, hashes: &Hashes, finished: &Finished) -> Result<(Vec<HashedFile>, Vec<HashedFile>)> {
    let job = finished.job;
    let outputs = plan.out.canonicalize().map_err(|e| Error::io(&plan.out, e))?;
    let mut inputs = plan.inputs[job].clone();
    // What the key of another job stands for is left out.
    inputs.extend(finished.ended.read.iter().filter(|file| !file.path.starts_with(&outputs)).cloned());
    inputs.sort_by(|a, b| a.path.cmp(&b.path));
    inputs.dedup();
    for file in &inputs {
        if hashes.of(&file.path)? != *file {
            return Err(Error::format(
                &file.path,
                None,
                "was changed while the batch ran; run the batch again",
            ));
        }
    }
    Ok((inputs, seal(&work(&plan.out, &plan.jobs[job].name))?))
}

fn keep(plan: &Plan, journal: &mut Journal, entries: Vec<(usize, Entry)>) -> Result<Vec<(usize, Entry)>> {
    journal.append(&entries.iter().map(|(_, entry)| entry).collect::<Vec<_>>())?;
    for (_, entry) in &entries {
        match entry.status {
            Status::Failed => remove(&work(&plan.out, &entry.job))?,
            Status::Done | Status::Missed => publish(&plan.out, &entry.job)?,
        }
    }
    Ok(entries)
}
