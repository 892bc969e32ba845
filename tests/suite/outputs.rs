//! Outputs replace neither inputs nor each other.

use crate::hostile::{IES, LIBRARY, LIGHTS, POINTS, SCENE, quick, refused, scratch};
use crate::run::words;

/// An output never replaces a file that the command reads.
#[test]
fn inputs_are_not_replaced() {
    let scratch = scratch();
    scratch.write("lightmap.obj", SCENE);
    scratch.write("report.obj", SCENE.replace("scene.mtl", "solution.json"));
    scratch.write("solution.json", LIBRARY);
    scratch.write("lamp.ies", IES);
    scratch.write("lights.toml", LIGHTS);
    let calls = [
        "solve lightmap.obj --out . --output lightmap",
        "solve report.obj --out .",
        "reference scene.obj --points points.csv --samples 4 --out points.csv",
        "reference scene.obj --points points.csv --samples 4 --out ./scene.mtl",
        "info scene.obj --json scene.obj",
        "info scene.obj --json scene.mtl",
        "form-factors scene.obj --out f.csv --json scene.obj",
        "info scene.obj --luminaires lights.toml --json lights.toml",
        "info scene.obj --luminaires lights.toml --json lamp.ies",
        "solve scene.obj --luminaires lights.toml --out o --json ./lamp.ies",
        "form-factors scene.obj --luminaires lights.toml --out lamp.csv --json lights.toml",
    ];
    for call in calls {
        refused(&scratch.mrvis(&words(call)), "would be replaced");
    }
    assert_eq!(scratch.text("points.csv"), POINTS);
    for (name, text) in
        [("scene.obj", SCENE), ("lightmap.obj", SCENE), ("lamp.ies", IES), ("lights.toml", LIGHTS)]
    {
        assert_eq!(scratch.text(name), text);
    }
    // Other outputs of the same folder are no danger.
    scratch.mrvis("solve lightmap.obj --out . --output none --points points.csv").exits(0);
}

/// Inputs with names like those of outputs are no reason to refuse.
#[test]
fn files_that_are_not_written_are_no_reason_to_refuse() {
    let scratch = scratch();
    for name in ["view.obj", "viewer.obj", "lightmap.x.obj"] {
        scratch.write(name, SCENE);
        let image = "--output image,lightmap --image-size 16x12 --lightmap-texels 256";
        scratch.mrvis(&format!("solve {name} --out . {image} --audit 0 --local-rays 0")).exits(0);
    }
    // A texture of one red pixel.
    scratch.write("wood.png", {
        let mut png = std::io::Cursor::new(Vec::new());
        image::RgbImage::from_pixel(1, 1, image::Rgb([255, 0, 0]))
            .write_to(&mut png, image::ImageFormat::Png)
            .expect("encoded");
        png.into_inner()
    });
    scratch.write("scene.mtl", LIBRARY.replace("Kd 0.5 0.5 0.5", "map_Kd wood.png"));
    let textured = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4";
    scratch.write("scene.obj", SCENE.replace("f 1 2 3 4", textured));
    scratch.mrvis("info scene.obj --json r.json").exits(0);
    assert_eq!(scratch.json("r.json")["scene"]["files"].as_array().map(Vec::len), Some(3));
    scratch.mrvis(&quick("bench scene.obj --out .")).exits(0);
    // The picture of a receiver is written.
    std::fs::copy(scratch.path("wood.png"), scratch.path("floor-reference.png")).expect("copied");
    scratch.write("scene.mtl", LIBRARY.replace("Kd 0.5 0.5 0.5", "map_Kd floor-reference.png"));
    refused(&scratch.mrvis(&quick("bench scene.obj --out .")), "would be replaced");
}

/// Two outputs in one place would leave one of them.
#[test]
fn outputs_do_not_replace_each_other() {
    let scratch = scratch();
    let calls = [
        "form-factors scene.obj --out x.csv --json x.csv",
        "form-factors scene.obj --out x.csv --json ./cache/../x.csv",
        "reference scene.obj --points points.csv --samples 4 --out x.csv --json x.csv",
        "solve scene.obj --out o --output vtu --json o/solution.vtu",
        "solve scene.obj --out o --output none --json o/solution.json",
        "solve scene.obj --out o --output image --json o/view.exr",
        "bench scene.obj --out o --json o/report.html",
        "generate cornell --out g.obj --json g.obj",
        "generate cornell --out g.obj --json g.mtl",
    ];
    std::fs::create_dir_all(scratch.path("cache")).expect("a folder");
    for call in calls {
        refused(&scratch.mrvis(&words(call)), "--out and --json would replace");
    }
    for name in ["x.csv", "o/solution.vtu", "o/report.html", "g.obj"] {
        assert!(!scratch.path(name).exists(), "{name}");
    }
}

/// The page of a benchmark states all options of its run.
#[test]
fn the_page_of_a_benchmark_repeats_its_command_line() {
    let scratch = scratch();
    let more = quick("--emitter lamp=100 --two-sided-emission --tolerance 0.1 --audit 0.5 --sides 2");
    let call = [&["bench", "scene.obj", "--out", "o o"][..], &more].concat();
    scratch.mrvis(&call).exits(0);
    let page = scratch.text("o o/report.html");
    let command = format!("mrvis {}", call.join(" ").replace("o o", "&#39;o o&#39;"));
    assert!(page.contains(&command) || page.contains(&command.replace("&#39;", "'")), "{command}");
}

/// An option without effect is refused and not offered.
#[test]
fn commands_without_light_have_no_photometric_option() {
    let scratch = scratch();
    for (command, line) in [("bench", "scene.obj"), ("form-factors", "scene.obj --out f.csv")] {
        let call = scratch.mrvis(&format!("{command} {line} --photometric"));
        refused(&call, "--photometric has no effect");
        let help = scratch.mrvis(&[command, "--help"]);
        assert!(!help.stdout.contains("--photometric"), "{}", help.stdout);
    }
    assert!(scratch.mrvis("solve --help").stdout.contains("--photometric"));
}

/// Progress is for terminals: a file that receives the messages of a command holds lines of text only.
#[test]
fn there_is_no_progress_in_a_pipe() {
    let scratch = scratch();
    // Several seconds: progress is shown after one second.
    let told = scratch.mrvis("reference scene.obj --points points.csv --samples 500000 --out r.csv").exits(0);
    let control = |text: &str| text.chars().any(|c| c.is_control() && c != '\n');
    assert!(!control(&told.stderr) && !control(&told.stdout), "{:?} {:?}", told.stderr, told.stdout);
}
