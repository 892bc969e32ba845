//! Erosion and expansion of features: Figures 2, 3 and 4 of the paper.

use super::cubes::{EDGES, TEXEL, shadow_widths};
use super::groups::shadow_mask;
use super::item::{FEATURES, Item, Panel, Table, count, number};
use super::{Context, counts_of, fixed, list};
use mrvis::Result;
use mrvis::internals::raster::{BitImage, Opener, expand};
use mrvis::metrics::Morphology;

/// Numbers of operations in the pictures.
const STEPS: [usize; 4] = [2, 4, 8, 12];
/// Feature sizes of Figure 4, texels.
const MASKS: [f64; 3] = [12.0, 18.0, 24.0];
/// Numbers d of erosions of squares of 2d and 2d + 1 texels.
const SQUARES: [usize; 4] = [1, 3, 8, 20];

fn opener(image: &BitImage) -> Opener {
    Opener::new(image.clone(), Morphology::Paper8)
}

/// Figure 2: erosions and expansions of the shadows of the second largest cubes.
pub fn figure_2(context: &Context) -> Result<Item> {
    let image = shadow_mask(&context.groups()?.shadows[2], 0.0)?;
    let mut item = Item::of(
        "The shadow of the third group of Figure 1; eight neighbours, which the paper's in-place operators amount to.",
    );
    let eroded: Vec<BitImage> = STEPS.iter().map(|&n| opener(&image).core(2.0 * n as f64)).collect();
    let expanded: Vec<BitImage> = STEPS.iter().map(|&n| expand(&image, n, Morphology::Paper8)).collect();
    for (name, images) in [("Erosions", &eroded), ("Expansions", &expanded)] {
        let mut panels = vec![Panel::binary(&image, "reference")];
        panels.extend(STEPS.iter().zip(images).map(|(n, image)| Panel::binary(image, format!("n = {n}"))));
        item.row(format!("{name} ({FEATURES})"), panels);
    }
    let counts = |images: &[BitImage]| images.iter().map(BitImage::count).collect::<Vec<_>>();
    let texels = [image.count(), image.width() * image.height()];
    judge_steps(&mut item, texels, &counts(&eroded), &counts(&expanded));
    judge_squares(&mut item, &SQUARES.map(|d| [left_of_square(2 * d, d - 1), left_of_square(2 * d, d)]));
    judge_odd_squares(&mut item, &SQUARES.map(|d| left_of_square(2 * d + 1, d)));
    Ok(item)
}

/// Texels that `n` erosions leave of a square of this side.
fn left_of_square(side: usize, n: usize) -> usize {
    let mut square = BitImage::new(side + 4, side + 4);
    (2..side + 2).for_each(|y| square.set_span(y, 2, side + 2));
    opener(&square).core(2.0 * n as f64).count()
}

/// Texels of features and of the image, and of features after growing numbers of erosions and of expansions.
fn judge_steps(item: &mut Item, [first, all]: [usize; 2], less: &[usize], more: &[usize]) {
    let eroded: Vec<usize> = [first].iter().chain(less).copied().collect();
    let expanded: Vec<usize> = [first].iter().chain(more).copied().collect();
    item.check(
        "each number of erosions leaves fewer texels of features than a smaller number, as long as any are left; each number of expansions \
         gives more, as long as any are missing",
        format!("{first} texels; {}; {}", counts_of(less), counts_of(more)),
        eroded.windows(2).all(|c| c[1] < c[0] || c[0] == 0)
            && expanded.windows(2).all(|c| c[1] > c[0] || c[0] == all),
        || "an operation leaves features as they are".into(),
    );
}

/// Texels that are left of squares of 2d texels by d − 1 and by d erosions.
fn judge_squares(item: &mut Item, left: &[[usize; 2]]) {
    let shown: Vec<String> = left.iter().map(|[before, after]| format!("{before} and {after}")).collect();
    item.check(
        format!(
            "an object of diameter 2d disappears after d erosions, and not before: squares of {} texels",
            counts_of(&SQUARES.map(|d| 2 * d))
        ),
        format!("after d − 1 and after d erosions {} texels are left", shown.join(", ")),
        left.iter().all(|[before, after]| *before > 0 && *after == 0),
        || "erosion takes more or fewer than one texel off each side".into(),
    );
}

/// Texels that are left of squares of 2d + 1 texels by d erosions.
fn judge_odd_squares(item: &mut Item, left: &[usize]) {
    item.check(
        format!(
            "of an object of diameter 2d + 1 one texel is left after d erosions: squares of {} texels",
            counts_of(&SQUARES.map(|d| 2 * d + 1))
        ),
        format!("{} texels", counts_of(left)),
        left.iter().all(|left| *left == 1),
        || "erosion takes more or fewer than one texel off each side".into(),
    );
}

/// Figure 3: erosions followed by as many expansions.
pub fn figure_3(context: &Context) -> Result<Item> {
    let image = shadow_mask(&context.groups()?.shadows[2], 0.0)?;
    let mut item = Item::of("The shadow of Figure 2.");
    let opened: Vec<BitImage> = STEPS.iter().map(|&n| opener(&image).open(2.0 * n as f64)).collect();
    let mut panels = vec![Panel::binary(&image, "reference")];
    panels.extend(STEPS.iter().zip(&opened).map(|(n, image)| Panel::binary(image, format!("n = {n}"))));
    item.row(format!("n erosions, then n expansions ({FEATURES})"), panels);
    judge_opened(&mut item, &image, &opened);
    Ok(item)
}

/// What n erosions and n expansions leave of an image, by the numbers of [`STEPS`].
fn judge_opened(item: &mut Item, image: &BitImage, opened: &[BitImage]) {
    let differing: Vec<String> = STEPS
        .iter()
        .zip(opened)
        .filter(|(n, left)| squares_within(image, **n) != **left)
        .map(|(n, _)| n.to_string())
        .collect();
    item.check(
        "what is left consists of regions wider than 2n: of all squares of 2n + 1 texels that fit into the reference",
        counts_of(&opened.iter().map(BitImage::count).collect::<Vec<_>>()) + " texels",
        differing.is_empty(),
        || format!("other texels are left by n = {}", differing.join(", ")),
    );
    let beyond = |left: &BitImage| {
        let mut beyond = left.clone();
        beyond.subtract(image);
        beyond.count()
    };
    let added: Vec<usize> = opened.iter().map(beyond).collect();
    item.check(
        "nothing is added to the reference",
        format!("{} texels", counts_of(&added)),
        added.iter().all(|n| *n == 0),
        || "expansion reaches beyond what erosion took".into(),
    );
    let left: Vec<usize> = opened.iter().map(BitImage::count).collect();
    item.check(
        "larger n leave less, and the largest less than the smallest",
        format!("{} of {} texels", counts_of(&left), image.count()),
        left.windows(2).all(|c| c[1] <= c[0]) && left.last() < left.first(),
        || "all regions of the reference are wider than the largest n, or texels come back".into(),
    );
}

/// The union of all squares of 2n + 1 texels that fit into the object, by their definition.
fn squares_within(image: &BitImage, n: usize) -> BitImage {
    let mut union = BitImage::new(image.width(), image.height());
    let side = 2 * n + 1;
    for top in 0..(image.height() + 1).saturating_sub(side) {
        for left in 0..(image.width() + 1).saturating_sub(side) {
            if (top..top + side).all(|y| (left..left + side).all(|x| image.get(x, y))) {
                (top..top + side).for_each(|y| union.set_span(y, left, left + side));
            }
        }
    }
    union
}

/// Figure 4: feature masks of the four groups.
pub fn figure_4(context: &Context) -> Result<Item> {
    let groups = context.groups()?;
    let mut item = Item::of("The images of Figure 1.");
    let mut table =
        Table::new("Texels of the masks", "feature size, texels | group 1 | group 2 | group 3 | group 4");
    let mut parts: Vec<[f64; 4]> = Vec::new();
    for size in [0.0].into_iter().chain(MASKS) {
        let masks =
            groups.shadows.iter().map(|image| shadow_mask(image, size)).collect::<Result<Vec<_>>>()?;
        let name = if size == 0.0 { "Original mask".into() } else { format!("Feature size {size}") };
        let panels =
            masks.iter().enumerate().map(|(k, mask)| Panel::binary(mask, format!("group {}", k + 1)));
        item.row(format!("{name} ({FEATURES})"), panels.collect());
        table.push([number(size, 0)].into_iter().chain(masks.iter().map(|mask| count(mask.count()))));
        parts.push(std::array::from_fn(|k| masks[k].count() as f64));
    }
    item.tables.push(table);
    let kept = [1, 2, 3].map(|i| std::array::from_fn(|k| parts[i][k] / parts[0][k]));
    judge_masks(&mut item, &kept);
    Ok(item)
}

/// By mask, the fractions of the shadows of the groups that it keeps.
fn judge_masks(item: &mut Item, kept: &[[f64; 4]; 3]) {
    let percentages = |row: &[f64; 4]| list(&row.map(|part| 100.0 * part), 0);
    item.check(
        "each mask keeps more of larger cubes' shadows",
        kept.iter().map(percentages).collect::<Vec<_>>().join("; ") + " %",
        kept.iter().all(|row| row.windows(2).all(|pair| pair[1] >= pair[0])),
        || "shadows of smaller cubes join into wider ones".into(),
    );
    let widths = EDGES.map(|edge| shadow_widths(edge).map(|width| width / TEXEL));
    let is_expected = |i: usize, k: usize| match widths[k] {
        [umbra, _] if umbra > MASKS[i] => kept[i][k] > 0.5,
        [_, penumbra] if penumbra < MASKS[i] => kept[i][k] < 0.5,
        _ => true,
    };
    let wrong: Vec<String> = (0..3)
        .flat_map(|i| (0..4).map(move |k| (i, k)))
        .filter(|&(i, k)| !is_expected(i, k))
        .map(|(i, k)| format!("group {} at size {}", k + 1, MASKS[i]))
        .collect();
    item.check(
        "a mask keeps most of a group's shadows if those of single cubes, penumbra included, are wider than its size, and less than half of \
         them if narrower",
        format!(
            "widths by the formula of Figure 5: {} texels",
            widths.map(|[umbra, penumbra]| format!("{} to {}", fixed(umbra, 0), fixed(penumbra, 0))).join(", ")
        ),
        wrong.is_empty(),
        || format!("{}: shadows of several cubes join, or hide parts of one another", wrong.join(", ")),
    );
}

#[cfg(test)]
mod tests {
    use super::super::item::failing_checks;
    use super::*;

    #[test]
    fn erosions_that_leave_too_much_or_too_little_are_found() {
        let steps =
            |less: &[usize], more: &[usize]| failing_checks(|item| judge_steps(item, [50, 100], less, more));
        assert_eq!(steps(&[40, 10, 0, 0], &[60, 90, 100, 100]), [0; 0]);
        assert_eq!(steps(&[40, 40, 0, 0], &[60, 90, 100, 100]), [0]);
        assert_eq!(steps(&[40, 10, 0, 0], &[50, 90, 100, 100]), [0]);
        for (left, expected) in [([4, 0], vec![]), ([0, 0], vec![0]), ([4, 1], vec![0])] {
            assert_eq!(failing_checks(|item| judge_squares(item, &[left])), expected);
        }
        assert_eq!(failing_checks(|item| judge_odd_squares(item, &[1, 1])), [0; 0]);
        assert_eq!(failing_checks(|item| judge_odd_squares(item, &[1, 9])), [0]);
    }

    #[test]
    fn regions_that_are_not_opened_are_found() {
        let square = |from: usize, to: usize| {
            BitImage::from_fn(64, 64, |x, y| (from..to).contains(&x.min(y)) && x.max(y) < to)
        };
        let image = square(10, 30);
        let opened = STEPS.map(|n| opener(&image).open(2.0 * n as f64));
        let with = |k: usize, left: BitImage| {
            let mut opened = opened.clone();
            opened[k] = left;
            failing_checks(|item| judge_opened(item, &image, &opened))
        };
        assert_eq!(with(0, opened[0].clone()), [0; 0]);
        assert_eq!(with(3, square(12, 28)), [0]);
        assert_eq!(with(0, square(9, 31)), [0, 1]);
        assert_eq!(with(3, image.clone()), [0, 2]);
    }

    #[test]
    fn masks_of_other_sizes_are_found() {
        let kept = [[0.7, 0.9, 0.95, 1.0], [0.2, 0.4, 0.9, 1.0], [0.0, 0.0, 0.3, 1.0]];
        let with = |i: usize, k: usize, part: f64| {
            let mut kept = kept;
            kept[i][k] = part;
            failing_checks(|item| judge_masks(item, &kept))
        };
        assert_eq!(with(0, 0, 0.7), [0; 0]);
        assert_eq!(with(0, 1, 0.6), [0]);
        assert_eq!(with(2, 2, 0.6), [1]);
    }
}
