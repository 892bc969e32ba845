//! Preparations that the caller stops.

use crate::Error;
use crate::model::{Detail, Model, PrepareOptions};
use crate::progress::Progress;
use crate::scene::generate::{self, Spec};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Stops in the stage of this name and counts how often it is asked in each stage.
#[derive(Default)]
struct In {
    stage: &'static str,
    begun: Mutex<Vec<String>>,
    asked: AtomicUsize,
}

impl Progress for In {
    fn stage(&self, name: &str, _: u64) {
        self.begun.lock().unwrap().push(name.into());
    }

    fn stopped(&self) -> bool {
        self.asked.fetch_add(1, Ordering::Relaxed);
        self.begun.lock().unwrap().last().is_some_and(|last| last == self.stage)
    }
}

/// A preparation ends in the stage in which it is stopped, whichever that is, and each stage asks often: no more than some thousand
/// triangles are treated between two questions.
#[test]
fn a_preparation_ends_in_the_stage_in_which_it_is_stopped() {
    let spec = Spec { trees: 40, leaves: 1000, ..Spec::new("forest") };
    let scene = generate::build(&spec).expect("a forest");
    let prepare = |stage, detail| {
        let options = PrepareOptions { detail, ..PrepareOptions::default() };
        let stop = In { stage, ..In::default() };
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
        let begun = stop.begun.into_inner().unwrap();
        assert_eq!(begun.last().map(String::as_str), Some(stage), "{begun:?}");
    }
    for (detail, least) in [(Detail::Rays, 8), (Detail::Clusters, 1000), (Detail::Optics, 4000)] {
        let (error, stop) = prepare("none", detail);
        let asked = stop.asked.into_inner();
        assert!(error.is_none() && asked >= least, "{detail:?}: asked {asked} times");
    }
}
