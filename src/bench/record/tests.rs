//! Names in the JSON, and interpolation.

use super::*;

#[test]
fn names_of_classes_are_those_of_the_json() {
    let names: Vec<_> = ReceiverClass::ALL.map(|class| serde_json::to_value(class).unwrap()).into();
    assert_eq!(names, ReceiverClass::ALL.map(|class| serde_json::Value::from(class.name())));
}

/// Rows of an ideal method: error rays^(−1/2), one second per ray.
const IDEAL: [(f64, f64); 3] = [(4.0, 0.5), (1.0, 1.0), (16.0, 0.25)];

fn time(points: &[(f64, f64)], error: f64) -> f64 {
    interpolate_log_log(points, error).unwrap().seconds
}

#[test]
fn interpolation_and_extrapolation_follow_the_law() {
    for error in [1.0, 0.9, 0.5, 0.3, 0.25, 0.2, 0.01] {
        assert!((time(&IDEAL, error) * error * error - 1.0).abs() < 1e-12, "{error}");
        assert_eq!(interpolate_log_log(&IDEAL, error).unwrap().extrapolated, error < 0.25);
    }
    assert_eq!(time(&IDEAL, 7.0), 1.0);
}

#[test]
fn rows_that_are_no_better_do_not_count() {
    let noisy = [IDEAL[0], IDEAL[1], IDEAL[2], (2.0, 1.5), (5.0, 0.5), (20.0, 0.3)];
    for error in [0.8, 0.4, 0.1] {
        assert_eq!(time(&noisy, error), time(&IDEAL, error));
    }
}

#[test]
fn zeros_and_nonsense_are_survived() {
    assert_eq!(interpolate_log_log(&[], 0.1), None);
    assert_eq!(interpolate_log_log(&[(f64::NAN, 0.1), (1.0, f64::NAN), (0.0, 0.1), (1.0, -1.0)], 0.1), None);
    for error in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(interpolate_log_log(&IDEAL, error), None);
    }
    assert_eq!(time(&[(2.0, 0.5)], 0.25), 8.0);
    let perfect = [(1.0, 0.5), (3.0, 0.0)];
    assert_eq!(interpolate_log_log(&perfect, 0.1), Some(Interpolated { seconds: 3.0, extrapolated: false }));
    assert_eq!(time(&[(f64::NAN, 0.2), (1.0, 0.5)], 0.5), 1.0);
}

#[test]
fn the_best_row_ignores_unknown_speeds() {
    let row = |s| MrRow { speedup_at_same_rms: s, ..Default::default() };
    let record = Record {
        mr: vec![row(None), row(Some(3.0)), row(Some(f64::NAN)), row(Some(2.0))],
        ..Default::default()
    };
    assert_eq!(record.best().unwrap().speedup_at_same_rms, Some(3.0));
    assert!(Record::default().best().is_none());
}
