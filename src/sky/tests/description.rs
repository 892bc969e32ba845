//! Short texts and `sky.toml`, right and wrong.

use super::*;
use crate::Error;

/// The first error of a sky, sun, place and time as texts; empty texts are left out.
fn message([sky, sun, place, time]: [&str; 4]) -> String {
    let [first, second, third, fourth] =
        [sky, sun, place, time].map(|text| Some(text).filter(|t| !t.is_empty()));
    let options = SkyOptions::of_texts(first, second, third, fourth);
    let error = options
        .and_then(|options| options.environment(DVec3::Z))
        .expect_err(&format!("{sky} {sun} {place} {time}"));
    assert!(matches!(error, Error::Argument { .. }), "{error:?}");
    error.to_string()
}

const MUNICH: &str = "48.137,11.575,520";
const NIGHT: &str = "2026-06-21T00:30+02:00";

#[test]
fn wrong_values_are_named_with_a_cure() {
    for (texts, parts) in [
        (["cloudy", "", "", ""], ["`sky` cloudy", "cie:N"]),
        (["cie:17", "", "", ""], ["17 is no type", "1 to 16"]),
        (["cie:2.5", "", "", ""], ["2.5 is no type", "1 to 16"]),
        (["cie", "", "", ""], ["`cie:N`", "1 to 16"]),
        (["uniform:-3", "", "", ""], ["-3", "at least 0"]),
        (["uniform:1e16", "", "", ""], ["1.000e16", "at most 1e15"]),
        (["uniform:NaN", "", "", ""], ["`NaN`", "not a finite number"]),
        (["clear:99", "", "", ""], ["99", "between 1 and 12"]),
        (["perez:100", "", "", ""], ["`perez:DNI,DHI`", "W/m²"]),
        (["perez:-5,100", "", "", ""], ["-5", "at least 0"]),
        (["perez:100,0", "", "", ""], ["black sky", "above 0"]),
        (["perez:100,100", "", "", ""], ["Perez sky needs the sun", "`place` and `time`"]),
        (["perez:100,100", "90,-5", "", ""], ["5.00 degrees below", "change `time`"]),
        (["perez:100,100", "90,0", "", ""], ["sun is on the horizon", "change `time`"]),
        (["uniform", "0,-10", "", ""], ["10.00 degrees below", "as none"]),
        (["clear:3", "", MUNICH, NIGHT], ["below the horizon", "clear sky"]),
        (["cie:12", "", MUNICH, NIGHT], ["below the horizon", "CIE type 12"]),
        (["uniform", "0,-10:50", "", ""], ["10.00 degrees below", "as none"]),
        (["uniform", "0,10", "", ""], ["irradiance of the sun is unknown", "AZIMUTH,ELEVATION:E"]),
        (["uniform", "0,95", "", ""], ["elevation 95", "±90"]),
        (["uniform", "south", "", ""], ["`sun` south", "AZIMUTH,ELEVATION"]),
        (["uniform", "0,0,0:5", "", ""], ["no direction", "vector"]),
        (["uniform", "0,40:-5", "", ""], ["-5", "at least 0"]),
        (["uniform", "0,40:1e16", "", ""], ["irradiance", "at most 1e15"]),
        (["uniform", "", "91,0", ""], ["latitude 91", "between -90 and 90"]),
        (["uniform", "", "48,200", ""], ["longitude 200", "between -180 and 180"]),
        (["uniform", "", "48", ""], ["`place` 48", "LATITUDE,LONGITUDE"]),
        (["uniform", "", "48,11,99999", ""], ["altitude 99999", "metres"]),
        (["uniform", "", MUNICH, ""], ["`place` without `time`", "state both"]),
        (["uniform", "", "", NIGHT], ["`time` without `place`", "state both"]),
        (
            ["uniform", "", "", "2026-02-30T12:00Z"],
            ["`2026-02-30T12:00Z` is no time", "2026-06-21T12:00+02:00"],
        ),
        (["uniform", "", "", "2026-06-21T12:00"], ["no offset from UTC", "2026-06-21T12:00+02:00"]),
        (["uniform", "", "", "2026-06-21"], ["no time", "2026-06-21T12:00+02:00"]),
        (["uniform", "", "", "5000-06-21T12:00Z"], ["the year", "1 to 3000"]),
    ] {
        let found = message(texts);
        assert!(parts.iter().all(|part| found.contains(part)) && !found.contains('\n'), "{texts:?}: {found}");
    }
}

#[test]
fn place_and_time_put_the_sun_into_the_sky() {
    let options =
        SkyOptions::parse("clear:3").and_then(|o| o.with_place(MUNICH)?.with_time("2026-06-21T13:15+02:00"));
    let mut options = options.expect("options");
    let sky = options.environment(DVec3::Y).expect("a sky");
    let sun = sky.suns()[0];
    let [azimuth, elevation] = sky.frame().angles(sun.direction);
    assert!((azimuth - 180.0).abs() < 3.0 && (elevation - 65.3).abs() < 0.1, "{azimuth} {elevation}");
    // South is +z where up is +y.
    assert!(sun.direction.z > 0.4 && sun.irradiance[0] > 800.0 && sun.irradiance[0] < 950.0);
    assert!(sky.notes[0].contains("up is +y, north -z, east +x"), "{:?}", sky.notes);
    assert!(sky.notes.iter().any(|n| n.contains("normal irradiance") && n.contains("W/m²")));
    options.photometric = true;
    let bright = options.environment(DVec3::Y).expect("a sky");
    let efficacy = bright.suns()[0].irradiance[0] / sun.irradiance[0];
    assert!((90.0..110.0).contains(&efficacy), "{efficacy} lm/W");
    let diffuse = |e: &Environment| e.sky().expect("a sky").horizontal_irradiance()[0];
    assert!((120.0..150.0).contains(&(diffuse(&bright) / diffuse(&sky))));
    let none = options.clone().with_sun("none").expect("none").environment(DVec3::Y).expect("a sky");
    assert!(none.suns().is_empty());
    // A sky without a sun of its own stays without at night.
    let night =
        SkyOptions::parse("overcast").and_then(|o| o.with_place(MUNICH)?.with_time(NIGHT)).expect("options");
    assert!(night.environment(DVec3::Z).expect("a sky").suns().is_empty());
}

#[test]
fn files_describe_everything() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sky.toml");
    let text = r#"
        sky = "perez:600,120"
        place = [48.137, 11.575, 520]
        time = 2026-06-21T10:00:00Z
        sun_diameter = 2
        ground = [0.1, 0.2, 0.3]
        north = [0, 0, -1]
        temperature = 20
        pressure = 950
        dew_point = 5
        photometric = true
    "#;
    std::fs::write(&path, text).expect("written");
    let options = SkyOptions::parse(&path.display().to_string()).expect("a description");
    assert_eq!(options.sky.0, SkyModel::Perez { direct: 600.0, diffuse: 120.0 });
    let sky = options.environment(DVec3::Y).expect("a sky");
    let ground = sky.radiance(DVec3::NEG_Y);
    assert!(sky.suns()[0].irradiance[0] > 5e4 && ground[2] > ground[0]);
    assert_near(sky.suns()[0].diameter, 2f64.to_radians(), 1e-12);
    for (text, line, what) in [
        ("sky = \"uniform\"\nclouds = 3\n", 2, "unknown field `clouds`"),
        ("# no sky\n\nsky = \"cie:20\"\n", 3, "no type of CIE sky"),
        ("sky = \"uniform\"\nplace = [95, 0]\n", 2, "latitude 95"),
        ("sky = \"uniform\"\ntime = 2026-06-21\n", 2, "2026-06-21T12:00+02:00"),
        ("sky = \"uniform\"\nground = [1, 2]\n", 2, "three"),
        ("sky = \"uniform\"\ndirect_normal = -4\n", 2, "-4"),
        ("sky = \"uniform\"\nsun = \"up\"\n", 2, "AZIMUTH,ELEVATION"),
        ("sky = \"uniform\"\nzenith = \"high\"\n", 2, "expected a number"),
        ("sky = \"uniform\"\nmap_north = \"south\"\n", 2, "`map_north`: invalid type"),
        (
            "# mine\n[sky]\nmodel = \"cie:3\"\n",
            2,
            "`sky` is a table (invalid type: map, expected a string): write sky = VALUE",
        ),
        ("sky = { model = \"cie:3\" }\n", 1, "`sky` is a table"),
        ("sky = \"other.toml\"\n", 1, "cannot name another"),
    ] {
        std::fs::write(&path, text).expect("written");
        let found = SkyOptions::read(&path).expect_err(what).to_string();
        assert!(found.contains(&format!("sky.toml:{line}: ")) && found.contains(what), "{found}");
        assert!(!found.contains('\n'), "{found}");
    }
    for (text, what) in [
        ("sky = \"uniform:3\"\nzenith = 2", "stated twice"),
        ("sky = \"uniform\"\nground = 1.5", "`ground` 1.5"),
        ("sky = \"uniform\"\nsun_diameter = 0", "`sun_diameter` 0"),
        ("sky = \"uniform\"\nnorth = [0, 0, 1]", "not horizontal"),
        ("sky = \"uniform\"\ndirect_normal = 500", "without a sun"),
        ("map = \"a.exr\"", "no sky to multiply"),
        ("sky = \"uniform\"\npressure = 1e9", "`pressure`"),
    ] {
        std::fs::write(&path, text).expect("written");
        let found = SkyOptions::read(&path).expect("read").environment(DVec3::Z).expect_err(what).to_string();
        assert!(found.contains("sky.toml: ") && found.contains(what), "{found}");
    }
}
