//! The command line as a contract. Exit codes: 0 done, 1 done but a tolerance was missed, 2 error with one line on
//! stderr.

use crate::hostile::{self, SCENE, quick, refused};
use crate::run::{Scratch, words};
use std::time::{Duration, Instant};

fn scratch() -> Scratch {
    let scratch = hostile::scratch();
    scratch.write("dark.obj", SCENE.replace("mtllib scene.mtl\n", ""));
    scratch.write("empty.obj", "");
    scratch.write("broken.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n");
    scratch.write("noise.obj", [0xff, 0xfe, 0x00, 0x81].repeat(500));
    scratch.write("file", "not a folder");
    scratch
}

/// Calls that must fail, each with a word of the message, before long work.
fn check_refused(cases: &[(&str, &str)]) {
    let scratch = scratch();
    for (line, word) in cases {
        let start = Instant::now();
        refused(&scratch.mrvis(*line), word);
        assert!(start.elapsed() < Duration::from_secs(20), "mrvis {line} works long before it refuses");
    }
}

#[test]
fn scenes_that_cannot_be_used_are_refused() {
    check_refused(&[
        ("bench missing.obj", "missing.obj"),
        ("bench empty.obj", "empty.obj"),
        ("bench broken.obj", "broken.obj:3"),
        ("bench noise.obj", "noise.obj"),
        ("bench file", "file"),
        ("bench .", "."),
        ("bench dark.obj", "--emitter NAME=W"),
        ("bench dark.obj --emitter nothing=10", "nothing"),
        ("bench dark.obj --emitter floor", "NAME=W"),
        ("bench dark.obj --emitter floor=-1", "floor=-1"),
        ("bench dark.obj --emitter floor=NaN", "floor=NaN"),
        ("bench scene.obj --receiver nowhere", "nowhere"),
    ]);
}

#[test]
fn options_out_of_range_are_refused() {
    check_refused(&[
        ("bench scene.obj --feature-size 0", "feature-size"),
        ("bench scene.obj --feature-size=-1", "feature-size"),
        ("bench scene.obj --feature-size NaN", "feature-size"),
        ("bench scene.obj --feature-size inf", "feature-size"),
        ("bench scene.obj --feature-size 1e-300", "feature-size"),
        ("bench scene.obj --feature-size 1e300", "feature-size"),
        ("bench scene.obj --feature-size wide", "feature-size"),
        ("bench scene.obj --feature-size 0.1 --feature-size NaN", "feature-size"),
        ("bench scene.obj --points 0", "points"),
        ("bench scene.obj --points 1000000000000", "points"),
        ("bench scene.obj --points=-5", "points"),
        ("bench scene.obj --rays 0", "rays"),
        ("bench scene.obj --rays 100000", "rays"),
        ("bench scene.obj --rays 1000000000000", "rays"),
        ("bench scene.obj --reference-rays 0", "reference-rays"),
        ("bench scene.obj --reference-rays 1000000000000", "reference-rays"),
        ("bench scene.obj --audit 2", "audit"),
        ("bench scene.obj --audit=-0.1", "audit"),
        ("bench scene.obj --audit NaN", "audit"),
        ("bench scene.obj --tolerance 0", "tolerance"),
        ("bench scene.obj --tolerance 1.5", "tolerance"),
        ("bench scene.obj --tolerance NaN", "tolerance"),
        ("bench scene.obj --extinction guessed", "extinction"),
        ("bench scene.obj --map 1000000000000", "map"),
        ("bench scene.obj --threads 1000000000000", "threads"),
        ("bench scene.obj --seed x", "seed"),
        ("bench scene.obj --no-such-option", "no-such-option"),
        ("bench scene.obj --threads 1025", "1024"),
        ("solve scene.obj --out o --threads 1025", "1024"),
        ("bench", "mrvis"),
        ("no-such-command", "no-such-command"),
        ("", "mrvis"),
    ]);
}

#[test]
fn outputs_that_cannot_be_written_are_refused() {
    check_refused(&[
        ("bench scene.obj --points 20 --reference-rays 16 --out file", "file"),
        ("bench scene.obj --points 20 --reference-rays 16 --out file/folder", "file"),
        ("bench scene.obj --points 20 --reference-rays 16 --json file/x.json", "x.json"),
        ("bench scene.obj --points 20 --reference-rays 16 --json none/x.json", "x.json"),
        ("bench scene.obj --points 20 --cache file", "file"),
    ]);
}

#[test]
fn other_commands_refuse_alike() {
    check_refused(&[
        ("fbem missing.png missing.png", "missing.png"),
        ("fbem scene.obj scene.obj", "scene.obj"),
        ("info missing.obj", "missing.obj"),
        ("info empty.obj", "empty.obj"),
        ("generate no-such-scene --out x.obj", "no-such-scene"),
        ("generate forest --trees 0 --out x.obj", "trees"),
        ("generate cornell --out file/x.obj", "file/x."),
        ("generate cornell --out x.glb", "must end in .obj"),
        ("generate cornell --instances --out x.glb", "--instances: `cornell` has none"),
        ("generate forest --instances --out x.obj", "must end in .gltf or .glb"),
        ("generate forest --species 2 --out x.glb", "--instances"),
    ]);
}

#[test]
fn help_and_version_are_no_errors() {
    let scratch = scratch();
    for arguments in ["--help", "--version", "bench --help", "fbem --help"] {
        let outcome = scratch.mrvis(arguments);
        assert_eq!(outcome.code, Some(0), "{arguments:?}: {}", outcome.stderr);
        assert!(!outcome.stdout.is_empty() && outcome.stderr.is_empty(), "{arguments:?}");
    }
    let help = scratch.mrvis("bench --help").stdout;
    let options = "--feature-size --rays --points --receiver --map --reference-rays --out --cache";
    let common = "--threads --seed --json --quiet --unit --emitter";
    for option in [words(options), words(common)].concat() {
        assert!(help.contains(option), "`mrvis bench --help` does not know {option}");
    }
}

/// A missed tolerance is exit code 1, not an error.
#[test]
fn missed_tolerances_are_exit_code_1() {
    let scratch = scratch();
    for (name, value) in [("black.png", 0u8), ("white.png", 255)] {
        image::GrayImage::from_pixel(32, 32, image::Luma([value])).save(scratch.path(name)).expect("written");
    }
    scratch.mrvis("fbem black.png black.png --tolerance 0").exits(0);
    scratch.mrvis("fbem white.png black.png --tolerance 0.5").exits(1);
    // With `--json -` the JSON is the only text on standard output.
    let piped = scratch.mrvis("fbem white.png black.png --json -");
    let json: serde_json::Value = serde_json::from_str(&piped.stdout).expect("JSON");
    assert!(
        json["l2"].as_f64().is_some_and(|e| e > 0.9) && piped.stderr.contains("FBEM"),
        "{}",
        piped.stdout
    );
    assert!(!scratch.path("-").exists());
}

/// The fields of docs/report.md, section The JSON, on a scene of three triangles, without network or terminal.
#[test]
fn bench_writes_what_it_promises() {
    let scratch = scratch();
    scratch.mrvis(&quick("bench scene.obj --json r.json --out report --feature-size 0.1")).exits(0);
    let json = scratch.json("r.json");
    let keys = [
        ("", "mrvis embree threads isa unit"),
        ("/scene", "path triangles objects emitters closed_parts sheet_parts clusters levels"),
        ("/build", "load_s embree_s hierarchy_s characterise_s hierarchy_bytes embree_bytes"),
        ("/build/bytes_per_triangle", "scene hierarchy traits wide embree total"),
        ("/workload", "points rays segments reference_rays reference_rms"),
        ("/exact/0", "rays seconds mode rms bias"),
        (
            "/mr/0",
            "feature_size rays seconds rms bias interval_coverage aggregated_fraction exact_rays nodes_per_segment speedup_per_segment speedup_at_same_rms speedup_at_same_fbem compared_with speedup_over_plain_exact route",
        ),
        ("/classes/0", "class points measured reference_rms exact certified mr"),
        ("/classes/0/exact/0", "rays seconds mode rms bias"),
        ("/classes/0/mr/0", "feature_size rays seconds rms bias speedup_at_same_rms route"),
        ("/receivers/0", "name width height texel l2 fbem"),
        ("/receivers/0/fbem/0", "feature_size exact16 mr"),
    ];
    holds(&json, &keys);
    holds(&json, &MAP_FIELDS);
    assert_eq!(json["maps"][0]["width"], 16);
    assert_eq!(json["scene"]["triangles"], 3);
    assert_eq!(json["workload"]["points"], 20);
    assert_eq!(json["threads"], 1, "single thread unless told otherwise");
    let rays: Vec<u64> =
        json["exact"].as_array().expect("rows").iter().map(|r| r["rays"].as_u64().expect("rays")).collect();
    assert_eq!(rays, [1, 4, 16, 64, 256]);
    let page = scratch.text("report/report.html");
    for sign in ["src=\"http", "href=\"http", "url(http", "@import"] {
        assert!(!page.contains(sign), "the page needs a network: {sign}");
    }
    // The floor sees the whole emitter: both engines are exact.
    for row in json["exact"].as_array().into_iter().chain(json["mr"].as_array()).flatten() {
        assert_eq!(row["rms"], 0.0, "{row}");
        assert_eq!(row["bias"], 0.0, "{row}");
        // Intervals of certain answers contain the reference.
        assert!(row.get("interval_coverage").is_none_or(|c| *c == 1.0), "{row}");
    }
    let quiet = scratch.mrvis(&quick("bench scene.obj --quiet"));
    assert_eq!((quiet.code, quiet.stdout.as_str(), quiet.stderr.as_str()), (Some(0), "", ""));
}

/// Fields of maps, by place.
const MAP_FIELDS: [(&str, &str); 3] = [
    ("/maps/0", "receiver width height texel reference_rays reference_rms"),
    ("/maps/0/exact/0", "rays spacing interpolated seconds rms bias"),
    (
        "/maps/0/mr/0",
        "feature_size rays seconds setup_s rms bias fbem speedup_at_same_rms speedup_with_setup speedup_over_texels speedup_at_same_fbem",
    ),
];

/// The JSON has all these fields, by place.
fn holds(json: &serde_json::Value, keys: &[(&str, &str)]) {
    for (place, names) in keys {
        let at = json.pointer(place).unwrap_or_else(|| panic!("the JSON has no {place}"));
        for name in words(names) {
            assert!(at.get(name).is_some(), "the JSON has no {place}/{name}");
        }
    }
}

/// An emitter can be added by name.
#[test]
fn emitters_can_be_added() {
    let scratch = scratch();
    scratch.mrvis(&quick("bench dark.obj --emitter lamp=100 --json r.json --quiet")).exits(0);
    assert_eq!(scratch.json("r.json")["scene"]["emitters"], 1);
}

/// `info` counts stored and visible triangles of a forest of instances.
#[test]
fn forests_of_instances_are_counted() {
    let scratch = scratch();
    let call = "generate forest --instances --species 2 --trees 40 --leaves 50";
    for name in ["made.gltf", "made.glb"] {
        scratch.mrvis(&format!("{call} --out {name} --json made.json")).exits(0);
        let facts = scratch.json("made.json");
        assert_eq!((&facts["instances"], &facts["species"]), (&40.into(), &2.into()));
        assert_eq!((&facts["polygons"], &facts["visible_polygons"]), (&102.into(), &2002.into()));
        scratch.mrvis(&format!("info {name} --json info.json")).exits(0).prints("instances").prints("4,004");
        let scene = &scratch.json("info.json")["scene"];
        assert_eq!((&scene["instances"], &scene["shared_meshes"]), (&40.into(), &2.into()));
        assert_eq!((&scene["stored_triangles"], &scene["visible_triangles"]), (&204.into(), &4004.into()));
    }
    let told = scratch.mrvis("info scene.obj --json info.json").exits(0);
    assert!(
        scratch.json("info.json")["scene"].get("instances").is_none() && !told.stdout.contains("instances")
    );
}
