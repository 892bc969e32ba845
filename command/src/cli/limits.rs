//! Limit of the memory of the whole command.
//!
//! Estimated memory is checked before the computation. For the rest a thread compares the memory in use with the limit and ends the
//! command with an error: otherwise the system would kill it without a message, or the machine would swap.

use mrvis::internals::memory;
use mrvis::{Error, Result};
#[cfg(not(unix))]
use std::process;
use std::{thread, time::Duration};

/// Time between two comparisons. Memory is filled at some 5 GB/s, so about 0.1 GB are taken in that time.
const INTERVAL: Duration = Duration::from_millis(20);
/// Address space at which a command with a limit of it ends, bytes: about what is taken between two comparisons.
const ADDRESS_RESERVE: u64 = 1 << 27;
/// Memory below which no limit stops the command, bytes: the program, Embree and small scenes take about 60 MB.
const MIN_LIMIT: f64 = 0.1;

/// Bytes of one GiB.
pub const GIB: f64 = (1u64 << 30) as f64;

/// The value of `--max-memory`, GiB.
pub fn parse(text: &str) -> Result<f64, String> {
    let wanted = || format!("a number of GiB, at least {MIN_LIMIT}");
    text.parse().ok().filter(|g: &f64| g.is_finite() && *g >= MIN_LIMIT).ok_or_else(wanted)
}

/// The limit in bytes, of `--max-memory` or a fraction of what is available; `None` where that is unknown.
pub fn bytes(given: Option<f64>) -> Option<u64> {
    given.map(|g| (g * GIB) as u64).or_else(memory::usable)
}

/// A refused allocation aborts the program (SIGABRT) after a message of the runtime; the exit code is then that of all errors. Other
/// reasons for that signal, as a defect of a library, have the same code and leave no core dump.
pub fn end_aborts_as_errors() {
    // Without the handler the code is that of the signal.
    #[cfg(unix)]
    let _ = signal_hook::flag::register_conditional_shutdown(
        signal_hook::consts::SIGABRT,
        2,
        std::sync::Arc::new(true.into()),
    );
}

/// Ends the command with an error when it uses more memory than the limit, or nearly all of a limit of its address space: memory that
/// is refused would abort it.
pub fn watch(given: Option<f64>) {
    let (Some(limit), Some(_)) = (bytes(given), memory_stats::memory_stats()) else { return };
    let watched = move || {
        loop {
            let used = memory_stats::memory_stats().map_or(0, |m| m.physical_mem as u64);
            if used > limit {
                out_of_memory(&format!(
                    "{:.1} GB are in use, {:.1} GB are allowed: take a smaller scene or coarser options, or raise \
                     --max-memory",
                    used as f64 / 1e9,
                    limit as f64 / 1e9
                ));
            }
            if memory::left_of_address_space().is_some_and(|left| left < ADDRESS_RESERVE) {
                out_of_memory(
                    "the limit of the address space is reached: raise it (`ulimit -v`), or take a smaller scene or \
                     coarser options",
                );
            }
            thread::sleep(INTERVAL);
        }
    };
    // Without the thread the system's own limit remains.
    let _ = thread::Builder::new().name("memory limit".into()).spawn(watched);
}

/// Ends the command.
fn out_of_memory(cause: &str) -> ! {
    // A closed standard error is ignored.
    super::say(&format!("mrvis: {}", Error::OutOfMemory(cause.into())));
    // Other threads are at work: what runs at the end of a program would take away what they use.
    #[cfg(unix)]
    signal_hook::low_level::exit(2);
    #[cfg(not(unix))]
    process::exit(2)
}
