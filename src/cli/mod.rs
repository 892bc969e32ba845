//! The command line: converts arguments to calls of the library, and results to text and JSON.
//!
//! A subcommand is a module with `pub struct Args` (clap) and `pub fn run(&Args) -> Result<ExitCode>`, and one line
//! each in `Command` and `run`.

mod args;
mod bench;
mod compare;
mod fbem;
mod flags;
mod form_factors;
mod generate;
mod info;
mod oracle;
mod outputs;
mod progress;
mod solve;

use crate::{Error, Result};
use clap::{Parser, Subcommand};
use std::{
    error::Error as _,
    io::{ErrorKind, Write},
    process::ExitCode,
};

/// Visibility and radiosity in scenes with much small detail, by exact rays and by multi-resolution visibility.
#[derive(Parser)]
#[command(version, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Command,
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
    /// Write a procedural scene as OBJ and MTL (list of scenes: --list).
    Generate(generate::Args),
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
        Command::Generate(args) => generate::run(args),
    }
}

/// Parses the arguments, runs the subcommand, and reports any error as one line on standard error.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            let _ = writeln!(std::io::stderr(), "mrvis: {} (see mrvis --help)", usage(&error));
            return ExitCode::from(2);
        }
        Err(help) => {
            let _ = help.print();
            return ExitCode::SUCCESS;
        }
    };
    match run(&cli.command) {
        Ok(code) => code,
        // A reader may close the pipe early.
        Err(Error::Io { source, .. }) if source.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(error) => {
            // A closed standard error is ignored.
            let _ = writeln!(std::io::stderr(), "mrvis: {}", flags::with_flags(&one_line(&error)));
            ExitCode::from(2)
        }
    }
}

/// The error in a command line, without usage and tips.
fn usage(error: &clap::Error) -> String {
    if error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return "no command is given".into();
    }
    let text = error.to_string();
    let what: Vec<&str> = text.lines().take_while(|l| !l.trim().is_empty()).map(str::trim).collect();
    what.join(" ").trim_start_matches("error: ").to_owned()
}

/// The error and its causes on one line, without repetition.
fn one_line(error: &Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(e) = cause {
        let next = e.to_string();
        if !text.contains(&next) {
            text = format!("{text}: {next}");
        }
        cause = e.source();
    }
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Writes to standard output.
fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(|e| Error::io("standard output", e))
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

    #[test]
    fn usage_errors_are_one_line() {
        for words in
            [&["mrvis"][..], &["mrvis", "bench"], &["mrvis", "fbem", "a", "--bogus"], &["mrvis", "nix"]]
        {
            let line = usage(&Cli::try_parse_from(words).err().unwrap());
            assert!(!line.contains('\n') && !line.is_empty() && !line.contains("Usage"), "{line}");
        }
    }
}
