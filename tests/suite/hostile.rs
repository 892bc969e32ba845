//! What a user meets who makes mistakes, and what a file can do that somebody else made.

use crate::run::{Outcome, Scratch, words};
use std::process::Command;
use std::time::{Duration, Instant};

/// A floor, and a lamp above it that faces downwards.
pub const SCENE: &str = "mtllib scene.mtl\no floor\nusemtl grey\nv 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nf 1 2 3 4\n\
    o lamp\nusemtl light\nv 2 2 2\nv 2 3 2\nv 3 2 2\nf 5 6 7\n";
pub const LIBRARY: &str = "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl light\nKd 0 0 0\nKe 10 10 10\n";
pub const POINTS: &str = "x,y,z,nx,ny,nz\n1,1,0,0,0,1\n2,2,0,0,0,1\n";
pub const IES: &str = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 2 1 1 2 0.1 0.1 0\n1 1 20\n0 90\n0\n100 0\n";
pub const LIGHTS: &str = "[[luminaire]]\nfile = \"lamp.ies\"\nat = [1, 1, 1.5]\naim = [0, 0, -1]\n";
const QUICK: &str = "--points 20 --rays 4 --reference-rays 16 --map 16 --rounds 1 --feature-size 1";

/// The words of a benchmark that takes no time.
pub fn quick(line: &str) -> Vec<&str> {
    [words(line), words(QUICK)].concat()
}

pub fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("scene.obj", SCENE);
    scratch.write("scene.mtl", LIBRARY);
    scratch.write("points.csv", POINTS);
    scratch
}

/// An error of one line that holds `word`.
pub fn refused(outcome: &Outcome, word: &str) {
    let one_line = outcome.stderr.trim_end().lines().count() == 1;
    let is_clean = one_line && !outcome.stderr.contains("internal error");
    assert!(
        outcome.code == Some(2) && is_clean && outcome.stderr.contains(word),
        "no `{word}`: {:?} {}",
        outcome.code,
        outcome.stderr
    );
}

/// Pipes and devices, under whatever name a file gives them, are refused at once.
#[test]
#[cfg(unix)]
fn pipes_and_devices_are_not_read() {
    let scratch = scratch();
    let made = Command::new("mkfifo").arg(scratch.path("pipe")).status().expect("mkfifo");
    assert!(made.success());
    for (kind, target) in [("pipe", "pipe"), ("zero", "/dev/zero"), ("noise", "/dev/urandom")] {
        for extension in ["obj", "ply", "gltf", "glb"] {
            let name = format!("{kind}.{extension}");
            std::os::unix::fs::symlink(target, scratch.path(&name)).expect("linked");
            refused(&scratch.mrvis_within(60.0, &format!("info {name}")), "pipe or a device");
        }
        scratch.write("library.obj", SCENE.replace("scene.mtl", target));
        scratch.write("texture.mtl", format!("{LIBRARY}map_Kd {target}\n"));
        scratch.write("texture.obj", SCENE.replace("scene.mtl", "texture.mtl"));
        scratch.mrvis_within(60.0, "info texture.obj").exits(0).prints("pipe or a device");
        let buffer = r#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"TARGET"}]}"#;
        scratch.write("buffer.gltf", buffer.replace("TARGET", target));
        for call in [
            "info library.obj",
            "info buffer.gltf",
            &format!("solve scene.obj --out o --points {target}"),
            &format!("solve scene.obj --out o --feature-sizes {target}"),
            &format!("compare {target} points.csv"),
            &format!("fbem {target} {target}"),
        ] {
            refused(&scratch.mrvis_within(60.0, call), "pipe or a device");
        }
    }
}

/// `-` is standard input.
#[test]
fn scenes_and_points_come_from_standard_input() {
    let scratch = scratch();
    scratch.mrvis_with_input(SCENE, "info - --json r.json").exits(0);
    assert_eq!(scratch.json("r.json")["scene"]["triangles"], 3);
    assert_eq!(
        scratch.json("r.json")["scene"]["emitters"],
        1,
        "the library is found from the current folder"
    );
    scratch.mrvis_with_input(POINTS, "reference scene.obj --points - --samples 4").exits(0);
}

/// Sizes are compared with the limit before anything is read.
#[test]
fn files_larger_than_the_memory_are_not_read() {
    let scratch = scratch();
    for extension in ["obj", "ply", "glb"] {
        let name = format!("sparse.{extension}");
        let file = std::fs::File::create(scratch.path(&name)).expect("made");
        file.set_len(1 << 40).expect("sparse");
        let start = Instant::now();
        refused(&scratch.mrvis_within(60.0, &format!("info {name}")), "may be read");
        assert!(start.elapsed() < Duration::from_secs(30));
    }
    let file = std::fs::File::create(scratch.path("scene.mtl")).expect("made");
    file.set_len(1 << 33).expect("sparse");
    refused(&scratch.mrvis_within(60.0, "info scene.obj"), "may be read");
}

#[test]
fn files_from_elsewhere_are_listed() {
    let (scratch, other) = (scratch(), Scratch::new());
    other.write("far.mtl", LIBRARY);
    let far = other.path("far.mtl").display().to_string();
    scratch.write("far.obj", SCENE.replace("scene.mtl", &far));
    scratch.mrvis("info far.obj --json far.json").exits(0).prints("outside the folder").prints("far.mtl");
    let scene = &scratch.json("far.json")["scene"];
    assert_eq!(scene["files"].as_array().map(Vec::len), Some(2));
    assert_eq!(scene["files_outside"].as_array().map(Vec::len), Some(1));
    other.write("lamp.ies", IES);
    other.write("lights.toml", LIGHTS);
    let lights = other.path("lights.toml").display().to_string();
    scratch
        .mrvis(&format!("info scene.obj --luminaires {lights} --json far.json"))
        .exits(0)
        .prints("lights.toml")
        .prints("lamp.ies");
    assert_eq!(scratch.json("far.json")["scene"]["files_outside"].as_array().map(Vec::len), Some(2));
    let near = scratch.mrvis("info scene.obj");
    assert!(!near.stdout.contains("outside"), "{}", near.stdout);
}

/// Names from files appear in messages without control characters and shortened.
#[test]
fn messages_quote_little_of_a_file() {
    let scratch = scratch();
    let name = format!("a\u{1b}[31m{}", "b".repeat(5000));
    scratch.write("long.obj", SCENE.replace("floor", &name));
    let told = scratch.mrvis("bench long.obj --receiver nowhere");
    refused(&told, "nowhere");
    assert!(told.stderr.chars().count() < 600 && !told.stderr.contains('\u{1b}'), "{}", told.stderr);
    let short = |told: &str| !told.contains('\u{1b}') && told.lines().all(|line| line.chars().count() < 200);
    let told = scratch.mrvis("info long.obj --all");
    assert!(short(&told.stdout) && told.stdout.contains("a[31mbbb"), "{}", told.stdout);
    // The mesh is placed twice, so it is shared.
    let esc = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],
        "nodes":[{"mesh":0},{"mesh":0,"translation":[0,0,2]}],
        "meshes":[{"name":"NAME","primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
        "bufferViews":[{"buffer":0,"byteLength":36}],
        "buffers":[{"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA","byteLength":36}]}"#;
    scratch.write(
        "esc.gltf",
        esc.replace("NAME", &format!("\\u001b[31m\\u001b]0;t\\u0007{}", "m".repeat(5000))),
    );
    let told = scratch.mrvis("info esc.gltf").exits(0);
    assert!(short(&told.stdout) && !told.stdout.contains('\u{7}'), "{}", told.stdout);
    told.prints("[31m]0;tmmm");
    // Of a long path the end is shown.
    scratch.write("far.obj", SCENE.replace("scene.mtl", &format!("{}/end.mtl", "d/".repeat(300))));
    let told = scratch.mrvis("info far.obj");
    assert!(short(&told.stdout) && told.stdout.contains("/d//end.mtl"), "{}", told.stdout);
    let told = scratch.mrvis("info scene.obj --emitter lamp=1e300");
    refused(&told, "1e300 W");
    assert!(told.stderr.chars().count() < 200, "{}", told.stderr);
    scratch.write("number.obj", format!("v 0 0 {}\n", "9x".repeat(5000)));
    let told = scratch.mrvis("info number.obj");
    refused(&told, "is not a number");
    assert!(told.stderr.chars().count() < 200, "{}", told.stderr);
}

/// Names that turn the direction of text, or that a spreadsheet would compute, reach neither terminals nor pages nor tables as they are.
#[test]
fn names_cannot_deceive() {
    let scratch = scratch();
    let turned = "\u{202e}gnp.exe\u{2066}";
    scratch
        .write("turned.obj", SCENE.replace("o floor", &format!("o {turned}")).replace("o lamp", "o =cmd|x"));
    let told = scratch.mrvis("info turned.obj --all").exits(0);
    assert!(
        told.stdout.contains("gnp.exe") && !told.stdout.contains(['\u{202e}', '\u{2066}']),
        "{}",
        told.stdout
    );
    // JSON has the whole name, with the marks escaped.
    let told = scratch.mrvis("info turned.obj --json -").exits(0).stdout;
    let record: serde_json::Value = serde_json::from_str(&told).expect("JSON");
    assert!(!told.contains(['\u{202e}', '\u{2066}']) && record.to_string().contains(turned), "{told}");
    let line = "solve turned.obj --out o --output page --image-size 16x12 --local-rays 0 --audit 0";
    scratch.mrvis(&words(line)).exits(0);
    let page = scratch.text("o/solution.html");
    assert!(!page.contains(['\u{202e}', '\u{2066}']));
    scratch.mrvis("form-factors turned.obj --by object --out f.csv").exits(0);
    let table = scratch.text("f.csv");
    assert!(table.contains("'=cmd|x") && !table.contains(",=cmd") && !table.contains("\n=cmd"), "{table}");
    assert!(!table.contains(['\u{202e}', '\u{2066}']), "{table}");
    // Names of jobs, of files that a process of its own reads, and arguments that are refused.
    let name = turned.replace('.', "-");
    let job = format!("[[job]]\nname = '{name}'\ncommand = 'info'\nscene = 'scene.obj'\n");
    let library = "a\u{200f}.mtl";
    scratch.write(library, "newmtl a\n");
    scratch.write("library.obj", format!("mtllib {library}\n{SCENE}"));
    let limited =
        "[[job]]\nname = 'l'\ncommand = 'info'\nscene = 'library.obj'\nlimits = { memory = '4G' }\n";
    scratch.write("turned.toml", job + limited);
    for (line, code) in [
        (&["batch", "turned.toml", "--out", "b", "--dry-run"][..], 0),
        (&["batch", "turned.toml", "--out", "b", "--log", "log.jsonl"], 0),
        (&["report", "b"], 0),
        (&["solve", "scene.obj", "--builder", turned], 2),
    ] {
        let told = scratch.mrvis(line).exits(code);
        let text = told.stdout + &told.stderr;
        assert!(!text.is_empty() && !text.contains(['\u{202e}', '\u{2066}']), "{line:?}: {text}");
    }
    for file in ["log.jsonl", "b/results.jsonl", "b/results.csv"] {
        assert!(!scratch.text(file).contains(['\u{202e}', '\u{2066}']), "{file}");
    }
}

/// Nothing is written beside the scene; a link of the former name of a cache file leads nowhere.
#[test]
fn caches_are_in_the_folder_of_the_user() {
    let scratch = scratch();
    scratch.mrvis(&quick("bench scene.obj --json r.json")).exits(0);
    assert_eq!(scratch.json("r.json")["build"]["cache"], "made");
    let files = |folder: &str| -> usize {
        let entries = std::fs::read_dir(scratch.path(folder)).expect("a folder").flatten();
        entries.filter(|e| e.path().extension().is_some_and(|e| e == "mrvis-cache")).count()
    };
    assert_eq!((files(""), files("cache/mrvis")), (0, 1));
}

/// The error of a write that the system ends names the file that was asked for.
#[test]
#[cfg(target_os = "linux")]
fn full_disks_are_said_with_the_name_of_the_file() {
    let scratch = scratch();
    // Writes beyond 1 KB fail with an error instead of a signal.
    let script = "trap '' XFSZ; ulimit -f 1; exec \"$0\" generate cubes --count 2000 --out big.obj";
    let text = scratch.bash(script).exits(2).stderr;
    assert!(text.contains("big.") && !text.contains(".mrvis-"), "{text}");
    let left = std::fs::read_dir(scratch.path("")).expect("the folder").flatten();
    assert!(left.into_iter().all(|e| !e.file_name().to_string_lossy().starts_with('.')));
}

#[test]
fn cameras_have_pictures_of_their_own() {
    let scratch = scratch();
    let bytes: Vec<u8> =
        [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    scratch.write("triangle.bin", bytes);
    let camera = |name: &str| format!(r#"{{"camera":0,"name":"{name}","translation":[0.2,0.2,2]}}"#);
    scratch.write(
        "cameras.gltf",
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1,2,3]}}],
            "nodes":[{{"mesh":0,"name":"t"}},{},{},{}],
            "cameras":[{{"type":"perspective","perspective":{{"yfov":0.8,"znear":0.1}}}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}}],
            "buffers":[{{"byteLength":36,"uri":"triangle.bin"}}]}}"#,
            camera("a b"),
            camera("a_b"),
            camera("a/b")
        ),
    );
    let call = "solve cameras.gltf --out o --output image --image-size 16x16";
    scratch.mrvis(&format!("{call} --emitter t=1")).exits(0);
    let pictures = std::fs::read_dir(scratch.path("o")).expect("the folder").flatten();
    let pictures = pictures.filter(|e| e.path().extension().is_some_and(|e| e == "png")).count();
    assert_eq!(pictures, 3);
}

/// Emitters that face away from everything are said so, with the cure.
#[test]
fn turned_emitters_are_noted() {
    let scratch = scratch();
    scratch.write("turned.obj", SCENE.replace("f 5 6 7", "f 5 7 6"));
    scratch.mrvis("solve turned.obj --out o --output none").exits(0).prints("--two-sided-emission");
    scratch
        .mrvis("reference turned.obj --points points.csv --samples 8")
        .exits(0)
        .warns("--two-sided-emission");
    let solved = scratch.mrvis("solve scene.obj --out o --output none");
    assert!(!solved.stdout.contains("--two-sided-emission"), "{}", solved.stdout);
}

/// What would take more than the machine has is refused before the work, or ended with an error.
#[test]
fn limits_of_memory_end_in_errors() {
    let scratch = scratch();
    let huge = ["bench", "scene.obj", "--points", "99999999", "--rays", "65536", "--max-memory", "4"];
    refused(&scratch.mrvis_within(20.0, &huge), "segments");
    let many = ["bench", "scene.obj", "--points", "99999999", "--max-memory", "4"];
    refused(&scratch.mrvis_within(20.0, &many), "memory");
    refused(&scratch.mrvis("solve scene.obj --out o --min-area 1e-300"), "--min-area 1e-300");
    refused(&scratch.mrvis("solve scene.obj --out o --audit 1000000000"), "--audit 1000000000");
    refused(&scratch.mrvis("info scene.obj --max-memory 0"), "max-memory");
    // A forest of six million triangles takes more than 0.2 GiB.
    let large = ["generate", "forest", "--trees", "3000", "--out", "forest.obj", "--max-memory", "0.2"];
    refused(&scratch.mrvis_within(60.0, &large), "out of memory");
}

/// A limit of the address space ends the command with an error of one line, in the library or in Embree.
#[test]
#[cfg(target_os = "linux")]
fn refused_memory_is_an_error() {
    let scratch = Scratch::new();
    scratch.mrvis("generate forest --trees 30 --out f.obj").exits(0);
    for kilobytes in [350_000, 450_000, 560_000] {
        let script = format!(
            "ulimit -v {kilobytes}; exec \"$0\" solve f.obj --out o --output none --threads 2 --quiet"
        );
        refused(&scratch.bash(&script), "mrvis: out of memory: ");
    }
    // Sizes that the user states.
    let scratch = self::scratch();
    let solve = "solve scene.obj --output lightmap --lightmap-texels 60000000 --out o --threads 1 --quiet";
    let large = scratch.bash(&format!("ulimit -v 800000; exec \"$0\" {solve}"));
    refused(&large, "texels of a lightmap (--lightmap-texels) take ");
    for (generated, what) in [
        ("terrain --count 20000 --out t.tif", "400000000 samples of the terrain take 3200000000 bytes"),
        ("forest --trees 10000 --out f.obj", "10000000 leaves take 1240000000 bytes"),
    ] {
        let large = scratch.bash(&format!("ulimit -v 800000; exec \"$0\" generate {generated} --quiet"));
        refused(&large, &format!("mrvis: out of memory: {what}"));
    }
}

#[test]
fn mistakes_of_typing_are_understood() {
    let scratch = scratch();
    refused(&scratch.mrvis("info scene.obj --unit furlong"), "not a unit of length");
    refused(&scratch.mrvis("slove scene.obj"), "did you mean solve?");
    refused(&scratch.mrvis("bench scene.obj --recevier floor"), "did you mean --receiver?");
    refused(&scratch.mrvis("bench scene.obj --receiver flor"), "did you mean `floor`?");
    for call in [["--quiet", "info", "scene.obj"], ["info", "scene.obj", "--quiet"]] {
        let quiet = scratch.mrvis(&call).exits(0);
        assert!(quiet.stdout.is_empty() && quiet.stderr.is_empty());
    }
}

#[test]
fn what_is_installed_beside_the_command() {
    let scratch = scratch();
    scratch.mrvis("--version").prints("(Embree 4.");
    for shell in ["bash", "zsh", "fish"] {
        let script = scratch.mrvis(&format!("completions {shell}")).exits(0);
        assert!(script.stdout.contains("feature-size"), "{shell}");
    }
    scratch.mrvis("man --out man").exits(0);
    for page in ["mrvis.1", "mrvis-solve.1", "mrvis-bench.1", "mrvis-form-factors.1"] {
        let text = std::fs::read_to_string(scratch.path("man").join(page)).expect(page);
        assert!(text.contains(".TH"), "{page}");
    }
    let long = scratch.mrvis("help solve").stdout;
    assert!(long.contains("--min-area") && long.contains("Accuracy and time"), "{long}");
    let colours = |variable: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mrvis"));
        let output = command.arg("--help").env(variable, "1").output().expect("the command runs");
        output.stdout.contains(&0x1b)
    };
    assert!(colours("CLICOLOR_FORCE") && !colours("NO_COLOR"));
}

/// The scenes of the generator are clean.
#[test]
fn generated_scenes_have_no_warnings() {
    let scratch = scratch();
    scratch.mrvis("generate cornell --out cornell.obj").exits(0);
    let call =
        ["solve", "cornell.obj", "--unit", "mm", "--out", "o", "--output", "none", "--max-seconds", "2"];
    scratch.mrvis(&call).exits(0);
    let warnings = &scratch.json("o/solution.json")["warnings"];
    let texts: Vec<&str> = warnings.as_array().expect("a list").iter().filter_map(|w| w.as_str()).collect();
    let of_the_scene = texts.iter().filter(|w| !w.contains("max-seconds")).count();
    assert_eq!(of_the_scene, 0, "{texts:?}");
}

/// A floor, lit by a luminaire with these lines of its file.
fn lit(lights: &str) -> Scratch {
    let scratch = scratch();
    scratch.write("scene.mtl", LIBRARY.replace("Ke 10 10 10", "Ke 0 0 0"));
    scratch.write("lamp.ies", IES);
    scratch.write("lights.toml", lights);
    scratch
}

/// The faces of a luminaire are not the user's: what is wrong is its place or aim.
#[test]
fn a_luminaire_that_misses_everything_is_to_be_aimed() {
    let scratch = lit(&LIGHTS.replace("[1, 1, 1.5]", "[1, 1, 3]").replace("[0, 0, -1]", "[0, 0, 1]"));
    let options = "scene.obj --luminaires lights.toml";
    let solved = scratch.mrvis(&format!("solve --out o --output none {options}")).exits(0);
    let traced = scratch.mrvis(&format!("reference --points points.csv --samples 8 {options}")).exits(0);
    let bench = scratch.mrvis(&quick("bench scene.obj --luminaires lights.toml"));
    refused(&bench, "no surface faces an emitter");
    for said in [solved.stdout, traced.stderr, bench.stderr] {
        assert!(said.contains("check `at` and `aim`") && !said.contains("reverse"), "{said}");
    }
}

#[test]
fn a_camera_that_looks_nowhere_is_told_so() {
    let solved = scratch().mrvis("solve scene.obj --out o --camera 1,2,3,1,2,3,60");
    refused(&solved, "eye and target are the same point");
    assert!(!solved.stderr.contains("seven numbers"), "{}", solved.stderr);
}

/// One point may look away from the lamp although the scene is lit.
#[test]
fn few_points_of_a_bench_are_no_fault_of_the_scene() {
    let scratch = scratch();
    // The lamp lights the small floor, not the large ceiling above it.
    let ceiling = "o ceiling\nusemtl grey\nv -40 -40 9\nv 40 -40 9\nv 40 40 9\nv -40 40 9\nf 8 9 10 11\n";
    scratch.write("scene.obj", format!("{SCENE}{ceiling}"));
    let bench = scratch.mrvis("bench scene.obj --points 1 --reference-rays 16 --map 0 --feature-size 1");
    refused(&bench, "--points 1: none of them faces an emitter");
    assert!(!bench.stderr.contains("reverse") && !bench.stderr.contains("winding"), "{}", bench.stderr);
}

/// Elements have reflected light: without points it would be in all results of a solution that was to leave it out.
#[test]
fn direct_light_alone_needs_points_or_pixels() {
    for more in ["", " --gather --output none"] {
        let solved = scratch().mrvis(&format!("solve scene.obj --out o --direct-only{more}"));
        refused(&solved, "give --points or --grid, or --gather with --output image");
    }
}

/// Messages have no names of types of the program's language.
#[test]
fn numbers_are_called_numbers() {
    let scratch = lit(&LIGHTS.replace("[1, 1, 1.5]", "[1, 1, 'x']"));
    scratch.write("sizes.toml", "floor = 'x'\n");
    for (options, what) in [
        ("--luminaires lights.toml", "expected a number"),
        ("--feature-sizes sizes.toml", "expected a number"),
        ("--error x", "'--error <E>': expected a number"),
        ("--seed x", "'--seed <N>': expected a whole number"),
    ] {
        refused(&scratch.mrvis(&format!("solve scene.obj --out o {options}")), what);
    }
}
