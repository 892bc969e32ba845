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

/// The fitted factor makes the mean of walks that of exact rays along the same segments.
#[test]
fn fitted_walks_have_the_mean_of_exact_rays() {
    let (stage, packets) = forest();
    let (engine, runs) = (stage.engine(LeafMode::Exact).with_patience(), runs(&stage, &packets));
    let mean = |route: Route, s: f32| {
        let found = answers(&engine.with_route(route), &runs, s);
        found.iter().map(|answer| f64::from(answer.transmittance)).sum::<f64>() / found.len() as f64
    };
    let mut fitted = 0;
    for s in stage.sizes() {
        let walks = engine.fitted_walks(&runs, s, &mut Workspace::default());
        let [exact, plain, found] = [Route::Exact, Route::WALKS, walks].map(|route| mean(route, s));
        let (before, after) = ((plain - exact).abs(), (found - exact).abs());
        if walks == Route::WALKS {
            assert!(before < 0.01, "{s}: {before}");
        } else {
            assert!(after < 2e-4 && before > 3.0 * after, "{s} {walks:?}: {before} before, {after} after");
            fitted += 1;
        }
    }
    assert!(fitted > 0);
}

/// If what is seen is what walks see, walks are taken; walks whose answers have nothing to do with what is seen are not.
#[test]
fn walks_are_taken_unless_they_err() {
    let (stage, packets) = forest();
    let (engine, s) = (stage.engine(LeafMode::Exact).with_patience(), SIZE * stage.size());
    let runs = runs(&stage, &packets);
    let taken_if_seen_by = |route: Route| {
        let seen = answers(&engine.with_route(route), &runs, s);
        let seen: Vec<f32> = seen.iter().map(|answer| answer.transmittance).collect();
        let reference = [seen.clone(), seen];
        let sample = RouteSample { runs: runs.clone(), reference: &reference };
        engine.route(&sample, &runs, s, &mut Workspace::default())
    };
    let walks = engine.fitted_walks(&runs, s, &mut Workspace::default());
    assert_eq!(taken_if_seen_by(walks), walks);
    let route = taken_if_seen_by(Route::Exact);
    assert!(matches!(route, Route::Exact | Route::Certified), "{route:?}");
}
