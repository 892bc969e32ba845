//! The far-field cache: probes on a surface that have nothing close to them, so that light between them varies slowly and is interpolated
//! (docs/method.md, Far-field cache).

#[cfg(test)]
mod tests;

use super::answer::{Answer, Bundle};
use super::cut::{DistanceCut, Mode};
use super::exact::Exact;
use super::multires::MultiResolution;
use super::probe::Probe;
use crate::math::sampling::{Site, mix, sobol};
use crate::ray::{EndRule, LANES, Packet, gather_neighbours};
use crate::scene::{EmitterSampler, Scene};
use glam::Vec3;
use std::sync::Arc;

/// Smallest gain at which probes use the cut: the pilot measures gains to about a tenth.
const MIN_GAIN: f32 = 1.25;

/// Data shared by the probes of a model.
pub struct FarField<'a> {
    cut: Arc<DistanceCut>,
    exact: Exact,
    emitters: &'a [EmitterSampler],
    /// Targets of each emitter.
    targets: Vec<Targets>,
}

/// Reusable buffers for segments, kept between probes.
#[derive(Default)]
pub struct FarFieldBuffers {
    packets: Vec<Packet>,
    blocked: Vec<u32>,
}

impl<'a> FarField<'a> {
    /// Segments of all probes end in `cells` cells of each emitter. `None` if the engine has no distance cut.
    pub fn new(
        engine: &MultiResolution,
        scene: &Scene,
        emitters: &'a [EmitterSampler],
        cells: usize,
        seed: u32,
    ) -> Option<FarField<'a>> {
        let cut = engine.cut.clone()?;
        let targets = |(k, emitter): (u32, &EmitterSampler)| {
            Targets::new(scene, emitter, cells, seed ^ k.wrapping_mul(0x9e37_79b9))
        };
        let targets = (0..).zip(emitters).map(targets).collect();
        Some(FarField { cut, exact: engine.exact(), emitters, targets })
    }

    /// [`Probe::is_clear`] for probes of this far field.
    pub fn is_clear(&self, probe: &Probe, apart: f32) -> bool {
        probe.is_clear(&self.cut, self.emitters, apart)
    }

    /// Fraction of an emitter that a probe sees, by one or several sets of segments.
    pub fn visible(
        &self,
        probe: &Probe,
        emitter: usize,
        sets: impl Iterator<Item = usize>,
        scratch: &mut FarFieldBuffers,
    ) -> Answer {
        let FarFieldBuffers { packets, blocked } = scratch;
        let (sampler, targets) = (&self.emitters[emitter], &self.targets[emitter]);
        packets.clear();
        sets.for_each(|set| targets.add_segments(probe, set, packets));
        Packet::share_slack(packets);
        let emitter_size = sampler.size_from(probe.at);
        let bundle = Bundle { packets, emitter_size, emitter: sampler.hull() };
        let segments: usize = packets.iter().map(Packet::len).sum();
        let mut found = None;
        if let Some(mode) = self.mode(segments).filter(|_| self.cut.takes(&bundle)) {
            self.cut.answers_that_pay(&[bundle], mode, |answer, _| found = answer);
        }
        found.unwrap_or_else(|| self.exact.answer(bundle, blocked))
    }

    /// The mode of the cut with the largest gain for `segments` segments from receivers with nothing small close to them; none if exact
    /// rays reach the same error in about as little time.
    fn mode(&self, segments: usize) -> Option<&Mode> {
        let gains = self.cut.modes().iter().map(|mode| (mode.fits[0].gain_of(segments as f32), mode));
        let best = gains.max_by(|a, b| a.0.total_cmp(&b.0));
        best.filter(|(gain, _)| *gain > MIN_GAIN).map(|(_, mode)| mode)
    }
}

// Points on an emitter in cells of equal area: ends of the segments of all probes.

/// Number of sets of points, each with a point in each cell. Neighbouring probes use different sets, so that their noise differs. As
/// many as a run of [`gather_neighbours`] has points.
const SETS: usize = LANES;

/// Points on an emitter, [`SETS`] in each of the cells.
struct Targets {
    /// Positions, normals of their faces, and end rules, by set and cell.
    points: Vec<(Vec3, Vec3, EndRule)>,
    cells: usize,
}

impl Targets {
    /// Cells are runs of neighbouring points: compact and of equal area.
    pub fn new(scene: &Scene, sampler: &EmitterSampler, cells: usize, seed: u32) -> Targets {
        let faces = sampler.all();
        let draw = |i: u32| {
            let [u, v, ..] = sobol(i, 0, seed);
            faces.sample(scene, u, v)
        };
        // The rule carries the number of the point through the sorting.
        let drawn: Vec<Site> = (0..(cells * SETS) as u32).map(draw).collect();
        let mut order: Vec<(Vec3, EndRule)> =
            drawn.iter().zip(0..).map(|(point, k)| (point.position, EndRule::of_slack(k as f32))).collect();
        gather_neighbours(&mut order);
        let mut points = vec![(Vec3::ZERO, Vec3::ZERO, EndRule::new(0.0)); drawn.len()];
        for (cell, run) in order.chunks(SETS).enumerate() {
            // The assignment of points to sets changes from cell to cell.
            let turn = mix(u64::from(seed) << 32 | cell as u64) as usize;
            for (k, (_, number)) in run.iter().enumerate() {
                let Site { position, normal, magnitude } = drawn[number.slack() as usize];
                points[(k ^ turn) % SETS * cells + cell] = (position, normal, EndRule::new(magnitude));
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
