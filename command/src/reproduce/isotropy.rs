//! Isotropic against directional clusters: the paper's footnote 3, which it left as future work.

use super::bsize::sizes;
use super::item::{Item, Panel, VISIBLE};
use super::shadow::{Grid, Wall};
use super::table::{Table, number};
use super::{Context, fixed, list};
use glam::{DVec3, Vec3};
use mrvis::Result;
use mrvis::internals::optics::{self, AXIS_COUNT, AxisMix, ClusterOptics};
use mrvis::internals::scene::generate::{self, Spec};
use mrvis::internals::visibility::LeafMode;
use mrvis::internals::{ModelParts, PrepareParts};
use mrvis::metrics::{FbemOptions, Morphology, fbem};
use mrvis::{Model, PrepareOptions};
use rayon::prelude::*;
use sobol_burley::sample_4d;

/// Scenes with what their clusters look like.
const SCENES: [(&str, &str); 4] = [
    ("louvres", "aligned slats"),
    ("bookshelf", "books side by side"),
    ("brick-wall", "bricks in a wall"),
    ("cubes", "cubes, turned at random"),
];

/// Feature sizes of the images, metres: four texels and more.
const SIZES: [f64; 3] = [0.1, 0.2, 0.4];
/// Sets of random directions in which BSIZE is measured, each drawn anew: the means of sets differ by the sampling error.
const SETS: usize = 8;
/// Directions of a set, a low-discrepancy sequence on the sphere with random scrambling.
const DIRECTIONS: usize = 16;

/// The directions of a set: unit vectors.
fn directions(set: usize) -> Vec<Vec3> {
    let direction = |k: usize| {
        let [u, v, ..] = sample_4d(k as u32, 0, set as u32);
        let (z, phi) = (2.0 * u - 1.0, std::f32::consts::TAU * v);
        let radius = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(radius * phi.cos(), radius * phi.sin(), z)
    };
    (0..DIRECTIONS).map(direction).collect()
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
    let options = PrepareOptions::default().with_optics(optics);
    Model::prepare(generate::build(&Spec::new(name))?, &options, context.progress)
}

/// Errors of the transmittance in directions that are measured but not fitted, means over clusters by triangles: by the mean over
/// directions and by interpolation; what interpolation takes off, with its standard error by the scatter between clusters.
fn transmittance_errors(models: &[Model; 2]) -> ([f64; 2], [f64; 2]) {
    let errors = models.each_ref().map(|model| by_triangles(model, |_, own| f64::from(own.error)));
    let measured =
        |k: usize, c: usize| f64::from(models[k].base().measured().expect("optics").optics[c].error);
    let mean = errors[0] - errors[1];
    let (mut square, mut weights) = (0.0, 0.0);
    for (c, cluster) in models[0].base().hierarchy().micro.clusters.iter().enumerate() {
        let weight = f64::from(cluster.triangles);
        square += (weight * (measured(0, c) - measured(1, c) - mean)).powi(2);
        weights += weight;
    }
    (errors, [mean, square.sqrt() / weights])
}

/// Relative errors of BSIZE by set of directions, means over clusters and directions: of the mean over all axes, and of the interpolation
/// between those around.
fn size_errors(model: &Model) -> Vec<[f64; 2]> {
    let tree = &model.base().hierarchy().micro;
    let of = |view: Vec3| {
        let errors = |c: usize, own: &ClusterOptics| {
            let mean = own.blocker_size.iter().sum::<f32>() / AXIS_COUNT as f32;
            let [measured, _] = sizes(model.scene(), tree.triangles_of(c), view);
            let mixed = AxisMix::around(view).mix(|axis| own.blocker_size[axis]);
            [mean, mixed]
                .map(|found| f64::from((found - measured).abs() / measured.max(f32::MIN_POSITIVE)).min(1.0))
        };
        let (mut sum, mut weights) = ([0.0; 2], 0.0);
        let optics = &model.base().measured().expect("optics").optics;
        for (c, (cluster, own)) in tree.clusters.iter().zip(optics).enumerate() {
            let (weight, errors) = (f64::from(cluster.triangles), errors(c, own));
            sum = [sum[0] + weight * errors[0], sum[1] + weight * errors[1]];
            weights += weight;
        }
        sum.map(|sum| sum / weights)
    };
    let of_set = |set: usize| {
        let found: Vec<[f64; 2]> = directions(set).into_par_iter().map(of).collect();
        [0, 1].map(|k| found.iter().map(|errors| errors[k]).sum::<f64>() / DIRECTIONS as f64)
    };
    (0..SETS).map(of_set).collect()
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
    /// Of BSIZE, with its standard error by the scatter between sets of directions.
    size: [f64; 2],
    /// Of the transmittance, with its standard error by the scatter between clusters.
    light: [f64; 2],
}

/// Footnote 3: errors of both on clusters that are and are not isotropic.
pub fn footnote_3(context: &Context) -> Result<Item> {
    let mut item = Item {
        here: "Scenes of `mrvis generate` with clusters that are not isotropic, and one whose clusters are. BSIZE, by erosions, and \
               extinction are measured on 13 axes, then averaged over them or interpolated by direction. Errors are means over clusters, by \
               triangles: of BSIZE relative to a measurement in random directions (at most 100 %), in sets that are drawn anew and whose \
               scatter tells the standard error, and of the mean transmittance in directions between the axes, with a standard error by the \
               scatter between clusters. Images of the slats are made with two sets of segments."
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
        let sets = size_errors(&models[1]);
        let (light, gain) = transmittance_errors(&models);
        let by_set =
            |of: &dyn Fn(&[f64; 2]) -> f64| mean(&sets.iter().map(|e| 100.0 * of(e)).collect::<Vec<_>>());
        let size = [by_set(&|e| e[0]), by_set(&|e| e[1])];
        gains.push(Gain { name, size: by_set(&|e| e[0] - e[1]), light: gain.map(|v| 100.0 * v) });
        let numbers = size.map(|[mean, _]| mean).into_iter().chain(light.map(|v| 100.0 * v));
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
    judge_gain(item, "BSIZE", gains, |gain| gain.size);
    judge_gain(item, "the transmittance", gains, |gain| gain.light);
}

/// The same for one error, by the gain with its standard error.
fn judge_gain(item: &mut Item, what: &str, gains: &[Gain], of: impl Fn(&Gain) -> [f64; 2]) {
    let Some((isotropic, others)) = gains.split_last() else { return };
    let shown = |gain: &Gain| format!("{} {} ± {}", gain.name, fixed(of(gain)[0], 2), fixed(of(gain)[1], 2));
    // By how many standard errors interpolation gains more than where clusters are isotropic, or than nothing.
    let certainty = |gain: &Gain| {
        let ([own, error], [other, other_error]) = (of(gain), of(isotropic));
        (own - other.max(0.0)) / error.hypot(other_error)
    };
    let uncertain = || others.iter().filter(|gain| certainty(gain) <= CERTAIN);
    item.check(
        format!(
            "where clusters are not isotropic, interpolation lowers the error of {what} by more than where they are, by over three standard \
             errors"
        ),
        format!("{} percentage points", gains.iter().map(shown).collect::<Vec<_>>().join(", ")),
        uncertain().next().is_none(),
        || {
            let shown = |gain: &Gain| format!("{} by {} standard errors", gain.name, fixed(certainty(gain), 1));
            let names = uncertain().map(shown).collect::<Vec<_>>().join(", ");
            format!("{names}: what interpolation gains differs too much between directions or clusters")
        },
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
        || {
            let smallest = gains.iter().map(|[a, b]| 0.5 * (a + b)).fold(f64::INFINITY, f64::min);
            format!("the smallest gain is {} percentage points", fixed(smallest, 2))
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_not_a_gain() {
        let holds = |isotropic: [f64; 2], light: [f64; 2]| {
            let other = Gain { name: "slats", size: [5.0, 1.0], light: [2.0, 0.1] };
            let mut item = Item::default();
            judge_clusters(&mut item, &[other, Gain { name: "cubes", size: isotropic, light }]);
            [item.checks[0].holds, item.checks[1].holds]
        };
        assert_eq!(holds([0.5, 0.1], [1.0, 0.1]), [true, true]);
        assert_eq!(holds([0.5, 0.1], [1.0, 0.5]), [true, false]);
        assert_eq!(holds([0.5, 1.5], [1.0, 0.1]), [false, true]);
        assert_eq!(holds([4.0, 0.1], [2.5, 0.1]), [false, false]);
        for (with, holds) in [([7.0, 7.1], true), ([9.0, 5.0], false), ([10.5, 10.4], false)] {
            let mut item = Item::default();
            judge_images(&mut item, &[vec![[10.0, 10.0]; 3], vec![with; 3]]);
            assert_eq!(item.checks[0].holds, holds, "{with:?}");
        }
    }
}
