//! Overlapping faces in one plane.

use crate::scene::testing::{Pieces, facing_down};
use crate::scene::{LoadOptions, Scene, Soup, SoupMaterial, resolve};
use glam::{DMat3, DVec3};

/// Rectangles by centre and half edges, each a grey object, transformed together.
fn sheets(turn: DMat3, at: DVec3, list: &[(&str, DVec3, DVec3, DVec3)]) -> Scene {
    let mut pieces = Pieces::empty();
    for (k, &(name, middle, u, v)) in list.iter().enumerate() {
        let corners = [middle - u - v, middle + u - v, middle + u + v, middle - u + v];
        pieces.grey(name, 0.1 * (k + 1) as f32).polygon(&corners.map(|p| turn * p + at));
    }
    pieces.scene()
}

/// Coordinates along a direction of the corners of objects.
fn heights(scene: &Scene, along: DVec3, counts: impl Fn(&str) -> bool) -> Vec<f32> {
    let object = |t: u32| &scene.objects[scene.triangle_object[t as usize] as usize].name;
    let counted = (0..scene.triangles.len() as u32).filter(|&t| counts(object(t)));
    counted.flat_map(|t| scene.corners(t).map(|p| p.dot(along.as_vec3()))).collect()
}

/// By how much all of these are above all of those.
fn gap(upper: &[f32], lower: &[f32]) -> f32 {
    upper.iter().copied().fold(f32::MAX, f32::min) - lower.iter().copied().fold(f32::MIN, f32::max)
}

fn said(scene: &Scene) -> Option<&String> {
    scene.repairs.messages.iter().find(|m| m.contains("in the same plane"))
}

const X: DVec3 = DVec3::X;
const Y: DVec3 = DVec3::Y;

#[test]
fn posters_in_their_wall_are_told() {
    let turns = [DMat3::IDENTITY, DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(0.3)];
    for turn in turns {
        for at in [DVec3::ZERO, DVec3::new(31.7, -12.3, 7.1)] {
            let wall = ("wall", DVec3::ZERO, 3.0 * X, 2.0 * Y);
            let poster = |z: f64, x: f64| ("poster", DVec3::new(x, 0.0, z), 0.5 * X, 0.25 * Y);
            let scene = sheets(turn, at, &[wall, poster(0.0, 1.0)]);
            let text = said(&scene).expect("a warning");
            assert!(text.contains("`wall` and `poster`") && text.contains("0.5 m²"), "{text}");
            assert_eq!(scene.repairs.overlapping_objects, 1);
            // A little in front, beside, and half beside.
            assert!(said(&sheets(turn, at, &[wall, poster(1e-3, 1.0)])).is_none());
            assert!(said(&sheets(turn, at, &[wall, poster(0.0, 3.5)])).is_none());
            let half = sheets(turn, at, &[wall, poster(0.0, 3.0)]);
            assert!(said(&half).is_some_and(|m| m.contains("0.25 m²")), "{:?}", said(&half));
        }
    }
}

/// A sheet whose front is turned to its wall, over both triangles of it, lies on the front of the wall, and a message tells this.
#[test]
fn sheets_that_face_each_other_are_stacked() {
    let (wall, poster) =
        (("wall", DVec3::ZERO, 3.0 * X, 2.0 * Y), ("poster", DVec3::ZERO, 0.25 * Y, 0.5 * X));
    for list in [[wall, poster], [poster, wall]] {
        let scene = sheets(DMat3::IDENTITY, DVec3::ZERO, &list);
        assert!(said(&scene).is_some_and(|m| m.contains("0.5 m²")));
        let of = |name: &str| heights(&scene, DVec3::Z, |object| object == name);
        assert!(of("wall").iter().all(|&z| z < -1e-5 && z > -4e-5), "{:?}", of("wall"));
        assert_eq!(of("poster"), [0.0; 6]);
    }
}

/// A lamp in the plane of a ceiling emits into the room, wherever the ceiling's front is.
#[test]
fn lamps_stay_in_front_of_their_ceiling() {
    for up in [false, true] {
        let rectangle = |u: DVec3, v: DVec3| [-u - v, u - v, u + v, v - u].map(|p| p + 3.0 * DVec3::Z);
        let front = if up { rectangle(3.0 * X, 2.0 * Y) } else { rectangle(2.0 * Y, 3.0 * X) };
        let mut pieces = Pieces::empty();
        pieces.grey("ceiling", 0.5).polygon(&front);
        pieces.glowing("lamp", 1.0).polygon(&rectangle(0.5 * Y, 0.5 * X));
        let scene = pieces.scene();
        let [ceiling, lamp] =
            ["ceiling", "lamp"].map(|name| heights(&scene, DVec3::Z, |object| object == name));
        assert!(gap(&ceiling, &lamp) > 0.0, "{up}: {ceiling:?} {lamp:?}");
    }
}

/// Walls and partitions follow a ceiling that is moved behind its lamp; what is connected with the lamp stays with the lamp.
#[test]
fn walls_follow_the_moved_ceiling() {
    let mut pieces = Pieces::empty();
    pieces.grey("room", 0.5).room(DVec3::ZERO, DVec3::new(7.0, 5.0, 3.0));
    pieces.grey("partition", 0.5).rectangle(DVec3::new(3.3, 0.0, 0.0), 5.0 * Y, 3.0 * DVec3::Z);
    pieces.glowing("lamp", 1.0).polygon(&facing_down([1.0, 2.0], [1.0, 2.0], 3.0));
    pieces.grey("lamp's rim", 0.5).rectangle(DVec3::new(1.0, 1.0, 3.0), X, 0.1 * DVec3::Z);
    let scene = pieces.scene();
    let of = |name: &str| heights(&scene, DVec3::Z, |object| object == name);
    let top = |name: &str| of(name).into_iter().fold(f32::MIN, f32::max);
    assert!(top("room") > 3.0 && top("partition") == top("room"), "{} {}", top("room"), top("partition"));
    // The walls end where the ceiling is: no vertex is left between.
    assert!(of("room").iter().all(|&z| z == 0.0 || z == top("room")), "{:?}", of("room"));
    assert_eq!(of("lamp"), [3.0; 6]);
    assert!(of("lamp's rim").contains(&3.0));
}

/// Of faces of one object with the same corners the one that emits is kept, or else the later one.
#[test]
fn lamps_in_place_of_a_tile_are_kept() {
    for (emissions, is_lit) in [([0.0, 5.0], true), ([5.0, 0.0], true), ([0.0, 0.0], false)] {
        let mut soup = Soup::new("tile");
        let ceiling = soup.object("ceiling");
        for (name, emission) in ["first", "second"].into_iter().zip(emissions) {
            let light = SoupMaterial::light(name, [emission; 3]);
            let material = soup.material(light);
            soup.polygon(ceiling, material, &facing_down([0.0, 1.0], [0.0, 1.0], 2.0));
        }
        let scene = resolve(soup, &LoadOptions::default()).expect("a scene");
        assert_eq!((scene.repairs.duplicate_faces, scene.emitters.len()), (1, usize::from(is_lit)));
        let kept = &scene.materials[scene.triangle_material[0] as usize].name;
        assert!(is_lit || kept == "second", "{kept}");
    }
}

#[test]
fn boxes_on_each_other_and_meshes_are_fine() {
    let mut pieces = Pieces::empty();
    for (k, low) in [0.0, 1.0].into_iter().enumerate() {
        pieces.grey(&format!("box {k}"), 0.3 + 0.1 * k as f32);
        pieces.cuboid(DVec3::new(0.0, 0.0, low), DVec3::new(1.0, 1.0, low + 1.0));
    }
    assert!(said(&pieces.clone().scene()).is_none());
    // The same as sheets.
    let sheets = LoadOptions { sides: Some(2), ..LoadOptions::default() };
    assert!(said(&pieces.scene_with(&sheets)).is_none());
}

/// Needles as long as their floor share all cells, but not every pair is tested; each needle covered by its neighbour
/// is reported.
#[test]
fn needles_take_no_time_for_each_pair() {
    let mut soup = Soup::new("needles");
    let object = soup.object("needles");
    let greys = [0.2f32, 0.4].map(|g| soup.material(SoupMaterial::diffuse(format!("grey {g}"), [g; 3])));
    let n = 100_000;
    for k in 0..n {
        let low = DVec3::new(0.0, f64::from(k) * 1e-2, 0.0);
        soup.polygon(object, greys[k as usize % 2], &[low, low + 1000.0 * X, low + 1.5e-2 * Y]);
    }
    // Testing all pairs takes half a minute, longer than a test may.
    let scene = resolve(soup, &LoadOptions::default()).expect("a scene");
    assert!(said(&scene).is_some_and(|m| m.contains("`needles` and itself")), "{:?}", said(&scene));
}

/// A floor of tiles of different greys in random order: tiles are in contact and do not overlap; a large rug covers
/// all.
#[test]
fn tiles_touch_and_a_rug_covers_them() {
    let mut soup = Soup::new("tiles");
    let (tiles, rug) = (soup.object("tiles"), soup.object("rug"));
    let tile = |soup: &mut Soup, k: u32, low: DVec3, size: f64, object: u32| {
        let grey = soup.material(SoupMaterial::diffuse(format!("grey {k}"), [0.001 * (k % 900) as f32; 3]));
        let corners = [low, low + size * X, low + size * (X + Y), low + size * Y];
        soup.polygon(object, grey, &corners);
    };
    let n = 60;
    for k in 0..n * n {
        let k = k * 7 % (n * n);
        let at = DVec3::new(0.1 * f64::from(k % n), 0.1 * f64::from(k / n), 0.3);
        tile(&mut soup, k, at, 0.1, tiles);
    }
    assert!(said(&resolve(soup.clone(), &LoadOptions::default()).expect("a scene")).is_none());
    tile(&mut soup, 950, DVec3::new(1.03, 1.02, 0.3), 4.0, rug);
    let scene = resolve(soup, &LoadOptions::default()).expect("a scene");
    assert!(said(&scene).is_some_and(|m| m.contains("16 m²")), "{:?}", said(&scene));
}

/// Two rectangles in one place that are turned away from each other are the sides of a sheet, also if one of them is in two pieces: each
/// is met from its own side.
#[test]
fn faces_back_to_back_are_seen_from_their_own_sides() {
    let up = ("up", DVec3::ZERO, 2.0 * X, Y);
    let down = ("down", DVec3::ZERO, Y, 2.0 * X);
    let pieces = [("left", -X, Y, X), ("right", X, Y, X)];
    for list in
        [vec![up, down], vec![down, up], vec![up, pieces[0], pieces[1]], vec![pieces[0], up, pieces[1]]]
    {
        let scene = sheets(DMat3::from_rotation_x(0.4), DVec3::new(1.0, 2.0, 3.0), &list);
        let normal = DMat3::from_rotation_x(0.4).z_axis;
        let [up, down] =
            [true, false].map(|is_up| heights(&scene, normal, |object| (object == "up") == is_up));
        assert!((1e-5..1e-3).contains(&gap(&up, &down)), "{up:?} {down:?}");
    }
}
