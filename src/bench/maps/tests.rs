//! Maps of a small forest.

use crate::bench::BenchOptions;
use crate::bench::context::Bench;
use crate::bench::gallery::single_rays;
use crate::bench::measure::Timer;
use crate::bench::prepare::build_of;
use crate::bench::receivers::choose;
use crate::bench::workload::{Workload, surface_points};
use crate::model::{Detail, testing};
use crate::scene::testing::forest;
use crate::visibility::DistanceCut;
use std::sync::Arc;

/// More rays err less, MR rows that are handed over are rows of exact rays, and preparation makes no row faster.
#[test]
fn rows_of_a_map_are_consistent() {
    let model = testing::model(&forest(12, 300), Detail::Optics);
    let options = BenchOptions { map: Some(48), rays: 64, rounds: 1, ..BenchOptions::default() };
    let sizes = vec![0.2, 1.0];
    let timer = Timer::new(1).expect("a timer");
    let bench = Bench { model: &model, scene: model.scene(), options: &options, timer, sizes, progress: &() };
    let points = surface_points(&model, 200, 1).expect("points");
    let workload = Workload::new(&model, points, 1);
    let mut build = build_of(&model);
    let engine = bench.engine(&workload, &bench.sample(&workload), &mut build);
    let surfaces = choose(&model, &single_rays(&model), &["ground".into()]).expect("the ground");
    let maps = bench.maps(&surfaces, &engine, &build).expect("maps");
    let [map] = &maps[..] else { panic!("{} maps", maps.len()) };
    assert_eq!((map.receiver.as_str(), map.width, map.reference_rays), ("ground", 48, 256));
    assert!(map.height <= 48 && map.texel <= 0.1);
    let every: Vec<_> = map.exact.iter().filter(|row| !row.interpolated).collect();
    assert_eq!(every.iter().map(|row| row.rays).collect::<Vec<_>>(), [1, 4, 16, 64]);
    assert!(every.windows(2).all(|pair| pair[1].rms < 0.7 * pair[0].rms), "{every:?}");
    // The noise of the reference is subtracted: 64 independent rays err by more than it states.
    assert!(map.reference_rms < every[3].rms && map.reference_rms > 0.0, "{every:?}");
    // Interpolation between every second texel averages noise: fewer rays in all, and a smaller error than a quarter of them at every
    // texel.
    let halved = map.exact.iter().find(|row| row.spacing == 2 && row.rays == 16).expect("a row");
    assert!(halved.rms < every[1].rms, "{halved:?}");
    // Two sizes, four spacings and three of them with more segments, and the rows by the cache.
    let (cached, others): (Vec<_>, Vec<_>) = map.mr.iter().partition(|row| row.route == "cache");
    assert_eq!(others.len(), 14);
    assert!(cached.iter().all(|row| row.interpolated && row.setup_s > 0.0), "{cached:?}");
    assert!(map.mr.iter().any(|row| row.route == "bundle" && row.aggregated_fraction > 0.0), "{:?}", map.mr);
    for row in others {
        let same = map.exact.iter().find(|e| (e.rays, e.spacing) == (row.rays, row.spacing)).expect("a row");
        assert!(row.route != "embree" || (row.rms, row.bias) == (same.rms, same.bias), "{row:?}");
        let speeds = [row.speedup_at_same_rms, row.speedup_with_setup];
        let [queries, prepared] = speeds.map(|speed| speed.expect("a ratio"));
        assert!(queries > 0.0 && prepared <= queries, "{row:?}");
        assert!(row.rms > 0.0 && row.fbem <= 1.0, "{row:?}");
        // The time over that of exact rays at every texel with the same error.
        assert_eq!(row.speedup_over_texels.is_none(), row.is_exact(), "{row:?}");
        if let Some(same) = every.iter().find(|e| row.spacing == 1 && row.rms == e.rms && !row.is_exact()) {
            let ratio = same.seconds / (row.seconds + row.setup_s);
            assert!((row.speedup_over_texels.expect("a ratio") / ratio - 1.0).abs() < 1e-9, "{row:?}");
        }
    }
}

/// A map by the cache is as exact as one of as many segments at every texel, answers fewer texels by segments, and has the same bits on any
/// number of threads.
#[test]
fn the_cache_makes_the_same_map_on_any_number_of_threads() {
    let model = testing::model(&forest(12, 300), Detail::Optics);
    let options = BenchOptions { map: Some(128), reference_rays: 128, ..BenchOptions::default() };
    let bench = |threads| Bench {
        model: &model,
        scene: model.scene(),
        options: &options,
        timer: Timer::new(threads).expect("a timer"),
        sizes: vec![1.5],
        progress: &(),
    };
    let surfaces = choose(&model, &single_rays(&model), &["ground".into()]).expect("the ground");
    let grids = surfaces.maps(&model, &single_rays(&model), 128, 0.3);
    let engine = model.multi_resolution().expect("optics").clone();
    let engine = engine.with_cut(Some(Arc::new(DistanceCut::build(model.scene()))));
    let found = [1, 2].map(|threads| {
        let bench = bench(threads);
        let map = bench.prepared(&grids[0]).expect("a map").expect("light");
        let rows = bench.cached_rows(&map, &engine);
        assert_eq!(rows.len(), 2, "two numbers of segments");
        let texels: Vec<Vec<f32>> = rows.iter().map(|row| bench.texels_of(&map, row, &engine).0).collect();
        let errors: Vec<(f64, f64)> = texels.iter().map(|texels| map.reference.errors(texels)).collect();
        (texels, errors)
    });
    assert_eq!(found[0].0, found[1].0);
    for (rms, bias) in &found[0].1 {
        assert!(*rms < 0.05 && bias.abs() < 0.01, "{rms} {bias}");
    }
}
