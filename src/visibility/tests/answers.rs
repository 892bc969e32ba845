//! Intervals, certificates and stated errors of answers.

use super::*;
use crate::scene::testing::forest;

/// See `wilson_interval`.
#[test]
fn intervals_hold_their_answers() {
    for name in ["forest", "cubes", "desk-room"] {
        let stage = Stage::generated(name);
        let (engine, exact) =
            (stage.engine(LeafMode::Exact), Exact { scene: stage.traced.clone(), traversal: SINGLE });
        let (mut workspace, mut blocked) = (Workspace::default(), Vec::new());
        for lanes in [1, 4, 16] {
            let bundles = stage.bundles(23, 150, lanes);
            for packets in bundles.chunks(1).chain(bundles.chunks(2)) {
                let n = packets.iter().map(Packet::len).sum::<usize>() as u64;
                for s in stage.sizes() {
                    let bundle = Bundle {
                        packets,
                        emitter_size: 0.2 * stage.scene.emitters[0].min_width,
                        emitter: &[],
                    };
                    let answer = engine.answer(bundle, s, &mut workspace);
                    let reference = exact.answer(bundle, &mut blocked);
                    for Answer { transmittance, lo, hi, cost, .. } in [answer, reference] {
                        assert!(
                            0.0 <= lo && lo <= transmittance && transmittance <= hi && hi <= 1.0,
                            "{answer:?}"
                        );
                        assert!(hi > lo && cost.segments == n, "{answer:?}");
                        assert!(
                            cost.exact_rays <= n
                                && cost.aggregated <= n
                                && cost.handed_over <= cost.exact_rays
                        );
                    }
                    let mut mean = 0.0;
                    for p in packets {
                        mean += engine
                            .transmittances(p, bundle.emitter_size, s, &mut workspace)
                            .iter()
                            .sum::<f32>()
                            / n as f32;
                    }
                    // Larger bundles may open other clusters, and adjacent segments are folded.
                    assert!(
                        packets.len() > 1 || (mean - answer.transmittance).abs() < 1e-5,
                        "{mean}: {answer:?}"
                    );
                    match answer.method {
                        Method::Clear => assert!(answer.transmittance == 1.0 && answer.cost.exact_rays == 0),
                        Method::Covered => {
                            assert!(answer.transmittance == 0.0 && answer.cost.exact_rays == 0)
                        }
                        Method::Exact => assert!(answer.cost.aggregated == 0 && answer.cost.exact_rays > 0),
                        Method::Aggregated => {
                            assert!(answer.cost.exact_rays == 0 && answer.cost.aggregated > 0)
                        }
                        Method::Mixed => assert!(answer.cost.exact_rays > 0 && answer.cost.aggregated > 0),
                    }
                    assert_eq!(reference.method, Method::Exact);
                }
            }
        }
    }
}

/// Certificates change no answer: bundles queried for exact visibility, except those that an empty shaft or one
/// triangle decides, agree with rays segment by segment, and no cluster is aggregated.
#[test]
fn certified_answers_are_exact() {
    for name in ["forest", "cubes", "desk-room"] {
        let stage = Stage::generated(name);
        let engine = stage.engine(LeafMode::Exact);
        let exact = Exact { scene: stage.traced.clone(), traversal: SINGLE };
        let (mut workspace, mut blocked) = (Workspace::default(), Vec::new());
        let packets = stage.bundles(29, 600, 16);
        let e = stage.scene.emitters[0].min_width;
        let bundles: Vec<Bundle> =
            packets.chunks(1).map(|packets| Bundle { packets, emitter_size: e, emitter: &[] }).collect();
        let (mut k, mut without_rays, mut apart) = (0, 0, 0);
        engine.certified(&bundles, &mut workspace, |answer| {
            let reference = exact.answer(bundles[k], &mut blocked);
            assert_eq!(answer.cost.aggregated, 0);
            without_rays += usize::from(answer.cost.exact_rays == 0);
            apart += usize::from((answer.transmittance - reference.transmittance).abs() > 1e-6);
            k += 1;
        });
        assert_eq!(k, bundles.len());
        // Grazing segments may differ by rounding.
        assert!(apart <= bundles.len() / 100, "{name}: {apart} of {} differ", bundles.len());
        assert!(without_rays > 0, "{name}: no certificate in {} bundles", bundles.len());
    }
}

/// Stated intervals contain the truth at their stated rate, for fields of leaves at every distance where aggregation
/// begins, and stated errors have the magnitude of the actual errors.
#[test]
fn claimed_errors_are_those_that_are_there() {
    let stage = Stage::new(forest(20, 300));
    let engine = stage.engine(LeafMode::Exact).with_tolerance(0.1);
    let model = crate::model::testing::model(&stage.scene, crate::model::Detail::Rays);
    let points = crate::bench::workload::surface_points(&model, 600, 3).expect("points");
    use crate::bench::workload::Workload;
    let workload = Workload::new(&model, points, 3);
    let exact = Exact { scene: stage.traced.clone(), traversal: SINGLE };
    let (mut workspace, mut blocked) = (Workspace::default(), Vec::new());
    for s in [0.1f32, 0.4] {
        let (mut inside, mut count, mut claimed, mut there, mut aggregated) = (0, 0, 0.0f64, 0.0f64, 0);
        for pair in 0..workload.pairs.len() {
            let (mut packets, mut reference) = (Vec::new(), Vec::new());
            workload.add_bundle(&stage.scene, pair, 256, 0, &mut packets);
            workload.add_bundle(&stage.scene, pair, 4096, 1, &mut reference);
            let e = workload.pairs[pair].emitter_size;
            let answer =
                engine.answer(Bundle { packets: &packets, emitter_size: e, emitter: &[] }, s, &mut workspace);
            if answer.cost.aggregated == 0 {
                continue;
            }
            let reference = exact
                .answer(Bundle { packets: &reference, emitter_size: e, emitter: &[] }, &mut blocked)
                .transmittance;
            let Answer { transmittance, lo, hi, .. } = answer;
            count += 1;
            aggregated += usize::from(answer.method == Method::Aggregated);
            inside += u32::from(lo - 0.01 <= reference && reference <= hi + 0.01);
            claimed += f64::from((hi - lo) / 3.92).powi(2);
            there += f64::from(transmittance - reference).powi(2);
        }
        let (claimed, there) = ((claimed / f64::from(count)).sqrt(), (there / f64::from(count)).sqrt());
        assert!(count > 200 && aggregated > 20, "{count} answers, {aggregated} of them without a triangle");
        let coverage = f64::from(inside) / f64::from(count);
        assert!(coverage >= 0.93, "s {s}: {coverage} of {count} inside, claimed {claimed}, there {there}");
        assert!(claimed < 2.5 * there && there < 1.5 * claimed, "s {s}: claimed {claimed}, there {there}");
    }
}

/// Wilson's interval for 4 of 16: 0.1018 to 0.4950 (Wilson 1927, z = 1.96), and its limits.
///
/// For a mean of 1 the upper end must not be rounded to 0.99999994: the interval of a clear bundle would exclude its
/// own answer (and `interval_coverage` of an unoccluded scene would be 0).
#[test]
fn wilson_interval() {
    let (lo, hi) = wilson(0.25, 16.0);
    assert!((lo - 0.1018).abs() < 5e-4 && (hi - 0.4950).abs() < 5e-4, "{lo} {hi}");
    // 0 of n: z² / (n + z²).
    let (lo, hi) = wilson(0.0, 16.0);
    assert!(lo == 0.0 && (hi - 3.8416 / 19.8416).abs() < 1e-4, "{lo} {hi}");
    let (lo, hi) = wilson(1.0, 16.0);
    assert!((lo - (1.0 - 3.8416 / 19.8416)).abs() < 1e-4 && hi > 0.9999, "{lo} {hi}");
    // The interval contains the mean, also at 0 and 1.
    for n in 1..=1024 {
        for clear in 0..=n {
            let mean = clear as f32 / n as f32;
            let (lo, hi) = wilson(mean, n as f32);
            assert!(0.0 <= lo && lo <= mean && mean <= hi && hi <= 1.0, "{clear} of {n}: {lo} to {hi}");
        }
    }
}
