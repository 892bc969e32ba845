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
    /// Part of the stated intervals, in `[0, 1]`, that the audit's rays bear out: their mean p and the answer x differ
    /// by no more than √(h² + 1.96² q (1 - q) / rays), where h is the half of the stated interval on p's side and q is p
    /// moved into the interval. 0.95 for honest claims, whatever the rays' own noise.
    pub coverage: f64,
    /// 95 % interval (Wilson) of `coverage`, lower end.
    pub coverage_lo: f64,
    /// Upper end.
    pub coverage_hi: f64,
    /// Bundles of similar claims together, by ascending claim.
    pub bins: Vec<CalibrationBin>,
}

/// What was asked for, chosen, expected and found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// What was asked for.
    pub asked: TargetAsked,
    /// What was chosen.
    pub chosen: TargetChoice,
    /// Root mean square error that the pilot expects.
    pub expected_rms: f64,
    /// 95 % interval of `expected_rms`, lower end.
    pub expected_rms_lo: f64,
    /// Upper end.
    pub expected_rms_hi: f64,
    /// Time of the queries that the pilot expects, seconds.
    pub expected_seconds: f64,
    /// Time of the pilot, seconds: what the choice took.
    pub pilot_s: f64,
    /// Time of the queries, seconds; a target of time is met by both together.
    pub seconds: f64,
    /// Root mean square error found.
    pub rms: f64,
    /// Mean error; positive: too bright.
    pub bias: f64,
    /// 95 % interval of `rms`, lower end.
    pub rms_lo: f64,
    /// Upper end.
    pub rms_hi: f64,
    /// Whether any choice was expected to do.
    pub reachable: bool,
    /// Whether error or time is what was asked for, or less.
    pub met: bool,
    /// Whether the intervals of the expected and the found error have something in common.
    pub as_expected: bool,
    /// The audit of the answers; absent (null) without one.
    pub audit: Option<Audit>,
}

/// What a [`Target`] asks: one of the two.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TargetAsked {
    /// Root mean square error, at most.
    pub error: Option<f64>,
    /// Time of choosing and of the queries together, at most; seconds.
    pub seconds: Option<f64>,
}

/// How a [`Target`] is reached.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TargetChoice {
    /// Feature size; length. Absent (null): exact.
    pub feature_size: Option<f64>,
    /// Whether nothing is averaged.
    pub exact: bool,
    /// Segments from a point to an emitter.
    pub rays: usize,
    /// Segments for those pairs that the first ones find partly visible; absent (null): the same.
    pub rays_where_partly_visible: Option<usize>,
    /// Part of the pairs, in `[0, 1]`, that the pilot found partly visible and asked again.
    pub partly_visible: f64,
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
