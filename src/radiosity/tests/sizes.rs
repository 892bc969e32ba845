//! Feature sizes by importance.

use super::visibility::{forest, ground, refined};
use super::*;
use crate::radiosity::elements::Shape;

const SIZE: f32 = 0.05;
const PAINTED: f32 = 0.02;

/// The light on the ground matters, that on leaves only as far as it gets there; the trunks have a size of their own.
fn ground_matters() -> Options {
    Options {
        engine: Engine::MultiResolution,
        error: 0.05,
        feature_size: Some(SIZE),
        importance: vec!["ground".into()],
        ..Options::default()
    }
}

#[test]
fn sizes_grow_where_importance_is_small() {
    let scene = forest();
    let named = |name: &str| scene.faces_named(name).expect("a name");
    let (ground, trunks) = (named("ground"), named("bark"));
    let options = Options { feature_sizes: vec![("bark".into(), PAINTED)], ..ground_matters() };
    refined(&scene, &options, |linked| {
        let (mut painted, mut grown) = (0, Vec::new());
        let elements = &linked.elements.elements;
        for (e, element) in elements.iter().enumerate() {
            let (size, importance) =
                (linked.elements.states[e].feature_size, linked.elements.states[e].importance);
            let parent = element.parent as usize;
            if elements[parent].is_cluster() {
                assert!(
                    linked.elements.states[parent].feature_size <= size,
                    "{e}: a cluster is asked for all of its parts"
                );
            }
            let Shape::Surface { side, .. } = element.shape else { continue };
            let face = linked.elements.sides[side as usize].triangles[0];
            if trunks.contains(&face) {
                painted += 1;
                assert!(size == PAINTED, "{size}");
            } else if ground.contains(&face) {
                assert!(size == SIZE && importance > 0.1, "{size} {importance}");
            } else {
                assert!((size - SIZE / importance.sqrt()).abs() < 1e-6, "{size} {importance}");
                grown.push((importance, size));
            }
        }
        grown.sort_by(|a, b| b.0.total_cmp(&a.0));
        assert!(painted > 100 && grown.windows(2).all(|w| w[0].1 <= w[1].1), "monotone");
        // Neither all alike nor without end: seven times, for importance below a fiftieth.
        let (smallest, largest) = (grown[0].1, grown[grown.len() - 1].1);
        assert!(
            smallest < 5.0 * SIZE && largest > 1.5 * smallest && largest < 7.1 * SIZE,
            "{smallest} {largest}"
        );
        // Parts are born with the size of what they are parts of.
        let leaf = (0..elements.len()).rfind(|&e| {
            elements[e].is_leaf()
                && linked.elements.states[e].feature_size > SIZE
                && linked.elements.can_open(e as u32)
        });
        let (leaf, before) = (leaf.expect("a leaf"), elements.len());
        linked.split(leaf as u32);
        let states = &linked.elements.states;
        let size = states[leaf].feature_size;
        assert!(states.len() > before && states[before..].iter().all(|s| s.feature_size == size));
    });
}

/// Nothing changes where sizes follow from the elements or nothing is important.
#[test]
fn sizes_without_importance_are_those_given() {
    let all = Options { importance: Vec::new(), ..ground_matters() };
    refined(&forest(), &all, |linked| assert!(linked.elements.states.iter().all(|s| s.feature_size == SIZE)));
    let none = Options { feature_size: None, ..ground_matters() };
    refined(&forest(), &none, |linked| {
        let elements = &linked.elements.elements;
        assert!(
            elements.iter().zip(linked.elements.states.iter()).all(|(e, s)| s.feature_size == 2.0 * e.radius)
        );
    });
}

/// Rays that matter little meet clusters that are not opened for them.
#[test]
fn little_is_opened_where_it_matters_little() {
    let scene = generated("desk-room");
    let size = 0.2;
    let cup = vec!["cup".into()];
    let coarse = Options { min_area: 1e-3, audit: 0, ..ground_matters() };
    let options = Options { importance: cup, feature_size: Some(size), ..coarse };
    let solved = |options: &Options| solved(&scene, &[], options).record;
    let grown = solved(&options);
    // Sizes that are painted do not grow.
    let painted = scene.objects.iter().map(|o| (o.name.clone(), size)).collect();
    let even = solved(&Options { feature_sizes: painted, ..options });
    let averaged = |r: &Record| r.bundles.aggregated + r.bundles.mixed;
    assert!(averaged(&grown) > 2 * averaged(&even), "{:?} {:?}", grown.bundles, even.bundles);
    assert!(grown.bundles.exact < even.bundles.exact && grown.exact_rays < even.exact_rays);
    let [a, b] = [grown, even].map(|r| r.mean_irradiance[0]);
    assert!((a / b - 1.0).abs() < 0.01, "{a} {b}");
}

/// Shadow rays of given points ask for the feature size of the surface that the points lie on: its own, not that for all surfaces, and
/// for surfaces of little importance a larger one.
#[test]
fn points_have_the_feature_size_of_their_surface() {
    let scene = forest();
    let light_at = |points: &[Point], options: Options| {
        let options = Options {
            engine: Engine::MultiResolution,
            direct_only: true,
            elements: false,
            importance: Vec::new(),
            ..options
        };
        solved(&scene, points, &options).irradiance
    };
    // Points inside of trunks are on no surface that light reaches, and have the size of all surfaces.
    let mut points = ground(&scene, 400);
    let mut values = light_at(&points, ground_matters()).into_iter();
    points.retain(|_| values.next().is_some_and(|light| light[0] > 0.0));
    let light = |options: Options| light_at(&points, options);
    let all = |size: f32| Options { feature_size: Some(size), ..ground_matters() };
    let named = |name: &str, size| vec![(name.to_owned(), size)];
    let (fine, coarse) = (light(all(SIZE)), light(all(20.0 * SIZE)));
    assert!(fine != coarse, "nothing is averaged");
    assert!(light(Options { feature_sizes: named("ground", SIZE), ..all(20.0 * SIZE) }) == fine);
    assert!(light(Options { feature_sizes: named("ground", 20.0 * SIZE), ..all(SIZE) }) == coarse);
    assert!(light(Options { feature_sizes: named("bark", SIZE), ..all(20.0 * SIZE) }) == coarse);
}
