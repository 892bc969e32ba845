//! Runs the command of one job, in this process or, with limits, in a process of its own.

use super::command_line::Line;
use crate::batch::{HashedFile, Limits};
use crate::cli::shared_scenes::SharedScenes;
use crate::cli::{interruption, job_context, one_line};
use mrvis::internals::{files::json_text, memory, threads::Threads};
use mrvis::{Error, Result};
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::io::{ErrorKind, Read, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How the command of a job ended.
#[derive(Debug, Default, Deserialize, Serialize)]
pub struct JobResult {
    /// Its error.
    pub error: Option<String>,
    /// Whether the error is that of a full disk.
    pub is_full: bool,
    /// Whether a stated tolerance was missed.
    pub missed: bool,
    /// Files of its scene, as they were when it was read or looked for.
    pub read: Vec<HashedFile>,
    /// Largest resident size of a process of its own, bytes.
    pub peak_bytes: Option<u64>,
}

impl JobResult {
    fn failed(error: impl Into<String>) -> JobResult {
        JobResult { error: Some(error.into()), ..JobResult::default() }
    }

    /// The end of a job whose files cannot be written or read.
    pub fn with_error(error: &Error) -> JobResult {
        JobResult { is_full: is_full(error), ..JobResult::failed(one_line(error)) }
    }
}

/// Runs a job in this process. A panic ends the job only.
pub fn in_process(line: &Line, shown: &str, threads: usize, scenes: &Arc<SharedScenes>) -> JobResult {
    let command = match line.parse() {
        Ok(command) => command,
        Err(error) => return JobResult::failed(crate::cli::usage(&error)),
    };
    let work = || job_context::within(shown, scenes, || crate::cli::run(&command));
    let ran = catch_unwind(AssertUnwindSafe(|| Threads::new(threads)?.run(work)));
    let (result, read) = match ran {
        Err(panic) => {
            let what = panic.downcast_ref::<String>().map(String::as_str);
            let what = what.or(panic.downcast_ref::<&str>().copied()).unwrap_or("unknown");
            let what: Vec<&str> = what.split_whitespace().collect();
            return JobResult::failed(format!("internal error, please report it: {}", what.join(" ")));
        }
        Ok(Err(error)) => return JobResult::failed(one_line(&error)),
        Ok(Ok(ran)) => ran,
    };
    match result {
        // Outputs of a command that was interrupted may be those of half of the work.
        Ok(_) if interruption::stopped() => JobResult::failed("the process of the job was interrupted"),
        Ok(code) => JobResult { missed: code != ExitCode::SUCCESS, read, ..JobResult::default() },
        Err(error) => JobResult::with_error(&error),
    }
}

/// Whether a file could not be written for lack of space.
pub fn is_full(error: &Error) -> bool {
    let kinds = [ErrorKind::StorageFull, ErrorKind::QuotaExceeded, ErrorKind::FileTooLarge];
    matches!(error, Error::Io { source, .. } if kinds.contains(&source.kind()))
}

/// Description of a job for a separate process, sent to its standard input.
#[derive(Deserialize, Serialize)]
struct Request {
    words: Vec<OsString>,
    shown: String,
    threads: usize,
    memory: Option<u64>,
    parent: u32,
}

/// Runs a job as a process of its own within limits.
pub fn as_process(line: &Line, shown: &str, threads: usize, limits: Limits) -> JobResult {
    let start = Instant::now();
    let request = Request {
        words: line.words.clone(),
        shown: shown.into(),
        threads,
        memory: limits.memory,
        parent: std::process::id(),
    };
    let child = started(&request);
    let mut child = match child {
        Ok(child) => child,
        Err(e) => return JobResult::failed(format!("the process of the job cannot be started ({e})")),
    };
    // Read while the process runs: it waits for room in a pipe that is full.
    let (answer, text) = (read_on_thread(child.stdout.take()), read_on_thread(child.stderr.take()));
    let late = || limits.seconds.is_some_and(|s| start.elapsed().as_secs_f64() > s);
    let mut stopped = false;
    // The polling interval grows from 1 to 50 ms: short jobs are not delayed, and long ones are polled rarely.
    let mut pause = Duration::from_millis(1);
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) if !stopped && (late() || interruption::stopped()) => {
                stopped = true;
                // A process that has just ended cannot be killed.
                let _ = child.kill();
            }
            Ok(None) => std::thread::sleep(pause),
            Err(e) => return JobResult::failed(format!("the process of the job was lost ({e})")),
        }
        pause = (pause * 2).min(Duration::from_millis(50));
    };
    // A thread that failed has read nothing.
    let [answer, text] = [answer, text].map(|reader| reader.join().unwrap_or_default());
    if let (true, Ok(ended)) = (status.success(), serde_json::from_str(&answer)) {
        return ended;
    }
    if stopped {
        let seconds = limits.seconds.unwrap_or_default();
        return JobResult::failed(format!("the time limit of {seconds} s was over; raise `limits.seconds`"));
    }
    JobResult::failed(cause(&status.to_string(), limits, &text))
}

/// Why a process ended, from what it wrote to standard error.
fn cause(status: &str, limits: Limits, text: &str) -> String {
    // The standard library adds how to get a list of functions.
    let text = text.split("note: run with").next().unwrap_or_default();
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let limit =
        limits.memory.map_or(String::new(), |bytes| limit_in_words(bytes, memory::address_space_limit()));
    let refused = text.strip_prefix("memory allocation of ").and_then(|text| text.strip_suffix(" failed"));
    match refused {
        Some(bytes) => format!("out of memory: {bytes} at once are refused{limit}"),
        None => format!("the process of the job ended with {status}{limit} {text}").trim_end().into(),
    }
}

/// Which limit a process has that is given `bytes`, [`u64::MAX`] without `limits.memory`, where the address space has a limit of its own.
fn limit_in_words(bytes: u64, address_space: Option<u64>) -> String {
    match address_space {
        Some(limit) if limit < bytes => " (the address space is limited: raise `ulimit -v`)".into(),
        _ if bytes == u64::MAX => String::new(),
        _ => format!(" (its memory limit is {:.1} GiB: `limits.memory`)", bytes as f64 / (1u64 << 30) as f64),
    }
}

/// Reads a pipe to its end.
fn read_on_thread(pipe: Option<impl Read + Send + 'static>) -> JoinHandle<String> {
    std::thread::spawn(move || {
        let mut text = String::new();
        // What came before an error is shown.
        let _ = pipe.map(|mut pipe| pipe.read_to_string(&mut text));
        text
    })
}

fn started(request: &Request) -> std::io::Result<Child> {
    let mut command = Command::new(std::env::current_exe()?);
    command.arg("run-job").stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    // The message of a job is one line.
    command.env("RUST_BACKTRACE", "0");
    // An interruption from the terminal reaches the batch only, which then ends the job.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut child = command.spawn()?;
    if let Some(mut input) = child.stdin.take() {
        input.write_all(&serde_json::to_vec(request)?)?;
    }
    Ok(child)
}

/// `mrvis run-job`: runs the job that standard input describes, for [`as_process`].
///
/// # Errors
/// Standard input is no such description.
pub fn run_requested() -> Result<ExitCode> {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text).map_err(|e| Error::io("standard input", e))?;
    let request: Request =
        serde_json::from_str(&text).map_err(|e| Error::format("standard input", None, e.to_string()))?;
    #[cfg(target_os = "linux")]
    limit_process(&request)?;
    let line = Line { words: request.words, files: Vec::new() };
    let scenes = Arc::new(SharedScenes::new(Arc::default()));
    let mut ended = in_process(&line, &request.shown, request.threads, &scenes);
    ended.peak_bytes = peak();
    let text = json_text(&ended).map_err(|e| Error::format("answer", None, e.to_string()))?;
    crate::cli::print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// Sets the limit of address space, and lets the job end with the batch.
#[cfg(target_os = "linux")]
fn limit_process(request: &Request) -> Result<()> {
    use rustix::process::{Resource, Rlimit, Signal, getppid, getrlimit};
    use rustix::process::{set_parent_process_death_signal, setrlimit};
    let at = |e: rustix::io::Errno| Error::io("limits of the process", e.into());
    set_parent_process_death_signal(Some(Signal::KILL)).map_err(at)?;
    let parent = getppid().map(|pid| pid.as_raw_nonzero().get() as u32);
    if parent != Some(request.parent) {
        return Err(Error::Cancelled("the batch has ended".into()));
    }
    if let Some(bytes) = request.memory {
        // A limit cannot be raised.
        let Rlimit { current, maximum } = getrlimit(Resource::As);
        let bytes = [current, maximum].into_iter().flatten().fold(bytes, u64::min);
        let limit = (bytes < u64::MAX).then_some(bytes);
        setrlimit(Resource::As, Rlimit { current: limit, maximum: limit }).map_err(at)?;
    }
    Ok(())
}

/// Largest resident size of this process so far, bytes.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(1024 * line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refused_memory_is_one_sentence() {
        let limits = Limits { memory: Some(1 << 30), ..Limits::default() };
        let text =
            "memory allocation of 99 bytes failed\nnote: run with `RUST_BACKTRACE=1` environment variable\n";
        let found = cause("exit status: 2", limits, text);
        assert!(found.starts_with("out of memory: 99 bytes at once are refused ("), "{found}");
        assert_eq!(limit_in_words(1 << 30, None), " (its memory limit is 1.0 GiB: `limits.memory`)");
        assert_eq!(limit_in_words(1 << 30, Some(1 << 30)), limit_in_words(1 << 30, None));
        let address_space = " (the address space is limited: raise `ulimit -v`)";
        assert_eq!(limit_in_words(1 << 30, Some(1 << 29)), address_space);
        assert_eq!(limit_in_words(u64::MAX, Some(1 << 29)), address_space);
        assert_eq!(limit_in_words(u64::MAX, None), "");
        let other = cause("signal: 9", Limits::default(), "");
        assert_eq!(other, "the process of the job ended with signal: 9");
    }
}
