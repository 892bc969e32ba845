//! Sky, sun and terrain on the command line.

use crate::hostile::refused;
use crate::run::Scratch;

/// A square of 4 by 4 m, up z.
const GROUND: &str =
    "mtllib grey.mtl\nusemtl grey\no ground\nv 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nf 1 2 3 4\n";
const GREY: &str = "newmtl grey\nKd 0.5 0.5 0.5\n";
const POINT: &str = "x,y,z,nx,ny,nz\n2,2,0,0,0,1\n1,3,0,0,0,1\n";

fn ground() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("ground.obj", GROUND);
    scratch.write("grey.mtl", GREY);
    scratch.write("points.csv", POINT);
    scratch
}

#[test]
fn sky_and_sun_light_points_and_are_named_in_outputs() {
    let scratch = ground();
    let scene = "ground.obj --points points.csv --up z --sky uniform:100 --sun 180,30:800";
    scratch
        .mrvis(&format!("solve {scene} --out s --audit 0 --error 0.1"))
        .exits(0)
        .prints("sun at azimuth 180.0000, elevation 30.0000 degrees");
    let light = |name: &str| scratch.rows(name).iter().map(|row| row[6]).collect::<Vec<f64>>();
    assert!(
        light("s/irradiance.csv").iter().all(|e| (e - 500.0).abs() < 1.5),
        "{:?}",
        light("s/irradiance.csv")
    );
    let record = scratch.json("s/solution.json");
    assert!(record["scene"]["sky"].to_string().contains("north +y"), "{}", record["scene"]["sky"]);
    scratch.mrvis(&format!("reference {scene} --out r.csv --samples 256")).exits(0);
    assert!(light("r.csv").iter().all(|e| (e - 500.0).abs() < 5.0), "{:?}", light("r.csv"));
}

#[test]
fn skies_that_cannot_be_are_refused_in_one_line() {
    let scratch = ground();
    scratch.write("sky.toml", "sky = 'overcast'\nbrightness = 3\n");
    for (options, words) in [
        ("--sky cie:17", "17 is no type of CIE sky"),
        ("--sky perez:600,100", "sun"),
        ("--sky perez:600,100 --sun 180,-5", "horizon"),
        ("--sky perez:600,-1 --sun 180,40", "-1"),
        ("--sky perez:5000,100 --sun 180,40", "outside the atmosphere"),
        ("--sky clear:3 --place 95,11 --time 2026-06-21T12:00Z", "95"),
        ("--sky clear:3 --place 48,11 --time 2026-06-31T12:00Z", "2026-06-31"),
        ("--sky clear:3 --place 48,11", "time"),
        ("--sky sky.toml", "sky.toml"),
        ("--sky missing.exr", "missing.exr"),
    ] {
        refused(&scratch.mrvis(&format!("info ground.obj --up z {options}")), words);
    }
}

/// A height field with a slope of 45 degrees to the south, whose rows are 10 m apart.
fn slope() -> Scratch {
    let scratch = Scratch::new();
    let mut text = "ncols 12\nnrows 10\nxllcorner 1000\nyllcorner 2000\ncellsize 10\n".to_owned();
    for row in 0..10 {
        text += &(format!("{} ", 100 - 10 * row).repeat(12) + "\n");
    }
    scratch.write("slope.asc", text);
    scratch
}

#[test]
fn terrain_computes_maps_of_height_fields() {
    let scratch = slope();
    let light = "--output sky-view-factor,sunlit,irradiance --sky uniform:100 --sun 180,45:800";
    scratch.mrvis(&format!("terrain slope.asc --out t --json t.json --format tif,npz,png {light}")).exits(0);
    let record = scratch.json("t.json");
    let mean = |k: usize| record["quantities"][k]["mean"].as_f64().expect("a number");
    let free = 0.5 * (1.0 + std::f64::consts::FRAC_1_SQRT_2);
    assert!((mean(0) - free).abs() < 3e-3 && mean(1) == 1.0, "{record}");
    // The sun is straight above the slope.
    assert!((mean(2) - 800.0 - 100.0 * free).abs() < 3.0, "{record}");
    for name in ["sky-view-factor.tif", "sunlit.npz", "irradiance.png"] {
        assert!(scratch.path(&format!("t/{name}")).metadata().is_ok_and(|file| file.len() > 60), "{name}");
    }
    scratch.mrvis("terrain slope.asc --out t --output irradiance").exits(2).warns("give --sky");
    let unused = |options: &str, words: &str| {
        refused(&scratch.mrvis(&format!("terrain slope.asc --out t {options}")), words);
    };
    unused("--sun 135,30", "--sun has no effect without --output sunlit or --output irradiance");
    unused("--place 47,11 --output horizon", "--place has no effect without --output sunlit");
    unused("--sun 135,30 --day --output sunlit", "--day has no effect without --output irradiance");
    // A clear day in June on a slope to the south: about as much as on a level plane, 8 kWh/m2.
    let day = "--output irradiance --day=60 --sky clear:3 --time 2026-06-21T12:00+01:00 --place";
    let energy = mean_of(&scratch, &format!("{day} 47,11"));
    assert!((6000.0..9000.0).contains(&energy), "{energy}");
    // At the midnight sun the last interval ends with the day.
    let at_80_north = |minutes: u32, month: u32| {
        let time = format!("--time 2026-{month:02}-21T12:00+01:00 --place 80,15");
        format!("--output irradiance --day={minutes} --sky clear:3 {time}")
    };
    let dark = scratch.mrvis(&format!("terrain slope.asc --out d {}", at_80_north(60, 12))).exits(0);
    dark.warns("the sun is below the horizon at all times");
    let [even, odd] = [120, 200].map(|minutes| mean_of(&scratch, &at_80_north(minutes, 6)));
    assert!((odd / even - 1.0).abs() < 0.01, "{odd} {even}");
    scratch.mrvis(&format!("terrain slope.asc --out d {day} 947,11")).exits(2).warns("latitude 947");
    let job = "[[job]]\ncommand = 'terrain'\nname = 'maps'\nscene = 'slope.asc'\noptions = { output = 'sky-view-factor' }\n";
    scratch.write("jobs.toml", job);
    scratch.mrvis("batch jobs.toml --out jobs --quiet").exits(0);
    scratch.mrvis("terrain slope.asc --out d --output sky-view-factor").exits(0);
    let maps = ["d", "jobs/maps"].map(|folder| scratch.path(&format!("{folder}/sky-view-factor.tif")));
    let [alone, of_batch] = maps.map(|path| std::fs::read(path).expect("a map"));
    assert!(alone == of_batch);
    scratch.write("bad.asc", "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize -5\n1 2\n3 4\n");
    refused(&scratch.mrvis("terrain bad.asc --out b"), "bad.asc");
    assert!(!scratch.path("b").exists());
}

/// Mean of the only quantity that `terrain slope.asc` computes.
fn mean_of(scratch: &Scratch, options: &str) -> f64 {
    scratch.mrvis(&format!("terrain slope.asc --out m --json m.json {options}")).exits(0);
    scratch.json("m.json")["quantities"][0]["mean"].as_f64().expect("a number")
}

#[test]
fn the_north_of_a_sky_turns_sun_and_sky_over_terrain() {
    let scratch = slope();
    scratch.write("south.toml", "sun = '180,45:800'\n");
    scratch.write("turned.toml", "sun = '0,45:800'\nnorth = [0, -1, 0]\n");
    let light = |sky: &str| mean_of(&scratch, &format!("--output irradiance --sky {sky}"));
    let found = [light("south.toml"), light("turned.toml")];
    assert!((found[0] - 800.0).abs() < 3.0 && (found[1] - found[0]).abs() < 1e-3, "{found:?}");
}

#[test]
fn the_light_of_a_day_follows_the_sun() {
    let scratch = slope();
    scratch.write("day.toml", "sky = 'clear:3'\nplace = [47, 11]\ntime = 2026-06-21T12:00:00+01:00\n");
    let day = "--output irradiance --day=240";
    let place = "--place 47,11 --time 2026-06-21T12:00+01:00";
    let found = [format!("{day} --sky day.toml"), format!("{day} --sky clear:3 {place}")]
        .map(|o| mean_of(&scratch, &o));
    assert!(found[0] > 5000.0 && found[0] == found[1], "{found:?}");
    let terrain = "terrain slope.asc --out d --output irradiance --day";
    scratch.mrvis(&format!("{terrain} --sun 180,60:900 {place}")).exits(2).warns("leave --sun out");
    scratch.mrvis(&format!("{terrain} --sky clear:3")).exits(2).warns("needs --place and --time");
    scratch.mrvis(&format!("{terrain}=240 --sky perez:600,120 {place}")).exits(0).warns("same at all times");
}

#[test]
fn sunlit_needs_only_the_direction_of_the_sun() {
    let scratch = slope();
    for (sun, part) in
        [("--place 47,11 --time 2026-06-21T12:00+01:00", 1.0), ("--sun 180,30", 1.0), ("--sun 0,30", 0.0)]
    {
        assert_eq!(mean_of(&scratch, &format!("--output sunlit {sun}")), part, "{sun}");
    }
    scratch.mrvis("terrain slope.asc --out m --output sunlit").exits(2).warns("give --sun");
}

#[test]
fn the_horizon_has_a_picture_for_each_azimuth() {
    let scratch = slope();
    scratch.mrvis("terrain slope.asc --out h --output horizon --format png --azimuths 4").exits(0);
    for azimuth in ["000.0", "090.0", "180.0", "270.0"] {
        assert!(scratch.path(&format!("h/horizon-{azimuth}.png")).exists(), "{azimuth}");
    }
}

#[test]
fn meshes_with_vertices_on_a_grid_are_height_fields() {
    let scratch = slope();
    let vertex =
        |k: usize| format!("v {} {} {}\n", 1005 + k % 12 * 10, 2095 - k / 12 * 10, 100 - k / 12 * 10);
    let vertices: String = (0..120).map(vertex).collect();
    let face = |k: usize| format!("f {} {} {} {}\n", k + 1, k + 13, k + 14, k + 2);
    let faces: String = (0..108).filter(|k| k % 12 < 11).map(face).collect();
    scratch.write("slope.obj", format!("{vertices}{faces}"));
    let wanted = mean_of(&scratch, "");
    scratch
        .mrvis("terrain slope.obj --out o --json o.json")
        .exits(0)
        .prints("12 x 10 samples every 10 x 10 m");
    let found = scratch.json("o.json")["quantities"][0]["mean"].as_f64().expect("a number");
    assert!((found - wanted).abs() < 1e-6, "{found} {wanted}");
    scratch.write("bent.obj", format!("{vertices}{faces}").replace("v 1015 ", "v 1018 "));
    scratch.mrvis("terrain bent.obj --out o").exits(2).warns("not at equal distances");
}

#[test]
fn height_fields_are_scenes() {
    let scratch = slope();
    scratch.write("points.csv", "x,y,z,nx,ny,nz\n1055,2055,60,0,-0.7071068,0.7071068\n");
    let solve = "solve slope.asc --out s --points points.csv --audit 0 --error 0.1";
    scratch.mrvis(&format!("{solve} --sky uniform:100 --sun 180,45:800")).exits(0);
    let value = scratch.rows("s/irradiance.csv")[0][6];
    assert!((value - 885.36).abs() < 3.0, "{value}");
}

/// A wall that hides the sun from a point of the slope, and a second height field to the east.
#[test]
fn scenes_of_height_fields_and_objects_have_several_files() {
    let scratch = slope();
    let east = scratch.text("slope.asc");
    scratch.write("east.asc", east.replace("xllcorner 1000", "xllcorner 1120"));
    scratch.write(
        "wall.obj",
        "o wall\nv 1030 2050 50\nv 1080 2050 50\nv 1080 2050 80\nv 1030 2050 80\nf 1 2 3 4\n",
    );
    let row = |x: u32| format!("{x},2055,60,0,-0.7071068,0.7071068\n");
    scratch.write("points.csv", format!("x,y,z,nx,ny,nz\n{}{}{}", row(1055), row(1100), row(1175)));
    let solve = "solve slope.asc --out s --points points.csv --output none --audit 0";
    let light = "--sky uniform:100 --sun 180,45:800 --add east.asc --add wall.obj";
    for curved in ["", "--curvature=1.1667"] {
        scratch.mrvis(&format!("{solve} {light} {curved}")).exits(0);
        let found: Vec<f64> = scratch.rows("s/irradiance.csv").iter().map(|row| row[6]).collect();
        assert!(found[0] < 90.0 && found[1..].iter().all(|e| (e - 885.0).abs() < 15.0), "{found:?}");
    }
    for (option, words) in [("--add tree.glb", "cannot be added"), ("--curvature=0.1 --quiet", "curvature")] {
        refused(&scratch.mrvis(&format!("info slope.asc {option}")), words);
    }
}

/// Files of instances have the upward axis y, and are turned where a height field is added.
#[test]
fn forests_of_instances_stand_upright_on_height_fields() {
    let scratch = Scratch::new();
    scratch.write(
        "hill.asc",
        format!("ncols 3\nnrows 3\nxllcorner -30\nyllcorner -30\ncellsize 20\n{}", "1 2 1\n".repeat(3)),
    );
    scratch.mrvis("generate forest --trees 3 --leaves 20 --instances --out trees.glb").exits(0);
    scratch.write("wall.obj", "o wall\nv 9 0 0\nv 9 9 0\nv 9 9 9\nf 1 2 3\n");
    for (added, normal, objects) in [
        ("", "normal 0.00 -1.00 0.00", "2"),
        ("--add wall.obj", "normal 0.00 -1.00 0.00", "3"),
        ("--add hill.asc", "normal 0.00 0.00 -1.00", "3"),
    ] {
        let info = scratch.mrvis(&format!("info trees.glb {added}")).exits(0);
        let count = info.stdout.lines().find_map(|line| line.trim().strip_prefix("objects"));
        assert_eq!(count.map(str::trim), Some(objects), "{}", info.stdout);
        assert!(info.stdout.contains(normal), "{}", info.stdout);
    }
}

/// Lux of a sky are not multiplied by 179 lm/W, and a sky in W/m² is not taken for one in lux.
#[test]
fn skies_have_the_photometric_unit_of_lamps() {
    let scratch = ground();
    scratch.write("sky.toml", "sky = \"perez:600,120\"\nsun = \"180,45\"\nphotometric = true\n");
    let solve = |options: &str| {
        let line = "solve ground.obj --up z --points points.csv --direct-only --audit 0 --out s --sky";
        scratch.mrvis(&format!("{line} {options}"))
    };
    refused(&solve("sky.toml --photometric"), "--photometric=red");
    refused(&solve("sky.toml"), "--photometric=red");
    let elements =
        "solve ground.obj --up z --sky sky.toml --photometric=red --error 0.1 --audit 0 --output vtu --out e";
    let text = scratch.mrvis(elements).exits(0).stdout;
    assert!(text.contains("mean illuminance of lit surfaces") && !text.contains("W/m"), "{text}");
    refused(&solve("perez:600,120 --sun 180,45 --photometric=red"), "`photometric = true`");
    let lux = |options: &str| {
        solve(options).exits(0);
        *scratch.rows("s/irradiance.csv")[0].last().expect("a value")
    };
    let [file, uniform] = ["sky.toml", "uniform:20000"].map(|sky| lux(&format!("{sky} --photometric=red")));
    assert!(file > 1e4 && (uniform / 2e4 - 1.0).abs() < 0.01, "{file} {uniform}");
}

/// A square in the plane y = 0 that faces up, and a directional light that shines straight down.
const YARD: &str = r#"{"asset":{"version":"2.0"},"extensionsUsed":["KHR_lights_punctual"],
"extensions":{"KHR_lights_punctual":{"lights":[{"type":"directional","intensity":1000}]}},
"scenes":[{"nodes":[0,1]}],"nodes":[{"mesh":0},{"rotation":[-0.70710678,0,0,0.70710678],"extensions":{"KHR_lights_punctual":{"light":0}}}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[-2,0,-2],"max":[2,0,2]},
{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":12}],
"buffers":[{"byteLength":60,"uri":"data:application/octet-stream;base64,AAAAwAAAAAAAAADAAAAAwAAAAAAAAABAAAAAQAAAAAAAAABAAAAAQAAAAAAAAADAAAABAAIAAAACAAMA"}]}"#;

/// The sun of the file stays beside a sky without a sun of its own.
#[test]
fn suns_of_gltf_files_shine_beside_a_sky() {
    let scratch = Scratch::new();
    scratch.write("yard.gltf", YARD);
    scratch.write("points.csv", "x,y,z,nx,ny,nz\n0.3,0,0.4,0,1,0\n");
    let light = |sky: &str| -> f64 {
        scratch.mrvis(&format!("solve yard.gltf --out s --points points.csv --audit 0 {sky}")).exits(0);
        scratch.rows("s/irradiance.csv")[0][6]
    };
    let sun = light("");
    let sky = light("--sky uniform:100 --sun none");
    let both = light("--sky uniform:100");
    assert!(sun > 1.0 && (sky - 100.0).abs() < 0.3 && (both - sun - sky).abs() < 0.3, "{sun} {sky} {both}");
}

#[test]
fn suns_of_gltf_files_below_the_horizon_get_a_note() {
    let scratch = Scratch::new();
    scratch.write("yard.gltf", YARD.replace("[-0.70710678,0,0,0.70710678]", "[0.70710678,0,0,0.70710678]"));
    scratch.mrvis("info yard.gltf").exits(0).prints("light comes from below the horizon");
}

#[test]
fn cameras_that_see_only_sky_see_something() {
    let scratch = ground();
    let solve =
        "solve ground.obj --up z --out s --audit 0 --output image --image-size 20x20 --camera 2,2,1,2,3,9,40";
    for (sky, is_seen) in [("--sky uniform:100", true), ("--sun 180,45:800", false)] {
        let solved = scratch.mrvis(&format!("{solve} {sky}")).exits(0);
        let said = format!("{}{}", solved.stdout, solved.stderr);
        assert_eq!(!said.contains("is black"), is_seen, "{said}");
    }
}

#[test]
fn generated_terrain_is_read_again() {
    let scratch = Scratch::new();
    scratch.mrvis("generate terrain --count 30 --out hills.tif").exits(0);
    scratch.mrvis("terrain hills.tif --out t --json t.json").exits(0);
    let factor = &scratch.json("t.json")["quantities"][0];
    let value = |name: &str| factor[name].as_f64().expect("a number");
    assert!(value("min") > 0.2 && value("min") < value("mean") && value("max") <= 1.0, "{factor}");
    scratch.mrvis("generate terrain --out hills.obj").exits(2).warns("must end in .tif");
}

/// A meadow of 20 m with a box of 2 m, z upwards.
const MEADOW: &str = "o meadow\nv -10 -10 0\nv 10 -10 0\nv 10 10 0\nv -10 10 0\nf 1 2 3 4\n\
    o box\nv 0 -1 0.01\nv 2 -1 0.01\nv 2 1 0.01\nv 0 1 0.01\nv 0 -1 2\nv 2 -1 2\nv 2 1 2\nv 0 1 2\n\
    f 8 7 6 5\nf 5 6 10 9\nf 6 7 11 10\nf 7 8 12 11\nf 8 5 9 12\nf 9 10 11 12\n";
/// One feature size and few rays: images of each size take seconds.
const QUICK: &str = "--points 100 --rays 4 --feature-size 0.5 --reference-rays 16 --rounds 1 --map 16";

#[test]
fn bench_names_patches_and_sun_in_all_outputs() {
    let scratch = Scratch::new();
    scratch.write("meadow.obj", MEADOW);
    let bench = format!("bench meadow.obj --up z --sky uniform:1000 --json b.json --out b {QUICK}");
    let with_sun = scratch.mrvis(&format!("{bench} --sun 140,40:500")).exits(0);
    let patches = "64 patches of the sky up to";
    with_sun.prints(patches).prints("and the sun.");
    let page = scratch.text("b/report.html");
    assert!(page.contains(patches) && page.contains("patches per point"));
    let record = scratch.json("b.json");
    let sky = &record["workload"]["sky"];
    assert!(sky["patches"] == 64 && sky["patches_per_point"] == 4 && sky["suns"] == 1, "{sky}");
    assert!(sky["shown"] == "lamps" && sky["largest_angle"].as_f64().is_some_and(|a| a > 20.0 && a < 32.0));
    // The box stands in the sun: its shadow is in the image of the meadow.
    assert_eq!(record["receivers"][0]["name"], "meadow", "{}", record["receivers"]);
    scratch.mrvis(&bench).exits(0).prints("the patch with the largest irradiance");
    assert_eq!(scratch.json("b.json")["workload"]["sky"]["shown"], "patch");
}

#[test]
fn bench_without_light_says_what_to_add() {
    let scratch = Scratch::new();
    scratch.write("meadow.obj", MEADOW);
    let bench = format!("bench meadow.obj --quiet {QUICK}");
    scratch.mrvis(&bench).exits(2).warns("--sky");
    refused(&scratch.mrvis(&format!("{bench} --sun 140,-10:500")), "");
}
