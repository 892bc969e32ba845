//! Modes: how the cut answers a class of receivers, and for which numbers of segments it does.

use super::near::Found;

/// Number of classes of receivers; see [`class`].
pub(super) const CLASSES: usize = 6;
/// Smallest gain over Embree at which a mode is used: gains of the pilot are known to a tenth, and differ as much among the scenes that
/// were measured.
pub(super) const MIN_GAIN: f32 = 1.25;
/// Numbers of segments that are planned for: powers of two up to the largest of a query, 2¹⁶.
const NUMBERS: usize = 17;

/// Time of n exact segments through the tree over that of Embree's fastest call, at most: Embree gains with the coherence of many segments.
/// Measured were 1.0 to 1.2 for 16 segments, 1.5 for 64 and 2.4 for 256, the most in park and forest (`cargo bench --bench distance_cut`,
/// rows of width 0).
pub fn over_embree(n: f32) -> f32 {
    1.25 * (n / SET).cbrt().max(1.0)
}

/// Class of a receiver by the number of blocks of small triangles around it that cannot be averaged: none, one, and steps of four up to
/// 256 and more.
pub(super) fn class(found: Found) -> usize {
    match found.blocks {
        0 => 0,
        n => (1 + n.ilog2() as usize / 2).min(CLASSES - 1),
    }
}

/// Blocks from which on a receiver is of a higher class than this.
pub(super) fn limit(class: usize) -> u32 {
    1 << (2 * class.min(CLASSES - 2))
}

/// Segments of a set of the pilot.
const SET: f32 = 16.0;
/// The mean square error of n stratified segments falls as n to this power: 1.2 to 1.3 outdoors, 1 if they were independent
/// (`cargo bench --bench distance_cut`, RMS of 16, 64 and 256 rays).
const STRATIFIED: f32 = 1.25;

/// A way to answer receivers of a class, with what a pilot of sixteen segments a receiver measured there.
#[derive(Clone, Copy, Debug)]
pub struct Mode {
    /// Width of the part of the emitter that a segment stands for, relative to that of the emitter.
    pub width: f32,
    /// Factor of all extinctions.
    pub factor: f32,
    /// Variance of the mean of sixteen exact segments, relative to T (1 - T).
    pub exact: f32,
    /// Variance of the mean of sixteen segments of the cut, relative to T (1 - T).
    pub spread: f32,
    /// Variance of single segments of the cut among those of a receiver, relative to T (1 - T).
    pub single: f32,
    /// Mean square of the error of an answer T that more segments do not make smaller, relative to T (1 - T).
    pub model: f32,
    /// Work of an exact segment through the tree and of one of the cut, and of finding the class of a receiver.
    pub work: [f32; 3],
}

impl Mode {
    /// Time of Embree over that of the cut's n segments at the same error, at least: the variance of a mean falls with n, the error of the
    /// model stays.
    pub fn gain(&self, n: f32) -> f32 {
        let error = self.spread + self.model * (n / SET).powf(STRATIFIED);
        let [exact, cut, class] = self.work;
        let time = (cut + class / n) / exact * over_embree(n);
        1.0 / time * (self.exact / error.max(f32::MIN_POSITIVE)).powf(1.0 / STRATIFIED)
    }

    /// Variance of the mean of n segments over that of a single one.
    pub fn averaged(&self, n: f32) -> f32 {
        self.spread / self.single.max(f32::MIN_POSITIVE) * (SET / n).powf(STRATIFIED)
    }
}

/// The mode of each class for each number of segments.
#[derive(Clone, Debug, Default)]
pub(super) struct Plan {
    modes: [[Option<Mode>; CLASSES]; NUMBERS],
}

impl Plan {
    /// The best of these modes for each class and number of segments, unless the gain is too small.
    pub fn of(modes: &[Vec<Mode>; CLASSES]) -> Plan {
        let mut plan = Plan::default();
        for (k, row) in plan.modes.iter_mut().enumerate() {
            let n = (1u32 << k) as f32;
            for (best, modes) in row.iter_mut().zip(modes) {
                let gains = modes.iter().filter(|mode| mode.gain(n) >= MIN_GAIN);
                *best = gains.max_by(|a, b| a.gain(n).total_cmp(&b.gain(n))).copied();
            }
        }
        plan
    }

    /// Whether the cut is used at all.
    pub fn is_empty(&self) -> bool {
        self.modes.iter().flatten().all(Option::is_none)
    }

    /// The modes of all classes for n segments; those of the next power of two, at which the model's error weighs more. None beyond the
    /// numbers that are planned for.
    pub fn of_number(&self, n: usize) -> [Option<Mode>; CLASSES] {
        let k = n.max(1).next_power_of_two().ilog2() as usize;
        self.modes.get(k).copied().unwrap_or_default()
    }
}
