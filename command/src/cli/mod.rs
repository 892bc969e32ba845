//! The command line: converts arguments to calls of the library, and results to text and JSON.
//!
//! A subcommand is a module with `pub struct Args` (clap) and `pub fn run(&Args) -> Result<ExitCode>`, and one line
//! each in `Command` and `run`.

mod args;
mod batch;
mod bench;
mod compare;
mod fbem;
mod flags;
mod form_factors;
mod generate;
mod help;
mod info;
mod inputs;
mod interruption;
mod job_context;
mod limits;
mod merge;
mod mesh_grid;
mod mpi;
mod oracle;
mod outputs;
mod progress;
mod report;
mod reproduce;
mod shared_scenes;
mod sky_args;
mod solve;
mod terrain;
mod values;

use clap::{
    FromArgMatches, Parser, Subcommand,
    error::{ContextKind, ContextValue},
};
use mrvis::internals::error::{in_words, is_obeyed};
use mrvis::internals::model::embree_version;
use mrvis::{Error, Result};
use std::{
    error::Error as _,
    io::{ErrorKind, Write},
    panic::catch_unwind,
    process::ExitCode,
    sync::{Mutex, PoisonError},
};

/// Exit code after an error.
const FAILED: u8 = 2;

/// Visibility and radiosity in scenes with much small detail.
#[derive(Parser)]
#[command(
    name = "mrvis",
    version,
    max_term_width = 110,
    disable_help_flag = true,
    disable_version_flag = true
)]
#[command(after_help = "mrvis help COMMAND describes all options of a command at length.")]
// The empty line of the default template before the usage is left out, so that the help fits on a screen.
#[command(help_template = "{about-with-newline}{usage-heading} {usage}\n\n{all-args}{after-help}")]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print help.
    #[arg(short, long, action = clap::ArgAction::HelpShort, global = true, help_heading = "Common options")]
    help: Option<bool>,
    /// Print the versions of mrvis and Embree.
    #[arg(short = 'V', long, action = clap::ArgAction::Version, help_heading = "Common options")]
    version: Option<bool>,
    /// No progress and no text: only files and the exit code.
    // The subcommands read it as an option of theirs.
    #[arg(long, global = true, help_heading = "Common options")]
    quiet: bool,
}

#[derive(Subcommand)]
enum Command {
    /// Report a scene and its repairs: counts, bounds, closed and sheet parts, emitters, objects.
    Info(info::Args),
    Bench(bench::Args),
    Fbem(fbem::Args),
    Solve(Box<solve::Args>),
    Reference(oracle::Args),
    Compare(compare::Args),
    FormFactors(form_factors::Args),
    Batch(batch::Args),
    Merge(merge::Args),
    Report(report::Args),
    Terrain(terrain::Args),
    Reproduce(reproduce::Args),
    /// Write a procedural scene as OBJ and MTL; --list shows all scenes.
    Generate(generate::Args),
    /// Print the script that completes options in a shell.
    #[command(hide = true)]
    Completions(help::CompletionsArgs),
    /// Write the manual pages.
    #[command(hide = true)]
    Man(help::ManArgs),
    /// Run the job that standard input describes, for `batch`.
    #[command(hide = true)]
    RunJob,
}

impl Command {
    /// The common options, of commands that have them.
    fn common(&self) -> Option<&args::Common> {
        Some(match self {
            Command::Info(args) => &args.common,
            Command::Bench(args) => &args.common,
            Command::Solve(args) => &args.common,
            Command::Reference(args) => &args.common,
            Command::Compare(args) => &args.common,
            Command::FormFactors(args) => &args.common,
            Command::Terrain(args) => &args.common,
            Command::Reproduce(args) => &args.common,
            Command::Generate(args) => &args.common,
            Command::Batch(_)
            | Command::Fbem(_)
            | Command::Completions(_)
            | Command::Man(_)
            | Command::Merge(_)
            | Command::Report(_)
            | Command::RunJob => return None,
        })
    }
}

fn run(command: &Command) -> Result<ExitCode> {
    match command {
        Command::Info(args) => info::run(args),
        Command::Bench(args) => bench::run(args),
        Command::Fbem(args) => fbem::run(args),
        Command::Solve(args) => solve::run(args),
        Command::Reference(args) => oracle::run(args),
        Command::Compare(args) => compare::run(args),
        Command::FormFactors(args) => form_factors::run(args),
        Command::Batch(args) => batch::run(args),
        Command::Merge(args) => merge::run(args),
        Command::Report(args) => report::run(args),
        Command::Terrain(args) => terrain::run(args),
        Command::Reproduce(args) => reproduce::run(args),
        Command::Generate(args) => generate::run(args),
        Command::Completions(args) => help::completions(args),
        Command::Man(args) => help::pages(args),
        Command::RunJob => batch::run_requested(),
    }
}

/// Parses the arguments, runs the subcommand, and reports any error, also a panic, as one line on standard error.
pub fn main() -> ExitCode {
    static PANIC: Mutex<String> = Mutex::new(String::new());
    let last = || PANIC.lock().unwrap_or_else(PoisonError::into_inner);
    // A panic while a file is read becomes an error of that file; any other ends in the message below.
    std::panic::set_hook(Box::new(move |info| *last() = info.to_string()));
    catch_unwind(parse_and_run).unwrap_or_else(|_| {
        let what = last().split_whitespace().collect::<Vec<_>>().join(" ");
        say(&format!("mrvis: internal error, please report it: {what}"));
        mpi::end_after_error();
        ExitCode::from(FAILED)
    })
}

fn parse_and_run() -> ExitCode {
    let parsed = help::command().try_get_matches().and_then(|matches| Cli::from_arg_matches(&matches));
    let mut cli = match parsed {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            say(&format!("mrvis: {} (see mrvis --help)", usage(&error)));
            return ExitCode::from(2);
        }
        Err(version) if version.kind() == clap::error::ErrorKind::DisplayVersion => {
            let embree = embree_version().unwrap_or_else(|e| one_line(&e));
            let _ = print(&format!("mrvis {} (Embree {embree})\n", env!("CARGO_PKG_VERSION")));
            return ExitCode::SUCCESS;
        }
        Err(help) => {
            let _ = help.print();
            return ExitCode::SUCCESS;
        }
    };
    limits::end_aborts_as_errors();
    if let Err(error) = mpi::start(&mut cli.command, cli.quiet) {
        return failed(&error);
    }
    // A batch has a budget of its own, and one job's memory must not end the others.
    if !matches!(cli.command, Command::Batch(_)) {
        limits::watch(cli.command.common().and_then(|common| common.max_memory));
    }
    match run(&cli.command) {
        Ok(code) => mpi::end(code),
        // A reader may close the pipe early.
        Err(Error::Io { source, .. }) if source.kind() == ErrorKind::BrokenPipe => {
            // Other ranks may wait for rows of this one.
            mpi::end_after_error();
            ExitCode::SUCCESS
        }
        Err(error) => failed(&error),
    }
}

fn failed(error: &Error) -> ExitCode {
    let (sign, text) = (mpi::sign(), one_line(error));
    // A closed standard error is ignored.
    say(&format!("mrvis: {sign}{text}"));
    mpi::end_after_error();
    ExitCode::from(FAILED)
}

/// The error in a command line, with a suggestion if there is one, without usage.
fn usage(error: &clap::Error) -> String {
    if error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return "no command is given".into();
    }
    let text = in_words(&error.to_string());
    let what: Vec<&str> = text.lines().take_while(|l| !l.trim().is_empty()).map(str::trim).collect();
    let what = what.join(" ").trim_start_matches("error: ").to_owned();
    let similar = [ContextKind::SuggestedArg, ContextKind::SuggestedSubcommand, ContextKind::SuggestedValue];
    let similar = similar.into_iter().find_map(|kind| match error.get(kind)? {
        ContextValue::String(text) => Some(text.clone()),
        ContextValue::Strings(list) => list.first().cloned(),
        _ => None,
    });
    similar.map_or(what.clone(), |similar| format!("{what}; did you mean {similar}?"))
}

/// Longest message, characters: a screen of 80 x 24.
const MAX_MESSAGE: usize = 1900;

/// The error and its causes on one line, with flags, without repetition.
fn one_line(error: &Error) -> String {
    let mut text = error.worded(flags::word);
    let mut cause = error.source();
    while let Some(e) = cause {
        let next = e.to_string();
        if !text.contains(&next) {
            text = format!("{text}: {next}");
        }
        cause = e.source();
    }
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    text.chars().filter(|c| !is_obeyed(*c)).take(MAX_MESSAGE).collect()
}

/// Feature sizes by name from the content of a file; see `solve --feature-sizes`.
pub(crate) fn feature_sizes(path: &std::path::Path, bytes: &[u8]) -> Result<Vec<(String, f32)>> {
    solve::parse_feature_sizes(path, bytes)
}

/// Writes to standard output what is [`printable`].
fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(printable(text).as_bytes())
        .and_then(|()| out.flush())
        .map_err(|e| Error::io("standard output", e))
}

/// Cores that this process may use.
fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Prints a line to the standard error stream in one write, so that lines of other processes do not come between its parts.
pub(crate) fn say(line: &str) {
    let _ = std::io::stderr().write_all(printable(&format!("{line}\n")).as_bytes());
}

/// A text without characters that a terminal could obey, besides ends of lines and tabs. Names and messages from files are in it.
pub(crate) fn printable(text: &str) -> String {
    text.chars().filter(|&c| !is_obeyed(c) || c == '\n' || c == '\t').collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn errors_are_one_line() {
        let check = |error: Error, want| assert_eq!(one_line(&error), want);
        check(Error::io("a b.obj", ErrorKind::NotFound.into()), "a b.obj: entity not found");
        check(Error::format("a.obj", Some(3), "two\nlines"), "a.obj:3: two lines");
    }
}
