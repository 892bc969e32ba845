//! Scenes and models that several jobs of a batch use: read and prepared once.
//!
//! A job gets the same bits as alone: what is kept was made from files with the same content and with the same options. Jobs that need
//! the same scene at the same time wait for the one that makes it.

use crate::batch::{HashedFile, Hashes};
use mrvis::{Model, PrepareOptions, Progress, Result, Scene};
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Scenes and models of a batch.
pub struct SharedScenes {
    hashes: Arc<Hashes>,
    /// By file and options.
    kept: Mutex<HashMap<String, CachedScene>>,
    /// Counts uses.
    clock: AtomicU64,
}

/// A scene and what was prepared of it.
#[derive(Default)]
struct CachedScene {
    /// Held while the scene is read.
    gate: Arc<Mutex<()>>,
    scene: Option<(Arc<Scene>, Vec<HashedFile>)>,
    models: Arc<Mutex<Vec<PreparedModel>>>,
    /// Jobs that use it have clones.
    in_use: InUse,
    last_use: u64,
}

/// A model and the options of its preparation, without the detail.
struct PreparedModel {
    how: String,
    model: Model,
}

/// Reference that a job holds while it uses a scene: the scene is idle when all have been dropped.
pub type InUse = Arc<()>;

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What a job that panicked has left is whole: values are replaced, never changed.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl SharedScenes {
    /// Nothing yet.
    pub fn new(hashes: Arc<Hashes>) -> SharedScenes {
        SharedScenes { hashes, kept: Mutex::default(), clock: AtomicU64::default() }
    }

    /// The scene of this file with these options, read by `read` if there is none or its files have changed since.
    ///
    /// # Errors
    /// As `read`.
    pub fn scene(&self, key: String, read: impl FnOnce() -> Result<Scene>) -> Result<(Arc<Scene>, InUse)> {
        let now = self.clock.fetch_add(1, Ordering::Relaxed);
        let (gate, in_use) = {
            let mut kept = lock(&self.kept);
            let entry = kept.entry(key.clone()).or_default();
            entry.last_use = now;
            (entry.gate.clone(), entry.in_use.clone())
        };
        let _one_at_a_time = lock(&gate);
        let known = lock(&self.kept).get(&key).and_then(|entry| entry.scene.clone());
        if let Some((scene, files)) = known
            && files.iter().all(|file| self.hashes.of(&file.path) == *file)
        {
            return Ok((scene, in_use));
        }
        let scene = Arc::new(read()?);
        let files = self.files(&scene);
        let mut kept = lock(&self.kept);
        let entry = kept.entry(key).or_default();
        entry.scene = Some((scene.clone(), files));
        entry.models = Arc::default();
        Ok((scene, in_use))
    }

    /// The files of a scene with their content, also those that it names and that could not be read.
    pub fn files(&self, scene: &Scene) -> Vec<HashedFile> {
        let parts = scene.parts();
        parts.files.iter().chain(parts.unread_files).map(|file| self.hashes.of(file)).collect()
    }

    /// A model of a scene: what was prepared of it already is not made again.
    ///
    /// # Errors
    /// As [`Model::prepare`].
    pub fn model(
        &self,
        scene: Arc<Scene>,
        options: &PrepareOptions,
        progress: &dyn Progress,
    ) -> Result<Model> {
        let models = {
            let kept = lock(&self.kept);
            let is_it =
                |entry: &&CachedScene| entry.scene.as_ref().is_some_and(|(own, _)| Arc::ptr_eq(own, &scene));
            kept.values().find(is_it).map(|entry| entry.models.clone())
        };
        let Some(models) = models else { return Model::prepare_watched(scene, options, progress) };
        let (clusters, optics, cache) = options.parts();
        let how = format!("{clusters:?} {optics:?} {cache:?}");
        let mut models = lock(&models);
        let similar = models.iter().filter(|known| known.how == how).map(|known| &known.model);
        // Of the models with enough detail, or else of all, the most detailed.
        let made = match similar.max_by_key(|model| model.detail()) {
            None => Model::prepare_watched(scene, options, progress)?,
            Some(known) => known.prepared_again(options, progress)?,
        };
        models.retain(|known| known.how != how || known.model.detail() > made.detail());
        if models.iter().all(|known| known.how != how) {
            models.push(PreparedModel { how, model: made.clone() });
        }
        Ok(made)
    }

    /// Drops scenes that no job uses, the longest unused first, until all such take at most `bytes`.
    pub fn shrink_to(&self, bytes: u64) {
        let mut kept = lock(&self.kept);
        let idle = kept.iter().filter(|(_, entry)| Arc::strong_count(&entry.in_use) == 1);
        let mut idle: Vec<(u64, String, u64)> =
            idle.map(|(key, entry)| (entry.last_use, key.clone(), entry.bytes())).collect();
        idle.sort();
        let mut total: u64 = idle.iter().map(|(_, _, bytes)| bytes).sum();
        for (_, key, size) in idle {
            if total <= bytes {
                break;
            }
            kept.remove(&key);
            total -= size;
        }
    }
}

impl CachedScene {
    /// Memory of the scene and its models.
    fn bytes(&self) -> u64 {
        let scene = self.scene.as_ref().map_or(0, |(scene, _)| scene.bytes() as u64);
        scene + lock(&self.models).iter().map(|known| known.model.bytes()).sum::<u64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mrvis::Detail;
    use mrvis::internals::scene::generate::{Spec, soup};
    use mrvis::internals::scene::write_obj;
    use std::cell::Cell;
    use std::path::{Path, PathBuf};

    fn cornell(folder: &Path) -> PathBuf {
        let path = folder.join("cornell.obj");
        write_obj(&path, &soup(&Spec::new("cornell")).expect("a scene"), &[]).expect("written");
        path
    }

    /// Shared scenes of one file, which counts how often it is read.
    struct FileScenes {
        _folder: tempfile::TempDir,
        path: PathBuf,
        shared: SharedScenes,
        reads: Cell<usize>,
    }

    impl FileScenes {
        fn new() -> FileScenes {
            let folder = tempfile::tempdir().expect("a folder");
            let (path, shared) = (cornell(folder.path()), SharedScenes::new(Arc::default()));
            FileScenes { _folder: folder, path, shared, reads: Cell::new(0) }
        }

        fn scene(&self, key: &str) -> (Arc<Scene>, InUse) {
            let read = || {
                self.reads.set(self.reads.get() + 1);
                Scene::load_with(&self.path, &Default::default())
            };
            self.shared.scene(key.into(), read).expect("a scene")
        }
    }

    #[test]
    fn scenes_are_read_again_when_a_file_changes() {
        let all = FileScenes::new();
        let (path, reads) = (&all.path, &all.reads);
        let scene = || all.scene("cornell");
        let (first, _) = scene();
        assert!(Arc::ptr_eq(&first, &scene().0));
        // The materials are in a file of their own.
        let materials = path.with_extension("mtl");
        let text = std::fs::read_to_string(&materials).expect("read");
        std::fs::write(&materials, text.replace("Kd ", "Kd 0")).expect("written");
        assert!(!Arc::ptr_eq(&first, &scene().0));
        assert_eq!(reads.get(), 2);
        // So is a file that appears, and one that vanishes.
        std::fs::rename(&materials, path.with_extension("aside")).expect("renamed");
        let (without, _) = scene();
        assert!(Arc::ptr_eq(&without, &scene().0));
        std::fs::rename(path.with_extension("aside"), &materials).expect("renamed");
        assert!(!Arc::ptr_eq(&without, &scene().0));
        assert_eq!(reads.get(), 4);
        let missing =
            all.shared.scene("x".into(), || Scene::load_with(Path::new("x.obj"), &Default::default()));
        assert!(missing.is_err());
    }

    #[test]
    fn models_share_what_is_prepared() {
        let all = FileScenes::new();
        let (shared, (scene, _used)) = (&all.shared, all.scene("a"));
        let model = |detail| {
            let mut options = PrepareOptions::default();
            options.detail = detail;
            shared.model(scene.clone(), &options, &()).expect("a model")
        };
        let details = [Detail::Rays, Detail::Optics, Detail::Clusters, Detail::Rays, Detail::Optics];
        let models = details.map(model);
        assert_eq!(models.each_ref().map(Model::detail), details);
        // Nothing was made again after the second.
        for model in &models[2..] {
            let report = model.report();
            assert_eq!([report.embree_s, report.clusters_s, report.optics_s, report.cache_s], [0.0; 4]);
        }
        let tree = |model: &Model| model.base().hierarchy().clone();
        assert!(Arc::ptr_eq(&tree(&models[1]), &tree(&models[2])));
        assert!(Arc::ptr_eq(&tree(&models[1]), &tree(&models[4])));
    }

    #[test]
    fn idle_scenes_are_dropped_the_longest_unused_first() {
        let all = FileScenes::new();
        let (shared, reads) = (&all.shared, &all.reads);
        let scene = |key: &str| all.scene(key);
        let used = scene("used");
        let size = used.0.bytes() as u64;
        ["old", "new"].into_iter().for_each(|key| drop(scene(key)));
        shared.shrink_to(size);
        assert_eq!(reads.get(), 3);
        ["used", "new"].into_iter().for_each(|key| drop(scene(key)));
        assert_eq!(reads.get(), 3, "these are there");
        scene("old");
        assert_eq!(reads.get(), 4, "this was dropped");
    }
}
