//! Tables and the page of a batch; the files in `examples/batch`.

use crate::install::project;
use crate::run::Scratch;
use mrvis::internals::scene::generate::Spec;
use serde_json::Value;

/// Every example runs, and its page has what it promises.
#[test]
fn the_example_of_a_comparison_runs() {
    check_examples(&["compare"]);
}

#[test]
#[ignore = "long: all examples"]
fn examples_run() {
    check_examples(&[]);
}

/// Runs these examples, or all, and lists the jobs of the others.
fn check_examples(only: &[&str]) {
    let folder = project("examples/batch");
    let scratch = Scratch::new();
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&folder).expect("the examples") {
        let path = entry.expect("an entry").path();
        if path.extension().is_none_or(|e| e != "toml") {
            continue;
        }
        let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
        let path = path.to_string_lossy().into_owned();
        let runs = only.is_empty() || only.contains(&&*name);
        let listed = if runs { &[][..] } else { &["--dry-run"] };
        let ran = scratch.mrvis(&[&["batch", &path, "--out", &name][..], listed].concat());
        assert_eq!(ran.code, Some(0), "{name}: {}{}", ran.stdout, ran.stderr);
        names.push(name.clone());
        if !runs {
            continue;
        }
        let made = scratch.mrvis(&format!("report {name}"));
        assert_eq!(made.code, Some(0), "{name}: {}", made.stderr);
        made.prints("report.html");
    }
    assert!(names.len() >= 3, "{names:?}");

    let page = scratch.text("compare/report.html");
    for part in
        ["Pareto front", "by visibility and error", "RMS difference from the reference", "data:image/png"]
    {
        assert!(page.contains(part), "the page lacks {part}");
    }
    let rows: Vec<Value> = scratch
        .text("compare/results.jsonl")
        .lines()
        .map(|l| serde_json::from_str(l).expect("JSON"))
        .collect();
    for row in rows.iter().filter(|row| row["command"] == "solve") {
        assert!(row["compared.rms"].as_f64().is_some_and(|rms| rms > 0.0), "{row}");
        assert!(row["seconds.solve"].is_number() && row["output_blake3"].is_string(), "{row}");
    }

    scratch.mrvis("report .").exits(2).warns("has no journal");
}

/// The example of the documentation, beside the scenes that it names.
#[test]
fn the_example_of_the_page_runs() {
    let page = include_str!("../../../docs/batch.md");
    let example =
        page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).expect("an example");
    let scratch = Scratch::new();
    scratch.write("jobs.toml", example);
    scratch.write("points.csv", include_str!("../../../examples/batch/points.csv"));
    std::fs::create_dir(scratch.path("rooms")).expect("made");
    for scene in ["hall", "rooms/a", "rooms/b"] {
        scratch.mrvis(&["generate", "cornell", "--out", &format!("{scene}.obj")]).exits(0);
    }
    scratch.mrvis("batch jobs.toml --out results --dry-run").prints("29 of 29 jobs, 29 to do");
    // All commands of the example, with one of the scenes, in the time that links alone take.
    let few = example
        .replace("\"rooms/*.obj\", ", "")
        .replace("\"160x120\"", "\"160x120\", audit = 0, local-rays = 0");
    scratch.write("jobs.toml", few);
    scratch.mrvis("batch jobs.toml --out results").exits(0).prints("13 jobs done");
}

/// Jobs that the file does not have any more are in no table and not on the page.
#[test]
fn jobs_of_a_former_file_are_not_shown() {
    let scratch = Scratch::new();
    scratch.write("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let jobs = |samples: &str| {
        let job = "[[job]]\nname = 'of-{samples}'\ncommand = 'info'\nscene = 'a.obj'\n[job.each]\nsamples = ";
        scratch.write("jobs.toml", format!("{job}{samples}\n"));
    };
    let run = |arguments: &[&str]| {
        scratch.mrvis(arguments).exits(0);
    };
    let shown = |file: &str| {
        let text = scratch.text(file);
        [1, 2, 3, 4].into_iter().filter(|n| text.contains(&format!("of-{n}"))).collect::<Vec<_>>()
    };
    let parts = [("1/2", "first"), ("2/2", "second"), ("1/2", "shared"), ("2/2", "shared")];
    for (samples, want) in [("[1, 2]", vec![1, 2]), ("[3, 4]", vec![3, 4])] {
        jobs(samples);
        run(&["batch", "jobs.toml", "--out", "o"]);
        run(&["report", "o"]);
        for (part, out) in parts {
            run(&["batch", "jobs.toml", "--out", out, "--shard", part]);
        }
        run(&["merge", "shared"]);
        run(&["merge", "first", "second", "--out", "merged"]);
        run(&["report", "merged"]);
        for file in [
            "o/results.csv",
            "o/report.html",
            "shared/results.csv",
            "merged/results.csv",
            "merged/report.html",
        ] {
            assert_eq!(shown(file), want, "{file}");
        }
    }
    run(&["merge", "o"]);
    assert_eq!(shown("o/results.csv"), [3, 4]);
}

/// Jobs of one scene have one camera: that of the file or of the defaults, unless a job states its own, or an automatic one that does not
/// depend on their light. The page shows their grids.
#[test]
fn jobs_of_a_scene_have_one_camera() {
    let scratch = Scratch::new();
    scratch.generate(&Spec::new("cornell"));
    let job = |name: &str, options: &str| {
        format!(
            "[[job]]\nname = '{name}'\ncommand = 'solve'\nscene = 'cornell.obj'\noptions = {{ {options} }}\n"
        )
    };
    let quick = "audit = 0, output = 'image', image-size = '32x32', cache = 'off', direct-only = true, grid = 'floor:200:80'";
    let jobs = job("dim", &format!("error = 0.4, {quick}"))
        + &job("bright", &format!("error = 0.3, emitter = 'light=900W', {quick}"))
        + &job("own", &format!("error = 0.4, camera = '278,273,-800,278,273,0,40', {quick}"))
        + &job("data", "error = 0.4, output = 'vtu'");
    let cameras = |defaults: &str| {
        scratch.write("jobs.toml", format!("{defaults}{jobs}"));
        let ran = scratch.mrvis("batch jobs.toml --out o --dry-run").exits(0);
        let lines = ran.stdout.lines().filter(|line| line.contains("mrvis solve"));
        let camera = |line: &str| {
            line.split(" --camera=").nth(1).map(|rest| rest.split(' ').next().map(str::to_owned))
        };
        lines.map(|line| camera(line).flatten().unwrap_or_default()).collect::<Vec<String>>()
    };
    let own = "278,273,-800,278,273,0,40";
    let all = "1,1,1,300,300,300,60";
    let defaults = format!("[defaults]\noptions = {{ camera = '{all}' }}\n");
    assert_eq!(cameras(&defaults), [all, all, own, all]);
    assert_eq!(cameras(""), ["scene", "scene", own, ""]);
    scratch.mrvis("batch jobs.toml --out o").exits(0);
    scratch.mrvis("report o").exits(0);
    let page = scratch.text("o/report.html");
    for part in ["Grids of points", "uniformity U0", "dim: light on a grid of points, grid-floor.png"] {
        assert!(page.contains(part), "the page lacks {part}");
    }
}

/// A picture that was removed is named on the page; the others are shown.
#[test]
fn the_page_names_pictures_that_are_gone() {
    let scratch = Scratch::new();
    scratch.generate(&Spec::new("cornell"));
    scratch.write(
        "jobs.toml",
        "[[job]]\nname = '{seed}'\ncommand = 'solve'\nscene = 'cornell.obj'\n\
         options = { error = 0.4, audit = 0, output = 'image', image-size = '32x32', cache = 'off' }\n[job.sweep]\nseed = [1, 2]\n",
    );
    scratch.mrvis("batch jobs.toml --out o").exits(0);
    std::fs::remove_file(scratch.path("o/1/view.png")).expect("removed");
    scratch.mrvis("report o").exits(1);
    let page = scratch.text("o/report.html");
    assert!(
        page.contains("1: view.png is missing: run the batch again") && page.contains("data:image/png"),
        "{page}"
    );
}
