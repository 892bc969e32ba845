//! The estimated error of a solution.

use super::{ErrorBarAudit, PointsError};

/// Smallest number of audited elements whose RMS error is the error estimate: the estimate is then known to about 1/√(2 · 50) = 10
/// % of itself where errors are normally distributed.
const MIN_AUDITED: usize = 50;
/// Largest estimate from error bars alone, relative to the mean irradiance: with larger ones the error counts as unknown.
const MAX_FROM_BARS: f64 = 1.0;

/// RMS error of the irradiance of elements, or of points, relative to its mean. The estimate and its interval have one source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorEstimate {
    /// The estimate.
    pub rms: f64,
    /// Upper end of its 95 % interval, where the source has one.
    pub upper: Option<f64>,
    /// Source of both.
    pub source: ErrorSource,
}

/// Source of an error estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ErrorSource {
    /// Independent paths from a sample of the elements.
    Audit,
    /// The error bars of all elements.
    Bars,
    /// Independent paths from a sample of the points, where the light of elements was not asked for.
    Points,
}

impl ErrorEstimate {
    /// From the error at points.
    pub fn of_points(error: PointsError) -> ErrorEstimate {
        ErrorEstimate { rms: error.rms, upper: Some(error.rms_upper), source: ErrorSource::Points }
    }

    /// From the audit if it has enough elements, else from the RMS of the error bars, `bars`; `None` if it is not finite, or far above
    /// the bars.
    pub fn of(audit: &ErrorBarAudit, bars: f64) -> Option<ErrorEstimate> {
        if audit.elements >= MIN_AUDITED {
            let ErrorBarAudit { expected_rms: rms, rms_upper, .. } = *audit;
            let found = ErrorEstimate { rms, upper: Some(rms_upper), source: ErrorSource::Audit };
            return (rms.is_finite() && rms_upper.is_finite()).then_some(found);
        }
        // False for NaN.
        let known = bars <= MAX_FROM_BARS;
        known.then_some(ErrorEstimate { rms: bars, upper: None, source: ErrorSource::Bars })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_estimate_and_its_interval_have_one_source() {
        let audit = |elements, rms, upper| ErrorBarAudit {
            elements,
            expected_rms: rms,
            rms_upper: upper,
            ..ErrorBarAudit::default()
        };
        let audited = ErrorEstimate::of(&audit(50, 0.01, 0.02), 0.3).expect("known");
        assert_eq!((audited.rms, audited.upper, audited.source), (0.01, Some(0.02), ErrorSource::Audit));
        // An audit of few elements has an interval, but the estimate is that of the bars.
        let few = ErrorEstimate::of(&audit(49, 0.01, 0.02), 0.3).expect("known");
        assert_eq!((few.rms, few.upper, few.source), (0.3, None, ErrorSource::Bars));
        for (audit, bars) in [
            (audit(0, 0.0, 0.0), 60.0),
            (audit(0, 0.0, 0.0), f64::NAN),
            (audit(99, f64::NAN, 0.02), 0.3),
            (audit(99, f64::INFINITY, f64::INFINITY), 0.3),
        ] {
            assert_eq!(ErrorEstimate::of(&audit, bars), None);
        }
    }
}
