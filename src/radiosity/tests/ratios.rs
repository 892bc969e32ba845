//! Lamps and receivers of very different sizes and distances: what a lamp sends arrives, wherever it is.

use super::*;
use crate::form_factors::analytic::{point_to_polygon, polygon_to_polygon};
use crate::path_tracer;
use glam::DMat3;

/// A square with this centre, width and normal direction (up or down the z axis).
fn level(centre: DVec3, width: f64, up: bool) -> [DVec3; 4] {
    let mut corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
        .map(|(u, v)| centre + width * DVec3::new(u, v, 0.0));
    if !up {
        corners.reverse();
    }
    corners
}

/// A square lamp that faces down.
struct Lamp {
    centre: DVec3,
    width: f64,
}

impl Lamp {
    fn corners(&self) -> [DVec3; 4] {
        level(self.centre, self.width, false)
    }
}

/// A grey floor about the origin and a lamp above it.
fn lamp_over_floor(floor: f64, lamp: &Lamp, reflectance: f32) -> Scene {
    let light = SoupMaterial { reflectance: [reflectance; 3], ..SoupMaterial::light("light", [10.0; 3]) };
    let mut pieces = Pieces::empty();
    pieces.grey("floor", 0.5).polygon(&level(DVec3::ZERO, floor, true));
    pieces.made_of("lamp", light).polygon(&lamp.corners());
    pieces.scene()
}

/// Power that elements of an object receive on one side, W.
fn received(outcome: &Outcome, object: u32, front: bool) -> f64 {
    let elements = outcome.mesh.elements.iter().filter(|e| e.object == object && e.front == front);
    elements.map(|e| e.area * e.irradiance[0]).sum()
}

/// Power that elements of the floor receive from a lamp in closed form, W: what the lamp reflects back is less than a thousandth of it.
fn sent(floor: f64, lamp: &Lamp) -> f64 {
    let factor = polygon_to_polygon(&lamp.corners(), &level(DVec3::ZERO, floor, true));
    10.0 * std::f64::consts::PI * lamp.width * lamp.width * factor
}

#[test]
fn light_of_a_lamp_arrives_on_floors_of_any_size() {
    for width in [1.0, 60.0, 1e5, 1e6] {
        // Beside the middle, which is a corner of elements.
        let lamp = Lamp { centre: DVec3::new(0.113 * width, 0.071 * width, 1.0), width: 1.0 };
        let scene = lamp_over_floor(width, &lamp, 0.0);
        for (error, local_rays, seed) in [(0.02, Some(400_000), 1), (0.1, None, 2)] {
            let options = Options { error, local_rays, seed, audit: 0, ..Options::default() };
            let outcome = solved(&scene, &[], &options);
            let Ledger { emitted, created, .. } = outcome.record.ledger;
            let (found, want) = (received(&outcome, 0, true), sent(width, &lamp));
            assert!(created.abs() < 5e-3 * emitted, "{width} {error}: created {created} of {emitted}");
            assert!((found / want - 1.0).abs() < 0.01, "{width} {error}: {found} instead of {want}");
        }
    }
}

/// A lamp lights a millionth of a floor, where all error is: of elements drawn by area alone the error bars would be checked in the dark.
#[test]
fn the_stated_error_is_that_of_the_lit_part() {
    let (width, lamp) = (2000.0, Lamp { centre: DVec3::new(300.0, 200.0, 2.0), width: 1.0 });
    let scene = lamp_over_floor(width, &lamp, 0.0);
    let options = Options { local_rays: Some(400_000), ..Options::default() };
    let outcome = solved(&scene, &[], &options);
    let vertices = &outcome.mesh.vertices;
    let (mut squares, mut light_squares, mut area, mut light) = (0.0, 0.0, 0.0, 0.0);
    for e in outcome.mesh.elements.iter().filter(|e| e.object == 0 && e.front) {
        let centre = e.corners.iter().map(|&c| DVec3::from(vertices[c as usize])).sum::<DVec3>() / 4.0;
        let want = 10.0 * std::f64::consts::PI * point_to_polygon(centre, DVec3::Z, &lamp.corners());
        squares += e.area * (e.irradiance[0] - want).powi(2);
        light_squares += e.area * want * want;
        (area, light) = (area + e.area, light + e.area * e.irradiance[0]);
    }
    let [error, level] = [squares, light_squares].map(|squares| (squares * area).sqrt() / light);
    let stated = outcome.record.error_estimate.expect("an estimate");
    // Paths know the little light that the floor reflects to the lamp to about a hundredth.
    assert!(stated > 0.5 * error && stated < 0.01 * level, "{stated} stated, {error} of {level}");
}

/// The back of a lamp lies in the plane of its front, which is a million times as bright as the ground.
#[test]
fn a_lamp_far_away_lights_the_ground_and_not_its_own_back() {
    for (distance, width, reflectance) in [(30.0, 0.3, 0.5), (570.0, 4.7, 0.5)] {
        let lamp = Lamp { centre: DVec3::new(0.3 * distance, 0.4 * distance, distance), width };
        let scene = lamp_over_floor(20.0, &lamp, reflectance);
        for error in [0.02, 0.1] {
            let options = Options { error, local_rays: Some(400_000), audit: 0, ..Options::default() };
            let outcome = solved(&scene, &[], &options);
            let (found, want) = (received(&outcome, 0, true), sent(20.0, &lamp));
            assert!((found / want - 1.0).abs() < 0.01, "{distance} {error}: {found} instead of {want}");
            assert!(received(&outcome, 1, false) < 1e-6 * want, "the back of the lamp is lit");
            assert!(received(&outcome, 1, true) < 0.01 * want, "more light than the ground reflects");
        }
    }
}

/// Light at these points by the solver and by the path tracer, W/m².
fn at_points(scene: &Scene, points: &[Point]) -> [Vec<f64>; 2] {
    let options = Options { direct_only: true, audit: 0, ..Options::default() };
    let found = solved(scene, points, &options).irradiance;
    let settings = path_tracer::Settings { samples: 4096, direct_only: true, seed: 1 };
    let traced =
        path_tracer::irradiance(&model_for(scene, &options), points, settings, &()).expect("irradiance");
    [found.iter().map(|v| v[0]).collect(), traced.values.iter().map(|v| v[0]).collect()]
}

/// By coarse links alone the lamp is no part of the mean of what it stands above.
#[test]
fn links_bring_the_light_of_a_lamp_to_floors_of_any_size() {
    for (width, error) in [(60.0, 0.02), (60.0, 1.0), (300.0, 10.0), (5e3, 0.02), (1e6, 0.02), (1e6, 0.5)] {
        let lamp = Lamp { centre: DVec3::new(0.03 * width, 0.01 * width, 1.0), width: 1.0 };
        let scene = lamp_over_floor(width, &lamp, 0.0);
        let options = Options { local_rays: Some(0), error, audit: 0, ..Options::default() };
        let outcome = solved(&scene, &[], &options);
        let Ledger { emitted, absorbed, created, .. } = outcome.record.ledger;
        // The floor absorbs half of the light, and the lamp a tenth of the rest.
        assert!((absorbed / emitted - 0.525).abs() < 0.04, "{width}: absorbed {absorbed} of {emitted}");
        assert!(created.abs() < 5e-3 * emitted, "{width}: created {created} of {emitted}");
        let is_noted =
            outcome.record.warnings.iter().any(|note| note.contains("may miss the light of lamps"));
        assert_eq!(is_noted, error > 0.5);
    }
}

/// Rays start 4 mm above a floor of 4 km; the light is that of the floor. They would start 2 m above one of 1,000 km, which is divided.
#[test]
fn points_of_large_floors_have_the_light_of_their_place() {
    for (floor, centre, width) in [(4e3, [700.0, 400.0, 0.7], 0.6), (1e6, [0.2, 0.1, 0.5], 1.0)] {
        let lamp = Lamp { centre: centre.into(), width };
        let scene = lamp_over_floor(floor, &lamp, 0.0);
        let beside = [0.0, 0.5, 1.0, 3.0];
        let place = |x: f64| DVec3::new(lamp.centre.x + x, lamp.centre.y + 0.1, 0.0);
        let points = beside.map(|x| Point { position: place(x), normal: DVec3::Z });
        let [found, traced] = at_points(&scene, &points);
        for ((x, found), traced) in beside.into_iter().zip(found).zip(traced) {
            let factor = point_to_polygon(place(x), DVec3::Z, &lamp.corners());
            let want = 10.0 * std::f64::consts::PI * factor;
            assert!((found / want - 1.0).abs() < 2e-3, "{floor} {x}: {found} instead of {want}");
            assert!((traced / want - 1.0).abs() < 0.02, "{floor} {x}: {traced} instead of {want}");
        }
    }
}

/// Of a luminous ceiling of 100 m a table hides four metres, which bring half of the light to the floor below it.
#[test]
fn a_table_below_a_wide_ceiling_has_its_shadow() {
    let mut pieces = Pieces::empty();
    pieces.grey("floor", 0.5).polygon(&level(DVec3::ZERO, 100.0, true));
    pieces.grey("table", 0.5).polygon(&level(DVec3::new(0.3, 0.2, 0.7), 1.0, true));
    pieces.glowing("ceiling", 10.0).polygon(&level(3.0 * DVec3::Z, 100.0, false));
    let place = |x: f64| Point { position: DVec3::new(x, 0.1, 0.0), normal: DVec3::Z };
    let [found, traced] = at_points(&pieces.scene(), &[0.0, 0.5, 1.0, 3.0].map(place));
    for (found, traced) in found.into_iter().zip(traced) {
        assert!((found / traced - 1.0).abs() < 0.04, "{found} instead of {traced}");
    }
}

/// Light on the line where a box stands on the floor is that beside the box: in it there is none.
#[test]
fn the_foot_of_a_box_has_the_light_beside_it() {
    let mut pieces = Pieces::empty();
    pieces.grey("floor", 0.5).polygon(&level(DVec3::ZERO, 6.0, true));
    let (foot, top) = (level(DVec3::ZERO, 1.0, true), level(DVec3::Z, 1.0, true));
    pieces.grey("box", 0.5).polygon(&top);
    for k in 0..4 {
        let next = (k + 1) % 4;
        pieces.polygon(&[foot[k], foot[next], top[next], top[k]]);
    }
    // A wall close to one side, so that the box is the wider place.
    pieces.grey("wall", 0.5).rectangle(DVec3::new(0.6, -2.0, 0.0), 4.0 * DVec3::Y, 0.8 * DVec3::Z);
    pieces.glowing("lamp", 10.0).polygon(&level(DVec3::new(0.2, 0.3, 3.0), 2.0, false));
    let scene = pieces.scene();
    let feet = [[0.5, 0.1], [-0.5, 0.1], [0.1, 0.5], [0.1, -0.5]].map(|[x, y]| DVec3::new(x, y, 0.0));
    let beside = feet.map(|foot| foot + 1e-4 * foot);
    let points = |places: [DVec3; 4]| places.map(|position| Point { position, normal: DVec3::Z });
    let [on, beside] = [feet, beside].map(|places| at_points(&scene, &points(places)));
    for k in 0..4 {
        for engine in 0..2 {
            let (found, want) = (on[engine][k], beside[engine][k]);
            assert!(want > 0.01 && (found / want - 1.0).abs() < 0.1, "{k} {engine}: {found} beside {want}");
        }
    }
}

/// Light in the corner of two walls that are boxes of their own, on a floor that goes on below them, is that of the room, not that in one
/// of the boxes; also in the origin, and where the diagonal of the floor passes through the corner.
#[test]
fn corners_of_walls_that_are_boxes_have_the_light_of_the_room() {
    let cases = [(DVec3::new(1.5, 2.25, 0.5), 12.0), (DVec3::ZERO, 12.0), (DVec3::ZERO, 1e4)];
    for ((corner, width), angle) in cases.into_iter().flat_map(|case| [(case, 0.0), (case, 0.5), (case, 1.0)])
    {
        let turn = DMat3::from_rotation_z(angle);
        let block = |low: DVec3, high: DVec3| {
            (corner + turn * (0.5 * (low + high)), turn * DMat3::from_diagonal(high - low))
        };
        let mut pieces = Pieces::empty();
        pieces.grey("floor", 0.5).polygon(&level(corner + angle * DVec3::X, width, true));
        let ends = [[-0.4, -0.4, 3.0, 0.0], [-0.4, 0.0, 0.0, 3.0]];
        for (k, [x0, y0, x1, y1]) in ends.into_iter().enumerate() {
            let (centre, axes) = block(DVec3::new(x0, y0, 0.0), DVec3::new(x1, y1, 2.0));
            pieces.grey(&format!("wall {k}"), 0.5).block(centre, axes);
        }
        let lamp = corner + turn * DVec3::new(1.5, 1.5, 3.0);
        pieces.glowing("lamp", 10.0).polygon(&level(lamp, 1.0, false));
        let scene = pieces.scene();
        let beside = corner + turn * DVec3::new(1e-3, 1e-3, 0.0);
        let points = [corner, beside].map(|position| Point { position, normal: DVec3::Z });
        for [found, want] in at_points(&scene, &points).map(|light| [light[0], light[1]]) {
            assert!(want > 0.1 && (found / want - 1.0).abs() < 0.05, "{angle} {found} beside {want}");
        }
    }
}

/// On a floor of 200 m, whose coordinates are rounded by more than the distances at which points beside walls are told apart, the foot of a
/// wall has the light of the floor beside it.
#[test]
fn feet_of_walls_on_large_floors_have_the_light_of_walls() {
    let mut pieces = Pieces::empty();
    pieces.grey("floor", 0.5).polygon(&level(DVec3::ZERO, 200.0, true));
    pieces.grey("wall", 0.5).cuboid(DVec3::new(-0.4, 0.0, 0.0), DVec3::new(0.0, 3.0, 2.0));
    pieces.glowing("lamp", 10.0).polygon(&level(DVec3::new(1.5, 1.5, 3.0), 1.0, false));
    let points = [0.0, 1e-3].map(|x| Point { position: DVec3::new(x, 1.5, 0.0), normal: DVec3::Z });
    let options = Options { audit: 0, elements: false, ..Options::default() };
    let found = solved(&pieces.scene(), &points, &options).irradiance;
    let [foot, beside] = [mean(found[0]), mean(found[1])];
    assert!((foot / beside - 1.0).abs() < 0.05, "{foot} beside {beside}");
}

/// The foot of a wall outside of a room has the light of the ground there, also where the floor of the room lies on that ground, in its
/// plane.
#[test]
fn feet_of_walls_outside_have_the_light_of_the_ground() {
    let mut pieces = Pieces::empty();
    pieces.grey("ground", 0.2).polygon(&facing_up([-2.0, 8.0], [-2.0, 3.6], 0.0));
    pieces.grey("floor", 0.4).polygon(&facing_up([0.0, 5.0], [0.0, 3.5], 0.0));
    pieces.grey("wall", 0.5).cuboid(DVec3::new(5.0, 1.2, 0.0), DVec3::new(5.2, 2.8, 0.9));
    pieces.glowing("lamp", 10.0).polygon(&level(DVec3::new(6.5, 2.0, 3.0), 1.0, false));
    let points =
        [0.0, 3e-5, 1e-3].map(|x| Point { position: DVec3::new(5.2 + x, 2.0, 0.0), normal: DVec3::Z });
    for light in at_points(&pieces.scene(), &points) {
        let beside = light[2];
        assert!(beside > 0.1 && light.iter().all(|at| (at / beside - 1.0).abs() < 0.05), "{light:?}");
    }
}

/// A point where faces touch, its normal, and the direction in which the light goes on.
type Touching = ([f64; 3], DVec3, DVec3);

/// Points exactly where faces touch, or within rounding of it, have the light a millimetre beside, in solutions and references.
#[test]
fn points_where_faces_touch_have_the_light_beside() {
    let at = DVec3::new;
    let check = |name: &str, turn: f64, pieces: Pieces, points: &[Touching]| {
        let turn = glam::DMat3::from_rotation_z(turn);
        let placed = |place: DVec3, normal: DVec3| Point { position: turn * place, normal: turn * normal };
        let pair = |&(place, normal, along): &Touching| {
            [0.0, 1e-3].map(|step| placed(DVec3::from(place) + step * along, normal))
        };
        let all: Vec<Point> = points.iter().flat_map(pair).collect();
        for light in at_points(&pieces.turned(turn).scene(), &all) {
            for (pair, (place, ..)) in light.chunks(2).zip(points) {
                assert!(
                    pair[1] > 0.02 && (pair[0] / pair[1] - 1.0).abs() < 0.05,
                    "{name} {place:?}: {pair:?}"
                );
            }
        }
    };
    let with_lamp = |lamp: DVec3, up: bool| {
        let mut pieces = Pieces::empty();
        pieces.glowing("lamp", 10.0).polygon(&level(lamp, 1.0, up));
        pieces
    };
    let ground = |pieces: &mut Pieces| {
        pieces.grey("ground", 0.2).polygon(&facing_up([-9.0, 11.0], [-8.0, 12.0], 0.0));
    };

    // Beside a carpet, and above one that ends at a wall, on a ground in its plane.
    let mut carpet = with_lamp(at(0.0, 0.0, 2.4), false);
    ground(&mut carpet);
    carpet.grey("carpet", 0.3).polygon(&facing_up([-1.0, 1.0], [-0.5, 0.5], 0.0));
    carpet.grey("wall", 0.5).cuboid(at(-1.2, -2.0, 0.0), at(-1.0, 2.0, 2.0));
    let points = [
        ([1.0, 0.1, 0.0], DVec3::Z, DVec3::X),
        ([1.0 + 1e-5, 0.1, 0.0], DVec3::Z, DVec3::X),
        ([-1.0, 0.1, 0.0], DVec3::X, DVec3::Z),
    ];
    check("carpet", 0.0, carpet, &points);

    // The wall of a house that goes on below the ground, on the line of the ground.
    let mut house = with_lamp(at(2.0, 0.5, 3.0), false);
    ground(&mut house);
    house.grey("house", 0.5).cuboid(at(-3.0, -2.0, -1.0), at(0.0, 2.0, 2.5));
    check("house in the ground", 0.3, house, &[([0.0, 0.5, 0.0], DVec3::X, DVec3::Z)]);

    // A wall below a roof that slopes down beyond it, lit from below.
    let mut eaves = with_lamp(at(2.0, 0.5, 0.0), true);
    eaves.grey("wall", 0.5).rectangle(at(0.0, -2.0, 0.0), 4.0 * DVec3::Y, 2.5 * DVec3::Z);
    let down = at(1.2, 0.0, -0.9);
    eaves.grey("roof", 0.5).rectangle(at(-0.8, -2.0, 3.1), down, 4.0 * DVec3::Y);
    check("eaves", 0.0, eaves, &[([0.0, 0.5, 2.5], DVec3::X, -DVec3::Z)]);

    // A hut of sheets that face into it, on a ground, and a floor of its own that ends at sheets.
    for name in ["ground", "floor"] {
        let mut hut = with_lamp(at(2.0, 1.5, 2.3), false);
        match name {
            "ground" => ground(&mut hut),
            _ => _ = hut.grey("floor", 0.2).polygon(&facing_up([0.0, 4.0], [0.0, 3.0], 0.0)),
        }
        hut.grey("hut", 0.5).room_without(Wall::Floor, DVec3::ZERO, at(4.0, 3.0, 2.5));
        let foot = |y: f64| ([0.0, y, 0.0], DVec3::Z, DVec3::X);
        let feet = [0.6, 0.93, 1.41, 1.8, 2.31].map(foot);
        for turn in [0.0, 0.3, std::f64::consts::FRAC_PI_4] {
            check(name, turn, hut.clone(), &feet);
        }
    }

    // A house on a slab in a hole of the ground, with a terrace beside it on the ground: the slab follows the ground below the terrace.
    let mut slab = with_lamp(at(2.0, 1.5, 2.3), false);
    slab.grey("ground", 0.2).pierced(
        at(-8.0, -8.0, 0.0),
        [20.0 * DVec3::X, 20.0 * DVec3::Y],
        [[7.8, 7.8], [12.2, 11.2]],
    );
    slab.grey("slab", 0.3).cuboid(at(-0.2, -0.2, -0.2), at(4.2, 3.2, 0.0));
    slab.grey("wall", 0.5).cuboid(at(0.0, 3.0, 0.0), at(4.0, 3.2, 2.5));
    slab.grey("terrace", 0.4).polygon(&facing_up([4.2, 7.0], [-0.2, 3.2], 0.0));
    check("slab", 0.0, slab, &[([2.3, 3.0, 0.0], DVec3::Z, -DVec3::Y)]);
}

/// A level deck 5 mm above a slope, and a blind 3 cm before a wall on a ground with a terrace in its plane, in scenes of kilometres: points
/// of the slope and of the wall keep their shadow.
#[test]
fn points_close_behind_others_are_not_moved_onto_these() {
    let at = DVec3::new;
    let mut deck = Pieces::empty();
    deck.grey("ground", 0.5).polygon(&level(DVec3::ZERO, 1000.0, true));
    deck.grey("slope", 0.5).rectangle(at(0.0, -5.0, 0.0), at(6.0, 0.0, 4.2), 10.0 * DVec3::Y);
    deck.grey("deck", 0.5).polygon(&facing_up([1.0, 3.5], [-2.0, 2.0], 2.105));
    deck.glowing("lamp", 10.0).polygon(&level(at(3.0, 0.0, 9.0), 2.0, false));
    let mut blind = Pieces::empty();
    blind.grey("ground", 0.5).polygon(&level(DVec3::ZERO, 4000.0, true));
    blind.grey("terrace", 0.5).polygon(&facing_up([0.0, 5.0], [-4.0, 4.0], 0.0));
    blind.grey("house", 0.5).cuboid(at(-8.0, -5.0, 0.0), at(0.0, 5.0, 6.0));
    blind.grey("blind", 0.5).rectangle(at(0.03, -1.0, 1.0), 2.0 * DVec3::Y, 1.5 * DVec3::Z);
    blind.glowing("lamp", 10.0).rectangle(at(4.0, -1.0, 1.0), 2.0 * DVec3::Z, 2.0 * DVec3::Y);
    for (pieces, hidden, open, normal) in [
        (deck, at(3.0, 0.0, 2.1), at(3.0, 0.0, 2.105), DVec3::Z),
        (blind, at(0.0, 0.0, 1.75), at(0.0, 3.0, 1.75), DVec3::X),
    ] {
        let points = [hidden, open].map(|position| Point { position, normal });
        for light in at_points(&pieces.scene(), &points) {
            assert!(light[1] > 0.05 && light[0] < 0.1 * light[1], "{light:?}");
        }
    }
}

/// A room 2.5 km from the middle of a scene, where places around a point are 1 cm off it, with a wall 5 mm thick: the dark half is dark
/// at the wall and 1 mm behind it, and a note names the resolution of coordinates.
#[test]
fn thin_walls_far_from_the_middle_are_opaque() {
    let low = DVec3::new(2500.0, 2.0, 0.0);
    let mut pieces = Pieces::empty();
    pieces.grey("far away", 0.5).polygon(&level(DVec3::new(-2500.0, 0.0, 0.0), 1.0, true));
    pieces.grey("room", 0.6).room(low, low + DVec3::new(6.0, 4.0, 3.0));
    pieces.grey("wall", 0.6).cuboid(low + 3.0 * DVec3::X, low + DVec3::new(3.005, 4.0, 3.0));
    pieces.glowing("lamp", 10.0).polygon(&level(low + DVec3::new(1.5, 2.0, 2.9), 1.0, false));
    let scene = pieces.scene();
    let at = |x: f64| Point { position: low + DVec3::new(x, 1.3, 0.0), normal: DVec3::Z };
    let points = [3.005, 3.006, 2.995, 2.5].map(at);
    let outcome = solved(&scene, &points, &quick());
    let [by_solve, by_paths] = at_points(&scene, &points);
    for light in [by_solve, by_paths] {
        assert!(
            light[0] < 1e-3 * light[3] && light[1] < 1e-3 * light[3] && light[2] > 0.5 * light[3],
            "{light:?}"
        );
    }
    let notes = &outcome.record.warnings;
    assert!(notes.iter().any(|note| note.contains("% of the points lie within")), "{notes:?}");
}

/// Fins two centimetres before a lamp of four metres: coarse elements get as much light on each side as fine ones.
#[test]
fn fins_close_to_a_lamp_have_its_light() {
    let mut pieces = Pieces::empty();
    pieces.grey("floor", 0.0).polygon(&facing_up([0.0, 4.0], [0.0, 4.0], 0.0));
    pieces.glowing("lamp", 5.0).rectangle(DVec3::ZERO, 4.0 * DVec3::Y, 2.0 * DVec3::Z);
    for k in 0..10 {
        let corner = DVec3::new(0.02, 0.0, 0.1 + 0.2 * f64::from(k));
        pieces.grey(&format!("fin{k}"), 0.0).rectangle(corner, 0.2 * DVec3::X, 4.0 * DVec3::Y);
    }
    let scene = pieces.scene();
    let light = |error: f64| {
        let outcome = solved(&scene, &[], &Options { error, audit: 0, ..Options::default() });
        let of_fin = |fin: u32| [true, false].map(|front| received(&outcome, 2 + fin, front));
        (0..10).flat_map(of_fin).collect::<Vec<f64>>()
    };
    let (coarse, fine) = (light(0.1), light(0.02));
    for (coarse, fine) in coarse.into_iter().zip(fine) {
        assert!((coarse - fine).abs() <= 0.05 * fine, "{coarse} instead of {fine}");
    }
}

/// A black floor below a plate that hides most of a lamp: no element that sees a corner of the lamp is stated to be dark without an error.
#[test]
fn elements_in_penumbrae_of_black_floors_are_not_certainly_dark() {
    let (lamp, plate) = (Lamp { centre: DVec3::new(1.8, 0.6, 2.0), width: 1.0 }, 0.9);
    let mut pieces = Pieces::empty();
    pieces.grey("floor", 0.0).polygon(&level(DVec3::ZERO, 60.0, true));
    let light = SoupMaterial { reflectance: [0.0; 3], ..SoupMaterial::light("light", [5.0; 3]) };
    pieces.made_of("lamp", light).polygon(&lamp.corners());
    pieces.grey("plate", 0.0).polygon(&level(lamp.centre - 0.1 * DVec3::Z, plate, true));
    let mesh = solved(&pieces.scene(), &[], &Options { error: 0.1, audit: 0, ..Options::default() }).mesh;
    let mut seen = 0;
    for element in mesh.elements.iter().filter(|e| e.object == 0 && e.front) {
        let centre =
            element.corners.map(|c| mesh.vertices[c as usize].as_dvec3()).into_iter().sum::<DVec3>() / 4.0;
        let beside_plate = |corner: &DVec3| {
            let at = centre + 0.95 * (*corner - centre) - lamp.centre;
            at.x.abs().max(at.y.abs()) > 0.51 * plate
        };
        if centre.distance(lamp.centre) < 6.0 && lamp.corners().iter().any(beside_plate) {
            seen += 1;
            assert!(element.irradiance[0] > 0.0 || element.error[0] > 0.0, "dark at {centre}");
        }
    }
    assert!(seen > 100, "{seen} elements");
}

/// A lamp whose edge lies on a wall: the wall's elements on both sides of the lamp's plane have the mean light of their part below it.
#[test]
fn elements_across_the_plane_of_a_lamp_have_the_light_of_their_part_before_it() {
    let mut pieces = Pieces::empty();
    pieces.grey("wall", 0.0).rectangle(DVec3::new(0.0, -2.0, 0.0), 4.0 * DVec3::Y, 3.0 * DVec3::Z);
    let [low, high] = [DVec3::new(0.0, -1.03, 2.117), DVec3::new(0.3, 0.97, 2.117)];
    let lamp = facing_down([low.x, high.x], [low.y, high.y], low.z);
    pieces.glowing("lamp", 5.0).polygon(&lamp);
    let mesh = solved(&pieces.scene(), &[], &Options { error: 0.1, audit: 0, ..Options::default() }).mesh;
    const POINTS: u32 = 20;
    let (mut found, mut wanted) = (0.0, 0.0);
    for element in mesh.elements.iter().filter(|e| e.object == 0 && e.front) {
        let [a, _, c, _] = element.corners.map(|c| mesh.vertices[c as usize].as_dvec3());
        if (a.z.min(c.z)..a.z.max(c.z)).contains(&low.z) {
            let part = |k: u32| (f64::from(k) + 0.5) / f64::from(POINTS);
            let light = |k: u32| {
                let at = a + DVec3::new(0.0, part(k % POINTS), part(k / POINTS)) * (c - a);
                if at.z < low.z { point_to_polygon(at, DVec3::X, &lamp) } else { 0.0 }
            };
            let mean = (0..POINTS * POINTS).map(light).sum::<f64>() / f64::from(POINTS * POINTS);
            found += element.area * element.irradiance[0];
            wanted += element.area * 5.0 * std::f64::consts::PI * mean;
        }
    }
    assert!(wanted > 0.0 && (found / wanted - 1.0).abs() < 0.03, "{found} instead of {wanted}");
}

/// Slender faces and a lamp of two sides, with coordinates from 1e-12 to 1e6.
#[test]
fn needles_of_any_length_keep_the_energy() {
    let far = 1e6;
    let corners = [
        DVec3::new(-1.0, 2.0, far),
        DVec3::new(1.0, 0.0, 1.0),
        DVec3::new(0.0, 3.0, -1.0),
        DVec3::new(1.3, 1.0, 1e-7),
        DVec3::new(far, far, 2.0),
        DVec3::new(-1.2, 0.0, far),
        DVec3::new(1e-12, 1.0, 1e-12),
        DVec3::new(-1.9, 1e-30, 1e-7),
        DVec3::new(far, -0.01, 1e-12),
    ];
    let mut pieces = Pieces::empty();
    pieces.grey("needles", 0.5);
    for face in [[8, 5, 7], [6, 0, 5], [2, 4, 8], [0, 6, 1], [3, 1, 6]] {
        pieces.polygon(&face.map(|k: usize| corners[k]));
    }
    pieces.glowing("lamp", 5.0).polygon(&[7, 3, 4].map(|k: usize| corners[k]));
    let scene = pieces.scene_with(&LoadOptions { two_sided_emission: true, ..LoadOptions::default() });
    for (error, local_rays) in [(0.1, Some(400_000)), (0.02, Some(0)), (1.0, Some(0))] {
        let options = Options { error, local_rays, audit: 0, ..Options::default() };
        let Ledger { emitted, created, .. } = solved(&scene, &[], &options).record.ledger;
        assert!(emitted > 0.0 && created.abs() < 5e-3 * emitted, "{error}: created {created} of {emitted}");
    }
}
