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
            eprintln!("mrvis: {} (see mrvis --help)", one_line(&e));
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

/// What is wrong with a command line, without usage and tips.
fn one_line(error: &clap::Error) -> String {
    if error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return "no command is given".into();
    }
    let text = error.to_string();
    let what: Vec<&str> = text.lines().take_while(|l| !l.trim().is_empty()).map(str::trim).collect();
    what.join(" ").trim_start_matches("error: ").to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usage_errors_are_one_line() {
        for words in
            [&["mrvis"][..], &["mrvis", "bench"], &["mrvis", "bench", "a.obj", "--bogus"], &["mrvis", "nix"]]
        {
            let line = one_line(&Command::try_parse_from(words).err().unwrap());
            assert!(!line.contains('\n') && !line.is_empty() && !line.contains("Usage"), "{line}");
        }
    }

    #[test]
    fn the_command_line_is_sound() {
        use clap::CommandFactory;
        Command::command().debug_assert();
    }
}
