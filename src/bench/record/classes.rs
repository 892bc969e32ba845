//! Rows by class of receiver.

use super::{ExactRow, MrRow, best_of};
use serde::Serialize;

/// What lies around a receiver point; the rule is in docs/report.md, Receiver classes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ReceiverClass {
    /// Nothing small lies near.
    #[default]
    Open,
    /// Something small lies near.
    Near,
    /// The point lies on something small.
    Inside,
    /// Large surfaces enclose the point.
    Interior,
}

impl ReceiverClass {
    /// All classes, in the order of records.
    pub const ALL: [ReceiverClass; 4] =
        [ReceiverClass::Open, ReceiverClass::Near, ReceiverClass::Inside, ReceiverClass::Interior];

    /// The name in records.
    pub fn name(self) -> &'static str {
        match self {
            ReceiverClass::Open => "open",
            ReceiverClass::Near => "near",
            ReceiverClass::Inside => "inside",
            ReceiverClass::Interior => "interior",
        }
    }
}

/// Rows over the receiver points of one class.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ClassRecord {
    /// The class.
    pub class: ReceiverClass,
    /// Receiver points of this class that face an emitter.
    pub points: usize,
    /// Number of these that the rows are measured on.
    pub measured: usize,
    /// RMS noise of the reference, estimated from its two halves; it is subtracted from errors.
    pub reference_rms: f64,
    /// As [`Record::exact`](super::Record::exact).
    pub exact: Vec<ExactRow>,
    /// As [`Record::certified`](super::Record::certified).
    pub certified: Vec<ExactRow>,
    /// As [`Record::mr`](super::Record::mr); `speedup_at_same_fbem` is `null`. The route of each row is decided for this class.
    pub mr: Vec<MrRow>,
}

impl ClassRecord {
    /// The row that table and page show: that with the largest `speedup_at_same_rms`, or the first if none is defined.
    pub fn shown_row(&self) -> Option<&MrRow> {
        best_of(&self.mr).or(self.mr.first())
    }

    /// The smallest `speedup_at_same_rms` of a row.
    pub fn smallest_speedup(&self) -> Option<f64> {
        self.mr.iter().filter_map(|row| row.speedup_at_same_rms).min_by(f64::total_cmp)
    }
}
