//! The far-field cache: probes on a surface that have nothing close to them, so that light between them varies slowly and is interpolated
//! (docs/method.md, Far-field cache).

mod targets;
#[cfg(test)]
mod tests;

use super::answer::{Answer, Bundle};
use super::cut::{Cut, Mode};
use super::exact::Exact;
use super::multires::MultiResolution;
use super::probe::Probe;
use crate::ray::Packet;
use crate::scene::{EmitterSampler, Scene};
use std::sync::Arc;
use targets::Targets;

/// Smallest gain at which probes use the cut: the pilot measures gains to about a tenth.
const MIN_GAIN: f32 = 1.25;

/// Data shared by the probes of a model.
pub struct FarField<'a> {
    cut: Arc<Cut>,
    exact: Exact,
    emitters: &'a [EmitterSampler],
    /// Targets of each emitter.
    targets: Vec<Targets>,
}

/// Reusable buffers for segments, kept between probes.
#[derive(Default)]
pub struct Scratch {
    packets: Vec<Packet>,
    blocked: Vec<u32>,
}

impl<'a> FarField<'a> {
    /// Segments of all probes end in `cells` cells of each emitter. `None` if the engine has no distance cut.
    pub fn new(
        engine: &MultiResolution,
        (scene, emitters): (&Scene, &'a [EmitterSampler]),
        (cells, seed): (usize, u32),
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
        scratch: &mut Scratch,
    ) -> Answer {
        let Scratch { packets, blocked } = scratch;
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

    /// The mode of the cut with the largest gain for so many segments from receivers with nothing small close to them; none if exact rays
    /// reach the same error in about as little time.
    fn mode(&self, segments: usize) -> Option<&Mode> {
        let gains = self.cut.modes().iter().map(|mode| (mode.fits[0].gain_of(segments as f32), mode));
        let best = gains.max_by(|a, b| a.0.total_cmp(&b.0));
        best.filter(|(gain, _)| *gain > MIN_GAIN).map(|(_, mode)| mode)
    }
}
