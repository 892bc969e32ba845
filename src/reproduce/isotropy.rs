//! Isotropic against directional clusters: the paper's footnote 3, which it left as future work.

use super::bsize::sizes;
use super::item::{Item, Panel, VISIBLE};
use super::shadow::{Grid, Wall};
use super::table::{Table, number};
use super::{Context, fixed, list};
use crate::Result;
use crate::metrics::{FbemOptions, Morphology, fbem};
use crate::model::{Model, PrepareOptions};
use crate::optics::{self, AXIS_COUNT, AxisMix, ClusterOptics};
use crate::scene::generate::{self, Spec};
use crate::visibility::LeafMode;
use glam::{DVec3, Vec3};

/// Scenes with what their clusters look like.
const SCENES: [(&str, &str); 4] = [
    ("louvres", "aligned slats"),
    ("bookshelf", "books side by side"),
    ("brick-wall", "bricks in a wall"),
    ("cubes", "cubes, turned at random"),
];

/// Feature sizes of the images, metres: four texels and more.
const SIZES: [f64; 3] = [0.1, 0.2, 0.4];
/// Components of unit vectors between the axes on which clusters are measured.
const BETWEEN: [f32; 3] = [0.802, 0.535, 0.267];
/// Number of their orders and signs, without opposite vectors.
const VIEWS: usize = 24;

/// The unit vectors with these components in all orders and signs, without opposite ones.
fn views() -> [Vec3; VIEWS] {
    let [a, b, c] = BETWEEN;
    let orders = [[a, b, c], [a, c, b], [b, a, c], [b, c, a], [c, a, b], [c, b, a]];
    std::array::from_fn(|k| {
        let sign = |bit: usize| if k >> bit & 1 == 1 { -1.0 } else { 1.0 };
        Vec3::from(orders[k / 4]) * Vec3::new(1.0, sign(0), sign(1))
    })
}

/// Sets of segments of the images, whose differences tell the sampling error.
const STREAMS: [u64; 2] = [0, 2];
/// Standard errors by which a difference is certain.
const CERTAIN: f64 = 3.0;

/// A model whose clusters have one value for all directions, or one a direction, with sizes by erosions. With an error of 1 allowed no
/// averaging width protects clusters whose error is large.
fn prepared(name: &str, isotropic: bool, context: &Context) -> Result<Model> {
    let morphology = Morphology::Paper8;
    let optics = optics::Options { isotropic, morphology, tolerance: 1.0, ..optics::Options::default() };
    let options = PrepareOptions { optics, ..PrepareOptions::default() };
    Model::prepare(generate::build(&Spec::new(name))?, &options, context.progress)
}

/// Mean error of the transmittance in directions that are measured but not fitted, over clusters by triangles.
fn transmittance_error(model: &Model) -> f64 {
    by_triangles(model, |_, own| f64::from(own.error))
}

/// Relative errors of BSIZE in the directions of [`views`], means over clusters: of the mean over all axes, and of the interpolation
/// between those around.
fn size_errors(model: &Model) -> [[f64; VIEWS]; 2] {
    let tree = &model.base().hierarchy().micro;
    [false, true].map(|interpolated| {
        views().map(|view| {
            by_triangles(model, |c, own| {
                let mean = own.blocker_size.iter().sum::<f32>() / AXIS_COUNT as f32;
                let [measured, _] = sizes(model.scene(), tree.triangles_of(c), view);
                let mixed = AxisMix::around(view).mix(|axis| own.blocker_size[axis]);
                let found = if interpolated { mixed } else { mean };
                f64::from((found - measured).abs() / measured.max(f32::MIN_POSITIVE)).min(1.0)
            })
        })
    })
}

/// Mean of some values, and its standard error.
fn mean(values: &[f64]) -> [f64; 2] {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    [mean, (square / (n * (n - 1.0).max(1.0))).sqrt()]
}

/// Mean of a value of the clusters, by their triangles.
fn by_triangles(model: &Model, value: impl Fn(usize, &ClusterOptics) -> f64) -> f64 {
    let (tree, optics) = (&model.base().hierarchy().micro, &model.base().measured().expect("optics").optics);
    let (mut sum, mut weights) = (0.0, 0.0);
    for (c, (cluster, own)) in tree.clusters.iter().zip(optics).enumerate() {
        let weight = f64::from(cluster.triangles);
        (sum, weights) = (sum + weight * value(c, own), weights + weight);
    }
    sum / weights
}

/// The wall behind the slats of `louvres`.
fn wall(model: &Model) -> Grid<'_> {
    let centre = DVec3::new(0.0, 2.0, 1.3);
    Wall { centre, right: DVec3::X, up: DVec3::Z, columns: 144, rows: 96, texel: 0.025 }.grid(model)
}

/// What interpolation takes off errors of clusters in a scene, percentage points.
struct Gain {
    name: &'static str,
    /// Of BSIZE, mean over directions and standard error.
    size: [f64; 2],
    /// Of the transmittance.
    light: f64,
}

/// Footnote 3: errors of both on clusters that are and are not isotropic.
pub fn footnote_3(context: &Context) -> Result<Item> {
    let mut item = Item {
        here: "Scenes of `mrvis generate` with clusters that are not isotropic, and one whose clusters are. BSIZE, by erosions, and \
               extinction are measured on 13 axes, then averaged over them or interpolated by direction. Errors are means over clusters, by \
               triangles, in directions between the axes: of BSIZE relative to a measurement in 24 such directions (at most 100 %), whose \
               scatter tells the standard error, and of the mean transmittance. Images of the slats are made with two sets of segments."
            .into(),
        ..Item::default()
    };
    let columns = [
        "scene",
        "clusters",
        "BSIZE by mean, %",
        "BSIZE interpolated, %",
        "light by mean, %",
        "light interpolated, %",
    ];
    let mut table = Table::new("Errors by the mean over directions, and by interpolation", &columns);
    let (mut gains, mut slats) = (Vec::new(), None);
    for (name, what) in SCENES {
        let [one, by_direction] = [true, false].map(|isotropic| prepared(name, isotropic, context));
        let models = [one?, by_direction?];
        let size = size_errors(&models[1]);
        let light = [0, 1].map(|k| 100.0 * transmittance_error(&models[k]));
        let by_view: Vec<f64> = (0..VIEWS).map(|k| 100.0 * (size[0][k] - size[1][k])).collect();
        gains.push(Gain { name, size: mean(&by_view), light: light[0] - light[1] });
        let numbers = size.map(|errors| 100.0 * mean(&errors)[0]).into_iter().chain(light);
        table.push([name.into(), what.into()].into_iter().chain(numbers.map(|e| number(e, 2))));
        slats.get_or_insert(models);
    }
    item.tables.push(table);
    judge_clusters(&mut item, &gains);
    if let Some(models) = slats {
        let errors = images(context, &mut item, &models)?;
        judge_images(&mut item, &errors);
    }
    Ok(item)
}

/// Images of the slats by the mean over directions and by direction; by these and by size the FBEM with each set of segments, per cent.
fn images(context: &Context, item: &mut Item, models: &[Model; 2]) -> Result<[Vec<[f64; 2]>; 2]> {
    let rays = if context.small { 64 } else { 256 };
    let exact = wall(&models[0]).by_rays(rays, 1, 1)?.image;
    let mut panels = vec![Panel::visible(&exact, "Embree rays")];
    let mut errors = [Vec::new(), Vec::new()];
    for ((model, name), errors) in models.iter().zip(["isotropic", "directional"]).zip(&mut errors) {
        let (engine, grid) =
            (model.engine(model.widest_packets(), LeafMode::Average).expect("optics"), wall(model));
        let segments = STREAMS.map(|stream| grid.segments(16, stream));
        for s in SIZES {
            let mut found = [0.0; 2];
            for (found, segments) in found.iter_mut().zip(&segments) {
                let image = grid.by_clusters_along(&engine, s, segments, 1)?.image;
                *found = 100.0 * fbem(&exact, &image, &FbemOptions::default().with_size(s))?.value;
                if s == SIZES[1] && panels.len() < 2 + usize::from(name == "directional") {
                    panels
                        .push(Panel::visible(&image, format!("{name}: FBEM({s} m) {} %", fixed(*found, 1))));
                }
            }
            errors.push(found);
        }
    }
    item.row(format!("Light through the slats, by extinction alone ({VISIBLE})"), panels);
    Ok(errors)
}

/// Whether interpolation gains more where clusters are not isotropic; the last scene is the isotropic one.
fn judge_clusters(item: &mut Item, gains: &[Gain]) {
    let Some((isotropic, others)) = gains.split_last() else { return };
    let shown =
        |gain: &Gain| format!("{} {} ± {}", gain.name, fixed(gain.size[0], 2), fixed(gain.size[1], 2));
    let certain = |gain: &Gain| {
        let error = (gain.size[1].powi(2) + isotropic.size[1].powi(2)).sqrt();
        gain.size[0] - isotropic.size[0].max(0.0) > CERTAIN * error
    };
    let check = item.check(
        "where clusters are not isotropic, interpolation lowers the error of BSIZE by more than where they are, by over three standard errors",
        format!("{} percentage points", gains.iter().map(shown).collect::<Vec<_>>().join(", ")),
        others.iter().all(certain),
    );
    check.if_not(|| {
        let uncertain: Vec<&str> =
            others.iter().filter(|gain| !certain(gain)).map(|gain| gain.name).collect();
        format!("{}: not certain, the gain depends on the direction", uncertain.join(", "))
    });
    let shown = |gain: &Gain| format!("{} {}", gain.name, fixed(gain.light, 2));
    item.check(
        "where clusters are not isotropic, interpolation lowers the error of transmittance, by more than where they are",
        format!("{} percentage points", gains.iter().map(shown).collect::<Vec<_>>().join(", ")),
        others.iter().all(|gain| gain.light > isotropic.light.max(0.0)),
    );
}

/// Whether images by direction have smaller errors; by size, errors with each set of segments.
fn judge_images(item: &mut Item, [one, by_direction]: &[Vec<[f64; 2]>; 2]) {
    let gains: Vec<[f64; 2]> =
        one.iter().zip(by_direction).map(|(a, b)| [a[0] - b[0], a[1] - b[1]]).collect();
    // Half the difference of two values estimates the standard error of their mean; pooled over sizes.
    let half = gains.iter().map(|[a, b]| (0.5 * (a - b)).powi(2)).sum::<f64>();
    let error = (half / gains.len() as f64).sqrt();
    let means = |pairs: &[[f64; 2]]| list(&pairs.iter().map(|[a, b]| 0.5 * (a + b)).collect::<Vec<_>>(), 2);
    item.check(
        format!(
            "the image of the slats has a smaller FBEM with directions, by over three standard errors, at sizes {} m",
            list(&SIZES, 1)
        ),
        format!(
            "{} % with and {} % without, standard error {} %",
            means(by_direction),
            means(one),
            fixed(error, 3)
        ),
        !gains.is_empty() && gains.iter().all(|[a, b]| 0.5 * (a + b) > CERTAIN * error && *a > 0.0 && *b > 0.0),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_not_a_gain() {
        let holds = |isotropic: [f64; 2], light: f64| {
            let other = Gain { name: "slats", size: [5.0, 1.0], light: 2.0 };
            let mut item = Item::default();
            judge_clusters(&mut item, &[other, Gain { name: "cubes", size: isotropic, light }]);
            [item.checks[0].holds, item.checks[1].holds]
        };
        assert_eq!(holds([0.5, 0.1], 1.0), [true, true]);
        assert_eq!(holds([0.5, 1.5], 1.0), [false, true]);
        assert_eq!(holds([4.0, 0.1], 2.5), [false, false]);
        for (with, holds) in [([7.0, 7.1], true), ([9.0, 5.0], false), ([10.5, 10.4], false)] {
            let mut item = Item::default();
            judge_images(&mut item, &[vec![[10.0, 10.0]; 3], vec![with; 3]]);
            assert_eq!(item.checks[0].holds, holds, "{with:?}");
        }
    }
}
