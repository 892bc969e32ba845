//! Interruption by the user (SIGINT): one flag for the whole process.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code after a second interruption: 128 + SIGINT, the convention of shells.
pub const INTERRUPTED: u8 = 130;

static STOPPED: AtomicBool = AtomicBool::new(false);

/// Installs a handler: the first interruption prints this message and sets the flag, the second ends the program. Later calls have no
/// effect.
pub fn watch(message: Option<&'static str>) {
    static WATCHED: OnceLock<()> = OnceLock::new();
    WATCHED.get_or_init(|| {
        // If the handler cannot be set, the first interruption ends the program.
        let _ = ctrlc::set_handler(move || {
            if STOPPED.swap(true, Ordering::Relaxed) {
                std::process::exit(INTERRUPTED.into());
            }
            if let Some(message) = message {
                // A closed standard error is ignored.
                super::say(&format!("mrvis: {message}"));
            }
        });
    });
}

/// Whether the user has interrupted the program.
pub fn stopped() -> bool {
    STOPPED.load(Ordering::Relaxed)
}
