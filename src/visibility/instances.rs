//! The second level of clusters: instances of meshes, and groups of them.
//!
//! A walk goes through the groups in the frame of the model, where groups are aggregated like clusters. Instances that it
//! cannot aggregate are entered in the frame of their mesh: the segments, not the geometry, are transformed. Affine maps
//! keep the parameter along a segment, so that the open ends need no change; uniform scale divides emitter size and feature
//! size.

use super::answer::Bundle;
use super::shaft::Shaft;
use super::slabs::{PacketSums, Passed};
use super::walk::{Buffers, Rule, Walked, gather, visit};
use super::wide::{AxisOptics, LEAF, NO_OPTICS, Node, WideTree, set_box, set_optics};
use super::work::NODE;
use crate::clusters::Tree;
use crate::math::Aabb;
use crate::optics::{AXIS_COUNT, AxisMix, ClusterOptics};
use crate::ray::Packet;
use crate::simd::Simd;
use glam::{DAffine3, Vec3};
use std::sync::Arc;

/// A placed mesh, as walks enter it.
#[derive(Clone)]
pub struct Frame {
    /// The clusters of the mesh, in its own frame.
    tree: Arc<WideTree>,
    /// From the frame of the model to that of the mesh.
    to_mesh: DAffine3,
    /// Length in the model over length in the mesh.
    scale: f32,
    /// Largest coordinate magnitude of segments in the frame of the mesh: the scale of rounding errors.
    magnitude: f32,
}

impl Frame {
    /// A mesh placed by `to_model`, a rotation or reflection with uniform scale, in a model of this coordinate magnitude.
    pub fn new(tree: Arc<WideTree>, to_model: DAffine3, magnitude: f32) -> Frame {
        let scale = to_model.matrix3.determinant().abs().cbrt() as f32;
        // Segments keep the rounding errors that they have in the model.
        let magnitude = tree.magnitude.max(magnitude / scale);
        Frame { tree, to_mesh: to_model.inverse(), scale, magnitude }
    }

    fn point(&self, p: Vec3) -> Vec3 {
        self.to_mesh.transform_point3(p.as_dvec3()).as_vec3()
    }

    /// Transforms the segments of a bundle and its emitter's hull into the frame of the mesh; returns the shaft there.
    #[inline(always)]
    pub(super) fn enter<S: Simd>(
        &self,
        simd: S,
        (packets, emitter): (&[Packet], &[Vec3]),
        (moved, hull): (&mut Vec<Packet>, &mut Vec<Vec3>),
    ) -> Shaft {
        moved.clear();
        moved.extend(packets.iter().map(|packet| self.packet(packet)));
        hull.clear();
        hull.extend(emitter.iter().map(|&p| self.point(p)));
        Shaft::of(simd, moved, hull, self.magnitude)
    }

    /// The segments of a packet in the frame of the mesh.
    fn packet(&self, packet: &Packet) -> Packet {
        let mut moved = packet.clone();
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

/// Work of entering an instance, for each packet of a bundle, whose segments are transformed, and for each bundle, whose shaft is
/// constructed. Measured in tests of a triangle against a packet, 51 and 26 ns (AVX2, AVX-512): entering takes 17 and 21 of them with
/// one packet, a shaft alone 3 and 4 (`cargo bench --bench visibility -- instances_entered shaft blocks_of_sixteen_triangles`).
pub(super) const ENTER_PACKET: u64 = 16;
pub(super) const ENTER_BUNDLE: u64 = 4;

/// Groups of instances with their optics, sixteen children side by side, and the frames of the instances.
pub struct InstanceTree {
    nodes: Vec<Node>,
    optics: Vec<[AxisOptics; AXIS_COUNT]>,
    pub(super) frames: Vec<Frame>,
}

impl InstanceTree {
    /// Lays out a tree over instances. `tree.order` holds indices into `boxes` (boxes of the instances in the model) and
    /// `frames`; `optics` has one entry a cluster, none for clusters of one instance. Those are never aggregated here: the root
    /// of their mesh may be, in the frame of the mesh, with optics that were measured on its triangles.
    pub fn build(
        tree: &Tree,
        optics: &[Option<ClusterOptics>],
        boxes: &[Aabb],
        frames: Vec<Frame>,
    ) -> InstanceTree {
        let mut nodes = vec![Node::EMPTY; tree.clusters.len() + 1];
        let mut wide = vec![NO_OPTICS; tree.clusters.len() + 1];
        let mut place = |node: usize, lane: usize, cluster: usize| {
            set_box(&mut nodes[node], lane, tree.clusters[cluster].bounds.thickened());
            match &optics[cluster] {
                Some(optics) => {
                    nodes[node].child[lane] = cluster as u32 + 1;
                    set_optics((&mut nodes[node], &mut wide[node]), lane, optics);
                }
                None => nodes[node].child[lane] = LEAF | tree.triangles_of(cluster)[0],
            }
        };
        if !tree.clusters.is_empty() {
            place(0, 0, 0);
        }
        for (c, cluster) in tree.clusters.iter().enumerate() {
            for (lane, child) in cluster.child_range().enumerate() {
                place(c + 1, lane, child);
            }
        }
        for (c, cluster) in tree.clusters.iter().enumerate().filter(|(_, cluster)| cluster.is_leaf()) {
            for (lane, &instance) in tree.order[cluster.triangle_range()].iter().enumerate() {
                set_box(&mut nodes[c + 1], lane, boxes[instance as usize].thickened());
                nodes[c + 1].child[lane] = LEAF | instance;
            }
        }
        InstanceTree { nodes, optics: wide, frames }
    }

    /// Bytes of the trees of all placed meshes, each counted once.
    pub fn mesh_bytes(&self) -> usize {
        let mut trees: Vec<&Arc<WideTree>> = self.frames.iter().map(|frame| &frame.tree).collect();
        trees.sort_unstable_by_key(|tree| Arc::as_ptr(tree));
        trees.dedup_by_key(|tree| Arc::as_ptr(tree));
        trees.into_iter().map(|tree| tree.bytes()).sum()
    }

    /// Bytes of all arrays, without the meshes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice())
            + size_of_val(self.optics.as_slice())
            + size_of_val(self.frames.as_slice())
    }
}

/// Working memory of walks through instances.
#[derive(Default)]
pub(super) struct InstanceBuffers {
    queue: Vec<u32>,
    found: Vec<u32>,
    packets: Vec<Packet>,
    emitter: Vec<Vec3>,
    sums: Vec<PacketSums>,
}

/// Walks for one bundle through the model's own triangles (`base`) and all instances.
#[inline(always)]
pub(super) fn walk_instances<S: Simd>(
    simd: S,
    (base, instances): (&WideTree, &InstanceTree),
    (bundle, shaft): (&Bundle, &Shaft),
    rule: &Rule,
    buffers: &mut Buffers,
    own: &mut InstanceBuffers,
) -> Walked {
    let packets = bundle.packets;
    let shared = shaft.apex.is_some();
    buffers.blocked.clear();
    buffers.blocked.resize(packets.len(), 0);
    own.sums.clear();
    own.sums.resize(packets.len(), PacketSums::EMPTY);
    let (mut walked, mut all) = gather(simd, base, None, (packets, shaft), rule, buffers);
    let mut averaged = add_slabs(simd, buffers, (packets, shared), &mut own.sums, &mut walked);
    if !all && !walked.gave_up {
        find(simd, instances, shaft, rule, buffers, own, &mut walked);
        averaged |= add_slabs(simd, buffers, (packets, shared), &mut own.sums, &mut walked);
    }
    let mut next = 0;
    while next < own.found.len() && !all && !walked.gave_up {
        walked.work += rule.enter[0] + rule.enter[1] * packets.len() as u64;
        if walked.work > rule.limit {
            walked.gave_up = true;
            break;
        }
        let frame = &instances.frames[own.found[next] as usize];
        next += 1;
        let inner = frame.enter(simd, (packets, bundle.emitter), (&mut own.packets, &mut own.emitter));
        let rule = Rule {
            e: rule.e / frame.scale,
            s: rule.s / frame.scale,
            limit: rule.limit.saturating_sub(walked.work),
            ..*rule
        };
        let (found, blocked) = gather(simd, &frame.tree, None, (&own.packets, &inner), &rule, buffers);
        all = blocked || all_blocked(packets, &buffers.blocked);
        walked.join(&found);
        // Ends that differ in the model may be one point in the frame of the mesh.
        let inner_shared = inner.apex.is_some();
        averaged |= add_slabs(simd, buffers, (&own.packets, inner_shared), &mut own.sums, &mut walked);
    }
    own.found.clear();
    if !walked.gave_up && !all {
        sum_up(simd, packets, averaged, buffers, own, &mut walked);
    } else {
        buffers.transmittance = [0.0; 16];
    }
    walked
}

/// Finds the instances that the shaft touches and aggregates groups of them.
#[inline(always)]
fn find<S: Simd>(
    simd: S,
    instances: &InstanceTree,
    shaft: &Shaft,
    rule: &Rule,
    buffers: &mut Buffers,
    own: &mut InstanceBuffers,
    walked: &mut Walked,
) {
    let from = shaft.apex.unwrap_or(Vec3::ZERO);
    let mix = AxisMix::around(shaft.direction());
    buffers.slabs.clear();
    own.found.clear();
    own.queue.clear();
    own.queue.push(0);
    let mut next = 0;
    while let Some(&at) = own.queue.get(next) {
        next += 1;
        walked.nodes += 1;
        walked.work += NODE + rule.fetch;
        if walked.work > rule.limit {
            walked.gave_up = true;
            return;
        }
        let node = (&instances.nodes[at as usize], &instances.optics[at as usize]);
        let InstanceBuffers { queue, found, .. } = own;
        visit(simd, node, (shaft, from), rule, &mix, &mut buffers.slabs, &mut |child| {
            if child & LEAF != 0 { found.push(child & !LEAF) } else { queue.push(child) }
        });
    }
}

/// Adds the aggregated clusters of a walk to the sums of the packets; returns whether there are any.
#[inline(always)]
fn add_slabs<S: Simd>(
    simd: S,
    buffers: &mut Buffers,
    (packets, shared): (&[Packet], bool),
    sums: &mut [PacketSums],
    walked: &mut Walked,
) -> bool {
    let boxes = buffers.slabs.len() as u64;
    if boxes == 0 {
        return false;
    }
    walked.work += boxes * (1 + packets.len() as u64);
    for (packet, sums) in packets.iter().zip(sums) {
        sums.add(simd, &buffers.slabs, packet, shared);
    }
    buffers.slabs.clear();
    true
}

/// Sums the transmittances of all segments.
#[inline(always)]
fn sum_up<S: Simd>(
    simd: S,
    packets: &[Packet],
    averaged: bool,
    buffers: &mut Buffers,
    own: &InstanceBuffers,
    walked: &mut Walked,
) {
    walked.clear = !walked.tested && !averaged;
    if walked.clear {
        let active = packets[0].active;
        buffers.transmittance = std::array::from_fn(|i| (active >> i & 1) as f32);
        return;
    }
    let mut total = Passed::default();
    for ((packet, blocked), sums) in packets.iter().zip(&buffers.blocked).zip(&own.sums) {
        let (each, passed) = sums.passed(simd, packet.active & !blocked);
        buffers.transmittance = each;
        buffers.sums.push(passed.transmittance);
        total.add(passed);
    }
    walked.take(&total, packets);
}

fn all_blocked(packets: &[Packet], blocked: &[u32]) -> bool {
    packets.iter().zip(blocked).all(|(packet, blocked)| packet.active & !blocked == 0)
}

impl Walked {
    /// Adds the counts of a walk through an instance.
    fn join(&mut self, other: &Walked) {
        self.nodes += other.nodes;
        self.work += other.work;
        self.tested |= other.tested;
        self.covered |= other.covered;
        self.gave_up |= other.gave_up;
    }
}
