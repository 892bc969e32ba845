//! Promises of the solver: conservation, closed forms, and that it can be stopped.

mod again;
mod audit;
mod coverings;
mod crossings;
mod daylight;
mod generated;
mod ground;
mod limits;
mod many_faces;
mod plates;
mod ratios;
mod shades;
mod shared_walls;
mod sheets;
mod sizes;
mod sky;
mod sky_links;
mod unlit;
mod visibility;

use super::audit::Ledger;
use super::mesh::Element;
use super::rgb::{Rgb, mean};
use super::*;
use crate::model::Model;
use crate::points::Point;
use crate::progress::{Progress, testing::stop_when};
use crate::scene::testing::{Pieces, Wall, facing_down, facing_up, generated, on_threads, walls};
use crate::scene::{LoadOptions, Scene, Soup, SoupMaterial, resolve};
use crate::visibility::Engine;
use glam::{DQuat, DVec3};

/// A unit cube seen from inside whose walls reflect and emit alike.
fn furnace(reflectance: f32) -> Scene {
    furnace_of(reflectance, 1.0)
}

/// The same with edges of another length.
fn furnace_of(reflectance: f32, edge: f64) -> Scene {
    let wall = SoupMaterial {
        reflectance: [reflectance; 3],
        ..SoupMaterial::light("wall", [std::f32::consts::FRAC_1_PI; 3])
    };
    let mut pieces = Pieces::empty();
    pieces.made_of("walls", wall).room(DVec3::ZERO, DVec3::splat(edge));
    pieces.scene()
}

/// A closed grey room with a box in it and a lamp below the ceiling.
fn room(lit: bool) -> Scene {
    let mut pieces = Pieces::empty();
    let grey = || SoupMaterial::diffuse("grey", [0.6, 0.5, 0.4]);
    pieces.made_of("walls", grey()).room(DVec3::ZERO, DVec3::new(3.0, 4.0, 2.5));
    pieces.made_of("box", grey()).room(DVec3::new(1.6, 1.0, 0.2), DVec3::new(1.0, 1.8, 1.0));
    if lit {
        pieces.glowing("lamp", 10.0).polygon(&facing_down([1.0, 2.0], [1.0, 2.0], 2.4));
    }
    pieces.scene()
}

/// Points on the floor of a scene.
fn floor(n: usize) -> Vec<Point> {
    let at = |i: usize| DVec3::new((i % 7) as f64 / 8.0 + 0.06, (i / 7) as f64 / n as f64 * 6.5 + 0.02, 0.0);
    (0..n).map(|i| Point { position: at(i), normal: DVec3::Z }).collect()
}

/// Default options but for larger elements and no audit.
fn coarse() -> Options {
    Options { min_area: 1e-3, audit: 0, ..Options::default() }
}

/// Default options but for a fortieth of the rays of the local pass, elements no smaller than these rays light, and no audit.
fn quick() -> Options {
    Options { local_rays: Some(350_000), ..coarse() }
}

fn solved(scene: &Scene, points: &[Point], options: &Options) -> Outcome {
    run(&model_for(scene, options), points, options, &()).expect("a solution")
}

#[test]
fn a_furnace_has_the_same_light_everywhere() {
    for reflectance in [0.0, 0.95] {
        let scene = furnace(reflectance);
        let options = Options { local_rays: Some(1_500_000), ..coarse() };
        let outcome = solved(&scene, &floor(20), &options);
        // Radiosity M / (1 - ρ), and as much irradiance.
        let want = 1.0 / (1.0 - f64::from(reflectance));
        for element in &outcome.mesh.elements {
            for k in 0..3 {
                // Rays to emitters have some noise.
                assert!((element.irradiance[k] / want - 1.0).abs() < 0.02, "{reflectance}: {element:?}");
                assert!((element.radiosity[k] / want - 1.0).abs() < 0.02, "{reflectance}: {element:?}");
            }
        }
        for value in &outcome.irradiance {
            assert!((value[0] / want - 1.0).abs() < 1e-3, "{reflectance}: {value:?}");
        }
        let Ledger { emitted, created, .. } = outcome.record.ledger;
        assert!((emitted - 6.0).abs() < 1e-3 && created.abs() < 2e-3 * emitted);
    }
}

#[test]
fn no_energy_is_made_or_lost() {
    let options = Options { local_rays: Some(1_000_000), audit: 0, ..Options::default() };
    let outcome = solved(&room(true), &[], &options);
    let Ledger { emitted, absorbed, escaped, created, row_sums, .. } = outcome.record.ledger;
    assert!((emitted - 10.0 * std::f64::consts::PI).abs() < 1e-3 * emitted, "{emitted}");
    assert!(created.abs() < 2e-3 * emitted, "created {created} of {emitted}");
    assert!((absorbed + escaped - emitted).abs() < 5e-3 * emitted, "{absorbed} {escaped} {emitted}");
    let [low, high] = row_sums.expect("closed elements");
    assert!(low > 0.995 && high < 1.005, "{low} {high}");
    assert_eq!(outcome.record.ledger.reciprocity_residual, 0.0);
}

#[test]
fn threads_do_not_matter() {
    // Links alone, and clusters with a local pass.
    let cluttered = generated("desk-room");
    for scene in [room(true), cluttered] {
        let with = |threads: usize| {
            let options = Options { error: 0.2, audit: 20, ..coarse() };
            on_threads(threads, || solved(&scene, &floor(200), &options))
        };
        let (one, two) = (with(1), with(3));
        assert_eq!(one.irradiance, two.irradiance);
        assert_eq!(one.mesh.elements, two.mesh.elements);
        assert_eq!(one.record.audit, two.record.audit);
        assert!(one.irradiance.iter().any(|v| v[0] > 0.0) && one.record.links > 100);
    }
}

#[test]
fn without_light_everything_is_black() {
    let outcome = solved(&room(false), &floor(5), &Options::default());
    assert!(outcome.irradiance.iter().flatten().all(|&v| v == 0.0));
    assert!(outcome.mesh.elements.iter().all(|e| e.irradiance == [0.0; 3]));
    assert!(
        outcome.record.warnings.iter().any(|w| w.contains("⟨LoadOptions::emitters⟩")),
        "{:?}",
        outcome.record.warnings
    );
}

#[test]
fn what_was_reached_when_stopped_is_consistent() {
    let (model, stop) = (model_for(&room(true), &Options::default()), stop_when(|_| true));
    let outcome = run(&model, &floor(5), &Options::default(), &stop).expect("a solution");
    assert!(outcome.record.interrupted && outcome.record.iterations.len() == 1);
    let Ledger { emitted, created, .. } = outcome.record.ledger;
    assert!(created.abs() < 2e-3 * emitted, "{created}");
    assert!(outcome.irradiance.iter().all(|v| v[0] > 0.0));
}

#[test]
fn steps_bring_the_error_down() {
    // Links alone: before a local pass they are refined less.
    let options = Options { step_seconds: Some(0.01), error: 0.1, local_rays: Some(0), ..Options::default() };
    let outcome = solved(&room(true), &[], &options);
    let steps = &outcome.record.iterations;
    assert!(steps.len() > 3);
    assert!(steps.windows(2).all(|s| s[1].links >= s[0].links));
    // Nothing is left above the error asked for.
    let last = &steps[steps.len() - 1];
    assert!(last.refined == 0 && last.error_bound < 1.01e-3, "{last:?}");
}

#[test]
fn importance_moves_the_work() {
    let scene = room(true);
    let links_at = |importance: &[&str]| {
        let importance = importance.iter().map(|s| (*s).to_owned()).collect();
        // Links alone: the local pass splits all surfaces evenly.
        let options = Options { importance, local_rays: Some(0), ..Options::default() };
        let outcome = solved(&scene, &[], &options);
        let at = |name: &str| {
            let object = scene.objects.iter().position(|o| o.name == name).expect("an object") as u32;
            outcome.mesh.elements.iter().filter(|e| e.object == object).count() as f64
        };
        at("box") / at("walls")
    };
    assert!(links_at(&["box"]) > 1.5 * links_at(&[]));
    let unknown = Options { importance: vec!["nothing".into()], ..Options::default() };
    assert!(run(&model_for(&scene, &unknown), &[], &unknown, &()).is_err());
}

#[test]
fn cameras_make_important_what_they_see() {
    let scene = room(true);
    let view = View { eye: DVec3::new(0.5, 2.0, 1.25), forward: DVec3::X, angle: 0.8 };
    // Links alone: the local pass splits all surfaces evenly.
    let plain = Options { local_rays: Some(0), audit: 0, ..Options::default() };
    let options = Options { views: vec![view], ..plain.clone() };
    let at = |options: &Options, x: f64| {
        let outcome = solved(&scene, &[], options);
        let on = |e: &&Element| {
            e.corners.iter().all(|&c| (f64::from(outcome.mesh.vertices[c as usize].x) - x).abs() < 1e-6)
        };
        outcome.mesh.elements.iter().filter(on).count() as f64
    };
    // The vertices are relative to the scene's origin.
    let (seen, behind) = (3.0 - scene.origin.x, -scene.origin.x);
    let ratio = |options: &Options| at(options, seen) / at(options, behind);
    let [important, plain] = [ratio(&options), ratio(&plain)];
    assert!(important > 1.03 * plain, "{important} {plain}");
}

#[test]
fn steps_are_cut_short_when_time_is_up() {
    // Links alone; their number ends the last step.
    let hurry = Options {
        error: 1e-3,
        step_seconds: Some(1e-6),
        max_links: 3000,
        local_rays: Some(0),
        audit: 0,
        ..Options::default()
    };
    let outcome = solved(&room(true), &[], &hurry);
    let steps = &outcome.record.iterations;
    let refined: Vec<usize> = steps.iter().map(|step| step.refined).collect();
    let [first @ .., last] = &refined[..] else { panic!("no steps") };
    assert!(first.len() > 10 && first.iter().all(|n| (1..=64).contains(n)) && *last <= 64, "{refined:?}");
    assert!(outcome.record.ledger.created.abs() < 5e-3 * outcome.record.ledger.emitted);
}

/// A room full of small things: what the local pass is for.
#[test]
fn clutter_is_lit_as_paths_say() {
    let scene = generated("desk-room");
    let points = limits::on_surfaces(&scene, 150);
    let outcome = solved(&scene, &points, &Options { error: 0.04, min_area: 1e-3, ..Options::default() });
    let (rms, _) = limits::off(&outcome.irradiance, &limits::truth(&scene, &points, 1024));
    assert!(rms < 0.08, "{rms}");
    // Nobody knows the light of an element to the last digit, of dark gaps below things neither.
    assert!(outcome.mesh.elements[..outcome.mesh.lit()].iter().all(|e| e.error[0] > 0.0));
    let Record { ledger, audit, .. } = outcome.record;
    assert!(ledger.created.abs() < 2e-3 * ledger.emitted, "{ledger:?}");
    assert_eq!(ledger.reciprocity_residual, 0.0);
    assert!(ledger.row_sum_error < 5e-3 && ledger.closed_area > 0.5, "{ledger:?}");
    let audit = audit.expect("an audit");
    // In dark gaps below things no ray finds light, which does not make their bars wide.
    assert!(audit.within_two > 0.85 && audit.rms_bar < 1.5 * audit.rms_upper, "{audit:?}");
}

/// Bars tell how wrong elements are, and neither nothing nor anything.
#[test]
fn bars_hold_the_truth() {
    let outcome = solved(&room(true), &[], &Options { error: 0.05, ..Options::default() });
    let audit = outcome.record.audit.expect("an audit");
    assert!(audit.within_one > 0.55 && audit.within_two > 0.88 && audit.factor != 1.0, "{audit:?}");
    assert!(audit.rms_bar < 3.0 * audit.rms_error, "{audit:?}");
}

/// Direct light at points looks for no dark sides, makes no links, and is what it is beside the light of elements.
#[test]
fn direct_light_at_points_makes_nothing_else() {
    let mut pieces = Pieces::empty();
    pieces.grey("room", 0.5).room(DVec3::ZERO, DVec3::new(3.0, 4.0, 2.5));
    pieces.grey("box", 0.5).room(DVec3::new(1.6, 1.0, 0.2), DVec3::new(1.0, 1.8, 1.0));
    pieces.grey("dark room", 0.5).room(DVec3::new(5.0, 0.0, 0.0), DVec3::new(7.0, 2.0, 2.0));
    pieces.glowing("lamp", 10.0).polygon(&facing_down([1.0, 2.0], [1.0, 2.0], 2.4));
    let (scene, points) = (pieces.scene(), floor(20));
    let with = |elements| {
        let options = Options { direct_only: true, elements, light_rays: Some(1024), ..coarse() };
        solved(&scene, &points, &options)
    };
    let [alone, beside] = [false, true].map(with);
    assert!(alone.record.links <= 1 && beside.record.links > 100);
    assert!(alone.record.unlit.sides == 0 && beside.record.unlit.sides > 0, "{:?}", beside.record.unlit);
    for (a, b) in alone.irradiance.iter().zip(&beside.irradiance) {
        assert!((a[0] - b[0]).abs() <= 0.02 * b[0], "{a:?} {b:?}");
    }
}

/// What no light arrives in has no error either; where light of a channel is shown as 0 because it was negative by noise, its error is not.
#[test]
fn bars_of_channels_without_light_are_zero() {
    let mut pieces = Pieces::empty();
    pieces.grey("floor", 0.5).polygon(&facing_up([0.0, 2.0], [0.0, 2.0], 0.0));
    pieces.made_of("lamp", SoupMaterial::light("red", [10.0, 0.0, 0.0]));
    pieces.polygon(&facing_down([0.5, 1.5], [0.5, 1.5], 1.0));
    let mesh = solved(&pieces.clone().scene(), &[], &quick()).mesh;
    let lit: Vec<_> = mesh.elements.iter().filter(|e| e.irradiance[0] > 0.0).collect();
    assert!(!lit.is_empty() && lit.iter().all(|e| e.error[0] > 0.0 && e.error[1..] == [0.0; 2]));
    pieces.made_of("far lamp", SoupMaterial::light("green", [0.0, 10.0, 0.0]));
    pieces.polygon(&facing_down([1.9, 2.0], [1.9, 2.0], 0.1));
    let mesh = solved(&pieces.scene(), &[], &quick()).mesh;
    let lit = || mesh.elements.iter().filter(|e| e.irradiance[0] > 0.0);
    assert!(lit().any(|e| e.irradiance[1] == 0.0) && lit().all(|e| e.error[1] > 0.0 && e.error[2] == 0.0));
}

#[test]
fn options_out_of_range_are_refused() {
    let scene = room(false);
    let wrong = [
        Options { error: 0.0, ..Options::default() },
        Options { error: -1.0, ..Options::default() },
        Options { max_seconds: Some(0.0), ..Options::default() },
        Options { feature_size: Some(f32::NAN), ..Options::default() },
        Options { gather_rays: Some(0), ..Options::default() },
        Options { feature_sizes: vec![("walls".into(), -1.0)], ..Options::default() },
    ];
    for options in wrong {
        let error = run(&model_for(&scene, &options), &[], &options, &()).err().expect("refused").to_string();
        assert!(error.contains("must"), "{error}");
    }
}

/// Irradiance at points by paths.
fn traced(scene: &Scene, points: &[Point], samples: u32, seed: u64) -> Vec<Rgb> {
    let settings = crate::path_tracer::Settings { samples, direct_only: false, seed };
    let model = model_for(scene, &Options::default());
    crate::path_tracer::irradiance(&model, points, settings, &()).expect("irradiance").values
}

/// Mean of the light at points, first channel.
fn mean_at(values: &[Rgb]) -> f64 {
    values.iter().map(|v| v[0]).sum::<f64>() / values.len() as f64
}

/// The model that a solve with these options needs.
fn model_for(scene: &Scene, options: &Options) -> Model {
    Model::prepare(scene.clone(), &options.prepare()).expect("a model")
}

/// Points on edges and in corners have the light of points beside them, inside the room; by the solver and by paths.
#[test]
fn light_on_edges_is_the_limit_from_inside() {
    let scene = room(true);
    let on = |x: f64, y: f64, z: f64, normal: DVec3| Point { position: DVec3::new(x, y, z), normal };
    let pairs = [
        (on(3.0, 2.0, 0.0, DVec3::Z), on(2.999, 2.0, 0.0, DVec3::Z)),
        (on(0.0, 1.7, 0.0, DVec3::Z), on(0.001, 1.7, 0.0, DVec3::Z)),
        (on(3.0, 4.0, 0.0, DVec3::Z), on(2.999, 3.999, 0.0, DVec3::Z)),
        (on(0.0, 0.0, 0.0, DVec3::Z), on(0.001, 0.001, 0.0, DVec3::Z)),
        (on(0.0, 0.0, 1.3, DVec3::X), on(0.0, 0.001, 1.3, DVec3::X)),
        (on(1.0, 4.0, 2.5, -DVec3::Y), on(1.0, 4.0, 2.499, -DVec3::Y)),
    ];
    let points: Vec<Point> = pairs.iter().flat_map(|&(edge, inside)| [edge, inside]).collect();
    for light in [solved(&scene, &points, &quick()).irradiance, traced(&scene, &points, 4096, 1)] {
        for (k, pair) in light.chunks_exact(2).enumerate() {
            assert!((pair[0][0] / pair[1][0] - 1.0).abs() < 0.04, "{:?}: {pair:?}", points[2 * k]);
        }
    }
}

/// The corner of a turned room that lies in the origin: its coordinates are 0, but not the rounding errors of its faces.
#[test]
fn corners_in_the_origin_have_the_light_of_points_beside_them() {
    let options = Options { direct_only: true, elements: false, audit: 0, ..Options::default() };
    for k in 0..12 {
        let angle = |m: u32| f64::from(k * m % 13);
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, angle(3), angle(5), angle(7));
        let turned = |corners: &[DVec3]| corners.iter().map(|&at| turn * at).collect::<Vec<DVec3>>();
        let mut pieces = Pieces::empty();
        pieces.grey("walls", 0.5);
        for (_, corners) in walls(DVec3::ZERO, DVec3::new(3.7, 2.9, 2.4)) {
            pieces.polygon(&turned(&corners));
        }
        pieces.glowing("lamp", 10.0).polygon(&turned(&facing_down([1.0, 2.0], [1.0, 2.0], 2.35)));
        let point = |at: DVec3, normal: DVec3| Point { position: turn * at, normal: turn * normal };
        let beside = |normal: DVec3| point(1e-3 * (DVec3::ONE - normal), normal);
        let points: Vec<Point> =
            DVec3::AXES.into_iter().flat_map(|normal| [point(DVec3::ZERO, normal), beside(normal)]).collect();
        for (pair, normal) in solved(&pieces.scene(), &points, &options).irradiance.chunks_exact(2).zip(0..) {
            assert!((pair[0][0] / pair[1][0] - 1.0).abs() < 0.04, "{k}, {normal}: {pair:?}");
        }
    }
}
