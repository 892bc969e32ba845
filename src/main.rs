//! The command `mrvis`.

fn main() -> std::process::ExitCode {
    mrvis::cli::main()
}
