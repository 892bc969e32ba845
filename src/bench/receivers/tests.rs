//! Selection of receivers and position of their texels.

use super::*;
use crate::model::{Detail, testing};
use crate::ray::Brute;
use crate::scene::testing::{Pieces, generated};
use glam::{DVec3, Vec3};

/// Feature sizes that do not limit the texels of these scenes.
const SIZES: [f64; 2] = [1e6, 1e6];

/// The images of these surfaces of a scene.
fn grids(scene: &Scene, names: &[&str], sizes: [f64; 2]) -> Result<Vec<ReceiverGrid>> {
    let (model, names) =
        (testing::model(scene, Detail::Rays), names.iter().map(|n| n.to_string()).collect::<Vec<_>>());
    let exact = model.exact();
    Ok(choose(&model, &exact, &names)?.grids(&model, &exact, sizes))
}

#[test]
fn rectangles_fit_tilted_quads() {
    let scene = generated("cornell");
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
    let receivers = grids(&generated("cornell"), &[], SIZES).unwrap();
    assert!(!receivers.is_empty() && receivers.len() <= DEFAULT_COUNT);
    for r in &receivers {
        assert!(r.lit && r.width == 96 && r.height <= 96, "{}", r.name);
        assert_eq!(r.points.len(), r.width * r.height);
    }
}

#[test]
fn names_that_nothing_has_are_errors() {
    let scene = generated("cornell");
    let message = grids(&scene, &["nothing"], SIZES).unwrap_err().to_string();
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
    let patch = Patch { triangles: Vec::new(), area: 2.0, rectangle: back, relief: false };
    let points = patch.points(&generated("cornell"), &back, &TexelGrid { width: 2, height: 1, texel: 1.0 });
    let points: Vec<Vec3> = points.iter().map(|p| p.position).collect();
    // Seen from -y with z up, x grows to the right.
    assert!(points[0].x < points[1].x);
}

/// A placed mesh is found by the name of its node, of its mesh or of its material; the image shows the face where it stands.
#[test]
fn placed_meshes_are_receivers() {
    use crate::scene::Placement;
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
    for (name, at) in [("left", first), ("right", second), ("board", first)] {
        let options = crate::bench::BenchOptions { receivers: vec![name.into()], ..Default::default() };
        options.check_for(&scene).expect(name);
        let receivers = grids(&scene, &[name], SIZES).expect(name);
        assert!(receivers.len() == 1 && receivers[0].lit && receivers[0].name == name);
        assert!((receivers[0].surface[0] - 3.0).abs() < 1e-4, "{:?}", receivers[0].surface);
        let normal = turn * DVec3::Z;
        for point in &receivers[0].points {
            let off = point.position.as_dvec3() + scene.origin - at;
            assert!(off.dot(normal).abs() < 1e-3 && off.length() < 1.7, "{name}: {off}");
            assert!(point.normal.as_dvec3().dot(normal) > 0.999);
        }
    }
    let ghost = grids(&scene, &["ghost"], SIZES).expect_err("hidden").to_string();
    assert!(ghost.contains("`ghost`") && ghost.contains("`left`"), "{ghost}");
}

/// Terrain under an emitter: the image is taken from above, every texel is on the surface and faces upwards.
#[test]
fn a_terrain_is_a_receiver() {
    let height = |x: f64, y: f64| 0.3 * (0.9 * x).sin() * (0.7 * y).cos();
    let mut pieces = Pieces::new();
    pieces.object("hills");
    let at = |i: i32, j: i32| {
        let (x, y) = (0.2 * f64::from(i), 0.2 * f64::from(j));
        DVec3::new(x, y, height(x, y))
    };
    pieces.field(0..40, at);
    pieces.light(DVec3::new(4.0, 4.0, 6.0), DVec3::Y, DVec3::X);
    let scene = pieces.scene();
    for names in [&[][..], &["hills"]] {
        let receivers = grids(&scene, names, SIZES).expect("receivers");
        assert_eq!(receivers.iter().map(|r| r.name.as_str()).collect::<Vec<_>>(), ["hills"]);
        let points = &receivers[0].points;
        assert_eq!(points.len(), receivers[0].width * receivers[0].height);
        for p in points {
            let q = p.position.as_dvec3() + scene.origin;
            // Chord error of the sine: step² / 8 times its curvature. Beside the edge there is no surface.
            let inside = q.x.min(q.y) > 0.2 && q.x.max(q.y) < 7.8;
            let off = (q.z - height(q.x, q.y)).abs();
            assert!(off < if inside { 0.01 } else { 0.1 }, "{q}: {}", height(q.x, q.y));
            assert!(p.normal.z > 0.8, "{p:?}");
        }
    }
}

/// A scene under a closed dome that emits: a round ground of 720 triangles, and a block on it.
fn round_garden() -> Scene {
    use std::f64::consts::TAU;
    let mut pieces = Pieces::new();
    pieces.object("ground");
    let at = |ring: usize, k: usize| {
        let (r, turn) = (ring as f64, TAU * k as f64 / 48.0);
        DVec3::new(r * turn.cos(), r * turn.sin(), 0.0)
    };
    for k in 0..48 {
        pieces.polygon(&[DVec3::ZERO, at(1, k), at(1, k + 1)]);
        for ring in 1..8 {
            pieces.polygon(&[at(ring, k), at(ring + 1, k), at(ring + 1, k + 1), at(ring, k + 1)]);
        }
    }
    pieces.object("block").cuboid(DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, 1.0, 1.5));
    pieces.dome(12.0, [16, 6]);
    pieces.scene()
}

/// A disc covers π/4 of the square around it; its image is a rectangle inside, and all its texels are on the ground.
#[test]
fn a_round_ground_is_a_receiver() {
    let scene = round_garden();
    assert_eq!(
        scene.triangle_object.iter().filter(|&&o| scene.objects[o as usize].name == "ground").count(),
        720
    );
    for names in [&[][..], &["ground"]] {
        let receivers = grids(&scene, names, SIZES).expect("receivers");
        let ground = receivers.iter().find(|r| r.name == "ground").expect("the ground");
        assert!(ground.lit);
        let points: Vec<DVec3> = ground.points.iter().map(|p| p.position.as_dvec3() + scene.origin).collect();
        assert!(points.iter().all(|p| p.truncate().length() < 8.05 && p.z.abs() < 0.01));
        // The largest square in a disc of radius 8.
        assert!((ground.surface[0] * ground.surface[1] / 128.0 - 1.0).abs() < 0.05, "{:?}", ground.surface);
    }
}

/// Texels of half the feature size on a large floor with one block: the image is a window with the block's shadow.
#[test]
fn windows_are_where_the_shadows_are() {
    let mut pieces = Pieces::new();
    pieces.object("floor").quad(DVec3::ZERO, 40.0 * DVec3::X, 30.0 * DVec3::Y);
    pieces.object("block").cuboid(DVec3::new(11.0, -9.0, 0.0), DVec3::new(12.0, -8.0, 1.0));
    pieces.light(DVec3::new(0.0, 0.0, 20.0), DVec3::Y, DVec3::X);
    let scene = pieces.scene();
    let sizes = [0.04, 0.2];
    let receivers = grids(&scene, &["floor"], sizes).expect("the floor");
    let floor = &receivers[0];
    assert!(floor.texel <= 0.5 * sizes[0] && floor.width <= 512, "{} {}", floor.texel, floor.width);
    assert_eq!(floor.surface, [40.0, 30.0]);
    let spots: Vec<DVec3> = floor.points.iter().map(|p| p.position.as_dvec3() + scene.origin).collect();
    let near = |x: f64, y: f64| spots.iter().any(|p| (p.x - x).hypot(p.y - y) < floor.texel);
    assert!(near(12.4, -8.5), "the shadow of the block falls outwards");
    // The middle has the same texels.
    let part = floor.middle(0.25);
    let middle = floor.only(part);
    assert!((2 * middle.width).abs_diff(floor.width) <= 1 && middle.texel == floor.texel);
    let bits = |p: &ReceiverPoint| p.position.to_array().map(f32::to_bits);
    let all: std::collections::HashSet<_> = floor.points.iter().map(bits).collect();
    assert!(middle.points.iter().all(|p| all.contains(&bits(p))));
}

/// Default sizes of a floor of 40 m: images of the whole surface show them all.
#[test]
fn default_sizes_are_what_images_show() {
    use crate::bench::sizes::of_images;
    let mut pieces = Pieces::new();
    pieces.object("floor").quad(DVec3::ZERO, 40.0 * DVec3::X, 30.0 * DVec3::Y);
    pieces.object("step").quad(DVec3::new(50.0, 0.0, 0.0), 4.0 * DVec3::X, 3.0 * DVec3::Y);
    pieces.light(DVec3::new(0.0, 0.0, 20.0), DVec3::Y, DVec3::X);
    let scene = pieces.scene();
    let model = testing::model(&scene, Detail::Rays);
    let brute = Brute::new(&scene.positions, &scene.triangles);
    let names = ["floor".to_owned(), "step".to_owned()];
    let surfaces = choose(&model, &brute, &names).expect("both");
    let range = surfaces.feature_sizes().expect("a range");
    assert!((range[1] - 8.0).abs() < 1e-9, "{range:?}");
    let sizes = of_images(range);
    let [first, last] = [sizes[0], sizes[sizes.len() - 1]];
    for grid in surfaces.grids(&model, &brute, [first, last]) {
        assert!(first >= 1.999 * grid.texel, "{}: {first} and {}", grid.name, grid.texel);
        let covered = grid.width as f64 * grid.texel;
        assert!((covered / grid.surface[0] - 1.0).abs() < 0.01, "{}: {covered}", grid.name);
    }
    assert!(choose(&model, &brute, &[]).is_ok_and(|all| all.feature_sizes().is_some()));
}

#[test]
fn the_largest_rectangle_is_found() {
    let picture = ["..##....", ".#####..", ".#####..", ".####.#.", "........"];
    let cells: Vec<bool> = picture.iter().flat_map(|row| row.chars().map(|c| c == '#')).collect();
    assert_eq!(largest(&cells, 8), Some([1, 1, 5, 4]));
    assert_eq!(largest(&[false; 6], 3), None);
}
