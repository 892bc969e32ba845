//! `mrvis batch JOBS.toml --out DIR`: many jobs of other commands.

mod command_line;
mod commit;
mod estimates;
mod job_run;
mod plan;
#[cfg(feature = "mpi")]
mod ranks;
mod reporter;
mod runner;

pub use job_run::run_requested;

use super::args::counted;
use super::inputs::{Inputs, Output};
use super::mpi::MpiArgs;
use super::{interruption, limits};
use crate::batch::{Capacity, Hashes, Journal, Status, TABLES, lock, lock_split, write_results};
use mrvis::Result;
use mrvis::internals::memory;
use mrvis::internals::threads::MAX_THREADS;
use plan::{Earlier, Plan, Shard};
use reporter::Reporter;
use runner::Settings;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Run all jobs of a file: scenes, sweeps of options and comparisons. Jobs that are done are not repeated.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The jobs: a TOML file with [[job]] tables, see docs/batch.md.
    #[arg(value_name = "JOBS.toml")]
    jobs: PathBuf,
    /// Folder for the results: one folder a job, and tables of all jobs.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Only jobs with this tag or name, and those that they need; repeatable.
    #[arg(long, value_name = "TAG")]
    only: Vec<String>,
    /// Check everything and list the jobs with estimates of their memory and time, without running any.
    #[arg(long)]
    dry_run: bool,
    /// Threads of all jobs together, of each process with --mpi [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=MAX_THREADS as i64))]
    threads: Option<u16>,
    /// Largest number of jobs at once, in each process with --mpi [default: the number of threads]
    #[arg(long = "jobs-at-once", value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    at_once: Option<u16>,
    /// Memory of all jobs together, of each process with --mpi, in GiB [default: 80 % of what is available]
    #[arg(long, value_name = "G", value_parser = limits::parse)]
    memory: Option<f64>,
    /// Largest number of times that a failed job runs again.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=100))]
    retry: u32,
    /// Only a part of the jobs, for several machines: part i of n; `mrvis merge` then makes the tables.
    #[arg(long, value_name = "i/n", value_parser = plan::read_shard)]
    shard: Option<Shard>,
    #[command(flatten)]
    pub mpi: MpiArgs,
    /// Append what happens to FILE as JSON Lines.
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// No progress and no text: only files and the exit code.
    #[arg(long)]
    pub quiet: bool,
}

impl Args {
    /// Whether this process runs a part of the jobs that no other process runs.
    pub fn has_own_part(&self) -> bool {
        self.shard.is_some()
    }

    /// Threads, jobs and memory that one process may use at once. Ranks on one machine share them.
    fn capacity(&self) -> Capacity {
        let processes = self.mpi.on_machine();
        let threads = self.threads.map_or_else(|| self.mpi.threads(), usize::from);
        let usable = || memory::usable().map(|bytes| bytes / processes as u64);
        let budget = self.memory.map(|g| (g * limits::GIB) as u64).or_else(usable);
        Capacity {
            threads,
            jobs: self.at_once.map_or(threads, usize::from),
            memory: budget.unwrap_or(u64::MAX),
        }
    }
}

impl Args {
    /// Refuses a log that would be written into an input or a table of the batch.
    fn check_log(&self, plan: &Plan) -> Result<()> {
        let Some(log) = &self.log else { return Ok(()) };
        let files = plan.lines.iter().flat_map(|line| &line.files);
        let tables = Output::within("--out", &self.out, TABLES.map(String::from));
        Inputs::of(files.chain([&self.jobs])).check(tables.chain([Output::new("--log", log)]))
    }
}

pub fn run(args: &Args) -> Result<ExitCode> {
    #[cfg(feature = "mpi")]
    if let Some(world) = args.mpi.world().filter(|world| !world.is_first()) {
        if !args.dry_run {
            ranks::serve(world, args.capacity());
        }
        return Ok(ExitCode::SUCCESS);
    }
    let hashes = Arc::new(Hashes::default());
    let mut plan = Plan::new(&args.jobs, &args.out, &args.only, &hashes)?;
    if let Some(shard) = args.shard {
        plan.chosen = shard.jobs(&plan.jobs, &plan.chosen);
    }
    if args.dry_run {
        super::print(&plan.listed(&plan.earlier(&hashes, false)?, args.capacity().threads))?;
        return Ok(ExitCode::SUCCESS);
    }
    args.check_log(&plan)?;
    let part = args.shard.map_or(String::new(), Shard::suffix);
    // Parts share the folder with each other, but not with a batch of all jobs.
    let _locks = [
        Some(lock(&args.out, "lock", args.shard.is_some())?),
        args.shard.map(|shard| lock_split(&args.out, shard.parts())).transpose()?,
        args.shard.map(|_| lock(&args.out, &format!("lock{part}"), false)).transpose()?,
    ];
    let Earlier { mut entries, done, spoilt } = plan.earlier(&hashes, true)?;
    plan.check_folders(&entries, &done)?;
    match args.shard {
        None => plan.listed.write(&args.out)?,
        Some(_) => plan.listed.clone().write_part(&args.out)?,
    }
    let journal = Journal::open(&args.out, &format!("journal{part}.jsonl"))?;
    interruption::watch(None);
    let to_do: Vec<usize> = plan.chosen.iter().copied().filter(|&k| !done[k]).collect();
    let work = plan.work(&entries, args.capacity().threads);
    let reporter = Reporter::new(work, &to_do, args.log.as_deref(), args.quiet)?;
    spoilt.iter().for_each(|(k, what)| reporter.repeated(&plan.jobs[*k].name, what));
    let settings = Settings {
        capacity: args.capacity(),
        retry: args.retry,
        tables: args.shard.is_none(),
        #[cfg(feature = "mpi")]
        world: args.mpi.world(),
    };
    let ran = runner::run(&plan, &mut entries, &done, &hashes, journal, &settings, &reporter);
    reporter.finish();
    let written = match args.shard {
        None => write_results(&plan.out, plan.own_entries(&entries)),
        Some(_) => Ok(()),
    };
    // The first error is the reason of the second.
    let summary = ran?;
    written?;
    if !args.quiet {
        let before = plan.chosen.len() - to_do.len();
        let mut text =
            format!("{} done, {before} done before", counted(summary.done + summary.missed, "job"));
        for (count, what) in [
            (summary.missed, "missed their tolerance"),
            (summary.failed, "failed"),
            (summary.skipped, "skipped"),
        ] {
            text += &if count > 0 { format!(", {count} {what}") } else { String::new() };
        }
        let table = match args.shard {
            None => format!("table: {}", args.out.join("results.csv").display()),
            Some(_) => "tables by mrvis merge".into(),
        };
        super::print(&format!("{text}; {table}\n"))?;
    }
    let missed = |k: &usize| entries.get(&plan.jobs[*k].name).is_some_and(|e| e.status == Status::Missed);
    Ok(match summary {
        s if s.failed + s.skipped > 0 => ExitCode::from(super::FAILED),
        _ if plan.chosen.iter().any(missed) => ExitCode::from(1),
        _ => ExitCode::SUCCESS,
    })
}
