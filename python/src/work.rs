//! Work without the GIL: the calling thread waits, and serves progress and signals meanwhile.

use crate::errors::{Raise, panicked, unsupported};
use mrvis::Progress;
use mrvis::internals::threads::{in_callback, is_in_callback};
use pyo3::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Time between two checks for signals and reports of progress by the calling thread: an interruption feels immediate below 0.1 s.
const CHECK_INTERVAL: Duration = Duration::from_millis(50);

/// Time after an exception until work that has not stopped is abandoned: Ctrl-C then acts within a second, two [`CHECK_INTERVAL`]s
/// included.
const ABANDON_DELAY: Duration = Duration::from_millis(500);

/// Stack of the working thread, bytes: that of the threads of a model.
const STACK: usize = 8 << 20;

enum Event {
    Stage(String),
    Done,
}

/// Progress of a computation, and the flag that stops it.
pub struct Watch {
    events: Mutex<Sender<Event>>,
    steps: AtomicU64,
    done: AtomicU64,
    stop: AtomicBool,
    /// Whether nothing of the work is left, its result included.
    ended: AtomicBool,
}

impl Progress for Watch {
    fn stage(&self, name: &str, steps: u64) {
        self.steps.store(steps, Relaxed);
        self.done.store(0, Relaxed);
        self.tell(Event::Stage(name.to_owned()));
    }

    fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Relaxed);
    }

    fn stopped(&self) -> bool {
        self.stop.load(Relaxed)
    }
}

impl Watch {
    fn new() -> (Arc<Watch>, Receiver<Event>) {
        let (events, heard) = channel();
        let (steps, done) = (AtomicU64::new(0), AtomicU64::new(0));
        let (stop, ended) = (AtomicBool::new(false), AtomicBool::new(false));
        (Arc::new(Watch { events: Mutex::new(events), steps, done, stop, ended }), heard)
    }

    fn tell(&self, event: Event) {
        // Abandoned work has no receiver.
        let _ = self.events.lock().unwrap_or_else(PoisonError::into_inner).send(event);
    }

    /// Fraction of the stage that is done, in `[0, 1]`; 0 if the number of its steps is unknown.
    fn fraction(&self) -> f64 {
        match self.steps.load(Relaxed) {
            0 => 0.0,
            steps => (self.done.load(Relaxed) as f64 / steps as f64).min(1.0),
        }
    }
}

/// The process that first did work. 0: none did yet.
static WORKED: AtomicU32 = AtomicU32::new(0);

/// Whether this process was forked from one that had done work: pools of threads and locks are copies without the threads that serve them.
fn is_forked() -> bool {
    ![0, std::process::id()].contains(&WORKED.load(Relaxed))
}

/// Refuses work that would wait for ever for threads of another process.
fn begin(py: Python<'_>) -> PyResult<()> {
    if is_forked() {
        return Err(unsupported(
            py,
            "mrvis worked before this process was forked, and its threads stayed behind: fork before the first call, or start processes \
             with multiprocessing.get_context(\"spawn\")",
        ));
    }
    WORKED.store(std::process::id(), Relaxed);
    Ok(())
}

/// The work of [`long`] that has not ended.
static RUNNING: Mutex<Vec<Arc<Watch>>> = Mutex::new(Vec::new());

fn running<R>(of: impl FnOnce(&mut Vec<Arc<Watch>>) -> R) -> R {
    of(&mut RUNNING.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Called when the program ends: stops work that was left behind and waits for it, because it uses libraries that are unloaded next. A
/// signal ends the waiting.
#[pyfunction]
pub fn stop_all(py: Python<'_>) -> PyResult<()> {
    if is_forked() {
        return Ok(());
    }
    let all = running(|all| all.clone());
    all.iter().for_each(|watch| watch.stop.store(true, Relaxed));
    while !all.iter().all(|watch| watch.ended.load(Relaxed)) {
        py.detach(|| thread::sleep(CHECK_INTERVAL));
        py.check_signals()?;
    }
    Ok(())
}

/// Does short work without the GIL on the calling thread. Neither signals nor progress are served.
pub fn short<R: Send>(py: Python<'_>, work: impl FnOnce() -> mrvis::Result<R> + Send) -> PyResult<R> {
    begin(py)?;
    match py.detach(|| catch_unwind(AssertUnwindSafe(work))) {
        Ok(result) => result.raise(py),
        Err(panic) => Err(panicked(py, &*panic)),
    }
}

/// Does work without the GIL on another thread. Meanwhile `progress(stage, fraction)` is called on this one: when a stage begins and
/// every [`CHECK_INTERVAL`]. The work is told to stop if it returns `False` or raises, or a signal raises. That exception is raised when
/// the work has stopped, whatever its result, and at the latest after [`ABANDON_DELAY`] or when a signal raises again: then the work is
/// left behind.
///
/// What `progress` itself asks is done apart from the threads that are at work, for which it would wait.
pub fn long<R: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(Arc<Watch>) -> mrvis::Result<R> + Send + 'static,
) -> PyResult<R> {
    begin(py)?;
    let (watch, heard) = Watch::new();
    let (results, result) = channel();
    let (own, nested) = (watch.clone(), is_in_callback());
    let job = move || {
        // Without a caller the result is dropped here.
        let _ = results.send(catch_unwind(AssertUnwindSafe(|| in_callback(nested, || work(own.clone())))));
        own.ended.store(true, Relaxed);
        own.tell(Event::Done);
    };
    running(|all| {
        all.retain(|watch| !watch.ended.load(Relaxed));
        all.push(watch.clone());
    });
    if let Err(error) = thread::Builder::new().stack_size(STACK).spawn(job) {
        watch.ended.store(true, Relaxed);
        return Err(mrvis::Error::OutOfMemory(format!("a thread: {error}"))).raise(py);
    }
    let (raised, result) = py.detach(move || {
        let raised = serve(&watch, &heard, progress.as_ref(), true);
        (raised, result.try_recv().ok())
    });
    match (raised, result) {
        (_, Some(Err(panic))) => Err(panicked(py, &*panic)),
        (Some(raised), _) => Err(raised),
        (None, Some(Ok(result))) => result.raise(py),
        (None, None) => Err(panicked(py, &"the work has no result")),
    }
}

/// [`long`] for work that borrows arrays: it cannot be left behind, and must stop soon.
pub fn borrowing<R: Send>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(Arc<Watch>) -> mrvis::Result<R> + Send,
) -> PyResult<R> {
    begin(py)?;
    let nested = is_in_callback();
    let (result, raised) = py.detach(|| {
        let (watch, heard) = Watch::new();
        thread::scope(|scope| {
            let job = || {
                let result = catch_unwind(AssertUnwindSafe(|| in_callback(nested, || work(watch.clone()))));
                watch.tell(Event::Done);
                result
            };
            let working = match thread::Builder::new().stack_size(STACK).spawn_scoped(scope, job) {
                Ok(working) => working,
                Err(error) => {
                    return (Ok(Err(mrvis::Error::OutOfMemory(format!("a thread: {error}")))), None);
                }
            };
            let raised = serve(&watch, &heard, progress.as_ref(), false);
            (working.join().unwrap_or_else(|panic: Box<dyn Any + Send>| Err(panic)), raised)
        })
    });
    match (result, raised) {
        (Err(panic), _) => Err(panicked(py, &*panic)),
        (_, Some(raised)) => Err(raised),
        (Ok(result), None) => result.raise(py),
    }
}

/// Reports until the work is done, or is to be left behind if it may be. Gives what the caller's function or a signal raised last.
fn serve(
    watch: &Watch,
    heard: &Receiver<Event>,
    progress: Option<&Py<PyAny>>,
    may_leave: bool,
) -> Option<PyErr> {
    let mut stage = None;
    let mut raised: Option<(PyErr, Instant)> = None;
    loop {
        match heard.recv_timeout(CHECK_INTERVAL) {
            Ok(Event::Stage(name)) => stage = Some(name),
            Err(RecvTimeoutError::Timeout) => {}
            Ok(Event::Done) | Err(RecvTimeoutError::Disconnected) => return raised.map(|(error, _)| error),
        }
        let ask = |py: Python<'_>| {
            py.check_signals()?;
            match (progress, &stage) {
                (Some(progress), Some(stage)) if !watch.stopped() => {
                    let said = progress.bind(py).call1((stage, watch.fraction()))?;
                    Ok(!said.is(pyo3::types::PyBool::new(py, false)))
                }
                _ => Ok(true),
            }
        };
        let goes_on: PyResult<bool> = in_callback(true, || Python::attach(ask));
        let is_again = match goes_on {
            Ok(true) => false,
            Ok(false) => {
                watch.stop.store(true, Relaxed);
                false
            }
            Err(error) => {
                watch.stop.store(true, Relaxed);
                let before = raised.take();
                let is_again = before.is_some();
                raised = Some((error, before.map_or_else(Instant::now, |(_, since)| since)));
                is_again
            }
        };
        if may_leave
            && let Some((_, since)) = &raised
            && (is_again || since.elapsed() > ABANDON_DELAY)
        {
            return raised.map(|(error, _)| error);
        }
    }
}
