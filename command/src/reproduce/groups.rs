//! Images of four groups of cubes: Figure 1 of the paper.

use super::cubes::{
    COLUMNS, COVERAGE, EDGES, LIGHT, LIGHT_DISTANCE, TEXEL, coverage_tolerance, covering_scene, light, wall,
};
use super::item::{Item, Panel, VISIBLE};
use super::shadow::{Wall, mean, meshed, paper_features};
use super::table_1::{paper_spread, range};
use super::{Context, fixed, list};
use mrvis::internals::metrics::{FeatureSet, norms};
use mrvis::internals::raster::BitImage;
use mrvis::metrics::Image;
use mrvis::{Detail, Result};

/// Texels along an element of the coarse mesh: more than the largest size of Table 1.
const ELEMENT: usize = 44;

/// The images of the four groups.
pub struct Groups {
    /// Visible fraction of the light.
    pub shadows: [Image<'static>; 4],
    /// Of a point at the centre of the light: 0 or 1.
    pub points: [Image<'static>; 4],
    /// Means over the elements of the coarse mesh.
    pub coarse: [Image<'static>; 4],
}

impl Groups {
    pub fn new(context: &Context) -> Result<Groups> {
        let model = context.model(covering_scene(COVERAGE)?, Detail::Rays)?;
        let rays = if context.small { 16 } else { 128 };
        let four = |make: &dyn Fn(&Wall) -> Result<Image<'static>>| -> Result<[Image<'static>; 4]> {
            let images = (0..4).map(|k| make(&wall(k, COLUMNS, TEXEL))).collect::<Result<Vec<_>>>()?;
            Ok(images.try_into().expect("four groups"))
        };
        let shadows = four(&|wall| Ok(wall.grid(&model).by_rays(rays, 1, 1)?.image))?;
        let points = four(&|wall| wall.grid(&model).sees(&[light()]))?;
        let coarse = shadows.iter().map(|image| meshed(image, ELEMENT)).collect::<Result<Vec<_>>>()?;
        Ok(Groups { shadows, points, coarse: coarse.try_into().expect("four groups") })
    }
}

/// The shadows of an image as features.
pub fn shadow_mask(image: &Image, size: f64) -> Result<BitImage> {
    Ok(FeatureSet::new(image, &paper_features())?.mask(size * image.texel()))
}

/// The smallest size, texels, whose mask holds less than half of the shadows.
fn median_size(image: &Image) -> Result<f64> {
    let mut features = FeatureSet::new(image, &paper_features())?;
    let all = features.mask(0.0).count();
    let sizes = (1..image.width()).map(|size| size as f64);
    Ok(sizes.into_iter().find(|size| 2 * features.mask(size * image.texel()).count() < all).unwrap_or(0.0))
}

/// Figure 1: L2 errors do not tell large shadows from small ones.
pub fn figure_1(context: &Context) -> Result<Item> {
    let groups = context.groups()?;
    let mut item = Item::of(format!(
        "Cubes of 0.1, 0.15, 0.2 and 0.3 m in four groups; each group has enough cubes to hide {1} % of its image from the centre of a light of \
             {LIGHT} m at a distance of {LIGHT_DISTANCE} m; the paper gives no dimensions. Images of {COLUMNS} x {COLUMNS} texels of 12.5 mm by \
             exact rays; a mesh of {0} x {0} elements with the mean of the reference.",
        COLUMNS / ELEMENT,
        fixed(100.0 * COVERAGE, 0)
    ));
    let errors: Vec<f64> = (0..4)
        .map(|k| Ok(100.0 * norms(&groups.shadows[k], &groups.coarse[k])?.l2))
        .collect::<Result<_>>()?;
    let covered: Vec<f64> = groups.points.iter().map(|image| 1.0 - mean(image)).collect();
    let names = ["0.1 m", "0.15 m", "0.2 m", "0.3 m"];
    let panels = |images: &[Image; 4], caption: &dyn Fn(usize) -> String| {
        images.iter().enumerate().map(|(k, image)| Panel::visible(image, caption(k))).collect()
    };
    item.row(
        format!("Reference ({VISIBLE})"),
        panels(&groups.shadows, &|k| {
            format!("cubes of {}, {} % hidden", names[k], fixed(100.0 * covered[k], 1))
        }),
    );
    let errors_of = |k: usize| format!("L2 error {} %", fixed(errors[k], 1));
    item.row(format!("Coarse mesh ({VISIBLE})"), panels(&groups.coarse, &errors_of));
    let sizes = groups.shadows.iter().map(median_size).collect::<Result<Vec<f64>>>()?;
    judge_figure_1(&mut item, &covered, &errors, &sizes);
    Ok(item)
}

/// Covered fractions of the images, L2 errors in per cent, and median feature sizes in texels, by group.
fn judge_figure_1(item: &mut Item, covered: &[f64], errors: &[f64], sizes: &[f64]) {
    let tolerance = coverage_tolerance(EDGES[3]);
    item.check(
        format!(
            "the groups hide equal parts of their images from the centre of the light, to half of the shadow of one of the largest cubes, {} %",
            fixed(100.0 * tolerance, 1)
        ),
        list(&covered.iter().map(|part| 100.0 * part).collect::<Vec<_>>(), 1) + " %",
        covered.iter().all(|part| (part - COVERAGE).abs() <= tolerance),
        || format!("a group cannot hide {} % with cubes that lie apart", fixed(100.0 * COVERAGE, 0)),
    );
    let (smallest, largest) = range(errors);
    let similar = paper_spread();
    item.check(
        format!(
            "the four L2 errors are similar: they differ by no more than the paper's errors at its smallest feature size, {} %",
            fixed(100.0 * (similar - 1.0), 0)
        ),
        format!("{} to {} %", fixed(smallest, 1), fixed(largest, 1)),
        largest <= similar * smallest,
        || {
            let spread = fixed(100.0 * (largest / smallest - 1.0), 0);
            format!("they differ by {spread} %: elements of the mesh resolve the shadows of some groups better than those of others")
        },
    );
    item.check(
        "the median feature size of the shadows, by area, grows from group to group",
        list(sizes, 0) + " texels",
        sizes.windows(2).all(|pair| pair[0] < pair[1]),
        || "shadows of several cubes join, and are as wide as those of larger cubes".into(),
    );
}

#[cfg(test)]
mod tests {
    use super::super::item::failing_checks;
    use super::*;

    #[test]
    fn each_check_of_figure_1_fails_by_numbers_of_its_own() {
        let of = |covered: [f64; 4], errors: [f64; 4], sizes: [f64; 4]| {
            failing_checks(|item| judge_figure_1(item, &covered, &errors, &sizes))
        };
        let (covered, errors, sizes) = ([COVERAGE; 4], [40.0, 42.0, 41.0, 43.0], [10.0, 15.0, 20.0, 30.0]);
        assert_eq!(of(covered, errors, sizes), [0; 0]);
        assert_eq!(of([0.4, 0.34, 0.4, 0.4], errors, sizes), [0]);
        assert_eq!(of(covered, [40.0, 48.0, 41.0, 43.0], sizes), [1]);
        assert_eq!(of(covered, errors, [10.0, 15.0, 15.0, 30.0]), [2]);
    }
}
