//! Claimed and observed errors.

use serde::Serialize;

/// Comparison of the stated intervals of a row with independent exact rays on a random part of the bundles.
///
/// A 95 % interval claims a standard error of its width / (2 · 1.96). The noise of the audit's rays is subtracted
/// from the observed error.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct IntervalAudit {
    /// Requested part of the bundles, in `(0, 1]`.
    pub fraction: f64,
    /// Number of audited bundles.
    pub bundles: usize,
    /// Exact rays per bundle.
    pub rays: usize,
    /// Root mean square of the claimed standard errors.
    pub claimed_rms: f64,
    /// Observed RMS error.
    pub observed_rms: f64,
    /// 95 % interval of `observed_rms`, lower end.
    pub observed_lo: f64,
    /// 95 % interval of `observed_rms`, upper end.
    pub observed_hi: f64,
    /// Part of the stated intervals, in `[0, 1]`, that the audit confirms: mean p of the rays and answer x satisfy |p
    /// − x| ≤ √(h² + 1.96² q (1 − q) / rays), with h the half width of the interval on p's side and q = p clamped to
    /// the interval. Correct intervals have 0.95, for any number of rays.
    pub coverage: f64,
    /// 95 % interval (Wilson) of `coverage`, lower end.
    pub coverage_lo: f64,
    /// 95 % interval (Wilson) of `coverage`, upper end.
    pub coverage_hi: f64,
    /// Groups of bundles with similar claims, by ascending claim.
    pub bins: Vec<CalibrationBin>,
}

/// Bundles with similar claimed errors.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CalibrationBin {
    /// Number of bundles.
    pub count: usize,
    /// Root mean square of the claimed standard errors.
    pub claimed: f64,
    /// Observed RMS error.
    pub observed: f64,
    /// 95 % interval of `observed`, lower end.
    pub observed_lo: f64,
    /// 95 % interval of `observed`, upper end.
    pub observed_hi: f64,
}
