//! The pages of `bench`, `solve` and `batch` in a headless browser: no text outside its box or over other text, nothing to scroll
//! sideways, at widths from a telephone to a desktop, light, dark and printed.

use crate::run::{Scratch, words};
use std::process::{Command, Stdio};

/// Widths in pixels, and media, at which each page is laid out. 700 pixels is A4 within its margins.
const VIEWS: [(u32, &str); 4] = [(1280, "light"), (400, "light"), (320, "dark"), (700, "print")];
/// More of them, for the test that takes long.
const MORE_VIEWS: [(u32, &str); 3] = [(1280, "dark"), (1000, "light"), (641, "light")];

/// What is wrong with the layout of these pages (names and HTML) at these widths and media.
fn problems(pages: &[(&str, String)], views: &[(u32, &str)]) -> Vec<String> {
    let browser = ["chromium", "chromium-browser", "google-chrome"].into_iter().find(|name| {
        Command::new(name).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
    });
    let browser =
        browser.expect("Chromium; `.ci/debian-packages chromium` installs it, and `make test` does so");
    let count = pages.len();
    let pages: Vec<_> =
        pages.iter().map(|(name, html)| serde_json::json!({"name": name, "html": html})).collect();
    let number = views.len() * count;
    let views: Vec<_> =
        views.iter().map(|(width, media)| serde_json::json!({"width": width, "media": media})).collect();
    // A page must not end the script that holds it.
    let json =
        |values: Vec<serde_json::Value>| serde_json::Value::from(values).to_string().replace("</", "<\\/");
    let script = format!(
        "const PAGES = {};\nconst VIEWS = {};\n{}",
        json(pages),
        json(views),
        include_str!("pages/layout.js")
    );
    let folder = Scratch::new();
    folder.write("check.html", format!("<!DOCTYPE html><meta charset=utf-8><body><script>{script}</script>"));
    let output = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .args(["--disable-dev-shm-usage", "--virtual-time-budget=60000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", folder.path("profile").display()))
        .arg(format!("file://{}", folder.path("check.html").display()))
        .output()
        .expect("the browser runs");
    let text = String::from_utf8_lossy(&output.stdout);
    let report = text.split("<pre id=\"report\">").nth(1).and_then(|t| t.split("</pre>").next());
    let report = report.unwrap_or_else(|| panic!("no report: {}", String::from_utf8_lossy(&output.stderr)));
    let mut lines = report.lines();
    assert_eq!(lines.next(), Some(&*format!("checked {number}")));
    lines.map(str::to_owned).collect()
}

/// A name without a space, and one with many.
const LONG: &str = "Wohnzimmerschrank_mit_Glastueren_und_Beleuchtung_links_unten_hinter_dem_Vorhang_Variante_B2_endgueltig_neu";

/// A lit floor with a block, whose scene, objects and materials have long names.
fn long_names(folder: &Scratch) -> String {
    let words = "ein recht langer Name aus vielen Woertern ".repeat(4);
    let scene = format!("{LONG}.obj");
    folder.write(
        "long.mtl",
        format!(
            "newmtl {LONG}\nKd .5 .5 .5\nnewmtl {words}\nKd .2 .6 .3\nnewmtl light\nKd 0 0 0\nKe 9 9 9\n"
        ),
    );
    let mut text = format!("mtllib long.mtl\no floor_{LONG}\nusemtl {LONG}\n");
    text += "v -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nf 1 2 3 4\n";
    text += &format!("o {words}\nusemtl {words}\nv -1 -1 .5\nv 1 -1 .5\nv 1 1 .5\nv -1 1 .5\nf 5 6 7 8\n");
    text += "o light\nusemtl light\nv -1 -1 3\nv -1 1 3\nv 1 1 3\nv 1 -1 3\nf 9 10 11 12\n";
    folder.write(&scene, text);
    scene
}

#[test]
fn pages_fit_into_windows() {
    check_pages(&VIEWS);
}

#[test]
#[ignore = "long: more widths"]
fn pages_fit_into_every_window() {
    check_pages(&MORE_VIEWS);
}

fn check_pages(views: &[(u32, &str)]) {
    let folder = Scratch::new();
    let scene = long_names(&folder);
    let few = words("--points 300 --rays 4 --reference-rays 16 --map 16 --rounds 1 --feature-size 0.5");
    let few = [few, words("--quiet --cache off")].concat();
    folder.mrvis(&[&["bench", &scene, "--out", "all"][..], &few].concat());
    let forest = folder.forest(4, 100);
    folder.mrvis(&[&["bench", &forest, "--out", "forest"][..], &few].concat());
    let options = words("--local-rays 0 --audit 50 --out all --output page --image-size 320x240 --quiet");
    folder.mrvis(&[&["solve", &scene][..], &options].concat());
    let jobs = format!(
        "[[job]]\ncommand = 'solve'\nscene = '{scene}'\nname = '{LONG}/{{visibility}}-{{error}}'\n\
         options = {{ output = 'image', image-size = '64x48', cache = 'off', local-rays = 0, audit = 0 }}\n\
         [job.sweep]\nvisibility = ['exact', 'mr']\nerror = [0.5, 0.4, 0.3]\n\
         [[job]]\ncommand = 'info'\nscene = 'broken.obj'\nname = 'fails'\n"
    );
    folder.write("jobs.toml", jobs);
    folder.write("broken.obj", "f 1 2 3\n");
    folder.mrvis("batch jobs.toml --out batch --quiet");
    folder.mrvis("report batch --quiet").exits(0);
    let pages = [
        ("batch with long names", folder.text("batch/report.html")),
        ("bench with long names", folder.text("all/report.html")),
        ("bench of a forest", folder.text("forest/report.html")),
        ("solve with long names", folder.text("all/solution.html")),
    ];
    let found = problems(&pages, views);
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// The check finds what it looks for.
#[test]
fn broken_pages_are_found() {
    let page = |style: &str, body: &str| {
        let filler = "<p>Some words of a page.</p>".repeat(10);
        format!("<!DOCTYPE html><style>body {{ background: #fff }} {style}</style>{filler}{body}")
    };
    let columns = "<div style='display:grid;grid-template-columns:5rem 5rem;white-space:nowrap'>\
                   <div>a long name in a column</div><div>and another one</div></div>";
    let cases = [
        ("overlap", "", columns),
        ("pixels wide", "", "<div style='width:3000px'>wide</div>"),
        ("too narrow", "", "<div style='overflow:auto'><div style='width:3000px'>wide</div></div>"),
        ("contrast", "p { color: #bbb }", ""),
        ("dark page", "body { background: #000; color: #fff }", ""),
        ("nothing", "", ""),
    ];
    let found = problems(&cases.map(|(what, style, body)| (what, page(style, body))), &VIEWS);
    for (what, ..) in cases {
        let of_page = || found.iter().filter(|line| line.starts_with(&format!("{what}, ")));
        let named = of_page().any(|line| line.split(": ").skip(1).any(|part| part.contains(what)));
        assert_eq!(named, what != "nothing", "{what}: {:?}", of_page().collect::<Vec<_>>());
        assert!(what != "nothing" || of_page().next().is_none(), "{:?}", of_page().collect::<Vec<_>>());
    }
}
