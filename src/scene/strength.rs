//! Strength of emitters.

use std::f64::consts::PI;

/// Strength of a named emitter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Strength {
    /// Power of each channel, W.
    Watts(f64),
    /// Luminous flux, lm.
    Lumens(f64),
    /// Luminance, cd/m².
    Luminance(f64),
}

impl Strength {
    /// Radiance of each channel, W/(m² sr), of an emitter of `area` m² (all emitting sides).
    pub(super) fn radiance(self, area: f64, lumens_per_watt: f64) -> f64 {
        match self {
            Strength::Watts(w) => w / (area * PI),
            Strength::Lumens(lm) => lm / lumens_per_watt / (area * PI),
            Strength::Luminance(l) => l / lumens_per_watt,
        }
    }

    /// The number and its unit.
    pub(super) fn parts(self) -> (f64, &'static str) {
        match self {
            Strength::Watts(v) => (v, "W"),
            Strength::Lumens(v) => (v, "lm"),
            Strength::Luminance(v) => (v, "cd/m\u{b2}"),
        }
    }
}
