//! Isotropic against directional clusters: the paper's footnote 3, which it left as future work.

use super::bsize::sizes;
use super::item::{Item, Panel, Table, VISIBLE};
use super::shadow::{Grid, Wall};
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
/// Unit vectors between the axes on which clusters are measured, in two octants.
const BETWEEN: [Vec3; 4] = [
    Vec3::new(0.802, 0.535, 0.267),
    Vec3::new(0.267, -0.802, 0.535),
    Vec3::new(0.535, -0.267, -0.802),
    Vec3::new(0.267, 0.535, 0.802),
];

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

/// Mean relative error of BSIZE in directions between the axes: of the mean over all axes, and of the interpolation between those around.
fn size_errors(model: &Model) -> [f64; 2] {
    let tree = &model.base().hierarchy().micro;
    let of = |interpolated: bool| {
        by_triangles(model, |c, own| {
            let mean = own.blocker_size.iter().sum::<f32>() / AXIS_COUNT as f32;
            let errors = BETWEEN.map(|view| {
                let [measured, _] = sizes(model.scene(), tree.triangles_of(c), view);
                let mixed = AxisMix::around(view).mix(|axis| own.blocker_size[axis]);
                let found = if interpolated { mixed } else { mean };
                f64::from((found - measured).abs() / measured.max(f32::MIN_POSITIVE)).min(1.0)
            });
            errors.iter().sum::<f64>() / errors.len() as f64
        })
    };
    [of(false), of(true)]
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

/// Footnote 3: errors of both on clusters that are and are not isotropic.
pub fn footnote_3(context: &Context) -> Result<Item> {
    let mut item = Item {
        here: "Scenes of `mrvis generate` with clusters that are not isotropic, and one whose clusters are. BSIZE, by erosions, and \
               extinction are measured on 13 axes, then averaged over them or interpolated by direction. Errors are means over clusters, by \
               triangles, in directions between the axes: of BSIZE relative to a measurement in that direction (at most 100 %), and of the \
               mean transmittance."
            .into(),
        ..Item::default()
    };
    let columns = [
        "scene",
        "clusters",
        "BSIZE, mean, %",
        "BSIZE, interpolated, %",
        "light, mean, %",
        "light, interpolated, %",
    ];
    let mut table = Table::new("Errors by the mean over directions, and by interpolation", &columns);
    // By scene, what interpolation takes off the errors of BSIZE and of the transmittance, per cent.
    let mut gains = Vec::new();
    for (name, what) in SCENES {
        let [one, by_direction] = [true, false].map(|isotropic| prepared(name, isotropic, context));
        let (one, by_direction) = (one?, by_direction?);
        let size = size_errors(&by_direction).map(|e| 100.0 * e);
        let light = [&one, &by_direction].map(|model| 100.0 * transmittance_error(model));
        gains.push([size[0] - size[1], light[0] - light[1]]);
        let numbers = size.into_iter().chain(light).map(|e| fixed(e, 2));
        table.push([name.into(), what.into()].into_iter().chain(numbers));
    }
    item.tables.push(table);
    let models = [prepared("louvres", true, context)?, prepared("louvres", false, context)?];
    let rays = if context.small { 64 } else { 256 };
    let exact = wall(&models[0]).by_rays(rays, 1, 1)?.image;
    let mut panels = vec![Panel::visible(&exact, "Embree rays")];
    let mut errors = Vec::new();
    for (model, name) in models.iter().zip(["isotropic", "directional"]) {
        let engine = model.engine(model.widest_packets(), LeafMode::Average).expect("optics");
        for s in SIZES {
            let image = wall(model).by_clusters(&engine, s, (16, 1))?.image;
            let options = FbemOptions::default().with_size(s);
            errors.push(100.0 * fbem(&exact, &image, &options)?.value);
            if s == SIZES[1] {
                let error = fixed(errors[errors.len() - 1], 1);
                panels.push(Panel::visible(&image, format!("{name}: FBEM({s} m) {error} %")));
            }
        }
    }
    item.row(format!("Light through the slats, by extinction alone ({VISIBLE})"), panels);
    let (one, by_direction) = errors.split_at(SIZES.len());
    let [isotropic, others] = [
        gains[3],
        gains[..3].iter().fold([f64::INFINITY; 2], |smallest, gain| [0, 1].map(|k| smallest[k].min(gain[k]))),
    ];
    for (k, what) in ["BSIZE", "transmittance"].into_iter().enumerate() {
        item.check(
            format!("where clusters are not isotropic, interpolation lowers the error of {what}, by more than where they are"),
            format!("at least {} against {} percentage points", fixed(others[k], 2), fixed(isotropic[k], 2)),
            others[k] > isotropic[k].max(0.0),
        );
    }
    item.check(
        format!("the image of the slats has a smaller FBEM with directions, at sizes {} m", list(&SIZES, 1)),
        format!("{} % with and {} % without", list(by_direction, 1), list(one, 1)),
        by_direction.iter().zip(one).all(|(with, without)| with < without),
    );
    Ok(item)
}
