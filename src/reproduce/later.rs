//! How work that followed the paper is covered: updates after moves, outdoor scenes.

use super::item::Item;
use super::shadow::Wall;
use super::table::{Cell, Table};
use super::{Context, counts_of, fixed, list};
use crate::Result;
use crate::metrics::{FbemOptions, Image, fbem};
use crate::model::{InstanceChange, Model, PrepareOptions};
use crate::radiosity::{self, Options, Visibility};
use crate::scene::Scene;
use crate::scene::generate::{self, Spec};
use crate::visibility::LeafMode;
use glam::{DAffine3, DVec3};
use std::sync::Arc;
use std::time::Instant;

/// Feature size of the image of the forest floor, metres.
const SIZE: f64 = 0.25;
/// Segments a texel of it.
const SEGMENTS: usize = 64;

/// Links after which solves of the office end, for the statement about steps.
const ENDS: [usize; 3] = [100, 1000, 10_000];
/// Part of the emitted power to which the ledger of a consistent solution balances: sums of 32-bit factors.
const BALANCED: f64 = 1e-4;

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
        "covered: steps of limited time, an end at any time or number of links",
        "`mrvis reproduce --only later --out DIR`; `mrvis generate office --out office.obj` and \
         `mrvis solve office.obj --step-seconds 0.1 --max-seconds 2 --out DIR`",
    ],
    [
        "Daubert et al. 1997: plants as clusters",
        "covered: leaves as two-sided surfaces, measured extinction, instances of plants",
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
        here: "What covers the two papers that followed, and where. Four statements are tried out: a tree of a forest of instances is moved, \
               light on the floor of a forest is averaged, solves of `mrvis generate office` are ended early, and bundles of links that need no \
               triangle are counted."
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

/// Solves of the office that end after few links.
fn office(context: &Context, item: &mut Item) -> Result<()> {
    let scene = generate::build(&Spec::new("office"))?;
    let model = Model::prepare(scene, &PrepareOptions::default(), context.progress)?;
    let solve = |max_links: usize, visibility: Visibility| {
        let options = Options { max_links, visibility, local_rays: Some(0), audit: 0, ..Options::default() };
        Ok(radiosity::run(&model, &[], &options, context.progress)?.record)
    };
    let (mut gaps, mut links) = (Vec::new(), Vec::new());
    for max_links in ENDS {
        let record = solve(max_links, Visibility::Exact)?;
        let ledger = &record.ledger;
        let gap = ledger.emitted + ledger.created - ledger.absorbed - ledger.escaped;
        gaps.push(100.0 * gap.abs() / ledger.emitted);
        links.push(record.links);
    }
    item.check(
        "a solution is consistent whenever it ends: emitted and created power is absorbed or escapes, to 0.01 % of what is emitted",
        format!("{} % with {} links", list(&gaps, 5), counts_of(&links)),
        gaps.iter().all(|gap| *gap <= 100.0 * BALANCED) && links.windows(2).all(|pair| pair[0] < pair[1]),
    );
    let bundles = solve(ENDS[2], Visibility::Mr)?.bundles;
    let all = bundles.clear + bundles.exact + bundles.aggregated + bundles.mixed;
    item.check(
        "bundles whose shafts are empty spare tests of triangles",
        format!("{} of {all} bundles of links with multi-resolution visibility need none", bundles.clear),
        bundles.clear > 0,
    );
    Ok(())
}

/// A tree of a forest is moved, and light below it averaged.
fn forest(context: &Context, item: &mut Item) -> Result<()> {
    let trees = if context.small { 100 } else { 1000 };
    let spec = Spec { instances: true, species: 4, trees, leaves: 200, ..Spec::new("forest") };
    let scene: Arc<Scene> = Arc::new(generate::build(&spec)?);
    let start = Instant::now();
    let model = Model::prepare(scene.clone(), &PrepareOptions::default(), context.progress)?;
    let prepare_s = start.elapsed().as_secs_f64();
    let instance = trees as u32 / 2;
    let transform = DAffine3::from_translation(DVec3::new(0.7, -0.4, 0.0))
        * model.instances()[instance as usize].transform;
    let start = Instant::now();
    let moved = model.update(&[InstanceChange::Move { instance, transform }])?;
    let update_s = start.elapsed().as_secs_f64();
    let mut changed = (*scene).clone();
    changed.placements[instance as usize - 1].transform = transform;
    let fresh = Model::prepare(changed, &PrepareOptions::default(), context.progress)?;
    let image = |model: &Model| -> Result<_> {
        let at = model.instances()[instance as usize].transform.translation;
        let wall = Wall {
            centre: DVec3::new(at.x, at.y, 0.0) + model.scene().origin.with_z(0.0),
            right: DVec3::X,
            up: DVec3::Y,
            columns: 64,
            rows: 64,
            texel: 0.1,
        };
        let grid = wall.grid(model);
        let engine = model.engine(model.widest_packets(), LeafMode::Exact).expect("optics");
        let by_clusters = grid.by_clusters(&grid.with_budget(engine), SIZE, (SEGMENTS, 1))?.image;
        Ok([by_clusters, grid.by_rays(16 * SEGMENTS, 1, 1)?.image, grid.by_rays(SEGMENTS, 0, 1)?.image])
    };
    let [updated, exact, rays] = image(&moved)?;
    let [anew, ..] = image(&fresh)?;
    item.check(
        "after a move of one tree answers equal those of a model that is prepared anew, bit by bit",
        format!("{} texels", updated.data().len()),
        updated.data() == anew.data(),
    );
    item.check_time(
        "the update takes less time than the preparation",
        format!("{} ms and {} ms with {trees} trees", fixed(1e3 * update_s, 1), fixed(1e3 * prepare_s, 1)),
        update_s < prepare_s,
    );
    let error = |image: &Image| -> Result<f64> {
        Ok(100.0 * fbem(&exact, image, &FbemOptions::default().with_size(SIZE))?.value)
    };
    // Along the same segments clusters answer what rays do unless they are averaged.
    let averaged = updated
        .data()
        .iter()
        .zip(rays.data())
        .filter(|(a, b)| (*a - *b).abs() > 0.5 / SEGMENTS as f32)
        .count();
    let averaged = averaged as f64 / rays.data().len() as f64;
    let (error, noise) = (error(&updated)?, error(&rays)?);
    let check = item.check(
        format!("light below the crown of a tree is averaged with no larger FBEM({SIZE} m) than that of as many exact rays, {SEGMENTS}"),
        format!("{} % and {} %; {} % of the texels differ from those of rays", fixed(error, 2), fixed(noise, 2), fixed(100.0 * averaged, 0)),
        error <= noise && averaged > 0.0,
    );
    check.if_not(|| match averaged {
        0.0 => "the engine answers by exact rays wherever they cost less".into(),
        _ => format!("the error is larger by {} percentage points", fixed(error - noise, 2)),
    });
    Ok(())
}
