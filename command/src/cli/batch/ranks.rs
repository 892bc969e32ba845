//! Jobs on other ranks (`--mpi`): the first rank distributes jobs and writes the journal; the others run jobs and report their results.
//! All write into one output folder, which every machine must be able to reach.
//!
//! A job goes to the next rank that has room for it. If a rank dies, the launcher ends all; the next run goes on from the journal.

use super::command_line::Line;
use super::commit::{Event, Finished};
use super::job_run::{JobResult, as_process, in_process};
use super::plan::Plan;
use crate::batch::{Capacity, Limits, begin};
use crate::cli::interruption;
use crate::cli::mpi::{Mailbox, World};
use crate::cli::shared_scenes::SharedScenes;
use mrvis::internals::ranks::Exchange;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::ffi::OsString;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

/// Time between two checks for messages: the largest delay that it adds to a job.
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// A job for another rank.
pub struct Assignment {
    /// The rank.
    pub rank: usize,
    /// Index of the job.
    pub job: usize,
    /// 1 for the first run.
    pub attempt: u32,
    /// Its threads.
    pub threads: usize,
    /// Its limits.
    pub limits: Limits,
    /// Memory that running jobs leave on the rank, bytes.
    pub spare: u64,
}

/// Request to a rank to run a job.
#[derive(Deserialize, Serialize)]
struct Request {
    job: usize,
    words: Vec<OsString>,
    shown: String,
    threads: usize,
    seconds: Option<f64>,
    memory: Option<u64>,
    spare: u64,
}

/// Reply of a rank about a job.
#[derive(Deserialize, Serialize)]
struct Reply {
    job: usize,
    seconds: f64,
    ended: JobResult,
}

fn encoded(value: &impl Serialize) -> Vec<u8> {
    serde_json::to_vec(value).expect("plain data")
}

fn decoded<T: for<'a> Deserialize<'a>>(bytes: &[u8]) -> T {
    serde_json::from_slice(bytes).expect("all ranks run the same program")
}

/// Capacities of all ranks; each rank passes its own. Called once on each rank.
pub fn capacities(world: World, own: Capacity) -> Vec<Capacity> {
    let all = world.all_gather(&encoded(&(own.threads, own.jobs, own.memory)));
    let capacity = |bytes: Vec<u8>| {
        let (threads, jobs, memory) = decoded(&bytes);
        Capacity { threads, jobs, memory }
    };
    all.into_iter().map(capacity).collect()
}

/// Hands out jobs until there are no more, and reports how they ended; then lets the other ranks end.
pub fn hand_out(world: World, plan: &Plan, assignments: &Receiver<Assignment>, events: &Sender<Event>) {
    let mut mailbox = Mailbox::new(world);
    let mut open: HashMap<usize, Assignment> = HashMap::new();
    let finished = |a: &Assignment, seconds: f64, ended: JobResult| {
        let (job, attempt, threads) = (a.job, a.attempt, a.threads);
        // Without a receiver the batch has ended.
        let _ =
            events.send(Event::Ran(Finished { job, attempt, threads, seconds, ended, needs: Vec::new() }));
    };
    loop {
        match assignments.recv_timeout(POLL_INTERVAL) {
            Ok(assignment) => match begin(&plan.out, &plan.jobs[assignment.job].name) {
                Err(error) => finished(&assignment, 0.0, JobResult::with_error(&error)),
                Ok(()) => {
                    mailbox.send(assignment.rank, &encoded(&request(plan, &assignment)));
                    open.insert(assignment.job, assignment);
                }
            },
            Err(RecvTimeoutError::Disconnected) if open.is_empty() => break,
            Err(RecvTimeoutError::Disconnected) => std::thread::sleep(POLL_INTERVAL),
            Err(RecvTimeoutError::Timeout) => {}
        }
        while let Some((_, message)) = mailbox.receive() {
            let Reply { job, seconds, ended } = decoded(&message);
            if let Some(assignment) = open.remove(&job) {
                finished(&assignment, seconds, ended);
            }
        }
    }
    release(world);
}

/// Lets the other ranks end.
pub fn release(world: World) {
    let mut mailbox = Mailbox::new(world);
    (1..world.count()).for_each(|rank| mailbox.send(rank, &[]));
}

fn request(plan: &Plan, assignment: &Assignment) -> Request {
    let &Assignment { job, threads, limits, spare, .. } = assignment;
    let (words, shown) = (plan.lines[job].words.clone(), plan.shown[job].clone());
    Request { job, words, shown, threads, seconds: limits.seconds, memory: limits.memory, spare }
}

/// Runs the jobs that the first rank sends within this capacity, until the first rank sends the end.
pub fn serve(world: World, capacity: Capacity) {
    interruption::watch(None);
    capacities(world, capacity);
    let scenes = Arc::new(SharedScenes::new(Arc::default()));
    let (replies, ended) = channel();
    let mut mailbox = Mailbox::new(world);
    std::thread::scope(|scope| {
        loop {
            if interruption::stopped() {
                // Threads of running jobs cannot be waited for.
                world.abort(interruption::INTERRUPTED);
            }
            while let Some((_, message)) = mailbox.receive() {
                if message.is_empty() {
                    return;
                }
                let request: Request = decoded(&message);
                let (replies, scenes) = (replies.clone(), scenes.clone());
                scope.spawn(move || {
                    // Without a receiver the batch has ended.
                    let _ = replies.send(run(&request, &scenes));
                });
            }
            if let Ok(reply) = ended.recv_timeout(POLL_INTERVAL) {
                mailbox.send(0, &encoded(&reply));
            }
        }
    });
}

fn run(request: &Request, scenes: &Arc<SharedScenes>) -> Reply {
    let Request { job, words, shown, threads, seconds, memory, spare } = request;
    let start = Instant::now();
    scenes.shrink_to(*spare);
    let line = Line { words: words.clone(), files: Vec::new() };
    let limits = Limits { seconds: *seconds, memory: *memory };
    let ended = match limits == Limits::default() {
        true => in_process(&line, shown, *threads, scenes),
        false => as_process(&line, shown, *threads, limits),
    };
    Reply { job: *job, seconds: start.elapsed().as_secs_f64(), ended }
}
