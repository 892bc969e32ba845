//! Limit of the memory of the whole command.
//!
//! What can be estimated is checked before the work. For all else a thread compares the memory in use with the limit and ends
//! the command with an error: otherwise the system would end it without a word, or the machine would come to a standstill.

use crate::{Error, Result, memory};
use std::{
    io::Write as _,
    process,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

/// Time between two comparisons. Memory is filled at some 5 GB/s, so about 0.1 GB are taken in that time.
const INTERVAL: Duration = Duration::from_millis(20);
/// Memory below which no limit stops the command, bytes: the program, Embree and small scenes take about 60 MB.
const MIN_LIMIT: f64 = 0.1;

/// Bytes of one GiB.
pub const GIB: f64 = (1u64 << 30) as f64;

/// The value of `--max-memory`, GiB.
pub fn parse(text: &str) -> Result<f64, String> {
    let wanted = || format!("a number of GiB, at least {MIN_LIMIT}");
    text.parse().ok().filter(|g: &f64| g.is_finite() && *g >= MIN_LIMIT).ok_or_else(wanted)
}

/// The limit in bytes, of `--max-memory` or a part of what is available; `None` where that is unknown.
pub fn bytes(given: Option<f64>) -> Option<u64> {
    given.map(|g| (g * GIB) as u64).or_else(memory::usable)
}

/// What a refused allocation means: ends the command with an error of one line, unless the thread has an answer to it. Nothing is allocated.
pub fn refused(bytes: usize) {
    static ENDS: AtomicBool = AtomicBool::new(false);
    if memory::may_be_refused() {
        return;
    }
    // Other threads wait for the end.
    while ENDS.swap(true, Ordering::Relaxed) {
        thread::sleep(INTERVAL);
    }
    let mut line = [0; 160];
    let mut rest = &mut line[..];
    let what = "more bytes are needed, which the system refuses: take a smaller scene or coarser options";
    // A closed standard error is ignored.
    let _ = writeln!(rest, "mrvis: out of memory: {bytes} {what}");
    let left = rest.len();
    let _ = std::io::stderr().write_all(&line[..line.len() - left]);
    // What runs at the end of a program may need memory.
    #[cfg(unix)]
    signal_hook::low_level::exit(2);
    #[cfg(not(unix))]
    process::abort();
}

/// Libraries may end the program by SIGABRT, as if memory is refused; the exit code is then that of all errors, and there is no core dump.
pub fn end_aborts_as_errors() {
    // Without the handler the code is that of the signal.
    #[cfg(unix)]
    let _ = signal_hook::flag::register_conditional_shutdown(
        signal_hook::consts::SIGABRT,
        2,
        std::sync::Arc::new(true.into()),
    );
}

/// Ends the command with an error when it uses more memory than the limit.
pub fn watch(given: Option<f64>) {
    let (Some(limit), Some(_)) = (bytes(given), memory_stats::memory_stats()) else { return };
    let watched = move || {
        loop {
            let used = memory_stats::memory_stats().map_or(0, |m| m.physical_mem as u64);
            if used > limit {
                let error = Error::OutOfMemory(format!(
                    "{:.1} GB are in use, {:.1} GB are allowed: take a smaller scene or coarser options, or raise \
                     --max-memory",
                    used as f64 / 1e9,
                    limit as f64 / 1e9
                ));
                // A closed standard error is ignored.
                let _ = writeln!(std::io::stderr(), "mrvis: {error}");
                process::exit(2);
            }
            thread::sleep(INTERVAL);
        }
    };
    // Without the thread the system's own limit remains.
    let _ = thread::Builder::new().name("memory limit".into()).spawn(watched);
}
