//! Selection of receivers and position of their texels.

use super::*;
use crate::model::{Detail, testing};
use crate::ray::Brute;
use crate::scene::generate::{Spec, build};
use glam::{DVec3, Vec3};

fn cornell() -> Scene {
    build(&Spec::new("cornell")).unwrap()
}

#[test]
fn rectangles_fit_tilted_quads() {
    let scene = cornell();
    // The top of the tall block is turned about the vertical; its rectangle is a square of about 165 mm.
    let faces: Vec<u32> = (0..scene.triangles.len() as u32).collect();
    let patches = patches(&scene, &faces);
    assert!(
        patches.iter().all(|p| p.filled() > 0.95 && p.filled() < 1.0 + 1e-5),
        "all its surfaces are quads"
    );
    for p in &patches {
        let Rectangle { right, normal, centre, width, height, rise } = p.rectangle;
        assert!(right.dot(normal).abs() < 1e-5 && width >= height);
        let up = normal.cross(right);
        for corner in p.triangles.iter().flat_map(|&t| scene.corners(t)) {
            let d = corner.as_dvec3() - centre;
            assert!(d.dot(right).abs() < 0.5001 * width && d.dot(up).abs() < 0.5001 * height);
            assert!(d.dot(normal) <= rise[0] && -d.dot(normal) <= rise[1]);
            assert!(d.dot(normal).abs() < 0.02 * width);
        }
    }
}

#[test]
fn default_receivers_are_lit_and_distinct() {
    let scene = cornell();
    let model = testing::model(&scene, Detail::Rays);
    let receivers = choose(&model, &Brute::new(&scene.positions, &scene.triangles), &[]).unwrap();
    assert!(!receivers.is_empty() && receivers.len() <= DEFAULT_COUNT);
    for r in &receivers {
        assert!(r.lit && r.width == MAX_SIDE_TEXELS && r.height <= MAX_SIDE_TEXELS, "{r:?}");
        assert_eq!(r.points().len(), r.width * r.height);
    }
}

#[test]
fn names_that_nothing_has_are_errors() {
    let scene = cornell();
    let brute = Brute::new(&scene.positions, &scene.triangles);
    let message =
        choose(&testing::model(&scene, Detail::Rays), &brute, &["nothing".into()]).unwrap_err().to_string();
    assert!(message.contains("nothing") && message.contains(&scene.objects[0].name), "{message}");
}

#[test]
fn images_show_what_is_up_at_the_top() {
    let wall = Rectangle {
        centre: DVec3::ZERO,
        right: DVec3::X,
        normal: DVec3::Y,
        width: 2.0,
        height: 1.0,
        rise: [0.0; 2],
    };
    let wall = wall.upright();
    assert_eq!(wall.normal.cross(wall.right), DVec3::Z);
    let back = wall.turned();
    assert_eq!((back.normal, back.normal.cross(back.right)), (-DVec3::Y, DVec3::Z));
    let receiver = ReceiverGrid {
        name: String::new(),
        width: 2,
        height: 1,
        texel: 1.0,
        lit: true,
        rectangle: back,
        relief: None,
    };
    let points: Vec<Vec3> = receiver.points().iter().map(|p| p.position).collect();
    // Seen from -y with z up, x grows to the right.
    assert!(points[0].x < points[1].x);
}

/// A placed mesh is found by the name of its node, of its mesh or of its material; the image shows the face where it stands.
#[test]
fn placed_meshes_are_receivers() {
    use crate::scene::Placement;
    use crate::scene::testing::Pieces;
    use glam::{DAffine3, DQuat};
    let mut mesh = Pieces::new();
    mesh.object("board").quad(DVec3::ZERO, 2.0 * DVec3::X, DVec3::Y);
    let mut pieces = Pieces::new();
    pieces.object("floor").quad(DVec3::ZERO, 20.0 * DVec3::X, 20.0 * DVec3::Y);
    pieces.light(DVec3::new(0.0, 0.0, 9.0), DVec3::Y, DVec3::X);
    let mut scene = pieces.scene();
    scene.shared = vec![std::sync::Arc::new(mesh.scene())];
    let turn = DQuat::from_rotation_y(0.5);
    let place = |name: &str, at: DVec3, visible| Placement {
        mesh: 0,
        transform: DAffine3::from_scale_rotation_translation(DVec3::splat(1.5), turn, at - scene.origin),
        name: name.into(),
        material: None,
        visible,
    };
    let (first, second) = (DVec3::new(-3.0, 0.0, 2.0), DVec3::new(4.0, 1.0, 3.0));
    let placements =
        vec![place("left", first, true), place("right", second, true), place("ghost", first, false)];
    scene.placements = placements;
    let model = testing::model(&scene, Detail::Rays);
    let exact = model.exact();
    for (name, at) in [("left", first), ("right", second), ("board", first)] {
        let options = crate::bench::Options { receivers: vec![name.into()], ..Default::default() };
        options.check_for(&scene).expect(name);
        let receivers = choose(&model, &exact, &[name.to_owned()]).expect(name);
        assert!(receivers.len() == 1 && receivers[0].lit && receivers[0].name == name);
        assert!((receivers[0].rectangle.width - 3.0).abs() < 1e-4, "{receivers:?}");
        let normal = turn * DVec3::Z;
        for point in receivers[0].points() {
            let off = point.position.as_dvec3() + scene.origin - at;
            assert!(off.dot(normal).abs() < 1e-3 && off.length() < 1.7, "{name}: {off}");
            assert!(point.normal.as_dvec3().dot(normal) > 0.999);
        }
    }
    let ghost = choose(&model, &exact, &["ghost".to_owned()]).expect_err("hidden").to_string();
    assert!(ghost.contains("`ghost`") && ghost.contains("`left`"), "{ghost}");
}

/// Terrain under an emitter: the image is taken from above, every texel is on the surface and faces upwards.
#[test]
fn a_terrain_is_a_receiver() {
    use crate::scene::testing::Pieces;
    let height = |x: f64, y: f64| 0.3 * (0.9 * x).sin() * (0.7 * y).cos();
    let mut pieces = Pieces::new();
    pieces.object("hills");
    let (n, step) = (40, 0.2);
    let at = |i: i32, j: i32| {
        let (x, y) = (step * f64::from(i), step * f64::from(j));
        DVec3::new(x, y, height(x, y))
    };
    for (i, j) in (0..n * n).map(|k| (k % n, k / n)) {
        pieces.polygon(&[at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
        pieces.polygon(&[at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
    }
    pieces.light(DVec3::new(4.0, 4.0, 6.0), DVec3::Y, DVec3::X);
    let scene = pieces.scene();
    let model = testing::model(&scene, Detail::Rays);
    let brute = Brute::new(&scene.positions, &scene.triangles);
    for names in [vec![], vec!["hills".to_owned()]] {
        let receivers = choose(&model, &brute, &names).expect("receivers");
        assert_eq!(receivers.iter().map(|r| r.name.as_str()).collect::<Vec<_>>(), ["hills"]);
        let points = receivers[0].points();
        assert_eq!(points.len(), receivers[0].width * receivers[0].height);
        for p in &points {
            let q = p.position.as_dvec3() + scene.origin;
            // Chord error of the sine: step² / 8 times its curvature. Beside the edge there is no surface.
            let inside = q.x.min(q.y) > 0.2 && q.x.max(q.y) < 7.8;
            let off = (q.z - height(q.x, q.y)).abs();
            assert!(off < if inside { 0.01 } else { 0.1 }, "{q}: {}", height(q.x, q.y));
            assert!(p.normal.z > 0.8, "{p:?}");
        }
    }
}
