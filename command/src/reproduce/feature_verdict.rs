//! The checks of Figure 9, of numbers alone.

use super::cubes::COVERAGE;
use super::item::Item;
use super::plain::Leaves;
use super::table_1::{SATISFACTORY, paper_parts, satisfactory_spread};
use super::{MIN_STANDARD_ERRORS, Repeated, fixed, list};

/// Feature sizes of the paper, in its relative unit.
pub const SIZES: [f64; 4] = [2.0, 2.8, 3.5, 5.0];
/// The paper's seconds for these sizes.
pub const PAPER_SECONDS: [f64; 4] = [1984.0, 1648.0, 1459.0, 1356.0];

/// Measured numbers that the checks judge, for one treatment of leaves, by feature size.
#[derive(Clone, Debug)]
pub struct Measured {
    pub leaves: Leaves,
    /// Millions.
    pub visits: Vec<f64>,
    /// Seconds, in two repetitions.
    pub times: Repeated,
    /// L2 and FBEM(s) of each group, per cent of the light.
    pub errors: Vec<[[f64; 2]; 4]>,
    /// L2 by the noise of the images, per cent.
    pub noise: f64,
    /// Mean light without averaging, and at the largest size, per cent.
    pub light: [f64; 2],
    /// Fraction of the shadows of each group that belongs to features above the size, per cent.
    pub wide: Vec<[f64; 4]>,
}

/// The error of a group at a size.
#[derive(Clone, Copy)]
struct Place {
    group: usize,
    size: usize,
    error: f64,
}

impl Place {
    fn name(&self) -> String {
        format!("group {} at s = {}", self.group + 1, SIZES[self.size])
    }
}

impl Measured {
    /// L2 above which it counts as risen, per cent: three times the noise.
    fn risen(&self) -> f64 {
        3.0 * self.noise
    }

    /// One error of a group by size: 0 for L2, 1 for FBEM.
    fn column(&self, group: usize, kind: usize) -> Vec<f64> {
        self.errors.iter().map(|row| row[group][kind]).collect()
    }

    /// FBEM where L2 has risen: clusters are averaged.
    fn averaged(&self) -> Vec<Place> {
        let cells = self.errors.iter().enumerate().flat_map(|(size, row)| {
            row.iter().enumerate().map(move |(group, cell)| (Place { group, size, error: cell[1] }, cell[0]))
        });
        cells.filter(|(_, l2)| *l2 > self.risen()).map(|(place, _)| place).collect()
    }
}

/// The paper's ratio of the times at the first and the last size.
fn paper_factor() -> f64 {
    PAPER_SECONDS[0] / PAPER_SECONDS[3]
}

/// All checks of one treatment of leaves.
pub fn judge(item: &mut Item, measured: &Measured) {
    judge_work(item, measured);
    judge_l2(item, measured);
    judge_fbem(item, measured);
}

/// Whether work and time fall.
fn judge_work(item: &mut Item, measured: &Measured) {
    let name = measured.leaves.name();
    let Measured { visits, times, .. } = measured;
    // The paper's times are of extinction in leaves.
    let (factor, suffix) = match measured.leaves {
        Leaves::Extinction => {
            let factor = paper_factor();
            (
                factor,
                format!(", from the first to the last by at least the paper's factor of times, {factor:.2}"),
            )
        }
        Leaves::Surfaces => (1.0, String::new()),
    };
    let found = visits[0] / visits[3];
    let rises = visits.windows(2).position(|v| v[1] >= v[0]);
    item.check(
        format!("{name}: work falls with s{suffix}"),
        format!("{} million visits, by a factor of {}", list(visits, 2), fixed(found, 2)),
        rises.is_none() && found >= factor,
        || match rises {
            Some(k) => {
                format!("no more clusters are averaged at s = {} than at s = {}", SIZES[k + 1], SIZES[k])
            }
            None => {
                "the descent to the clusters that are averaged at the largest size takes most of the work"
                    .into()
            }
        },
    );
    let seconds: Vec<f64> = (0..times.0.len()).map(|k| times.mean(k)).collect();
    let certain = times.certain();
    let steps: Vec<f64> = seconds.windows(2).map(|pair| (pair[1] / pair[0]).ln()).collect();
    let rises = steps.iter().position(|step| *step > certain);
    let fall = (seconds[0] / seconds[3]).ln();
    item.check_time(
        format!(
            "{name}: time falls with s: from the first to the last by over three standard errors, and nowhere does it rise by as much"
        ),
        format!("{} s, standard error {} % of each", list(&seconds, 2), fixed(100.0 * times.noise(), 1)),
        fall > certain && rises.is_none(),
        || match rises {
            Some(k) => format!("it rises from s = {} to s = {}", SIZES[k], SIZES[k + 1]),
            None => format!("it falls by {} standard errors", fixed(MIN_STANDARD_ERRORS * fall / certain, 1)),
        },
    );
}

/// Whether L2 rises, and later for larger objects.
fn judge_l2(item: &mut Item, measured: &Measured) {
    let name = measured.leaves.name();
    let columns: Vec<Vec<f64>> = (0..4).map(|k| measured.column(k, 0)).collect();
    let falls = |v: &[f64]| v.windows(2).any(|pair| pair[1] < pair[0]);
    let wrong: Vec<String> = (0..4)
        .filter(|&k| falls(&columns[k]) || columns[k][3] <= columns[k][0] + measured.noise)
        .map(|k| (k + 1).to_string())
        .collect();
    item.check(
        format!(
            "{name}: L2 never falls from size to size, and rises from the first to the last by more than the noise, in all groups"
        ),
        format!(
            "{} %, noise {} %",
            columns.iter().map(|column| list(column, 1)).collect::<Vec<_>>().join("; "),
            fixed(measured.noise, 1)
        ),
        wrong.is_empty(),
        || {
            format!(
                "not in group {}: errors of averaged clusters compensate each other, or as many are averaged at the smallest size as at the \
                 largest",
                wrong.join(" and ")
            )
        },
    );
    let onsets: Vec<f64> = columns.iter().map(|column| onset(column, measured.risen())).collect();
    let shown = |onset: &f64| match *onset {
        f64::NEG_INFINITY => format!("{} or less", SIZES[0]),
        f64::INFINITY => format!("more than {}", SIZES[3]),
        s => fixed(s, 2),
    };
    let at_first: Vec<String> = (1..)
        .zip(&onsets)
        .filter(|(_, s)| s.is_infinite() && **s < 0.0)
        .map(|(k, _): (usize, _)| k.to_string())
        .collect();
    let together = match at_first.len() {
        0 | 1 => String::new(),
        _ => format!(
            "; groups {} have risen at the smallest size already and are not told apart",
            at_first.join(" and ")
        ),
    };
    let early: Vec<String> = (1..4)
        .filter(|&k| onsets[k] <= onsets[k - 1] && onsets[k] != f64::NEG_INFINITY)
        .map(|k| format!("group {} before group {k}", k + 1))
        .collect();
    item.check(
        format!(
            "{name}: L2 rises later for larger objects: in the order of the groups, but for groups that have risen at the smallest size \
             already"
        ),
        format!(
            "above {} % at s = {}{together}",
            fixed(measured.risen(), 1),
            onsets.iter().map(shown).collect::<Vec<_>>().join(", ")
        ),
        early.is_empty() && onsets[3] > onsets[0],
        || match early.is_empty() {
            true => "all groups have risen at the smallest size".into(),
            false => format!("it rises in {}, or in neither", early.join(", ")),
        },
    );
}

/// Whether FBEM(s) is similar and low where clusters are averaged.
fn judge_fbem(item: &mut Item, measured: &Measured) {
    let name = measured.leaves.name();
    let averaged = measured.averaged();
    let by_error = |a: &&Place, b: &&Place| a.error.total_cmp(&b.error);
    let ends = averaged.iter().min_by(by_error).zip(averaged.iter().max_by(by_error));
    let l2 = measured.errors.iter().flatten().fold(0.0f64, |largest, cell| largest.max(cell[0]));
    let factor = satisfactory_spread();
    let similar = format!(
        "where clusters are averaged, FBEM(s) is of similar magnitude over groups and sizes: within a factor of {}, by which the images \
         differ that Table 1 counts as satisfactory",
        fixed(factor, 2)
    );
    let [satisfactory, not] = paper_parts().map(|part| fixed(100.0 * part, 0));
    let low = format!(
        "FBEM(s) remains low: the largest is at most {} % of the largest L2 (ours: between the {satisfactory} % that Table 1 counts as \
         satisfactory and the {not} % that it does not)",
        100.0 * SATISFACTORY
    );
    let Some((smallest, largest)) = ends else {
        for statement in [similar, low] {
            item.check(format!("{name}: {statement}"), "no L2 has risen", false, || {
                "nothing is averaged at any size".into()
            });
        }
        return;
    };
    let wide = |place: &Place| {
        let part = measured.wide[place.size][place.group];
        format!("{} % of the shadows of {} belong to features above that size", fixed(part, 0), place.name())
    };
    item.check(
        format!("{name}: {similar}"),
        format!(
            "{} % ({}) to {} % ({})",
            fixed(smallest.error, 1),
            smallest.name(),
            fixed(largest.error, 1),
            largest.name()
        ),
        largest.error <= factor * smallest.error,
        || format!("{}, {}", wide(largest), wide(smallest)),
    );
    let [before, after] = measured.light;
    item.check(
        format!("{name}: {low}"),
        format!("{} % and {} %", fixed(largest.error, 1), fixed(l2, 1)),
        largest.error <= SATISFACTORY * l2,
        || {
            format!(
                "averaging changes the mean light of the images from {} % to {} % at s = {}, and {}",
                fixed(before, 1),
                fixed(after, 1),
                SIZES[3],
                wide(largest)
            )
        },
    );
}

/// Whether work falls as much with groups that cover other fractions of the wall: coverages and factors.
pub fn judge_coverage(item: &mut Item, factors: &[(f64, f64)]) {
    let paper = paper_factor();
    let shown =
        |(part, factor): &(f64, f64)| format!("{} at {} %", fixed(*factor, 2), fixed(100.0 * part, 0));
    item.check(
        format!(
            "{}: work falls by the paper's factor, {}, with groups that hide other parts of their images than {} %, too",
            Leaves::Extinction.name(),
            fixed(paper, 2),
            fixed(100.0 * COVERAGE, 0)
        ),
        format!("by a factor of {}", factors.iter().map(shown).collect::<Vec<_>>().join(", ")),
        !factors.is_empty() && factors.iter().all(|(_, factor)| *factor >= paper),
        || "the factor depends on how much the cubes hide, which the paper does not give".into(),
    );
}

/// The size at which the error exceeds `risen`, interpolated; infinite with the sign of the side on which it lies outside the sizes.
fn onset(errors: &[f64], risen: f64) -> f64 {
    match errors.iter().position(|&v| v > risen) {
        Some(0) => f64::NEG_INFINITY,
        Some(k) => {
            let part = (risen - errors[k - 1]) / (errors[k] - errors[k - 1]);
            SIZES[k - 1] + part * (SIZES[k] - SIZES[k - 1])
        }
        None => f64::INFINITY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds that differ by a hundredth between repetitions.
    fn times(seconds: [f64; 4]) -> Repeated {
        Repeated(seconds.map(|s| [s, 1.01 * s]).to_vec())
    }

    /// Numbers like those of the paper: all checks hold.
    fn like_the_paper() -> Measured {
        let l2 = [
            [10.0, 9.0, 0.5, 0.5],
            [20.0, 18.0, 10.0, 0.5],
            [30.0, 25.0, 18.0, 0.5],
            [30.0, 28.0, 25.0, 12.0],
        ];
        let cell = |l2: f64| if l2 > 3.0 { [l2, 10.0] } else { [l2, 0.5] };
        Measured {
            leaves: Leaves::Extinction,
            visits: vec![75.0, 60.0, 55.0, 50.0],
            times: times([0.75, 0.6, 0.55, 0.5]),
            errors: l2.iter().map(|row| row.map(cell)).collect(),
            noise: 1.0,
            light: [70.0, 70.0],
            wide: vec![[10.0; 4]; 4],
        }
    }

    /// Numbers of the checks that do not hold.
    fn failing(measured: &Measured) -> Vec<usize> {
        let mut item = Item::default();
        judge(&mut item, measured);
        assert_eq!(item.checks.len(), 6);
        assert!(item.checks[1].timed);
        (0..6).filter(|&k| !item.checks[k].holds).collect()
    }

    #[test]
    fn each_check_fails_by_numbers_of_its_own() {
        let paper = like_the_paper();
        assert_eq!(failing(&paper), [0; 0]);
        let more_work = Measured { visits: vec![70.0, 60.0, 55.0, 50.0], ..paper.clone() };
        assert_eq!(failing(&more_work), [0]);
        for seconds in [[0.75, 0.6, 0.7, 0.5], [0.75, 0.75, 0.745, 0.74]] {
            assert_eq!(failing(&Measured { times: times(seconds), ..paper.clone() }), [1], "{seconds:?}");
        }
        let mut falls = paper.clone();
        falls.errors[2][1][0] = 17.9;
        assert_eq!(failing(&falls), [2]);
        let mut early = paper.clone();
        (early.errors[1][3], early.errors[2][3]) = ([12.0, 10.0], [12.0, 10.0]);
        assert_eq!(failing(&early), [3]);
        let mut uneven = paper.clone();
        uneven.errors[3][3][1] = 4.5;
        assert_eq!(failing(&uneven), [4]);
        let mut high = paper;
        high.errors.iter_mut().flatten().for_each(|cell| cell[1] *= 1.6);
        assert_eq!(failing(&high), [5]);
    }

    /// Where nothing is averaged nothing is shown.
    #[test]
    fn errors_of_zero_show_nothing() {
        let nothing = Measured { errors: vec![[[0.0; 2]; 4]; 4], ..like_the_paper() };
        assert_eq!(failing(&nothing), [2, 3, 4, 5]);
    }

    #[test]
    fn other_coverages_are_judged() {
        for (factors, holds) in
            [(vec![(0.2, 1.5), (0.4, 1.7)], true), (vec![(0.2, 1.4), (0.4, 1.7)], false), (vec![], false)]
        {
            let mut item = Item::default();
            judge_coverage(&mut item, &factors);
            assert_eq!(item.checks[0].holds, holds, "{factors:?}");
        }
    }
}
