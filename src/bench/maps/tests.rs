//! Maps of a small forest.

use crate::bench::Options;
use crate::bench::context::Bench;
use crate::bench::gallery::single_rays;
use crate::bench::measure::Timer;
use crate::bench::prepare::build_of;
use crate::bench::receivers::choose;
use crate::bench::workload::{Workload, surface_points};
use crate::model::{Detail, testing};
use crate::scene::generate::{Spec, build};

/// More rays err less, MR rows that are handed over are rows of exact rays, and preparation makes no row faster.
#[test]
fn rows_of_a_map_are_consistent() {
    let mut spec = Spec::new("forest");
    (spec.trees, spec.leaves) = (12, 300);
    let scene = build(&spec).expect("a forest");
    let model = testing::model(&scene, Detail::Optics);
    let options = Options { map: Some(48), rays: 64, ..Options::default() };
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
    // Interpolation between every second texel averages noise: fewer rays in all, and a smaller error than a quarter of them at every texel.
    let halved = map.exact.iter().find(|row| row.spacing == 2 && row.rays == 16).expect("a row");
    assert!(halved.rms < every[1].rms, "{halved:?}");
    // Two sizes, four spacings.
    assert_eq!(map.mr.len(), 8);
    assert!(map.mr.iter().any(|row| row.route == "bundle" && row.aggregated_fraction > 0.0), "{:?}", map.mr);
    for row in &map.mr {
        let same = map.exact.iter().find(|e| (e.rays, e.spacing) == (row.rays, row.spacing)).expect("a row");
        assert!(row.route == "bundle" || (row.rms, row.bias) == (same.rms, same.bias), "{row:?}");
        let speeds = [row.speedup_at_same_rms, row.speedup_with_setup];
        let [queries, prepared] = speeds.map(|speed| speed.expect("a ratio"));
        assert!(queries > 0.0 && prepared <= queries, "{row:?}");
        assert!(row.rms > 0.0 && row.fbem <= 1.0, "{row:?}");
    }
}
