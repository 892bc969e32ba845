//! Luminaires with photometric files and lights of glTF: light at a distance is I cos θ / d².

use super::*;
use crate::model::{Detail, Model, PrepareOptions};
use crate::path_tracer::{Settings, irradiance};
use crate::points::Point;
use crate::radiosity;
use crate::scene::{UpAxis, read_placements};
use glam::{DVec3, dvec3};

const FLOOR: &str = "v -3 -3 0\nv 3 -3 0\nv 3 3 0\nv -3 3 0\nf 1 2 3 4\n";
/// Bilateral symmetry, with light upwards; 0.1 m × 0.2 m.
const IES: &str = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 5 3 1 2 0.1 0.2 0\n1 1 20\n0 30 60 90 120\n0 90 180\n\
                   1000 700 300 50 20\n1000 900 500 80 20\n1000 800 100 10 20\n";

/// A floor 4 m below the luminaire.
fn scene(folder: &std::path::Path) -> Scene {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("written");
    write("floor.obj", FLOOR);
    write("lamp.ies", IES);
    write("lights.toml", "[[luminaire]]\nfile = \"lamp.ies\"\nat = [0, 0, 4]\naim = [0, 0, -1]\n");
    let luminaires = read_placements(&folder.join("lights.toml")).expect("placements");
    let options = LoadOptions { luminaires, ..LoadOptions::default() };
    Scene::load_with(folder.join("floor.obj"), &options).expect("a scene")
}

/// Candelas of the table of `IES`, in its own half-planes.
fn candelas(c: usize, gamma: f64) -> f64 {
    let row = [[1000.0, 700.0, 300.0, 50.0], [1000.0, 900.0, 500.0, 80.0], [1000.0, 800.0, 100.0, 10.0]][c];
    let (i, part) = ((gamma / 30.0) as usize, gamma / 30.0 % 1.0);
    row[i] + part * (row[i + 1] - row[i])
}

#[test]
fn light_below_a_luminaire_is_that_of_its_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene(folder.path());
    // C = 0 is +x, C = 90 is +y seen from behind the luminaire.
    let places = [
        (0, dvec3(0.0, 0.0, 0.0)),
        (0, dvec3(2.0, 0.0, 0.0)),
        (1, dvec3(0.0, 2.5, 0.0)),
        (2, dvec3(-2.0, 0.0, 0.0)),
    ];
    let points: Vec<Point> =
        places.iter().map(|&(_, position)| Point { position, normal: DVec3::Z }).collect();
    let want: Vec<f64> = places
        .iter()
        .map(|&(c, p)| {
            let d2 = p.distance_squared(dvec3(0.0, 0.0, 4.0));
            let cosine = 4.0 / d2.sqrt();
            candelas(c, cosine.acos().to_degrees()) * cosine / d2 / 179.0
        })
        .collect();
    let model =
        Model::prepare(scene.clone(), &PrepareOptions { detail: Detail::Rays, ..Default::default() }, &())
            .expect("a model");
    let settings = Settings { samples: 1024, direct_only: false, seed: 1 };
    let reference = irradiance(&model, &points, settings, &|_| ()).expect("reference");
    let options = radiosity::Options { seed: 1, ..Default::default() };
    let model = Model::prepare(scene, &options.prepare(), &()).expect("a model");
    let solved = radiosity::run(&model, &points, &options, &()).expect("solved");
    for (i, want) in want.iter().enumerate() {
        let (r, s) = (reference.values[i][1], solved.irradiance[i][1]);
        // The opening is 1/20 of the distance: the kink of a table in steps of 30 degrees is smoothed by about 1 %.
        assert!((r / want - 1.0).abs() < 0.015, "reference {i}: {r} instead of {want}");
        assert!((s / want - 1.0).abs() < 0.015, "solved {i}: {s} instead of {want}");
        assert!((s / r - 1.0).abs() < 0.005, "solved {s}, reference {r}");
    }
    // Elements: the flux onto the floor, against the closed form summed over it.
    let n = 60;
    let cell = 6.0 / f64::from(n);
    let table = crate::scene::profile::Distribution::new(
        &[0.0, 90.0, 180.0],
        &[0.0, 30.0, 60.0, 90.0],
        &[0, 1, 2].map(|c| [0.0, 30.0, 60.0, 89.999].map(|g| candelas(c, g)).to_vec()),
        crate::scene::profile::Symmetry::C0C180,
    )
    .expect("a table");
    let mut flux = 0.0;
    for i in 0..n * n {
        let p = dvec3((f64::from(i % n) + 0.5) * cell - 3.0, (f64::from(i / n) + 0.5) * cell - 3.0, -4.0);
        let cosine = 4.0 / p.length();
        flux += table.intensity(cosine.acos(), p.y.atan2(p.x)) * cosine / p.length_squared() * cell * cell
            / 179.0;
    }
    let onto: f64 = solved
        .mesh
        .elements
        .iter()
        .filter(|e| e.exitance == [0.0; 3] && e.front)
        .map(|e| e.irradiance[1] * e.area)
        .sum();
    assert!((onto / flux - 1.0).abs() < 0.01, "{onto} W onto the floor instead of {flux}");
}

#[test]
fn placed_luminaires_have_the_flux_of_their_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let s = scene(folder.path());
    let table = crate::scene::read_luminaire::read(&folder.path().join("lamp.ies")).expect("a luminaire");
    let lumens: f64 = s.emitters.iter().map(|e| 179.0 * s.power(e)[0]).sum();
    assert_eq!(s.emitters.len(), 2, "downwards and upwards");
    assert!((lumens / table.distribution.halves().iter().sum::<f64>() - 1.0).abs() < 1e-4);
    let toml = folder.path().join("lights.toml");
    std::fs::write(&toml, "[[luminaire]]\nfile = \"lamp.ies\"\nat = 3\n").expect("written");
    assert!(read_placements(&toml).expect_err("wrong").to_string().contains("lights.toml:3"));
}

#[test]
fn up_follows_the_bounds_and_the_option() {
    let load = |obj: &str, up| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.obj");
        std::fs::write(&path, obj).expect("written");
        Scene::load_with(&path, &LoadOptions { up, ..LoadOptions::default() }).expect("a scene").up_axis()
    };
    assert_eq!(load(FLOOR, None), UpAxis::Z);
    assert_eq!(load("v 0 0 0\nv 0 0 9\nv 9 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 4\n", None), UpAxis::Y);
    assert_eq!(load(FLOOR, Some(UpAxis::Y)), UpAxis::Y);
}

#[test]
fn punctual_lights_of_gltf() {
    let folder = tempfile::tempdir().expect("a folder");
    let positions: [f32; 9] = [-9.0, 0.0, 9.0, 9.0, 0.0, 9.0, 0.0, 0.0, -9.0];
    std::fs::write(folder.path().join("b.bin"), bytemuck::cast_slice::<f32, u8>(&positions))
        .expect("written");
    let value = |light: &str, place: &str| {
        let json = format!(
            r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["KHR_lights_punctual"],
            "extensions":{{"KHR_lights_punctual":{{"lights":[{light}]}}}},"scene":0,"scenes":[{{"nodes":[0,1]}}],
            "nodes":[{{"mesh":0}},{{{place},"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[-9,0,-9],"max":[9,0,9]}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}}],"buffers":[{{"uri":"b.bin","byteLength":36}}]}}"#
        );
        let path = folder.path().join("a.gltf");
        std::fs::write(&path, json).expect("written");
        let scene = Scene::load(&path).expect("a scene");
        assert_eq!(scene.repairs.punctual_lights, 1);
        let model =
            Model::prepare(scene, &PrepareOptions { detail: Detail::Rays, ..Default::default() }, &())
                .expect("a model");
        let points = [DVec3::ZERO, dvec3(2.0, 0.0, 0.0)].map(|position| Point { position, normal: DVec3::Y });
        let settings = Settings { samples: 256, direct_only: true, seed: 1 };
        irradiance(&model, &points, settings, &|_| ())
            .expect("reference")
            .values
            .iter()
            .map(|v| v[0] * 179.0)
            .collect::<Vec<f64>>()
    };
    // The node turns −z to −y; 2 m above the floor.
    let place = r#""translation":[0,2,0],"rotation":[-0.70710678,0,0,0.70710678]"#;
    let near = |found: f64, want: f64, limit: f64| {
        assert!((found - want).abs() < limit * want, "{found} instead of {want}")
    };
    let point = value(r#"{"type":"point","intensity":400,"color":[1,0.5,0]}"#, place);
    near(point[0], 100.0, 0.01);
    near(point[1], 400.0 * 2.0 / 8f64.powf(1.5), 0.01);
    let spot =
        value(r#"{"type":"spot","intensity":400,"spot":{"innerConeAngle":0.2,"outerConeAngle":0.5}}"#, place);
    near(spot[0], 100.0, 0.01);
    assert!(spot[1] == 0.0, "45 degrees are outside of the cone");
    let sun = value(r#"{"type":"directional","intensity":5000}"#, place);
    near(sun[0], 5000.0, 0.05);
    near(sun[1], 5000.0, 0.05);
}
