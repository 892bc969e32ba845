//! The checks of Figures 7 and 8, of numbers alone.

use super::item::Item;
use super::office_light::InRadiosity;
use super::{fixed, list};

/// Contrast of a shadow that counts as missing: the default threshold of shadows of the feature-based error.
const MAX_MISSING_CONTRAST: f64 = 0.02;
/// Speed-up of average over surface visibility in the paper [SD95 sec 4.2].
const PAPER_GAIN: f64 = 4.0;

/// Contrasts of the shadows under the desks, as fractions of the light beside them.
pub struct Contrasts {
    /// Contrast of direct light on the floor, by rays.
    pub exact: f64,
    /// Contrasts of direct light on the floor: uniform grids, cells of the k-d tree, fitted boxes of the k-d tree, Goldsmith and Salmon.
    pub by: Vec<f64>,
    pub in_radiosity: InRadiosity,
}

/// Mean cost of a segment, and the cost of all segments.
#[derive(Clone, Copy)]
pub struct Cost {
    /// Visits per segment.
    pub visits: f64,
    pub seconds: f64,
    /// Triangles of the leaf that holds most of them.
    pub largest_leaf: usize,
}

fn percentages(parts: &[f64]) -> String {
    list(&parts.iter().map(|part| 100.0 * part).collect::<Vec<_>>(), 1)
}

/// Whether radiosity solutions with surface visibility show the shadows alike, and as rays do.
pub fn judge_quality(item: &mut Item, in_radiosity: &InRadiosity) {
    let (by, by_rays) = (&in_radiosity.by, in_radiosity.by_rays.unwrap_or(f64::NAN));
    let threshold = fixed(100.0 * MAX_MISSING_CONTRAST, 0);
    let apart = |other: f64| by.iter().map(|c| (c - other).abs()).fold(0.0, f64::max);
    let first = by.first().copied().unwrap_or(f64::NAN);
    item.check(
        format!(
            "in radiosity solutions, whose links may end at clusters, the shadows under the desks are comparable with all hierarchies: their \
             contrasts differ by less than the threshold of a shadow, {threshold} %"
        ),
        format!("contrast {} %", percentages(by)),
        by.len() > 1 && apart(first) < MAX_MISSING_CONTRAST,
        || format!("they differ by up to {} percentage points", fixed(100.0 * apart(first), 1)),
    );
    item.check(
        format!("their contrasts are those of radiosity by rays, to the same threshold, {threshold} %"),
        format!("contrast {} %, by rays {} %", percentages(by), percentages(&[by_rays])),
        by.len() > 1 && in_radiosity.by_rays.is_some() && apart(by_rays) < MAX_MISSING_CONTRAST,
        || {
            format!(
                "they differ by up to {} percentage points: links with a high tolerance end at clusters and elements that are as large as the \
                 shadows",
                fixed(100.0 * apart(by_rays), 1)
            )
        },
    );
}

/// Whether surface visibility is faster with the new hierarchy than with the k-d trees: cells, and fitted boxes.
pub fn judge_surface_speed(item: &mut Item, new: Cost, kd: [Cost; 2]) {
    for (name, kd) in ["k-d tree with cells", "k-d tree with fitted boxes"].into_iter().zip(kd) {
        let reason = || {
            format!(
                "leaves of this k-d tree hold up to {} triangles, those of the new hierarchy up to {}",
                kd.largest_leaf, new.largest_leaf
            )
        };
        item.check(
            format!("with surface visibility the new hierarchy needs fewer visits than the {name}"),
            format!("{} and {} a segment", fixed(new.visits, 1), fixed(kd.visits, 1)),
            new.visits < kd.visits,
            reason,
        );
    }
    let cells = kd[0];
    item.check_time(
        "the new hierarchy is faster than the k-d tree with cells, which is that of the paper",
        format!("{} s and {} s", fixed(new.seconds, 2), fixed(cells.seconds, 2)),
        new.seconds < cells.seconds,
        || format!("a segment needs {} and {} visits", fixed(new.visits, 1), fixed(cells.visits, 1)),
    );
}

/// Whether average visibility loses shadows with the k-d tree and keeps them with the new hierarchy.
pub fn judge_shadows(item: &mut Item, contrasts: &Contrasts) {
    let Contrasts { exact, by, in_radiosity } = contrasts;
    let [new, cells] = [by[0], by[1]];
    let threshold = fixed(100.0 * MAX_MISSING_CONTRAST, 0);
    item.check(
        format!(
            "shadows are completely missing from under the desks with the k-d tree: their contrast is below the threshold of a shadow, \
             {threshold} %"
        ),
        format!("contrast {} % with cells", percentages(&[cells])),
        cells < MAX_MISSING_CONTRAST,
        || {
            format!(
                "the cells keep {} % of the contrast by rays: extinction of what they hold is spread over more air, but not lost",
                fixed(100.0 * cells / exact, 0)
            )
        },
    );
    let kept = 1.0 - (-0.5f64).exp();
    let measured =
        |found: &[f64]| format!("contrast {} % of {} % by rays", percentages(found), percentages(&[*exact]));
    let keeps = |found: &[f64]| !found.is_empty() && found.iter().all(|c| *c >= kept * exact);
    let part = |found: &[f64]| list(&found.iter().map(|c| 100.0 * c / exact).collect::<Vec<_>>(), 0);
    item.check(
        format!(
            "the k-d tree is not suited to the extinction model: it keeps less of their contrast with the floor around than 1 − e^(−1/2) = {} %, \
             which extinction keeps of a desk top in a cluster of its own",
            fixed(100.0 * kept, 0)
        ),
        measured(&[cells]),
        cells < kept * exact,
        || format!("it keeps {} %: desk tops are in cells that are hardly larger", part(&[cells])),
    );
    item.check(
        "the new hierarchy represents the shadows: it keeps at least that part of their contrast",
        measured(&[new]),
        keeps(&[new]),
        || format!("it keeps {} %: desk tops share clusters with other things", part(&[new])),
    );
    item.check(
        "boxes fitted to their contents mend that: the k-d tree and Goldsmith and Salmon's construction with such boxes keep at least that part",
        measured(&by[2..]),
        keeps(&by[2..]),
        || format!("they keep {} %: desk tops share boxes with other things", part(&by[2..])),
    );
    let by = &in_radiosity.by;
    item.check(
        format!(
            "radiosity solutions with average visibility show the shadows with all fitted boxes: their contrast is above the threshold of a \
             shadow, {threshold} %"
        ),
        format!("contrast {} %", percentages(by)),
        !by.is_empty() && by.iter().all(|c| *c >= MAX_MISSING_CONTRAST),
        || "links end at clusters in which the desks' shadows are averaged".into(),
    );
}

/// Costs of average visibility with the new hierarchy and with cells of the k-d tree, and of surface visibility with the new hierarchy.
pub fn judge_average_speed(item: &mut Item, [new, cells, surface]: [Cost; 3]) {
    item.check_time(
        "with average visibility the new hierarchy is slower than the k-d tree (section 4.2)",
        format!("{} s and {} s", fixed(new.seconds, 2), fixed(cells.seconds, 2)),
        new.seconds > cells.seconds,
        || {
            format!(
                "a segment visits {} clusters of the new hierarchy on average, and {} cells of the k-d tree",
                fixed(new.visits, 1),
                fixed(cells.visits, 1)
            )
        },
    );
    let gain = surface.seconds / new.seconds;
    item.check_time(
        format!(
            "average visibility is faster than surface visibility with the new hierarchy, by at least the paper's factor of {PAPER_GAIN}"
        ),
        format!("{} s and {} s, {} times", fixed(new.seconds, 2), fixed(surface.seconds, 2), fixed(gain, 2)),
        gain >= PAPER_GAIN,
        || {
            format!(
                "a segment visits {} clusters on average, and {} clusters and triangles with surface visibility, which ends at the first hit",
                fixed(new.visits, 1),
                fixed(surface.visits, 1)
            )
        },
    );
}

#[cfg(test)]
mod tests {
    use super::super::item::failing_checks;
    use super::*;

    #[test]
    fn solutions_are_comparable_or_not() {
        for (by, expected) in [
            (vec![0.5, 0.51, 0.49], vec![]),
            (vec![0.51, 0.535], vec![0, 1]),
            (vec![0.49, 0.485, 0.475], vec![1]),
            (vec![0.5], vec![0, 1]),
        ] {
            let found = InRadiosity { by: by.clone(), by_rays: Some(0.5) };
            assert_eq!(failing_checks(|item| judge_quality(item, &found)), expected, "{by:?}");
        }
    }

    #[test]
    fn shadows_are_kept_or_lost() {
        let of = |by: [f64; 4], in_radiosity: f64| Contrasts {
            exact: 1.0,
            by: by.to_vec(),
            in_radiosity: InRadiosity { by: vec![in_radiosity; 3], by_rays: Some(0.5) },
        };
        for (contrasts, expected) in [
            (of([0.5, 0.0, 0.5, 0.5], 0.5), vec![]),
            (of([0.5, 0.1, 0.5, 0.5], 0.5), vec![0]),
            (of([0.5, 0.5, 0.5, 0.5], 0.5), vec![0, 1]),
            (of([0.3, 0.0, 0.5, 0.5], 0.5), vec![2]),
            (of([0.5, 0.0, 0.3, 0.5], 0.5), vec![3]),
            (of([0.5, 0.0, 0.5, 0.5], 0.01), vec![4]),
        ] {
            assert_eq!(
                failing_checks(|item| judge_shadows(item, &contrasts)),
                expected,
                "{:?}",
                contrasts.by
            );
        }
    }

    #[test]
    fn times_are_judged() {
        let of = |visits: f64, seconds: f64| Cost { visits, seconds, largest_leaf: 16 };
        let (one, two, nine) = (of(10.0, 1.0), of(20.0, 2.0), of(90.0, 9.0));
        assert_eq!(failing_checks(|item| judge_surface_speed(item, one, [two, nine])), [0; 0]);
        assert_eq!(failing_checks(|item| judge_surface_speed(item, two, [nine, one])), [1]);
        assert_eq!(failing_checks(|item| judge_surface_speed(item, two, [one, nine])), [0, 2]);
        assert_eq!(failing_checks(|item| judge_average_speed(item, [two, one, nine])), [0; 0]);
        assert_eq!(failing_checks(|item| judge_average_speed(item, [one, two, two])), [0, 1]);
    }
}
