//! Features: MR images lack no shadow and no lit region of at least the feature size.

use glam::DVec3;
use mrvis::internals::bench;
use mrvis::internals::scene::generate::{self, Spec};
use mrvis::internals::scene::{LoadOptions, Soup, SoupMaterial, resolve};
use mrvis::{BenchOptions, Model};

/// Where all surfaces are large, nothing is averaged, and one row says so: a board between a lamp and a narrow floor.
#[test]
fn a_board_over_a_floor_has_one_row() {
    let mut soup = Soup::new("board");
    let grey = soup.material(SoupMaterial::diffuse("grey", [0.5; 3]));
    let light = soup.material(SoupMaterial::light("light", [1.0; 3]));
    for (name, material, [x, y], z) in [
        ("floor", grey, [8.0, 0.25], 0.0),
        ("board", grey, [1.5, 1.0], 1.0),
        ("lamp", light, [-1.0, 1.0], 2.0),
    ] {
        let object = soup.object(name);
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        soup.polygon(object, material, &corners.map(|(u, v)| DVec3::new(0.5 * x * u, 0.5 * y * v, z)));
    }
    let scene = resolve(soup, &LoadOptions::default()).expect("a scene");
    let mut options = BenchOptions::default();
    (options.points, options.reference_rays, options.rounds) = (100, 64, 1);
    let model = Model::prepare(scene, &options.prepare()).expect("a model");
    let (record, images) = bench::run(&model, &options, &()).expect("a benchmark");
    let sentence = record.nothing_averaged.as_ref().expect("nothing is averaged");
    assert!(sentence.starts_with("Nothing may be averaged in this scene"), "{sentence}");
    assert_eq!((record.mr.len(), record.mr[0].aggregated_fraction), (1, 0.0));
    assert!(!record.receivers.is_empty() && record.receivers.iter().all(|receiver| receiver.fbem.len() == 1));
    assert!(images.iter().all(|receiver| receiver.mr.len() == 1));
}

/// Leaves, touching bricks and books, rows of slats: at all four sizes MR images contain every connected feature of the exact shadow images
/// (docs/method.md, Feature-based error). Leaves are averaged, not handed over; other scenes may have exact rays alone, and say so in one
/// row.
#[test]
#[ignore = "long: full size"]
fn no_feature_of_the_size_is_missing() {
    check_features(
        ((20, 300), &[]),
        &[("forest", 1), ("cubes", 1), ("brick-wall", 2), ("louvres", 2), ("bookshelf", 2)],
    );
}

/// The same of few leaves, at two sizes that need few texels.
#[test]
fn no_feature_of_leaves_is_missing() {
    check_features(((4, 200), &[0.5, 1.0]), &[("forest", 1)]);
}

/// `sizes`: feature sizes; if empty, those that the images show.
fn check_features(((trees, leaves), sizes): ((usize, usize), &[f64]), scenes: &[(&str, usize)]) {
    for &(name, receivers) in scenes {
        let mut spec = Spec::new(name);
        (spec.trees, spec.leaves) = (trees, leaves);
        let scene = generate::build(&spec).expect(name);
        let mut options = BenchOptions::default();
        (options.points, options.reference_rays, options.rounds) = (200, 64, 1);
        options.feature_sizes = sizes.to_vec();
        let model = Model::prepare(scene, &options.prepare()).expect(name);
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
