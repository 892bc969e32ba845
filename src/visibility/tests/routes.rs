//! Routes of bundles: which is taken, and the factor of extinctions of walks.

use super::*;

/// Feature size of the walks, of the scene's diagonal.
const SIZE: f32 = 0.05;

fn forest() -> (Stage, Vec<Packet>) {
    let stage = Stage::generated("forest");
    let packets = stage.bundles(5, 256, LANES);
    (stage, packets)
}

fn runs<'a>(stage: &Stage, packets: &'a [Packet]) -> Vec<Vec<Bundle<'a>>> {
    let size = 0.2 * stage.size();
    packets.chunks(8).map(|run| run.iter().map(|packet| Bundle::of_packet(packet, size)).collect()).collect()
}

fn answers(engine: &MultiResolution, runs: &[Vec<Bundle>], s: f32) -> Vec<Answer> {
    let (mut found, mut workspace) = (Vec::new(), Workspace::default());
    runs.iter().for_each(|run| engine.answers(run, s, &mut workspace, |answer| found.push(answer)));
    found
}

/// If what is seen is what walks with some factor of all extinctions see, that factor is found, and walks are taken.
#[test]
fn the_factor_of_walks_is_found() {
    let (stage, packets) = forest();
    let (engine, s) = (stage.engine(LeafMode::Exact).with_patience(), SIZE * stage.size());
    let runs = runs(&stage, &packets);
    for factor in [0.8, 1.0, 1.15] {
        let seen = answers(&engine.with_route(Route::Walks { factor }), &runs, s);
        let seen: Vec<f32> = seen.iter().map(|answer| answer.transmittance).collect();
        let truth = [seen.clone(), seen];
        let sample = RouteSample { runs: runs.clone(), finest: runs.clone(), truth: &truth };
        match engine.route(&sample, s, &mut Workspace::default()) {
            Route::Walks { factor: found } => assert!((found - factor).abs() < 0.005, "{found} for {factor}"),
            other => panic!("{other:?} for {factor}"),
        }
    }
}

/// Walks whose answers have nothing to do with what is seen are not taken.
#[test]
fn walks_that_err_are_not_taken() {
    let (stage, packets) = forest();
    let (engine, s) = (stage.engine(LeafMode::Exact).with_patience(), SIZE * stage.size());
    let runs = runs(&stage, &packets);
    let exact = answers(&engine.with_route(Route::Exact), &runs, s);
    let seen: Vec<f32> = exact.iter().map(|answer| answer.transmittance).collect();
    let truth = [seen.clone(), seen];
    let sample = RouteSample { runs: runs.clone(), finest: runs.clone(), truth: &truth };
    let route = engine.route(&sample, s, &mut Workspace::default());
    assert!(matches!(route, Route::Exact | Route::Certified), "{route:?}");
}

/// Exact rays with and without certificates see the same.
#[test]
fn certificates_change_no_fraction() {
    let (stage, packets) = forest();
    let (engine, runs) = (stage.engine(LeafMode::Exact), runs(&stage, &packets));
    let [plain, certified] = [Route::Exact, Route::Certified]
        .map(|route| answers(&engine.with_route(route), &runs, SIZE * stage.size()));
    let same = plain.iter().zip(&certified).filter(|(a, b)| a.transmittance == b.transmittance).count();
    assert!(same as f64 > 0.99 * plain.len() as f64, "{same} of {}", plain.len());
    assert!(certified.iter().all(|answer| answer.cost.aggregated == 0));
}
