//! Luminaires with photometric files and lights of glTF: light at a distance is I cos θ / d².

use super::*;
use crate::model::{Detail, Model, testing::model};
use crate::path_tracer::{Settings, irradiance};
use crate::points::{Irradiance, Point};
use crate::radiosity;
use crate::scene::{UpAxis, read_added, read_placements};
use crate::terrain::ReadOptions;
use glam::{DVec3, dvec3};
use std::path::PathBuf;

const FLOOR: &str = "v -3 -3 0\nv 3 -3 0\nv 3 3 0\nv -3 3 0\nf 1 2 3 4\n";
/// Bilateral symmetry, with light upwards; 0.1 m × 0.2 m.
const IES: &str = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 5 3 1 2 0.1 0.2 0\n1 1 20\n0 30 60 90 120\n0 90 180\n\
                   1000 700 300 50 20\n1000 900 500 80 20\n1000 800 100 10 20\n";

/// A floor 4 m below the luminaire.
fn scene(folder: &std::path::Path) -> Scene {
    scene_of(folder, IES)
}

/// The same with another photometric file.
fn scene_of(folder: &std::path::Path, ies: &str) -> Scene {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("written");
    write("floor.obj", FLOOR);
    write("lamp.ies", ies);
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

/// Irradiance at points by path tracing, and the solution of the scene with its values there.
fn reference_and_solution(scene: &Scene, points: &[Point]) -> (Irradiance, radiosity::Outcome) {
    let settings = Settings { samples: 1024, direct_only: false, seed: 1 };
    let reference = irradiance(&model(scene, Detail::Rays), points, settings, &()).expect("reference");
    let options = radiosity::Options { audit: 0, local_rays: Some(350_000), ..Default::default() };
    let model = Model::prepare(scene.clone(), &options.prepare()).expect("a model");
    let solved = radiosity::run(&model, points, &options, &()).expect("solved");
    (reference, solved)
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
    let (reference, solved) = reference_and_solution(&scene, &points);
    for (i, want) in want.iter().enumerate() {
        let (r, s) = (reference.values[i][1], solved.irradiance[i][1]);
        // The opening is 1/20 of the distance: the kink of a table in steps of 30 degrees is smoothed by about 1 %.
        assert!((r / want - 1.0).abs() < 0.015, "reference {i}: {r} instead of {want}");
        assert!((s / want - 1.0).abs() < 0.015, "solved {i}: {s} instead of {want}");
        assert!((s / r - 1.0).abs() < 0.005, "solved {s}, reference {r}");
    }
    let table = crate::scene::read_luminaire::read(&folder.path().join("lamp.ies")).expect("a luminaire");
    let lumens: f64 = scene.emitters.iter().map(|e| 179.0 * scene.power(e)[0]).sum();
    assert_eq!(scene.emitters.len(), 2, "downwards and upwards");
    assert!((lumens / table.distribution.halves().iter().sum::<f64>() - 1.0).abs() < 1e-4);
}

#[test]
fn wrong_luminaires_name_file_and_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    write("lamp.ies", IES);
    write("bad.ies", &IES.replace("1000 900", "1000 -900"));
    write("dark.ies", &IES.replace("1 -1 1 5", "1 -1 0 5"));
    write("short.ldt", "a\n1\n1\n1\n0\n");
    let good = ["file = \"lamp.ies\"", "at = [0, 0, 4]", "aim = [0, 0, -1]"];
    for (line, instead, want) in [
        (0, "file = \"bad.ies\"", "bad.ies:8: an intensity of -900 cd"),
        (0, "file = \"short.ldt\"", "short.ldt:5: the file ends before line 6"),
        (0, "file = \"dark.ies\"", "lights.toml:2: the table of this file sums to no light"),
        (0, "file = \"none.ies\"", "none.ies: "),
        (0, "file = \"lights.toml\"", "lights.toml: the extension must be"),
        (1, "at = 3", "lights.toml:3: "),
        (1, "at = [0, nan, 4]", "lights.toml:3: `at`"),
        (2, "aim = [0, 0, 0]", "lights.toml:4: `aim`"),
        (2, "aim = [0, 0, -1]\nc0 = [0, 0, 1]", "lights.toml:4: `aim`"),
        (2, "aim = [0, 0, -1]\nflux = -3", "lights.toml:5: `flux`"),
        (2, "aim = [0, 0, -1]\ndimming = 0", "lights.toml:5: `dimming` must be above 0 and at most 1"),
        (2, "aim = [0, 0, -1]\n\nmaintenance = 1.01", "lights.toml:6: `maintenance` must be above 0"),
        (2, "aim = [0, 0, -1]\nmaintenance = nan", "lights.toml:5: `maintenance`"),
        (2, "aim = [0, 0, -1]\ncolour = 1", "lights.toml:5: "),
        (2, "", "lights.toml:1: missing field `aim`"),
    ] {
        let mut lines = good;
        lines[line] = instead;
        write("lights.toml", &format!("[[luminaire]]\n{}\n", lines.join("\n")));
        let found = read_placements(&folder.path().join("lights.toml")).expect_err(instead).to_string();
        assert!(found.contains(want), "{instead}: {found}");
    }
}

#[test]
fn up_follows_the_light_the_bounds_and_the_option() {
    let load = |obj: &str, up| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.obj");
        std::fs::write(folder.path().join("a.mtl"), "newmtl light\nKe 1 1 1\n").expect("written");
        std::fs::write(&path, obj).expect("written");
        Scene::load_with(&path, &LoadOptions { up, ..LoadOptions::default() }).expect("a scene").up_axis()
    };
    let tower = "mtllib a.mtl\nv 0 0 0\nv 0 0 9\nv 9 0 0\nv 0 1 0\nv 1 0 9\nv 0 1 9\nf 1 2 3\nf 1 2 4\n";
    assert_eq!(load(FLOOR, None), UpAxis::Z);
    assert_eq!(load(tower, None), UpAxis::Y);
    // A light at its top that shines down z; then one that shines up.
    assert_eq!(load(&format!("{tower}usemtl light\nf 2 6 5\n"), None), UpAxis::Z);
    assert_eq!(load(&format!("{tower}usemtl light\nf 2 5 6\n"), None), UpAxis::Y);
    assert_eq!(load(FLOOR, Some(UpAxis::Y)), UpAxis::Y);
}

/// The fluxes of all emitters that state them are one sum.
#[test]
fn emitters_in_scenes_of_millimetres_are_questioned() {
    let note_in = |unit: &str, size: f64, strengths: [Strength; 2]| {
        let square = |z: f64| format!("v 0 0 {z}\nv {size} 0 {z}\nv {size} {size} {z}\nv 0 {size} {z}\n");
        let faces = "o floor\nf 1 2 3 4\no window 1\nf 5 6 7 8\no window 2\nf 9 10 11 12\n";
        let obj = square(0.0) + &square(0.5 * size) + &square(size) + faces;
        let names = ["window 1", "window 2"].map(String::from);
        let emitters = names.into_iter().zip(strengths).collect();
        let unit = unit.into();
        let scene = load_with(&obj, &[], &LoadOptions { emitters, unit, ..LoadOptions::default() });
        let notes = scene.expect("a scene").repairs.messages.clone();
        notes.into_iter().filter(|note| note.contains("is the file in")).collect::<Vec<_>>()
    };
    let note = |size, strengths| note_in("m", size, strengths);
    let [bright, dim, watts] = [Strength::Lumens(3000.0), Strength::Lumens(2000.0), Strength::Watts(1.0)];
    let found = note(5000.0, [bright, dim]);
    let want = "2 emitters of 5000 lm in total in a scene of 5000 m x 5000 m, 2.0e-4 lx: is the file in millimetres?";
    assert!(found.len() == 1 && found[0].starts_with(want) && found[0].contains("to mm"), "{found:?}");
    assert_eq!(note(5000.0, [bright, watts]).len(), 1);
    // 179 lm for each watt.
    let found = note(5000.0, [watts, watts]);
    assert!(found.len() == 1 && found[0].starts_with("2 emitters of 358 lm"), "{found:?}");
    assert!(note(5.0, [bright, dim]).is_empty() && note(5.0, [watts, watts]).is_empty());
    // Metres that are read as millimetres, a room in millimetres, and one in inches.
    let found = note_in("mm", 5.0, [bright, dim]);
    let want =
        "2 emitters of 5000 lm in total in a scene of 5.0 mm x 5.0 mm, 2.0e8 lx: is the file in metres?";
    assert!(found.len() == 1 && found[0].starts_with(want), "{found:?}");
    assert!(
        note_in("mm", 5000.0, [bright, dim]).is_empty() && note_in("in", 200.0, [bright, dim]).is_empty()
    );
}

#[test]
fn punctual_lights_of_gltf() {
    let folder = tempfile::tempdir().expect("a folder");
    let positions: [f32; 9] = [-9.0, 0.0, 9.0, 9.0, 0.0, 9.0, 0.0, 0.0, -9.0];
    std::fs::write(folder.path().join("b.bin"), bytemuck::cast_slice::<f32, u8>(&positions))
        .expect("written");
    let far = folder.path().join("far.obj");
    std::fs::write(&far, "v -1e4 -50 1e4\nv 1e4 -50 1e4\nv 0 -50 -1e4\nf 1 2 3\n").expect("written");
    let value_with = |added: &[PathBuf], light: &str, place: &str| {
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
        let files = read_added(added, &ReadOptions::default(), None).expect("surfaces");
        let options = LoadOptions { added: files, ..LoadOptions::default() };
        let scene = Scene::load_with(&path, &options).expect("a scene");
        // Lengths are relative to the floor, not to the distance of the sun.
        assert!(!added.is_empty() || scene.size() < 26.0, "{}", scene.size());
        let notes = &scene.repairs.messages;
        assert!(notes.iter().any(|m| m.contains("1 light of KHR_lights_punctual made into")), "{notes:?}");
        let model = model(&scene, Detail::Rays);
        let points = [DVec3::ZERO, dvec3(2.0, 0.0, 0.0)].map(|position| Point { position, normal: DVec3::Y });
        let settings = Settings { samples: 256, direct_only: true, seed: 1 };
        irradiance(&model, &points, settings, &())
            .expect("reference")
            .values
            .iter()
            .map(|v| v[0] * 179.0)
            .collect::<Vec<f64>>()
    };
    let value = |light: &str, place: &str| value_with(&[], light, place);
    // The node turns −z to −y; 2 m above the floor.
    let place = r#""translation":[0,2,0],"rotation":[-0.70710678,0,0,0.70710678]"#;
    let near = |found: f64, want: f64, limit: f64| {
        assert!((found - want).abs() < limit * want, "{found} instead of {want}")
    };
    let point = value(r#"{"type":"point","intensity":400,"color":[1,0.5,0]}"#, place);
    near(point[0], 100.0, 0.01);
    near(point[1], 400.0 * 2.0 / 8f64.powf(1.5), 0.01);
    // Nor does what lies far away.
    let above_far = value_with(&[far], r#"{"type":"point","intensity":400}"#, place);
    // Its two plates are 7 cm apart in a scene of 28 km.
    near(above_far[0], 100.0, 0.05);
    near(above_far[1], 400.0 * 2.0 / 8f64.powf(1.5), 0.05);
    // The orientation of its node does not matter.
    for place in [r#""translation":[0,2,0]"#, r#""translation":[0,2,0],"rotation":[0,0.6,0,0.8]"#] {
        near(value(r#"{"type":"point","intensity":400}"#, place)[0], 100.0, 0.01);
    }
    let spot =
        value(r#"{"type":"spot","intensity":400,"spot":{"innerConeAngle":0.2,"outerConeAngle":0.5}}"#, place);
    near(spot[0], 100.0, 0.01);
    assert!(spot[1] == 0.0, "45 degrees are outside of the cone");
    // A hard edge is the limit of gradual ones.
    let hard =
        value(r#"{"type":"spot","intensity":400,"spot":{"innerConeAngle":0.5,"outerConeAngle":0.5}}"#, place);
    near(hard[0], 100.0, 0.01);
    assert!(hard[1] == 0.0, "45 degrees are outside of the cone");
    assert!(
        Scene::load(folder.path().join("a.gltf"))
            .expect("a scene")
            .repairs
            .messages
            .iter()
            .any(|m| { m.contains("1 spot light with an inner cone angle that is not below the outer one") })
    );
    let sun = value(r#"{"type":"directional","intensity":5000}"#, place);
    near(sun[0], 5000.0, 0.001);
    near(sun[1], 5000.0, 0.001);
}

/// A grey room of 4 m × 4 m × 3 m with a downlight of I = I(0) cos⁸ γ below its ceiling.
#[test]
fn light_in_a_room_with_a_downlight_is_that_of_the_reference() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    write("grey.mtl", "newmtl grey\nKd 0.6 0.6 0.6\n");
    write(
        "room.obj",
        "mtllib grey.mtl\nusemtl grey\nv 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nv 0 0 3\nv 4 0 3\nv 4 4 3\nv 0 4 3\n\
         f 1 2 3 4\nf 8 7 6 5\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n",
    );
    let list = |of: fn(f64) -> f64| (0..=36).map(move |k| format!("{}", of(2.5 * f64::from(k))));
    let gammas: Vec<String> = list(|g| g).collect();
    let candelas: Vec<String> = list(|g| 900.0 * g.to_radians().cos().max(0.0).powi(8)).collect();
    write(
        "down.ies",
        &format!(
            "IESNA:LM-63-1995\nTILT=NONE\n1 -1 1 37 1 1 2 -0.15 0 0\n1 1 9\n{}\n0\n{}\n",
            gammas.join(" "),
            candelas.join("\n")
        ),
    );
    write("lights.toml", "[[luminaire]]\nfile = \"down.ies\"\nat = [1.5, 2, 2.9]\naim = [0, 0, -1]\n");
    let luminaires = read_placements(&folder.path().join("lights.toml")).expect("placements");
    let scene = Scene::load_with(
        folder.path().join("room.obj"),
        &LoadOptions { luminaires, ..LoadOptions::default() },
    )
    .expect("a scene");
    // The flux of I(0) cos⁸ γ is 2π I(0) / 9.
    let lumens: f64 = scene.emitters.iter().map(|e| 179.0 * scene.power(e)[0]).sum();
    assert!((lumens / (200.0 * std::f64::consts::PI) - 1.0).abs() < 0.01, "{lumens} lm");
    let grid = |k: usize| 0.125 + 0.25 * k as f64;
    let points: Vec<Point> = (0..256)
        .map(|k| Point { position: dvec3(grid(k % 16), grid(k / 16), 0.0), normal: DVec3::Z })
        .collect();
    let (reference, solved) = reference_and_solution(&scene, &points);
    let mean = |values: &[[f64; 3]]| values.iter().map(|v| v[1]).sum::<f64>() / values.len() as f64;
    let (want, found) = (mean(&reference.values), mean(&solved.irradiance));
    assert!((found / want - 1.0).abs() < 0.01, "points: {found} instead of {want}");
    let squares: f64 =
        reference.values.iter().zip(&solved.irradiance).map(|(r, s)| (r[1] - s[1]).powi(2)).sum();
    let rms = (squares / 256.0).sqrt();
    assert!(rms < 0.03 * want, "points: RMS difference {rms} of {want}");
    let floor = solved.mesh.elements.iter().filter(|e| {
        e.front
            && e.corners
                .iter()
                .all(|&v| (solved.mesh.origin.z + f64::from(solved.mesh.vertices[v as usize].z)).abs() < 1e-5)
    });
    let (light, area) = floor.fold((0.0, 0.0), |(l, a), e| (l + e.area * e.irradiance[1], a + e.area));
    assert!((area - 16.0).abs() < 1e-3, "{area} m²");
    // A grid of points 0.25 m apart sums a smooth beam of 2 m exactly to about 1 %.
    assert!((light / area / want - 1.0).abs() < 0.02, "elements: {} instead of {want}", light / area);
    let ledger = &solved.record.ledger;
    assert!((179.0 * ledger.emitted / lumens - 1.0).abs() < 1e-6, "{}", ledger.emitted);
}

/// Two beams, one of 27° that lights nothing but the floor and one that passes it: the ledger sends light where the beams do.
#[test]
fn ledgers_send_directed_light_where_it_goes() {
    let folder = tempfile::tempdir().expect("a folder");
    let beam = |gammas: &str| {
        let candelas = if gammas.starts_with('0') { "100 100 0" } else { "0 100 0" };
        let ies = format!(
            "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 3 1 1 2 0.1 0.2 0\n1 1 20\n{gammas}\n0\n{candelas}\n"
        );
        let solved = reference_and_solution(&scene_of(folder.path(), &ies), &[]).1;
        assert!(
            solved.record.local_convergence.is_some(),
            "no local pass: links take the emission as diffuse"
        );
        solved.record.ledger
    };
    // Escaped, absorbed and created, as fractions of the emitted power.
    for (gammas, want) in [("0 26 27", [0.5, 0.5, 0.0]), ("70 75 80", [1.0, 0.0, 0.0])] {
        let ledger = beam(gammas);
        for (found, want) in [ledger.escaped, ledger.absorbed, ledger.created].into_iter().zip(want) {
            assert!((found / ledger.emitted - want).abs() < 0.02, "{gammas}: {ledger:?}");
        }
    }
}
