//! Progress callbacks on the thread of the caller.

use super::guard::{Call, Outcome};
use mrvis::internals::threads::{in_callback, is_in_callback};
use mrvis::{Error, Progress};
use std::ffi::{CString, c_char, c_void};
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// A callback of the header.
pub type mrv_progress =
    Option<unsafe extern "C" fn(user: *mut c_void, stage: *const c_char, done: f64) -> i32>;

/// Time between two calls of a callback: a progress bar that is drawn 20 times a second seems smooth.
const INTERVAL: Duration = Duration::from_millis(50);
/// Stack of the thread that does the work, bytes: as those of pools.
const STACK: usize = 8 << 20;

/// Does `work`. With a callback it is done on a thread of its own, while the thread of the caller calls the callback.
pub fn with_progress<R: Send>(
    call: &Call,
    callback: mrv_progress,
    user: *mut c_void,
    work: impl FnOnce(Arc<dyn Progress>) -> R + Send,
) -> Outcome<R> {
    let Some(callback) = callback else { return Ok(work(Arc::new(()))) };
    let ask = |stage: &CString, done: f64| {
        // SAFETY: the caller promises that the callback may be called so; `stage` outlives the call.
        call.in_caller_state(|| in_callback(true, || unsafe { callback(user, stage.as_ptr(), done) })) != 0
    };
    // Work of a call that is made in another callback stays apart from the pool that is at work there.
    let nested = is_in_callback();
    let told = Arc::new(ProgressState::default());
    // The first call comes before the work, so that the caller can stop it at once.
    told.stop.store(ask(&CString::from(c"start"), 0.0), Ordering::Relaxed);
    thread::scope(|scope| {
        let worker = thread::Builder::new().name("mrvis".into()).stack_size(STACK);
        let worker = worker.spawn_scoped(scope, || {
            let _over = EndOfWork(&told);
            in_callback(nested, || work(told.clone()))
        });
        let worker = worker.map_err(|e| Error::OutOfMemory(format!("a thread cannot be started ({e})")))?;
        if !told.stopped() {
            told.pass_on(ask);
        }
        Ok(worker.join().unwrap_or_else(|panic| resume_unwind(panic)))
    })
}

/// State that the working threads share with the thread of the caller.
#[derive(Default)]
struct ProgressState {
    stage: Mutex<Stage>,
    changed: Condvar,
    done: AtomicU64,
    stop: AtomicBool,
}

#[derive(Default)]
struct Stage {
    name: CString,
    steps: u64,
    is_new: bool,
    is_over: bool,
}

impl ProgressState {
    fn stage(&self) -> MutexGuard<'_, Stage> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls `ask` every [`INTERVAL`] and at the start of each stage, until the work ends or `ask` returns true.
    fn pass_on(&self, ask: impl Fn(&CString, f64) -> bool) {
        // The caller was asked before the work began.
        let mut due = Instant::now() + INTERVAL;
        loop {
            let mut stage = self.stage();
            while !stage.is_over && !stage.is_new && Instant::now() < due {
                let wait = due.saturating_duration_since(Instant::now());
                stage = self.changed.wait_timeout(stage, wait).unwrap_or_else(PoisonError::into_inner).0;
            }
            if stage.is_over {
                return;
            }
            stage.is_new = false;
            let (name, steps) = (stage.name.clone(), stage.steps);
            drop(stage);
            let part = self.done.load(Ordering::Relaxed) as f64 / steps as f64;
            if ask(&name, if steps == 0 { -1.0 } else { part.min(1.0) }) {
                self.stop.store(true, Ordering::Relaxed);
                return;
            }
            due = Instant::now() + INTERVAL;
        }
    }
}

impl Progress for ProgressState {
    fn stage(&self, name: &str, steps: u64) {
        let mut stage = ProgressState::stage(self);
        stage.name = CString::new(name).unwrap_or_default();
        (stage.steps, stage.is_new) = (steps, true);
        self.done.store(0, Ordering::Relaxed);
        self.changed.notify_one();
    }

    fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Guard that reports the end of the work when dropped, also after a panic.
struct EndOfWork<'a>(&'a ProgressState);

impl Drop for EndOfWork<'_> {
    fn drop(&mut self) {
        self.0.stage().is_over = true;
        self.0.changed.notify_one();
    }
}
