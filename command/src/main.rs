//! The command `mrvis`. Exit code 0: done; 1: done, but a stated tolerance was missed; 2: error.

fn main() -> std::process::ExitCode {
    mrvis_command::main()
}
