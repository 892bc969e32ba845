//! Walks through the second level of clusters: instances of meshes, and groups of them.
//!
//! A walk goes through the groups in the frame of the model, where groups are aggregated like clusters. Instances that it
//! cannot aggregate are entered in the frame of their mesh: the segments, not the geometry, are transformed. Affine maps
//! keep the parameter along a segment, so that the open ends need no change; uniform scale divides emitter size and feature
//! size.

use super::answer::Bundle;
use super::instance_tree::{Frame, InstanceTree};
use super::shaft::Shaft;
use super::slabs::{BoxSums, PacketSums};
use super::walk::{Buffers, WalkResult, WalkRule, gather, visit};
use super::wide::{NODE_WORK, WideTree};
use crate::clusters::placed::Child;
use crate::optics::AxisMix;
use crate::ray::{Lanes, Packet};
use crate::simd::Simd;
use glam::Vec3;
use smallvec::{SmallVec, smallvec};

/// Work of entering an instance, for each packet of a bundle, whose segments are transformed, and for each bundle, whose shaft is
/// constructed. Measured in tests of a triangle against a packet, 51 and 26 ns (AVX2, AVX-512): entering takes 17 and 21 of them with
/// one packet, a shaft alone 3 and 4 by a benchmark that is no longer in the repository
/// (`git show 2d559b4:benches/visibility.rs`).
pub(super) const ENTER_PACKET: u64 = 16;
pub(super) const ENTER_BUNDLE: u64 = 4;

/// Working memory of walks through instances.
#[derive(Default)]
pub(super) struct InstanceBuffers {
    packets: Vec<Packet>,
    emitter: Vec<Vec3>,
    sums: Vec<PacketSums>,
}

/// Instances that a shaft touches, in their order; 64 of them fit without an allocation, 512 bytes of the stack.
type TouchedInstances<'a> = SmallVec<[&'a Frame; 64]>;

/// Trees of a model.
pub(super) struct ModelTrees<'a> {
    /// Clusters of the model's own triangles.
    pub base: &'a WideTree,
    pub instances: &'a InstanceTree,
}

/// Walks for one bundle through the model's own triangles and all instances.
#[inline(always)]
pub(super) fn walk_instances<S: Simd>(
    simd: S,
    ModelTrees { base, instances }: ModelTrees,
    bundle: &Bundle,
    shaft: &Shaft,
    rule: &WalkRule,
    buffers: &mut Buffers,
    own: &mut InstanceBuffers,
) -> WalkResult {
    let packets = bundle.packets;
    let shared = shaft.apex.is_some();
    buffers.blocked.clear();
    buffers.blocked.resize(packets.len(), 0);
    own.sums.clear();
    own.sums.resize(packets.len(), PacketSums::EMPTY);
    let (mut walked, mut all) = gather(simd, base, None, packets, shaft, rule, buffers);
    let mut averaged = add_slabs(simd, buffers, packets, shared, &mut own.sums, &mut walked);
    let mut found = TouchedInstances::new();
    if !all && !walked.gave_up {
        find(simd, instances, shaft, rule, buffers, &mut found, &mut walked);
        averaged |= add_slabs(simd, buffers, packets, shared, &mut own.sums, &mut walked);
    }
    for frame in found {
        if all || walked.gave_up {
            break;
        }
        walked.work += rule.enter[0] + rule.enter[1] * packets.len() as u64;
        if walked.work > rule.limit {
            walked.gave_up = true;
            break;
        }
        let InstanceBuffers { packets: moved, emitter: hull, .. } = &mut *own;
        let inner = frame.enter(simd, instances.magnitude, packets, bundle.emitter, moved, hull);
        let rule = WalkRule {
            e: rule.e / frame.scale,
            s: rule.s / frame.scale,
            limit: rule.limit.saturating_sub(walked.work),
            ..*rule
        };
        let (found, blocked) = gather(simd, &frame.tree, None, &own.packets, &inner, &rule, buffers);
        all = blocked || all_blocked(packets, &buffers.blocked);
        walked.join(&found);
        // Ends that differ in the model may be one point in the frame of the mesh.
        let inner_shared = inner.apex.is_some();
        averaged |= add_slabs(simd, buffers, &own.packets, inner_shared, &mut own.sums, &mut walked);
    }
    if !walked.gave_up && !all {
        sum_up(simd, packets, averaged, buffers, own, &mut walked);
    } else {
        buffers.transmittance = [0.0; 16];
    }
    walked
}

/// Finds the instances that the shaft touches and aggregates groups of them.
#[inline(always)]
fn find<'a, S: Simd>(
    simd: S,
    instances: &'a InstanceTree,
    shaft: &Shaft,
    rule: &WalkRule,
    buffers: &mut Buffers,
    found: &mut TouchedInstances<'a>,
    walked: &mut WalkResult,
) {
    let mix = AxisMix::around(shaft.direction());
    buffers.slabs.clear();
    let mut queue: SmallVec<[_; 32]> = smallvec![(&instances.entry, instances.root.as_slice())];
    let mut next = 0;
    while let Some(&(lanes, children)) = queue.get(next) {
        next += 1;
        walked.nodes += 1;
        walked.work += NODE_WORK + rule.fetch;
        if walked.work > rule.limit {
            walked.gave_up = true;
            return;
        }
        let opened = visit(simd, &lanes.node, &lanes.optics, shaft, rule, &mix, &mut buffers.slabs);
        for lane in Lanes(opened) {
            match &children[lanes.node.child[lane] as usize] {
                Child::Item(item) => found.push(&item.content.frame),
                Child::Group(group) => queue.push((&group.content.lanes, &group.children)),
            }
        }
    }
}

/// Adds the aggregated clusters of a walk to the sums of the packets; returns whether there are any.
#[inline(always)]
fn add_slabs<S: Simd>(
    simd: S,
    buffers: &mut Buffers,
    packets: &[Packet],
    shared: bool,
    sums: &mut [PacketSums],
    walked: &mut WalkResult,
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
    walked: &mut WalkResult,
) {
    walked.clear = !walked.tested && !averaged;
    if walked.clear {
        let active = packets[0].active;
        buffers.transmittance = std::array::from_fn(|i| (active >> i & 1) as f32);
        return;
    }
    let mut total = BoxSums::default();
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

impl WalkResult {
    /// Adds the counts of a walk through an instance.
    fn join(&mut self, other: &WalkResult) {
        self.nodes += other.nodes;
        self.work += other.work;
        self.tested |= other.tested;
        self.covered |= other.covered;
        self.gave_up |= other.gave_up;
    }
}
