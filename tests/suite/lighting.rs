//! What lighting engineers ask of `solve` and `info`: grids, surfaces, luminaires, upward axis, pictures.

use crate::hostile::refused;
use crate::run::Scratch;

/// A floor of 4 x 2 m, a lamp of 1 x 1 m that faces it 2 m above its middle, and a bowl beside them.
const HALL: &str = "mtllib hall.mtl\nusemtl grey\no floor\nv 0 0 0\nv 4 0 0\nv 4 2 0\nv 0 2 0\nf 1 2 3 4\n\
    o bowl\nv 5 0 0\nv 6 0 .5\nv 6 1 1\nv 5 1 .5\nv 7 0 2\nf 5 6 7 8\nf 6 9 7\n\
    usemtl glow\no lamp\nv 1.5 .5 2\nv 1.5 1.5 2\nv 2.5 1.5 2\nv 2.5 .5 2\nf 10 11 12 13\n";
const GLOW: &str = "newmtl grey\nKd 0.4 0.5 0.3\nnewmtl glow\nKd 0 0 0\nKe 10 10 10\n";

fn hall() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("hall.obj", HALL);
    scratch.write("hall.mtl", GLOW);
    scratch
}

#[test]
fn a_grid_of_points_needs_no_file() {
    let scratch = hall();
    scratch.write("points.csv", "x,y,z,nx,ny,nz\n1,1,0,0,0,1\n");
    let solve = "solve hall.obj --out s --direct-only --photometric --points points.csv --grid floor:1";
    scratch
        .mrvis(&format!("{solve} --grid bowl:0.5:0.8"))
        .exits(2)
        .warns("--grid `bowl`: the surface is curved")
        .warns("--points");
    let solved = scratch.mrvis(&format!("{solve} --grid floor:0.5:0.8")).exits(0);
    // Points of a grid above its surface are meant to be there; the point of the file is on the floor.
    assert!(!solved.stdout.contains("from every surface"), "{}", solved.stdout);
    // The point of the file comes first, then both grids from their lower left corners.
    let found = scratch.rows("s/irradiance.csv");
    assert_eq!(found.len(), 1 + 8 + 32);
    assert_eq!((&found[0][..6], &found[1][..3]), (&[1.0, 1.0, 0.0, 0.0, 0.0, 1.0][..], &[0.5, 0.5, 0.0][..]));
    assert!((found[9][2] - 0.8).abs() < 1e-6 && (found[9][0] - 0.25).abs() < 1e-6, "{:?}", found[9]);
    let record = scratch.json("s/solution.json");
    let grid = &record["grids"][1];
    assert!(grid["name"] == "floor" && grid["columns"] == 8 && grid["rows"] == 4, "{grid}");
    assert!(grid["spacing"] == 0.5 && grid["height"] == 0.8 && grid["unit"] == "lx", "{grid}");
    let lux: Vec<f64> = found[9..].iter().map(|row| row[9]).collect();
    let mean = lux.iter().sum::<f64>() / 32.0;
    let [stated, minimum, uniformity] =
        ["mean", "minimum", "uniformity"].map(|key| grid[key].as_f64().expect("a number"));
    assert!((stated / mean - 1.0).abs() < 1e-9 && (minimum / mean / uniformity - 1.0).abs() < 1e-9, "{grid}");
    assert!(record["at_points"]["count"] == 1 && record["grids"][0]["count"] == 8);
    for words in [
        "grid `floor` of 8 x 4, 0.8 m above it: 32 points: minimum",
        "uniformity U0",
        "grid-floor-2.png",
        "\nestimated error at all points ",
    ] {
        assert!(solved.stdout.contains(words), "{words}: {}", solved.stdout);
    }
    for name in ["s/grid-floor.png", "s/grid-floor-2.png"] {
        assert!(std::fs::read(scratch.path(name)).expect(name).starts_with(b"\x89PNG"), "{name}");
    }
    for (grid, words) in [
        ("flor:1", "did you mean `floor`?"),
        ("floor:0", "above 0"),
        ("floor", "SURFACE:SPACING"),
        ("floor:0.0001", "widen the spacing"),
    ] {
        refused(&scratch.mrvis(&format!("solve hall.obj --out s --grid {grid}")), words);
    }
}

#[test]
fn the_light_of_each_surface_is_stated() {
    let scratch = hall();
    let shown = "--photometric --output page --image-size 32x24";
    scratch.mrvis(&format!("solve hall.obj --out s {shown} --audit 0 --error 0.2")).exits(0);
    let surfaces = &scratch.json("s/solution.json")["surfaces"];
    let floor = &surfaces[0];
    assert!(floor["name"] == "floor" && floor["side"] == "front" && floor["unit"] == "lx", "{surfaces}");
    let [area, minimum, mean, maximum] =
        ["area", "minimum", "mean", "maximum"].map(|key| floor[key].as_f64().expect("a number"));
    assert!((area - 8.0).abs() < 1e-4 && 0.0 < minimum && minimum < mean && mean < maximum, "{floor}");
    let is_dark_back = |s: &serde_json::Value| s["side"] == "back" && s["maximum"] == 0.0;
    assert!(!surfaces.as_array().expect("a list").iter().any(is_dark_back), "{surfaces}");
    let page = scratch.text("s/solution.html");
    for words in ["Light by surface", ">floor</td>", "mean lx", "area m²"] {
        assert!(page.contains(words), "{words}");
    }
    // Points alone need no elements, whose light would be none.
    scratch.mrvis("solve hall.obj --out p --grid floor:1 --audit 0").exits(0);
    assert!(scratch.json("p/solution.json")["surfaces"].is_null());
}

#[test]
fn reflectances_of_materials_are_listed() {
    let scratch = hall();
    scratch.mrvis("info hall.obj --json i.json").prints("0.400  0.400 0.500 0.300  grey");
    let grey = &scratch.json("i.json")["materials"][0];
    let mean = grey["mean_reflectance"].as_f64().expect("a number");
    assert!(grey["name"] == "grey" && (mean - 0.4).abs() < 1e-6, "{grey}");
}

#[test]
fn luminaires_are_dimmed_and_age() {
    let scratch = hall();
    scratch.write("lamp.ies", "TILT=NONE\n1 -1 1 2 1 1 2 0.1 0.1 0\n1 1 20\n0 90\n0\n100 100\n");
    let lamp = "[[luminaire]]\nfile = \"lamp.ies\"\nat = [2, 1, 1]\naim = [0, 0, -1]\n";
    scratch
        .write("lum.toml", format!("{lamp}{}dimming = 0.5\nmaintenance = 0.8\n", lamp.replace("[2,", "[3,")));
    let info = scratch.mrvis("info hall.obj --luminaires lum.toml --photometric --json i.json").exits(0);
    let words = "dimming 0.5 and maintenance factor 0.8 included";
    assert_eq!(info.stdout.matches(words).count(), 1, "{}", info.stdout);
    let emitters = &scratch.json("i.json")["emitters"];
    let flux = |k: usize| emitters[k]["flux_lm"].as_f64().expect("a flux");
    assert!((flux(2) / flux(1) - 0.4).abs() < 1e-6, "{emitters}");
    assert!(
        emitters[2]["dimming"] == 0.5 && emitters[2]["maintenance"] == 0.8 && emitters[1]["dimming"] == 1.0
    );
    assert!(emitters[0]["dimming"].is_null(), "a panel of the scene is no luminaire");
}

/// The light at elements close to a luminaire comes from rays: the quadrature of its directions there would take minutes.
#[test]
fn luminaires_close_to_a_surface_are_solved_in_seconds() {
    let scratch = hall();
    scratch.write("lamp.ies", "TILT=NONE\n1 -1 1 3 1 1 2 0.6 1.2 0\n1 1 20\n0 60 90\n0\n900 500 100\n");
    scratch.write("lum.toml", "[[luminaire]]\nfile = \"lamp.ies\"\nat = [2, 1, 0.02]\naim = [0, 0, -1]\n");
    let options = "--luminaires lum.toml --error 0.1 --audit 0 --output none --out s";
    scratch.mrvis(&format!("solve hall.obj {options}")).exits(0);
    let ledger = &scratch.json("s/solution.json")["ledger"];
    let [emitted, created] = ["emitted", "created"].map(|key| ledger[key].as_f64().expect("a power"));
    assert!(created.abs() < 0.005 * emitted, "{ledger}");
}

#[test]
fn the_upward_axis_says_where_it_is_from() {
    let scratch = hall();
    let up = |more: &str| {
        scratch
            .mrvis(&format!("solve hall.obj --out s --grid floor:2 --direct-only --quiet {more}"))
            .exits(0);
        let record = scratch.json("s/solution.json");
        format!("{} {}", record["scene"]["up"], record["scene"]["up_from"]).replace('"', "")
    };
    assert_eq!(up(""), "z guessed from the direction of most light");
    assert_eq!(up("--up y"), "y given");
    assert_eq!(up("--emitter lamp=0"), "z guessed from the extents");
    scratch
        .mrvis("info hall.obj --emitter lamp=0 --json i.json")
        .prints("up          z (guessed from the extents)");
    assert_eq!(scratch.json("i.json")["scene"]["up_from"], "guessed from the extents");
    scratch
        .mrvis("solve hall.obj --out s --grid floor:2 --direct-only")
        .prints("z up (guessed from the direction of most light; --up");
}

#[test]
fn rooms_in_millimetres_are_questioned() {
    let scratch = Scratch::new();
    scratch.write("lamp.ies", "TILT=NONE\n1 -1 1 2 1 1 2 0.1 0.1 0\n1 1 20\n0 90\n0\n900 900\n");
    scratch.write("lum.toml", "[[luminaire]]\nfile = \"lamp.ies\"\nat = [1, 1, 2]\naim = [0, 0, -1]\n");
    let shown = |size: f64, more: &str| {
        let corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1]];
        let lines = corners.map(|corner| {
            let [x, y, z] = corner.map(|c| size * f64::from(c));
            format!("v {x} {y} {z}\n")
        });
        scratch.write("room.obj", lines.concat() + "f 1 2 3 4\nf 1 5 6 2\n");
        scratch.mrvis(&format!("info room.obj {more}")).stdout
    };
    let room = |size| shown(size, "--luminaires lum.toml");
    assert!(room(3000.0).contains("is the file in millimetres? set --unit to mm"), "{}", room(3000.0));
    // A room of 3 m, and a hall of 100 m.
    assert!(!room(3.0).contains("millimetres") && !room(100.0).contains("millimetres"));
    let watts = shown(3000.0, "--emitter room=60W");
    assert!(watts.contains("is the file in millimetres?"), "{watts}");
    // Who then forgets to state the positions of luminaires in millimetres is asked.
    let converted = shown(3000.0, "--luminaires lum.toml --unit mm");
    assert!(converted.contains("are they stated in metres?"), "{converted}");
}

/// A pixel that a lamp touches is not as bright as the lamp.
#[test]
fn edges_of_bright_faces_are_smooth() {
    let scratch = hall();
    let solve = "solve hall.obj --out s --output image --image-size 160x120 --audit 0 --error 0.2";
    scratch.mrvis(&format!("{solve} --camera 0,-5,1.2,2,1,1,50")).exits(0);
    let picture = image::open(scratch.path("s/view.png")).expect("a picture").to_luma8();
    // The lamp is above the middle, before nothing.
    let lamp: Vec<u8> = picture.enumerate_pixels().filter(|(_, y, _)| *y < 60).map(|(.., p)| p[0]).collect();
    let count = |range: std::ops::RangeInclusive<u8>| lamp.iter().filter(|v| range.contains(v)).count();
    assert!(count(250..=255) > 20, "the lamp is seen");
    assert!(count(30..=210) > 10, "{} pixels between black and white", count(30..=210));
}

#[test]
fn a_camera_that_sees_nothing_says_so() {
    let scratch = hall();
    let shown = "--output image --image-size 16x12 --audit 0 --error 0.2";
    let solve = |camera: &str| scratch.mrvis(&format!("solve hall.obj --out s {shown} --camera {camera}"));
    let away = solve("2,-5,1,2,-9,1,50").exits(0);
    let words = "view.png, of a camera at 2, -5, 1, is black (closed rooms are black from outside; --look-inside shows what is in \
                 them): the scene reaches from 0, 0, 0 to 7, 2, 2; give --camera";
    away.prints(words);
    assert!(scratch.json("s/solution.json")["warnings"].to_string().contains(words));
    assert!(!solve("2,-5,1,2,1,1,50").stdout.contains("is black"));
}

/// A floor of 8 by 8 that a lamp lights, with the third coordinate up, or with the second.
fn scene(scratch: &Scratch, up: &str) {
    let vertex = |[x, y, z]: [f64; 3]| match up {
        "z" => format!("v {x} {y} {z}\n"),
        _ => format!("v {x} {z} {}\n", -y),
    };
    let floor = [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0], [8.0, 8.0, 0.0], [0.0, 8.0, 0.0]].map(vertex).concat();
    let lamp = [[4.0, 4.0, 3.0], [4.0, 5.0, 3.0], [5.0, 4.0, 3.0]].map(vertex).concat();
    scratch.write("s.mtl", "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl light\nKd 0 0 0\nKe 10 10 10\n");
    scratch.write(
        "s.obj",
        format!(
            "mtllib s.mtl\no floor\nusemtl grey\n{floor}f 1 2 3 4\no lamp\nusemtl light\n{lamp}f 5 6 7\n"
        ),
    );
}

fn solve(scratch: &Scratch, up: &str, output: &str) {
    scratch
        .mrvis(&format!("solve s.obj --up {up} --out o --audit 0 --max-seconds 5 --output {output}"))
        .exits(0);
}

/// glTF is y-up: the node of the GLB turns the scene so that its lamp is 3 above its floor.
#[test]
fn meshes_stand_upright_in_gltf() {
    for up in ["y", "z"] {
        let scratch = Scratch::new();
        scene(&scratch, up);
        solve(&scratch, up, "glb");
        let bytes = std::fs::read(scratch.path("o/solution.glb")).expect("a GLB");
        let length = u32::from_le_bytes(bytes[12..16].try_into().expect("a length")) as usize;
        let root: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
        let numbers = |value: &serde_json::Value| -> Vec<f32> {
            value.as_array().map_or(Vec::new(), |list| {
                list.iter().map(|v| v.as_f64().expect("a number") as f32).collect()
            })
        };
        let rotation = match numbers(&root["nodes"][0]["rotation"])[..] {
            [x, y, z, w] => glam::Quat::from_xyzw(x, y, z, w),
            _ => glam::Quat::IDENTITY,
        };
        let [low, high] =
            ["min", "max"].map(|end| glam::Vec3::from_slice(&numbers(&root["accessors"][0][end])));
        let size = (rotation * (high - low)).abs();
        assert!((size - glam::Vec3::new(8.0, 3.0, 8.0)).length() < 1e-3, "{up}: {size}");
        let upward = if up == "z" { glam::Vec3::Z } else { glam::Vec3::Y };
        assert!((rotation * upward - glam::Vec3::Y).length() < 1e-5, "{up}");
    }
}

/// A camera that looks across the floor: the floor is at the bottom of the picture, and both sides are alike.
#[test]
fn cameras_are_not_rolled() {
    for (up, camera) in [("z", "4,-4,1,4,4,1,60"), ("y", "4,1,4,4,1,-4,60")] {
        let scratch = Scratch::new();
        scene(&scratch, up);
        solve(&scratch, up, &format!("image --image-size 80x60 --camera {camera}"));
        let image = image::open(scratch.path("o/view.png")).expect("a picture").to_luma8();
        let mean = |columns: std::ops::Range<u32>, rows: std::ops::Range<u32>| {
            let pixels = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
            let values: Vec<f64> = pixels.map(|(x, y)| f64::from(image.get_pixel(x, y)[0])).collect();
            values.iter().sum::<f64>() / values.len() as f64
        };
        let (top, bottom) = (mean(0..80, 0..5), mean(20..60, 33..42));
        assert!(bottom > 20.0 && bottom > 10.0 * top, "{up}: {top} above {bottom}");
        let (left, right) = (mean(0..40, 31..60), mean(40..80, 31..60));
        assert!((left / right - 1.0).abs() < 0.2, "{up}: {left} beside {right}");
    }
}
