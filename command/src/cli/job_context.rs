//! Context of a command that runs as a job of a batch, by thread; none on other threads.

use super::shared_scenes::{InUse, SharedScenes};
use crate::batch::HashedFile;
use mrvis::{Detail, Model, PrepareOptions, Progress, Result, Scene};
use std::cell::RefCell;
use std::sync::Arc;

/// The job that runs on this thread.
struct Context {
    /// Its command line, for pages.
    command_line: String,
    shared: Arc<SharedScenes>,
    /// Files that it has read or looked for.
    read: Vec<HashedFile>,
    /// Scenes that it uses.
    uses: Vec<InUse>,
}

thread_local! {
    static CONTEXT: RefCell<Option<Context>> = const { RefCell::new(None) };
}

/// Runs `work` as a job with this command line; returns also the files of the scenes that it has read.
pub fn within<R>(
    command_line: &str,
    shared: &Arc<SharedScenes>,
    work: impl FnOnce() -> R,
) -> (R, Vec<HashedFile>) {
    let context = Context {
        command_line: command_line.into(),
        shared: shared.clone(),
        read: Vec::new(),
        uses: Vec::new(),
    };
    CONTEXT.with(|c| c.replace(Some(context)));
    let result = work();
    let read = CONTEXT.with(|c| c.take()).map(|context| context.read);
    (result, read.unwrap_or_default())
}

/// The command line of the job on this thread.
pub fn command_line() -> Option<String> {
    CONTEXT.with(|c| c.borrow().as_ref().map(|context| context.command_line.clone()))
}

fn shared() -> Option<Arc<SharedScenes>> {
    CONTEXT.with(|c| c.borrow().as_ref().map(|context| context.shared.clone()))
}

/// A scene, which `read` reads unless another job of the batch has read it; `key`: its file and the options that change it.
///
/// # Errors
/// As `read`.
pub fn scene(key: impl FnOnce() -> String, read: impl FnOnce() -> Result<Scene>) -> Result<Arc<Scene>> {
    let Some(shared) = shared() else { return Ok(Arc::new(read()?)) };
    let (scene, in_use) = shared.scene(key(), read)?;
    let mut files = shared.files(&scene);
    CONTEXT.with(|c| {
        for context in c.borrow_mut().iter_mut() {
            context.read.append(&mut files);
            context.uses.push(in_use.clone());
        }
    });
    Ok(scene)
}

/// As [`Model::prepare`], but reuses what another job of the batch has prepared.
///
/// # Errors
/// As [`Model::prepare`].
pub fn prepare(scene: Arc<Scene>, options: &PrepareOptions, progress: &dyn Progress) -> Result<Model> {
    match shared() {
        None => Model::prepare_watched(scene, options, progress),
        Some(shared) => shared.model(scene, options, progress),
    }
}

/// [`prepare`] for rays alone.
///
/// # Errors
/// As [`Model::prepare`].
pub fn prepare_rays(scene: Arc<Scene>, progress: &dyn Progress) -> Result<Model> {
    let mut options = PrepareOptions::default();
    options.detail = Detail::Rays;
    prepare(scene, &options, progress)
}
