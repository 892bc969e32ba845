//! Work that a caller stops, and the time that a caller allows.

use crate::model::testing::{model, prepared_in};
use crate::model::{Detail, Model};
use crate::progress::testing::stop_when;
use crate::scene::{Scene, testing::generated};
use crate::{
    Answers, Engine, Error, FormFactorOptions, GenerateOptions, Grouping, Progress, Segments, SolveOptions,
    SurfacePoint,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Stops when it is asked for the time `at`, counted from 1.
#[derive(Default)]
struct AtAsk {
    at: u64,
    asked: AtomicU64,
    /// Numbers of questions before the first stage, and since the last step.
    before: AtomicU64,
    since: AtomicU64,
}

impl Progress for AtAsk {
    fn stage(&self, _: &str, _: u64) {
        self.before.fetch_min(self.asked.load(Ordering::Relaxed), Ordering::Relaxed);
    }

    fn advance(&self, _: u64) {
        self.since.store(0, Ordering::Relaxed);
    }

    fn stopped(&self) -> bool {
        self.since.fetch_add(1, Ordering::Relaxed);
        self.asked.fetch_add(1, Ordering::Relaxed) + 1 >= self.at
    }
}

fn at_ask(at: u64) -> AtAsk {
    AtAsk { at, before: AtomicU64::new(u64::MAX), ..AtAsk::default() }
}

fn cornell(detail: Detail) -> Model {
    model(&Scene::generate("cornell").expect("a scene"), detail)
}

/// Rays to find partners, rays of pairs, and the adjustment all end early; a caller who never stops gets all steps.
#[test]
fn form_factors_stop_at_any_step() {
    let model = cornell(Detail::Rays);
    let options = FormFactorOptions { rays: Some(256), ..FormFactorOptions::default() };
    let all = Arc::new(stop_when(|_| false));
    let facets =
        model.with_progress(all.clone()).form_factors(&options).expect("form factors").areas.len() as u64;
    assert_eq!(all.steps(), 2 * facets);
    for steps in [0, 1, facets, facets + 1, 2 * facets] {
        let progress = Arc::new(stop_when(move |c| c.steps >= steps));
        let result = model.with_progress(progress.clone()).form_factors(&options);
        assert!(matches!(result, Err(Error::Cancelled(_))), "{steps} of {}", 2 * facets);
        // Each thread ends what it has begun.
        let done = progress.steps();
        assert!(done < steps + 64.max(rayon::current_num_threads() as u64), "{done} after {steps}");
    }
}

/// Facets are made, and the matrix is put together, in steps that a caller can stop at.
#[test]
fn form_factors_stop_before_and_after_their_rays() {
    let model = model(&generated("cubes"), Detail::Rays);
    let options =
        FormFactorOptions { rays: Some(16), grouping: Grouping::Material, ..FormFactorOptions::default() };
    let all = Arc::new(at_ask(u64::MAX));
    model.with_progress(all.clone()).form_factors(&options).expect("form factors");
    let polygons = FormFactorOptions { grouping: Grouping::Polygon, ..options.clone() };
    let facets = model.form_factors(&polygons).expect("form factors").areas.len();
    let [asked, before, since] = [&all.asked, &all.before, &all.since].map(|n| n.load(Ordering::Relaxed));
    assert!(before >= facets as u64, "{before} questions while {facets} facets are made");
    assert!(since >= 2 * facets as u64, "{since} questions while {facets} rows are balanced and grouped");
    for at in [2, before / 2, asked - facets as u64 / 2] {
        assert!(
            matches!(model.with_progress(at_ask(at)).form_factors(&options), Err(Error::Cancelled(_))),
            "{at} of {asked}"
        );
    }
}

/// A bundle of many chunks is answered in parts, and stops between them.
#[test]
fn one_large_bundle_stops() {
    let model = model(&generated("cubes"), Detail::Optics);
    let [low, high] = model.scene().bounds().map(|corner| corner.map(|x| x as f32));
    let count = 5 << 14;
    let at = |i: usize, z: f32| {
        let [u, v, ..] = sobol_burley::sample_4d((i % 4096) as u32, 0, (i / 4096) as u32);
        [low[0] + u * (high[0] - low[0]), low[1] + v * (high[1] - low[1]), z]
    };
    let from: Vec<[f32; 3]> = (0..count).map(|i| at(i, low[2] + 0.01)).collect();
    let to: Vec<[f32; 3]> = (0..count).map(|i| at(i ^ 7, high[2] - 0.01)).collect();
    let whole = [0, count as u64];
    let segments = Segments::new(&from[..], &to[..], &whole).feature_size(0.5);
    let mut clear = Vec::new();
    for engine in [Engine::Exact, Engine::MultiResolution] {
        let visibility = model.visibility().with_engine(engine);
        let (mut found, mut each) = ([0.0], vec![7.0; count]);
        for at in [1, 4] {
            let watched = model.with_progress(at_ask(at)).visibility().with_engine(engine);
            let stopped = watched.answer_into(&segments, &mut Answers::new(&mut found));
            assert!(matches!(stopped, Err(Error::Cancelled(_))), "{engine:?} {at}");
        }
        visibility
            .answer_into(&segments, &mut Answers::new(&mut found).segments(&mut each))
            .expect("answers");
        let mean = each.iter().map(|&t| f64::from(t)).sum::<f64>() / count as f64;
        assert!((mean - f64::from(found[0])).abs() < 1e-5, "{engine:?}: {mean} {}", found[0]);
        visibility.answer_into(&segments, &mut Answers::new(&mut found)).expect("answers");
        clear.push(found[0]);
    }
    assert!((clear[0] - clear[1]).abs() < 0.02 && (0.1..0.99).contains(&clear[0]), "{clear:?}");
}

/// What the preparation of a model took does not shorten its solutions.
#[test]
fn the_time_of_a_solution_begins_with_its_call() {
    let light = |model: Model| {
        let options =
            SolveOptions { error: 0.2, audit: 0, max_seconds: Some(1e5), ..SolveOptions::default() };
        let solution = model.solve(&options).expect("light");
        let report = solution.report().clone();
        assert!(!report.warnings.iter().any(|w| w.contains("max_seconds")), "{:?}", report.warnings);
        (report.mean_irradiance, report.elements)
    };
    let slow = prepared_in(cornell(Detail::Clusters), 1e6);
    assert_eq!(light(slow), light(cornell(Detail::Clusters)));
}

#[test]
fn points_beyond_the_scene_are_refused() {
    let model = cornell(Detail::Clusters);
    let solution =
        model.solve(&SolveOptions { error: 0.5, audit: 0, ..SolveOptions::default() }).expect("light");
    let floor = SurfacePoint { position: [278.0, 0.0, 279.6], normal: [0.0, 1.0, 0.0] };
    for (point, want) in [
        (
            SurfacePoint { position: [1e300, 0.0, 0.0], ..floor },
            "`points`[1].position [1e300, 0.0, 0.0]: must be",
        ),
        (SurfacePoint { position: [0.0, f64::NAN, 0.0], ..floor }, "`points`[1].position [0.0, NaN, 0.0]"),
        (SurfacePoint { normal: [0.0; 3], ..floor }, "`points`[1].normal [0.0, 0.0, 0.0]: must be"),
    ] {
        let errors =
            [solution.irradiance(&[floor, point]).err(), model.reference(&[floor, point], 2, 1).err()];
        for error in errors {
            let error = error.expect(want).to_string();
            assert!(error.contains(want), "{error}");
        }
    }
}

#[test]
fn parameters_of_generated_scenes_count() {
    let mut options = GenerateOptions { count: Some(20), ..GenerateOptions::default() };
    let count =
        |options: &GenerateOptions| Scene::generate_with("cubes", options).expect("cubes").triangle_count();
    let few = count(&options);
    options.count = Some(40);
    assert!(count(&options) > few && Scene::generate_with("no such", &options).is_err());
    options.light_size = Some(-1.0);
    let error = Scene::generate_with("cubes", &options).expect_err("a size").to_string();
    assert!(error.contains("`light_size` -1"), "{error}");
}

#[test]
fn solutions_are_written_by_their_extension() {
    let solution = cornell(Detail::Clusters);
    let solution =
        solution.solve(&SolveOptions { error: 0.5, audit: 0, ..SolveOptions::default() }).expect("light");
    let folder = tempfile::tempdir().expect("a folder");
    for (name, begin) in [("a.vtu", "<?xml"), ("a.ply", "ply\n"), ("a.glb", "glTF")] {
        let path = folder.path().join(name);
        solution.write(&path).expect(name);
        assert!(std::fs::read(&path).expect(name).starts_with(begin.as_bytes()), "{name}");
        std::fs::remove_file(&path).expect(name);
        // Stopped at any time: either there is a complete file, or the work was cancelled and there is none.
        for at in 1.. {
            match solution.with_progress(at_ask(at)).write(&path) {
                Ok(()) => {
                    assert!(at > 2, "{name}: asked {} times", at - 1);
                    break;
                }
                Err(Error::Cancelled(_)) => assert!(!path.exists(), "{name} {at}"),
                Err(other) => panic!("{name} {at}: {other}"),
            }
        }
        assert!(path.exists());
    }
    assert!(solution.write(folder.path().join("a.doc")).unwrap_err().to_string().contains(".glb"));
}
