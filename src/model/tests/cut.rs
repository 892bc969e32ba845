//! The distance cut of a model: its correction, where it is used, and that placed meshes and rooms do without.

use super::*;
use crate::bench::workload::{Workload, surface_points};
use crate::ray::Packet;
use crate::visibility::{Answer, MultiResolution, Route};

fn flat(name: &str, trees: usize, leaves: usize) -> Model {
    let spec = Spec { trees, leaves, ..Spec::new(name) };
    model(&generate::build(&spec).expect(name), Detail::Optics)
}

/// Receivers on the ground and exact fractions of 2,048 rays.
fn ground(model: &Model, points: usize) -> (Workload, Vec<f32>) {
    let points = surface_points(model, points, 1).expect("points");
    let ground = points.into_iter().filter(|p| p.position.z < 0.01 && p.normal.z > 0.9).collect();
    let workload = Workload::new(model, ground, 1);
    let (exact, mut blocked) = (model.exact(), Vec::new());
    let reference = |pair: usize| {
        let packets = segments(model, &workload, pair, 2048, 1);
        exact.answer(bundle(&workload, pair, &packets), &mut blocked).transmittance
    };
    let truths = (0..workload.pairs.len()).map(reference).collect();
    (workload, truths)
}

fn segments(model: &Model, workload: &Workload, pair: usize, rays: usize, stream: u64) -> Vec<Packet> {
    let mut packets = Vec::new();
    workload.add_bundle(model.scene(), pair, rays, stream, &mut packets);
    packets
}

fn bundle<'a>(workload: &'a Workload, pair: usize, packets: &'a [Packet]) -> Bundle<'a> {
    Bundle {
        packets,
        emitter_size: workload.pairs[pair].emitter_size,
        emitter: workload.hull_of_surface(pair),
    }
}

/// Answers of an engine to all pairs of a workload.
fn answers(engine: &MultiResolution, model: &Model, workload: &Workload, rays: usize, s: f32) -> Vec<Answer> {
    let mut workspace = Workspace::default();
    let answer = |pair: usize| {
        let packets = segments(model, workload, pair, rays, 0);
        engine.answer(bundle(workload, pair, &packets), s, &mut workspace)
    };
    (0..workload.pairs.len()).map(answer).collect()
}

fn with_cut(model: &Model, mode: usize) -> MultiResolution {
    let cut = model.cut().expect("a cut");
    model.multi_resolution().expect("optics").clone().with_cut(Some(cut)).with_route(Route::Cut(mode))
}

/// On the ground of a forest the cut answers without bias and with intervals that hold about as often as they state, in every mode and at
/// any number of segments, and the same at any feature size, which it does not know.
#[test]
fn ground_of_a_forest_is_answered_by_the_cut() {
    let model = flat("forest", 36, 800);
    let (workload, truths) = ground(&model, 3500);
    for (mode, rays) in (0..model.cut().expect("a cut").modes().len()).zip([16, 64, 256, 16]) {
        let engine = with_cut(&model, mode);
        let [found, others @ ..] = [0.05, 1.0].map(|s| answers(&engine, &model, &workload, rays, s));
        let n = found.len() as f64;
        let errors = || (0..found.len()).map(|k| f64::from(found[k].transmittance - truths[k]));
        let (bias, rms) = (errors().sum::<f64>() / n, (errors().map(|e| e * e).sum::<f64>() / n).sqrt());
        // Stratified, the fractions of 2,048 rays err by a tenth of these answers or less.
        let holds = |&k: &usize| (found[k].lo..=found[k].hi).contains(&truths[k]);
        let held = (0..found.len()).filter(holds).count() as f64 / n;
        assert!(others[0].iter().zip(&found).all(|(a, b)| same(a, b)));
        let averaged = found.iter().filter(|a| a.cost.aggregated > 0).count() as f64 / n;
        assert!(averaged > 0.5, "mode {mode}: {averaged:.3} of the answers average");
        // The mean of the pilot is known to 0.003, twice a standard error; and so is the mean of these receivers.
        let error = 2.0 * rms / n.sqrt();
        assert!(bias.abs() < 0.003 + error, "mode {mode}: bias {bias:+.4}, by chance {error:.4}");
        assert!((0.90..=0.99).contains(&held), "mode {mode}: {held:.3} of the intervals hold");
        assert!(found.iter().all(|a| 0.0 <= a.lo && a.lo <= a.transmittance && a.transmittance <= a.hi));
    }
}

fn same(a: &Answer, b: &Answer) -> bool {
    [a.transmittance, a.lo, a.hi].map(f32::to_bits) == [b.transmittance, b.lo, b.hi].map(f32::to_bits)
}

/// The correction and the routes are those of the scene, whatever the number of threads.
#[test]
fn threads_change_no_answer_of_the_cut() {
    let scene = std::sync::Arc::new(crate::scene::testing::forest(16, 500));
    let found = |threads: usize| {
        let options = crate::model::PrepareOptions { threads, ..crate::model::PrepareOptions::default() };
        let model = Model::prepare(scene.clone(), &options).expect("a model");
        let points = surface_points(&model, 500, 1).expect("points");
        let workload = Workload::new(&model, points, 1);
        model.on_threads(|| answers(&with_cut(&model, 0), &model, &workload, 16, 0.1)).expect("threads")
    };
    let (one, two) = (found(1), found(2));
    assert!(one.len() > 100 && one.iter().zip(&two).all(|(a, b)| same(a, b)));
}

/// Rooms have no receivers for which it pays: nothing is kept, and answers are those of walks. Nor have models with placed meshes.
#[test]
fn placed_meshes_and_rooms_do_without_the_cut() {
    assert!(model(&forest(), Detail::Optics).cut().is_none());
    assert!(flat("desk-room", 36, 800).cut().is_none());
}
