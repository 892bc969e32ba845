//! Models of placed meshes against models of the same triangles, each stored where it is placed.

mod cut;
mod histories;
mod single;

use super::testing::model;
use super::{Detail, InstanceChange, Model, PrepareOptions};
use crate::Error;
use crate::math::{affine, rows};
use crate::progress::testing::stop_when;
use crate::ray::{LANES, Occluder, Packet};
use crate::scene::Scene;
use crate::scene::generate::{self, Spec};
use crate::visibility::{Bundle, Exact, LeafMode, Workspace};
use glam::{DAffine3, DVec3, Vec3};

/// A forest of placed trees.
fn forest() -> Scene {
    let spec = Spec { trees: 24, leaves: 400, instances: true, species: 2, ..Spec::new("forest") };
    generate::build(&spec).expect("a forest")
}

/// Bundles of sixteen segments from points near the ground to parts of the sky panel.
fn bundles(model: &Model) -> Vec<Packet> {
    let bounds = model.bounds();
    let place = |k: usize, a: f64| ((k as f64 * a).fract() as f32 - 0.5) * bounds.extent();
    let middle = bounds.center();
    (1..=400)
        .map(|k| {
            let from = middle
                + place(k, 0.618_034) * Vec3::new(0.8, 0.0, 0.0)
                + place(k, 0.754_878) * Vec3::new(0.0, 0.8, 0.0);
            let from = Vec3::new(from.x, from.y, bounds.min.z + 0.01);
            let mut packet = Packet::EMPTY;
            for lane in 0..LANES {
                let (u, v) = ((lane % 4) as f32 / 3.0 - 0.5, (lane / 4) as f32 / 3.0 - 0.5);
                let wide = 0.2 * bounds.extent();
                let to = Vec3::new(middle.x + u * wide.x, middle.y + v * wide.y, bounds.max.z - 0.01);
                packet.set(lane, from, to, model.end_rule());
            }
            packet
        })
        .collect()
}

fn blocked(model: &Model, packets: &[Packet]) -> Vec<u32> {
    let mut blocked = vec![0; packets.len()];
    let exact = Exact { scene: model.traced().clone(), traversal: model.widest_packets() };
    exact.occluded(packets, &mut blocked);
    blocked
}

/// Transmittance of each bundle by multi-resolution visibility, for an emitter as wide as the bundle and a feature size.
fn transmittances(model: &Model, packets: &[Packet], s: f32) -> Vec<f32> {
    let engine = model.engine(model.widest_packets(), LeafMode::Average).expect("optics");
    let width = 0.2 * model.bounds().extent().min_element();
    let bundles: Vec<Bundle> = packets.iter().map(|p| Bundle::of_packet(p, width)).collect();
    let mut found = Vec::new();
    engine.answers(&bundles, s, &mut Workspace::default(), |a| found.push(a.transmittance));
    found
}

/// Exact rays see the same through Embree's instances as through copied triangles, but for rounding at edges; averages
/// of both are as far from the truth as each other.
#[test]
fn placed_meshes_answer_like_copied_triangles() {
    let placed = model(&forest(), Detail::Optics);
    let copied = model(&forest().flattened(u64::MAX).expect("copied"), Detail::Optics);
    assert_eq!(placed.visible_triangles(), copied.visible_triangles());
    let packets = bundles(&placed);
    let (a, b) = (blocked(&placed, &packets), blocked(&copied, &packets));
    let differ: u32 = a.iter().zip(&b).map(|(a, b)| (a ^ b).count_ones()).sum();
    let stopped: u32 = b.iter().map(|b| b.count_ones()).sum();
    assert!(stopped > 1000 && differ <= 6, "{differ} of {stopped} blocked segments differ");
    let reference: Vec<f32> = b.iter().map(|b| 1.0 - b.count_ones() as f32 / LANES as f32).collect();
    for s in [0.05, 0.3, 2.0] {
        let [of_placed, of_copied] = [&placed, &copied].map(|model| {
            let found = transmittances(model, &packets, s);
            let n = found.len() as f32;
            let rms = (found.iter().zip(&reference).map(|(f, t)| (f - t).powi(2)).sum::<f32>() / n).sqrt();
            let bias = found.iter().zip(&reference).map(|(f, t)| f - t).sum::<f32>() / n;
            (rms, bias)
        });
        assert!(of_placed.0 < 1.3 * of_copied.0 + 0.01, "s = {s}: RMS, bias {of_placed:?} and {of_copied:?}");
        assert!(
            (of_placed.1 - of_copied.1).abs() < 0.02,
            "s = {s}: RMS, bias {of_placed:?} and {of_copied:?}"
        );
    }
}

/// Changes that make no sense are refused, and leave the model as it was.
#[test]
fn bad_changes_are_refused() {
    let forest = model(&forest(), Detail::Rays);
    let transform = forest.instances()[1].transform;
    let stretched = rows(&(affine(&transform) * DAffine3::from_scale(DVec3::new(1.0, 1.0, 1.2))));
    let away = |by: f64| rows(&DAffine3::from_translation(DVec3::splat(by)));
    let stranger = super::Instance { mesh: 99, ..forest.instances()[1].clone() };
    for (change, word) in [
        (InstanceChange::Move { instance: 0, transform }, "instance 0"),
        (InstanceChange::Move { instance: 1000, transform }, "does not exist"),
        (InstanceChange::Move { instance: 1, transform: stretched }, "unequal scale"),
        (InstanceChange::Move { instance: 1, transform: away(f64::NAN) }, "not finite"),
        (InstanceChange::Add(stranger), "mesh 99"),
        (
            InstanceChange::Add(super::Instance { material: Some(999), ..forest.instances()[1].clone() }),
            "material 999",
        ),
        (InstanceChange::Move { instance: 1, transform: away(1e39) }, "beyond"),
    ] {
        let error = forest.update(&[change]).err().expect("refused").to_string();
        assert!(error.contains(word), "{error}");
    }
    let once = forest.update(&[InstanceChange::Remove { instance: 2 }]).expect("removed");
    assert!(once.update(&[InstanceChange::Remove { instance: 2 }]).is_err(), "removed twice");
}

/// Paths of the oracle meet placed meshes where they stand.
#[test]
fn paths_meet_placed_meshes() {
    let scene = forest();
    let points: Vec<crate::points::Point> = (0..40)
        .map(|k| {
            let spread = scene.bounds.extent().as_dvec3();
            let place = DVec3::new((k as f64 * 0.618).fract() - 0.5, (k as f64 * 0.755).fract() - 0.5, 0.0);
            let position = scene.origin + scene.bounds.center().as_dvec3() + 0.7 * place * spread;
            crate::points::Point {
                position: DVec3::new(position.x, position.y, scene.origin.z + f64::from(scene.bounds.min.z)),
                normal: DVec3::Z,
            }
        })
        .collect();
    let settings = crate::path_tracer::Settings { samples: 512, direct_only: false, seed: 1 };
    let light = |scene: &Scene| {
        let found = crate::path_tracer::irradiance(&model(scene, Detail::Rays), &points, settings, &());
        found.expect("light").values.iter().map(|v| v[0]).sum::<f64>()
    };
    let (placed, copied) = (light(&scene), light(&scene.flattened(u64::MAX).expect("copied")));
    assert!(copied > 0.0 && (placed / copied - 1.0).abs() < 0.01, "{placed} and {copied}");
}

/// Two boxes far apart in one group: no pixel of the group's raster is as small as a box, and yet they block.
#[test]
fn small_instances_far_apart_are_not_lost() {
    let mut scene = forest();
    scene.placements.truncate(2);
    let far = DAffine3::from_translation(DVec3::new(3000.0, 0.0, 0.0));
    scene.placements[1].transform = far * scene.placements[0].transform;
    let placed = model(&scene, Detail::Optics);
    let boxes: Vec<_> = (1..3).map(|i| placed.instances()[i].bounds(placed.mesh_of(i as u32))).collect();
    // Through the middle of a crown, from beside the group to beside the group.
    let (c, out) = (boxes[0].center(), 4.0 * boxes[0].extent().max_element());
    let mut packet = Packet::EMPTY;
    for lane in 0..LANES {
        let by = (lane as f32 / LANES as f32 - 0.5) * 0.5 * boxes[0].extent();
        let at = |y: f32| Vec3::new(c.x + by.x, c.y + y, c.z + by.z);
        packet.set(lane, at(-out), at(out), placed.end_rule());
    }
    let exact = 1.0 - blocked(&placed, std::slice::from_ref(&packet))[0].count_ones() as f32 / LANES as f32;
    let found = transmittances(&placed, std::slice::from_ref(&packet), 0.05)[0];
    assert!(exact < 0.9 && (found - exact).abs() < 0.35, "exact {exact}, found {found}");
}

/// A preparation ends in the stage in which it is stopped, whichever that is, and each stage asks often: no more than some thousand
/// triangles are treated between two questions.
#[test]
fn a_preparation_ends_in_the_stage_in_which_it_is_stopped() {
    let scene = crate::scene::testing::forest(40, 1000);
    let prepare = |stage: &'static str, detail| {
        let options = PrepareOptions { detail, ..PrepareOptions::default() };
        let stop = stop_when(move |told| told.stage == stage);
        let result = Model::prepare_watched(scene.clone(), &options, &stop);
        (result.err(), stop)
    };
    let cases = [
        ("building Embree's tree", Detail::Rays),
        ("building clusters", Detail::Clusters),
        ("building clusters", Detail::Optics),
        ("measuring clusters", Detail::Optics),
    ];
    for (stage, detail) in cases {
        let (error, stop) = prepare(stage, detail);
        assert!(matches!(error, Some(Error::Cancelled(_))), "{stage}: {error:?}");
        let begun = stop.begun();
        assert_eq!(begun.last().map(String::as_str), Some(stage), "{begun:?}");
    }
    for (detail, least) in [(Detail::Rays, 8), (Detail::Clusters, 1000), (Detail::Optics, 4000)] {
        let (error, stop) = prepare("none", detail);
        let asked = stop.asked();
        assert!(error.is_none() && asked >= least, "{detail:?}: asked {asked} times");
    }
}
