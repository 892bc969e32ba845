//! Classes of points in made scenes, and the rows of a small forest.

use super::Surroundings;
use crate::bench::BenchOptions;
use crate::bench::record::ReceiverClass;
use crate::bench::workload::{ReceiverPoint, Workload, surface_points};
use crate::model::{Detail, testing};
use crate::scene::Scene;
use crate::scene::testing::{Pieces, forest};
use glam::{DVec3, Vec3};

/// Classes of points (position, normal) of a scene.
fn classes<const N: usize>(scene: &Scene, points: [([f32; 3], Vec3); N]) -> [ReceiverClass; N] {
    let model = testing::model(scene, Detail::Rays);
    let origin = scene.origin.as_vec3();
    let magnitude = model.magnitude();
    let point = |(at, normal)| ReceiverPoint { position: Vec3::from(at) - origin, normal, magnitude };
    let found = Surroundings::of(&model).classes(&points.map(point), 1);
    found.try_into().expect("a class a point")
}

/// All of a closed room is interior, whatever stands in it, and so it is whichever way its lamp looks.
#[test]
fn a_closed_room_is_interior() {
    let mut room = Pieces::new();
    room.room(DVec3::new(-2.0, -2.0, 0.0), DVec3::new(2.0, 2.0, 3.0));
    room.light(DVec3::new(0.0, 0.0, 2.9), 0.5 * DVec3::Y, 0.5 * DVec3::X);
    // A pencil on the floor.
    room.quad(DVec3::new(1.0, 0.0, 0.02), 0.05 * DVec3::X, 0.01 * DVec3::Y);
    let points = [
        ([1.5, 1.5, 0.0], Vec3::Z),
        ([-2.0, 0.5, 1.5], Vec3::X),
        ([1.0, 0.06, 0.0], Vec3::Z),
        ([1.0, 0.0, 0.02], Vec3::Z),
    ];
    assert_eq!(classes(&room.scene(), points), [ReceiverClass::Interior; 4]);
}

/// A floor under a sky, 140 m from corner to corner: leaves of 20 cm are small, and near within 2.2 m; a wall is large.
#[test]
fn leaves_are_small_and_walls_are_not() {
    let mut garden = Pieces::new();
    garden.quad(DVec3::ZERO, 90.0 * DVec3::X, 90.0 * DVec3::Y);
    garden.light(DVec3::new(0.0, 0.0, 50.0), 90.0 * DVec3::Y, 90.0 * DVec3::X);
    garden.quad(DVec3::new(-30.0, 0.0, 4.0), 20.0 * DVec3::Y, 8.0 * DVec3::Z);
    // A patch of leaves, a step apart, in three layers; one of them 1 m above the ground, and one patch 10 m above it.
    for (x, height) in [(0.0, 1.0), (20.0, 10.0)] {
        for k in 0..3 * 15 * 15 {
            let [i, j, layer] = [k % 15, k / 15 % 15, k / 225].map(f64::from);
            let at = DVec3::new(x + 0.4 * (i - 7.0), 0.4 * (j - 7.0), height + 0.3 * layer);
            garden.quad(at, 0.2 * DVec3::X, 0.2 * DVec3::Y);
        }
    }
    let points = [
        ([0.0, 0.0, 1.3], Vec3::Z),
        ([0.0, 0.0, 1.0], Vec3::NEG_Z),
        ([0.2, 0.2, 0.0], Vec3::Z),
        ([20.2, 0.2, 0.0], Vec3::Z),
        ([-28.0, 0.0, 0.0], Vec3::Z),
        ([-30.0, 0.0, 4.0], Vec3::X),
        ([30.0, 30.0, 0.0], Vec3::Z),
    ];
    use ReceiverClass::{Inside, Near, Open};
    assert_eq!(classes(&garden.scene(), points), [Inside, Inside, Near, Open, Open, Open, Open]);
}

/// In a forest leaves and ground are classes of their own, with rows and routes of their own.
#[test]
fn a_forest_has_rows_by_class() {
    let model = testing::model(&forest(9, 200), Detail::Optics);
    let options = BenchOptions {
        points: 600,
        rays: 4,
        feature_sizes: vec![1.0],
        reference_rays: 64,
        rounds: 1,
        audit: 0.0,
        ..BenchOptions::default()
    };
    let (record, _) = crate::bench::run(&model, &options, &()).expect("a record");
    let workload = Workload::new(&model, surface_points(&model, 600, options.seed).expect("points"), 1);
    let (all, points) =
        (workload.facing_points().len(), record.classes.iter().map(|class| class.points).sum::<usize>());
    // Classes of fewer than 50 points are left out.
    assert!(points <= all && all - points < 2 * 50, "{points} of {all}");
    let found: Vec<ReceiverClass> = record.classes.iter().map(|class| class.class).collect();
    assert!(found.len() >= 2 && found.contains(&ReceiverClass::Inside), "{found:?}");
    assert!(!found.contains(&ReceiverClass::Interior), "{found:?}");
    for class in &record.classes {
        assert!(class.measured >= 50 && class.measured <= class.points, "{class:?}");
        assert_eq!(class.exact.iter().map(|row| row.rays).collect::<Vec<_>>(), [1, 4, 16, 64, 256]);
        assert!(class.exact.windows(2).all(|pair| pair[1].rms < pair[0].rms), "{class:?}");
        assert!(!class.mr.is_empty() && class.reference_rms > 0.0);
    }
    for row in record.mr.iter().chain(record.classes.iter().flat_map(|class| &class.mr)) {
        assert!(["bundle", "cut", "certified", "embree"].contains(&row.route.as_str()), "{row:?}");
        assert!(row.seconds > 0.0 && (row.route != "embree" || row.handed_over == 1.0), "{row:?}");
    }
}
