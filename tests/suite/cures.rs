//! Errors and warnings name the cure that helps.

use crate::hostile::{IES, LIBRARY, LIGHTS, SCENE, quick, refused, scratch};
use crate::run::Scratch;

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
