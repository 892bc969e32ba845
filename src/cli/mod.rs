//! The command `mrvis`: one file per subcommand, on the public API of the other rooms.

use clap::{Parser, Subcommand};
use std::process::ExitCode;

pub mod bench;
pub mod fbem;

/// Visibility and radiosity in scenes full of small detail.
#[derive(Parser)]
#[command(name = "mrvis", version)]
struct Command {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Bench(bench::Args),
    Fbem(fbem::Args),
}

/// Runs the command line; errors are one line on stderr and exit code 2.
pub fn main() -> ExitCode {
    let command = match Command::try_parse() {
        Ok(command) => command,
        Err(e) if e.use_stderr() => {
            let text = e.to_string();
            let line = text.lines().next().unwrap_or_default();
            eprintln!("mrvis: {} (see mrvis --help)", line.trim_start_matches("error: "));
            return ExitCode::from(2);
        }
        Err(help) => {
            let _ = help.print();
            return ExitCode::SUCCESS;
        }
    };
    let result = match &command.what {
        What::Bench(args) => bench::run(args),
        What::Fbem(args) => fbem::run(args),
    };
    result.unwrap_or_else(|e| {
        eprintln!("mrvis: {e}");
        ExitCode::from(2)
    })
}
