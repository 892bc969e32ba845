//! `bench` under a sky: patches and suns are emitters.

use crate::hostile::refused;
use crate::run::Scratch;

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
