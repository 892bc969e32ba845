//! Modes: widths with which the cut answers, and what a pilot measured with each.

use super::traverse::Met;
use crate::ray::LANES;

/// Number of classes of packets; see [`class`].
pub(super) const CLASSES: usize = 6;
/// The mean square error of n stratified segments falls as n to this power: 1.2 to 1.3 outdoors, 1 if they were independent
/// (`mrvis bench`, RMS of 16, 64 and 256 segments).
pub(super) const STRATIFIED: f32 = 1.25;
/// The same for segments that are tested against no small triangle, so that what they see has fewer edges: 1.4 to 1.5 on the ground of a
/// garden, where nine tenths of the receivers are of that class (`mrvis bench`, RMS of 16, 64 and 256 segments).
pub(super) const SMOOTH: f32 = 1.45;

/// Class of a packet of `segments` by how often one of sixteen was tested against triangles of small pieces: never, once, and steps of
/// four up to 256 and more.
pub(super) fn class(met: &Met, segments: u32) -> usize {
    match met.small_tests * LANES as u32 / segments.max(1) {
        0 if met.small_tests == 0 => 0,
        tests => (1 + tests.max(1).ilog2() as usize / 2).min(CLASSES - 1),
    }
}

/// What a pilot of packets of sixteen segments measured in a class.
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
    /// Mean square of the error of an answer T that more segments do not make smaller, relative to T (1 - T); one standard error more
    /// than was measured, so that it is not too small in classes where it is hardly known.
    pub model: f32,
    /// Estimated work of Embree for a segment, and of the cut.
    pub work: [f32; 2],
    /// Power of n with which the variance of n segments falls.
    pub power: f32,
    /// Part of the packets of the pilot.
    pub part: f32,
}

impl Fit {
    /// Time of Embree over that of the cut for sixteen segments at the same error.
    pub fn gain(&self) -> f32 {
        let error = (self.spread + self.model).max(f32::MIN_POSITIVE);
        self.work[0] / self.work[1] * (self.exact / error).powf(1.0 / STRATIFIED)
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

/// A way to answer.
#[derive(Clone, Copy, Debug)]
pub struct Mode {
    /// Width of the part of the emitter that a segment stands for, relative to that of the emitter.
    pub width: f32,
    /// What the pilot measured, by class.
    pub fits: [Fit; CLASSES],
}

impl Mode {
    /// Averages with a width and a factor of all extinctions that nothing was measured of.
    pub fn unmeasured(width: f32, factor: f32) -> Mode {
        Mode { width, fits: [Fit { factor, ..Fit::default() }; CLASSES] }
    }

    /// Work of the cut for the segments of the pilot over that of Embree.
    pub(in crate::visibility) fn work(&self) -> f32 {
        let work = |of: usize| self.fits.iter().map(|fit| fit.part * fit.work[of]).sum::<f32>();
        work(1) / work(0).max(f32::MIN_POSITIVE)
    }

    /// The smallest factor of a class.
    pub(super) fn smallest_factor(&self) -> f32 {
        self.fits.iter().map(|fit| fit.factor).fold(f32::INFINITY, f32::min)
    }
}

/// Time that exact rays take to an error, relative to one with 1/`ratio` of the mean square: the number of rays that an error needs.
pub fn rays_for(ratio: f64) -> f64 {
    ratio.powf(1.0 / f64::from(STRATIFIED))
}
