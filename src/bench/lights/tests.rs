//! Patches of the sky and suns as emitters.

use super::{Lights, PatchSet, SOURCE_DISTANCE, patches};
use crate::bench::measure::{Queries, Timer};
use crate::bench::workload::{ReceiverPoint, Workload, surface_points};
use crate::bench::{BenchOptions, run};
use crate::model::{Detail, Model, testing};
use crate::path_tracer::{Settings, irradiance};
use crate::points::Point;
use crate::scene::Scene;
use crate::scene::testing::Pieces;
use crate::sky::SkyOptions;
use crate::visibility::Route;
use glam::{DVec3, Vec3};

/// A meadow of 20 m with a box of 2 m, and maybe leaves above the meadow.
fn meadow(leaves: bool) -> Pieces {
    let mut pieces = Pieces::new();
    pieces.quad(DVec3::ZERO, 20.0 * DVec3::X, 20.0 * DVec3::Y);
    pieces.cuboid(DVec3::new(0.0, -1.0, 0.01), DVec3::new(2.0, 1.0, 2.0));
    for k in 0..if leaves { 12 * 12 * 12 } else { 0 } {
        let [i, j, layer] = [k % 12, k / 12 % 12, k / 144].map(f64::from);
        let at = DVec3::new(0.3 * (i - 20.0), 0.3 * (j - 6.0), 1.0 + 0.2 * layer);
        pieces.quad(at + 0.05 * (layer * DVec3::X).fract(), 0.12 * DVec3::X, 0.12 * DVec3::Y);
    }
    pieces
}

fn under(sky: &str, sun: &str, mut scene: Scene) -> Scene {
    let options = SkyOptions::parse(sky).and_then(|sky| sky.with_sun(sun)).expect("a sky");
    scene.set_sky(&options).expect("a sky");
    assert_eq!(scene.sky().expect("a sky").frame().up, DVec3::Z);
    scene
}

fn points(model: &Model, all: &[([f64; 3], Vec3)]) -> Vec<ReceiverPoint> {
    let (origin, magnitude) = (model.scene().origin, model.magnitude());
    let point = |&(at, normal): &([f64; 3], Vec3)| ReceiverPoint {
        position: (DVec3::from(at) - origin).as_vec3(),
        normal,
        magnitude,
    };
    all.iter().map(point).collect()
}

/// The sum by point of weights times values.
fn sums(workload: &Workload, value: impl Fn(usize) -> f32) -> Vec<f64> {
    let mut sums = vec![0.0; workload.points.len()];
    for (k, pair) in workload.pairs.iter().enumerate() {
        sums[pair.point as usize] += f64::from(pair.weight) * f64::from(value(k));
    }
    sums
}

fn visible(model: &Model, workload: &Workload, rays: usize) -> Vec<f32> {
    let every: Vec<usize> = (0..workload.pairs.len()).collect();
    let queries = Queries { scene: model.scene(), workload, pairs: &every };
    Timer::new(1).expect("one thread").exact(queries, &model.exact(), rays, &|_| ()).visible
}

/// The weights of all patches, and of those that are drawn, add up to the irradiance of an unobstructed plane, whatever its slope.
#[test]
fn weights_are_the_irradiance_of_the_sky() {
    let model = testing::model(&under("perez:600,120", "140,35", meadow(false).scene()), Detail::Rays);
    let slopes =
        [Vec3::Z, Vec3::X, Vec3::new(0.3, -0.8, 0.2), Vec3::new(-0.5, 0.1, -0.4)].map(Vec3::normalize);
    let places: Vec<_> = slopes.iter().map(|normal| ([-3.0, 0.5, 4.0], *normal)).collect();
    let sky = model.scene().sky().expect("a sky");
    for asked in [PatchSet::All, PatchSet::Some] {
        let workload = Workload::asking(asked, &model, points(&model, &places), 1);
        for (sum, normal) in sums(&workload, |_| 1.0).into_iter().zip(slopes) {
            let whole = sky.irradiance(normal.as_dvec3()).iter().sum::<f64>() / 3.0;
            assert!((sum / whole - 1.0).abs() < 2e-3, "{asked:?} {normal}: {sum} instead of {whole}");
        }
    }
}

/// On a meadow beside a box, exact visible fractions of all patches times their irradiances are the irradiance by the path tracer, and so
/// are those of the patches that are drawn, in the mean over points. Samples are even over a patch, not by the cosine, which
/// errs by up to 0.4 % here.
#[test]
fn exact_fractions_are_the_irradiance_beside_a_box() {
    let model = testing::model(&under("uniform:1000", "none", meadow(false).scene()), Detail::Rays);
    let places: Vec<_> = [-3.0, -1.0, -0.3, -0.1].map(|x| ([x, 0.3, 0.0], Vec3::Z)).into();
    let asked: Vec<Point> =
        places.iter().map(|(at, n)| Point { position: DVec3::from(*at), normal: n.as_dvec3() }).collect();
    let settings = Settings { samples: 1 << 15, direct_only: true, seed: 1 };
    let reference = irradiance(&model, &asked, settings, &()).expect("paths");
    let workload = Workload::asking(PatchSet::All, &model, points(&model, &places), 1);
    let found = visible(&model, &workload, 256);
    let found = sums(&workload, |k| found[k]);
    for ((found, reference), error) in found.iter().zip(&reference.values).zip(&reference.standard_errors) {
        let tolerance = 4.0 * error[0] + 0.005 * reference[0];
        assert!(
            (found - reference[0]).abs() < tolerance,
            "{found} instead of {} ± {}",
            reference[0],
            error[0]
        );
    }
    assert!(found[3] < 0.7 * found[0], "the box hides a third of the sky: {found:?}");
    // 4 of 64 patches at each of a thousand places.
    let many = vec![places[2]; 1000];
    let workload = Workload::new(&model, points(&model, &many), 1);
    assert_eq!(workload.pairs.len(), 4000);
    let drawn = visible(&model, &workload, 64);
    let mean = sums(&workload, |k| drawn[k]).iter().sum::<f64>() / 1000.0;
    assert!((mean / found[2] - 1.0).abs() < 0.02, "{mean} instead of {}", found[2]);
}

/// Segments lead into the patch or the disc, above the horizon of their receiver.
#[test]
fn segments_end_in_their_patch() {
    let model = testing::model(&under("uniform:1000", "90,3:100", meadow(false).scene()), Detail::Rays);
    let sky = model.scene().sky().expect("a sky");
    let found = patches(sky);
    assert_eq!(found.len(), 64);
    let normal = Vec3::new(0.2, 0.9, 0.4).normalize();
    let workload = Workload::asking(PatchSet::All, &model, points(&model, &[([0.0, 0.0, 5.0], normal)]), 1);
    for (k, pair) in workload.pairs.iter().enumerate() {
        let hull = workload.hull(k);
        let edges = [hull[1] - hull[0], hull[2] - hull[0], hull[4] - hull[0]];
        let mut packets = Vec::new();
        workload.pack(model.scene(), &[k], 64, 0, &mut packets);
        for packet in &packets {
            for lane in packet.lanes() {
                let along = packet.point(lane, 1.0) - packet.point(lane, 0.0);
                let length = SOURCE_DISTANCE * model.bounds().diagonal();
                assert!((along.length() / length - 1.0).abs() < 1e-5 && along.dot(normal) > 0.0);
                let direction = along.as_dvec3().normalize();
                let inside = |edge: Vec3| {
                    let at = (packet.point(lane, 1.0) - hull[0]).dot(edge) / edge.length_squared();
                    (0.0..=1.0).contains(&at)
                };
                assert!(edges.into_iter().all(inside), "{} {direction}", pair.emitter);
                let (axis, half_angle) = match pair.emitter {
                    0 => (sky.suns()[0].direction, 0.5 * sky.suns()[0].diameter),
                    patch => {
                        let patch = &sky.patches().all()[found[patch as usize - 1] as usize];
                        (patch.axis, patch.half_angle)
                    }
                };
                assert!(axis.angle_between(direction) < half_angle + 1e-5, "{}", pair.emitter);
            }
        }
    }
}

/// At a small feature size MR sees what exact rays see; at a large one it averages leaves, and errs by less than 5 % in the mean.
#[test]
fn averaged_leaves_are_near_to_exact_ones_under_a_sky() {
    let scene = under("uniform:1000", "160,50:400", meadow(true).scene());
    let model = testing::model(&scene, Detail::Optics);
    let all = surface_points(&model, 400, 1).expect("points");
    let workload = Workload::new(&model, all, 1);
    let every: Vec<usize> = (0..workload.pairs.len()).collect();
    let queries = Queries { scene: model.scene(), workload: &workload, pairs: &every };
    let engine = model.multi_resolution().expect("optics").with_route(Route::WALKS);
    let timer = Timer::new(1).expect("one thread");
    let exact = timer.exact(queries, &model.exact(), 64, &|_| ()).visible;
    let error = |s: f32| {
        let found = timer.multi_resolution(queries, &engine, s, 64, &|_| ());
        let all = exact.iter().zip(&found.run.visible).map(|(a, b)| f64::from(b - a));
        let mean = all.clone().sum::<f64>() / exact.len() as f64;
        let rms = (all.map(|e| e * e).sum::<f64>() / exact.len() as f64).sqrt();
        (mean, rms, found.cost.aggregated)
    };
    let partly = exact.iter().filter(|&&v| v > 0.1 && v < 0.9).count();
    assert!(partly * 20 > exact.len(), "{partly} of {}", exact.len());
    let (_, rms, aggregated) = error(1e-5);
    // Far leaves have no umbra under a patch of 16 degrees, however small the feature size.
    assert!(rms < 1e-2 && aggregated < 1000, "{rms} with {aggregated} averaged segments");
    let (mean, rms, aggregated) = error(2.0);
    assert!(aggregated > 1000 && rms > 1e-3, "{aggregated} {rms}");
    assert!(mean.abs() < 0.05 && rms < 0.15, "{mean} {rms}");
}

/// Images show the sun, or a patch near the zenith if there is none.
#[test]
fn images_show_the_sun_or_the_patch_with_the_largest_irradiance() {
    let lights = |sun: &str| {
        let model = testing::model(&under("uniform:1000", sun, meadow(false).scene()), Detail::Rays);
        let points = points(&model, &[([-3.0, 0.0, 0.0], Vec3::Z)]);
        assert_eq!(Lights::of(&model, PatchSet::Shown).all.len(), 1);
        Workload::shown(&model, points, 1).pairs[0].weight
    };
    let sun = lights("160,50:400");
    assert!((sun / (400.0 * 50f32.to_radians().sin()) - 1.0).abs() < 1e-3, "{sun}");
    let patch = lights("none");
    assert!((1000.0 / 64.0..2500.0 / 64.0).contains(&patch), "{patch}");
}

/// A closed room under a sky is dark, and the record says why.
#[test]
fn a_closed_room_under_a_sky_has_a_note() {
    let mut pieces = Pieces::new();
    pieces.room(DVec3::new(-2.0, -2.0, 0.0), DVec3::new(2.0, 2.0, 3.0));
    pieces.object("shelf").cuboid(DVec3::new(-1.0, 0.0, 0.0), DVec3::new(1.0, 0.5, 1.0));
    // One feature size: images of each take seconds.
    let few =
        BenchOptions { points: 100, reference_rays: 16, rounds: 1, map: Some(16), ..BenchOptions::default() };
    let options = BenchOptions { feature_sizes: vec![0.5], ..few };
    let scene = under("uniform:1000", "160,50:400", pieces.scene());
    let model = Model::prepare(scene, &options.prepare()).expect("a model");
    let (record, _) = run(&model, &options, &()).expect("a record");
    let sky = record.workload.sky.expect("a sky");
    assert_eq!((sky.patches, sky.suns, sky.patches_per_point, &*sky.shown), (64, 1, 4, "lamps"));
    assert!(sky.largest_angle > 20.0 && sky.largest_angle <= 32.0, "{}", sky.largest_angle);
    let notes: Vec<_> = record.warnings.iter().filter(|note| note.contains("closed room")).collect();
    assert_eq!(notes.len(), 1, "{:?}", record.warnings);
}

/// A dome of one connected surface is asked in parts of bounded angle, which together send the light of the whole; a ceiling is asked as
/// a whole.
#[test]
fn domes_are_divided_like_a_sky() {
    let dome = |rings: i32| {
        let mut pieces = meadow(false);
        pieces.glowing("dome", 1.0);
        let at = |i: i32, j: i32| {
            let (turn, height) =
                (std::f64::consts::TAU * f64::from(i % 48) / 48.0, f64::from(j) / f64::from(rings));
            let wide = (1.0 - height * height).sqrt();
            60.0 * DVec3::new(turn.cos() * wide, turn.sin() * wide, height)
        };
        for (i, j) in (0..rings).flat_map(|j| (0..48).map(move |i| (i, j))) {
            pieces.polygon(&[at(i, j), at(i, j + 1), at(i + 1, j + 1)]);
            pieces.polygon(&[at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
        }
        pieces.scene()
    };
    let scene = dome(12);
    assert_eq!(scene.emitters.len(), 1);
    let found = super::record(&scene).expect("a dome");
    assert_eq!((found.domes, found.suns, found.patches_per_point), (1, 0, 4));
    assert!((40..200).contains(&found.patches) && found.largest_angle <= 32.0, "{found:?}");
    let model = testing::model(&scene, Detail::Rays);
    let places = [([-3.0, 0.5, 4.0], Vec3::Z), ([1.0, 0.5, 0.5], Vec3::Z)];
    for asked in [PatchSet::All, PatchSet::Some] {
        let workload = Workload::asking(asked, &model, points(&model, &places), 1);
        assert!(workload.pairs.iter().all(|pair| pair.emitter > 0), "the whole is not asked");
        let sums = sums(&workload, |_| 1.0);
        // π W/m²; the direction to the middle of a part stands for those to all of it, 2 % more.
        for sum in sums {
            let whole = std::f64::consts::PI;
            assert!((sum / whole - 1.0).abs() < 0.05, "{asked:?}: {sum} instead of {whole}");
        }
    }
    let whole = Workload::shown(&model, points(&model, &places), 1);
    assert!(whole.pairs.iter().all(|pair| pair.emitter == 0));
    let mut ceiling = meadow(false);
    ceiling.light(10.0 * DVec3::Z, 40.0 * DVec3::X, -40.0 * DVec3::Y);
    assert!(super::record(&ceiling.scene()).is_none());
}
