//! The visibility engines behind one question: which of sixteen segments get through.

use crate::ray::{LANES, Occluder, Packet};
use crate::visibility::{Exact, Method, MultiResolution, Workspace};

/// How links ask for visibility.
#[derive(Clone, Copy)]
pub enum Sight<'a> {
    /// Embree rays.
    Exact(Exact<'a>),
    /// Multi-resolution or average visibility, as the engine was made.
    MultiResolution(&'a MultiResolution<'a>),
}

/// Bundles and segments asked for, by how they were answered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Tally {
    /// Bundles of which all segments got through without a test.
    pub clear: u64,
    /// Bundles answered by triangles alone.
    pub exact: u64,
    /// Bundles answered by clusters alone.
    pub aggregated: u64,
    /// Bundles answered by both.
    pub mixed: u64,
    /// Segments asked for.
    pub segments: u64,
    /// Segments for which triangles were tested.
    pub exact_rays: u64,
}

impl Tally {
    /// Adds another.
    pub fn add(&mut self, other: Tally) {
        self.clear += other.clear;
        self.exact += other.exact;
        self.aggregated += other.aggregated;
        self.mixed += other.mixed;
        self.segments += other.segments;
        self.exact_rays += other.exact_rays;
    }
}

/// Buffers and counts of a thread.
#[derive(Default)]
pub struct Scratch {
    workspace: Workspace,
    /// What has been asked for.
    pub tally: Tally,
}

impl Sight<'_> {
    /// Transmittance of each segment of a packet, 0 in unused lanes. `emitter_size` and the feature size are those of
    /// [`MultiResolution`].
    pub fn transmittances(
        &self,
        packet: &Packet,
        emitter_size: f32,
        feature_size: f32,
        scratch: &mut Scratch,
    ) -> [f32; LANES] {
        let Scratch { workspace, tally } = scratch;
        let segments = packet.len() as u64;
        tally.segments += segments;
        match self {
            Sight::Exact(engine) => {
                let mut blocked = [0];
                engine.occluded(std::slice::from_ref(packet), &mut blocked);
                tally.exact += 1;
                tally.exact_rays += segments;
                let clear = packet.active & !blocked[0];
                std::array::from_fn(|i| (clear >> i & 1) as f32)
            }
            Sight::MultiResolution(engine) => {
                let (answer, lanes) = engine.answer_lanes(packet, emitter_size, feature_size, workspace);
                match answer.method {
                    Method::Clear => tally.clear += 1,
                    Method::Exact | Method::Covered => tally.exact += 1,
                    Method::Aggregated => tally.aggregated += 1,
                    Method::Mixed => tally.mixed += 1,
                }
                tally.exact_rays += answer.cost.exact_rays;
                lanes
            }
        }
    }
}
