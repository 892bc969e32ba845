//! The top level of a model: the Embree scene of instances and the groups of instances.

use super::instance::Instance;
use super::mesh::{Measured, Mesh};
use crate::clusters::placed::Cells;
use crate::embree::{CommittedScene, Device, SceneBuilder};
use crate::math::Aabb;
use crate::optics::groups::Member;
use crate::visibility::{Frame, InstanceTree, Instances, PlacedChange};
use crate::{Result, optics};
use std::sync::Arc;

/// The Embree scene of all present instances, and their groups.
pub struct TopLevel {
    /// Box around all present instances.
    pub bounds: Aabb,
    pub traced: CommittedScene,
    /// Seconds of measuring and laying out the groups.
    pub groups_s: f64,
    /// None if the meshes have no optics.
    pub groups: Option<Arc<InstanceTree>>,
}

/// The top level before an update.
pub struct Previous<'a> {
    pub top: &'a TopLevel,
    pub instances: &'a [Instance],
    /// The instances that the update changes, each once; those that it adds have the numbers after `instances`.
    pub changed: &'a [u32],
}

impl TopLevel {
    /// Builds the top level; takes groups without changed instances from `before`.
    ///
    /// # Errors
    /// [`crate::Error::Embree`] if Embree reports an error.
    pub fn build(
        device: &Device,
        meshes: &[Arc<Mesh>],
        instances: &[Instance],
        options: &optics::Options,
        before: Option<&Previous>,
    ) -> Result<TopLevel> {
        let mut builder = SceneBuilder::new(device)?;
        for (i, instance) in present(instances) {
            let mesh = &meshes[instance.mesh as usize];
            builder.add_instance(&mesh.traced, instance.transform_f32(), i)?;
        }
        let traced = builder.commit()?;
        let start = std::time::Instant::now();
        let measured: Option<Vec<&Measured>> = meshes.iter().map(|mesh| mesh.measured()).collect();
        let groups = measured.map(|measured| Arc::new(groups(meshes, &measured, instances, options, before)));
        let bounds = match &groups {
            Some(groups) => meshes[0].scene.bounds.union(groups.bounds()),
            None => present(instances)
                .map(|(_, instance)| instance.bounds(&meshes[instance.mesh as usize].scene))
                .fold(Aabb::EMPTY, Aabb::union),
        };
        Ok(TopLevel { bounds, traced, groups_s: start.elapsed().as_secs_f64(), groups })
    }
}

/// The instances that rays see, with their numbers.
fn present(instances: &[Instance]) -> impl Iterator<Item = (u32, &Instance)> {
    (0..).zip(instances).filter(|(_, instance)| instance.is_present())
}

/// Groups of all present instances but the first: the scene's own triangles have a tree of their own.
fn groups(
    meshes: &[Arc<Mesh>],
    measured: &[&Measured],
    instances: &[Instance],
    options: &optics::Options,
    before: Option<&Previous>,
) -> InstanceTree {
    let bounds = |instance: &Instance| instance.bounds(&meshes[instance.mesh as usize].scene);
    let before = before.and_then(|before| Some((before, before.top.groups.as_deref()?)));
    let change = |number: u32| {
        let old = before.and_then(|(before, _)| before.instances.get(number as usize));
        let new = Some(&instances[number as usize]).filter(|instance| instance.is_present());
        let frame = |instance: &Instance| {
            Frame::new(measured[instance.mesh as usize].tree.clone(), instance.affine())
        };
        PlacedChange {
            number,
            before: old.filter(|instance| instance.is_present()).map(bounds),
            after: new.map(|instance| (bounds(instance), frame(instance))),
        }
    };
    let changes = match before {
        Some((before, _)) => before.changed.iter().map(|&number| change(number)).collect(),
        None => present(instances).skip(1).map(|(number, _)| change(number)).collect(),
    };
    let sizes = meshes[1..].iter().map(|mesh| mesh.scene.bounds.extent().max_element());
    let placed = Instances {
        cells: Cells::for_size(sizes.fold(f32::MAX, f32::min)),
        own: meshes[0].scene.bounds,
        member: |number: u32| {
            let instance = &instances[number as usize];
            Member { parts: &measured[instance.mesh as usize].parts, to_world: instance.transform_f32() }
        },
        options,
    };
    InstanceTree::update(before.map(|(_, groups)| groups), changes, &placed)
}
