//! The distance cut of a model: its correction, where it is used, and that placed meshes do without.

use super::*;
use crate::bench::workload::{Order, Workload, surface_points};
use crate::visibility::Method;

fn flat(name: &str) -> Model {
    let spec = Spec { trees: 36, leaves: 800, ..Spec::new(name) };
    model(&generate::build(&spec).expect(name), Detail::Optics)
}

/// Answers of the engine and exact fractions of 1,024 rays, for ground receivers of a forest.
fn on_the_ground(model: &Model) -> Vec<(crate::visibility::Answer, f32)> {
    let points = surface_points(model, 4000, 1).expect("points");
    let ground: Vec<_> = points.into_iter().filter(|p| p.position.z < 0.01 && p.normal.z > 0.9).collect();
    let workload = Workload::new(model, ground, 1);
    let engine = model.multi_resolution().expect("optics").clone().with_cut(model.cut());
    let (scene, exact, mut workspace) = (model.scene(), model.exact(), Workspace::default());
    let answer = |pair: usize| {
        let packets = |(rays, stream): (usize, u64)| {
            let mut packets = Vec::new();
            workload.add_bundle(scene, pair, (rays, Order::Near), stream, &mut packets);
            packets
        };
        let (asked, traced) = (packets((16, 0)), packets((1024, 1)));
        let emitter_size = workload.pairs[pair].emitter_size;
        let bundle = |packets| Bundle { packets, emitter_size, emitter: workload.hull(pair) };
        let truth = exact.answer(bundle(&traced), &mut Vec::new()).transmittance;
        (engine.answer(bundle(&asked), 1e-6, &mut workspace), truth)
    };
    (0..workload.pairs.len()).map(answer).collect()
}

/// On the ground of a forest sixteen segments of the cut are without bias, err less than half as much as sixteen rays do, and state
/// intervals that hold.
#[test]
fn ground_of_a_forest_is_answered_by_the_cut() {
    let model = flat("forest");
    let found = on_the_ground(&model);
    let n = found.len() as f64;
    assert!(n > 500.0, "{n} receivers");
    let averaged =
        found.iter().filter(|(a, _)| matches!(a.method, Method::Aggregated | Method::Mixed)).count();
    assert!(averaged as f64 > 0.7 * n, "{averaged} of {n}");
    let errors = || found.iter().map(|(answer, truth)| f64::from(answer.transmittance - truth));
    let (bias, rms) = (errors().sum::<f64>() / n, (errors().map(|e| e * e).sum::<f64>() / n).sqrt());
    // The error of sixteen independent rays.
    let rays = (found.iter().map(|(_, t)| f64::from(t * (1.0 - t)) / 16.0).sum::<f64>() / n).sqrt();
    assert!(bias.abs() < 0.015 && rms < 0.5 * rays, "bias {bias:+.4}, RMS {rms:.4}, of rays {rays:.4}");
    let noise = |t: f32| 2.0 * (t * (1.0 - t) / 1024.0).sqrt();
    let inside = found.iter().filter(|(a, t)| a.lo - noise(*t) <= *t && *t <= a.hi + noise(*t)).count();
    assert!(inside as f64 > 0.93 * n, "{inside} of {n} intervals hold");
    assert!(found.iter().all(|(a, _)| 0.0 <= a.lo && a.lo <= a.transmittance && a.transmittance <= a.hi));
}

/// The correction and the routes are those of the scene, whatever the number of threads.
#[test]
fn threads_change_no_answer_of_the_cut() {
    let model = flat("forest");
    let answers = |threads: usize| -> Vec<[u32; 3]> {
        let options = crate::model::PrepareOptions::default().with_threads(threads);
        let model = Model::prepare(model.shared_scene(), &options, &()).expect("a model");
        let bits =
            |(a, _): &(crate::visibility::Answer, f32)| [a.transmittance, a.lo, a.hi].map(f32::to_bits);
        model.on_threads(|| on_the_ground(&model).iter().take(200).map(bits).collect()).expect("threads")
    };
    assert!(answers(1) == answers(2));
}

#[test]
fn placed_meshes_and_rooms_do_without_the_cut() {
    let placed = model(&forest(), Detail::Optics);
    assert!(placed.cut().is_none());
    let room = flat("desk-room");
    let (cut, workspace) = (room.cut().expect("a cut"), &mut Workspace::default());
    assert!(cut.bytes() > 0);
    let points = surface_points(&room, 500, 1).expect("points");
    let workload = Workload::new(&room, points, 1);
    let engine = room.multi_resolution().expect("optics").clone().with_cut(room.cut());
    for pair in 0..workload.pairs.len() {
        let mut packets = Vec::new();
        workload.add_bundle(room.scene(), pair, (16, Order::Near), 0, &mut packets);
        let emitter_size = workload.pairs[pair].emitter_size;
        let bundle = Bundle { packets: &packets, emitter_size, emitter: workload.hull(pair) };
        let mut walked = None;
        engine.walked_answers(&[bundle], 1e-6, workspace, |answer| walked = Some(answer.transmittance));
        assert_eq!(Some(engine.answer(bundle, 1e-6, workspace).transmittance), walked);
    }
}
