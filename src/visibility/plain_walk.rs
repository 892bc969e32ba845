//! The umbra criterion for single segments and nodes (docs/method.md, Umbra criterion): the reference in tests of the
//! fast engine.

use super::multires::LeafMode;
use crate::clusters::{Hierarchy, Tree};
use crate::optics::{AxisMix, ClusterOptics};
use crate::scene::Scene;
use glam::Vec3;

/// Width of the umbra on the receiver, `b + (b - e) d2/d1`, for a blocker of width `b` at distance `d1` from an
/// emitter of width `e` and `d2` from the receiver; negative without umbra. Lengths. Source: docs/method.md, Umbra
/// criterion.
pub fn umbra(e: f64, b: f64, d1: f64, d2: f64) -> f64 {
    b + (b - e) * d2 / d1
}

/// Largest occluded fraction of a disc emitter of diameter `e` behind a disc blocker of diameter `b`, in `[0, 1]`;
/// distances as for [`umbra`].
pub fn peak_occlusion(e: f64, b: f64, d1: f64, d2: f64) -> f64 {
    let ratio = b * (d1 + d2) / (e * d2);
    (ratio * ratio).min(1.0)
}

/// A segment from a receiver point to an emitter point, open at both ends.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    /// The receiver end, scene units.
    pub origin: Vec3,
    /// Vector from the receiver end to the emitter end, scene units.
    pub direction: Vec3,
    /// Smallest parameter at which geometry blocks.
    pub near: f32,
    /// Largest parameter at which geometry blocks.
    pub far: f32,
}

/// Result of a walk for one segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentWalk {
    /// Total optical depth of the aggregated clusters.
    pub depth: f64,
    /// Whether a triangle of an opened leaf or of a large surface blocks it.
    pub blocked: bool,
    /// Number of aggregated clusters.
    pub aggregated: usize,
}

impl SegmentWalk {
    /// exp(-depth), or 0 if blocked.
    pub fn transmittance(&self) -> f64 {
        if self.blocked { 0.0 } else { (-self.depth).exp() }
    }
}

/// The rule by which clusters are aggregated for the segments of a bundle.
pub struct SegmentRule {
    /// Emitter size and feature size, scene units.
    pub e: f32,
    pub s: f32,
    pub leaf: LeafMode,
    /// Weights of the clusters' optics for the direction of the bundle.
    pub mix: AxisMix,
}

/// Walks the clusters for one segment; `blocks(triangle)` tests a triangle against it. Leaves with faces of emitters are treated like
/// others.
pub fn walk(
    hierarchy: &Hierarchy,
    optics: &[ClusterOptics],
    segment: Segment,
    rule: &SegmentRule,
    mut blocks: impl FnMut(u32) -> bool,
) -> SegmentWalk {
    let mut walked = SegmentWalk { depth: 0.0, blocked: false, aggregated: 0 };
    walked.blocked = hierarchy.large.order.iter().any(|&t| blocks(t));
    if !hierarchy.micro.clusters.is_empty() {
        visit(&hierarchy.micro, 0, optics, segment, rule, &mut walked, &mut blocks);
    }
    walked
}

fn visit(
    tree: &Tree,
    c: usize,
    optics: &[ClusterOptics],
    segment: Segment,
    rule: &SegmentRule,
    walked: &mut SegmentWalk,
    blocks: &mut impl FnMut(u32) -> bool,
) {
    let SegmentRule { e, s, leaf, ref mix } = *rule;
    let cluster = &tree.clusters[c];
    let bounds = cluster.bounds.thickened();
    let (mut enter, mut leave) = (0.0f32, 1.0f32);
    for k in 0..3 {
        let d = segment.direction[k];
        let inverse = 1.0 / if d.abs() < 1e-30 { 1e-30 } else { d };
        let a = (bounds.min[k] - segment.origin[k]) * inverse;
        let b = (bounds.max[k] - segment.origin[k]) * inverse;
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    if enter > leave || leave <= segment.near || enter >= segment.far {
        return;
    }
    let end_inside = enter <= segment.near || leave >= segment.far;
    // The end of the overlap with the largest umbra: receiver side if b < e, emitter side if b > e; there the
    // threshold b* is smaller.
    let threshold = s + (e - s) * if e > s { enter } else { leave };
    let small = mix.mix(|axis| optics[c].feature_size(axis)) < threshold;
    if (small && !end_inside) || (cluster.is_leaf() && leaf == LeafMode::Average) {
        let path = f64::from(leave - enter) * f64::from(segment.direction.length());
        let middle = segment.origin + 0.5 * (enter + leave) * segment.direction;
        let density = 1.0 + f64::from(optics[c].slope.dot(middle - bounds.center()));
        let path = path * density.max(0.0);
        walked.depth += path * f64::from(mix.mix(|axis| optics[c].extinction[axis]));
        walked.aggregated += 1;
    } else if cluster.is_leaf() {
        walked.blocked |= tree.triangles_of(c).iter().any(|&t| blocks(t));
    } else {
        for child in cluster.child_range() {
            visit(tree, child, optics, segment, rule, walked, blocks);
        }
    }
}

/// An end rule that holds on all faces of a scene.
pub fn end_rule(scene: &Scene) -> crate::ray::EndRule {
    crate::ray::EndRule::new(scene.magnitude())
}
