//! What decisions are made on: runs of neighbouring bundles spread over the workload.

use super::workload::{Order, Workload};
use crate::ray::{LANES, Packet};
use crate::scene::Scene;
use crate::visibility::{Bundle, MultiResolution, Workspace};
use glam::Vec3;
use std::ops::Range;

/// Runs and pairs of each.
const SHAPE: (usize, usize) = (16, 16);

/// Segments of runs of neighbouring pairs, spread evenly over a workload. Made once, for the most segments that any row
/// asks; fewer are the first of them.
pub struct Sample {
    packets: Vec<Packet>,
    runs: Vec<Run>,
}

/// Neighbouring pairs of one emitter.
struct Run {
    /// See [`Workload::hull`].
    hull: Vec<Vec3>,
    /// Packets and emitter size of each pair.
    pairs: Vec<(Range<usize>, f32)>,
}

impl Sample {
    /// `rays` segments of each pair.
    pub fn of(scene: &Scene, workload: &Workload, rays: usize) -> Sample {
        let mut sample = Sample { packets: Vec::new(), runs: Vec::new() };
        let pairs = workload.pairs.len();
        let length = (SHAPE.1 * scene.emitters.len()).min(pairs);
        let runs = SHAPE.0.min(pairs / length.max(1));
        for k in 0..runs {
            let first = (pairs - length) * k / (runs - 1).max(1);
            // The run is that of one emitter, as the engine is asked.
            let emitter = workload.pairs[first].emitter;
            let same = (first..first + length).filter(|&pair| workload.pairs[pair].emitter == emitter);
            let mut run = Run { hull: workload.hull(first).to_vec(), pairs: Vec::new() };
            for pair in same.take(SHAPE.1) {
                let first = sample.packets.len();
                workload.add_bundle(scene, pair, (rays, Order::Near), 0, &mut sample.packets);
                run.pairs.push((first..sample.packets.len(), workload.pairs[pair].emitter_size));
            }
            sample.runs.push(run);
        }
        sample
    }

    /// Bytes of a sample of so many segments of each pair, at most.
    pub fn bytes(rays: usize) -> usize {
        SHAPE.0 * SHAPE.1 * rays.div_ceil(LANES) * size_of::<Packet>()
    }

    /// The bundles of about `rays` segments (whole packets, as many as there are), run by run.
    pub fn bundles(&self, rays: usize) -> Vec<Vec<Bundle<'_>>> {
        let count = rays.div_ceil(LANES);
        let mut all = Vec::with_capacity(self.runs.len());
        for Run { hull, pairs } in &self.runs {
            let bundle = |(range, emitter_size): &(Range<usize>, f32)| {
                let packets = &self.packets[range.clone()];
                let packets = &packets[..count.min(packets.len())];
                Bundle { packets, emitter_size: *emitter_size, emitter: hull }
            };
            all.push(pairs.iter().map(bundle).collect());
        }
        all
    }

    /// Whether the engine pays for bundles like these.
    pub fn pays(&self, engine: &MultiResolution, s: f32, rays: usize) -> bool {
        let runs = self.bundles(rays);
        engine.pays(runs.iter().map(Vec::as_slice), s, &mut Workspace::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::workload::surface_points;
    use crate::scene::generate::{Spec, build};

    #[test]
    fn fewer_segments_are_the_first_of_more_and_memory_is_as_stated() {
        let scene = build(&Spec::new("desk-room")).expect("a room");
        let points = surface_points(&scene, 3000, 1).expect("points");
        let workload = Workload::new(&scene, points, 1);
        let (many, few) = (Sample::of(&scene, &workload, 256), Sample::of(&scene, &workload, 64));
        let (many_at_64, few_at_64) = (many.bundles(64).concat(), few.bundles(64).concat());
        assert!(many_at_64.len() > 100 && many_at_64.len() == few_at_64.len());
        for (a, b) in many_at_64.iter().zip(&few_at_64) {
            assert_eq!((a.packets.len(), a.emitter_size), (b.packets.len(), b.emitter_size));
            for (a, b) in a.packets.iter().zip(b.packets) {
                assert!(a.origin == b.origin && a.direction == b.direction && a.active == b.active);
            }
        }
        assert!(many.packets.len() * size_of::<Packet>() <= Sample::bytes(256));
    }
}
