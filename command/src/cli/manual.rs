//! `mrvis completions SHELL` and `mrvis man --out DIR`: files that `make install` installs beside the command.

use super::writable::check_folder;
use mrvis::{Error, Result};
use std::{path::PathBuf, process::ExitCode};

#[derive(clap::Args, Debug)]
pub struct CompletionsArgs {
    /// The shell.
    #[arg(value_name = "SHELL", value_enum)]
    shell: clap_complete::Shell,
}

#[derive(clap::Args, Debug)]
pub struct ManArgs {
    /// Folder for the pages (created if missing).
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Prints the script that completes options and subcommands.
///
/// # Errors
/// Standard output cannot be written.
pub fn completions(args: &CompletionsArgs) -> Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut super::help::command(), "mrvis", &mut script);
    super::print(&String::from_utf8_lossy(&script))?;
    Ok(ExitCode::SUCCESS)
}

/// Writes one page for the command and one for each subcommand.
///
/// # Errors
/// A page cannot be written.
pub fn pages(args: &ManArgs) -> Result<ExitCode> {
    let _folder = check_folder(&args.out)?;
    let command = super::help::command().disable_help_subcommand(true);
    clap_mangen::generate_to(command, &args.out).map_err(|e| Error::io(&args.out, e))?;
    Ok(ExitCode::SUCCESS)
}
