//! The checks of Figures 7 and 8, of numbers alone.

use super::item::Item;
use super::{fixed, list};

/// Contrast of a shadow that counts as missing: the default threshold of shadows of the feature-based error.
const NO_SHADOW: f64 = 0.02;
/// By what average visibility is faster than surface visibility in the paper [SD95 sec 4.2].
const PAPER_GAIN: f64 = 4.0;

/// Contrasts of the shadows under the desks, as parts of the light beside them.
pub struct Contrasts {
    /// By rays.
    pub exact: f64,
    /// Of light straight on the floor: uniform grids, cells of the k-d tree, fitted boxes of the k-d tree, Goldsmith and Salmon.
    pub by: Vec<f64>,
    /// Of radiosity solutions: uniform grids, and fitted boxes of the k-d tree and of Goldsmith and Salmon, unless small.
    pub in_radiosity: Vec<f64>,
}

fn percentages(parts: &[f64]) -> String {
    list(&parts.iter().map(|part| 100.0 * part).collect::<Vec<_>>(), 1)
}

/// Whether radiosity solutions with surface visibility show the shadows alike.
pub fn judge_quality(item: &mut Item, contrasts: &Contrasts) {
    let Contrasts { exact, in_radiosity, .. } = contrasts;
    let measured =
        || format!("contrast {} % of {} % by rays", percentages(in_radiosity), percentages(&[*exact]));
    item.check(
        "in radiosity solutions, whose links may end at clusters, the shadows under the desks are comparable with all hierarchies: their \
         contrasts differ by less than the threshold of a shadow, 2 %",
        measured(),
        !in_radiosity.is_empty() && in_radiosity.iter().all(|c| (c - in_radiosity[0]).abs() < NO_SHADOW),
    );
    item.check(
        "and nearer to those by rays than to none: more than half of their contrast",
        measured(),
        !in_radiosity.is_empty() && in_radiosity.iter().all(|c| *c > 0.5 * exact),
    );
}

/// Visits per segment, and seconds.
type Cost = (f64, f64);

/// Whether surface visibility is faster with the new hierarchy than with the k-d tree.
pub fn judge_surface_speed(item: &mut Item, new: Cost, kd: Cost) {
    item.check(
        "with surface visibility the new hierarchy needs fewer visits than the k-d tree",
        format!("{} and {} a segment", fixed(new.0, 1), fixed(kd.0, 1)),
        new.0 < kd.0,
    );
    item.check_time(
        "the new hierarchy is faster than the k-d tree",
        format!("{} s and {} s", fixed(new.1, 2), fixed(kd.1, 2)),
        new.1 < kd.1,
    );
}

/// Whether average visibility loses shadows with the k-d tree and keeps them with the new hierarchy.
pub fn judge_shadows(item: &mut Item, contrasts: &Contrasts) {
    let Contrasts { exact, by, in_radiosity } = contrasts;
    let [new, cells] = [by[0], by[1]];
    let check = item.check(
        format!(
            "shadows are completely missing from under the desks with the k-d tree: their contrast is below the threshold of a shadow, {} %",
            fixed(100.0 * NO_SHADOW, 0)
        ),
        format!("contrast {} % with cells", percentages(&[cells])),
        cells < NO_SHADOW,
    );
    check.if_not(|| {
        format!(
            "the cells keep {} % of the contrast by rays: extinction of what they hold is spread over more air, but not lost",
            fixed(100.0 * cells / exact, 0)
        )
    });
    let kept = 1.0 - (-0.5f64).exp();
    let measured =
        |found: &[f64]| format!("contrast {} % of {} % by rays", percentages(found), percentages(&[*exact]));
    let keeps = |found: &[f64]| !found.is_empty() && found.iter().all(|c| *c >= kept * exact);
    item.check(
        format!(
            "the k-d tree is not suited to the extinction model: it keeps less of their contrast with the floor around than 1 − e^(−1/2) = {} %, \
             which extinction keeps of a desk top in a cluster of its own",
            fixed(100.0 * kept, 0)
        ),
        measured(&[cells]),
        cells < kept * exact,
    );
    item.check(
        "the new hierarchy represents the shadows: it keeps at least that part of their contrast",
        measured(&[new]),
        keeps(&[new]),
    );
    item.check(
        "what the k-d tree lacks is boxes fitted to their contents: with them it and Goldsmith and Salmon's construction keep that part",
        measured(&by[2..]),
        keeps(&by[2..]),
    );
    item.check(
        "radiosity solutions with average visibility keep it with all fitted boxes, too",
        measured(in_radiosity),
        keeps(in_radiosity),
    );
}

/// Times of average visibility with the new hierarchy and with cells of the k-d tree, and of surface visibility with the new hierarchy.
pub fn judge_average_speed(item: &mut Item, [new, cells, surface]: [Cost; 3]) {
    let check = item.check_time(
        "with average visibility the new hierarchy is slower than the k-d tree (section 4.2)",
        format!("{} s and {} s", fixed(new.1, 2), fixed(cells.1, 2)),
        new.1 > cells.1,
    );
    check.if_not(|| {
        format!(
            "a segment visits {} clusters of the new hierarchy on average, and {} cells of the k-d tree",
            fixed(new.0, 1),
            fixed(cells.0, 1)
        )
    });
    let check = item.check_time(
        format!(
            "average visibility is faster than surface visibility with the new hierarchy, by at least the paper's factor of {PAPER_GAIN}"
        ),
        format!("{} s and {} s, {} times", fixed(new.1, 2), fixed(surface.1, 2), fixed(surface.1 / new.1, 2)),
        PAPER_GAIN * new.1 <= surface.1,
    );
    check.if_not(|| {
        format!(
            "a segment visits {} clusters on average, and {} clusters and triangles with surface visibility, which ends at the first hit",
            fixed(new.0, 1),
            fixed(surface.0, 1)
        )
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn failing(judge: impl Fn(&mut Item)) -> Vec<usize> {
        let mut item = Item::default();
        judge(&mut item);
        (0..item.checks.len()).filter(|&k| !item.checks[k].holds).collect()
    }

    #[test]
    fn solutions_are_comparable_or_not() {
        let of = |in_radiosity: Vec<f64>| Contrasts { exact: 0.6, by: Vec::new(), in_radiosity };
        for (contrasts, expected) in [
            (vec![0.5, 0.51, 0.49], vec![]),
            (vec![0.5, 0.53], vec![0]),
            (vec![0.3, 0.29], vec![1]),
            (vec![], vec![0, 1]),
        ] {
            assert_eq!(
                failing(|item| judge_quality(item, &of(contrasts.clone()))),
                expected,
                "{contrasts:?}"
            );
        }
    }

    #[test]
    fn shadows_are_kept_or_lost() {
        let of = |by: [f64; 4], in_radiosity: f64| Contrasts {
            exact: 1.0,
            by: by.to_vec(),
            in_radiosity: vec![in_radiosity; 3],
        };
        for (contrasts, expected) in [
            (of([0.5, 0.0, 0.5, 0.5], 0.5), vec![]),
            (of([0.5, 0.1, 0.5, 0.5], 0.5), vec![0]),
            (of([0.5, 0.5, 0.5, 0.5], 0.5), vec![0, 1]),
            (of([0.3, 0.0, 0.5, 0.5], 0.5), vec![2]),
            (of([0.5, 0.0, 0.3, 0.5], 0.5), vec![3]),
            (of([0.5, 0.0, 0.5, 0.5], 0.3), vec![4]),
        ] {
            assert_eq!(failing(|item| judge_shadows(item, &contrasts)), expected, "{:?}", contrasts.by);
        }
    }

    #[test]
    fn times_are_judged() {
        let (one, two, nine) = ((10.0, 1.0), (20.0, 2.0), (90.0, 9.0));
        assert_eq!(failing(|item| judge_surface_speed(item, one, two)), [0; 0]);
        assert_eq!(failing(|item| judge_surface_speed(item, two, one)), [0, 1]);
        assert_eq!(failing(|item| judge_average_speed(item, [two, one, nine])), [0; 0]);
        assert_eq!(failing(|item| judge_average_speed(item, [one, two, two])), [0, 1]);
    }
}
