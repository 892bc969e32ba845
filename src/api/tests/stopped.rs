//! Work that a caller stops, and the time that a caller allows.

use crate::model::testing::{model, prepared_in};
use crate::model::{Detail, Model};
use crate::scene::Scene;
use crate::{Error, FormFactorOptions, GenerateOptions, Progress, SolveOptions, SurfacePoint};
use std::sync::atomic::{AtomicU64, Ordering};

/// Stops when so many steps are done.
struct After {
    steps: u64,
    done: AtomicU64,
}

impl Progress for After {
    fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
    }

    fn stopped(&self) -> bool {
        self.done.load(Ordering::Relaxed) >= self.steps
    }
}

fn after(steps: u64) -> After {
    After { steps, done: AtomicU64::new(0) }
}

fn cornell(detail: Detail) -> Model {
    model(&Scene::generate("cornell").expect("a scene"), detail)
}

/// Rays to find partners, rays of pairs, and the adjustment all end early; a caller who never stops gets all steps.
#[test]
fn form_factors_stop_at_any_step() {
    let model = cornell(Detail::Rays);
    let options = FormFactorOptions::default();
    let all = after(u64::MAX);
    let facets = model.form_factors(&options, &all).expect("form factors").len() as u64;
    assert_eq!(all.done.load(Ordering::Relaxed), 2 * facets);
    for steps in [0, 1, facets, facets + 1, 2 * facets] {
        let progress = after(steps);
        let result = model.form_factors(&options, &progress);
        assert!(matches!(result, Err(Error::Cancelled(_))), "{steps} of {}", 2 * facets);
        // Each thread ends what it has begun.
        let done = progress.done.load(Ordering::Relaxed);
        assert!(done < steps + 64.max(rayon::current_num_threads() as u64), "{done} after {steps}");
    }
}

/// What the preparation of a model took does not shorten its solutions.
#[test]
fn the_time_of_a_solution_begins_with_its_call() {
    let light = |model: Model, seconds: Option<f64>| {
        let options = SolveOptions::default().with_error(0.2).with_audit(0);
        let options = seconds.iter().fold(options, |options, &seconds| options.with_max_seconds(seconds));
        let solution = model.solve(&options, &()).expect("light");
        assert!(!solution.warnings().iter().any(|w| w.contains("max_seconds")), "{:?}", solution.warnings());
        (solution.mean_irradiance(), solution.element_count())
    };
    let slow = prepared_in(cornell(Detail::Clusters), 1e6);
    assert_eq!(light(slow, Some(1e5)), light(cornell(Detail::Clusters), None));
}

#[test]
fn points_beyond_the_scene_are_refused() {
    let model = cornell(Detail::Clusters);
    let solution = model.solve(&SolveOptions::default().with_error(0.5).with_audit(0), &()).expect("light");
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
            [solution.irradiance(&[floor, point]).err(), model.reference(&[floor, point], 2, 1, &()).err()];
        for error in errors {
            let error = error.expect(want).to_string();
            assert!(error.contains(want), "{error}");
        }
    }
    let camera = solution.automatic_camera(&()).expect("a camera");
    let camera = crate::Camera { eye: [1e300; 3], ..camera };
    let error = solution.image(&camera, &crate::ImageOptions::default().with_size(1, 1), &mut [0.0; 3], &());
    assert!(error.unwrap_err().to_string().contains("`camera.eye`"));
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
    assert!(error.contains("light_size -1"), "{error}");
}

#[test]
fn solutions_are_written_by_their_extension() {
    let solution = cornell(Detail::Clusters);
    let solution =
        solution.solve(&SolveOptions::default().with_error(0.5).with_audit(0), &()).expect("light");
    let folder = tempfile::tempdir().expect("a folder");
    for (name, begin) in [("a.vtu", "<?xml"), ("a.ply", "ply\n"), ("a.glb", "glTF")] {
        let path = folder.path().join(name);
        solution.write(&path, &()).expect(name);
        assert!(std::fs::read(&path).expect(name).starts_with(begin.as_bytes()), "{name}");
        std::fs::remove_file(&path).expect(name);
        assert!(matches!(solution.write(&path, &after(0)), Err(Error::Cancelled(_))) && !path.exists());
    }
    assert!(solution.write(folder.path().join("a.doc"), &()).unwrap_err().to_string().contains(".glb"));
}
