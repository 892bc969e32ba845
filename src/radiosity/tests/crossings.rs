//! Thin walls that stand in the middle of elements.

use super::*;

/// Place of the wall of [`hall_with_wall`].
const WALL: f64 = 3.037;

/// A closed hall of 6 by 4 by 3 with a lamp below its ceiling at one end, and a thin wall across it that leaves a door of this width. No
/// line of subdivision lies below the wall.
fn hall_with_wall(door: f64) -> Scene {
    let mut pieces = Pieces::empty();
    pieces.grey("hall", 0.6).room(DVec3::ZERO, DVec3::new(6.0, 4.0, 3.0));
    pieces.grey("wall", 0.6).rectangle(WALL * DVec3::X, (4.0 - door) * DVec3::Y, 3.0 * DVec3::Z);
    pieces.glowing("lamp", 50.0).polygon(&facing_down([1.0, 2.0], [1.5, 2.5], 2.95));
    pieces.scene()
}

/// Points on the floor at this distance behind the wall.
fn behind(distance: f64) -> Vec<Point> {
    let at = |k: u32| DVec3::new(3.037 + distance, 0.5 + 0.2 * f64::from(k), 0.0);
    (0..11).map(|k| Point { position: at(k), normal: DVec3::Z }).collect()
}

#[test]
fn no_light_passes_below_a_wall() {
    let scene = hall_with_wall(0.0);
    let points = [behind(0.005), behind(0.3), behind(2.0)].concat();
    for options in [quick(), Options { audit: 0, error: 0.05, ..Options::default() }] {
        let outcome = solved(&scene, &points, &options);
        let lit = mean(outcome.record.mean_irradiance);
        let most = outcome.irradiance.iter().map(|v| v[0]).fold(0.0, f64::max);
        assert!(most < 1e-4 * lit, "{most} of {lit} behind the wall");
        let Ledger { emitted, escaped, created, .. } = outcome.record.ledger;
        assert!(
            escaped.abs() < 3e-4 * emitted && created.abs() < 5e-3 * emitted,
            "{:?}",
            outcome.record.ledger
        );
        // The wall is black from behind: pictures do not look through it.
        let dark = &outcome.mesh.elements[outcome.mesh.lit()..];
        assert!(dark.iter().any(|e| e.object == 1));
    }
}

#[test]
fn the_floor_behind_a_wall_with_a_door_is_not_brightened() {
    let scene = hall_with_wall(0.8);
    let options = Options { audit: 0, ..Options::default() };
    let distances = [0.005, 0.05];
    let light = solved(&scene, &distances.map(behind).concat(), &options).irradiance;
    for (distance, light) in distances.into_iter().zip(light.chunks(11)) {
        let (points, found) = (behind(distance), mean_at(light));
        let want = mean_at(&traced(&scene, &points, 4096, 1));
        // The points of the reference have a standard error of 1 % in their mean.
        assert!((found / want - 1.0).abs() < 0.06, "{distance}: {found} instead of {want}");
    }
}

/// A thin wall that leans and extends through floor, ceiling and walls of a closed hall: nothing escapes along it, and elements end at it.
/// Those in the dark half are dark, those in the other half have no part of the dark half in their mean.
#[test]
fn elements_end_at_a_wall_that_crosses_a_closed_room() {
    const LEAN: f64 = 0.2;
    let mut pieces = Pieces::empty();
    pieces.grey("hall", 0.6).room(DVec3::ZERO, DVec3::new(6.0, 4.0, 3.0));
    let up = DVec3::new(3.2 * LEAN, 0.0, 3.2);
    pieces.grey("wall", 0.6).rectangle(DVec3::new(WALL - 0.1 * LEAN, -0.1, -0.1), 4.2 * DVec3::Y, up);
    pieces.glowing("lamp", 50.0).polygon(&facing_down([1.0, 2.0], [1.5, 2.5], 2.95));
    let scene = pieces.scene();
    for (elements, error) in [(true, 0.02), (true, 0.1), (false, 0.1)] {
        let outcome =
            solved(&scene, &behind(0.005), &Options { audit: 0, error, elements, ..Options::default() });
        let Ledger { emitted, escaped, .. } = outcome.record.ledger;
        assert!(escaped < 5e-4 * emitted, "{escaped} of {emitted} escape");
        assert!(outcome.irradiance.iter().all(|light| *light == [0.0; 3]), "{:?}", outcome.irradiance);
        let mesh = outcome.mesh;
        let of_hall = mesh.elements[..mesh.lit()].iter().filter(|e| e.object == 0);
        for element in of_hall {
            let heights = element.corners.map(|c| {
                let p = mesh.vertices[c as usize].as_dvec3() + mesh.origin;
                p.x - WALL - LEAN * p.z
            });
            let [low, high] = [f64::min, f64::max].map(|of| heights.into_iter().reduce(of).expect("four"));
            // What extends less than a hundredth of an element is not cut off.
            let most = 0.015 * (high - low);
            assert!(low >= -most || high <= most, "{low} {high}");
            assert!(low < -most || element.irradiance == [0.0; 3], "{element:?}");
        }
    }
}

/// The floor before a screen is bright up to the foot of the screen, and its light does not come from below it; nor that of a screen
/// which ends 3 mm above the floor and beside the wall, but for what passes the gap.
#[test]
fn the_bright_foot_of_a_screen_does_not_light_what_is_behind() {
    for (gap, allowed) in [(0.0, 0.1), (0.003, 0.2)] {
        let mut pieces = Pieces::empty();
        pieces.grey("room", 0.7).room(DVec3::ZERO, DVec3::new(4.0, 3.0, 2.5));
        let corner = DVec3::new(gap, 1.0, gap);
        pieces.grey("screen", 0.5).rectangle(corner, 0.4 * DVec3::X, 0.6 * DVec3::Z);
        pieces.glowing("lamp", 20.0).rectangle(DVec3::new(0.05, 0.8, 0.1), 0.4 * DVec3::Z, 0.3 * DVec3::X);
        let scene = pieces.scene();
        let place = |x: f64, y: f64| Point { position: DVec3::new(x, 1.0 + y, 0.0), normal: DVec3::Z };
        let points: Vec<Point> = (1..9).map(|k| place(0.05 * f64::from(k) - 0.02, 0.02)).collect();
        let options = Options { audit: 0, elements: false, ..Options::default() };
        let found = mean_at(&solved(&scene, &points, &options).irradiance);
        let want = mean_at(&traced(&scene, &points, 8192, 1));
        assert!((found / want - 1.0).abs() < allowed, "{gap}: {found} instead of {want}");
    }
}

/// Elements are split where direct light differs over them: along the edge of a shadow that no contact line marks.
#[test]
fn elements_are_smaller_at_edges_of_shadows() {
    let mut pieces = Pieces::empty();
    pieces.grey("floor", 0.5).polygon(&facing_up([0.0, 4.0], [0.0, 4.0], 0.0));
    pieces.grey("plate", 0.5).polygon(&facing_up([1.6, 2.4], [1.6, 2.4], 0.5));
    pieces.glowing("lamp", 10.0).polygon(&facing_down([1.99, 2.01], [1.99, 2.01], 2.0));
    let scene = pieces.scene();
    let mesh = solved(&scene, &[], &Options { audit: 0, ..Options::default() }).mesh;
    // The shadow of the plate, .5 above the floor and 1.5 below the lamp, ends 2 / 1.5 times as far from the middle.
    let half = 0.4 * 2.0 / 1.5;
    let (mut at_edge, mut elsewhere) = (Vec::new(), Vec::new());
    for element in mesh.elements.iter().filter(|e| e.object == 0 && e.front) {
        let corners = element.corners.map(|k| mesh.vertices[k as usize].as_dvec3() + mesh.origin);
        let away = |p: DVec3| (p.x - 2.0).abs().max((p.y - 2.0).abs()) - half;
        let [low, high] =
            [f64::min, f64::max].map(|of| corners.map(away).into_iter().reduce(of).expect("four"));
        if low < 0.0 && high > 0.0 {
            at_edge.push(element.area);
        } else if low > 0.3 {
            elsewhere.push(element.area);
        }
    }
    let mean = |areas: &[f64]| areas.iter().sum::<f64>() / areas.len() as f64;
    assert!(at_edge.len() > 20 && elsewhere.len() > 20, "{} {}", at_edge.len(), elsewhere.len());
    assert!(mean(&at_edge) < 0.5 * mean(&elsewhere), "{} {}", mean(&at_edge), mean(&elsewhere));
}

/// A closed hall that thin walls divide into `count` square rooms along each side, with a lamp in every other room.
fn rooms(count: usize) -> Scene {
    const SIDE: f64 = 4.3;
    let (mut pieces, end) = (Pieces::empty(), SIDE * count as f64);
    pieces.grey("hall", 0.7).room(DVec3::ZERO, DVec3::new(end, end, 2.7));
    for at in (1..count).map(|k| SIDE * k as f64) {
        pieces.grey("wall", 0.7).rectangle(at * DVec3::X, end * DVec3::Y, 2.7 * DVec3::Z);
        pieces.rectangle(at * DVec3::Y, end * DVec3::X, 2.7 * DVec3::Z);
    }
    for k in (0..count * count).filter(|k| (k / count + k % count).is_multiple_of(2)) {
        let [x, y] = [k / count, k % count].map(|place| SIDE * (place as f64 + 0.5));
        pieces.glowing("lamp", 50.0).polygon(&facing_down([x - 0.3, x + 0.3], [y - 0.3, y + 0.3], 2.6));
    }
    pieces.scene()
}

/// However many walls stand on the elements of one floor.
#[test]
fn rooms_without_lamps_are_dark() {
    let at = |x: f64, y: f64, z: f64, normal: DVec3| Point { position: DVec3::new(x, y, z), normal };
    let points = [
        at(2.0, 6.3, 0.0, DVec3::Z),
        at(4.2, 7.3, 0.0, DVec3::Z),
        at(2.0, 6.3, 2.7, -DVec3::Z),
        at(0.0, 5.6, 1.3, DVec3::X),
        at(2.0, 2.0, 0.0, DVec3::Z),
    ];
    for elements in [false, true] {
        let options = Options { audit: 0, error: 0.2, elements, ..Options::default() };
        let outcome = solved(&rooms(5), &points, &options);
        let found: Vec<f64> = outcome.irradiance.iter().map(|v| v[0]).collect();
        assert!(found[..4] == [0.0; 4] && found[4] > 1.0, "{found:?}");
        let Ledger { emitted, created, .. } = outcome.record.ledger;
        assert!(created.abs() < 5e-3 * emitted, "{created} of {emitted}");
    }
}

/// Two bright boxes a hand apart, a little before a wall: the light in the gap between them falls off over less than an element.
#[test]
fn gaps_between_boxes_have_the_light_of_paths() {
    let mut pieces = Pieces::empty();
    pieces.grey("hall", 0.6).room(DVec3::ZERO, DVec3::new(6.0, 4.0, 3.0));
    for (name, left) in [("left", 2.0), ("right", 3.136)] {
        // Mirrored, the faces are wound outward.
        pieces.grey(name, 0.9).room(DVec3::new(left + 1.0, 3.69, 0.0), DVec3::new(left, 3.99, 2.0));
    }
    pieces.glowing("lamp", 15.0).polygon(&facing_down([2.7, 3.3], [1.2, 1.8], 2.99));
    let scene = pieces.scene();
    let height = |k: u32| 0.2 + 0.1 * f64::from(k);
    let points: Vec<Point> =
        (0..16).map(|k| Point { position: DVec3::new(3.0, 3.94, height(k)), normal: DVec3::X }).collect();
    let options = Options { audit: 0, elements: false, ..Options::default() };
    let found = mean_at(&solved(&scene, &points, &options).irradiance);
    let truth = mean_at(&traced(&scene, &points, 16_384, 3));
    assert!((found / truth - 1.0).abs() < 0.05, "{found} instead of {truth}");
}

/// A lamp behind a plate whose hole shows a hundredth of it: at most points, the first shadow rays all end on the plate.
#[test]
fn small_holes_before_lamps_let_all_their_light_through() {
    for lamps in [1, 16] {
        light_passes_a_small_hole(lamps);
    }
}

fn light_passes_a_small_hole(lamps: u32) {
    const HOLE: f64 = 0.05;
    let mut pieces = Pieces::empty();
    // Where no ray to any of many lamps has passed, further rays go to some of them only: this lamp is made of strips.
    for strip in 0..lamps {
        let ends = [strip, strip + 1].map(|k| 2.0 * f64::from(k) / f64::from(lamps) - 1.0);
        pieces.glowing(&format!("lamp {strip}"), 100.0).polygon(&facing_down(ends, [-1.0, 1.0], 2.0));
    }
    let (corner, hole) = (DVec3::new(-3.0, -3.0, 1.0), [[3.0 - HOLE; 2], [3.0 + HOLE; 2]]);
    pieces.grey("plate", 0.0).pierced(corner, [6.0 * DVec3::X, 6.0 * DVec3::Y], hole);
    let scene = pieces.scene();
    let place =
        |k: u32| DVec3::new(f64::from(k % 50), f64::from(k / 50), 0.0) * 0.016 - DVec3::new(0.39, 0.39, 0.0);
    // Most points have 256 rays, of which two or three pass the hole: their mean has a standard error of 1.1 %.
    let points: Vec<Point> = (0..2500).map(|k| Point { position: place(k), normal: DVec3::Z }).collect();
    let options = Options { audit: 0, direct_only: true, elements: false, ..Options::default() };
    let found = mean_at(&solved(&scene, &points, &options).irradiance);
    // The part of the lamp that a point p sees through the hole has its centre at -p and twice the hole's size.
    let of =
        |p: &Point| 4.0 * (4.0 * HOLE).powi(2) / (4.0 * p.position.truncate().length_squared() + 4.0).powi(2);
    let want = 100.0 * points.iter().map(of).sum::<f64>() / points.len() as f64;
    assert!((found / want - 1.0).abs() < 0.03, "{lamps} lamps: {found} instead of {want}");
}

/// A strip of light whose edge lies on an opaque partition, which crosses elements of floor and ceiling, in their middles or so near to
/// their edges that they are not cut there: the other half of the room is black.
#[test]
fn no_light_comes_through_a_partition_with_a_lamp_on_it() {
    // Paths that meet what such an element has beyond the partition find its light there, on a strip 0.4 mm wide.
    for (at, most) in [(0.3137, 0.0), (-0.0004, 1e-3)] {
        let mut pieces = Pieces::empty();
        pieces.grey("room", 0.5).room(DVec3::new(-3.0, -3.0, 0.0), DVec3::new(3.0, 3.0, 2.5));
        pieces.grey("partition", 0.5).rectangle(DVec3::new(at, -3.0, 0.0), 6.0 * DVec3::Y, 2.5 * DVec3::Z);
        pieces.glowing("lamp", 50.0).polygon(&facing_down([at, at + 0.05], [-1.0, 1.0], 2.211));
        let mesh = solved(&pieces.scene(), &[], &Options { audit: 0, ..Options::default() }).mesh;
        let middle = |e: &&Element| {
            e.corners.iter().map(|&c| f64::from(mesh.vertices[c as usize].x)).sum::<f64>() / 4.0
        };
        let dark: Vec<&Element> = mesh.elements.iter().filter(|e| middle(e) < at - 1e-4).collect();
        let lit: Vec<f64> = dark.iter().map(|e| e.irradiance[0]).filter(|light| *light > most).collect();
        assert!(!dark.is_empty() && lit.is_empty(), "{at}: {} elements, {:?}", lit.len(), lit.first());
    }
}
