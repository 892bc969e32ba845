//! Erosion and expansion of features: Figures 2, 3 and 4 of the paper.

use super::groups::{EDGES, TEXEL, shadow_mask, shadow_widths};
use super::item::{FEATURES, Item, Panel};
use super::table::{Table, count, number};
use super::{Context, counts_of, fixed, list};
use crate::Result;
use crate::metrics::Morphology;
use crate::raster::{BitImage, Opener, expand};

/// Numbers of operations in the pictures.
const STEPS: [usize; 4] = [2, 4, 8, 12];
/// Feature sizes of Figure 4, texels.
const MASKS: [f64; 3] = [12.0, 18.0, 24.0];

fn opener(image: &BitImage) -> Opener {
    Opener::new(image.clone(), Morphology::Paper8)
}

/// Figure 2: erosions and expansions of the shadows of the second largest cubes.
pub fn figure_2(context: &Context) -> Result<Item> {
    let image = shadow_mask(&context.groups()?.shadows[2], 0.0)?;
    let mut item = Item {
        here: "The shadow of the third group of Figure 1; eight neighbours, which the paper's in-place operators amount to."
            .into(),
        ..Item::default()
    };
    let eroded: Vec<BitImage> = STEPS.iter().map(|&n| opener(&image).core(2.0 * n as f64)).collect();
    let expanded: Vec<BitImage> = STEPS.iter().map(|&n| expand(&image, n, Morphology::Paper8)).collect();
    for (name, images) in [("Erosions", &eroded), ("Expansions", &expanded)] {
        let mut panels = vec![Panel::binary(&image, "reference")];
        panels.extend(STEPS.iter().zip(images).map(|(n, image)| Panel::binary(image, format!("n = {n}"))));
        item.row(format!("{name} ({FEATURES})"), panels);
    }
    let counts = |images: &[BitImage]| images.iter().map(BitImage::count).collect::<Vec<_>>();
    let (less, more) = (counts(&eroded), counts(&expanded));
    item.check(
        "each erosion removes features, until nothing is left; each expansion adds to them",
        format!("texels of features: {}; {}", counts_of(&less), counts_of(&more)),
        less.windows(2).all(|c| c[1] < c[0] || c[0] == 0)
            && more.windows(2).all(|c| c[1] > c[0] || c[0] == image.width() * image.height()),
    );
    // Erosion of the background is expansion of the object, on the inside of a free border.
    let size = opener(&image).largest() as usize;
    let last = opener(&image).core(size as f64 - 2.0);
    item.check(
        "an object of diameter 2d disappears after d erosions",
        format!(
            "the largest has {size} texels; after {} erosions {} texels are left, after {} none",
            size / 2 - 1,
            last.count(),
            size / 2
        ),
        last.count() > 0 && opener(&image).core(size as f64).is_empty(),
    );
    Ok(item)
}

/// Figure 3: erosions followed by as many expansions.
pub fn figure_3(context: &Context) -> Result<Item> {
    let image = shadow_mask(&context.groups()?.shadows[2], 0.0)?;
    let mut item = Item { here: "The shadow of Figure 2.".into(), ..Item::default() };
    let opened: Vec<BitImage> = STEPS.iter().map(|&n| opener(&image).open(2.0 * n as f64)).collect();
    let mut panels = vec![Panel::binary(&image, "reference")];
    panels.extend(STEPS.iter().zip(&opened).map(|(n, image)| Panel::binary(image, format!("n = {n}"))));
    item.row(format!("n erosions, then n expansions ({FEATURES})"), panels);
    let squares = STEPS.iter().map(|&n| squares_within(&image, n));
    item.check(
        "what is left consists of regions wider than 2n: of all squares of 2n + 1 texels that fit into the reference",
        counts_of(&opened.iter().map(BitImage::count).collect::<Vec<_>>()) + " texels",
        squares.zip(&opened).all(|(squares, left)| squares == *left),
    );
    let within = opened.iter().all(|left| {
        let mut beyond = left.clone();
        beyond.subtract(&image);
        beyond.is_empty()
    });
    item.check("nothing is added to the reference", "", within);
    let left: Vec<usize> = opened.iter().map(BitImage::count).collect();
    item.check(
        "larger n leave less, and the largest less than the smallest",
        format!("{} of {} texels", counts_of(&left), image.count()),
        left.windows(2).all(|c| c[1] <= c[0]) && left[left.len() - 1] < left[0],
    );
    Ok(item)
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
    let mut item = Item { here: "The images of Figure 1.".into(), ..Item::default() };
    let mut table = Table::new(
        "Texels of the masks",
        &["feature size, texels", "group 1", "group 2", "group 3", "group 4"],
    );
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
    let kept = |i: usize, k: usize| parts[i][k] / parts[0][k];
    item.check(
        "each mask keeps more of larger cubes' shadows",
        (1..4)
            .map(|i| list(&std::array::from_fn::<_, 4, _>(|k| 100.0 * kept(i, k)), 0))
            .collect::<Vec<_>>()
            .join("; ")
            + " %",
        (1..4).all(|i| (1..4).all(|k| kept(i, k) >= kept(i, k - 1))),
    );
    let widths = EDGES.map(|edge| shadow_widths(edge).map(|width| width / TEXEL));
    let expected = |i: usize, k: usize| match widths[k] {
        [umbra, _] if umbra > MASKS[i - 1] => kept(i, k) > 0.5,
        [_, penumbra] if penumbra < MASKS[i - 1] => kept(i, k) < 0.5,
        _ => true,
    };
    item.check(
        "a mask keeps most of a group's shadows if those of single cubes, penumbra included, are wider than its size, and less than half of \
         them if narrower",
        format!(
            "widths by the formula of Figure 5: {} texels",
            widths.map(|[umbra, penumbra]| format!("{} to {}", fixed(umbra, 0), fixed(penumbra, 0))).join(", ")
        ),
        (1..4).all(|i| (0..4).all(|k| expected(i, k))),
    );
    Ok(item)
}
