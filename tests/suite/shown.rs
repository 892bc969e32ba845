//! `solve` and `form-factors` on published cases, transparent materials, and interruptions.

use crate::ended::LATEST_END;
use crate::run::{Outcome, Scratch, signal, wait};
use glam::{DVec3, dvec3};
use mrvis::Model;
use mrvis::internals::form_factors::{Facets, Grouping, Settings, by_groups, compute};
use mrvis::internals::points::Point;
use mrvis::internals::radiosity::{self, Link, Options};
use mrvis::internals::scene::generate::Spec;
use mrvis::internals::scene::{LoadOptions, Scene, Soup, SoupMaterial, resolve};
use std::f64::consts::{PI, TAU};

/// Rows of a table of published cases.
fn published(text: &str) -> Vec<csv::StringRecord> {
    let mut reader =
        csv::ReaderBuilder::new().comment(Some(b'#')).flexible(true).from_reader(text.as_bytes());
    reader.records().map(|row| row.expect("a row")).collect()
}

fn obstructed(id: &str, quantity: &str) -> f64 {
    let rows = published(include_str!("../validation/viewfactors_obstructed.csv"));
    let row = rows.iter().find(|row| &row[0] == id && row[2].starts_with(quantity)).expect("the row");
    row[5].parse().expect("a number")
}

/// Builds scenes of polygons, grouped into objects.
#[derive(Default)]
struct Builder(Soup);

impl Builder {
    fn new() -> Builder {
        let mut soup = Soup::new("test");
        soup.material(SoupMaterial::diffuse("black", [0.0; 3]));
        soup.material(SoupMaterial::light("lamp", [1.0 / PI as f32; 3]));
        Builder(soup)
    }

    fn object(&mut self, name: &str, material: u32, polygons: &[Vec<DVec3>]) -> &mut Builder {
        let object = self.0.object(name);
        polygons.iter().for_each(|p| self.0.polygon(object, material, p));
        self
    }

    fn scene(&mut self) -> Scene {
        resolve(std::mem::take(&mut self.0), &LoadOptions::default()).expect("a scene")
    }
}

const BLACK: u32 = 0;
const LAMP: u32 = 1;

fn rectangle(corner: DVec3, u: DVec3, v: DVec3) -> Vec<DVec3> {
    vec![corner, corner + u, corner + u + v, corner + v]
}

/// A unit emitter at z = 1 that faces a unit square at z = 0, and between them a square of side `size`.
fn plates(low: DVec3, size: f64) -> Scene {
    Builder::new()
        .object("lamp", LAMP, &[rectangle(DVec3::Z, DVec3::Y, DVec3::X)])
        .object("floor", BLACK, &[rectangle(DVec3::ZERO, DVec3::X, DVec3::Y)])
        .object("blocker", BLACK, &[rectangle(low, size * DVec3::X, size * DVec3::Y)])
        .scene()
}

#[test]
fn solutions_of_published_obstructed_pairs() {
    // The emitter's radiosity is 1, so the floor's mean irradiance is the form factor.
    let n = 24;
    let at = |k: usize| (k as f64 + 0.5) / n as f64;
    let grid: Vec<Point> =
        (0..n * n).map(|k| Point { position: dvec3(at(k % n), at(k / n), 0.0), normal: DVec3::Z }).collect();
    for (id, quantity, low, size) in [
        ("facet_shapiro", "F(y=1 -> y=0)", dvec3(0.25, 0.25, 0.75), 0.5),
        ("view3d_square_obstruction", "F(z=0 -> z=1)", dvec3(0.0, 0.0, 0.5), 0.5),
        ("centred_half_obstruction", "F12", dvec3(0.25, 0.25, 0.5), 0.5),
    ] {
        let want = obstructed(id, quantity);
        let scene = plates(low, size);
        let options = Options { audit: 0, min_area: 1e-4, ..Options::default() };
        let outcome = radiosity::run(&model(&scene), &grid, &options, &()).expect("a solution");
        let points = outcome.irradiance.iter().map(|e| e[0]).sum::<f64>() / grid.len() as f64;
        assert!((points / want - 1.0).abs() < 5e-3, "{id} at points: {points} instead of {want}");
        // Elements sample visibility with few segments; the errors have no bias.
        let floor = outcome.mesh.elements.iter().filter(|e| e.object == 1 && e.front);
        let (light, area) =
            floor.fold((0.0, 0.0), |(light, area), e| (light + e.irradiance[0] * e.area, area + e.area));
        let mean = light / area;
        assert!((mean / want - 1.0).abs() < 0.02, "{id} of the elements: {mean} instead of {want}");
    }
    let hidden = plates(dvec3(-0.1, -0.1, 0.5), 1.2);
    let options = Options { audit: 0, elements: false, ..Options::default() };
    let outcome = radiosity::run(&model(&hidden), &grid, &options, &()).expect("a solution");
    assert!(outcome.irradiance.iter().all(|e| *e == [0.0; 3]));
}

fn factors(scene: &Scene) -> mrvis::FormFactors {
    let facets = Facets::new(scene);
    let settings = Settings::new(facets.count());
    let (matrix, _) = compute(&model(scene), &facets, &settings, &()).expect("a matrix");
    by_groups(matrix, scene, &facets, Grouping::Object, &()).expect("groups")
}

/// A regular polygon at height `z` with the area of a disc; `up`: faces upwards.
fn disc(radius: f64, z: f64, up: bool) -> Vec<DVec3> {
    const SIDES: usize = 96;
    let step = TAU / SIDES as f64;
    let r = radius * (step / step.sin()).sqrt();
    let mut corners: Vec<DVec3> =
        (0..SIDES).map(|k| dvec3(r * (k as f64 * step).cos(), r * (k as f64 * step).sin(), z)).collect();
    if !up {
        corners.reverse();
    }
    corners
}

#[test]
fn coaxial_discs_of_the_published_suite() {
    let mut rows = published(include_str!("../validation/viewfactors_unobstructed.csv"));
    rows.retain(|row| row[0].starts_with("coaxial-discs-"));
    assert!(rows.len() >= 8, "{} cases", rows.len());
    for row in rows {
        let [one, other, want] = [2, 3, 6].map(|k: usize| row[k].parse::<f64>().expect("a number"));
        let mut builder = Builder::new();
        builder.object("one", BLACK, &[disc(one, 0.0, true)]);
        let scene = builder.object("other", BLACK, &[disc(other, 1.0, false)]).scene();
        let found = f64::from(factors(&scene).factor(0, 1));
        assert!((found / want - 1.0).abs() < 1e-3, "{}: {found} instead of {want}", &row[0]);
    }
}

/// An emitter above a floor, and a pane of glass between them.
fn pane(scratch: &Scratch, d: &str) {
    scratch.write(
        "pane.obj",
        "mtllib pane.mtl\nv 0 0 0\nv 4 0 0\nv 4 1 0\nv 0 1 0\nv 0 0 1\nv 4 0 1\nv 4 1 1\nv 0 1 1\n\
         v -9 -9 .5\nv 2 -9 .5\nv 2 9 .5\nv -9 9 .5\no floor\nusemtl floor\nf 1 2 3 4\no lamp\nusemtl lamp\nf 8 7 6 5\n\
         o pane\nusemtl glass\nf 9 10 11 12\n",
    );
    let materials =
        "newmtl floor\nKd 0 0 0\nnewmtl lamp\nKd 0 0 0\nKe 1 1 1\nnewmtl glass\nKd 0 0 0\n".to_owned();
    scratch.write("pane.mtl", materials + d + "\n");
    scratch.write("points.csv", "x,y,z,nx,ny,nz\n0.2,0.5,0,0,0,1\n");
}

#[test]
fn glass_blocks_from_one_half_on_in_every_command() {
    let mut clear = None;
    for (d, blocks) in [("d 0", false), ("d 0.499", false), ("Tr 0.6", false), ("d 0.5", true), ("d 1", true)]
    {
        let scratch = Scratch::new();
        pane(&scratch, d);
        let call = |line: &str| {
            let outcome = scratch.mrvis(&format!("{line} --quiet"));
            assert_eq!(outcome.code, Some(0), "{d}: {}", outcome.stderr);
        };
        let direct = "--output none --audit 0 --local-rays 20000";
        call(&format!("solve pane.obj --out s --points points.csv {direct}"));
        call("reference pane.obj --out r.csv --points points.csv");
        call("form-factors pane.obj --out f.csv --by object");
        // The command reads scenes as the others do; two values show it.
        if ["d 0.499", "d 0.5"].contains(&d) {
            let few = "--points 50 --rays 1 --reference-rays 8 --map 0 --rounds 1 --feature-size 1";
            call(&format!("bench pane.obj --json b.json --cache off {few}"));
            let triangles = scratch.json("b.json")["scene"]["triangles"].as_u64();
            assert_eq!(triangles, Some(if blocks { 6 } else { 4 }), "{d}");
        }
        let [solved, traced] = ["s/irradiance.csv", "r.csv"].map(|name| scratch.rows(name)[0][6]);
        let factors = scratch.text("f.csv");
        let factor = |from: &str, to: &str| -> f64 {
            let start = format!("{from},{to},");
            factors.lines().find_map(|l| l.strip_prefix(&start)).map_or(0.0, |f| f.parse().expect("a number"))
        };
        assert!((factor("floor", "lamp") > 0.3) != blocks, "{d}: {factors}");
        if blocks {
            assert!(
                solved < 0.5 * clear.expect("d 0 comes first") && traced < 0.5 * solved.max(1.0),
                "{d}: {solved} {traced}"
            );
        } else {
            assert!((solved / traced - 1.0).abs() < 0.02, "{d}: {solved} {traced}");
            assert_eq!(*clear.get_or_insert(solved), solved, "{d}: glass is not there");
        }
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_solution_is_consistent_and_says_so() {
    let scratch = Scratch::new();
    let scene = scratch.generate(&Spec::new("desk-room"));
    let line = format!("solve {scene} --out s --error 1e-5 --output vtu,image --gather");
    let child = scratch.started(&line);
    wait(2.0);
    signal("INT", child.id());
    Outcome::within(LATEST_END, child).exits(0).prints("interrupted");
    let record = scratch.json("s/solution.json");
    assert_eq!(record["interrupted"], true);
    let power = |what: &str| record["ledger"][what].as_f64().expect("a number");
    let gone = power("absorbed") + power("escaped") - power("created");
    assert!((gone / power("emitted") - 1.0).abs() < 1e-3, "{}", record["ledger"]);
    assert!(scratch.path("s/solution.vtu").exists() && scratch.path("s/view.png").exists());
}

/// A second interruption ends the program immediately.
#[cfg(unix)]
#[test]
fn a_second_interruption_ends_at_once() {
    let scratch = Scratch::new();
    let scene = scratch.generate(&Spec::new("desk-room"));
    let interrupted_after = |seconds: f64| {
        let child = scratch.started(&format!("solve {scene} --out s --output none --error 1e-5"));
        wait(seconds);
        // The regular end, with the last sweeps and the audit, takes longer than the time between the two.
        let twice = format!("kill -INT {0}; sleep 0.005; kill -INT {0}", child.id());
        assert!(std::process::Command::new("bash").args(["-c", &twice]).status().expect("bash").success());
        Outcome::at_end(child)
    };
    // While the scene is read or prepared the first interruption ends the program; the test then waits longer.
    let at_once = |outcome: &Outcome| outcome.code == Some(130);
    let ended = [0.5, 1.0, 2.0, 4.0, 8.0].into_iter().map(interrupted_after).find(at_once);
    ended.expect("an end at the second interruption").warns("once more ends at once");
    assert!(!scratch.path("s/solution.json").exists());
}

#[test]
fn ten_million_links_take_less_than_a_gibibyte() {
    // Stored size, and 32 bytes of temporary data per link during refinement and sweeps.
    let stored = size_of::<Link>();
    assert!(stored <= 40, "{stored}");
    assert!(10_000_000 * (stored + 32) < 1 << 30);
    let options = Options { error: 0.01, local_rays: Some(20_000), audit: 0, ..Options::default() };
    let outcome =
        radiosity::run(&model(&plates(dvec3(0.25, 0.25, 0.5), 0.5)), &[], &options, &()).expect("a solution");
    let (links, elements) = (outcome.record.links, outcome.record.elements);
    assert!(links > 2000, "{links}");
    // Memory is proportional to elements and links only.
    assert!(
        outcome.record.bytes < 80 * links + 400 * elements + 100_000,
        "{} {links} {elements}",
        outcome.record.bytes
    );
}

/// The model for a solve with default options.
fn model(scene: &Scene) -> Model {
    Model::prepare(scene.clone(), &Options::default().prepare()).expect("a model")
}
