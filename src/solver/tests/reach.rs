//! Where no light goes, and floors that lie on both sides of its border.

use super::*;

/// A closed room 3 by 4 by 2.5 with a lamp under its ceiling.
fn hall(soup: &mut Soup) -> (u32, u32) {
    let grey = soup.material(SoupMaterial::diffuse("grey", [0.5; 3]));
    let walls = soup.object("walls");
    inward(soup, walls, grey, DVec3::ZERO, DVec3::new(3.0, 4.0, 2.5));
    let light = soup.material(SoupMaterial::light("light", [10.0; 3]));
    let lamp = soup.object("lamp");
    let corner = |x: f64, y: f64| DVec3::new(x, y, 2.4);
    soup.polygon(lamp, light, &[corner(1.0, 1.0), corner(1.0, 2.0), corner(2.0, 2.0), corner(2.0, 1.0)]);
    (grey, walls)
}

#[test]
fn boxes_without_a_bottom_are_dark_inside() {
    let mut soup = Soup::new("box on a floor");
    let (grey, _) = hall(&mut soup);
    let thing = soup.object("box");
    let (low, high) = (DVec3::new(1.03, 2.02, 0.0), DVec3::new(2.01, 3.04, 1.0));
    let at = |k: usize| DVec3::select(glam::BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), high, low);
    // Wound outward; no bottom.
    for f in [[4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
        soup.polygon(thing, grey, &f.map(at));
    }
    let scene = resolve(soup, &LoadOptions::default()).expect("a scene");
    let outcome = solved(&scene, &[], &Options { audit: 0, ..Options::default() });
    let inside = outcome.solution.elements.iter().filter(|e| e.object == 2 && !e.front).count();
    assert_eq!(inside, 0, "no light gets there");
    assert!(outcome.solution.elements.iter().any(|e| e.object == 2 && e.front));
    let ledger = &outcome.record.ledger;
    assert!(ledger.created.abs() < 2e-3 * ledger.emitted, "{ledger:?}");
}

#[test]
fn rooms_with_a_weak_lamp_of_their_own_are_not_dark() {
    let mut soup = Soup::new("two rooms");
    let (grey, walls) = hall(&mut soup);
    inward(&mut soup, walls, grey, DVec3::new(5.0, 0.0, 0.0), DVec3::new(8.0, 4.0, 2.5));
    let glow = soup.material(SoupMaterial::light("glow", [1e-6; 3]));
    let lamp = soup.object("night light");
    let corner = |x: f64, y: f64| DVec3::new(x, y, 2.4);
    soup.polygon(lamp, glow, &[corner(6.0, 1.0), corner(6.0, 1.1), corner(6.1, 1.1), corner(6.1, 1.0)]);
    let scene = resolve(soup, &LoadOptions::default()).expect("a scene");
    let point = Point { position: DVec3::new(6.5, 2.0, 0.0), normal: DVec3::Z };
    let outcome = solved(&scene, &[point], &Options { audit: 0, ..Options::default() });
    let e = outcome.irradiance[0][0];
    assert!(e > 0.0 && e < 1e-6, "{e}");
    let there =
        |e: &&crate::solution::Element| e.object == 0 && e.irradiance[0] > 0.0 && e.irradiance[0] < 1e-5;
    assert!(outcome.solution.elements.iter().filter(there).count() > 5);
}

/// A plate from wall to wall: the walls' elements reach past it, the light does not.
#[test]
fn a_plate_from_wall_to_wall_keeps_the_energy() {
    let mut soup = Soup::new("plate");
    let (grey, _) = hall(&mut soup);
    let plate = soup.object("plate");
    let corner = |x: f64, y: f64| DVec3::new(x, y, 1.07);
    soup.polygon(plate, grey, &[corner(0.0, 0.0), corner(3.0, 0.0), corner(3.0, 4.0), corner(0.0, 4.0)]);
    let scene = resolve(soup, &LoadOptions::default()).expect("a scene");
    let at = |z: f64, up: f64| Point { position: DVec3::new(1.3, 1.7, z), normal: DVec3::Z * up };
    let outcome = solved(&scene, &[at(0.0, 1.0), at(1.07, 1.0)], &Options { audit: 0, ..Options::default() });
    assert!(outcome.irradiance[0][0] < 0.01 * outcome.irradiance[1][0], "{:?}", outcome.irradiance);
    let ledger = &outcome.record.ledger;
    assert!(ledger.created.abs() < 2e-3 * ledger.emitted, "{ledger:?}");
}
