//! Points on an emitter in cells of equal area: ends of the segments of all probes.

use crate::math::sampling::mix;
use crate::ray::{EndRule, LANES, Packet, gather_neighbours};
use crate::scene::{EmitterSampler, Scene};
use crate::visibility::probe::Probe;
use glam::Vec3;
use sobol_burley::sample_4d;

/// Number of sets of points, each with a point in each cell. Neighbouring probes use different sets, so that their noise differs. As
/// many as a run of [`gather_neighbours`] has points.
const SETS: usize = LANES;

/// Points on an emitter, [`SETS`] in each of the cells.
pub(super) struct Targets {
    /// Positions, normals of their faces, and end rules, by set and cell.
    points: Vec<(Vec3, Vec3, EndRule)>,
    cells: usize,
}

impl Targets {
    /// Cells are runs of neighbouring points: compact and of equal area.
    pub fn new(scene: &Scene, sampler: &EmitterSampler, cells: usize, seed: u32) -> Targets {
        let faces = sampler.all();
        let draw = |i: u32| {
            let [u, v, ..] = sample_4d(i & 0xffff, 0, seed ^ (i >> 16).wrapping_mul(0x9e37_79b9));
            faces.sample(scene, u, v)
        };
        // The rule carries the number of the point through the sorting.
        let drawn: Vec<(Vec3, Vec3, f32)> = (0..(cells * SETS) as u32).map(draw).collect();
        let mut order: Vec<(Vec3, EndRule)> =
            drawn.iter().zip(0..).map(|(point, k)| (point.0, EndRule::of_slack(k as f32))).collect();
        gather_neighbours(&mut order);
        let mut points = vec![(Vec3::ZERO, Vec3::ZERO, EndRule::new(0.0)); drawn.len()];
        for (cell, run) in order.chunks(SETS).enumerate() {
            // The assignment of points to sets changes from cell to cell.
            let turn = mix(u64::from(seed) << 32 | cell as u64) as usize;
            for (k, (_, number)) in run.iter().enumerate() {
                let (at, normal, magnitude) = drawn[number.slack() as usize];
                points[(k ^ turn) % SETS * cells + cell] = (at, normal, EndRule::new(magnitude));
            }
        }
        Targets { points, cells }
    }

    /// Appends segments from a probe to the points of a set on faces whose fronts are turned towards it.
    pub fn add_segments(&self, probe: &Probe, set: usize, packets: &mut Vec<Packet>) {
        let mut lane = packets.last().map_or(LANES, Packet::len);
        for &(at, normal, rule) in &self.points[set % SETS * self.cells..][..self.cells] {
            if normal.dot(probe.at - at) <= 0.0 {
                continue;
            }
            if lane == LANES {
                packets.push(Packet::EMPTY);
                lane = 0;
            }
            let there = rule.seen_from(probe.rule);
            let end = there.lifted(at, normal);
            packets.last_mut().expect("just pushed").set_lifted(lane, probe.at, end, [probe.rule, there]);
            lane += 1;
        }
    }
}
