//! How work that followed the paper is covered: updates after moves, outdoor scenes.

use super::item::{Item, Panel, VISIBLE};
use super::shadow::Wall;
use super::table::{Cell, Table, count};
use super::{Context, counts_of, fixed, list};
use glam::{DAffine3, DVec3};
use mrvis::Result;
use mrvis::Scene;
use mrvis::internals::radiosity::{self, Options, Visibility};
use mrvis::internals::scene::generate::{self, Spec};
use mrvis::internals::visibility::LeafMode;
use mrvis::internals::{ModelParts, SceneParts};
use mrvis::metrics::{FbemOptions, Image, fbem};
use mrvis::{InstanceChange, Model, PrepareOptions};
use std::sync::Arc;
use std::time::Instant;

/// Feature size of the image of the forest floor, metres.
const SIZE: f64 = 0.25;
/// Side of a texel of it, metres.
const TEXEL: f64 = 0.1;
/// Segments a texel of it.
const SEGMENTS: usize = 64;

/// Links after which solves of the office end, for the statement about steps.
const ENDS: [usize; 3] = [100, 1000, 10_000];
/// Part of the emitted power that a solution may create: rounding errors of 32-bit factors.
const CREATED: f64 = 1e-4;

/// Mechanisms of the later papers, what stands for them here, and the commands that show it; those that `later` shows are tried out.
const COVERED: [[&str; 3]; 6] = [
    [
        "Drettakis and Sillion 1997: a link that is subdivided is kept, with its shaft, to find what a move affects",
        "covered for visibility: only groups of clusters above changed instances are made anew; links are not updated, \
         light is solved again",
        "`mrvis reproduce --only later --out DIR`",
    ],
    [
        "1997: shafts bound what can block a link",
        "covered: a bundle whose shaft is empty is certain without rays",
        "`mrvis reproduce --only later --out DIR`; `mrvis generate office --out office.obj` and `mrvis bench office.obj --out DIR`",
    ],
    [
        "1997: a consistent solution results whatever time is allocated",
        "covered: steps of limited time, an end at any time or number of links, with as much power received as sent",
        "`mrvis reproduce --only later --out DIR`; `mrvis generate office --out office.obj` and \
         `mrvis solve office.obj --step-seconds 0.1 --max-seconds 2 --out DIR`",
    ],
    [
        "Daubert et al. 1997: plants as clusters",
        "covered: leaves as two-sided surfaces, measured extinction, instances of plants; averaged where that takes less time to an error",
        "`mrvis reproduce --only later --out DIR`; `mrvis generate forest --instances --out forest.obj` and \
         `mrvis bench forest.obj --out DIR`",
    ],
    [
        "1997: terrain as a mesh that blocks exactly",
        "covered: large surfaces and terrain are always exact",
        "`make scenes` and `mrvis bench scenes/real/valley.obj --out DIR`",
    ],
    [
        "1997: sky and sun as elements of the hierarchy",
        "not covered: a large panel or a closed box of sky takes their place",
        "`mrvis generate urban-block --out block.obj` and `mrvis solve block.obj --out DIR`",
    ],
];

/// The table, with four of its statements tried out.
pub fn later_papers(context: &Context) -> Result<Item> {
    let mut item = Item {
        here: "What covers the two papers that followed, and where. Three statements are tried out: a tree of a forest of instances is moved, \
               light on the floor of a forest is averaged, and solves of `mrvis generate office` are ended early. Bundles of links that need \
               no triangle are counted."
            .into(),
        ..Item::default()
    };
    let mut table = Table::new("Coverage", &["mechanism", "here", "shown by"]);
    COVERED.iter().for_each(|row| table.push(row.map(Cell::from)));
    item.tables.push(table);
    forest(context, &mut item)?;
    office(context, &mut item)?;
    Ok(item)
}

/// A solution that ended after few links.
struct End {
    links: usize,
    /// Power received less power sent, as a part of what is emitted.
    created: f64,
    /// Root mean square difference of row sums from 1, before and after normalisation.
    row_sums: [f64; 2],
}

/// Solves of the office, a closed room, that end after few links.
fn office(context: &Context, item: &mut Item) -> Result<()> {
    let scene = generate::build(&Spec::new("office"))?;
    let model = Model::prepare(scene, &PrepareOptions::default(), context.progress)?;
    let solve = |max_links: usize, visibility: Visibility| {
        let options = Options { max_links, visibility, local_rays: Some(0), audit: 0, ..Options::default() };
        Ok(radiosity::run(&model, &[], &options, context.progress)?.record)
    };
    let end = |max_links: usize| -> Result<End> {
        let record = solve(max_links, Visibility::Exact)?;
        let ledger = &record.ledger;
        Ok(End {
            links: record.links,
            created: ledger.created / ledger.emitted,
            row_sums: [ledger.row_sum_error_sampled, ledger.row_sum_error],
        })
    };
    judge_ends(item, &ENDS.map(end).into_iter().collect::<Result<Vec<_>>>()?);
    let bundles = solve(ENDS[2], Visibility::Mr)?.bundles;
    let columns = ["answered by", "bundles"];
    let mut table = Table::new(
        format!("Bundles of {} links of the office, multi-resolution visibility", ENDS[2]),
        &columns,
    );
    for (name, n) in [
        ("an empty shaft: no test", bundles.clear),
        ("clusters", bundles.aggregated),
        ("clusters and triangles", bundles.mixed),
        ("triangles", bundles.exact),
    ] {
        table.push([name.into(), count(n as usize)]);
    }
    item.tables.push(table);
    Ok(())
}

/// Whether solutions that end early are consistent.
fn judge_ends(item: &mut Item, ends: &[End]) {
    let links: Vec<usize> = ends.iter().map(|end| end.links).collect();
    let percentages = |of: &dyn Fn(&End) -> f64, digits| {
        list(&ends.iter().map(|end| 100.0 * of(end)).collect::<Vec<_>>(), digits)
    };
    item.check(
        "a solution is consistent whenever it ends: received and sent power are equal, to 0.01 % of what is emitted",
        format!("{} % with {} links", percentages(&|end| end.created, 5), counts_of(&links)),
        !ends.is_empty() && ends.iter().all(|end| end.created.abs() <= CREATED),
        || {
            format!(
                "after normalisation row sums differ from 1 by {} %: one factor for each leaf does not bring all of them to 1",
                percentages(&|end| end.row_sums[1], 2)
            )
        },
    );
    item.check(
        "the form factors of a closed room sum to 1 the better the more links there are: before normalisation the root mean square \
         difference falls from end to end",
        format!("{} % with {} links", percentages(&|end| end.row_sums[0], 1), counts_of(&links)),
        ends.len() > 1
            && ends.windows(2).all(|pair| pair[0].links < pair[1].links && pair[1].row_sums[0] < pair[0].row_sums[0]),
        || "each link has few segments, and as its ends become smaller their noise adds up as much as the links' errors shrink".into(),
    );
}

/// What is found below a tree that was moved.
struct Moved {
    /// Texels of the images, and those that differ between the updated model and one that is prepared anew.
    texels: usize,
    changed: usize,
    prepare_s: f64,
    update_s: f64,
}

/// Images of the light below the crown of a tree.
struct Below {
    /// FBEM of exact rays, and of extinction alone, per cent.
    rays: f64,
    clusters: f64,
    /// Texels that extinction averages, and segments that the engine hands over to exact rays if it may choose, per cent.
    averaged: f64,
    handed_over: f64,
}

/// Smallest part of the texels, per cent, that counts as most of them.
const MIN_AVERAGED: f64 = 50.0;
/// Number of trees of the forest.
const TREES: usize = 1000;
/// The tree that is moved.
const INSTANCE: u32 = TREES as u32 / 2;

/// The floor below the tree.
fn below_tree(model: &Model, small: bool) -> Wall {
    let side = if small { 32 } else { 64 };
    let at = model.instances()[INSTANCE as usize].transform.translation;
    let centre = DVec3::new(at.x, at.y, 0.0) + model.scene().parts().origin.with_z(0.0);
    Wall { centre, right: DVec3::X, up: DVec3::Y, columns: side, rows: side, texel: TEXEL }
}

/// The floor by extinction alone.
fn by_extinction(model: &Model, wall: &Wall) -> Result<Image<'static>> {
    let engine = model.engine(model.widest_packets(), LeafMode::Average).expect("optics");
    Ok(wall.grid(model).by_clusters(&engine, SIZE, (SEGMENTS, 1))?.image)
}

/// A tree of a forest is moved, and light below it averaged.
fn forest(context: &Context, item: &mut Item) -> Result<()> {
    let spec = Spec { instances: true, species: 4, trees: TREES, leaves: 200, ..Spec::new("forest") };
    let scene: Arc<Scene> = Arc::new(generate::build(&spec)?);
    let start = Instant::now();
    let model = Model::prepare(scene.clone(), &PrepareOptions::default(), context.progress)?;
    let prepare_s = start.elapsed().as_secs_f64();
    let transform = DAffine3::from_translation(DVec3::new(0.7, -0.4, 0.0))
        * model.instances()[INSTANCE as usize].transform;
    let start = Instant::now();
    let moved = model.update(&[InstanceChange::Move { instance: INSTANCE, transform }])?;
    let update_s = start.elapsed().as_secs_f64();
    let changed = scene.with_transform(INSTANCE as usize - 1, transform);
    let fresh = Model::prepare(changed, &PrepareOptions::default(), context.progress)?;
    let wall = below_tree(&moved, context.small);
    let [updated, anew] = [by_extinction(&moved, &wall)?, by_extinction(&fresh, &wall)?];
    let changed = updated.data().iter().zip(anew.data()).filter(|(a, b)| a != b).count();
    judge_move(item, &Moved { texels: updated.data().len(), changed, prepare_s, update_s });
    let (below, panels) = light_below(&moved, &wall, &updated)?;
    item.row(format!("Light below the crown of a tree ({VISIBLE})"), panels);
    judge_below(item, &below);
    Ok(())
}

/// Light below the tree by extinction, and by as many rays.
fn light_below(model: &Model, wall: &Wall, clusters: &Image) -> Result<(Below, Vec<Panel>)> {
    let grid = wall.grid(model);
    let exact = grid.by_rays(16 * SEGMENTS, 1, 1)?.image;
    let rays = grid.by_rays(SEGMENTS, 0, 1)?.image;
    let engine = model.engine(model.widest_packets(), LeafMode::Exact).expect("optics");
    let handed_over = grid.handed_over(&grid.with_budget(engine, 0), SIZE, &grid.segments(SEGMENTS, 0));
    let error = |image: &Image| -> Result<f64> {
        Ok(100.0 * fbem(&exact, image, &FbemOptions::default().with_size(SIZE))?.value)
    };
    // Along the same segments clusters answer what rays do unless they are averaged.
    let differs = |(a, b): &(&f32, &f32)| (*a - *b).abs() > 0.5 / SEGMENTS as f32;
    let averaged = clusters.data().iter().zip(rays.data()).filter(differs).count();
    let below = Below {
        rays: error(&rays)?,
        clusters: error(clusters)?,
        averaged: 100.0 * averaged as f64 / rays.data().len() as f64,
        handed_over: 100.0 * handed_over,
    };
    let panels = vec![
        Panel::visible(&exact, format!("{} exact rays", 16 * SEGMENTS)),
        Panel::visible(&rays, format!("{SEGMENTS} exact rays")),
        Panel::visible(clusters, format!("{SEGMENTS} segments, extinction")),
    ];
    Ok((below, panels))
}

/// Whether an update equals a preparation anew, and takes less time.
fn judge_move(item: &mut Item, moved: &Moved) {
    item.check(
        "after a move of one tree answers equal those of a model that is prepared anew, bit by bit",
        format!("{} of {} texels differ", moved.changed, moved.texels),
        moved.texels > 0 && moved.changed == 0,
        || "groups of clusters above the tree are not those of a fresh preparation".into(),
    );
    let [update, prepare] = [moved.update_s, moved.prepare_s].map(|s| fixed(1e3 * s, 1));
    item.check_time(
        "the update takes less time than the preparation",
        format!("{update} ms and {prepare} ms with {TREES} trees"),
        moved.update_s < moved.prepare_s,
        || "most of the preparation is made again".into(),
    );
}

/// Whether extinction averages light below the crown with a small error.
fn judge_below(item: &mut Item, below: &Below) {
    let Below { rays, clusters, averaged, handed_over } = below;
    item.check(
        format!(
            "extinction in clusters of leaves alone averages light below the crown of a tree, in most texels, with no larger FBEM({SIZE} m) \
             than that of as many exact rays, {SEGMENTS}"
        ),
        format!(
            "{} % and {} %, {} % of the texels are averaged; the engine, where it may choose, hands {} % of the segments over to exact rays, \
             which cost less",
            fixed(*clusters, 2),
            fixed(*rays, 2),
            fixed(*averaged, 0),
            fixed(*handed_over, 0)
        ),
        clusters <= rays && *averaged > MIN_AVERAGED,
        || {
            format!(
                "{} % of the texels are averaged at this feature size, and the error differs by {} percentage points from that of rays",
                fixed(*averaged, 1),
                fixed(clusters - rays, 2)
            )
        },
    );
}

#[cfg(test)]
mod tests {
    use super::super::item::failing_checks;
    use super::*;

    #[test]
    fn moves_and_averages_are_judged() {
        let moved = |changed: usize, update_s: f64| {
            failing_checks(|item| judge_move(item, &Moved { texels: 64, changed, prepare_s: 0.1, update_s }))
        };
        assert_eq!(moved(0, 0.01), [0; 0]);
        assert_eq!(moved(1, 0.01), [0]);
        assert_eq!(moved(0, 0.2), [1]);
        for (clusters, averaged, expected) in
            [(4.0, 60.0, vec![]), (6.0, 60.0, vec![0]), (4.0, 40.0, vec![0])]
        {
            let below = Below { rays: 5.0, clusters, averaged, handed_over: 0.0 };
            assert_eq!(failing_checks(|item| judge_below(item, &below)), expected, "{clusters}");
        }
    }

    #[test]
    fn ends_that_are_not_consistent_are_found() {
        let ends = |created: f64, row_sums: f64| {
            let of =
                |links: usize, created: f64, row_sums: f64| End { links, created, row_sums: [row_sums, 0.0] };
            failing_checks(|item| judge_ends(item, &[of(100, 0.0, 0.2), of(1000, created, row_sums)]))
        };
        assert_eq!(ends(1e-6, 0.1), [0; 0]);
        assert_eq!(ends(-2e-4, 0.1), [0]);
        assert_eq!(ends(0.0, 0.3), [1]);
    }
}
