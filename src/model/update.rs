//! Updates: instances move, come, go, appear and disappear; meshes stay as they are.

use super::instance::{Instance, InstanceChange, is_single};
use super::top_level::{Previous, TopLevel};
use super::{Inner, Model};
use crate::{Error, Result};
use std::collections::BTreeSet;
use std::sync::Arc;

impl Model {
    /// The model after some changes of its instances, in their order. Its answers are those of a model that is prepared
    /// afresh with the changed instances. Clusters of meshes are not measured again. Groups of instances are made and measured anew
    /// above the old and new places of changed instances, O(changed · log n); all others are shared with this model.
    ///
    /// Two parts take O(n): the list of instances is copied, and Embree builds its tree of instances anew, because it has no way to
    /// change one: a scene of which one instance moved takes as long to commit as a new one.
    ///
    /// | instances | 1 moved | 100 moved |
    /// | --- | --- | --- |
    /// | 1,000 | 3.4 ms | 37 ms |
    /// | 10,000 | 9.1 ms | 23 ms |
    /// | 100,000 | 58 ms | 133 ms |
    ///
    /// (Medians of `cargo bench --features internals --bench preparation -- update`, trees of 100 leaves, two cores. In the smallest
    /// model 100 changes touch most groups, each with many members.)
    ///
    /// The scene's own triangles (instance 0) can be neither moved nor removed nor hidden: they hold the light sources.
    ///
    /// # Errors
    /// [`Error::Argument`] if an index is out of range or names instance 0, or a transform is not finite or has shear or
    /// unequal scale; [`Error::Embree`]. The model itself does not change.
    pub fn update(&self, changes: &[InstanceChange]) -> Result<Model> {
        let inner = &*self.inner;
        let mut instances = inner.instances.clone();
        let mut changed = BTreeSet::new();
        for (i, change) in changes.iter().enumerate() {
            let applied = apply(&mut instances, inner, change);
            changed.insert(applied.map_err(|error| error.in_entry("changes", i))?);
        }
        let changed: Vec<u32> = changed.into_iter().collect();
        let before =
            inner.top.as_ref().map(|top| Previous { top, instances: &inner.instances, changed: &changed });
        let top = match is_single(&instances) {
            true => None,
            false => Some(self.on_threads(|| {
                TopLevel::build(
                    &inner.device,
                    &inner.meshes,
                    &instances,
                    &inner.options.optics,
                    before.as_ref(),
                )
            })??),
        };
        Ok(Model {
            inner: Arc::new(Inner { instances, top, revision: inner.revision + 1, ..inner.copied() }),
            ranks: self.ranks.clone(),
            watcher: Default::default(),
        })
    }
}

/// Applies one change; returns the number of its instance.
fn apply(instances: &mut Vec<Instance>, inner: &Inner, change: &InstanceChange) -> Result<u32> {
    let (count, meshes) = (instances.len(), inner.meshes.len());
    let mesh = |instance: &Instance| inner.meshes[instance.mesh as usize].scene.as_ref();
    let wrong = |i: usize, problem: String| Error::argument("instance", i, problem);
    let at = |index: u32| match index as usize {
        0 => Err(wrong(0, "the scene's own triangles and light sources cannot change".into())),
        i if i >= count || instances[i].removed => {
            Err(wrong(i, format!("does not exist (there are {count}, removed ones included)")))
        }
        i => Ok(i),
    };
    match change {
        InstanceChange::Move { instance, transform } => {
            let i = at(*instance)?;
            let moved = Instance { transform: *transform, ..instances[i].clone() };
            moved.check(i, mesh(&moved), &inner.scene.materials)?;
            instances[i] = moved;
            Ok(i as u32)
        }
        InstanceChange::Add(instance) => {
            if instance.mesh == 0 || instance.mesh as usize >= meshes {
                let own = "mesh 0 holds the scene's own triangles";
                return Err(wrong(count, format!("mesh {} must lie in 1..{meshes} ({own})", instance.mesh)));
            }
            instance.check(count, mesh(instance), &inner.scene.materials)?;
            instances.push(Instance { removed: false, ..instance.clone() });
            Ok(count as u32)
        }
        InstanceChange::Remove { instance } => {
            let i = at(*instance)?;
            instances[i].removed = true;
            Ok(i as u32)
        }
        InstanceChange::Show { instance, visible } => {
            let i = at(*instance)?;
            instances[i].visible = *visible;
            Ok(i as u32)
        }
    }
}
