//! Work without the GIL: the calling thread waits, and serves progress and signals meanwhile.

use crate::errors::{Raise, panicked};
use mrvis::Progress;
use pyo3::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

/// How often the calling thread looks for signals and reports progress: a key that stops the program feels immediate below 0.1 s.
const TICK: Duration = Duration::from_millis(50);

/// Stack of the working thread, bytes: that of the threads of a model.
const STACK: usize = 8 << 20;

enum Event {
    Stage(String),
    Done,
}

/// What the computation says, and whether it shall stop.
pub struct Watch {
    events: Sender<Event>,
    steps: AtomicU64,
    done: AtomicU64,
    stop: AtomicBool,
}

impl Progress for Watch {
    fn stage(&self, name: &str, steps: u64) {
        self.steps.store(steps, Relaxed);
        self.done.store(0, Relaxed);
        // The receiver lives as long as the work.
        let _ = self.events.send(Event::Stage(name.to_owned()));
    }

    fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Relaxed);
    }

    fn stopped(&self) -> bool {
        self.stop.load(Relaxed)
    }
}

impl Watch {
    /// Part of the stage that is done, in `[0, 1]`; 0 if the number of its steps is unknown.
    fn fraction(&self) -> f64 {
        match self.steps.load(Relaxed) {
            0 => 0.0,
            steps => (self.done.load(Relaxed) as f64 / steps as f64).min(1.0),
        }
    }
}

/// Does short work without the GIL on the calling thread. Neither signals nor progress are served.
pub fn short<R: Send>(py: Python<'_>, work: impl FnOnce() -> mrvis::Result<R> + Send) -> PyResult<R> {
    match py.detach(|| catch_unwind(AssertUnwindSafe(work))) {
        Ok(result) => result.raise(py),
        Err(panic) => Err(panicked(py, &*panic)),
    }
}

/// Does work without the GIL on another thread. Meanwhile `progress(stage, fraction)` is called on this one: when a stage begins and every
/// [`TICK`]. The work is told to stop if it returns `False` or raises, or a signal raises: that exception is raised when the work has
/// stopped, whatever its result.
pub fn long<R: Send>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&Watch) -> mrvis::Result<R> + Send,
) -> PyResult<R> {
    let (result, raised) = py.detach(|| {
        let (events, heard) = channel();
        let watch =
            Watch { events, steps: AtomicU64::new(0), done: AtomicU64::new(0), stop: AtomicBool::new(false) };
        thread::scope(|scope| {
            let job = || {
                let result = catch_unwind(AssertUnwindSafe(|| work(&watch)));
                let _ = watch.events.send(Event::Done);
                result
            };
            let working = match thread::Builder::new().stack_size(STACK).spawn_scoped(scope, job) {
                Ok(working) => working,
                Err(error) => {
                    return (Ok(Err(mrvis::Error::OutOfMemory(format!("a thread: {error}")))), None);
                }
            };
            let raised = serve(&watch, &heard, progress.as_ref());
            (working.join().unwrap_or_else(|panic: Box<dyn Any + Send>| Err(panic)), raised)
        })
    });
    match (result, raised) {
        (Err(panic), _) => Err(panicked(py, &*panic)),
        (_, Some(raised)) => Err(raised),
        (Ok(result), None) => result.raise(py),
    }
}

/// Reports until the work is done; gives what the caller's function or a signal raised.
fn serve(watch: &Watch, heard: &Receiver<Event>, progress: Option<&Py<PyAny>>) -> Option<PyErr> {
    let (mut stage, mut raised) = (None, None);
    loop {
        match heard.recv_timeout(TICK) {
            Ok(Event::Stage(name)) => stage = Some(name),
            Err(RecvTimeoutError::Timeout) => {}
            Ok(Event::Done) | Err(RecvTimeoutError::Disconnected) => return raised,
        }
        if raised.is_some() {
            continue;
        }
        let goes_on = Python::attach(|py| {
            py.check_signals()?;
            let (Some(progress), Some(stage)) = (progress, &stage) else { return Ok(true) };
            let said = progress.bind(py).call1((stage, watch.fraction()))?;
            Ok(!said.is(pyo3::types::PyBool::new(py, false)))
        });
        match goes_on {
            Ok(true) => {}
            Ok(false) => watch.stop.store(true, Relaxed),
            Err(error) => {
                raised = Some(error);
                watch.stop.store(true, Relaxed);
            }
        }
    }
}
