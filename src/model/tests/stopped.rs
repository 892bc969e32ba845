//! Preparations that the caller stops.

use crate::Error;
use crate::model::{Detail, Model, PrepareOptions};
use crate::progress::testing::stop_when;

/// A preparation ends in the stage in which it is stopped, whichever that is, and each stage asks often: no more than some thousand
/// triangles are treated between two questions.
#[test]
fn a_preparation_ends_in_the_stage_in_which_it_is_stopped() {
    let scene = crate::scene::testing::forest(40, 1000);
    let prepare = |stage: &'static str, detail| {
        let options = PrepareOptions { detail, ..PrepareOptions::default() };
        let stop = stop_when(move |told| told.stage == stage);
        let result = Model::prepare_watched(scene.clone().into(), &options, &stop);
        (result.err(), stop)
    };
    let cases = [
        ("building Embree's tree", Detail::Rays),
        ("building clusters", Detail::Clusters),
        ("building clusters", Detail::Optics),
        ("measuring clusters", Detail::Optics),
    ];
    for (stage, detail) in cases {
        let (error, stop) = prepare(stage, detail);
        assert!(matches!(error, Some(Error::Cancelled(_))), "{stage}: {error:?}");
        let begun = stop.begun();
        assert_eq!(begun.last().map(String::as_str), Some(stage), "{begun:?}");
    }
    for (detail, least) in [(Detail::Rays, 8), (Detail::Clusters, 1000), (Detail::Optics, 4000)] {
        let (error, stop) = prepare("none", detail);
        let asked = stop.asked();
        assert!(error.is_none() && asked >= least, "{detail:?}: asked {asked} times");
    }
}
