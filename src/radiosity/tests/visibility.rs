//! Properties of whole solutions with each visibility engine.

use super::*;
use crate::model::cache::CacheLocation;
use crate::radiosity::audit::{AuditSize, link_uncertainty};
use crate::radiosity::deadline::Deadline;
use crate::radiosity::elements::Elements;
use crate::radiosity::final_gather::FinalGather;
use crate::radiosity::links::{Link, Split, Tally};
use crate::radiosity::pipeline::{engine_for, total_area};
use crate::radiosity::refinement::{
    LinkedScene, apply_importance, link_errors, propagate_importance, refine,
};
use crate::radiosity::surroundings::probe;
use crate::scene::generate::{Spec, build};
use glam::Vec3;

/// A few trees under a sky.
pub(super) fn forest() -> Scene {
    let mut spec = Spec::new("forest");
    (spec.trees, spec.leaves, spec.trunks) = (9, 120, true);
    build(&spec).expect("a forest")
}

/// Points on the ground under the trees.
pub(super) fn ground(scene: &Scene, n: usize) -> Vec<Point> {
    let reach = 0.5 * f64::from(scene.bounds.max.x.min(scene.bounds.max.y));
    let at = |i: usize| ((i as f64 * 0.618_034).fract() - 0.5, (i as f64 * 0.754_878).fract() - 0.5);
    let place = |(x, y): (f64, f64)| DVec3::new(reach * x, reach * y, 0.0);
    (0..n).map(|i| Point { position: place(at(i)), normal: DVec3::Z }).collect()
}

/// Number of points for which the distance cut is made in scenes of up to 8,000 triangles, and of those that are judged.
const MANY: usize = (1 << 14) + 512;
const JUDGED: usize = 512;

/// Largest irradiance.
fn largest(found: &Outcome) -> f64 {
    found.irradiance.iter().map(|e| mean(*e)).fold(0.0, f64::max)
}

/// Mean square error of the first points, relative to the square of `free`.
fn mean_square(found: &Outcome, truth: &Outcome, free: f64) -> f64 {
    let errors = found.irradiance.iter().zip(&truth.irradiance);
    errors.map(|(a, b)| ((mean(*a) - mean(*b)) / free).powi(2)).sum::<f64>() / truth.irradiance.len() as f64
}

/// Skylight at many points under leaves, by the distance cut: it averages, and its mean square error exceeds that of exact rays with
/// the same tolerance by no more than the square of the tolerance.
#[test]
fn skylight_under_leaves_is_averaged_within_its_tolerance() {
    let scene = crate::scene::testing::forest(20, 300);
    let points = ground(&scene, MANY);
    let direct = |points: &[Point], engine, error| {
        let options = Options { direct_only: true, elements: false, error, ..with(engine) };
        solved(&scene, points, &options)
    };
    let truth = direct(&points[..JUDGED], Engine::Exact, 0.004);
    // Exact rays are traced for each point by itself: an eighth of the points shows how many.
    let exact = direct(&points[..MANY / 8], Engine::Exact, 0.02);
    let mr = direct(&points, Engine::MultiResolution, 0.02);
    let bundles = mr.record.bundles;
    assert!(bundles.aggregated + bundles.mixed > MANY as u64, "{bundles:?}");
    let segments = [8 * exact.record.bundles.segments, bundles.segments];
    assert!(3 * segments[1] < 2 * segments[0], "{segments:?}");
    // 0.02 allows a standard error of 1 / (2 √250).
    let [exact, mr] = [&exact, &mr].map(|found| mean_square(found, &truth, largest(&truth)));
    assert!(mr < exact + 0.25 / 250.0, "{mr} {exact}");
}

/// Light at dense points on a floor with a wall and leaves high above: it is interpolated away from the wall, with an error that
/// exceeds that of exact rays by no more than the tolerance, and nothing leaks through the wall into the dark behind it.
#[test]
fn light_of_dense_points_is_interpolated_and_leaks_through_no_wall() {
    let room = |leaves: u32| {
        let mut pieces = Pieces::new();
        pieces.object("floor").quad(DVec3::ZERO, DVec3::X * 20.0, DVec3::Y * 20.0);
        pieces.object("wall").quad(DVec3::new(2.0, 0.0, 4.0), DVec3::Y * 20.0, DVec3::Z * 8.0);
        pieces.object("leaves");
        for k in 0..leaves {
            let at = |factor: f64| (f64::from(k) * factor).fract() - 0.5;
            let place = DVec3::new(5.0 * at(0.618_034) - 4.0, 8.0 * at(0.754_878), 5.0 + at(0.569_840));
            pieces.quad(place, DVec3::new(0.1, 0.1 * at(0.3), 0.05), DVec3::new(0.1 * at(0.7), 0.1, -0.05));
        }
        pieces.light(DVec3::new(-4.0, 0.0, 8.0), DVec3::X * 4.0, DVec3::Y * -4.0);
        pieces.scene()
    };
    let scene = room(3000);
    // In an order in which the first points are spread over all.
    let place = |i: usize| {
        let k = i * 6_101 % (130 * 130);
        DVec3::new((k % 130) as f64 / 10.0 - 6.5, (k / 130) as f64 / 10.0 - 6.5, 0.0)
    };
    let points: Vec<Point> = (0..130 * 130).map(|i| Point { position: place(i), normal: DVec3::Z }).collect();
    let options = |engine, error| Options {
        direct_only: true,
        elements: false,
        error,
        feature_size: Some(1.0),
        ..with(engine)
    };
    let direct = |points: &[Point], engine, error| solved(&scene, points, &options(engine, error));
    let free = largest(&solved(&room(0), &points, &options(Engine::Exact, 0.1)));
    let truth = direct(&points[..JUDGED], Engine::Exact, 0.008);
    // Exact rays are traced for each point by itself: a quarter of the points shows how many.
    let exact = direct(&points[..points.len() / 4], Engine::Exact, 0.02);
    let mr = direct(&points, Engine::MultiResolution, 0.02);
    let segments = [4 * exact.record.bundles.segments, mr.record.bundles.segments];
    // Behind the wall both trace all rays.
    assert!(5 * segments[1] < 2 * segments[0], "{segments:?}");
    let [by_rays, smooth] = [&exact, &mr].map(|found| mean_square(found, &truth, free));
    assert!(smooth < by_rays + 0.25 / 250.0, "{smooth} {by_rays}");
    let dark = (0..points.len()).filter(|&i| place(i).x > 2.0);
    assert!(dark.clone().count() > 4000 && dark.clone().all(|i| mean(mr.irradiance[i]) == 0.0));
}

fn with(engine: Engine) -> Options {
    Options { engine, error: 0.05, audit: 0, ..Options::default() }
}

/// The elements of a model with the link of the root.
pub(super) fn linked(model: &Model, options: &Options) -> LinkedScene {
    let (scene, exact) = (model.scene(), model.exact());
    let min_area = options.min_area * total_area(scene);
    let elements = Elements::build(scene, model.base().hierarchy(), min_area, &[]);
    let length = 2.0 * scene.bounds.diagonal();
    let found = probe(&elements, &exact, length, 1, &Deadline::start(&(), None));
    let engine = engine_for(model, &elements, options);
    LinkedScene::new(elements, found, engine, options)
}

/// A scene after refinement.
pub(super) fn refined<R>(scene: &Scene, options: &Options, see: impl FnOnce(&mut LinkedScene) -> R) -> R {
    let deadline = Deadline::start(&(), None);
    let model = model_for(scene, options);
    let mut linked = linked(&model, options);
    apply_importance(&mut linked, scene, options, &model.exact()).expect("names of the scene");
    for _ in 0..3 {
        let errors = [link_errors(&linked), Vec::new()];
        refine(&mut linked, &errors, 1e-3, false, &|_| false, &());
        let nodes = linked.active_nodes();
        linked.iterate(&nodes, 1e-3, 12, &deadline);
        propagate_importance(&mut linked, &nodes);
        linked.update_oracle_statistics();
    }
    see(&mut linked)
}

#[test]
fn measured_clusters_are_kept_for_those_who_need_them() {
    let mut scene = forest();
    let folder = tempfile::tempdir().expect("a folder");
    scene.path = folder.path().join("forest.obj");
    let files = || std::fs::read_dir(folder.path()).expect("the folder").count();
    let solve = |engine| {
        let cache = CacheLocation::Folder(folder.path().into());
        let options = Options { cache, error: 0.3, elements: false, ..with(engine) };
        let outcome = solved(&scene, &ground(&scene, 20), &options);
        (outcome.record.cache.clone(), outcome)
    };
    // Exact rays need no measures: none are made.
    let (origin, before) = solve(Engine::Exact);
    assert!(origin == "off" && files() == 0, "{origin}");
    let (origin, first) = solve(Engine::MultiResolution);
    assert!(origin == "made" && files() == 1, "{origin}");
    let (origin, second) = solve(Engine::MultiResolution);
    assert_eq!(origin, "hit");
    assert_eq!(first.irradiance, second.irradiance);
    // But clusters that are there are taken, and are the same.
    let (origin, after) = solve(Engine::Exact);
    assert_eq!(origin, "hit");
    assert_eq!(before.irradiance, after.irradiance);
    assert!(first.irradiance != after.irradiance, "nothing was averaged");
}

#[test]
fn average_visibility_is_never_handed_over() {
    let scene = forest();
    let Tally { aggregated, handed_over, .. } =
        refined(&scene, &with(Engine::Average), |linked| linked.tally);
    assert!(aggregated > 0 && handed_over == 0);
}

/// what overlaps is opened. No pair of surfaces is linked twice, and nothing with what holds it.
#[test]
fn links_cover_each_pair_once() {
    refined(&room(true), &with(Engine::Exact), |linked| {
        let (elements, links) = (&linked.elements, &linked.links);
        assert!(links.len() > 100, "{}", links.len());
        for (i, l) in links.iter().enumerate() {
            assert!(l.a == l.b || !(elements.is_part_of(l.a, l.b) || elements.is_part_of(l.b, l.a)), "{l:?}");
            assert!(l.a != l.b || elements.elements[l.a as usize].is_cluster(), "{l:?}");
            let within = |k: &Link| {
                let one = |p: u32, q: u32| elements.is_part_of(p, q);
                (one(l.a, k.a) && one(l.b, k.b)) || (one(l.a, k.b) && one(l.b, k.a))
            };
            let held = links.iter().enumerate().find(|(j, k)| *j != i && within(k));
            assert!(held.is_none(), "{l:?} is part of {held:?}");
        }
    });
}

/// Links that survive are not asked for again; of one link more than refined, only its parts are measured.
#[test]
fn visibility_is_kept_with_the_link() {
    refined(&room(true), &with(Engine::Exact), |linked| {
        let before = (linked.tally, linked.links.clone());
        let errors = [link_errors(linked), Vec::new()];
        assert_eq!(refine(linked, &errors, f32::INFINITY, false, &|_| false, &()).links, 0);
        assert_eq!((linked.tally, linked.links.clone()), before);
        let worst = errors[0].iter().filter(|(_, split)| *split != Split::Neither);
        let worst = worst.map(|(error, _)| *error).fold(0.0, f32::max);
        let refined = refine(linked, &errors, 0.999 * worst, true, &|_| false, &()).links;
        let asked = linked.tally.segments - before.0.segments;
        assert!(refined >= 1 && asked <= 16 * 64 * refined as u64, "{refined} {asked}");
    });
}

/// the answer does not get worse when more is asked for, as brute force sees it.
#[test]
fn less_tolerance_is_not_worse() {
    check_tolerances(Some(100_000));
}

#[test]
#[ignore = "long: the rays of the local pass for an error of 1 %"]
fn less_tolerance_is_not_worse_with_all_rays() {
    check_tolerances(None);
}

/// Checks errors of points at decreasing tolerances, with `local_rays` rays of the local pass.
fn check_tolerances(local_rays: Option<usize>) {
    let scene = room(true);
    let points = floor(60);
    let want = super::limits::truth(&scene, &points, 4096);
    let rms = |error: f64| {
        let options = Options { error, audit: 0, local_rays, ..Options::default() };
        super::limits::off(&solved(&scene, &points, &options).irradiance, &want).0
    };
    let [coarse, middle, fine] = [2.0, 0.2, 0.01].map(rms);
    assert!(fine < 0.02 && fine < 0.5 * coarse && middle < 1.1 * coarse, "{coarse} {middle} {fine}");
}

/// The audit reports error bars that are too small or too large, and light that is wrong.
#[test]
fn wrong_bars_are_found_out() {
    let scene = room(true);
    refined(&scene, &with(Engine::Exact), |linked| {
        let model = model_for(&scene, &with(Engine::Exact));
        let bars = link_uncertainty(linked);
        let audit_both = |linked: &LinkedScene, factor: f64| {
            let bars: Vec<f64> = bars.iter().map(|b| factor * b).collect();
            let gather = FinalGather::new(&model, linked, &with(Engine::Exact));
            let size = AuditSize::of(&Options { audit: 300, ..Options::default() });
            let endless = Deadline::start(&(), None);
            (gather.audit(&bars, size, &endless).0, gather.bar_factor(&bars, size, &endless).0)
        };
        let audit = |linked: &LinkedScene, factor: f64| audit_both(linked, factor).0;
        // Bars that are too large or too small are brought to the same.
        let [small, same, large] = [0.7, 1.0, 2.0].map(|factor| factor * audit_both(linked, factor).1);
        assert!(
            (small / same - 1.0).abs() < 0.3 && (large / same - 1.0).abs() < 0.3,
            "{small} {same} {large}"
        );
        let [bold, right, shy] = [0.02, 1.0, 50.0].map(|factor| audit(linked, factor));
        assert!(right.within_two > 0.9 && right.rms_bar < 6.0 * right.rms_error, "{right:?}");
        assert!(bold.within_two < 0.8 * right.within_two, "{bold:?} {right:?}");
        assert!(shy.rms_bar > 10.0 * shy.rms_error, "{shy:?}");
        linked.elements.states.iter_mut().flat_map(|s| &mut s.irradiance).for_each(|e| *e *= 1.5);
        let wrong = audit(linked, 1.0);
        assert!(wrong.within_two < 0.7 * right.within_two && wrong.rms_error > 0.2, "{wrong:?}");
    });
}

/// shadows that need not be resolved are not refined.
#[test]
fn small_shadows_are_not_refined() {
    let scene = forest();
    let links = |engine, size: f32| {
        let options = Options { feature_size: Some(size), ..with(engine) };
        refined(&scene, &options, |linked| linked.links.len())
    };
    let (exact, fine, coarse) = (
        links(Engine::Exact, 1.0),
        links(Engine::MultiResolution, 1e-3),
        links(Engine::MultiResolution, 1.0),
    );
    assert!(coarse < fine && 10 * coarse < 9 * exact, "{exact} {fine} {coarse}");
}

/// a cluster shows each side the light that leaves it there.
#[test]
fn clusters_do_not_shine_alike_to_all_sides() {
    // A lamp above a block: its top is bright, and what lies below gets next to nothing from it.
    let mut pieces = Pieces::empty();
    // Mirrored, the faces are wound outward.
    pieces.grey("block", 0.8).room(DVec3::new(0.5, -0.5, 0.0), DVec3::new(-0.5, 0.5, 0.5));
    pieces.glowing("lamp", 10.0).polygon(&facing_down([-1.0, 1.0], [-1.0, 1.0], 3.0));
    pieces.grey("screens", 0.8).polygon(&facing_up([-4.0, 4.0], [-4.0, 4.0], -3.0));
    let scene = pieces.scene();
    refined(&scene, &with(Engine::Exact), |linked| {
        let irradiance = |normal: Vec3| {
            let sides = linked.elements.sides.iter();
            let mut found = sides.filter(|s| s.normal.dot(normal) > 0.99 && s.exitance == [0.0; 3]);
            let is_small = |c: &Vec3| c.abs().max_element() < 1.0;
            let side = found.find(|s| linked.elements.corners(s).iter().all(is_small));
            side.map(|s| linked.elements.states[s.element as usize].irradiance[0])
                .expect("a side of the block")
        };
        let (top, bottom) = (irradiance(Vec3::Z), irradiance(-Vec3::Z));
        assert!(top > 5.0 * bottom, "{top} {bottom}");
    });
}
