//! Four groups of cubes: Figure 1, Appendix A and Table 1 of the paper.

use super::blocks::Blocks;
use super::item::{Item, Panel, VISIBLE};
use super::shadow::{Wall, mean, meshed};
use super::table::{Table, count, number};
use super::{Context, fixed, list};
use crate::Result;
use crate::metrics::{FbemOptions, FeatureOptions, FeatureSet, Features, Image, Morphology, norms, spectrum};
use crate::model::{Detail, Model, PrepareOptions};
use crate::raster::BitImage;
use crate::scene::Scene;
use glam::DVec3;

/// Feature sizes of Table 1, texels.
pub const SIZES: [f64; 5] = [5.0, 16.0, 24.0, 30.0, 40.0];
/// Table 1 of the paper: for each size the errors of the groups, smallest cubes first.
pub const TABLE_1: [[f64; 4]; 5] = [
    [14.76, 16.34, 17.25, 17.31],
    [9.37, 12.24, 15.76, 15.80],
    [4.78, 6.50, 9.06, 14.74],
    [4.23, 3.16, 6.90, 13.37],
    [3.65, 2.33, 3.35, 6.94],
];
/// Texels along an image.
const COLUMNS: usize = 176;
/// Side of a texel, metres: the shadow of the largest cubes, 0.375 m, is 30 texels wide, as in the paper.
pub const TEXEL: f64 = 0.0125;
/// Texels along an element of the coarse mesh: more than the largest size of the table.
const ELEMENT: usize = 44;
/// Distance of the centres of the groups from the wall, metres.
const GROUP_DISTANCE: f64 = 1.6;
/// Distance of the light from the wall, metres.
const LIGHT_DISTANCE: f64 = 8.0;
/// Distance between the centres of two groups.
const PITCH: f64 = 2.6;

/// The images of the four groups.
pub struct Groups {
    /// Visible fraction of the light.
    pub shadows: [Image<'static>; 4],
    /// Of a point at the centre of the light: 0 or 1.
    pub points: [Image<'static>; 4],
    /// Means over the elements of the coarse mesh.
    pub coarse: [Image<'static>; 4],
}

/// Edges of the cubes of the groups, from left to right, metres.
pub const EDGES: [f64; 4] = [0.1, 0.15, 0.2, 0.3];
/// Side of the box of a group, metres.
const SIDE: f64 = 2.0;
/// Side of the light, metres.
const LIGHT: f64 = 0.1;
/// Part of a group's box that its cubes cover, seen from the wall. The paper gives none; how much work Figure 9 saves depends on it, and the
/// item gives the numbers for others.
pub const COVERAGE: f64 = 0.3;

/// The four groups before a wall, with a small light: the scene of Figures 1, 4 and 9 and of Table 1, with this coverage.
pub fn covering_scene(coverage: f64) -> Result<Scene> {
    let mut blocks = Blocks::new("four groups of cubes");
    blocks.rectangle(DVec3::new(0.0, 0.0, 2.0), 12.0 * DVec3::Z, 14.0 * DVec3::X, false);
    for (k, edge) in EDGES.into_iter().enumerate() {
        let centre = DVec3::new((k as f64 - 1.5) * PITCH, GROUP_DISTANCE, 2.0);
        blocks.covering_cubes(coverage, edge, centre, SIDE);
    }
    let at = DVec3::new(0.0, LIGHT_DISTANCE, 2.0);
    blocks.rectangle(at, LIGHT * DVec3::X, LIGHT * DVec3::Z, true);
    blocks.scene()
}

/// Smallest width of the shadows of single cubes, penumbra included, metres: b + (b + e) d2/d1 of the face towards the wall and of that
/// towards the light (docs/method.md, Umbra criterion).
pub fn shadow_widths(edge: f64) -> [f64; 2] {
    [-0.5, 0.5].map(|side| {
        let d2 = GROUP_DISTANCE + side * edge;
        edge + (edge + LIGHT) * d2 / (LIGHT_DISTANCE - d2)
    })
}

/// Where the shadow of a group lies on the back wall.
pub fn wall(group: usize, columns: usize, texel: f64) -> Wall {
    let across = (group as f64 - 1.5) * PITCH * LIGHT_DISTANCE / (LIGHT_DISTANCE - GROUP_DISTANCE);
    // The wall is seen from the light, which has +x on its left.
    let centre = DVec3::new(across, 0.0, 2.0);
    Wall { centre, right: -DVec3::X, up: DVec3::Z, columns, rows: columns, texel }
}

impl Groups {
    pub fn new(context: &Context) -> Result<Groups> {
        let options = PrepareOptions::default().with_detail(Detail::Rays);
        let model = Model::prepare(covering_scene(COVERAGE)?, &options, context.progress)?;
        let rays = if context.small { 16 } else { 128 };
        let four = |make: &dyn Fn(&Wall) -> Result<Image<'static>>| -> Result<[Image<'static>; 4]> {
            let images = (0..4).map(|k| make(&wall(k, COLUMNS, TEXEL))).collect::<Result<Vec<_>>>()?;
            Ok(images.try_into().expect("four groups"))
        };
        let shadows = four(&|wall| Ok(wall.grid(&model).by_rays(rays, 1, 1)?.image))?;
        let light = DVec3::new(0.0, LIGHT_DISTANCE, 2.0);
        let points = four(&|wall| wall.grid(&model).sees(&[light]))?;
        let coarse = shadows.iter().map(|image| meshed(image, ELEMENT)).collect::<Result<Vec<_>>>()?;
        Ok(Groups { shadows, points, coarse: coarse.try_into().expect("four groups") })
    }
}

/// Features as the paper defines them: shadows, sized by erosions with eight neighbours.
pub fn paper_features() -> FeatureOptions {
    FeatureOptions::default().with_features(Features::Shadow).with_morphology(Morphology::Paper8)
}

/// The shadows of an image as features.
pub fn shadow_mask(image: &Image, size: f64) -> Result<BitImage> {
    Ok(FeatureSet::new(image, &paper_features())?.mask(size * image.texel()))
}

/// The smallest size, texels, whose mask holds less than half of the shadows.
fn typical_size(image: &Image) -> Result<f64> {
    let mut features = FeatureSet::new(image, &paper_features())?;
    let all = features.mask(0.0).count();
    let sizes = (1..image.width()).map(|size| size as f64);
    Ok(sizes.into_iter().find(|size| 2 * features.mask(size * image.texel()).count() < all).unwrap_or(0.0))
}

/// Figure 1: L2 errors do not tell large shadows from small ones.
pub fn figure_1(context: &Context) -> Result<Item> {
    let groups = context.groups()?;
    let mut item = Item {
        here: format!(
            "Cubes of 0.1, 0.15, 0.2 and 0.3 m in four groups, each covering {1} % of its part of the wall, a light of {LIGHT} m at a \
             distance of {LIGHT_DISTANCE} m; the paper gives no dimensions. Images of {COLUMNS} x {COLUMNS} texels of 12.5 mm by exact rays; a mesh of \
             {0} x {0} elements with the mean of the reference.",
            COLUMNS / ELEMENT,
            fixed(100.0 * COVERAGE, 0)
        ),
        ..Item::default()
    };
    let errors: Vec<f64> = (0..4)
        .map(|k| Ok(100.0 * norms(&groups.shadows[k], &groups.coarse[k])?.l2))
        .collect::<Result<_>>()?;
    let names = ["0.1 m", "0.15 m", "0.2 m", "0.3 m"];
    let panels = |images: &[Image; 4], caption: &dyn Fn(usize) -> String| {
        images.iter().enumerate().map(|(k, image)| Panel::visible(image, caption(k))).collect()
    };
    item.row(
        format!("Reference ({VISIBLE})"),
        panels(&groups.shadows, &|k| format!("cubes of {}", names[k])),
    );
    let errors_of = |k: usize| format!("L2 error {} %", fixed(errors[k], 1));
    item.row(format!("Coarse mesh ({VISIBLE})"), panels(&groups.coarse, &errors_of));
    let (smallest, largest) = range(&errors);
    let similar = paper_spread();
    item.check(
        format!(
            "the four L2 errors are similar: they differ by no more than the paper's errors at its smallest feature size, {} %",
            fixed(100.0 * (similar - 1.0), 0)
        ),
        format!("{} to {} %", fixed(smallest, 1), fixed(largest, 1)),
        largest <= similar * smallest,
    );
    // The sizes differ by a factor of three all the same.
    let sizes = groups.shadows.iter().map(typical_size).collect::<Result<Vec<f64>>>()?;
    item.check(
        "the sizes that half of the shadows' area lies above grow from the left to the right",
        list(&sizes, 0) + " texels",
        sizes.windows(2).all(|pair| pair[0] < pair[1]),
    );
    Ok(item)
}

/// Appendix A: L1 and L2 errors of a mean follow from the mean alone.
pub fn appendix_a(context: &Context) -> Result<Item> {
    let groups = context.groups()?;
    let mut item = Item {
        here: "The four groups before a point light: norms of the difference between the visibility of each texel (0 \
               or 1) and its mean over the wall, beside the formulas; and of a light of 0.1 m, for which the formulas are \
               upper bounds."
            .into(),
        ..Item::default()
    };
    let mut table =
        Table::new("Norms of v − v̄", &["group", "light", "v̄", "L1", "2v̄(1 − v̄)", "L2", "√(v̄(1 − v̄))"]);
    let (mut off, mut excess) = (0.0f64, f64::NEG_INFINITY);
    for (images, light) in [(&groups.points, "point"), (&groups.shadows, "0.1 m")] {
        for (k, image) in images.iter().enumerate() {
            let v = mean(image);
            let flat = Image::from_fn(image.width(), image.height(), image.texel(), |_, _| v as f32)?;
            let found = norms(image, &flat)?;
            let [l1, l2] = [2.0 * v * (1.0 - v), (v * (1.0 - v)).sqrt()];
            match light {
                "point" => off = off.max((found.l1 - l1).abs()).max((found.l2 - l2).abs()),
                _ => excess = excess.max(found.l1 - l1).max(found.l2 - l2),
            }
            let numbers = [v, found.l1, l1, found.l2, l2].map(|v| number(v, 4));
            table.push([count(k + 1), light.into()].into_iter().chain(numbers));
        }
    }
    item.tables.push(table);
    item.check(
        "a point light: both norms equal the formulas to 0.0001",
        format!("largest difference {off:.1e}"),
        off < 1e-4,
    );
    item.check(
        "a light with an area: both norms are below the formulas",
        format!("largest norm less its formula {}", fixed(excess, 4)),
        excess <= 0.0,
    );
    Ok(item)
}

/// Table 1: the feature-based error metric tells the groups apart.
pub fn table_1(context: &Context) -> Result<Item> {
    let groups = context.groups()?;
    let mut item = Item {
        here: "The images of Figure 1; FBEM with the paper's features (shadows, erosions with eight neighbours), per cent of the \
               unoccluded value. The paper gives neither the scene nor the unit of its numbers, so that ordering and fall-off \
               are compared, not values."
            .into(),
        ..Item::default()
    };
    let options = FbemOptions::default().with_features(paper_features());
    let sizes = SIZES.map(|s| s * TEXEL);
    let columns: Vec<Vec<f64>> = (0..4)
        .map(|k| {
            let found = spectrum(&groups.shadows[k], &groups.coarse[k], &sizes, &options)?;
            Ok(found.iter().map(|fbem| 100.0 * fbem.value).collect())
        })
        .collect::<Result<_>>()?;
    let found: Vec<[f64; 4]> = (0..5).map(|i| std::array::from_fn(|k| columns[k][i])).collect();
    let mut table = Table::new(
        "FBEM here, and in the paper",
        &[
            "feature size, texels",
            "group 1, %",
            "group 2, %",
            "group 3, %",
            "group 4, %",
            "paper 1, %",
            "paper 2, %",
            "paper 3, %",
            "paper 4, %",
        ],
    );
    for (i, s) in SIZES.iter().enumerate() {
        let numbers = found[i].iter().chain(&TABLE_1[i]).map(|v| number(*v, 2));
        table.push([number(*s, 0)].into_iter().chain(numbers));
    }
    item.tables.push(table);
    judge_table_1(&mut item, &found);
    Ok(item)
}

/// Largest error of a group relative to the smallest at the smallest size of the paper's table, which is about L2.
fn paper_spread() -> f64 {
    let (smallest, largest) = range(&TABLE_1[0]);
    largest / smallest
}

fn judge_table_1(item: &mut Item, found: &[[f64; 4]]) {
    let (smallest, largest) = range(&found[0]);
    item.check(
        format!(
            "the smallest size does not tell the groups apart: their errors differ by no more than the paper's, {} %",
            fixed(100.0 * (paper_spread() - 1.0), 0)
        ),
        format!("{} %", fixed(100.0 * (largest / smallest - 1.0), 0)),
        largest / smallest <= paper_spread(),
    );
    let falls = (0..4).all(|k| found.windows(2).all(|rows| rows[1][k] < rows[0][k]));
    let columns: Vec<String> =
        (0..4).map(|k| list(&found.iter().map(|row| row[k]).collect::<Vec<_>>(), 1)).collect();
    item.check(
        "in each group the error falls from size to size, as in the paper",
        columns.join("; ") + " %",
        falls,
    );
    let left: [f64; 4] = std::array::from_fn(|k| 100.0 * found[3][k] / found[0][k]);
    let paper: [f64; 4] = std::array::from_fn(|k| 100.0 * TABLE_1[3][k] / TABLE_1[0][k]);
    item.check(
        "at size 30 only the largest cubes need more work: over half of their error at size 5 is left, and less than half of that of the \
         others",
        format!("{} %; in the paper {} %", list(&left, 0), list(&paper, 0)),
        left[..3].iter().all(|part| *part < 50.0) && left[3] > 50.0,
    );
    judge_fall_off(item, found);
    let [agree, all] = ordered_pairs(found);
    item.check(
        format!("pairs of numbers that differ by more than {RESIDUAL} in the paper, its residual error of the mesh, have its order here"),
        format!("{agree} of {all} pairs"),
        agree == all,
    );
}

/// Whether errors of smaller objects fall faster: what is left of the error at size 5 grows from group to group.
fn judge_fall_off(item: &mut Item, found: &[[f64; 4]]) {
    let left = |table: &[[f64; 4]], i: usize| -> [f64; 4] {
        std::array::from_fn(|k| 100.0 * table[i][k] / table[0][k])
    };
    let rows = |table: &[[f64; 4]]| (1..4).map(|i| list(&left(table, i), 0)).collect::<Vec<_>>().join("; ");
    item.check(
        "at sizes 16, 24 and 30 the part of the error at size 5 that is left grows from each group to the next, of larger cubes",
        format!("{} %; in the paper {} %", rows(found), rows(&TABLE_1)),
        (1..4).all(|i| left(found, i).windows(2).all(|pair| pair[0] < pair[1])),
    );
}

/// The paper's estimate of the part of its numbers that the mesh causes (section 2.3).
const RESIDUAL: f64 = 3.0;

/// Number of pairs of the table that differ by more than [`RESIDUAL`] in the paper and have its order, and of all of these pairs.
fn ordered_pairs(found: &[[f64; 4]]) -> [usize; 2] {
    let flat = |rows: &[[f64; 4]]| rows.iter().flatten().copied().collect::<Vec<f64>>();
    let (here, paper) = (flat(found), flat(&TABLE_1));
    let mut counts = [0; 2];
    for (a, here_a) in here.iter().enumerate() {
        for (_, here_b) in here.iter().enumerate().filter(|(b, _)| paper[a] > paper[*b] + RESIDUAL) {
            counts[0] += usize::from(here_a > here_b);
            counts[1] += 1;
        }
    }
    counts
}

/// Smallest and largest value.
pub fn range(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)))
}
