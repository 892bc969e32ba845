//! Single steps of a walk, for the micro-benchmarks in `benches/visibility.rs`.

use super::instance_tree::{Frame, InstanceTree};
use super::shaft::Shaft;
use super::slabs::{Slabs, pass};
use super::triangles::{self, Tiles};
use super::wide::{WideTree, mixed};
use crate::optics::AxisMix;
use crate::ray::Packet;
use crate::simd::{Isa, Kernel, LANES, Simd, dispatch};
use glam::Vec3;

/// Largest number of nodes and triangle blocks per step of a benchmark: 16 nodes with optics take 32 KiB at most, so
/// that caches hold them.
const MAX_STEP_NODES: usize = 16;

/// The first nodes and blocks of an engine's tree, and one bundle.
pub struct Steps<'a> {
    tree: &'a WideTree,
    frames: Vec<&'a Frame>,
    magnitude: f32,
    isa: Isa,
    packets: &'a [Packet],
}

impl<'a> Steps<'a> {
    pub(super) fn new(
        (tree, instances): (&'a WideTree, Option<&'a InstanceTree>),
        magnitude: f32,
        isa: Isa,
        packets: &'a [Packet],
    ) -> Steps<'a> {
        let mut frames = instances.map_or(Vec::new(), InstanceTree::frames);
        frames.truncate(MAX_STEP_NODES);
        Steps { tree, frames, magnitude, isa, packets }
    }

    fn nodes(&self) -> usize {
        self.tree.nodes.len().min(MAX_STEP_NODES)
    }

    fn blocks(&self) -> usize {
        self.tree.blocks.len().min(MAX_STEP_NODES)
    }

    /// Number of shafts, nodes, blocks, instances or boxes that a step processes.
    pub fn items(&self, step: Step) -> usize {
        match step {
            Step::Shaft => 1,
            Step::Nodes(_) => self.nodes(),
            Step::Blocks => self.blocks(),
            Step::Enter => self.frames.len(),
            Step::Slabs => 16 * self.nodes(),
        }
    }

    /// Runs a step.
    pub fn run(&self, step: Step) -> f32 {
        dispatch(self.isa, Run(self, step))
    }
}

/// A step of a walk.
#[derive(Clone, Copy, Debug)]
pub enum Step {
    /// Constructs the shaft of the bundle.
    Shaft,
    /// Tests the children of the nodes against the shaft and for aggregation at this feature size.
    Nodes(f32),
    /// Tests the triangles of the blocks, up to sixteen each, against all segments.
    Blocks,
    /// Transforms the segments into the frames of the instances and constructs the shafts there.
    Enter,
    /// Traces the segments through all children of the nodes as boxes with extinction.
    Slabs,
}

/// Kernel of one step; the result only prevents the compiler from removing the step.
struct Run<'a>(&'a Steps<'a>, Step);

impl Kernel for Run<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> f32 {
        let Run(steps, step) = self;
        let Steps { tree, packets, .. } = steps;
        let shaft = Shaft::of(simd, packets, &[], steps.magnitude);
        let mix = AxisMix::around(shaft.direction());
        let nodes = tree.nodes.iter().zip(&tree.optics).take(steps.nodes());
        match step {
            Step::Shaft => shaft.direction().x,
            Step::Nodes(s) => nodes
                .map(|(node, optics)| {
                    let (sizes, _) = mixed(simd, optics, &mix);
                    shaft.touches(simd, node) & shaft.aggregates(simd, node, sizes, 0.0, s)
                })
                .fold(0, u32::wrapping_add) as f32,
            Step::Blocks => {
                let (mut tiles, mut blocked) = (Tiles::default(), vec![0; packets.len()]);
                let tested = tree.blocks.iter().take(steps.blocks()).map(|block| {
                    blocked.fill(0);
                    tiles.clear();
                    triangles::block_all(simd, &shaft, block, packets, (&mut tiles, &mut blocked)).work
                });
                tested.sum::<u64>() as f32
            }
            Step::Enter => {
                let (mut moved, mut hull) = (Vec::new(), Vec::new());
                let (magnitude, segments) = (steps.magnitude, (*packets, &[][..]));
                let shafts = steps.frames.iter().map(|frame| {
                    frame.enter(simd, magnitude, segments, (&mut moved, &mut hull)).direction().x
                });
                shafts.sum()
            }
            Step::Slabs => {
                let from = shaft.apex.unwrap_or(Vec3::ZERO);
                let mut slabs = Slabs::default();
                for (node, _) in nodes {
                    slabs.add(simd, (node, 0xffff), from, (simd.splat(0.1), simd.splat(0.1)));
                }
                let (blocked, mut sums) = (vec![0; packets.len()], Vec::new());
                let how = (shaft.apex.is_some(), f32::MAX);
                pass(simd, &slabs, (packets, &blocked), how, &mut sums, &mut [0.0; LANES]).transmittance
            }
        }
    }
}
