//! Runs the jobs of a plan: starts them as threads and memory allow, and follows them to their end.

use super::commit::{Event, Finished, JobEnd, commit, make_room};
use super::estimates::MIN_MEMORY;
use super::job_run::{JobResult, as_process, in_process};
use super::plan::Plan;
#[cfg(feature = "mpi")]
use super::ranks;
use super::reporter::Reporter;
use crate::batch::{
    Capacity, Entries, Entry, Hashes, Journal, Limits, Schedule, Status, Task, begin, remove, work,
    write_results,
};
use crate::cli::interruption;
#[cfg(feature = "mpi")]
use crate::cli::mpi::World;
use crate::cli::shared_scenes::SharedScenes;
use mrvis::internals::memory;
use mrvis::{Error, Result};
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::Scope;
use std::time::{Duration, Instant};

/// Number of jobs that must fit into the memory budget together for such a job to share a process with others. A larger job is a
/// process of its own with the budget as its limit, so that a wrong estimate ends that job only.
const MIN_SHARED_JOBS: u64 = 4;

/// Address space that a thread takes without using it, bytes: an arena of glibc (64 MiB) and a stack (8 MiB).
const RESERVED_BY_THREAD: u64 = 72 << 20;

/// Time between two checks for an interruption: below what a user notices.
const INTERVAL: Duration = Duration::from_millis(50);

/// How a batch runs.
pub struct Settings {
    /// Threads and memory of all jobs of this process together, and jobs at once.
    pub capacity: Capacity,
    /// Further runs of a failed job, if the job file states fewer.
    pub retry: u32,
    /// Whether an interrupted batch writes tables of all jobs: parts of a batch leave them to `merge`.
    pub tables: bool,
    /// All ranks, if others run jobs as well.
    #[cfg(feature = "mpi")]
    pub world: Option<World>,
}

/// How a batch ended.
#[derive(Debug, Default)]
pub struct Summary {
    /// Jobs that ended, by their status.
    pub done: usize,
    pub missed: usize,
    pub failed: usize,
    /// Jobs that were not run because they need a failed one.
    pub skipped: usize,
    /// Whether the user has interrupted the batch.
    pub interrupted: bool,
}

struct Runner<'a> {
    plan: &'a Plan,
    settings: &'a Settings,
    reporter: &'a Reporter,
    schedule: Schedule,
    attempts: HashMap<usize, u32>,
    /// Jobs that an earlier batch had begun when it was ended: it may have run out of memory in one of them.
    begun: Vec<bool>,
    summary: Summary,
    /// Why no more jobs start.
    broken: Option<Error>,
    /// Jobs that run or are being made permanent.
    open: usize,
    /// Sender to the thread that makes jobs permanent; `None` after the last job.
    closing: Option<Sender<JobEnd>>,
    scenes: Arc<SharedScenes>,
    /// Capacity of each process; the first is this one.
    capacities: Vec<Capacity>,
    /// Takes jobs for other processes.
    #[cfg(feature = "mpi")]
    assignments: Option<Sender<ranks::Assignment>>,
}

/// Runs all chosen jobs that are not done. `entries` gets the lines of the journal.
///
/// # Errors
/// The journal or a folder cannot be written.
pub fn run(
    plan: &Plan,
    entries: &mut Entries,
    done: &[bool],
    hashes: &Arc<Hashes>,
    journal: Journal,
    settings: &Settings,
    reporter: &Reporter,
) -> Result<Summary> {
    let expected = plan.work(entries, settings.capacity.threads);
    let tasks = expected.into_iter().enumerate().map(|(k, work)| task(plan, k, entries, work)).collect();
    let capacities = capacities(settings);
    // What an earlier run has made of jobs that are to be run is no result of this one.
    plan.chosen.iter().filter(|&&k| !done[k]).for_each(|&k| drop(entries.remove(&plan.jobs[k].name)));
    let begun = plan.jobs.iter().zip(done).map(|(job, done)| !done && work(&plan.out, &job.name).exists());
    let schedule = Schedule::new(tasks, capacities.clone(), done.to_vec(), &plan.chosen);
    let mut runner = Runner {
        plan,
        settings,
        reporter,
        schedule,
        attempts: HashMap::new(),
        begun: begun.collect(),
        summary: Summary::default(),
        broken: None,
        open: 0,
        closing: None,
        scenes: Arc::new(SharedScenes::new(hashes.clone())),
        capacities,
        #[cfg(feature = "mpi")]
        assignments: None,
    };
    std::thread::scope(|scope| {
        let (events, inbox) = channel();
        let (closing, to_commit) = channel();
        runner.closing = Some(closing);
        let own_events = events.clone();
        scope.spawn(move || commit(plan, hashes, journal, &to_commit, &own_events));
        #[cfg(feature = "mpi")]
        if let Some(world) = settings.world {
            let ((sender, assignments), events) = (channel(), events.clone());
            runner.assignments = Some(sender);
            scope.spawn(move || ranks::hand_out(world, plan, &assignments, &events));
        }
        runner.follow(scope, &events, &inbox, entries);
        #[cfg(feature = "mpi")]
        runner.assignments.take();
        if runner.summary.interrupted {
            // Threads of running jobs cannot be waited for; what they write is in work folders.
            reporter.interrupted(
                runner.summary.done + runner.summary.missed,
                runner.schedule.waiting().count() + runner.open,
            );
            if settings.tables {
                // The batch ends in any case, and the next run writes them again.
                let _ = write_results(&plan.out, plan.own_entries(entries));
            }
            std::process::exit(interruption::INTERRUPTED.into());
        }
    });
    runner.broken.map_or(Ok(runner.summary), Err)
}

/// Capacities of all processes.
fn capacities(settings: &Settings) -> Vec<Capacity> {
    #[cfg(feature = "mpi")]
    if let Some(world) = settings.world {
        return ranks::capacities(world, settings.capacity);
    }
    vec![settings.capacity]
}

fn task(plan: &Plan, k: usize, entries: &Entries, work: f64) -> Task {
    let job = &plan.jobs[k];
    Task {
        needs: job.needs.clone(),
        work,
        memory: plan.memory(k, entries).unwrap_or(0),
        threads: plan.estimates[k].threads,
        alone: job.command.name == "bench",
    }
}

impl<'a> Runner<'a> {
    /// Starts jobs and handles what happens until all have ended, or the user interrupts the batch.
    fn follow<'s>(
        &mut self,
        scope: &'s Scope<'s, '_>,
        events: &Sender<Event>,
        inbox: &Receiver<Event>,
        entries: &mut Entries,
    ) where
        'a: 's,
    {
        loop {
            while !interruption::stopped() && self.broken.is_none() {
                // In turn, so that all processes have jobs.
                let mut started = 0;
                for process in 0..self.schedule.processes() {
                    let Some((job, threads)) = self.schedule.start(process) else { continue };
                    self.start(scope, job, threads, process, events.clone());
                    started += 1;
                }
                if started == 0 {
                    break;
                }
            }
            if interruption::stopped() || self.open == 0 {
                break;
            }
            match inbox.recv_timeout(INTERVAL) {
                Ok(event) => self.handle(event, entries),
                Err(RecvTimeoutError::Timeout) => self.reporter.tick(),
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        self.summary.interrupted = interruption::stopped();
        // Jobs that have ended become permanent.
        self.closing = None;
        while let Ok(event) = inbox.recv() {
            match event {
                Event::Closed => break,
                Event::Ran(_) => {}
                event => self.handle_kept(event, entries),
            }
        }
    }

    fn start<'s>(
        &mut self,
        scope: &'s Scope<'s, '_>,
        job: usize,
        threads: usize,
        process: usize,
        events: Sender<Event>,
    ) where
        'a: 's,
    {
        let plan: &'a Plan = self.plan;
        let attempt = *self.attempts.entry(job).and_modify(|n| *n += 1).or_insert(1);
        let limits = self.limits(job, threads, self.capacities[process].memory);
        let spare = self.schedule.memory_left(process);
        self.open += 1;
        self.reporter.started(job, &plan.jobs[job].name, threads);
        #[cfg(feature = "mpi")]
        if let (1.., Some(assignments)) = (process, &self.assignments) {
            // The other end lives as long as this sender.
            let _ =
                assignments.send(ranks::Assignment { rank: process, job, attempt, threads, limits, spare });
            return;
        }
        self.scenes.shrink_to(spare);
        let (scenes, refused) = (self.scenes.clone(), events.clone());
        let work = move || {
            let start = Instant::now();
            let (line, shown) = (&plan.lines[job], &plan.shown[job]);
            let ended = match begin(&plan.out, &plan.jobs[job].name) {
                Err(error) => JobResult::with_error(&error),
                Ok(()) if limits == Limits::default() => in_process(line, shown, threads, &scenes),
                Ok(()) => as_process(line, shown, threads, limits),
            };
            let seconds = start.elapsed().as_secs_f64();
            let needs = Vec::new();
            // Without a receiver the batch has ended.
            let _ = events.send(Event::Ran(Finished { job, attempt, threads, seconds, ended, needs }));
        };
        if let Err(e) = std::thread::Builder::new().spawn_scoped(scope, work) {
            let ended = JobResult::with_error(&Error::io("thread of a job", e));
            let ran = Finished { job, attempt, threads, seconds: 0.0, ended, needs: Vec::new() };
            // The receiver is this thread.
            let _ = refused.send(Event::Ran(ran));
        }
    }

    /// The limits of a job; one that takes much of the budget of its process, or may have ended an earlier batch, has at least that
    /// limit. If the address space is limited, every job has a process of its own.
    fn limits(&self, job: usize, threads: usize, budget: u64) -> Limits {
        let mut limits = self.plan.jobs[job].limits;
        let expected = self.plan.memory(job, &Entries::new()).unwrap_or(0);
        // Memory that a limit of the address space refuses ends a whole process.
        let is_refusable = memory::left_of_address_space().is_some();
        let is_large = expected.saturating_sub(MIN_MEMORY) > budget / MIN_SHARED_JOBS;
        if self.begun[job] || is_large {
            let reserved = RESERVED_BY_THREAD.saturating_mul(threads as u64 + 1);
            limits.memory = limits.memory.or(Some(budget.saturating_add(reserved)));
        } else if is_refusable {
            // A process of its own, with the limit of this one.
            limits.memory = limits.memory.or(Some(u64::MAX));
        }
        limits
    }

    fn handle(&mut self, event: Event, entries: &mut Entries) {
        let Event::Ran(mut ran) = event else { return self.handle_kept(event, entries) };
        self.schedule.ended(ran.job);
        // What an interrupted command has written may be incomplete.
        if interruption::stopped() {
            return;
        }
        if ran.ended.is_full {
            self.broken.get_or_insert(make_room(ran.ended.error.as_deref().unwrap_or_default()));
            // The job counts as not run: what an earlier run has made of it stays.
            self.open -= 1;
            let _ = remove(&work(&self.plan.out, &self.plan.jobs[ran.job].name));
            return;
        }
        let retries = self.plan.jobs[ran.job].retry.max(self.settings.retry);
        if ran.ended.error.is_some() && ran.attempt <= retries && self.broken.is_none() {
            self.open -= 1;
            let error = ran.ended.error.unwrap_or_default();
            self.reporter.retried(ran.job, &self.plan.jobs[ran.job].name, &error);
            self.schedule.again(ran.job);
            return;
        }
        ran.needs = self.plan.fingerprints(ran.job, entries);
        self.close(JobEnd::Ran(ran));
    }

    /// Sends a job to the thread that writes the journal, unless the batch takes no more jobs. The next run then runs or skips the job.
    fn close(&self, job: JobEnd) {
        if let Some(closing) = &self.closing {
            // The other end lives as long as this sender.
            let _ = closing.send(job);
        }
    }

    fn handle_kept(&mut self, event: Event, entries: &mut Entries) {
        match event {
            Event::JournalLines(kept) => kept.into_iter().for_each(|(k, entry)| self.kept(k, entry, entries)),
            Event::Broken(error, lost) => {
                self.broken.get_or_insert(error);
                self.open -= lost;
            }
            Event::Ran(_) | Event::Closed => {}
        }
    }

    fn kept(&mut self, job: usize, entry: Entry, entries: &mut Entries) {
        self.open -= 1;
        if entry.status != Status::Skipped {
            self.reporter.ended(job, &entry);
        }
        match entry.status {
            Status::Failed => {
                self.summary.failed += 1;
                let lost = self.schedule.failed(job);
                lost.iter().for_each(|&k| self.skip(k, job, &lost));
            }
            Status::Missed => self.summary.missed += 1,
            Status::Done => self.summary.done += 1,
            Status::Skipped => {}
        }
        if entry.has_outputs() {
            self.schedule.done(job);
        }
        entries.insert(entry.job.clone(), entry);
    }

    /// A job cannot run because it needs `failed`, or another one of the `lost` jobs that are skipped for that.
    fn skip(&mut self, job: usize, failed: usize, lost: &[usize]) {
        self.summary.skipped += 1;
        let (jobs, needs) = (&self.plan.jobs, &self.plan.jobs[job].needs);
        let skipped = needs.iter().find(|need| lost.contains(need)).filter(|_| !needs.contains(&failed));
        let (need, how) = skipped.map_or((failed, "failed"), |&need| (need, "was skipped"));
        let why = format!("it needs {}, which {how}", jobs[need].name);
        self.reporter.skipped(&jobs[job].name, &jobs[need].name, &why);
        if self.closing.is_some() {
            self.open += 1;
            self.close(JobEnd::Skipped(job, why));
        }
    }
}
