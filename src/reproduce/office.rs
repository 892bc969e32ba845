//! An office, with clusters by three builders: Figures 7 and 8 of the paper.

use super::cells::cell_tree;
use super::item::{Item, Panel, Table, VISIBLE};
use super::plain::{Descent, Leaves, PlainTree, Visits};
use super::shadow::{Rendered, Wall, crop, mean};
use super::{Context, fixed, list};
use crate::Result;
use crate::clusters::{self, Builder};
use crate::metrics::{FbemOptions, Image, fbem};
use crate::model::{Detail, Model, PrepareOptions};
use crate::scene::generate::{self, DESKS, ROOM, Spec};
use glam::DVec3;

/// Side of a texel of the floor, metres: a sixteenth of the depth of a desk.
const TEXEL: f64 = 0.05;
/// Feature size of the errors, metres: the depth of a desk, the smallest extent of the shadows under desks.
const SHADOW: f64 = 0.8;
/// Planar surfaces of the shell of the room, which never block, stay outside the clusters; the tops of desks, with an inscribed
/// disc of 0.08 of the diagonal, do not.
const SHELL: f32 = 0.15;
/// Half of a desk, less a margin for the penumbra of its edges: under it, metres.
const UNDER: [f64; 2] = [0.5, 0.2];

/// Builders that the paper compares.
const BUILDERS: [(Option<Builder>, &str); 4] = [
    (Some(Builder::Grids), "uniform grids (new)"),
    (None, "k-d tree, cells"),
    (Some(Builder::KdTree), "k-d tree, fitted boxes"),
    (Some(Builder::GoldsmithSalmon), "Goldsmith-Salmon"),
];

/// Images of the floor by one builder.
struct Floor {
    name: &'static str,
    clusters: usize,
    rendered: Rendered,
    visits: Visits,
}

/// All floors with one treatment of leaves, and the exact one.
struct Floors {
    exact: Image<'static>,
    by: Vec<Floor>,
}

fn floor(small: bool) -> Wall {
    let texel = if small { 2.0 * TEXEL } else { TEXEL };
    let count = |length: f64| (length / texel).round() as usize;
    let (columns, rows) = (count(ROOM.x), count(ROOM.y));
    Wall { centre: DVec3::ZERO, right: DVec3::X, up: DVec3::Y, columns, rows, texel }
}

impl Floors {
    fn new(
        context: &Context,
        leaves: Leaves,
        builders: &[(Option<Builder>, &'static str)],
    ) -> Result<Floors> {
        let scene = generate::build(&Spec::new("office"))?;
        let model =
            Model::prepare(scene, &PrepareOptions::default().with_detail(Detail::Rays), context.progress)?;
        let grid = floor(context.small).grid(&model);
        let rays = if context.small { 4 } else { 16 };
        let exact = grid.by_rays(if context.small { 32 } else { 256 }, 1, 1)?.image;
        let by = builders.iter().map(|&(builder, name)| {
            let scene = model.scene();
            let options = clusters::Options { builder: builder.unwrap_or_default(), large_surface: SHELL };
            let clusters = clusters::build(scene, &options).micro;
            let clusters = match builder {
                Some(_) => clusters,
                None => cell_tree(scene, &clusters.order),
            };
            let tree = PlainTree::new(scene, &clusters, &[]);
            let repeat = if context.small { 1 } else { 2 };
            let descent = Descent { leaves, sizes: None };
            let (rendered, visits) = grid.by_plain_tree(&tree, |_| descent, (rays, repeat))?;
            Ok(Floor { name, clusters: clusters.clusters.len(), rendered, visits })
        });
        Ok(Floors { exact, by: by.collect::<Result<_>>()? })
    }

    /// Loss of light under the desks, relative to the rest of the floor.
    fn contrast(image: &Image) -> Result<f64> {
        let half = 0.5 * ROOM;
        let texel = |metres: f64| (metres / image.texel()).round() as usize;
        let mut under = 0.0;
        for [x, y] in DESKS {
            let (left, top) = (half.x + x - UNDER[0], half.y - y - UNDER[1]);
            let part = [left, top, left + 2.0 * UNDER[0], top + 2.0 * UNDER[1]].map(texel);
            under += mean(&crop(image, part)?) / DESKS.len() as f64;
        }
        // The middle of the room, between the rows of desks.
        let aisle = [half.x - 3.5, half.y - 0.7, half.x + 1.5, half.y - 0.3].map(texel);
        Ok(1.0 - under / mean(&crop(image, aisle)?))
    }

    fn show(&self, item: &mut Item, title: &str) -> Result<()> {
        let mut panels = vec![Panel::visible(&self.exact, "Embree rays")];
        panels.extend(self.by.iter().map(|f| {
            Panel::visible(&f.rendered.image, format!("{}, {} s", f.name, fixed(f.rendered.seconds, 2)))
        }));
        item.row(format!("{title}: light on the floor, seen from above ({VISIBLE})"), panels);
        let columns = [
            "clusters by",
            "number",
            "seconds",
            "visits per segment",
            "FBEM(0.8 m), %",
            "contrast under desks, %",
        ];
        let mut table = Table::new(title, &columns);
        table.push([
            "Embree rays".into(),
            "".into(),
            "".into(),
            "".into(),
            "0".into(),
            fixed(100.0 * Self::contrast(&self.exact)?, 1),
        ]);
        let segments = self.exact.data().len() as f64 * 6.0;
        for f in &self.by {
            let error =
                fbem(&self.exact, &f.rendered.image, &FbemOptions::default().with_size(SHADOW))?.value;
            table.push([
                f.name.into(),
                f.clusters.to_string(),
                fixed(f.rendered.seconds, 2),
                fixed(f.visits.all() as f64 / segments / 16.0, 1),
                fixed(100.0 * error, 2),
                fixed(100.0 * Self::contrast(&f.rendered.image)?, 1),
            ]);
        }
        item.tables.push(table);
        Ok(())
    }
}

/// What was built instead of the paper's scene.
fn scene_of(polygons: usize) -> String {
    format!(
        "The paper's scene, pieces of the Soda Hall model, is lost; `mrvis generate office` has as many polygons \
         ({polygons}): seven desks with screens, keyboards and small things, chairs, a shelf of books, six panels of light in the \
         ceiling. The clusters of the paper's k-d tree fill its cells; a second one has boxes fitted to their contents. The light that falls straight on the floor is shown, so that no other error hides that of the visibility. \
         Seconds are those of one core."
    )
}

fn polygons() -> Result<usize> {
    Ok(generate::soup(&Spec::new("office"))?.polygons())
}

/// Figure 7: surface visibility, by descents that test triangles.
pub fn figure_7(context: &Context) -> Result<Item> {
    let floors = Floors::new(context, Leaves::Surfaces, &BUILDERS)?;
    let polygons = polygons()?;
    let mut item = Item { here: scene_of(polygons), ..Item::default() };
    floors.show(&mut item, "Surface visibility")?;
    item.check("the scene has the paper's 5,380 polygons", polygons.to_string(), polygons == 5380);
    let errors: Vec<f64> = floors
        .by
        .iter()
        .map(|f| {
            Ok(100.0
                * fbem(&floors.exact, &f.rendered.image, &FbemOptions::default().with_size(SHADOW))?.value)
        })
        .collect::<Result<_>>()?;
    // The noise of as many rays.
    let noise = if context.small { 6.0 } else { 2.0 };
    item.check(
        format!(
            "the quality of the shadows is comparable with all hierarchies: FBEM(0.8 m) of at most {noise} %"
        ),
        list(&errors, 2) + " %",
        errors.iter().all(|e| *e <= noise),
    );
    let [new, kd] = [0, 1].map(|k| floors.by[k].visits.all() as f64);
    item.check(
        "the new hierarchy needs fewer visits than the k-d tree",
        format!("{} times as many with the k-d tree", fixed(kd / new, 2)),
        new < kd,
    );
    let [new, kd] = [0, 1].map(|k| floors.by[k].rendered.seconds);
    item.check_time(
        "the new hierarchy is faster than the k-d tree",
        format!("{} s and {} s", fixed(new, 2), fixed(kd, 2)),
        new < kd,
    );
    Ok(item)
}

/// Figure 8: average visibility, by extinction alone.
pub fn figure_8(context: &Context) -> Result<Item> {
    let floors = Floors::new(context, Leaves::Extinction, &BUILDERS)?;
    let mut item = Item { here: scene_of(polygons()?), ..Item::default() };
    floors.show(&mut item, "Average visibility by extinction")?;
    let exact = Floors::contrast(&floors.exact)?;
    let [new, kd] = [0, 1].map(|k| Floors::contrast(&floors.by[k].rendered.image));
    let (new, kd) = (new?, kd?);
    item.check(
        "the k-d tree loses the shadows under the desks: less than half of their contrast is left",
        format!("contrast {} % of {} %", fixed(100.0 * kd, 1), fixed(100.0 * exact, 1)),
        kd < 0.5 * exact,
    );
    item.check(
        "the new hierarchy keeps them: more than half of their contrast is left",
        format!("contrast {} % of {} %", fixed(100.0 * new, 1), fixed(100.0 * exact, 1)),
        new > 0.5 * exact,
    );
    let surfaces = Floors::new(context, Leaves::Surfaces, &BUILDERS[..1])?;
    let [average, surface] = [&floors, &surfaces].map(|floors| floors.by[0].rendered.seconds);
    item.check_time(
        "average visibility is faster than surface visibility with the new hierarchy",
        format!("{} times, four times in the paper", fixed(surface / average, 2)),
        average < surface,
    );
    Ok(item)
}
