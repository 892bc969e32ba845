//! Progress reports of a running batch: progress bars on a terminal, plain lines elsewhere, and a log of JSON Lines.

use crate::batch::{Entry, Status};
use crate::cli::{printable, progress::time_left, say};
use indicatif::{HumanDuration, MultiProgress, ProgressBar, ProgressStyle};
use mrvis::internals::files::escaped;
use mrvis::{Error, Result};
use serde_json::json;
use std::collections::HashMap;
use std::fs::File;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// Reports of a batch.
pub struct Reporter {
    state: Mutex<State>,
    log: Option<Mutex<File>>,
    /// Progress of all jobs; none unless standard error is a terminal.
    bars: Option<(MultiProgress, ProgressBar)>,
    quiet: bool,
    start: Instant,
}

struct State {
    lines: HashMap<usize, ProgressBar>,
    /// Expected work of each job, jobs that have ended in this run, and their work.
    work: Vec<f64>,
    ended: usize,
    total: usize,
    work_ended: f64,
    work_total: f64,
}

impl Reporter {
    /// Reports of jobs with this expected work; `chosen` of them will run.
    ///
    /// # Errors
    /// The log cannot be written.
    pub fn new(work: Vec<f64>, chosen: &[usize], log: Option<&Path>, quiet: bool) -> Result<Reporter> {
        let open = |path: &Path| {
            let file = File::options().create(true).append(true).open(path);
            file.map(Mutex::new).map_err(|e| Error::io(path, e))
        };
        let bars = (!quiet && std::io::stderr().is_terminal()).then(|| {
            let (all, bar) = (MultiProgress::new(), ProgressBar::new(chosen.len() as u64));
            let bar = all.add(bar);
            if let Ok(style) = ProgressStyle::with_template("{pos} of {len} jobs {wide_bar} {elapsed}{msg}") {
                bar.set_style(style);
            }
            (all, bar)
        });
        let work_total = chosen.iter().map(|&k| work[k]).sum();
        let state =
            State { lines: HashMap::new(), work, ended: 0, total: chosen.len(), work_ended: 0.0, work_total };
        let log = log.map(open).transpose()?;
        Ok(Reporter { state: state.into(), log, bars, quiet, start: Instant::now() })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes a line for people; a closed standard error is ignored.
    fn say(&self, text: &str) {
        match &self.bars {
            Some((all, _)) => drop(all.println(printable(text))),
            None if self.quiet => {}
            None => say(text),
        }
    }

    /// Writes a line of the log. A log that cannot be written any more does not end the batch.
    fn note(&self, event: impl Into<serde_json::Value>, mut what: serde_json::Value) {
        let Some(log) = &self.log else { return };
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        what["event"] = event.into();
        what["time"] = now.as_secs_f64().into();
        let mut log = log.lock().unwrap_or_else(PoisonError::into_inner);
        let _ = log.write_all(escaped(format!("{what}\n")).as_bytes());
    }

    /// A job starts.
    pub fn started(&self, job: usize, name: &str, threads: usize) {
        self.note("started", json!({ "job": name, "threads": threads }));
        let Some((all, bar)) = &self.bars else { return };
        let line = all.insert_before(bar, ProgressBar::new_spinner());
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {elapsed}") {
            line.set_style(style);
        }
        line.set_message(printable(name));
        self.state().lines.insert(job, line);
    }

    /// Updates the displayed time left.
    pub fn tick(&self) {
        let Some((_, bar)) = &self.bars else { return };
        let state = self.state();
        state.lines.values().for_each(ProgressBar::tick);
        bar.set_message(state.left(self.start.elapsed()).unwrap_or_default());
        bar.tick();
    }

    fn clear_line(&self, job: usize) {
        if let Some(line) = self.state().lines.remove(&job) {
            line.finish_and_clear();
        }
    }

    /// A job that was done runs again for what is wrong with its outputs.
    pub fn repeated(&self, name: &str, what: &str) {
        self.note("repeated", json!({ "job": name, "reason": what }));
        self.say(&format!("{name} runs again: {what}"));
    }

    /// A failed job will run again.
    pub fn retried(&self, job: usize, name: &str, error: &str) {
        self.clear_line(job);
        self.note("retried", json!({ "job": name, "error": error }));
        self.say(&format!("{name} failed and runs again: {error}"));
    }

    /// A job has ended.
    pub fn ended(&self, job: usize, entry: &Entry) {
        self.clear_line(job);
        let left = {
            let mut state = self.state();
            state.ended += 1;
            state.work_ended += state.work[job];
            self.bars.iter().for_each(|(_, bar)| bar.set_position(state.ended as u64));
            let (ended, total) = (state.ended, state.total);
            format!("[{ended}/{total}{}]", state.left(self.start.elapsed()).unwrap_or_default())
        };
        let mut what = json!({
            "job": entry.job, "seconds": entry.seconds, "threads": entry.threads, "attempt": entry.attempt,
        });
        let name = &entry.job;
        match &entry.error {
            Some(error) => {
                what["error"] = error.as_str().into();
                what["command"] = entry.command.as_str().into();
                self.say(&format!("{left} failed {name}: {error}\n  {}", entry.command));
            }
            None if entry.status == Status::Missed => {
                self.say(&format!("{left} done {name}, {:.2} s, but it missed its tolerance", entry.seconds));
            }
            // On a terminal the lines of running jobs show it.
            None if self.bars.is_some() => {}
            None => self.say(&format!("{left} done {name}, {:.2} s", entry.seconds)),
        }
        self.note(json!(entry.status), what);
    }

    /// A job is not run because it needs a failed one.
    pub fn skipped(&self, name: &str, needs: &str, why: &str) {
        self.state().ended += 1;
        self.note("skipped", json!({ "job": name, "needs": needs }));
        self.say(&format!("skipped {name}: {why}"));
    }

    /// The user has interrupted the batch; numbers of finished and of remaining jobs.
    pub fn interrupted(&self, done: usize, left: usize) {
        self.note("interrupted", json!({ "left": left }));
        self.finish();
        self.say(&format!("interrupted after {done} jobs; the same command goes on with the other {left}"));
    }

    /// Removes the lines that change.
    pub fn finish(&self) {
        self.state().lines.drain().for_each(|(_, line)| line.finish_and_clear());
        self.bars.iter().for_each(|(_, bar)| bar.finish_and_clear());
    }
}

impl State {
    /// The time left, in words: the work left at the mean speed so far.
    fn left(&self, elapsed: Duration) -> Option<String> {
        let part = if self.work_total > 0.0 { self.work_ended / self.work_total } else { 0.0 };
        let left = time_left(elapsed, part).filter(|_| self.ended < self.total)?;
        Some(format!(", {} left", HumanDuration(left)))
    }
}
