//! The front door: batches agree with engines, single queries with batches, and wrong arguments are named.

mod reports;
mod scene_builder;
mod shown;
mod stopped;

use super::*;
use crate::model::{Detail, Model, PrepareOptions};
use crate::ray::{LANES, Packet};
use crate::scene::testing::{self, Pieces};
use crate::visibility::{Bundle, Method, Workspace};
use glam::Vec3;

/// A small forest under its sky panel.
fn forest() -> Model {
    Model::prepare(testing::forest(9, 200), &PrepareOptions::default()).unwrap()
}

/// Origins, targets, offsets of bundles, and sizes of emitters.
type Arrays = (Vec<[f32; 3]>, Vec<[f32; 3]>, Vec<u64>, Vec<f32>);

/// `points` points below the trees, `rays` segments from each to source 0, and the size of the emitter from each.
fn queries(model: &Model, points: usize, rays: usize) -> Arrays {
    let (scene, sampler) = (model.scene(), &model.samplers()[0]);
    let (bounds, faces) = (scene.bounds, sampler.all());
    let (mut origins, mut targets, mut sizes) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..points {
        let [u, v, ..] = sobol_burley::sample_4d(k as u32, 0, 7);
        let from = bounds.min + Vec3::new(0.2 + 0.6 * u, 0.2 + 0.6 * v, 1e-4) * bounds.extent();
        for i in 0..rays {
            let [u, v, ..] = sobol_burley::sample_4d(i as u32, 1, k as u32);
            origins.push(from.to_array());
            targets.push(faces.sample(scene, u, v).position.to_array());
        }
        sizes.push(sampler.size_from(from));
    }
    let bundles = (0..=points as u64).map(|k| k * rays as u64).collect();
    (origins, targets, bundles, sizes)
}

#[derive(Clone, Debug, PartialEq)]
struct BatchAnswers {
    transmittance: Vec<f32>,
    lo: Vec<f32>,
    hi: Vec<f32>,
    methods: Vec<Method>,
    each: Vec<f32>,
}

/// Asks for everything; the transmittance of each segment if `each`.
fn ask(visibility: &Visibility, segments: &Segments, each: bool) -> BatchAnswers {
    let (n, m) = (segments.bundle_count(), segments.origins.len());
    let mut found = BatchAnswers {
        transmittance: vec![-1.0; n],
        lo: vec![-1.0; n],
        hi: vec![-1.0; n],
        methods: vec![Method::Clear; n],
        each: vec![-1.0; if each { m } else { 0 }],
    };
    let mut answers = Answers::new(&mut found.transmittance)
        .intervals(&mut found.lo, &mut found.hi)
        .methods(&mut found.methods);
    if each {
        answers = answers.segments(&mut found.each);
    }
    let cost = visibility.answer_into(segments, &mut answers).unwrap();
    assert_eq!(cost.segments, m as u64);
    found
}

#[test]
fn batches_are_answered_as_engines_do() {
    let model = forest();
    let visibility = model.visibility();
    let origin = model.scene().origin();
    for (points, rays) in [(300, 16), (40, 50), (700, 1)] {
        let (origins, targets, bundles, sizes) = queries(&model, points, rays);
        let segments = Segments::new(&origins[..], &targets[..], &bundles)
            .relative_to(origin)
            .feature_size(0.4)
            .emitter_sizes(&sizes);
        let packets: Vec<Vec<Packet>> = (0..points)
            .map(|k| {
                let mut packets = vec![Packet::EMPTY; rays.div_ceil(LANES)];
                for i in 0..rays {
                    let (a, b) = (origins[k * rays + i].into(), targets[k * rays + i].into());
                    packets[i / LANES].set(i % LANES, a, b, model.end_rule());
                }
                packets
            })
            .collect();
        let exact = ask(&visibility.clone().with_engine(Engine::Exact), &segments, true);
        let averaged = ask(&visibility.clone().with_engine(Engine::MultiResolution), &segments, false);
        let each = ask(&visibility.clone().with_engine(Engine::MultiResolution), &segments, true);
        let (engine, mut workspace) = (model.multi_resolution().unwrap(), Workspace::default());
        let (mut aggregated, mut differing) = (0, 0);
        for k in 0..points {
            let bundle = Bundle { packets: &packets[k], emitter_size: sizes[k], emitter: &[] };
            let want = model.exact().answer(bundle, &mut Vec::new());
            assert_eq!(exact.transmittance[k], want.transmittance);
            assert_eq!((exact.lo[k], exact.hi[k]), (want.lo, want.hi));
            let want = engine.answer(bundle, 0.4, &mut workspace);
            // Neighbours share the upper part of their traversal: up to rounding the same, but where one of the two
            // ways hands a bundle to Embree.
            differing += usize::from((averaged.transmittance[k] - want.transmittance).abs() > 1e-3);
            aggregated += usize::from(want.method == Method::Aggregated || want.method == Method::Mixed);
            for found in [&exact, &averaged, &each] {
                let (lo, t, hi) = (found.lo[k], found.transmittance[k], found.hi[k]);
                assert!(0.0 <= lo && lo <= t && t <= hi && hi <= 1.0, "{lo} {t} {hi}");
            }
            for found in [&exact, &each] {
                let mean = found.each[k * rays..][..rays].iter().sum::<f32>() / rays as f32;
                assert!((mean - found.transmittance[k]).abs() < 1e-5, "{mean} {}", found.transmittance[k]);
            }
        }
        assert!(differing <= points / 20, "{differing} of {points} differ");
        // Walks for single segments mostly give up: a ray is cheap.
        assert!(rays == 1 || aggregated > points / 10, "{aggregated} of {points} aggregate");
        let mean = |found: &BatchAnswers| found.transmittance.iter().sum::<f32>() / points as f32;
        assert!((mean(&exact) - mean(&averaged)).abs() < 0.03, "{} {}", mean(&exact), mean(&averaged));
        let automatic = ask(&visibility, &segments, false);
        assert!(
            automatic.transmittance == averaged.transmittance
                || automatic.transmittance == exact.transmittance
        );
        let average = ask(&visibility.clone().with_engine(Engine::Average), &segments, false);
        assert!(average.methods.iter().all(|m| *m != Method::Covered));
    }
}

#[test]
fn strides_frames_and_threads_change_nothing() {
    let model = forest();
    let origin = model.scene().origin();
    let (origins, targets, bundles, sizes) = queries(&model, 600, 16);
    let ask_with = |origins: Strided, targets: Strided, relative_to: [f64; 3]| {
        let segments = Segments::new(origins, targets, &bundles).relative_to(relative_to);
        let visibility = model.visibility().with_engine(Engine::MultiResolution);
        ask(&visibility, &segments.feature_sizes(&vec![0.3; sizes.len()]).emitter_sizes(&sizes), true)
    };
    let want = ask_with(origins[..].into(), targets[..].into(), origin);
    // Both ends in one array of records of eight floats.
    let records: Vec<f32> = origins
        .iter()
        .zip(&targets)
        .flat_map(|(a, b)| [a[0], a[1], a[2], f32::NAN, b[0], b[1], b[2], f32::NAN])
        .collect();
    let strided = |first: usize| Strided::new(&records[first..], 8, origins.len()).unwrap();
    assert_eq!(ask_with(strided(0), strided(4), origin), want);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| ask_with(origins[..].into(), targets[..].into(), origin)), want);
    }
    // Moved by a power of two the coordinates are rounded the same way, nearly.
    let moved = |p: &[[f32; 3]]| -> Vec<[f32; 3]> { p.iter().map(|p| p.map(|v| v - 8.0)).collect() };
    let (a, b) = (moved(&origins), moved(&targets));
    let shifted = ask_with(a[..].into(), b[..].into(), origin.map(|v| v + 8.0));
    let off: f32 = shifted.transmittance.iter().zip(&want.transmittance).map(|(a, b)| (a - b).abs()).sum();
    assert!(off / 600.0 < 0.01, "{off}");
}

#[test]
fn single_questions_agree_with_batches() {
    let model = forest();
    let visibility = model.visibility().with_engine(Engine::Exact);
    let below = [0.0, 0.0, 0.01];
    let seen = visibility.from_point(below, [0.0, 0.0, 2.0]).to_source(0).rays(4096).answer().unwrap();
    assert!(seen.lo <= seen.transmittance && seen.transmittance <= seen.hi && seen.transmittance > 0.0);
    let automatic = model.visibility();
    let averaged = automatic.from_point(below, [0.0, 0.0, 1.0]).to_source(0).feature_size(0.3);
    let averaged = averaged.rays(4096).answer().unwrap();
    assert!((seen.transmittance - averaged.transmittance).abs() < 0.1, "{seen:?} {averaged:?}");
    // The panel is above: a ceiling sees nothing of it, a wall half.
    let down = visibility.from_point(below, [0.0, 0.0, -1.0]).to_source(0).answer().unwrap();
    assert_eq!((down.transmittance, down.hi), (0.0, 0.0));
    let wall = visibility.from_point(below, [1.0, 0.0, 0.0]).to_source(0).rays(4096).answer().unwrap();
    assert!((wall.transmittance / seen.transmittance - 0.5).abs() < 0.25, "{wall:?}");
    let up = visibility.from_point([0.0, 0.0, 1e3], [0.0, 0.0, -1.0]).to_source(0).answer().unwrap();
    assert_eq!(up.transmittance, 0.0, "the panel emits downwards");
    let point = visibility.from_point(below, [0.0, 0.0, 1.0]).to_point([0.0, 0.0, 0.02]).answer().unwrap();
    assert_eq!(point.transmittance, 1.0);
}

/// A plate 2 mm above a floor hides a lamp at 50 km, from the floor to the lamp and back.
#[test]
fn what_lies_near_an_end_blocks_however_large_the_scene_is() {
    use glam::DVec3;
    let mut pieces = Pieces::new();
    pieces.quad(DVec3::ZERO, 10.0 * DVec3::X, 10.0 * DVec3::Y);
    pieces.object("plate").quad(0.002 * DVec3::Z, 2.0 * DVec3::X, 2.0 * DVec3::Y);
    pieces.light(5e4 * DVec3::Z, 10.0 * DVec3::Y, 10.0 * DVec3::X);
    let model = Model::prepare(pieces.scene(), &PrepareOptions::default()).unwrap();
    let floor = [[0.3f32, -0.2, 0.0], [-0.4, 0.1, 0.0], [1.5, 0.0, 0.0], [-2.0, 1.7, 0.0]];
    let lamp = [[1.0f32, 2.0, 5e4]; 4];
    for engine in [Engine::Exact, Engine::MultiResolution] {
        let visibility = model.visibility().with_engine(engine);
        for (from, to) in [(&floor, &lamp), (&lamp, &floor)] {
            let segments = Segments::new(&from[..], &to[..], &[0, 1, 2, 3, 4]).feature_size(0.1);
            assert_eq!(ask(&visibility, &segments, true).each, [0.0, 0.0, 1.0, 1.0], "{engine:?}");
        }
        for (at, seen) in floor.iter().zip([0.0, 0.0, 1.0, 1.0]) {
            let query = visibility.from_point(at.map(f64::from), [0.0, 0.0, 1.0]).feature_size(0.1);
            assert_eq!(query.to_source(0).answer().unwrap().transmittance, seen);
            assert_eq!(query.to_point([1.0, 2.0, 5e4]).answer().unwrap().transmittance, seen);
        }
    }
}

#[test]
fn wrong_arguments_are_named_and_nothing_is_written() {
    let model = forest();
    let visibility = model.visibility();
    let (a, b) =
        ([[0.0f32, 0.0, 0.1]; 4], [[0.0f32, 0.0, 9.0], [1.0, 0.0, 9.0], [2.0, 0.0, 9.0], [3.0, 0.0, 9.0]]);
    let with = |k: usize, v: f32| {
        let mut b = b;
        b[k][1] = v;
        b
    };
    let refuse = |segments: &Segments, want: &str| {
        let mut found = vec![7.0; segments.bundle_count()];
        let error = visibility.answer_into(segments, &mut Answers::new(&mut found)).expect_err(want);
        assert_eq!(error.category(), crate::ErrorCategory::Input);
        assert!(error.to_string().contains(want), "{error} instead of {want}");
        assert!(found.iter().all(|f| *f == 7.0), "{want}");
    };
    let two = [0, 2, 4];
    refuse(&Segments::new(&a[..], &b[..3], &two), "`targets` has 3");
    refuse(&Segments::new(&a[..], &b[..], &[]), "`bundles`");
    refuse(&Segments::new(&a[..], &b[..], &[0, 3]), "`bundles`");
    refuse(&Segments::new(&a[..], &b[..], &[0, 5, 4]), "`bundles`[2] 4");
    refuse(&Segments::new(&a[..], &with(2, f32::NAN)[..], &two), "`targets`[2]");
    refuse(&Segments::new(&with(3, f32::INFINITY)[..], &a[..], &two), "`origins`[3]");
    refuse(&Segments::new(&a[..], &a[..], &two), "`targets`[0]");
    refuse(&Segments::new(&a[..], &b[..], &two).feature_size(0.0), "`feature_size` 0");
    refuse(&Segments::new(&a[..], &b[..], &two).feature_sizes(&[1.0]), "`feature_sizes` of 1 entries");
    refuse(&Segments::new(&a[..], &b[..], &two).emitter_sizes(&[1.0, -1.0]), "`emitter_sizes`[1] -1");
    refuse(&Segments::new(&a[..], &b[..], &two).relative_to([f64::NAN; 3]), "`relative_to`");
    let mut short = [0.0; 1];
    let segments = Segments::new(&a[..], &b[..], &two);
    let error = visibility.answer_into(&segments, &mut Answers::new(&mut short)).unwrap_err();
    assert!(error.to_string().contains("`transmittance` of 1 entries: must have 2"), "{error}");
    assert!(Strided::new(&[0.0; 8], 2, 1).is_err() && Strided::new(&[0.0; 8], 3, 3).is_err());
    assert!(Strided::new(&[0.0; 8], usize::MAX, 3).is_err());
    assert_eq!(Strided::<f32>::new(&[], 0, 0).unwrap().len(), 0);
    let query = visibility.from_point([0.0; 3], [0.0, 0.0, 1.0]);
    for (query, want) in [
        (query, "target"),
        (query.to_source(9), "`to_source` 9"),
        (query.to_source(0).rays(0), "`rays` 0"),
        (query.to_source(0).feature_size(-1.0), "`feature_size` -1"),
        (query.to_point([f64::INFINITY; 3]), "`to_point`"),
        (query.to_point([0.0; 3]), "point itself"),
        (visibility.from_point([0.0; 3], [0.0; 3]).to_source(0), "`normal`"),
        (visibility.from_point([f64::NAN; 3], [1.0; 3]).to_source(0), "`position`"),
    ] {
        let error = query.answer().expect_err(want).to_string();
        assert!(error.contains(want), "{error} instead of {want}");
    }
    let needs = visibility.clone().with_engine(Engine::MultiResolution);
    assert!(needs.from_point([0.0; 3], [0.0, 0.0, 1.0]).to_source(0).answer().is_err(), "no feature size");
}

#[test]
fn empty_bundles_and_batches_are_answered() {
    let model = forest();
    let none: &[[f32; 3]] = &[];
    for engine in [Engine::Exact, Engine::MultiResolution, Engine::Automatic] {
        let visibility = model.visibility().with_engine(engine);
        let found = ask(&visibility, &Segments::new(none, none, &[0]).feature_size(1.0), false);
        assert!(found.transmittance.is_empty());
        let found = ask(&visibility, &Segments::new(none, none, &[0, 0, 0]).feature_size(1.0), true);
        assert_eq!((found.transmittance, found.hi), (vec![1.0; 2], vec![1.0; 2]));
        let up = Strided::repeated(&[0.0, 0.0, -2.0], 1);
        let (from, bundles) = ([[0.0, 0.0, -1.0]], [0, 0, 1, 1]);
        let found = ask(&visibility, &Segments::new(&from[..], up, &bundles).feature_size(1.0), true);
        assert_eq!((found.transmittance, found.each), (vec![1.0; 3], vec![1.0]));
    }
}

#[test]
fn without_optics_visibility_is_exact() {
    let options = PrepareOptions { detail: Detail::Rays, threads: 2, ..PrepareOptions::default() };
    let model = Model::prepare(testing::forest(4, 50), &options).unwrap();
    let up = |engine| {
        let visibility = model.visibility().with_engine(engine);
        visibility.from_point([0.0, 0.0, 0.01], [0.0, 0.0, 1.0]).to_source(0).feature_size(0.1).answer()
    };
    assert_eq!(up(Engine::Automatic).unwrap().cost.exact_rays, 64);
    let error = up(Engine::Average).expect_err("no optics").to_string();
    assert!(error.contains("Detail::Optics"), "{error}");
    let error = model.solve(&SolveOptions::default()).err().expect("no clusters").to_string();
    assert!(error.contains("Detail::Clusters"), "{error}");
}

#[cfg(feature = "reports")]
#[test]
fn automatic_means_the_same_in_solutions_and_queries() {
    let model = forest();
    let solved = |engine, feature_size| {
        let alone = SolveOptions { error: 0.5, audit: 0, local_rays: Some(0), ..SolveOptions::default() };
        let options = SolveOptions { engine, feature_size, ..alone };
        model.solve(&options).unwrap().inner.record.options.engine
    };
    assert_eq!(solved(Engine::Automatic, Some(0.2)), Engine::MultiResolution);
    assert_eq!(solved(Engine::Automatic, None), Engine::Exact);
    assert_eq!(solved(SolveOptions::default().engine, Some(0.2)), Engine::Exact);
    let rays = |size: Option<f32>| {
        let visibility = model.visibility();
        let query = visibility.from_point([0.0, 0.0, 0.01], [0.0, 0.0, 1.0]).to_source(0);
        size.map_or(query, |size| query.feature_size(size)).answer().unwrap().cost.exact_rays
    };
    assert!(rays(None) == 64 && rays(Some(5.0)) < 64);
}

#[test]
fn form_factors_have_rows() {
    let model = crate::model::testing::model(&testing::generated("cornell"), Detail::Rays);
    let found =
        model.form_factors(&FormFactorOptions { rays: Some(1024), ..FormFactorOptions::default() }).unwrap();
    assert!(found.names.is_empty() && found.offsets.len() == found.areas.len() + 1);
    for from in 0..found.areas.len() {
        let (columns, factors) = found.row(from);
        let span = found.offsets[from] as usize..found.offsets[from + 1] as usize;
        assert_eq!((columns, factors), (&found.columns[span.clone()], &found.factors[span]));
        for (&to, &factor) in columns.iter().zip(factors) {
            assert_eq!(found.factor(from, to as usize), factor);
            let [there, back] = [(from, to as usize), (to as usize, from)]
                .map(|(a, b)| found.areas[a] * f64::from(found.factor(a, b)));
            assert!((there - back).abs() <= 1e-5 * there.abs(), "{from} {to}: {there} {back}");
        }
    }
    let objects =
        FormFactorOptions { rays: Some(1024), grouping: Grouping::Object, ..FormFactorOptions::default() };
    let found = model.form_factors(&objects).unwrap();
    let names: Vec<&str> = model.scene().object_names().collect();
    assert_eq!(found.names, names);
    let refused = FormFactorOptions { max_bytes: Some(10), ..FormFactorOptions::default() };
    let error = model.form_factors(&refused).unwrap_err();
    assert_eq!(error.category(), crate::ErrorCategory::OutOfMemory);
    assert!(
        model.form_factors(&FormFactorOptions { rays: Some(0), ..FormFactorOptions::default() }).is_err()
    );
}
