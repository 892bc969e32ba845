//! What was claimed of errors, and what was found.

use serde::{Deserialize, Serialize};

/// Exact rays of their own on a random part of the bundles, against what a row stated.
///
/// An interval that is stated as holding the truth with 95 % claims a standard error of its width / (2 · 1.96). The
/// noise of the audit's own rays is subtracted from what was observed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Audit {
    /// Part of the bundles that was asked for, in `(0, 1]`.
    pub fraction: f64,
    /// Bundles looked at.
    pub bundles: usize,
    /// Exact rays for each of them.
    pub rays: usize,
    /// Root mean square of the claimed standard errors.
    pub claimed_rms: f64,
    /// Root mean square error found.
    pub observed_rms: f64,
    /// 95 % interval of `observed_rms`, lower end.
    pub observed_lo: f64,
    /// Upper end.
    pub observed_hi: f64,
    /// Part of the stated intervals, in `[0, 1]`, that agree with the audit's rays: the 95 % interval of the rays and
    /// the stated one have something in common.
    pub coverage: f64,
    /// 95 % interval (Wilson) of `coverage`, lower end.
    pub coverage_lo: f64,
    /// Upper end.
    pub coverage_hi: f64,
    /// Bundles of similar claims together, by ascending claim.
    pub bins: Vec<CalibrationBin>,
}

/// Estimates whose mean is the exact answer: an averaged level, corrected by exact segments.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UnbiasedRow {
    /// The averaged level, then the exact one.
    pub levels: Vec<UnbiasedLevel>,
    /// Segments from a point to an emitter of the averaged level.
    pub rays: usize,
    /// Time of the queries, seconds.
    pub seconds: f64,
    /// Time of measuring on a sample how to divide the work, seconds; not part of `seconds`.
    pub pilot_s: f64,
    /// Root mean square error.
    pub rms: f64,
    /// Mean error; positive: too bright. 0 but for chance.
    pub bias: f64,
    /// Standard error of `bias`.
    pub bias_error: f64,
    /// Time that plain exact rays need to reach this rms / this time; absent (null) when it cannot be told.
    pub speedup_at_same_rms: Option<f64>,
    /// Whether that rests on a time beyond the last exact row, extrapolated by rays^-1/2.
    pub extrapolated: bool,
}

/// A level of an [`UnbiasedRow`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UnbiasedLevel {
    /// Feature size; length. Absent (null): exact.
    pub feature_size: Option<f64>,
    /// Part of their size, in `(0, 1]`, that emitters are taken for in deciding what is averaged.
    pub emitter_part: f64,
    /// Segments from a point to an emitter, on average.
    pub rays: f64,
}

/// Bundles that claimed about the same error.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CalibrationBin {
    /// How many.
    pub count: usize,
    /// Root mean square of the claimed standard errors.
    pub claimed: f64,
    /// Root mean square error found.
    pub observed: f64,
    /// 95 % interval of `observed`, lower end.
    pub observed_lo: f64,
    /// Upper end.
    pub observed_hi: f64,
}
