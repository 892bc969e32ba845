//! The page of a batch.

use super::front;
use super::*;
use crate::batch::table::RecordedGrid;
use serde_json::json;

fn row(value: serde_json::Value) -> Row {
    value.as_object().expect("an object").clone()
}

fn rows() -> Vec<Row> {
    let job = |error: f64, engine: &str, seconds: f64, found: f64| {
        row(json!({
            "job": format!("e{error}-{engine}"), "command": "solve", "scene": "a.obj", "status": "done",
            "option.error": error, "option.visibility": engine, "option.seed": 3,
            "job_seconds": seconds, "output_bytes": 1000, "compared.rms": found,
        }))
    };
    let failed = json!({ "job": "bad", "command": "solve", "scene": "a.obj", "status": "failed", "error_message": "a < b", "job_seconds": 1.0 });
    vec![job(0.1, "exact", 1.0, 0.2), job(0.05, "exact", 2.0, 0.1), job(0.1, "mr", 0.5, 0.3), row(failed)]
}

#[test]
fn the_page_has_all_jobs_and_refers_to_nothing() {
    let picture = |file: &str| JobPicture {
        job: "e0.1-mr".into(),
        file: file.into(),
        size: [800, 600],
        picture: Picture { width: 1, height: 1, pixels: vec![[1, 2, 3]] },
    };
    let pictures =
        ["view.png", "grid-floor.png", "floor-mask-0.5.png", "floor-mr-0.5-difference.png"].map(picture);
    let grid = RecordedGrid {
        name: "desk <a>".into(),
        columns: 8,
        rows: 4,
        height: 0.75,
        unit: "lx".into(),
        minimum: 120.0,
        mean: 300.0,
        maximum: 456.0,
        uniformity: Some(0.4),
    };
    let report = Report {
        name: "out",
        grids: &[JobGrid { job: "e0.1-mr".into(), grid }],
        rows: &rows(),
        jobs_in_all: 6,
        faults: &["c: x.png was changed".into()],
        pictures: &pictures,
        unreadable: &["b.png: gone".into()],
        pictures_in_all: 6,
    };
    let page = report_page(&report).expect("a page");
    for part in [
        "3</strong> of <strong>6</strong> jobs",
        "c: x.png was changed",
        "a &lt; b",
        "by error and visibility",
        "by visibility and error",
        "Pareto front",
        "4 of 6 pictures",
        "e0.1-mr: picture, view.png, 800 × 600 pixels",
        "e0.1-mr: light on a grid of points, grid-floor.png",
        "desk &lt;a&gt;",
        "8 × 4",
        "0.40",
        "e0.1-mr: mask of features larger than 0.5 scene units, floor-mask-0.5.png",
        "e0.1-mr: difference from the reference, floor-mr-0.5-difference.png",
        "A picture cannot be read: b.png: gone",
        "data-value=\"0.05\"",
    ] {
        assert!(page.contains(part), "lacks {part}");
    }
    // The seed does not differ.
    assert!(!page.contains("and seed") && !page.contains("data-name=\"seed\""));
    for outside in ["http://", "https://", "src=\"/", "url(", "@import"] {
        let text = page.replace("http://www.w3.org/2000/svg", "");
        assert!(!text.contains(outside), "{outside}");
    }
}

#[test]
fn charts_of_differences_name_the_noise_of_the_reference() {
    let job = |error: f64, rms: f64| {
        row(json!({
            "job": format!("e{error}"), "scene": "a.obj", "status": "done", "option.error": error, "job_seconds": 1.0 / error,
            "compared.rms": rms, "compared.noise": 0.0125,
        }))
    };
    let rows = [job(0.1, 0.2), job(0.05, 0.1)];
    let report = Report { name: "out", rows: &rows, jobs_in_all: 2, ..Report::default() };
    let page = report_page(&report).expect("a page");
    // Estimates have no charts.
    let estimated = rows.clone().map(|mut row| {
        row.insert("error_estimate".into(), row["compared.rms"].clone());
        row.remove("compared.rms");
        row
    });
    assert!(charts(&rows).expect("charts").1 == 1 && charts(&estimated).expect("charts").1 == 0);
    assert!(page.contains("Each difference includes the noise of the reference, 0.0125."), "{page}");
}

#[test]
fn the_page_says_how_many_charts_it_leaves_out() {
    let names = "abcdefgh".chars();
    let jobs = [1.0, 2.0].map(|k| {
        let options = names.clone().map(|name| (format!("option.{name}"), json!(k)));
        let fixed = json!({ "job": format!("j{k}"), "scene": "a.obj", "status": "done", "job_seconds": k, "compared.rms": 0.1 / k });
        row(fixed).into_iter().chain(options).collect::<Row>()
    });
    let report = Report { name: "out", rows: &jobs, jobs_in_all: 2, ..Report::default() };
    assert!(report_page(&report).expect("a page").contains("40 of 56 charts"));
}

#[test]
fn a_batch_without_jobs_has_a_page() {
    let report = Report { name: "out", ..Report::default() };
    assert!(report_page(&report).expect("a page").contains("0</strong> of <strong>0"));
}

#[test]
fn the_front_has_what_no_job_beats() {
    let found = front(&[[3.0, 0.1], [1.0, 0.5], [2.0, 0.6], [2.0, 0.2], [4.0, 0.1], [1.0, 0.7]]);
    assert_eq!(found, [[1.0, 0.5], [2.0, 0.2], [3.0, 0.1]]);
}
