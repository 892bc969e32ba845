//! What stands above the instances of a model: the Embree scene of instances and the groups of instances.

use super::instance::Instance;
use super::mesh::Mesh;
use crate::Result;
use crate::clusters::{self, Tree};
use crate::embree::{CommittedScene, Device, SceneBuilder};
use crate::math::Aabb;
use crate::optics::groups::{self, Member};
use crate::optics::{self, ClusterOptics};
use crate::visibility::{Frame, InstanceTree};
use std::collections::HashMap;
use std::sync::Arc;

/// The Embree scene of all present instances, and their groups.
pub struct TopLevel {
    /// Box around all present instances.
    pub bounds: Aabb,
    pub traced: CommittedScene,
    /// Seconds of measuring and laying out the groups.
    pub groups_s: f64,
    /// None if the meshes have no optics.
    pub groups: Option<Groups>,
}

/// Groups of instances.
pub struct Groups {
    pub instances: Arc<InstanceTree>,
    /// Optics by what they were measured on: an update measures only groups with changed members.
    measured: HashMap<blake3::Hash, ClusterOptics>,
}

impl TopLevel {
    /// Builds everything above the instances; takes the optics of groups with the same members from `before`.
    ///
    /// # Errors
    /// [`crate::Error::Embree`] if Embree reports an error.
    pub fn build(
        device: &Device,
        meshes: &[Arc<Mesh>],
        instances: &[Instance],
        options: &optics::Options,
        before: Option<&TopLevel>,
    ) -> Result<TopLevel> {
        let present: Vec<u32> =
            (0..instances.len() as u32).filter(|&i| instances[i as usize].is_present()).collect();
        let mesh = |i: u32| &meshes[instances[i as usize].mesh as usize];
        let mut builder = SceneBuilder::new(device, Default::default())?;
        for &i in &present {
            builder.add_instance(&mesh(i).traced, instances[i as usize].transform_f32(), i)?;
        }
        let traced = builder.commit()?;
        let boxes: Vec<Aabb> =
            present.iter().map(|&i| instances[i as usize].bounds(&mesh(i).scene)).collect();
        let bounds = boxes.iter().fold(Aabb::EMPTY, |a, &b| a.union(b));
        let magnitude = bounds.min.abs().max(bounds.max.abs()).max_element();
        let measured = meshes.iter().all(|mesh| mesh.measured().is_some());
        let start = std::time::Instant::now();
        let groups = measured.then(|| {
            // The scene's own triangles have a tree of their own.
            let placed = present.iter().zip(&boxes).filter(|(i, _)| instances[**i as usize].mesh > 0);
            let (placed, boxes): (Vec<u32>, Vec<Aabb>) = placed.map(|(i, b)| (*i, *b)).unzip();
            let known = before.and_then(|top| top.groups.as_ref()).map(|groups| &groups.measured);
            Groups::build(meshes, instances, (&placed, &boxes), magnitude, options, known)
        });
        let groups_s = start.elapsed().as_secs_f64();
        Ok(TopLevel { bounds, traced, groups_s, groups })
    }
}

impl Groups {
    /// Bytes of the optics that are kept for updates.
    pub fn bytes(&self) -> usize {
        self.measured.capacity() * (size_of::<blake3::Hash>() + size_of::<ClusterOptics>())
    }

    fn build(
        meshes: &[Arc<Mesh>],
        instances: &[Instance],
        (placed, boxes): (&[u32], &[Aabb]),
        magnitude: f32,
        options: &optics::Options,
        known: Option<&HashMap<blake3::Hash, ClusterOptics>>,
    ) -> Groups {
        let measured = |i: u32| {
            let mesh = &meshes[instances[i as usize].mesh as usize];
            mesh.measured().expect("all meshes are measured")
        };
        let tree = clusters::over_boxes(boxes);
        let members: Vec<Member> = placed
            .iter()
            .map(|&i| Member { parts: &measured(i).parts, to_world: instances[i as usize].transform_f32() })
            .collect();
        let keys: Vec<blake3::Hash> =
            (0..tree.clusters.len()).map(|c| key(&tree, c, placed, instances)).collect();
        let is_group = |c: &u32| tree.triangles_of(*c as usize).len() > 1;
        let fresh: Vec<u32> = (0..tree.clusters.len() as u32)
            .filter(is_group)
            .filter(|&c| known.is_none_or(|known| !known.contains_key(&keys[c as usize])))
            .collect();
        let mut made = groups::measure_some(&tree, &fresh, &members, options).into_iter();
        let optics: Vec<Option<ClusterOptics>> = (0..tree.clusters.len() as u32)
            .map(|c| {
                is_group(&c).then(|| match known.and_then(|known| known.get(&keys[c as usize])) {
                    Some(optics) => *optics,
                    None => made.next().expect("one for each fresh group"),
                })
            })
            .collect();
        let frames = placed
            .iter()
            .map(|&i| Frame::new(measured(i).tree.clone(), instances[i as usize].transform, magnitude));
        let instances = Arc::new(InstanceTree::build(&tree, &optics, boxes, frames.collect()));
        let measured = keys.into_iter().zip(optics).filter_map(|(key, optics)| Some((key, optics?)));
        Groups { instances, measured: measured.collect() }
    }
}

/// What the optics of a group depend on: its members with their meshes and transforms, in the order of the tree.
fn key(tree: &Tree, cluster: usize, placed: &[u32], instances: &[Instance]) -> blake3::Hash {
    let mut hash = blake3::Hasher::new();
    for &member in tree.triangles_of(cluster) {
        let Instance { mesh, transform, .. } = &instances[placed[member as usize] as usize];
        hash.update(&mesh.to_le_bytes());
        hash.update(bytemuck::cast_slice(&transform.to_cols_array()));
    }
    hash.finalize()
}
