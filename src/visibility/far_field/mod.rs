//! The far-field cache: probes on a surface that have nothing close to them, so that light between them varies slowly and is interpolated
//! (docs/method.md, Far-field cache).

mod targets;
#[cfg(test)]
mod tests;

use super::answer::{Answer, Bundle};
use super::cut::{Cut, HalfBall, Mode};
use super::exact::Exact;
use super::multires::MultiResolution;
use crate::ray::{EndRule, Packet};
use crate::scene::{EmitterSampler, Scene};
use glam::Vec3;
use std::sync::Arc;
use targets::Targets;

/// Smallest gain at which the cut looks from probes: the pilot knows gains to about a tenth.
const MIN_GAIN: f32 = 1.25;

/// A point of a surface, lifted off it.
#[derive(Clone, Copy, Debug)]
pub struct Probe {
    at: Vec3,
    normal: Vec3,
    rule: EndRule,
}

impl Probe {
    /// A point of a surface with faces of this magnitude, see [`EndRule`].
    pub fn new(position: Vec3, normal: Vec3, magnitude: f32) -> Probe {
        let rule = EndRule::new(magnitude);
        Probe { at: rule.lifted(position, normal), normal, rule }
    }
}

/// What probes of a model are made with.
pub struct FarField<'a> {
    cut: Arc<Cut>,
    exact: Exact,
    emitters: Vec<(&'a EmitterSampler, Targets)>,
}

/// Memory of segments, kept between probes.
#[derive(Default)]
pub struct Scratch {
    packets: Vec<Packet>,
    blocked: Vec<u32>,
}

impl<'a> FarField<'a> {
    /// Segments of all probes end in `cells` cells of each emitter. `None` if the engine has no distance cut.
    pub fn new(
        engine: &MultiResolution,
        (scene, samplers): (&Scene, &'a [EmitterSampler]),
        (cells, seed): (usize, u32),
    ) -> Option<FarField<'a>> {
        let cut = engine.cut.clone()?;
        let emitter = |(k, sampler): (u32, &'a EmitterSampler)| {
            (sampler, Targets::new(scene, sampler, cells, seed ^ k.wrapping_mul(0x9e37_79b9)))
        };
        Some(FarField { cut, exact: engine.exact(), emitters: (0..).zip(samplers).map(emitter).collect() })
    }

    /// Whether nothing lies within this radius of a probe above its surface. A triangle close to the ball may count.
    pub fn is_clear(&self, probe: &Probe, radius: f32) -> bool {
        let Probe { at, normal, rule } = *probe;
        self.cut.is_empty(HalfBall { at, radius, normal, depth: 0.5 * rule.height() })
    }

    /// Smallest angle of an emitter seen from a probe, radians, at most 1.
    pub fn angle(&self, probe: &Probe) -> f32 {
        let angle = |(sampler, _): &(&EmitterSampler, Targets)| {
            sampler.size_from(probe.at) / sampler.distance(probe.at).max(f32::MIN_POSITIVE)
        };
        self.emitters.iter().map(angle).fold(1.0, f32::min)
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
        let (sampler, targets) = &self.emitters[emitter];
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
