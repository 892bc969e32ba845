//! An office, with clusters by three builders: Figures 7 and 8 of the paper.

use super::item::{Item, Panel, Table, VISIBLE, count, number};
use super::office_light::{InRadiosity, SHELL, contrast};
use super::office_verdict::{self, Contrasts, Cost};
use super::plain::{Descent, Leaves, PlainTree, Visits, cell_tree};
use super::shadow::{Rendered, Wall};
use super::{Context, counts_of, fixed, office_light};
use glam::DVec3;
use mrvis::internals::clusters;
use mrvis::internals::scene::generate::{self, ROOM, Spec};
use mrvis::metrics::{FbemOptions, Image, fbem};
use mrvis::{Builder, Detail, Engine, Result};

/// Side of a texel of the floor, metres: a sixteenth of the depth of a desk.
const TEXEL: f64 = 0.05;
/// Feature size of the errors, metres: the depth of a desk, the smallest extent of the shadows under desks.
const SHADOW: f64 = 0.8;
/// Builders that the paper compares; the k-d tree with clusters that fill its cells, and with fitted boxes.
const BUILDERS: [(Option<Builder>, &str); 4] = [
    (Some(Builder::Grids), "uniform grids (new)"),
    (None, "k-d tree, cells"),
    (Some(Builder::KdTree), "k-d tree, fitted boxes"),
    (Some(Builder::GoldsmithSalmon), "Goldsmith-Salmon"),
];

/// Difference of two values of texels that rounding alone can make; a segment of the smallest panel makes a larger one.
const ROUNDING: f32 = 1e-4;
/// Panels of light in the ceiling of the office.
const PANELS: usize = 6;

/// Images of the floor by one builder.
struct Floor {
    name: &'static str,
    clusters: usize,
    /// Triangles of the leaf that holds most of them.
    largest_leaf: usize,
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
        let model = context.model(scene, Detail::Rays)?;
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
            let (rendered, visits) = grid.by_plain_tree(&tree, |_| descent, rays, repeat)?;
            let leaves = clusters.clusters.iter().filter(|cluster| cluster.is_leaf());
            let largest_leaf = leaves.map(|leaf| leaf.triangles as usize).max().unwrap_or(0);
            Ok(Floor { name, clusters: clusters.clusters.len(), largest_leaf, rendered, visits })
        });
        Ok(Floors { rays, exact, sampled, by: by.collect::<Result<_>>()? })
    }

    fn fbem(&self, image: &Image) -> Result<f64> {
        Ok(100.0 * fbem(&self.exact, image, &[SHADOW], &FbemOptions::default())?[0].value)
    }

    /// From each texel to points of all panels.
    fn visits_per_segment(&self, floor: &Floor) -> f64 {
        floor.visits.all() as f64 / (self.exact.data().len() * PANELS * self.rays) as f64
    }

    /// Contrasts under the desks, exact and by builder.
    fn contrasts(&self, in_radiosity: InRadiosity) -> Result<Contrasts> {
        let by = self.by.iter().map(|floor| contrast(&floor.rendered.image)).collect::<Result<Vec<_>>>()?;
        Ok(Contrasts { exact: contrast(&self.exact)?, by, in_radiosity })
    }

    /// Visits per segment, seconds and triangles of the largest leaf by a builder.
    fn cost(&self, builder: usize) -> Cost {
        let floor = &self.by[builder];
        Cost {
            visits: self.visits_per_segment(floor),
            seconds: floor.rendered.seconds,
            largest_leaf: floor.largest_leaf,
        }
    }

    /// Texels by which an image differs from exact rays along the same segments.
    fn differing(&self, floor: &Floor) -> usize {
        let pairs = floor.rendered.image.data().iter().zip(self.sampled.data());
        pairs.filter(|(a, b)| (*a - *b).abs() > ROUNDING).count()
    }

    fn show(&self, item: &mut Item, title: &str) -> Result<()> {
        let mut panels = vec![Panel::visible(&self.exact, "Embree rays")];
        panels.extend(self.by.iter().map(|f| {
            Panel::visible(&f.rendered.image, format!("{}, {}\u{a0}s", f.name, fixed(f.rendered.seconds, 2)))
        }));
        item.row(format!("{title}: light on the floor, seen from above ({VISIBLE})"), panels);
        let columns = "clusters by | number | triangles of the largest leaf | time, s | visits per segment | FBEM(0.8 m), % | \
             contrast under desks, %";
        let mut table = Table::new(title, columns);
        table.push([
            "Embree rays".into(),
            "".into(),
            "".into(),
            "".into(),
            "".into(),
            number(0.0, 0),
            number(100.0 * contrast(&self.exact)?, 1),
        ]);
        for f in &self.by {
            table.push([
                f.name.into(),
                count(f.clusters),
                count(f.largest_leaf),
                number(f.rendered.seconds, 2),
                number(self.visits_per_segment(f), 1),
                number(self.fbem(&f.rendered.image)?, 2),
                number(100.0 * contrast(&f.rendered.image)?, 1),
            ]);
        }
        item.tables.push(table);
        Ok(())
    }
}

/// Description of the scene that replaces the paper's.
fn scene_of(polygons: usize) -> String {
    format!(
        "The paper's scene, pieces of the Soda Hall model, is lost; `mrvis generate office` has as many polygons \
         ({polygons}): seven desks with screens, keyboards and small things, chairs, a shelf of books, six panels of light in the \
         ceiling. The clusters of the paper's k-d tree fill its cells; as we read Sillion 94, triangles that a plane cuts are not divided \
         further and make one leaf. A second k-d tree divides them by the other axes and has boxes fitted to their contents. \
         The light that falls straight on the floor is shown, so that no other error hides that of the visibility; \
         its seconds are those of one core. Radiosity solutions take their visibility from the engines, whose boxes are always \
         fitted to their contents: cells that a k-d tree fills are not among them."
    )
}

fn polygons() -> Result<usize> {
    Ok(generate::soup(&Spec::new("office"))?.polygons())
}

/// Figure 7: surface visibility, by descents that test triangles.
pub fn figure_7(context: &Context) -> Result<Item> {
    let floors = Floors::new(context, Leaves::Surfaces, &BUILDERS)?;
    let polygons = polygons()?;
    let mut item = Item::of(scene_of(polygons));
    floors.show(&mut item, "Surface visibility")?;
    item.check("the scene has the paper's 5,380 polygons", polygons.to_string(), polygons == 5380, || {
        "`mrvis generate office` makes other things".into()
    });
    let differing: Vec<usize> = floors.by.iter().map(|floor| floors.differing(floor)).collect();
    item.check(
        "surface visibility tests triangles, so that light straight on the floor is that of exact rays along the same segments with every \
         hierarchy: less than 0.1 % of the texels differ",
        format!("{} of {} texels", counts_of(&differing), floors.exact.data().len()),
        differing.iter().all(|&n| 1000 * n < floors.exact.data().len()),
        || "segments miss or meet triangles at their edges otherwise than Embree's rays, or clusters do not hold all triangles".into(),
    );
    let in_radiosity = office_light::show(&mut item, Engine::Exact, context)?;
    office_verdict::judge_quality(&mut item, &in_radiosity);
    office_verdict::judge_surface_speed(&mut item, floors.cost(0), [floors.cost(1), floors.cost(2)]);
    Ok(item)
}

/// Figure 8: average visibility, by extinction alone.
pub fn figure_8(context: &Context) -> Result<Item> {
    let floors = Floors::new(context, Leaves::Extinction, &BUILDERS)?;
    let mut item = Item::of(
        "The scene and the builders of Figure 7, `mrvis generate office`. Seven desk tops, thin closed boxes, hide the floor from \
               some of the panels only, so that parts of their contrast are compared: extinction takes 1 − e^(−1/2) = 39 % off the light that a \
               desk top in a cluster of its own hides, because along the shortest edge t of a thin closed box of area 2A κ t is \
               2A t / (4 A t) = 1/2.",
    );
    floors.show(&mut item, "Average visibility by extinction")?;
    let in_radiosity = office_light::show(&mut item, Engine::Average, context)?;
    office_verdict::judge_shadows(&mut item, &floors.contrasts(in_radiosity)?);
    let surfaces = Floors::new(context, Leaves::Surfaces, &BUILDERS[..1])?;
    let costs = [floors.cost(0), floors.cost(1), surfaces.cost(0)];
    office_verdict::judge_average_speed(&mut item, costs);
    Ok(item)
}
