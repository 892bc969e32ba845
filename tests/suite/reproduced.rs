//! `mrvis reproduce`, and clusters by other builders.

use crate::hostile::refused;
use crate::run::Scratch;
use mrvis::internals::scene::generate::Spec;
use serde_json::Value;

/// The items asked for are made: page, record, exit code and text agree.
#[test]
fn items_are_made_with_a_page_and_numbers() {
    let scratch = Scratch::new();
    let call = ["reproduce", "--only", "fig3", "--only", "fig5", "--out", "paper", "--json", "all.json"];
    scratch.mrvis(&call).exits(0).prints("2 of 2 verdicts hold");
    let record = scratch.json("paper/reproduce.json");
    assert_eq!(record, scratch.json("all.json"));
    let items = record["items"].as_array().expect("items");
    assert_eq!(items.iter().map(|item| &item["name"]).collect::<Vec<_>>(), ["fig3", "fig5"]);
    for item in items {
        assert_eq!(item["holds"], true);
        let checks = item["checks"].as_array().expect("checks");
        assert!(
            !checks.is_empty()
                && checks.iter().all(|check| check["holds"] == true && check["reason"].is_null())
        );
    }
    // Tables and charts are numbers with units.
    let table = &items[1]["tables"][0];
    assert_eq!((&table["columns"][1]["name"], &table["columns"][1]["unit"]), (&"d1".into(), &"m".into()));
    assert!(table["rows"].as_array().is_some_and(|rows| rows.iter().all(|row| row[1].is_f64())));
    let points = &items[1]["charts"][0]["charts"][0]["series"][0]["points"];
    assert!(points.as_array().is_some_and(|points| points.len() > 2 && points[0][1].is_f64()));
    let page = scratch.text("paper/paper.html");
    for text in ["2 of 2", "Figure 3", "Figure 5", "--only fig3 --only fig5"] {
        assert!(page.contains(text), "{text}");
    }
    assert!(!page.contains("src=\"http") && !page.contains("Figure 9"));
    // A second run, of the item that takes less time, replaces the files of the first.
    scratch.mrvis("reproduce --only fig5 --out paper --quiet").exits(0);
    assert_eq!(scratch.json("paper/reproduce.json")["items"].as_array().map(Vec::len), Some(1));
}

/// Unknown items, unusable folders, and outputs that would replace inputs are refused before anything is made.
#[test]
fn what_cannot_be_made_is_refused() {
    let scratch = Scratch::new();
    scratch.write("reproduce.json", "an input");
    scratch.write("file", "not a folder");
    let calls: [(&[&str], &str); 3] = [
        (&["reproduce", "--only", "fig99", "--out", "paper"], "fig99"),
        (
            &["reproduce", "--only", "fig3", "--json", "paper/reproduce.json", "--out", "paper"],
            "reproduce.json",
        ),
        (&["reproduce", "--only", "fig3", "--out", "file"], "file"),
    ];
    for (call, word) in calls {
        refused(&scratch.mrvis(call), word);
    }
    assert_eq!(scratch.text("reproduce.json"), "an input");
    assert!(!scratch.path("paper").exists());
}

/// A builder is named in the JSON of `info`, `bench` and `solve`, changes the clusters, and leaves exact answers as they are.
#[test]
fn builders_change_clusters_and_no_exact_answer() {
    let scratch = Scratch::new();
    let scene = scratch.generate(&Spec { count: Some(60), ..Spec::new("cubes") });
    scratch
        .write("points.csv", "x,y,z,nx,ny,nz\n0,0,0.001,0,0,1\n0.5,0.3,0.001,0,0,1\n-0.4,0.6,0.001,0,0,1\n");
    let by = |builder: &str| -> [Value; 4] {
        let call = |line: &str| scratch.mrvis(&format!("{line} --builder {builder} --quiet")).exits(0);
        let json = |name: &str| format!("{builder}-{name}.json");
        let [info, bench, out] = ["info", "bench", "solve"].map(json);
        call(&format!("info {scene} --json {info}"));
        let quick = "--points 50 --rays 1 --reference-rays 8 --map 0 --rounds 1 --feature-size 1";
        call(&format!("bench {scene} --json {bench} {quick}"));
        let direct = "--points points.csv --direct-only --light-rays 64";
        call(&format!("solve {scene} --out {builder} --json {out} {direct}"));
        let irradiance = scratch.text(format!("{builder}/irradiance.csv"));
        [scratch.json(&info), scratch.json(&bench), scratch.json(&out), irradiance.into()]
    };
    let names = ["grids", "kdtree", "goldsmith-salmon", "sah"];
    let all = names.map(by);
    for (k, (name, [info, bench, solve, irradiance])) in names.iter().zip(&all).enumerate() {
        assert_eq!(info["scene"]["builder"], *name);
        assert_eq!(bench["build"]["builder"], *name);
        assert_eq!(solve["options"]["builder"], *name);
        assert!(bench["exact"][0]["rms"].is_f64());
        assert_eq!(bench["exact"][0]["rms"], all[0][1]["exact"][0]["rms"]);
        assert_eq!(irradiance, &all[0][3]);
        assert!(
            all[..k].iter().all(|other| other[0]["scene"]["clusters"] != info["scene"]["clusters"]),
            "{name}"
        );
    }
}
