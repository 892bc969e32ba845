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
