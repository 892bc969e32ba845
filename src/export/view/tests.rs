//! The automatic camera in rooms, gardens, terrain and before single objects.

use super::*;
use crate::scene::testing::{Pieces, generated};
use glam::{DMat3, DVec3, dvec3};

/// The automatic view of a scene: its eye in coordinates of the scene, the camera, and the fraction of the picture that
/// shows each object, the last entry being the fraction without a surface.
fn view(scene: &Scene) -> (DVec3, Camera, Vec<f32>) {
    let solution = evenly_lit(scene);
    let mesh = Mesh::new(&solution);
    let stage = Stage::new(&mesh, &solution).expect("a stage");
    let camera = best_view(&stage, &solution, scene.up_axis().vector(), &scene.unit);
    let frame = render(&stage, &camera, [80, 60], 1, &());
    let mut parts = vec![0.0; scene.objects.len() + 1];
    for first in &frame.first {
        let object =
            first.map_or(scene.objects.len(), |f| solution.elements[f.element as usize].object as usize);
        parts[object] += 1.0 / 4800.0;
    }
    (camera.eye.as_dvec3() + scene.origin, camera, parts)
}

/// Fraction of the picture that shows an object.
fn part(scene: &Scene, parts: &[f32], name: &str) -> f32 {
    let named = scene.objects.iter().zip(parts).filter(|(object, _)| object.name.starts_with(name));
    named.map(|(_, part)| part).sum()
}

#[test]
fn a_garden_under_a_dome_is_seen_from_the_ground() {
    let mut pieces = Pieces::new();
    pieces.object("ground").quad(DVec3::ZERO, 44.0 * DVec3::X, 44.0 * DVec3::Y);
    pieces.object("shrubs");
    let bush = dvec3(7.0, 4.0, 0.0);
    for k in 0..400 {
        let turn = 2.4 * f64::from(k);
        let (r, z) = (1.8 * (f64::from(k) / 400.0).sqrt(), 0.1 + 1.6 * (f64::from(k) * 0.618).fract());
        let leaf = DMat3::from_rotation_z(turn) * DMat3::from_rotation_x(f64::from(k));
        pieces.quad(bush + dvec3(r * turn.cos(), r * turn.sin(), z), 0.25 * leaf.x_axis, 0.25 * leaf.y_axis);
    }
    pieces.object("wall").cuboid(dvec3(-9.0, -9.0, 0.0), dvec3(-5.0, -8.7, 2.0));
    pieces.dome(20.0, [32, 12]);
    let scene = pieces.scene();
    let (eye, camera, parts) = view(&scene);
    assert!(eye.length() < 20.0, "inside the dome: {eye}");
    assert!((1.0..2.6).contains(&eye.z), "at eye height: {eye}");
    let way = (bush + DVec3::Z - eye).normalize().as_vec3();
    assert!(camera.forward.dot(way) > 0.85, "towards the shrubs: {camera:?}");
    let (sky, ground) = (part(&scene, &parts, "light"), part(&scene, &parts, "ground"));
    assert!(sky < 0.6 && part(&scene, &parts, "shrubs") > 0.04, "sky {sky}, ground {ground}: {parts:?}");
}

#[test]
fn rooms_are_seen_from_inside() {
    let scene = generated("desk-room");
    let (eye, camera, parts) = view(&scene);
    let (low, high) =
        (scene.bounds.min.as_dvec3() + scene.origin, scene.bounds.max.as_dvec3() + scene.origin);
    assert!(eye.cmpgt(low).all() && eye.cmplt(high).all(), "{eye} in {low} to {high}");
    assert!((0.8..2.0).contains(&(eye.z - low.z)), "at eye height: {eye}");
    assert!(camera.forward.z.abs() < 0.5, "{camera:?}");
    let seen = parts[..scene.objects.len()].iter().filter(|&&p| p > 0.0005).count();
    assert!(seen >= 5, "{seen} objects: {parts:?}");
}

#[test]
fn terrain_is_seen_from_above() {
    let mut pieces = Pieces::new();
    pieces.object("terrain");
    let height = |x: f64, y: f64| 600.0 * (x / 2500.0).sin() * (y / 1900.0).cos() + 150.0 * (x / 500.0).cos();
    let at = |i: i32, j: i32| {
        let (x, y) = (250.0 * f64::from(i), 250.0 * f64::from(j));
        dvec3(x, y, height(x, y))
    };
    pieces.field(0..80, at);
    pieces.light(dvec3(10_000.0, 10_000.0, 9000.0), 4000.0 * DVec3::Y, 4000.0 * DVec3::X);
    let scene = pieces.scene();
    let (eye, _, parts) = view(&scene);
    assert!(eye.z > height(eye.x, eye.y) + 1.0, "above the ground: {eye}");
    assert!(part(&scene, &parts, "terrain") > 0.3, "{parts:?}");
}

#[test]
fn single_objects_are_seen_whole() {
    let mut pieces = Pieces::new();
    let turn = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(0.3);
    pieces.object("box").block(DVec3::ZERO, turn * DMat3::from_diagonal(dvec3(0.3, 0.2, 0.1)));
    pieces.light(dvec3(0.0, 0.0, 0.5), 0.1 * DVec3::Y, 0.1 * DVec3::X);
    let scene = pieces.scene();
    let (eye, camera, parts) = view(&scene);
    assert!(part(&scene, &parts, "box") > 0.04, "{parts:?}");
    let half = 0.5 * camera.angle;
    for p in &scene.positions {
        let way = (*p - camera.eye).normalize();
        assert!(camera.forward.dot(way) > half.cos(), "{p} is in the picture from {eye}");
    }
}

/// A box with an open side is seen through it, or from inside: not through a wall that hides nothing.
#[test]
fn the_cornell_box_shows_its_blocks() {
    let scene = generated("cornell");
    let (_, camera, parts) = view(&scene);
    assert!(camera.up.y.abs() > 0.9, "{camera:?}");
    let seen = parts[..scene.objects.len()].iter().filter(|&&p| p > 0.01).count();
    assert!(seen >= 6 && *parts.last().unwrap() < 0.6, "{parts:?}");
}

/// A room with two lamps below its ceiling, of which the second emits if it is on, otherwise it is a dark plate; and a sun.
fn room(is_on: bool) -> Scene {
    let mut pieces = Pieces::new();
    pieces.object("room").quad(dvec3(3.0, 2.0, 0.0), 6.0 * DVec3::X, 4.0 * DVec3::Y);
    for x in [0.0, 6.0] {
        let side = if x == 0.0 { 4.0 * DVec3::Y } else { -4.0 * DVec3::Y };
        pieces.quad(dvec3(x, 2.0, 1.5), side, 3.0 * DVec3::Z);
    }
    pieces.object("cupboard").cuboid(dvec3(0.5, 0.5, 0.0), dvec3(1.5, 1.0, 1.8));
    pieces.object("table").cuboid(dvec3(3.0, 2.0, 0.0), dvec3(4.5, 3.0, 0.7));
    pieces.light(dvec3(1.0, 2.0, 2.9), DVec3::Y, DVec3::X);
    if is_on {
        pieces.light(dvec3(5.0, 2.0, 2.9), DVec3::Y, DVec3::X);
    } else {
        pieces.object("plate").quad(dvec3(5.0, 2.0, 2.9), DVec3::Y, DVec3::X);
    }
    pieces.light(dvec3(100.0, 0.0, 100.0), 5.0 * DVec3::Y, 5.0 * DVec3::X);
    pieces.scene()
}

#[test]
fn the_camera_is_the_same_whichever_lamps_are_on() {
    let [on, off] = [true, false].map(|is_on| {
        let scene = room(is_on);
        let camera = scene_view(&scene).expect("a camera");
        (camera.eye.as_dvec3() + scene.origin, camera)
    });
    assert!(on.0.distance(off.0) < 1e-4 && on.1.forward.distance(off.1.forward) < 1e-5, "{on:?} {off:?}");
    // The sun does not widen the view.
    assert!(on.0.distance(dvec3(3.0, 2.0, 1.0)) < 20.0, "{on:?}");
}
