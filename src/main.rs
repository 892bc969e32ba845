//! The command `mrvis`. Exit code 0: done; 1: done, but a stated tolerance was missed; 2: error.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
