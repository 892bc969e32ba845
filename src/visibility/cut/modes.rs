//! Modes: widths with which the cut answers, and the pilot's measurements with each width.

use super::traverse::PacketTrace;
use crate::ray::LANES;

/// Number of classes of packets; see [`class`].
pub(super) const CLASSES: usize = 6;
/// The mean square error of n stratified segments falls as n to this power: 1.2 to 1.3 outdoors, 1 if they were independent
/// (`mrvis bench`, RMS of 16, 64 and 256 segments).
pub(super) const STRATIFIED_EXPONENT: f32 = 1.25;
/// The same for segments that are tested against no small triangle, so that their visibility has fewer edges: 1.4 to 1.5 on the ground
/// of a garden, where nine tenths of the receivers are of that class (`mrvis bench`, RMS of 16, 64 and 256 segments).
pub(super) const SMOOTH_EXPONENT: f32 = 1.45;

/// Class of a packet of `segments` by how often one of sixteen was tested against triangles of small pieces: never, once, and steps of
/// four up to 256 and more.
pub(super) fn class(trace: &PacketTrace, segments: u32) -> usize {
    match trace.small_tests * LANES as u32 / segments.max(1) {
        0 if trace.small_tests == 0 => 0,
        tests => (1 + tests.max(1).ilog2() as usize / 2).min(CLASSES - 1),
    }
}

/// Measurements of a pilot in a class, with packets of sixteen segments.
#[derive(Clone, Copy, Debug, Default)]
pub struct Fit {
    /// Factor of all extinctions.
    pub factor: f32,
    /// Variance of the mean of a packet of exact segments, relative to T (1 - T).
    pub exact: f32,
    /// Variance of the mean of a packet of the cut, relative to T (1 - T).
    pub spread: f32,
    /// Variance of single segments of the cut among those of a packet, relative to T (1 - T).
    pub single: f32,
    /// Mean square of the error of an answer T that more segments do not reduce, relative to T (1 - T). One standard error is added
    /// to the measured value, so that it is not too small in classes where it is uncertain.
    pub model: f32,
    /// Estimated work of Embree for a segment, and of the cut.
    pub work: [f32; 2],
    /// Power of n with which the variance of n segments falls.
    pub power: f32,
    /// Fraction of the pilot's packets that are in this class.
    pub part: f32,
}

impl Fit {
    /// Time of Embree over that of the cut for sixteen segments at the same error.
    pub fn gain(&self) -> f32 {
        let error = (self.spread + self.model).max(f32::MIN_POSITIVE);
        self.work[0] / self.work[1] * (self.exact / error).powf(1.0 / STRATIFIED_EXPONENT)
    }

    /// The same for n segments, for which the error of the model weighs more.
    pub(in crate::visibility) fn gain_of(&self, n: f32) -> f32 {
        let fewer = (LANES as f32 / n).powf(self.power);
        let error = (self.spread * fewer + self.model).max(f32::MIN_POSITIVE);
        self.work[0] / self.work[1] * (self.exact * fewer / error).powf(1.0 / self.power)
    }

    /// Variance of the mean of n segments over that of a single one.
    pub fn averaged(&self, n: f32) -> f32 {
        self.spread / self.single.max(f32::MIN_POSITIVE) * (LANES as f32 / n).powf(self.power)
    }
}

/// A way to answer bundles.
#[derive(Clone, Copy, Debug)]
pub struct Mode {
    /// Width of the part of the emitter that a segment represents, relative to that of the emitter.
    pub width: f32,
    /// The pilot's measurements by class.
    pub fits: [Fit; CLASSES],
}

impl Mode {
    /// A mode with this width and this factor of all extinctions, without measurements.
    pub fn unmeasured(width: f32, factor: f32) -> Mode {
        Mode { width, fits: [Fit { factor, ..Fit::default() }; CLASSES] }
    }

    /// Work of the cut for the segments of the pilot divided by that of Embree.
    pub(in crate::visibility) fn work(&self) -> f32 {
        let work = |of: usize| self.fits.iter().map(|fit| fit.part * fit.work[of]).sum::<f32>();
        work(1) / work(0).max(f32::MIN_POSITIVE)
    }

    /// The smallest factor of a class.
    pub(super) fn smallest_factor(&self) -> f32 {
        self.fits.iter().map(|fit| fit.factor).fold(f32::INFINITY, f32::min)
    }
}

/// Relative time of exact rays if the mean square error shall be smaller by a factor of `ratio`: the relative number of rays.
pub fn rays_for(ratio: f64) -> f64 {
    ratio.powf(1.0 / f64::from(STRATIFIED_EXPONENT))
}
