//! Radiance and irradiance of the models.

use super::*;
use crate::sky::gradation::{CIE_CLEAR, TRADITIONAL_OVERCAST, cie_shape};
use crate::sky::perez::{Atmosphere, SOLAR_CONSTANT};
use crate::sky::position::clear_irradiances;

/// Horizontal irradiance over radiance at the zenith with the sun at 60° of elevation, CIE types 1 to 16 (quadrature by another program,
/// from the coefficients of ISO 15469).
const CIE_RATIOS: [f64; 16] = [
    2.449541, 2.086023, 2.769988, 2.315419, PI, 2.584160, 2.421225, 2.328380, 3.459323, 3.170260, 2.989061,
    3.190573, 3.025853, 3.216957, 3.015856, 2.443461,
];

/// The rows of this name, as many, in the stored table of values of other programs, see `scenes/sky_reference.py`: numbers (NaN for empty
/// and for texts), and the time where there is one.
fn reference(name: &str, count: usize) -> Vec<([f64; 6], String)> {
    let mut reader =
        csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(include_str!("reference.csv").as_bytes());
    let row = |r: csv::StringRecord| {
        ([1, 2, 3, 4, 5, 6].map(|k| r[k].parse().unwrap_or(f64::NAN)), r[1].to_owned())
    };
    let rows = reader.records().map(|r| r.expect("a row")).filter(|r| &r[0] == name);
    let rows: Vec<_> = rows.map(row).collect();
    assert_eq!(rows.len(), count, "{name}");
    rows
}

#[test]
fn cie_skies_have_their_irradiances() {
    for (kind, ratio) in (1..=16).zip(CIE_RATIOS) {
        let sky = environment(&format!("cie:{kind},1000"), "30,60");
        let zenith = sky.radiance(DVec3::Z)[1];
        assert_near(1000.0 / zenith, ratio, 1e-4);
    }
}

#[test]
fn radiance_is_that_of_other_programs() {
    for (what, count) in [("perez", 120), ("clear", 30), ("overcast", 10)] {
        for ([clearness, brightness, sun, azimuth, elevation, value], _) in reference(what, count) {
            let towards = frame().direction(180.0, sun);
            let zenith_angle = (90.0 - sun).to_radians();
            let shape = match what {
                "perez" => Atmosphere { clearness, brightness, zenith_angle }.shape(towards),
                "clear" => cie_shape(CIE_CLEAR, towards),
                _ => cie_shape(TRADITIONAL_OVERCAST, towards),
            };
            // Coefficients are printed with six digits, radiance with four; the clear sky of Radiance has rounded coefficients.
            let relative = shape.relative(frame().direction(azimuth, elevation)) / shape.relative(DVec3::Z);
            assert_near(relative, value, 1e-3);
        }
    }
}

#[test]
fn efficacies_are_those_of_gendaylit() {
    for (which, what) in ["diffuse efficacy", "direct efficacy"].into_iter().enumerate() {
        for ([direct, diffuse, elevation, .., value], _) in reference(what, 5) {
            // Without a date gendaylit takes the distance of the sun on 1 January, where irradiance is 3.5 % higher.
            let zenith_angle = (90.0 - elevation).to_radians();
            let atmosphere = Atmosphere::new(direct, diffuse, 1.035 * SOLAR_CONSTANT, zenith_angle);
            // 2 cm of water.
            let dew_point = (2.0f64.ln() + 0.075) / 0.07;
            assert_near(atmosphere.efficacy(dew_point)[which], value, 2e-3);
        }
    }
}

#[test]
fn clear_skies_have_the_irradiance_of_pvlib() {
    for (which, what) in ["clear direct", "clear diffuse"].into_iter().enumerate() {
        for ([turbidity, elevation, altitude, .., value], _) in reference(what, 6) {
            let zenith_angle = (90.0 - elevation).to_radians();
            let found = clear_irradiances(turbidity, zenith_angle, altitude, SOLAR_CONSTANT);
            assert_near(found[which], value, 1e-4);
        }
    }
}

#[test]
fn the_sun_is_where_pvlib_finds_it() {
    for ([_, latitude, longitude, azimuth, elevation, _], time) in reference("sun", 5) {
        let place = Place { latitude, longitude, altitude: 0.0 };
        let air = Air { pressure: Some(1013.25), temperature: 12.0 };
        let sun = position::sun_position(&place, &time.parse().expect("a time"), &air).expect("a position");
        let error = (sun.azimuth - azimuth).abs().max((sun.elevation - elevation).abs());
        assert!(error < 3e-4, "{time}: {sun:?}, not {azimuth} and {elevation}");
    }
}

/// The worked example of NREL/TP-560-34302, appendix A.5: 2003-10-17, 12:30:30, UTC − 7 h.
#[test]
fn the_sun_is_where_the_worked_example_says() {
    let place = Place { latitude: 39.742476, longitude: -105.1786, altitude: 1830.14 };
    for air in [Air { pressure: Some(820.0), temperature: 11.0 }, Air { pressure: None, temperature: 12.0 }] {
        for time in ["2003-10-17T12:30:30-07:00", "2003-10-17T19:30:30Z"] {
            let sun =
                position::sun_position(&place, &time.parse().expect("a time"), &air).expect("a position");
            assert!((sun.azimuth - 194.340241).abs() < 3e-4, "{sun:?}");
            assert!((90.0 - sun.elevation - 50.111622).abs() < 3e-4, "{sun:?}");
            assert!((sun.distance - 0.9965421031).abs() < 1e-6, "{sun:?}");
        }
    }
}

/// Errors relative to the radiance, of at least 1 % of that at the zenith: skies of unlikely brightness fall to 0.
#[test]
fn tables_agree_with_formulas() {
    let sun = frame().direction(200.0, 35.0);
    let mut shapes: Vec<Shape> = (1..=15).map(|kind| cie_shape(kind, sun)).collect();
    let zenith_angle = 55f64.to_radians();
    for clearness in [1.02, 1.1, 1.4, 1.8, 2.3, 3.5, 5.0, 9.0] {
        shapes.extend(
            [0.05, 0.2, 0.5].map(|brightness| Atmosphere { clearness, brightness, zenith_angle }.shape(sun)),
        );
    }
    let mut worst = 0.0f64;
    for shape in shapes {
        let Shape::Gradation(formula) = shape else { continue };
        let table = gradation::GradationTable::new(&formula);
        for v in directions(40_000).filter(|v| v.z > 0.0) {
            let (value, wanted) = (table.relative(v), shape.relative(v));
            worst = worst.max((value - wanted).abs() / wanted.max(0.01 * shape.relative(DVec3::Z)));
        }
    }
    assert!(worst < 2e-4, "relative error {worst}");
}

#[test]
fn levels_are_integrals() {
    let mut skies: Vec<(String, f64)> = (1..=16).map(|kind| (format!("cie:{kind},300"), 300.0)).collect();
    for (direct, diffuse) in [
        (0.0, 80.0),
        (20.0, 200.0),
        (80.0, 250.0),
        (150.0, 250.0),
        (300.0, 200.0),
        (500.0, 150.0),
        (800.0, 90.0),
    ] {
        skies.push((format!("perez:{direct},{diffuse}"), diffuse));
    }
    for sun in ["80,8:0", "200,88:0"] {
        for (text, wanted) in &skies {
            let sky = environment(text, sun);
            let found = integral(300, 0.0, |v| v.z * sky.radiance(v)[0]);
            assert_near(found, *wanted, 1e-4);
            assert_near(sky.irradiance(DVec3::Z)[0], *wanted, 5e-4);
        }
    }
}

#[test]
fn other_levels_are_kept() {
    let mut options = SkyOptions::parse("cie:3").expect("a sky");
    options.zenith = Some(70.0);
    let sky = options.environment(DVec3::Z).expect("a sky");
    assert_near(sky.radiance(DVec3::Z)[2], 70.0, 1e-12);
    options.zenith = None;
    options.diffuse_horizontal = Some(Amount::Rgb([10.0, 20.0, 0.0]));
    let sky = options.environment(DVec3::Z).expect("a sky");
    let found = sky.sky().expect("a sky").horizontal_irradiance();
    assert_near(found[1], 20.0, 1e-12);
    assert_eq!((found[0], found[2]), (10.0, 0.0));
}

#[test]
fn tilted_planes_have_closed_forms() {
    let sky = environment("uniform:3", "120,40:700");
    let radiance = 3.0 / PI;
    let sun = frame().direction(120.0, 40.0);
    assert_near(sky.radiance(DVec3::new(0.6, 0.0, 0.8))[0], radiance, 1e-12);
    for normal in directions(300) {
        // Uniform sky: π L (1 + cos slope) / 2.
        let of_sky = PI * radiance * (1.0 + normal.z) / 2.0;
        assert_near(sky.sky_irradiance(normal)[0] + 1.0, of_sky + 1.0, 1e-7);
        let cosine = sun.dot(normal);
        if cosine.abs() > 0.01 {
            assert_near(sky.irradiance(normal)[0] + 1.0, of_sky + 700.0 * cosine.max(0.0) + 1.0, 1e-6);
        }
    }
}

/// Ground of reflectance ρ below a uniform sky: ρ E / π, and (1 − cos slope) / 2 of it on a tilted plane.
#[test]
fn the_ground_reflects_sky_and_sun() {
    let mut options =
        SkyOptions::parse("uniform:200").and_then(|o| o.with_sun("180,30:600")).expect("options");
    options.ground = Some(Amount::Rgb([0.2, 0.1, 0.5]));
    let sky = options.environment(DVec3::Y).expect("a sky");
    let horizontal = 200.0 + 300.0;
    for (c, reflectance) in [0.2, 0.1, 0.5].into_iter().enumerate() {
        let ground = reflectance * horizontal / PI;
        assert_near(sky.radiance(DVec3::new(0.6, -0.8, 0.0))[c], ground, 1e-6);
        let normal = DVec3::new(0.8, 0.6, 0.0);
        let wanted = 200.0 * 1.6 / 2.0 + PI * ground * 0.4 / 2.0;
        assert_near(sky.sky_irradiance(normal)[c], wanted, 1e-6);
    }
    assert_eq!(environment("uniform:2", "none").radiance(DVec3::NEG_Z), [0.0; 3]);
}

#[test]
fn tilted_planes_below_gradations_agree_with_quadrature() {
    for (text, sun) in [
        ("perez:800,90", "200,25:0"),
        ("cie:15,100", "90,70"),
        ("overcast:100", "none"),
        ("perez:5,120", "60,5:0"),
    ] {
        let sky = environment(text, sun);
        for normal in directions(13) {
            let wanted = integral(350, 0.0, |v| v.dot(normal).max(0.0) * sky.radiance(v)[0]);
            assert!((sky.irradiance(normal)[0] - wanted).abs() < 5e-4 * wanted + 1e-4, "{text} {normal}");
        }
    }
}

/// The table is exact where the plane's horizon cuts nothing, and near to exact elsewhere; hardest where the sky is bright around a low
/// sun.
#[test]
fn tabulated_planes_are_those_of_the_patches() {
    for (text, sun, ground) in [
        ("uniform:200", "none", 0.0),
        ("clear:3", "135,40", 0.5),
        ("cie:15,100", "90,20", 0.0),
        ("cie:15,100", "300,5", 0.2),
        ("overcast:100", "none", 0.0),
    ] {
        let mut options = SkyOptions::parse(text).and_then(|o| o.with_sun(sun)).expect("options");
        options.ground = Some(Amount::Grey(ground));
        let sky = options.environment(DVec3::Z).expect("a sky");
        let level = sky.sky_irradiance(DVec3::Z)[0];
        let (mut squares, mut worst) = (0.0, 0.0f64);
        for normal in directions(400) {
            let error = (sky.tabulated_sky_irradiance(normal)[0] - sky.sky_irradiance(normal)[0]) / level;
            squares += error * error / 400.0;
            worst = worst.max(error.abs());
        }
        assert!(worst < 1e-3 && squares.sqrt() < 5e-4, "{text}: {worst:.1e} {:.1e}", squares.sqrt());
        assert_near(sky.tabulated_sky_irradiance(DVec3::Z)[0] / level, 1.0, 1e-4);
    }
}

#[test]
fn other_units_scale_everything() {
    let mut options = SkyOptions::parse("perez:600,150").and_then(|o| o.with_sun("100,35")).expect("options");
    options.ground = Some(Amount::Grey(0.2));
    let sky = options.environment(DVec3::Z).expect("a sky");
    let scaled = sky.scaled(1.0 / 179.0);
    for normal in directions(50) {
        assert_near(179.0 * scaled.irradiance(normal)[0], sky.irradiance(normal)[0], 1e-9);
        assert_near(179.0 * scaled.radiance(normal)[1], sky.radiance(normal)[1], 1e-9);
        assert_near(scaled.pdf(normal), sky.pdf(normal), 1e-12);
    }
    let diffuse = scaled.sky().expect("a sky").horizontal_irradiance()[0];
    assert_near(179.0 * diffuse, 150.0, 1e-9);
}

/// A sky turned with its frame has the same radiance in the turned direction.
#[test]
fn axes_turn_the_sky() {
    let mut options = SkyOptions::parse("perez:600,150").and_then(|o| o.with_sun("100,35")).expect("options");
    let z = options.environment(DVec3::Z).expect("a sky");
    let y = options.environment(DVec3::Y).expect("a sky");
    options.north = Some([1.0, 0.0, 0.0]);
    let turned = options.environment(DVec3::Z).expect("a sky");
    for v in directions(500) {
        let wanted = z.radiance(v)[0] + 1.0;
        // East is +x in both; up is +y and north −z, or north is +x and east −y.
        assert_near(y.radiance(DVec3::new(v.x, v.z, -v.y))[0] + 1.0, wanted, 1e-12);
        assert_near(turned.radiance(DVec3::new(v.y, -v.x, v.z))[0] + 1.0, wanted, 1e-12);
    }
    let [azimuth, elevation] = y.frame().angles(y.suns()[0].direction);
    assert!((azimuth - 100.0).abs() < 1e-9 && (elevation - 35.0).abs() < 1e-9);
    // In the morning the sun is in the east.
    assert!(
        z.suns()[0].direction.x > 0.5 && y.suns()[0].direction.x > 0.5 && turned.suns()[0].direction.y < -0.5
    );
}
