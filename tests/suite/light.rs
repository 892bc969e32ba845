//! Commands around the solver: reference, compare, form-factors, outputs of solve.

use crate::hostile::refused;
use crate::run::Scratch;
use mrvis::internals::scene::generate::Spec;

/// A closed box; all faces emit radiosity 1 and reflect 0.5, so that irradiance is 1/(1 − 0.5) = 2.
const BOX: &str = "mtllib box.mtl\nusemtl glow\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
    f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 4 3 7 8\nf 1 4 8 5\nf 2 6 7 3\n";
const GLOW: &str = "newmtl glow\nKd 0.5 0.5 0.5\nKe 0.318309886 0.318309886 0.318309886\n";
/// Options of solves whose light need not be accurate.
const ROUGH: &str = "--audit 0 --local-rays 0";
const POINTS: &str = "x,y,z,nx,ny,nz\n0.5,0.5,0,0,0,1\n0.1,0.9,1,0,0,-1\n";

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("box.obj", BOX);
    scratch.write("box.mtl", GLOW);
    scratch.write("dark.obj", BOX.replace("mtllib box.mtl\n", ""));
    scratch.write("points.csv", POINTS);
    scratch.write("bad.csv", POINTS.replace("0.9", "nan"));
    scratch.write("flat.csv", POINTS.replace("0,0,1\n", "0,0,0\n"));
    scratch.write("columns.csv", POINTS.replace(",nz", ""));
    scratch.write("none.csv", "x,y,z,nx,ny,nz\n");
    scratch
}

/// The values of an irradiance file, beginning with `Er`.
fn values(scratch: &Scratch, name: &str) -> Vec<Vec<f64>> {
    scratch.rows(name).into_iter().map(|row| row[6..].to_vec()).collect()
}

#[test]
fn a_reference_says_how_sure_it_is() {
    let scratch = scratch();
    let arguments = "reference box.obj --points points.csv --samples 512 --json r.json";
    scratch.mrvis(&format!("{arguments} --out a.csv")).exits(0);
    for row in values(&scratch, "a.csv") {
        let [e, _, _, se, ..] = row[..] else { panic!("{} columns", row.len()) };
        assert!((e - 2.0).abs() < 6.0 * se + 1e-3 && se < 0.05, "{e} ± {se}");
    }
    assert_eq!(scratch.json("r.json")["samples"], 512);
    // Equal on any number of threads, different with another seed.
    scratch.mrvis(&format!("{arguments} --out b.csv --threads 3")).exits(0);
    scratch.mrvis(&format!("{arguments} --out c.csv --seed 2")).exits(0);
    let text = |name: &str| scratch.text(name);
    assert_eq!(text("a.csv"), text("b.csv"));
    assert_ne!(text("a.csv"), text("c.csv"));
    // `compare` reports the difference, and the tolerance decides the exit code.
    scratch.mrvis("compare a.csv c.csv --tolerance 0.2 --json d.json").exits(0).prints("RMS").prints("bias");
    assert!(scratch.json("d.json")["rms"].as_f64().is_some_and(|r| r > 0.0 && r < 0.2));
    scratch.mrvis("compare a.csv c.csv --tolerance 1e-9").exits(1);
    scratch.mrvis("compare a.csv b.csv --tolerance 0").exits(0);
}

#[test]
fn scenes_without_light_are_zero_with_a_warning() {
    let scratch = scratch();
    scratch.mrvis("reference dark.obj --points points.csv --out a.csv").exits(0).warns("no light");
    assert!(values(&scratch, "a.csv").iter().flatten().all(|&v| v == 0.0));
}

#[test]
fn bad_input_is_refused_in_one_line() {
    let scratch = scratch();
    for (arguments, word) in [
        ("reference box.obj --points bad.csv", "bad.csv:3"),
        ("reference box.obj --points missing.csv", "missing.csv"),
        ("reference box.obj --points points.csv --samples 1", "samples"),
        ("reference box.obj --points points.csv --out nowhere/a.csv", "nowhere/a.csv"),
        ("compare points.csv points.csv", "Er,Eg,Eb"),
        ("compare points.csv points.csv --tolerance=-1", "tolerance"),
        ("solve", "SCENE"),
        ("solve box.obj --out s --importance-camera", "the scene has no camera"),
        ("solve box.obj --out s --points flat.csv", "flat.csv:2"),
        ("solve box.obj --out s --points columns.csv", "x,y,z,nx,ny,nz"),
        ("solve box.obj --out s --points none.csv", "no point"),
        ("solve none.obj --out s", "none.obj"),
        ("solve box.obj --out box.mtl", "box.mtl: is not a folder"),
        ("solve box.obj --out /dev/full", "give a folder that can be written"),
        ("solve box.obj --out /proc/nothing", "give a folder that can be written"),
        ("solve box.obj --out s --json nowhere/s.json", "nowhere/s.json"),
        ("solve box.obj --out s --error 0", "--error"),
        ("solve box.obj --out s --error -1", "--error"),
        ("solve box.obj --out s --max-seconds 0", "--max-seconds"),
        ("solve box.obj --out s --image-size 16384x16384", "image-size"),
        ("solve box.obj --out s --lightmap-texels 0", "lightmap-texels"),
        ("form-factors box.obj --out f.txt", ".npz, .csv or .mtx"),
        ("form-factors box.obj --out f.npz --rays 0", "rays"),
        ("form-factors box.obj --out f.npz --max-memory 0", "--max-memory"),
        ("form-factors box.obj --out f.npz --max-memory NaN", "max-memory"),
        ("form-factors box.obj --out nowhere/f.npz", "nowhere/f.npz"),
    ] {
        refused(&scratch.mrvis(arguments), word);
    }
}

#[test]
fn reflectances_of_one_are_clamped_by_name() {
    let scratch = scratch();
    scratch.write("box.mtl", GLOW.replace("Kd 0.5 0.5", "Kd 1 1.5"));
    for arguments in [
        format!("solve box.obj --out s --output none {ROUGH}"),
        "reference box.obj --points points.csv --samples 4 --out a.csv".to_owned(),
    ] {
        let outcome = scratch.mrvis(&arguments).exits(0);
        let said = outcome.stdout + &outcome.stderr;
        assert!(said.contains("clamped") && said.contains("`glow`"), "{said}");
    }
}

#[test]
fn form_factors_of_a_box_are_the_closed_forms() {
    let scratch = scratch();
    scratch.mrvis("form-factors box.obj --out f.csv --json f.json --tolerance 1e-3").exits(0);
    let text = scratch.text("f.csv");
    let entry = |from: &str, to: &str| -> f64 {
        let start = format!("{from},{to},");
        let line = text.lines().find_map(|l| l.strip_prefix(&start)).expect("an entry");
        line.split(',').next().and_then(|f| f.parse().ok()).expect("a factor")
    };
    // Unit cube: floor and ceiling, floor and wall.
    assert!((entry("0", "1") / 0.199825 - 1.0).abs() < 1e-3);
    assert!((entry("0", "2") / 0.200044 - 1.0).abs() < 1e-3);
    let report = &scratch.json("f.json")["report"];
    assert_eq!(report["closed_rows"], 6);
    assert!(report["reciprocity_residual"].as_f64().is_some_and(|r| r < 1e-6));
    let town = scratch.generate(&Spec { count: Some(120), ..Spec::new("urban-block") });
    for out in ["g.npz", "g.mtx"] {
        scratch.mrvis(&format!("form-factors {town} --by material --out {out} --quiet")).exits(0);
        assert!(scratch.path(out).exists());
    }
}

/// Points alone need no light of elements: the error is theirs. Other estimates have the interval of their source.
#[test]
fn errors_are_those_of_what_is_asked_for() {
    let scratch = scratch();
    let at_points = "solve box.obj --out s --error 0.2 --points points.csv";
    for more in ["", "--direct-only"] {
        scratch.mrvis(&format!("{at_points} {more}")).exits(0).prints("2 points: minimum");
        let record = scratch.json("s/solution.json");
        assert!(record["error_estimate_source"] == "points" && record["audit"].is_null(), "{record}");
        assert_eq!(record["error_estimate"], record["points_error"]["rms"]);
        assert_eq!(record["at_points"]["count"], 2);
        assert_eq!(record["ledger"]["absorbed"].is_null(), !more.is_empty());
    }
    let solve = format!("{at_points} --min-area 1e-3 --output vtu");
    scratch.mrvis(&solve).exits(0).prints("estimated error");
    let record = scratch.json("s/solution.json");
    assert_eq!(record["error_estimate_source"], "audit");
    let [estimate, upper] = ["error_estimate", "error_estimate_upper"].map(|key| record[key].as_f64());
    assert!(estimate.is_some() && estimate <= upper, "{estimate:?} {upper:?}");
    // The interval of an audit that is too small for an estimate is not that of the estimate.
    scratch.mrvis(&format!("{solve} --audit 20")).exits(0);
    assert!(scratch.json("s/solution.json")["error_estimate_upper"].is_null());
}

#[test]
fn a_solution_is_shown() {
    let scratch = scratch();
    let shown = "--output ply,glb,vtu,lightmap,image --image-size 64x48 --quiet";
    scratch
        .mrvis(&format!("solve box.obj --out s {shown} --audit 0 --min-area 1e-3 --local-rays 300000"))
        .exits(0);
    let begins = |name: &str, with: &[u8]| {
        let file = std::fs::read(scratch.path("s").join(name)).expect(name);
        assert!(file.starts_with(with), "{name}");
    };
    begins("solution.ply", b"ply\n");
    begins("solution.glb", b"glTF");
    begins("solution.vtu", b"<?xml");
    begins("view.png", b"\x89PNG");
    begins("lightmap.exr", b"\x76\x2f\x31\x01");
    begins("view.exr", b"\x76\x2f\x31\x01");
    // Furnace: all visible surfaces have radiosity 1 + 0.5 · 2 = 2.
    let image =
        mrvis::internals::image_io::read_image(&scratch.path("s").join("view.exr"), Default::default(), 1.0)
            .expect("an image");
    let want = 2.0 / std::f32::consts::PI;
    let seen: Vec<f32> = image.data().iter().copied().filter(|&v| v > 0.0).collect();
    assert!(seen.len() > 64 * 48 / 10, "{} pixels", seen.len());
    assert!(seen.iter().filter(|&&v| (v / want - 1.0).abs() < 0.02).count() > seen.len() * 8 / 10);
    scratch.mrvis("solve box.obj --out s --camera 0,0,0,0,0,0,40").exits(2).warns("camera");
}

/// A closed room with a lamp in one half and an opaque wall whose foot is not on a line of subdivision: from the other half nothing is
/// seen, and from the lit half no edge of the wall is dark.
#[test]
fn walls_are_black_from_their_dark_side() {
    let scratch = Scratch::new();
    let corners = "v 0 0 0\nv 6 0 0\nv 6 4 0\nv 0 4 0\nv 0 0 3\nv 6 0 3\nv 6 4 3\nv 0 4 3\nv 3.037 0 0\nv 3.037 4 0\nv 3.037 4 3\n\
        v 3.037 0 3\nv 1 1.5 2.95\nv 1 2.5 2.95\nv 2 2.5 2.95\nv 2 1.5 2.95\n";
    let faces = "f 1 2 3 4\nf 5 8 7 6\nf 1 4 8 5\nf 2 6 7 3\nf 1 5 6 2\nf 4 3 7 8\no wall\nf 9 10 11 12\nusemtl lamp\nf 13 14 15 16\n";
    scratch.write("room.mtl", "newmtl grey\nKd .6 .6 .6\nnewmtl lamp\nKd 0 0 0\nKe 50 50 50\n");
    scratch.write("room.obj", format!("mtllib room.mtl\n{corners}o room\nusemtl grey\n{faces}"));
    let solve = "solve room.obj --out s --output image --image-size 128x96 --error 0.1 --audit 0 --quiet";
    let seen = |camera: &str| {
        scratch.mrvis(&format!("{solve} --camera {camera}")).exits(0);
        let path = scratch.path("s").join("view.exr");
        mrvis::internals::image_io::read_image(&path, Default::default(), 1.0).expect("an image")
    };
    assert!(seen("5.5,2,1.5,3,2,1.5,80").data().iter().all(|&v| v == 0.0));
    let lit = seen("0.5,2,2.5,3.037,2,0,60");
    let mean = lit.data().iter().sum::<f32>() / lit.data().len() as f32;
    assert!(lit.data().iter().all(|&v| v > 0.3 * mean), "{mean}");
}

#[test]
fn a_missed_target_is_told_by_the_exit_code() {
    let scratch = scratch();
    let scene = scratch.generate(&Spec::new("cornell"));
    let solve = |target: &str, links: &str| {
        let limits = format!("--target-error {target} --max-links {links} --local-rays 20000 --audit 10");
        scratch.mrvis(&format!("solve {scene} --unit mm --min-area 1e-3 --out s --output none {limits}"))
    };
    let missed = solve("1e-6", "2000").exits(1);
    missed.prints("--target-error 0.000001 was missed").prints("--max-links 2000 ended refinement");
    let record = scratch.json("s/solution.json");
    assert!(record["target_met"] == false && record["ended"] == "links", "{record}");
    // Watts, although lengths are in millimetres.
    assert!(missed.stdout.contains(" W, absorbed ") && record["ledger"]["unit"] == "W", "{}", missed.stdout);
    solve("0.9", "1000000").exits(0);
}

#[test]
fn engines_are_compared_at_points() {
    let scratch = scratch();
    let solve = "solve box.obj --out s --points points.csv --compare mr --json v.json";
    let outcome = scratch.mrvis(&format!("{solve} --cache off --output none {ROUGH}")).exits(0);
    let json = scratch.json("v.json");
    let versus = &json["versus"];
    assert!(versus["visibility"] == "mr" && versus["difference"]["points"] == 2, "{versus}");
    assert!(versus["speedup"].as_f64().is_some_and(|s| s > 0.0));
    assert!(versus["difference"]["rms"].as_f64().is_some_and(|rms| rms < 0.01), "{versus}");
    outcome.prints("times as long as exact");
    // `--compare` needs points.
    scratch.mrvis("solve box.obj --out s --compare mr").exits(2).warns("--points");
}

/// Without time for gathering, pixels show the light of elements, with a note.
#[test]
fn pictures_are_whole_when_time_is_short() {
    let scratch = scratch();
    let arguments = format!("solve box.obj --output image --image-size 640x480 {ROUGH}");
    let solve = |more: &str| scratch.mrvis(&format!("{arguments} {more}"));
    solve("--out plain").exits(0);
    solve("--out hurried --gather --error 0.001 --max-seconds 0.2")
        .exits(0)
        .prints("pixels is that of elements");
    let record = scratch.json("hurried/solution.json");
    assert!(record["warnings"].to_string().contains("--max-seconds 0.2: light at"), "{}", record["warnings"]);
    let names = |folder: &str| {
        let files = std::fs::read_dir(scratch.path(folder)).expect("a folder");
        let mut names: Vec<_> = files.map(|f| f.expect("a file").file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(names("plain"), names("hurried"));
    for folder in ["plain", "hurried"] {
        let picture = image::open(scratch.path(folder).join("view.png")).expect("a whole picture");
        assert_eq!((picture.width(), picture.height()), (640, 480));
    }
}

/// Luminous quantities are the weights times those of the channels, in every output.
#[test]
fn photometric_outputs() {
    let scratch = scratch();
    scratch.write(
        "lamp.ies",
        "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 3 1 1 2 0.1 0.1 0\n1 1 9\n0 45 90\n0\n90 60 0\n",
    );
    scratch
        .write("lights.toml", "[[luminaire]]\nfile = \"lamp.ies\"\nat = [0.5, 0.5, 0.9]\naim = [0, 0, -1]\n");
    scratch.write("bad.toml", "[[luminaire]]\nfile = \"lamp.ies\"\nat = [0.5]\naim = [0, 0, -1]\n");
    let lit = "dark.obj --luminaires lights.toml --photometric";
    scratch.mrvis(&format!("info {lit} --json i.json")).exits(0);
    // ∫ I 2π sin γ dγ of the linear table, by parts: 2π (90 − 30 sin 45° / (π/4) − 60 (1 − sin 45°) / (π/4)).
    let (half, step) = (0.5f64.sqrt(), std::f64::consts::FRAC_PI_4);
    let flux = 2.0 * std::f64::consts::PI * (90.0 - (30.0 * half + 60.0 * (1.0 - half)) / step);
    let found = scratch.json("i.json")["emitters"][0]["flux_lm"].as_f64().expect("a flux");
    assert!((found / flux - 1.0).abs() < 1e-5, "{found} instead of {flux} lm");
    let lit = format!("{lit} --points points.csv");
    scratch.mrvis(&format!("solve {lit} --out p --json s.json --audit 0 --local-rays 300000")).exits(0);
    scratch.mrvis(&format!("reference {lit} --samples 256 --out r.csv")).exits(0);
    for row in values(&scratch, "p/irradiance.csv").iter().chain(&values(&scratch, "r.csv")) {
        let lux = 179.0 * (0.2126 * row[0] + 0.7152 * row[1] + 0.0722 * row[2]);
        assert!((row[row.len() - 1] - lux).abs() < 1e-9 * lux, "{row:?}");
    }
    let json = scratch.json("s.json");
    let (lux, watts) = (&json["photometric"]["mean_illuminance_lx"], &json["mean_irradiance"][0]);
    assert!((lux.as_f64().unwrap() / watts.as_f64().unwrap() - 179.0).abs() < 1e-6, "{lux} {watts}");
    let ledger = &json["photometric"]["ledger"];
    assert_eq!(ledger["unit"], "lm");
    let emitted = ledger["emitted"].as_f64().expect("a power");
    assert!((emitted / flux - 1.0).abs() < 1e-5, "{emitted} of {flux} lm are emitted");
    scratch.mrvis("compare p/irradiance.csv r.csv --tolerance 0.2").exits(0);
    scratch.mrvis("info dark.obj --luminaires bad.toml").exits(2).warns("bad.toml:3: ");
}
