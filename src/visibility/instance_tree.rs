//! The second level of clusters: placed meshes, and groups of them with their optics.

use super::shaft::Shaft;
use super::wide::{AxisOptics, NO_OPTICS, WideNode, WideTree, set_box, set_optics};
use crate::clusters::placed::{self, Cells, Change, Child, Item, Key};
use crate::math::Aabb;
use crate::optics::groups::{self, Member, Part};
use crate::optics::{self, AXIS_COUNT, ClusterOptics};
use crate::ray::Packet;
use crate::simd::Simd;
use glam::{Affine3A, DAffine3, Vec3};
use std::sync::Arc;

/// A placed mesh, as walks enter it.
#[derive(Clone)]
pub struct Frame {
    /// The clusters of the mesh, in its own frame.
    pub(super) tree: Arc<WideTree>,
    /// From the frame of the model to that of the mesh.
    to_mesh: DAffine3,
    /// Length in the model over length in the mesh.
    pub(super) scale: f32,
}

impl Frame {
    /// A mesh placed by `to_model`, a rotation or reflection with uniform scale.
    pub fn new(tree: Arc<WideTree>, to_model: DAffine3) -> Frame {
        let scale = to_model.matrix3.determinant().abs().cbrt() as f32;
        Frame { tree, to_mesh: to_model.inverse(), scale }
    }

    fn point(&self, p: Vec3) -> Vec3 {
        self.to_mesh.transform_point3(p.as_dvec3()).as_vec3()
    }

    /// Transforms the segments of a bundle and its emitter's hull into the frame of the mesh; returns the shaft there. `magnitude`
    /// is the largest coordinate magnitude of the model.
    #[inline(always)]
    pub(super) fn enter<S: Simd>(
        &self,
        simd: S,
        magnitude: f32,
        packets: &[Packet],
        emitter: &[Vec3],
        moved: &mut Vec<Packet>,
        hull: &mut Vec<Vec3>,
    ) -> Shaft {
        moved.clear();
        moved.extend(packets.iter().map(|packet| self.packet(packet)));
        hull.clear();
        hull.extend(emitter.iter().map(|&p| self.point(p)));
        // Segments keep the rounding errors that they have in the model.
        Shaft::of(simd, moved, hull, self.tree.magnitude.max(magnitude / self.scale))
    }

    /// The segments of a packet in the frame of the mesh.
    fn packet(&self, packet: &Packet) -> Packet {
        let mut moved = packet.clone();
        moved.slack = packet.slack.map(|slack| slack.map(|length| length / self.scale));
        for lane in packet.lanes() {
            let take = |v: &[[f32; 16]; 3]| Vec3::new(v[0][lane], v[1][lane], v[2][lane]);
            let origin = self.point(take(&packet.origin));
            let direction = self.to_mesh.transform_vector3(take(&packet.direction).as_dvec3()).as_vec3();
            for axis in 0..3 {
                moved.origin[axis][lane] = origin[axis];
                moved.direction[axis][lane] = direction[axis];
            }
        }
        moved
    }
}

/// An instance in the tree.
pub struct Placed {
    /// Its number.
    number: u32,
    /// Its box in the frame of the model.
    bounds: Aabb,
    pub(super) frame: Frame,
}

/// Children of a group side by side, as walks test them.
pub(super) struct Lanes {
    pub node: WideNode,
    pub optics: [AxisOptics; AXIS_COUNT],
}

/// Measured optics of a group of instances of instances.
pub struct Measured {
    bounds: Aabb,
    optics: ClusterOptics,
    pub(super) lanes: Lanes,
}

/// An instance or a group of them.
pub(super) type Branch = Child<Placed, Measured>;

/// Groups of instances with their optics, sixteen children side by side.
///
/// The tree is a function of the instances that it holds (`clusters::placed`); trees before and after an update share their
/// unchanged parts.
pub struct InstanceTree {
    /// Largest coordinate magnitude of the model, scene units: the scale of rounding errors.
    pub(super) magnitude: f32,
    /// The root as an only child.
    pub(super) entry: Lanes,
    /// At most one.
    pub(super) root: Vec<Branch>,
}

/// What an update takes from the model.
pub struct Instances<'a, M> {
    /// The cells that sort instances.
    pub cells: Cells,
    /// Box of the model's own triangles.
    pub own: Aabb,
    /// The boxes that represent an instance, by its number.
    pub member: M,
    /// How groups are measured.
    pub options: &'a optics::Options,
}

/// A change of one instance.
pub struct PlacedChange {
    /// Its number.
    pub number: u32,
    /// Its box before, if the tree held it.
    pub before: Option<Aabb>,
    /// Its box and frame, if the tree shall hold it.
    pub after: Option<(Aabb, Frame)>,
}

impl Branch {
    fn bounds(&self) -> Aabb {
        match self {
            Child::Item(item) => item.content.bounds,
            Child::Group(group) => group.content.bounds,
        }
    }
}

impl Lanes {
    /// The boxes of some children and the optics of those that are groups. Instances are never aggregated here: the root of their
    /// mesh may be, in the frame of the mesh, with optics that were measured on its triangles.
    fn of(children: &[Branch]) -> Lanes {
        let (mut node, mut wide) = (WideNode::EMPTY, NO_OPTICS);
        for (lane, child) in children.iter().enumerate() {
            set_box(&mut node, lane, child.bounds().thickened());
            node.child[lane] = lane as u32;
            if let Child::Group(group) = child {
                set_optics(&mut node, &mut wide, lane, &group.content.optics);
            }
        }
        Lanes { node, optics: wide }
    }
}

impl InstanceTree {
    /// The tree after changes of some instances, each named once. Groups above them are measured, all others are shared with
    /// `before`: O(changed · log n). Parallel; the result does not depend on the number of threads.
    pub fn update<'a, M>(
        before: Option<&InstanceTree>,
        changes: Vec<PlacedChange>,
        instances: &Instances<'a, M>,
    ) -> InstanceTree
    where
        M: Fn(u32) -> Member<'a> + Sync,
    {
        let changes = sorted(changes, &instances.cells);
        let measure = |children: &[Branch]| measure(children, instances);
        let before = before.and_then(|tree| tree.root.first());
        let root: Vec<Branch> = placed::update(before, &changes, &measure).into_iter().collect();
        let bounds = root.iter().fold(instances.own, |all, root| all.union(root.bounds()));
        let magnitude = bounds.magnitude();
        InstanceTree { magnitude, entry: Lanes::of(&root), root }
    }

    /// Box around all instances.
    pub fn bounds(&self) -> Aabb {
        self.root.first().map_or(Aabb::EMPTY, Branch::bounds)
    }

    /// The frames of all instances.
    pub fn frames(&self) -> Vec<&Frame> {
        let mut frames = Vec::new();
        self.root.iter().for_each(|root| root.for_each_item(&mut |item| frames.push(&item.content.frame)));
        frames
    }

    /// Bytes of the trees of all placed meshes, each counted once.
    pub fn mesh_bytes(&self) -> usize {
        let mut trees: Vec<&Arc<WideTree>> = self.frames().into_iter().map(|frame| &frame.tree).collect();
        trees.sort_unstable_by_key(|tree| Arc::as_ptr(tree));
        trees.dedup_by_key(|tree| Arc::as_ptr(tree));
        trees.into_iter().map(|tree| tree.bytes()).sum()
    }

    /// Bytes of groups and instances, without the meshes.
    pub fn bytes(&self) -> usize {
        let mut bytes = size_of::<InstanceTree>();
        for root in &self.root {
            root.for_each_group(&mut |group| {
                bytes += size_of_val(group) + size_of_val(group.children.as_slice());
            });
            root.for_each_item(&mut |item| bytes += size_of_val(&**item));
        }
        bytes
    }
}

/// Changes in the order of their keys, one for each key: an instance that moves inside its cell is replaced.
fn sorted(changes: Vec<PlacedChange>, cells: &Cells) -> Vec<Change<Placed>> {
    let mut sorted: Vec<Change<Placed>> = Vec::with_capacity(2 * changes.len());
    for PlacedChange { number, before, after } in changes {
        let key = |bounds| cells.key(bounds, number);
        let gone: Option<Key> = before.map(key);
        let came = after.map(|(bounds, frame)| {
            let (key, content) = (key(bounds), Placed { number, bounds, frame });
            Arc::new(Item { key, content })
        });
        if let Some(key) = gone.filter(|&gone| came.as_ref().is_none_or(|came| came.key != gone)) {
            sorted.push(Change { key, is_there: true, item: None });
        }
        if let Some(item) = came {
            sorted.push(Change { key: item.key, is_there: gone == Some(item.key), item: Some(item) });
        }
    }
    sorted.sort_unstable_by_key(|change| change.key);
    sorted
}

/// Measures a group on its children: an instance is represented by the boxes of its mesh, a group by its own.
fn measure<'a, M>(children: &[Branch], instances: &Instances<'a, M>) -> Measured
where
    M: Fn(u32) -> Member<'a> + Sync,
{
    let bounds = children.iter().fold(Aabb::EMPTY, |all, child| all.union(child.bounds()));
    let groups: Vec<Option<Part>> = children
        .iter()
        .map(|child| match child {
            Child::Item(_) => None,
            Child::Group(group) => Some(Part::of_group(group.content.bounds, &group.content.optics)),
        })
        .collect();
    let members: Vec<Member> = children
        .iter()
        .zip(&groups)
        .map(|(child, group)| match child {
            Child::Item(item) => (instances.member)(item.content.number),
            Child::Group(_) => Member { parts: group.as_slice(), to_world: Affine3A::IDENTITY },
        })
        .collect();
    let optics = groups::measure(bounds, &members, instances.options);
    Measured { bounds, optics, lanes: Lanes::of(children) }
}

/// Comparisons of trees in tests.
#[cfg(test)]
impl InstanceTree {
    /// Whether both trees have the same groups of the same instances, with the same optics bit by bit.
    pub fn equals(&self, other: &InstanceTree) -> bool {
        fn equal(a: &Branch, b: &Branch) -> bool {
            a.bounds() == b.bounds()
                && match (a, b) {
                    (Child::Item(a), Child::Item(b)) => {
                        let (a, b) = (&a.content, &b.content);
                        a.number == b.number && a.frame.to_mesh == b.frame.to_mesh
                    }
                    (Child::Group(a), Child::Group(b)) => {
                        a.content.optics == b.content.optics
                            && a.children.len() == b.children.len()
                            && a.children.iter().zip(&b.children).all(|(a, b)| equal(a, b))
                    }
                    _ => false,
                }
        }
        let roots = self.root.iter().zip(&other.root).all(|(a, b)| equal(a, b));
        roots && self.root.len() == other.root.len() && self.magnitude == other.magnitude
    }

    /// Number of groups, and of those that another tree does not share.
    pub fn counts(&self, other: &InstanceTree) -> [usize; 2] {
        let groups = |tree: &InstanceTree| {
            let mut all = std::collections::HashSet::new();
            for root in &tree.root {
                root.for_each_group(&mut |group| {
                    all.insert(std::ptr::from_ref(group) as usize);
                });
            }
            all
        };
        let (own, others) = (groups(self), groups(other));
        [own.len(), own.difference(&others).count()]
    }
}
