//! How work that followed the paper is covered: updates after moves, outdoor scenes.

use super::item::{Item, Table};
use super::shadow::Wall;
use super::{Context, fixed};
use crate::Result;
use crate::metrics::{FbemOptions, Image, fbem};
use crate::model::{InstanceChange, Model, PrepareOptions};
use crate::scene::Scene;
use crate::scene::generate::{self, Spec};
use crate::visibility::LeafMode;
use glam::{DAffine3, DVec3};
use std::sync::Arc;
use std::time::Instant;

/// Feature size of the image of the forest floor, metres, and segments a texel.
const SIZE: f64 = 0.25;
const SEGMENTS: usize = 64;

/// Mechanisms of the later papers, what stands for them here, and the command or function that shows it.
const COVERED: [[&str; 3]; 6] = [
    [
        "Drettakis and Sillion 1997: a link that is subdivided is kept, with its shaft, to find what a move affects",
        "covered for visibility: only groups of clusters above changed instances are made anew; links are not updated, \
         light is solved again",
        "Model::update in Rust, mrvis_model_update in C, Model.update in Python",
    ],
    [
        "1997: shafts bound what can block a link",
        "covered: a bundle whose shaft is empty, or that one triangle covers, is certain without rays",
        "mrvis bench (certificates)",
    ],
    [
        "1997: a consistent solution results whatever time is allocated",
        "covered: steps of limited time, interruption at any time",
        "mrvis solve with options `step_seconds` and `max_seconds`",
    ],
    [
        "Daubert et al. 1997: plants as clusters",
        "covered: leaves as two-sided surfaces, measured extinction, instances of plants",
        "mrvis generate forest with option `instances`, mrvis bench",
    ],
    [
        "1997: terrain as a mesh that blocks exactly",
        "covered: large surfaces and terrain are always exact",
        "make scenes (valley), mrvis bench",
    ],
    [
        "1997: sky and sun as elements of the hierarchy",
        "not covered: a large panel or a closed box of sky takes their place",
        "mrvis solve on generate urban-block",
    ],
];

/// The table, with two of its statements tried out.
pub fn later_papers(context: &Context) -> Result<Item> {
    let mut item = Item {
        here: "What covers the two papers that followed, and where. Two statements are tried out: a tree of a forest of instances is moved, and \
               light on the floor of a forest is averaged."
            .into(),
        ..Item::default()
    };
    let mut table = Table::new("Coverage", &["mechanism", "here", "shown by"]);
    COVERED.iter().for_each(|row| table.push(row.map(String::from)));
    item.tables.push(table);
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
    item.check(
        format!("light below the crown of a tree is averaged with no larger FBEM({SIZE} m) than that of as many exact rays, {SEGMENTS}"),
        format!("{} % and {} %; {} % of the texels differ from those of rays", fixed(error, 2), fixed(noise, 2), fixed(100.0 * averaged, 0)),
        error <= noise && averaged > 0.0,
    );
    Ok(item)
}
