//! Benchmarks and references from the front door.

use crate::model::{Detail, testing::model};
use crate::progress::testing::stop_when;
use crate::scene::testing::{forest, generated};
use crate::{Answers, BenchOptions, Error, Segments, SolveOptions, Strided, SurfacePoint};
use std::sync::Arc;

#[test]
fn benchmarks_have_a_record_and_a_page() {
    let model_of = |detail| model(&forest(4, 40), detail);
    let optics = model_of(Detail::Optics);
    let options = BenchOptions {
        points: 60,
        rays: 2,
        reference_rays: 16,
        feature_sizes: vec![1.0, 0.5],
        audit: 0.0,
        rounds: 1,
        ..BenchOptions::default()
    };
    let report = optics.bench(&options).unwrap();
    let record: serde_json::Value = serde_json::from_str(&report.json).unwrap();
    assert_eq!((&record["workload"]["points"], &record["seed"]), (&60.into(), &1.into()));
    let sizes = record["mr"].as_array().unwrap().iter().map(|row| row["feature_size"].as_f64().unwrap());
    assert!(sizes.clone().all(|s| s == 0.5 || s == 1.0) && sizes.count() == 6);
    assert_eq!(report.rows.len(), 6);
    assert!(report.rows.iter().all(|row| row.seconds > 0.0 && (0.0..=1.0).contains(&row.aggregated)));
    assert!(report.page.starts_with("<!DOCTYPE html>") && !report.page.contains("<pre>"));

    let says = |result: crate::Result<_>, part: &str| {
        let message = result.err().unwrap().to_string();
        assert!(message.contains(part), "{message}");
    };
    says(model_of(Detail::Clusters).bench(&options), "prepare the model with `Detail::Optics`");
    says(optics.bench(&BenchOptions { points: 0, ..options.clone() }), "`points` 0");
    says(optics.bench(&BenchOptions { receivers: vec!["nobody".into()], ..options.clone() }), "nobody");
    assert!(matches!(optics.with_progress(stop_when(|_| true)).bench(&options), Err(Error::Cancelled(_))));
}

#[test]
fn references_agree_with_solutions() {
    let model = model(&generated("cornell"), Detail::Clusters);
    let floor = SurfacePoint { position: [278.0, 0.0, 279.6], normal: [0.0, 2.0, 0.0] };
    let found = model.reference(&[floor], 4096, 1).unwrap();
    let solved = model.solve(&SolveOptions { error: 0.05, ..SolveOptions::default() }).unwrap();
    let light = solved.irradiance(&[floor]).unwrap()[0];
    for (k, light) in light.into_iter().enumerate() {
        let (want, noise) = (found.irradiance[0][k], found.standard_errors[0][k]);
        assert!(noise > 0.0 && noise < 0.05 * want, "{noise} {want}");
        assert!((light - want).abs() < 4.0 * noise + 0.05 * want, "{light} {want}");
    }
    assert!(model.reference(&[floor], 1, 1).unwrap_err().to_string().contains("`samples` 1"));
    assert!(matches!(
        model.with_progress(stop_when(|_| true)).reference(&[floor], 8, 1),
        Err(Error::Cancelled(_))
    ));
}

#[test]
fn batches_stop_in_their_middle() {
    let model = model(&generated("cornell"), Detail::Rays);
    let (ends, offsets) = ([100.0f32, 100.0, 100.0, 400.0, 400.0, 400.0], Vec::from_iter(0..=100_000));
    let [from, to] = [&ends[..3], &ends[3..]].map(|p| Strided::repeated(p.try_into().unwrap(), 100_000));
    let (segments, mut clear) = (Segments::new(from, to, &offsets), vec![-1.0; 100_000]);
    let steps = Arc::new(stop_when(|c| c.steps >= 1));
    let found =
        model.with_progress(steps.clone()).visibility().answer_into(&segments, &mut Answers::new(&mut clear));
    assert!(matches!(found, Err(Error::Cancelled(_))));
    assert!(clear.contains(&-1.0) && steps.steps() < 100_000);
    let steps = Arc::new(stop_when(|_| false));
    model
        .with_progress(steps.clone())
        .visibility()
        .answer_into(&segments, &mut Answers::new(&mut clear))
        .unwrap();
    assert!(!clear.contains(&-1.0) && steps.steps() == 100_000);
}
