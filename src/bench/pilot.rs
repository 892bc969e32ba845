//! Sample of the pairs on which a pilot measures errors and times before a row is planned.

use super::measure::Queries;
use crate::ray::{LANES, Packet};

/// Segments per pair of the averaged level of unbiased rows: the numbers at which MR is fastest relative to exact rays
/// (docs/report.md, Where MR pays), and one step more.
pub(super) const UNBIASED_SEGMENTS: [usize; 3] = [64, 256, 1024];
/// Number of runs of neighbouring pairs in a pilot: 32 independent runs give the standard error to 1/√62 = 13 %.
pub(super) const PILOT_RUNS: usize = 32;
/// Pairs per run of a pilot: 32 neighbours share their traversal as in a full row.
pub(super) const PILOT_RUN_PAIRS: usize = 32;

/// Upper bound of the memory of a pilot's segments (two independent sets), bytes.
pub(super) fn pilot_bytes() -> usize {
    let packets = UNBIASED_SEGMENTS.map(|n| n.div_ceil(LANES)).into_iter().max().unwrap_or(0);
    2 * PILOT_RUNS * PILOT_RUN_PAIRS * packets * size_of::<Packet>()
}

/// Pairs of a pilot: runs of neighbouring queries, evenly spread.
pub(super) fn pilot_pairs(queries: Queries) -> Vec<usize> {
    let all = queries.pairs.len();
    let length = PILOT_RUN_PAIRS.min(all);
    let runs = PILOT_RUNS.min(all / length.max(1));
    let first = |k: usize| (all - length) * k / (runs - 1).max(1);
    (0..runs).flat_map(|k| queries.pairs[first(k)..first(k) + length].iter().copied()).collect()
}
