//! Equal scene, options and seed give equal results on any number of threads.

use crate::run::{Scratch, assert_same_lines};
use mrvis::internals::scene::generate::Spec;
use serde_json::Value;

/// Whether a key of the report is a time or derived from times.
fn is_timing(key: &str) -> bool {
    key.ends_with("_s")
        || key == "rounds"
        || key == "seconds"
        || key == "mode"
        || key == "coherent"
        || key == "threads"
        || key.starts_with("speedup")
        || key == "compared_with"
        // Embree allocates blocks of memory per thread.
        || key == "embree_bytes"
        || key == "bytes_per_triangle"
        // Origin of the clusters.
        || key.starts_with("cache")
}

pub fn strip(value: &mut Value) {
    match value {
        Value::Object(map) => {
            map.retain(|key, _| !is_timing(key));
            map.values_mut().for_each(strip);
        }
        Value::Array(items) => items.iter_mut().for_each(strip),
        _ => {}
    }
}

#[test]
fn bench_reports_the_same_figures_on_any_number_of_threads() {
    let scratch = Scratch::new();
    let scene = scratch.forest(4, 100);
    let report = |threads: &str| {
        // At this feature size half of the rays meet clusters that are averaged.
        let few = "--points 120 --rays 4 --feature-size 2 --reference-rays 32 --map 24 --rounds 1 --seed 5";
        let call = format!("bench {scene} --threads {threads} --json r.json --quiet --cache off {few}");
        scratch.mrvis(&call).exits(0);
        let mut json = scratch.json("r.json");
        strip(&mut json);
        json
    };
    let (one, two) = (report("1"), report("2"));
    assert!(one.to_string().len() > 500, "nothing left to compare: {one}");
    let averaged =
        one["mr"].as_array().expect("rows").iter().filter_map(|row| row["aggregated_fraction"].as_f64());
    assert!(averaged.fold(0.0, f64::max) > 0.2, "nothing is averaged: {one}");
    assert_same_lines(&format!("{one:#}"), &format!("{two:#}"), "one thread and two");
}

/// Cached clusters give the results of measured ones; a damaged file is not used.
#[test]
fn bench_reports_the_same_figures_with_a_cache() {
    let scratch = Scratch::new();
    let scene =
        scratch.generate(&Spec { trees: 2, leaves: 100, light_size: Some(1.0), ..Spec::new("forest") });
    let report = |cache: &str, want: &str| {
        let quick = "--points 60 --rays 1 --reference-rays 8 --map 0 --rounds 1 --feature-size 0.2";
        scratch.mrvis(&format!("bench {scene} {quick} --quiet --json r.json {cache}")).exits(0);
        let mut json = scratch.json("r.json");
        assert_eq!(json["build"]["cache"], want);
        let noted = json["build"].get("cache_note").is_some();
        strip(&mut json);
        (json, noted)
    };
    let measured = report("--cache off", "off");
    assert!(!measured.1);
    assert_eq!(report("", "made"), measured);
    assert_eq!(report("", "hit"), measured);
    assert_eq!(report("--cache folder", "made"), measured);
    let kept = std::fs::read_dir(scratch.path("cache/mrvis"))
        .expect("the user's folder")
        .flatten()
        .map(|e| e.path());
    let file = kept.into_iter().find(|p| p.extension().is_some_and(|e| e == "mrvis-cache")).expect("a cache");
    let mut bytes = std::fs::read(&file).expect("read");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&file, &bytes).expect("written");
    assert_eq!(report("", "made"), (measured.0.clone(), true));
    assert_eq!(report("", "hit"), measured);
}
