//! What a command knows of the batch that it runs in: nothing on a thread that no batch prepared.

use std::cell::RefCell;
use std::path::PathBuf;

/// The job that runs on this thread.
#[derive(Default)]
struct Context {
    /// Its command line, for pages.
    command_line: String,
    /// Files that it has read.
    read: Vec<PathBuf>,
}

thread_local! {
    static CONTEXT: RefCell<Option<Context>> = const { RefCell::new(None) };
}

/// Runs `work` as a job with this command line; returns also the files that it has read.
pub fn within<R>(command_line: &str, work: impl FnOnce() -> R) -> (R, Vec<PathBuf>) {
    let context = Context { command_line: command_line.into(), read: Vec::new() };
    CONTEXT.with(|c| c.replace(Some(context)));
    let result = work();
    let read = CONTEXT.with(|c| c.take()).map(|context| context.read);
    (result, read.unwrap_or_default())
}

/// The command line of the job on this thread.
pub fn command_line() -> Option<String> {
    CONTEXT.with(|c| c.borrow().as_ref().map(|context| context.command_line.clone()))
}

/// Notes files that a job has read.
pub fn note_read(files: &[PathBuf]) {
    CONTEXT.with(|c| c.borrow_mut().iter_mut().for_each(|context| context.read.extend_from_slice(files)));
}
