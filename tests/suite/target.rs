//! Targets: choice, expectation and result agree; missed targets are reported.

use crate::run::Scratch;
use mrvis::internals::scene::generate::Spec;
use serde_json::Value;

/// Runs `bench` on a small forest; exit code and record.
fn bench(scratch: &Scratch, scene: &str, more: &[&str]) -> (Option<i32>, Value) {
    let options = [
        "--points",
        "300",
        "--reference-rays",
        "256",
        "--map",
        "0",
        "--rounds",
        "1",
        "--quiet",
        "--json",
        "found.json",
    ];
    let outcome = scratch.mrvis(&[&["bench", scene, "--cache", "off"], &options[..], more].concat());
    assert_eq!(outcome.stderr, "");
    (outcome.code, scratch.json("found.json"))
}

#[test]
fn estimates_without_bias_have_none() {
    let scratch = Scratch::new();
    let mut spec = Spec::new("forest");
    (spec.trees, spec.leaves) = (4, 200);
    let scene = scratch.generate(&spec);
    let (code, record) = bench(
        &scratch,
        &scene,
        &["--unbiased", "--tolerance", "0.2", "--extinction", "analytic", "--feature-size", "1"],
    );
    assert_eq!(code, Some(0));
    assert_eq!(record["clusters"]["extinction"], "analytic");
    let rows = record["unbiased"].as_array().expect("rows");
    let figure = |row: &Value, key: &str| row[key].as_f64().expect("a number");
    for row in rows {
        let (bias, error) = (figure(row, "bias"), figure(row, "bias_error"));
        assert!(bias.abs() < 4.0 * error, "{row}");
        assert_eq!(row["levels"].as_array().expect("levels").len(), 2);
    }
    // The error falls with the number of segments.
    assert!(figure(&rows[2], "rms") < 0.5 * figure(&rows[0], "rms"), "{rows:?}");
}
