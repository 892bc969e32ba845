//! Choice of plans for targets.

use super::*;

fn expected(rays: usize, rms: f64, seconds: f64) -> Expected {
    let error = RmsEstimate { rms, lo: 0.9 * rms, hi: 1.1 * rms };
    Expected { plan: Plan { feature_size: None, rays, more: None }, error, seconds, partly: 0.0 }
}

#[test]
fn the_cheapest_that_is_good_enough_or_the_best_that_is_cheap_enough() {
    let plans = [expected(1, 0.4, 0.1), expected(4, 0.2, 0.4), expected(16, 0.05, 1.6)];
    let rays = |target| {
        let (best, reachable) = choose(&plans, target, 0.0);
        (best.plan.rays, reachable)
    };
    assert_eq!(rays(Target::Error(0.25)), (4, true));
    // The interval of an RMS of 0.2 reaches 0.22.
    assert_eq!(rays(Target::Error(0.21)), (16, true));
    assert_eq!(rays(Target::Error(0.01)), (16, false));
    assert_eq!(rays(Target::Seconds(1.0)), (4, true));
    assert_eq!(rays(Target::Seconds(100.0)), (16, true));
    assert_eq!(rays(Target::Seconds(0.01)), (1, false));
    // The pilot's time counts.
    assert_eq!(choose(&plans, Target::Seconds(1.0), 0.7).0.plan.rays, 1);
    assert!(!choose(&plans, Target::Seconds(1.0), 0.85).1);
}

#[test]
fn a_smaller_pilot_is_spread_as_evenly() {
    let all: Vec<usize> = (0..10).collect();
    assert_eq!(first_of_each(&all, 4, 2), [0, 1, 4, 5, 8, 9]);
    assert_eq!(first_of_each(&all, 4, 4), all);
    assert!(first_of_each(&[], 4, 2).is_empty());
}

/// Plans whose first query alone takes longer than a sufficient plan are not tried.
#[test]
fn plans_that_cannot_win_are_left_out() {
    let found = [expected(1, 0.4, 0.1), expected(4, 0.1, 0.4), expected(16, 0.05, 1.6)];
    let excluded = |rays, more, error| {
        let plan = Plan { feature_size: None, rays, more };
        cannot_win(plan, &found, Target::Error(error))
    };
    assert!(!excluded(1, Some(64), 0.2) && excluded(4, Some(64), 0.2) && excluded(64, None, 0.2));
    assert!(!excluded(64, None, 0.01), "nothing is good enough yet");
    let averaged = Plan { feature_size: Some(0.1), rays: 64, more: None };
    assert!(!cannot_win(averaged, &found, Target::Error(0.2)), "another engine may be faster");
    assert!(!cannot_win(Plan { feature_size: None, rays: 64, more: None }, &found, Target::Seconds(0.1)));
}

/// A target time includes the pilot.
#[test]
fn choosing_is_part_of_the_time() {
    use super::super::{Options, run};
    use crate::model::Model;
    use crate::scene::generate::{Spec, build};
    let mut spec = Spec::new("forest");
    (spec.trees, spec.leaves) = (4, 60);
    let scene = build(&spec).expect("a forest");
    let with = |seconds: f64| {
        let options = Options {
            points: 100,
            rays: 4,
            reference_rays: 16,
            feature_sizes: vec![1.0],
            rounds: 1,
            audit: 0.0,
            target: Some(Target::Seconds(seconds)),
            ..Options::default()
        };
        run(&Model::prepare(scene.clone(), &options.prepare(), &()).expect("a model"), &options, &())
            .expect("a record")
            .0
            .target
            .expect("a target")
    };
    let tight = with(1e-6);
    assert!(!tight.met && !tight.reachable && tight.pilot_s > 1e-6, "{tight:?}");
    let wide = with(2.0);
    assert_eq!(wide.met, wide.pilot_s + wide.seconds <= 2.0, "{wide:?}");
    assert!(wide.pilot_s > 0.0 && wide.seconds > 0.0, "{wide:?}");
}
