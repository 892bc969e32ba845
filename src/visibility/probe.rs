//! Points of surfaces that have nothing close to them, between which light is interpolated (docs/method.md, Far-field cache).

use super::cut::{DistanceCut, HalfBall};
use crate::ray::EndRule;
use crate::scene::EmitterSampler;
use glam::Vec3;

/// Radius around probes that must be empty, relative to the distance between them and for an emitter of an angle of 1: no less than √2, so
/// that the balls of the four corners of a cell hold every segment between it and a corner. With twice the value the RMS error is the same
/// in the garden of `make scenes`, with 1.7 times the probes; half of the leaf forest's probes then lie among leaves.
const CLEARANCE: f32 = 1.5;

/// A point of a surface, lifted off it.
#[derive(Clone, Copy, Debug)]
pub struct Probe {
    pub(super) at: Vec3,
    pub(super) normal: Vec3,
    pub(super) rule: EndRule,
}

impl Probe {
    /// A point of a surface with faces of this magnitude, see [`EndRule`].
    #[cfg(any(test, feature = "reports"))]
    pub fn new(position: Vec3, normal: Vec3, magnitude: f32) -> Probe {
        let rule = EndRule::new(magnitude);
        Probe::lifted(rule.lifted(position, normal), normal, rule)
    }

    /// A point that is lifted off its surface already.
    pub fn lifted(at: Vec3, normal: Vec3, rule: EndRule) -> Probe {
        Probe { at, normal, rule }
    }

    /// Whether the light of all emitters may be interpolated between probes this far apart: nothing lies within a radius that increases as
    /// the apparent size of the emitters decreases, so that penumbrae are wider than that distance.
    pub fn is_clear(&self, cut: &DistanceCut, emitters: &[EmitterSampler], apart: f32) -> bool {
        let angle = |emitter: &EmitterSampler| {
            emitter.size_from(self.at) / emitter.distance(self.at).max(f32::MIN_POSITIVE)
        };
        self.is_empty_within(cut, CLEARANCE * apart / emitters.iter().map(angle).fold(1.0, f32::min))
    }

    /// Whether nothing lies within this radius above the surface. A triangle close to the half ball may count.
    pub(super) fn is_empty_within(&self, cut: &DistanceCut, radius: f32) -> bool {
        let Probe { at, normal, rule } = *self;
        cut.is_empty(HalfBall { at, radius, normal, depth: 0.5 * rule.height() })
    }
}
