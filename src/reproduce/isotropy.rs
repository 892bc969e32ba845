//! Isotropic against directional clusters: the paper's footnote 3, which it left as future work.

use super::item::{Item, Panel, Table, VISIBLE};
use super::shadow::{Grid, Wall};
use super::{Context, fixed};
use crate::Result;
use crate::metrics::{FbemOptions, fbem};
use crate::model::{Model, PrepareOptions};
use crate::optics::{self, AXIS_COUNT, ClusterOptics};
use crate::scene::generate::{self, Spec};
use crate::visibility::LeafMode;
use glam::DVec3;

/// Scenes with what their clusters look like.
const SCENES: [(&str, &str); 4] = [
    ("louvres", "aligned slats"),
    ("bookshelf", "books side by side"),
    ("brick-wall", "bricks in a wall"),
    ("cubes", "cubes, turned at random"),
];

/// A model whose clusters have one value for all directions, or one a direction. With an error of 1 allowed no averaging width
/// protects clusters whose error is large.
fn prepared(name: &str, isotropic: bool, context: &Context) -> Result<Model> {
    let optics = optics::Options { isotropic, tolerance: 1.0, ..optics::Options::default() };
    let options = PrepareOptions { optics, ..PrepareOptions::default() };
    Model::prepare(generate::build(&Spec::new(name))?, &options, context.progress)
}

/// Mean error of the transmittance in directions that are measured but not fitted, and mean ratio of the largest blocker size by direction
/// to its mean, over clusters by triangles.
fn anisotropy(model: &Model) -> [f64; 2] {
    let (tree, optics) = (&model.base().hierarchy().micro, &model.base().measured().expect("optics").optics);
    let (mut sums, mut weights) = ([0.0; 2], 0.0);
    for (cluster, own) in tree.clusters.iter().zip(optics) {
        let weight = f64::from(cluster.triangles);
        let ratio = |o: &ClusterOptics| {
            let sizes = (0..AXIS_COUNT).map(|axis| f64::from(o.blocker_size[axis]));
            let mean = sizes.clone().sum::<f64>() / AXIS_COUNT as f64;
            if mean > 0.0 { sizes.fold(0.0, f64::max) / mean } else { 1.0 }
        };
        sums = [sums[0] + weight * f64::from(own.error), sums[1] + weight * ratio(own)];
        weights += weight;
    }
    sums.map(|sum| sum / weights)
}

/// The wall behind the slats of `louvres`.
fn wall(model: &Model) -> Grid<'_> {
    let centre = DVec3::new(0.0, 2.0, 1.3);
    Wall { centre, right: DVec3::X, up: DVec3::Z, columns: 144, rows: 96, texel: 0.025 }.grid(model)
}

/// Footnote 3: errors of both on clusters that are and are not isotropic.
pub fn footnote_3(context: &Context) -> Result<Item> {
    let mut item = Item {
        here: "Scenes of `mrvis generate` with clusters that are not isotropic, and one whose clusters are. Sizes and extinction are \
               measured on 13 axes, then averaged over them or interpolated by direction; the error of a cluster is that of its mean \
               transmittance in three directions between the axes."
            .into(),
        ..Item::default()
    };
    let columns = ["scene", "clusters", "error isotropic, %", "error directional, %", "largest / mean BSIZE"];
    let mut table = Table::new("Clusters", &columns);
    let mut ratios = Vec::new();
    for (name, what) in SCENES {
        let [one, by_direction] = [true, false].map(|isotropic| prepared(name, isotropic, context));
        let [[isotropic, _], [directional, spread]] = [anisotropy(&one?), anisotropy(&by_direction?)];
        ratios.push(directional / isotropic);
        let errors = [100.0 * isotropic, 100.0 * directional, spread].map(|v| fixed(v, 2));
        table.push([name.into(), what.into()].into_iter().chain(errors));
    }
    item.tables.push(table);
    let (models, s) = ([prepared("louvres", true, context)?, prepared("louvres", false, context)?], 0.2);
    let rays = if context.small { 64 } else { 256 };
    let exact = wall(&models[0]).by_rays(rays, 1, 1)?.image;
    let mut panels = vec![Panel::visible(&exact, "Embree rays")];
    let mut errors = Vec::new();
    for (model, name) in models.iter().zip(["isotropic", "directional"]) {
        let engine = model.engine(model.widest_packets(), LeafMode::Average).expect("optics");
        let image = wall(model).by_clusters(&engine, s, (16, 1))?.image;
        let error = 100.0 * fbem(&exact, &image, &FbemOptions::default().with_size(s))?.value;
        panels.push(Panel::visible(&image, format!("{name}: FBEM({s} m) {} %", fixed(error, 1))));
        errors.push(error);
    }
    item.row(format!("Light through the slats, by extinction alone ({VISIBLE})"), panels);
    item.check(
        "clusters that are not isotropic have an error smaller by at least a tenth with directions",
        ratios[..3].iter().map(|r| fixed(*r, 2)).collect::<Vec<_>>().join(", ") + " times",
        ratios[..3].iter().all(|r| *r <= 0.9),
    );
    item.check(
        "the image of the slats has an FBEM smaller by at least a third with directions",
        format!("{} % and {} %", fixed(errors[0], 1), fixed(errors[1], 1)),
        errors[1] < 0.67 * errors[0],
    );
    Ok(item)
}
