//! The distance cut of a model: its correction, where it is used, and that placed meshes and rooms do without.

use super::*;
use crate::bench::workload::{Order, Workload, surface_points};
use crate::ray::Packet;
use crate::visibility::{Answer, Method, MultiResolution};

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
    let truth = |pair: usize| {
        let packets = segments(model, &workload, pair, (2048, 1));
        exact.answer(bundle(&workload, pair, &packets), &mut blocked).transmittance
    };
    let truths = (0..workload.pairs.len()).map(truth).collect();
    (workload, truths)
}

fn segments(model: &Model, workload: &Workload, pair: usize, (rays, stream): (usize, u64)) -> Vec<Packet> {
    let mut packets = Vec::new();
    workload.add_bundle(model.scene(), pair, (rays, Order::Near), stream, &mut packets);
    packets
}

fn bundle<'a>(workload: &'a Workload, pair: usize, packets: &'a [Packet]) -> Bundle<'a> {
    Bundle { packets, emitter_size: workload.pairs[pair].emitter_size, emitter: workload.hull(pair) }
}

/// Answers of an engine to all pairs of a workload.
fn answers(
    engine: &MultiResolution,
    (model, workload): (&Model, &Workload),
    (rays, s): (usize, f32),
) -> Vec<Answer> {
    let mut workspace = Workspace::default();
    let answer = |pair: usize| {
        let packets = segments(model, workload, pair, (rays, 0));
        engine.answer(bundle(workload, pair, &packets), s, &mut workspace)
    };
    (0..workload.pairs.len()).map(answer).collect()
}

fn with_cut(model: &Model) -> MultiResolution {
    let cut = model.cut().expect("a cut");
    model.multi_resolution().expect("optics").clone().with_cut(Some(cut))
}

/// On the ground of a forest the cut answers most receivers: without bias, with errors below those of as many rays, and intervals that
/// hold about as often as they state, at any number of segments; and the same answers at any feature size, which it does not know.
#[test]
fn ground_of_a_forest_is_answered_by_the_cut() {
    let model = flat("forest", 36, 800);
    let (workload, truths) = ground(&model, 6000);
    let engine = with_cut(&model);
    for rays in [16, 64, 256] {
        let sizes = [0.05, 0.2, 1.0];
        let [found, others @ ..] = sizes.map(|s| answers(&engine, (&model, &workload), (rays, s)));
        let by_cut: Vec<usize> = (0..found.len())
            .filter(|&k| matches!(found[k].method, Method::Aggregated | Method::Mixed))
            .filter(|&k| others.iter().all(|other| same(&found[k], &other[k])))
            .collect();
        let n = by_cut.len() as f64;
        let errors = || by_cut.iter().map(|&k| f64::from(found[k].transmittance - truths[k]));
        let (bias, rms) = (errors().sum::<f64>() / n, (errors().map(|e| e * e).sum::<f64>() / n).sqrt());
        let noise = |k: usize| truths[k] * (1.0 - truths[k]) / 2048.0;
        let holds = |&&k: &&usize| {
            let (a, margin) = (&found[k], 2.0 * noise(k).sqrt());
            a.lo - margin <= truths[k] && truths[k] <= a.hi + margin
        };
        let held = by_cut.iter().filter(holds).count() as f64 / n;
        assert!(n > 0.5 * found.len() as f64, "{rays} segments: {n} of {} by the cut", found.len());
        // The mean of the pilot is known to 0.003, twice a standard error; and so is the mean of these receivers.
        let error = 2.0 * rms / n.sqrt();
        assert!(bias.abs() < 0.003 + error, "{rays} segments: bias {bias:+.4}, by chance {error:.4}");
        assert!((0.93..=0.99).contains(&held), "{rays} segments: {held:.3} of the intervals hold");
        assert!(found.iter().all(|a| 0.0 <= a.lo && a.lo <= a.transmittance && a.transmittance <= a.hi));
    }
}

fn same(a: &Answer, b: &Answer) -> bool {
    [a.transmittance, a.lo, a.hi].map(f32::to_bits) == [b.transmittance, b.lo, b.hi].map(f32::to_bits)
}

/// The correction and the routes are those of the scene, whatever the number of threads.
#[test]
fn threads_change_no_answer_of_the_cut() {
    let model = flat("forest", 36, 800);
    let found = |threads: usize| {
        let options = crate::model::PrepareOptions::default().with_threads(threads);
        let model = Model::prepare(model.shared_scene(), &options, &()).expect("a model");
        let points = surface_points(&model, 500, 1).expect("points");
        let workload = Workload::new(&model, points, 1);
        model.on_threads(|| answers(&with_cut(&model), (&model, &workload), (16, 0.1))).expect("threads")
    };
    let (one, two) = (found(1), found(2));
    assert!(one.len() > 100 && one.iter().zip(&two).all(|(a, b)| same(a, b)));
}

/// What walks certify stays certain: where nothing is averaged, an answer is no estimate because the cut gives it.
#[test]
fn certain_answers_stay_certain() {
    let model = flat("forest", 9, 800);
    let points = surface_points(&model, 3000, 1).expect("points");
    let workload = Workload::new(&model, points, 1);
    let walks = model.multi_resolution().expect("optics");
    let [walked, found] = [walks, &with_cut(&model)].map(|e| answers(e, (&model, &workload), (16, 0.05)));
    let mut certain = 0;
    for (walked, found) in walked.iter().zip(&found) {
        if walked.lo == walked.hi {
            certain += 1;
            assert!(same(walked, found), "{walked:?} {found:?}");
        }
    }
    assert!(certain > 20, "{certain}");
}

/// Rooms have no receivers for which it pays: nothing is kept, and answers are those of walks. Nor have models with placed meshes.
#[test]
fn placed_meshes_and_rooms_do_without_the_cut() {
    assert!(model(&forest(), Detail::Optics).cut().is_none());
    assert!(flat("desk-room", 36, 800).cut().is_none());
}
