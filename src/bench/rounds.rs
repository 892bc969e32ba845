//! Timing rule of all rows.
//!
//! The minimum of several times is smaller than a single time, so rows that are compared are run equally often. Rows
//! are run in turns, so that other load and clock changes affect all rows alike. Of each timed section the minimum
//! over its runs counts: other load only lengthens a section.

use std::time::{Duration, Instant};

/// Smallest number of runs of each row: the smaller of two times is without a single disturbance. Changes times only.
const MIN_ROUNDS: usize = 2;
/// Largest number of runs of each row: limits the time of a row to six times that of one run.
pub(super) const MAX_ROUNDS: usize = 6;
/// A round starts only if the rounds are expected to end within this time: limits the duration of a benchmark.
pub(super) const MAX_TIME: Duration = Duration::from_secs(10);

/// Pairs that are asked, untimed, before each timed row: one chunk of [`super::measure`], which loads the upper nodes
/// of the tree into the caches.
pub(super) const WARM_UP_PAIRS: usize = 1024;

/// Minimum times of rows that were run equally often.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Timed {
    /// Time of each row, seconds, in order.
    pub seconds: Vec<f64>,
    /// Number of runs of each row.
    pub rounds: usize,
}

/// Runs `rows` rows in at most `max_rounds` rounds. `run` gets the index of the row and whether this is its first run; it
/// returns the times of the row's timed sections, seconds, always the same sections.
pub(super) fn rounds(
    max_rounds: usize,
    max_time: Duration,
    rows: usize,
    mut run: impl FnMut(usize, bool) -> Vec<f64>,
) -> Timed {
    let start = Instant::now();
    let goes_on = |rounds: usize| {
        let likely_end = start.elapsed().mul_f64((rounds + 1) as f64 / rounds as f64);
        rounds < max_rounds && (rounds < MIN_ROUNDS || likely_end < max_time)
    };
    let mut best: Vec<Vec<f64>> = (0..rows).map(|row| run(row, true)).collect();
    let mut rounds = 1;
    while goes_on(rounds) {
        for (row, best) in best.iter_mut().enumerate() {
            shorten(best, &run(row, false));
        }
        rounds += 1;
    }
    Timed { seconds: best.iter().map(|sections| sections.iter().sum()).collect(), rounds }
}

/// Takes the smaller time of each section.
fn shorten(best: &mut [f64], again: &[f64]) {
    best.iter_mut().zip(again).for_each(|(a, &b)| *a = a.min(b));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_take_turns_and_are_run_equally_often() {
        let mut calls = Vec::new();
        let timed = rounds(MAX_ROUNDS, MAX_TIME, 3, |row, first| {
            calls.push((row, first));
            vec![1.0 + row as f64]
        });
        assert_eq!((timed.rounds, &timed.seconds[..]), (MAX_ROUNDS, &[1.0, 2.0, 3.0][..]));
        let turns: Vec<(usize, bool)> =
            (0..MAX_ROUNDS).flat_map(|round| (0..3).map(move |row| (row, round == 0))).collect();
        assert_eq!(calls, turns);
        assert!(rounds(MAX_ROUNDS, MAX_TIME, 0, |_, _| Vec::new()).seconds.is_empty());
    }

    /// A long row is run as often as a short one.
    #[test]
    fn long_rows_hold_short_ones_back() {
        let mut calls = [0, 0];
        let patience = Duration::from_millis(100);
        rounds(MAX_ROUNDS, patience, 2, |row, _| {
            calls[row] += 1;
            std::thread::sleep(if row == 0 { patience.mul_f64(0.4) } else { Duration::ZERO });
            vec![0.0]
        });
        assert_eq!(calls, [MIN_ROUNDS; 2]);
    }

    #[test]
    fn sections_keep_their_shorter_times() {
        let mut best = [1.0, 5.0, 2.0];
        shorten(&mut best, &[2.0, 1.0, 2.0]);
        assert_eq!(best, [1.0, 1.0, 2.0]);
    }
}
