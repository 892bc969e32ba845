//! An office, with clusters by three builders: Figures 7 and 8 of the paper.

use super::cells::cell_tree;
use super::desks::{SHELL, contrast};
use super::item::{Item, Panel, Table, VISIBLE};
use super::plain::{Descent, Leaves, PlainTree, Visits};
use super::shadow::{Rendered, Wall};
use super::{Context, fixed, list, office_light};
use crate::Result;
use crate::clusters::{self, Builder};
use crate::metrics::{FbemOptions, Image, fbem};
use crate::model::{Detail, Model, PrepareOptions};
use crate::radiosity::Visibility;
use crate::scene::generate::{self, ROOM, Spec};
use glam::DVec3;

/// Side of a texel of the floor, metres: a sixteenth of the depth of a desk.
const TEXEL: f64 = 0.05;
/// Feature size of the errors, metres: the depth of a desk, the smallest extent of the shadows under desks.
const SHADOW: f64 = 0.8;
/// Contrast of a shadow that counts as missing: the default threshold of shadows of the feature-based error.
const NO_SHADOW: f64 = 0.02;
/// By what average visibility is faster than surface visibility in the paper [SD95 sec 4.2].
const PAPER_GAIN: f64 = 4.0;
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
    rays: usize,
    exact: Image<'static>,
    /// Exact rays, the same as those that descend the trees.
    sampled: Image<'static>,
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
        let exact = grid.by_rays(if context.small { 32 } else { 128 }, 1, 1)?.image;
        let sampled = grid.by_rays(rays, 0, 1)?.image;
        let by = builders.iter().map(|&(builder, name)| {
            let scene = model.scene();
            let options = clusters::Options { builder: builder.unwrap_or_default(), large_surface: SHELL };
            let clusters = clusters::build(scene, &options).micro;
            let clusters = match builder {
                Some(_) => clusters,
                None => cell_tree(scene, &clusters.order),
            };
            let tree = PlainTree::new(scene, &clusters, &[]);
            // The times of surface visibility are far apart.
            let repeat = if context.small || leaves == Leaves::Surfaces { 1 } else { 2 };
            let descent = Descent { leaves, sizes: None };
            let (rendered, visits) = grid.by_plain_tree(&tree, |_| descent, (rays, repeat))?;
            Ok(Floor { name, clusters: clusters.clusters.len(), rendered, visits })
        });
        Ok(Floors { rays, exact, sampled, by: by.collect::<Result<_>>()? })
    }

    fn fbem(&self, image: &Image) -> Result<f64> {
        Ok(100.0 * fbem(&self.exact, image, &FbemOptions::default().with_size(SHADOW))?.value)
    }

    /// From each texel to points of six panels.
    fn visits_per_segment(&self, floor: &Floor) -> f64 {
        floor.visits.all() as f64 / (self.exact.data().len() * 6 * self.rays) as f64
    }

    fn show(&self, item: &mut Item, title: &str) -> Result<()> {
        let mut panels = vec![Panel::visible(&self.exact, "Embree rays")];
        panels.extend(self.by.iter().map(|f| {
            Panel::visible(&f.rendered.image, format!("{}, {}\u{a0}s", f.name, fixed(f.rendered.seconds, 2)))
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
            fixed(100.0 * contrast(&self.exact)?, 1),
        ]);
        for f in &self.by {
            table.push([
                f.name.into(),
                f.clusters.to_string(),
                fixed(f.rendered.seconds, 2),
                fixed(self.visits_per_segment(f), 1),
                fixed(self.fbem(&f.rendered.image)?, 2),
                fixed(100.0 * contrast(&f.rendered.image)?, 1),
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
         ceiling. The clusters of the paper's k-d tree fill its cells; a second one has boxes fitted to their contents. \
         The light that falls straight on the floor is shown, so that no other error hides that of the visibility; \
         its seconds are those of one core. Radiosity solutions take their visibility from the engines, whose boxes are always \
         fitted to their contents: cells that a k-d tree fills are not among them."
    )
}

fn percentages(parts: &[f64]) -> String {
    list(&parts.iter().map(|part| 100.0 * part).collect::<Vec<_>>(), 1)
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
    let errors: Vec<f64> = floors.by.iter().map(|f| floors.fbem(&f.rendered.image)).collect::<Result<_>>()?;
    let noise = floors.fbem(&floors.sampled)?;
    item.check(
        "the quality of the shadows is comparable with all hierarchies: FBEM(0.8 m) is that of as many exact rays, to 0.1 %",
        format!("{} %, rays {} %", list(&errors, 2), fixed(noise, 2)),
        errors.iter().all(|e| (e - noise).abs() <= 0.1),
    );
    let [new, kd] = [0, 1].map(|k| floors.by[k].visits.all() as f64);
    item.check(
        "the new hierarchy needs fewer visits than the k-d tree",
        format!("{} times as many with the k-d tree", fixed(kd / new, 2)),
        new < kd,
    );
    let contrasts = office_light::show(&mut item, Visibility::Exact, context)?;
    let exact = contrast(&floors.exact)?;
    item.check(
        "in radiosity solutions, too, surface visibility shows the shadows under the desks: more than half of their contrast",
        format!("contrast {} % of {} %", percentages(&contrasts), fixed(100.0 * exact, 1)),
        contrasts.iter().all(|contrast| *contrast > 0.5 * exact),
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
    let exact = contrast(&floors.exact)?;
    let [new, kd] = [0, 1].map(|k| contrast(&floors.by[k].rendered.image));
    let (new, kd) = (new?, kd?);
    item.check(
        format!(
            "shadows are completely missing from under the desks with the k-d tree: their contrast is below the threshold of a shadow, {} %",
            fixed(100.0 * NO_SHADOW, 0)
        ),
        format!(
            "contrast {} %: cells darken whole rows of desks, without their outlines, but do not lose all of the extinction there",
            fixed(100.0 * kd, 1)
        ),
        kd < NO_SHADOW,
    );
    let kept = 1.0 - (-0.5f64).exp();
    let measured =
        |found: f64| format!("contrast {} % of {} %", fixed(100.0 * found, 1), fixed(100.0 * exact, 1));
    // Along the shortest edge t of a thin closed box κ t = 2A t / (4 A t) = 1/2.
    item.check(
        format!(
            "the k-d tree is not suited to the extinction model: it keeps less of their contrast with the floor around than 1 − e^(−1/2) = {} %, \
             which extinction keeps of a desk top in a cluster of its own",
            fixed(100.0 * kept, 0)
        ),
        measured(kd),
        kd < kept * exact,
    );
    item.check(
        "the new hierarchy represents the shadows: it keeps at least that part of their contrast",
        measured(new),
        new >= kept * exact,
    );
    let contrasts = office_light::show(&mut item, Visibility::Average, context)?;
    item.check(
        "a radiosity solution with the new hierarchy and average visibility keeps them, too",
        measured(contrasts[0]),
        contrasts[0] >= kept * exact,
    );
    let surfaces = Floors::new(context, Leaves::Surfaces, &BUILDERS[..1])?;
    let [average, surface] = [&floors, &surfaces].map(|floors| floors.by[0].rendered.seconds);
    let [work, exact_work] = [&floors, &surfaces].map(|floors| floors.visits_per_segment(&floors.by[0]));
    item.check_time(
        format!("average visibility is faster than surface visibility with the new hierarchy, by at least the paper's factor of {PAPER_GAIN}"),
        format!(
            "{} times: a segment visits {} clusters on average, and {} clusters and triangles with surface visibility, which ends at the \
             first hit",
            fixed(surface / average, 2),
            fixed(work, 1),
            fixed(exact_work, 1)
        ),
        PAPER_GAIN * average <= surface,
    );
    Ok(item)
}
