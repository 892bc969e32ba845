//! Emitters of many faces, whose light elements have no closed form for.

use super::*;
use crate::form_factors::analytic::point_to_polygon;
use std::f64::consts::PI;

/// A black floor below a dome of 16 by 8 faces of radiance 1, and a lamp of this radiance in the height 3 that faces down.
fn below_dome(lamp: f32) -> Scene {
    let mut pieces = Pieces::empty();
    pieces.grey("floor", 0.0).polygon(&facing_up([-2.0, 2.0], [-2.0, 2.0], 0.0));
    pieces.dome(20.0, [16, 8]);
    pieces.glowing("lamp", lamp).polygon(&facing_down([0.8, 1.0], [0.3, 0.5], 3.0));
    pieces.scene()
}

/// The elements of the front of the floor, with their centres.
fn of_floor(scene: &Scene, seed: u64) -> Vec<(Element, DVec3)> {
    let options = Options { local_rays: Some(200_000), audit: 0, seed, ..Options::default() };
    let mesh = solved(scene, &[], &options).mesh;
    let centre =
        |e: &Element| e.corners.iter().map(|&c| mesh.vertices[c as usize].as_dvec3()).sum::<DVec3>() / 4.0;
    let of_front = mesh.elements.iter().filter(|e| e.object == 0 && e.front);
    of_front.map(|e| (*e, centre(e))).collect()
}

/// Where all is equally bright, rays that meet it have no noise: elements differ by .02 %, by .7 % with rays to points of the dome.
#[test]
fn light_of_an_even_dome_has_no_noise() {
    let light: Vec<f64> = of_floor(&below_dome(1.0), 0).iter().map(|(e, _)| e.irradiance[0]).collect();
    let [low, high] = [f64::min, f64::max].map(|of| light.iter().copied().reduce(of).expect("elements"));
    // All have the factor by which received and emitted power are balanced.
    assert!((low / PI - 1.0).abs() < 0.01 && high / low < 1.003, "{low} {high}");
}

/// Few rays of an element meet a small lamp of a hundred times the brightness or more: rays to emitters find it, also where it has most
/// of the power. One ray of some two hundred that met the lamp by chance would bring a third of the light, and with such rays alone a
/// quarter of the elements would err as much.
#[test]
fn a_lamp_in_a_dome_keeps_its_light() {
    let lamp = facing_down([0.8, 1.0], [0.3, 0.5], 3.0);
    for (bright, seed) in [(100.0, 0), (1e5, 1)] {
        let (mut area, mut area_off, mut squares) = (0.0, 0.0, 0.0);
        for (element, centre) in of_floor(&below_dome(bright), seed) {
            let part = point_to_polygon(centre, DVec3::Z, &lamp);
            let want = PI * (1.0 + (f64::from(bright) - 1.0) * part);
            let error = (element.irradiance[0] / want - 1.0).abs();
            area += element.area;
            squares += element.area * error.powi(2);
            area_off += if error > 0.35 { element.area } else { 0.0 };
        }
        let rms = (squares / area).sqrt();
        assert!(rms < 0.15 && area_off < 0.02 * area, "{bright}: {rms}, {area_off} of {area}");
    }
}
