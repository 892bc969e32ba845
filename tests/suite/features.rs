//! Features: MR images lack no shadow and no lit region of at least the feature size.

use mrvis::Model;
use mrvis::internals::bench::{self, Options};
use mrvis::internals::scene::generate::{self, Spec};

/// The surfaces of the Cornell box are large: nothing is averaged, and one row says so.
#[test]
fn a_scene_without_detail_has_one_row() {
    let scene = generate::build(&Spec::new("cornell")).expect("cornell");
    let options = Options { points: 200, reference_rays: 64, ..Options::default() };
    let model = Model::prepare(scene, &options.prepare(), &()).expect("a model");
    let (record, images) = bench::run(&model, &options, &()).expect("cornell");
    let sentence = record.nothing_averaged.expect("nothing is averaged");
    assert!(sentence.starts_with("Nothing may be averaged in this scene"), "{sentence}");
    assert_eq!((record.mr.len(), record.mr[0].aggregated_fraction), (1, 0.0));
    assert!(record.mr[0].speedup_at_same_rms.is_some_and(|speed| speed > 0.0));
    assert!(!record.receivers.is_empty() && record.receivers.iter().all(|receiver| receiver.fbem.len() == 1));
    assert!(images.iter().all(|receiver| receiver.mr.len() == 1));
}

/// Leaves, touching bricks and books, rows of slats: at all four sizes MR images contain every connected feature of the exact shadow images
/// (docs/method.md, Feature-based error). Leaves are averaged, not handed over; other scenes may have exact rays alone, and say so in one
/// row.
#[test]
fn no_feature_of_the_size_is_missing() {
    for (name, receivers) in
        [("forest", 1), ("cubes", 1), ("brick-wall", 2), ("louvres", 2), ("bookshelf", 2)]
    {
        let mut spec = Spec::new(name);
        (spec.trees, spec.leaves) = (20, 300);
        let scene = generate::build(&spec).expect(name);
        let options = Options { points: 200, rays: 16, reference_rays: 128, ..Options::default() };
        let model = Model::prepare(scene, &options.prepare(), &()).expect(name);
        let (record, _) = bench::run(&model, &options, &()).expect(name);
        if record.nothing_averaged.is_some() {
            assert!(name != "forest" && record.mr.len() == 1, "{name}: nothing is averaged at any size");
            continue;
        }
        let rows: Vec<_> = record.receivers.iter().flat_map(|r| &r.fbem).collect();
        let features: usize = rows.iter().map(|f| f.features).sum();
        let missing: usize = rows.iter().map(|f| f.missing_features).sum();
        assert!(record.receivers.len() >= receivers && features >= 10, "{name}: {features} features");
        assert_eq!(missing, 0, "{name}: {rows:?}");
    }
}
