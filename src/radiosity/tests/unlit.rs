//! Where no light goes, and floors that lie on both sides of its border.

use super::*;

/// A closed room 3 by 4 by 2.5 with a lamp under its ceiling, and rooms without a lamp.
fn hall(dark: &[[DVec3; 2]]) -> Pieces {
    let mut pieces = Pieces::empty();
    pieces.grey("walls", 0.5).room(DVec3::ZERO, DVec3::new(3.0, 4.0, 2.5));
    for &[low, high] in dark {
        pieces.room(low, high);
    }
    pieces.glowing("lamp", 10.0).polygon(&facing_down([1.0, 2.0], [1.0, 2.0], 2.4));
    pieces
}

#[test]
fn boxes_without_a_bottom_are_dark_inside() {
    let mut pieces = hall(&[]);
    // Mirrored, the faces are wound outward.
    let (low, high) = (DVec3::new(2.01, 2.02, 0.0), DVec3::new(1.03, 3.04, 1.0));
    pieces.grey("box", 0.5).room_without(Wall::Floor, low, high);
    let scene = pieces.scene();
    let outcome = solved(&scene, &[], &coarse());
    let (lit, dark) = outcome.mesh.elements.split_at(outcome.mesh.lit());
    assert!(!lit.iter().any(|e| e.object == 2 && !e.front), "no light gets there");
    assert!(dark.len() == 5 && dark.iter().all(|e| e.object == 2 && !e.front && e.radiosity == [0.0; 3]));
    assert!(outcome.mesh.elements.iter().any(|e| e.object == 2 && e.front));
    let Record { unlit, warnings, .. } = &outcome.record;
    assert!(unlit.sides == 5 && unlit.of > 16 && (0.01..0.2).contains(&unlit.area), "{unlit:?}");
    assert!(warnings.is_empty(), "{warnings:?}");
    let ledger = &outcome.record.ledger;
    assert!(ledger.created.abs() < 2e-3 * ledger.emitted, "{ledger:?}");
}

#[test]
fn rooms_with_a_weak_lamp_of_their_own_are_not_dark() {
    let mut pieces = hall(&[[DVec3::new(5.0, 0.0, 0.0), DVec3::new(8.0, 4.0, 2.5)]]);
    pieces.glowing("night light", 1e-6).polygon(&facing_down([6.0, 6.1], [1.0, 1.1], 2.4));
    let scene = pieces.scene();
    let point = Point { position: DVec3::new(6.5, 2.0, 0.0), normal: DVec3::Z };
    let outcome = solved(&scene, &[point], &quick());
    let e = outcome.irradiance[0][0];
    assert!(e > 0.0 && e < 1e-6, "{e}");
    let there = |e: &&Element| e.object == 0 && e.irradiance[0] > 0.0 && e.irradiance[0] < 1e-5;
    assert!(outcome.mesh.elements.iter().filter(there).count() > 5);
}

/// Nobody expects most of a scene to be dark.
#[test]
fn a_large_room_without_a_lamp_is_told_of() {
    let scene = hall(&[[DVec3::new(5.0, 0.0, 0.0), DVec3::new(15.0, 8.0, 5.0)]]).scene();
    let Record { unlit, warnings, .. } =
        solved(&scene, &[], &Options { audit: 0, ..Options::default() }).record;
    // Its walls, 340 square metres, and what it could see of the other room from outside, beside 59 and the lamp's two sides.
    assert!(unlit.sides == 12 && (unlit.area - 399.0 / 460.0).abs() < 1e-4, "{unlit:?}");
    assert!(warnings.iter().any(|w| w.contains("12 of 20 sides")), "{warnings:?}");
}

/// A plate from wall to wall: the walls' elements reach past it, the light does not.
#[test]
fn a_plate_from_wall_to_wall_keeps_the_energy() {
    let mut pieces = hall(&[]);
    pieces.grey("plate", 0.5).polygon(&facing_up([0.0, 3.0], [0.0, 4.0], 1.07));
    let scene = pieces.scene();
    let at = |z: f64, up: f64| Point { position: DVec3::new(1.3, 1.7, z), normal: DVec3::Z * up };
    let outcome = solved(&scene, &[at(0.0, 1.0), at(1.07, 1.0)], &coarse());
    assert!(outcome.irradiance[0][0] < 0.01 * outcome.irradiance[1][0], "{:?}", outcome.irradiance);
    let ledger = &outcome.record.ledger;
    assert!(ledger.created.abs() < 2e-3 * ledger.emitted, "{ledger:?}");
}

/// Two rooms with a sheet between them that has a slit or a door: what gets through is what paths find. Seen edge-on the
/// sheet and the wall beside it are not nothing.
#[test]
fn a_sheet_with_a_door_keeps_rooms_apart() {
    // What gets through a slit is little, and known the less.
    for (door, rough, off) in [(0.05, 0.7, 0.35), (1.0, 0.25, 0.1)] {
        let mut pieces = Pieces::empty();
        pieces.grey("walls", 0.8).room(DVec3::ZERO, DVec3::new(6.0, 3.0, 2.5));
        pieces.glowing("lamp", 10.0).polygon(&facing_down([1.0, 2.0], [1.0, 2.0], 2.4));
        pieces.grey("sheet", 0.8).rectangle(3.0 * DVec3::X, (3.0 - door) * DVec3::Y, 2.5 * DVec3::Z);
        let scene = pieces.scene();
        let points: Vec<Point> = (0..60)
            .map(|k| DVec3::new(3.2 + (k % 10) as f64 * 0.28, 0.2 + (k / 10) as f64 * 0.5, 0.0))
            .map(|position| Point { position, normal: DVec3::Z })
            .collect();
        let want = limits::truth(&scene, &points, 1024);
        let outcome = solved(&scene, &points, &Options { min_area: 2e-5, ..quick() });
        let (rms, bias) = limits::off(&outcome.irradiance, &want);
        assert!(bias.abs() < off && rms < rough, "{door}: {rms} {bias}");
    }
}

/// A lamp above the middle of a square floor: all four parts of it are alike, and yet they are not even; off the middle no
/// element has another light than its place.
#[test]
fn open_floors_are_lit_by_the_closed_form() {
    for middle in [0.0, 0.7] {
        let corners = facing_down([middle - 0.5, middle + 0.5], [-0.5, 0.5], 3.0);
        let mut pieces = Pieces::empty();
        pieces.grey("floor", 0.5).polygon(&facing_up([-5.0, 5.0], [-5.0, 5.0], 0.0));
        pieces.glowing("lamp", 10.0).polygon(&corners);
        let scene = pieces.scene();
        let outcome = solved(&scene, &[], &Options { audit: 0, ..Options::default() });
        let solution = &outcome.mesh;
        let (mut squares, mut sum, mut area) = (0.0, 0.0, 0.0);
        for e in solution.elements.iter().filter(|e| e.object == 0 && e.front) {
            let [a, _, c, _] = e.corners.map(|v| solution.vertices[v as usize].as_dvec3() + scene.origin);
            let want = 31.415_926
                * crate::form_factors::analytic::point_to_polygon(0.5 * (a + c), DVec3::Z, &corners);
            squares += e.area * (e.irradiance[0] - want).powi(2);
            sum += e.area * want;
            area += e.area;
        }
        let rms = (squares * area).sqrt() / sum;
        assert!(rms < 0.05 && solution.elements.len() > 500, "{middle}: {rms} {}", solution.elements.len());
    }
}

/// The mean irradiance, to which errors are relative, is that of the inside: a lamp above the room changes nothing. In the open all lit
/// sides count.
#[test]
fn the_mean_is_that_of_the_inside() {
    let mean = |pieces: Pieces| solved(&pieces.scene(), &[], &coarse()).record.mean_irradiance[0];
    let above = |mut pieces: Pieces| {
        pieces.glowing("lamp above", 10.0).polygon(&facing_down([1.0, 2.0], [1.0, 2.0], 4.0));
        pieces
    };
    let mut ground = Pieces::empty();
    ground.grey("ground", 0.2).polygon(&facing_up([-9.0, 12.0], [-8.0, 12.0], 0.0));
    let (alone, with_more) = (mean(hall(&[])), mean(above(hall(&[]))));
    assert!((with_more / alone - 1.0).abs() < 0.02, "{alone} {with_more}");
    // All light of the lamp, of 10 W/m²sr and 1 m², would bring 10 π W over 420 m².
    let (open, all) = (mean(above(ground)), 10.0 * std::f64::consts::PI / 420.0);
    assert!(open > 0.8 * all && open < all, "{open} of {all} W/m\u{b2}");
}
