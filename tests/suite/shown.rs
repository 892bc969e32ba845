//! Transparent materials in all commands, and interrupted solves.

use crate::ended::LATEST_END;
use crate::run::{Outcome, Scratch, signal, wait};
use mrvis::internals::scene::generate::Spec;

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
