//! Calls that end early: interrupted by the user.
#![cfg(unix)]

use crate::run::{Outcome, Scratch, signal, wait, wait_until};
use mrvis::internals::scene::generate::Spec;
use std::process::Child;

/// Seconds. A loaded machine of tests is many times slower than an idle one, on which a second is the promise.
pub const LATEST_END: f64 = 30.0;

/// Sends Ctrl-C and waits for the end.
fn interrupted(child: Child) -> Outcome {
    signal("INT", child.id());
    Outcome::within(LATEST_END, child)
}

/// A large picture is left out when it is interrupted.
#[test]
fn an_interrupted_picture_is_left_out() {
    let scratch = Scratch::new();
    let scene = scratch.generate(&Spec::new("cornell"));
    let line = format!("solve {scene} --unit mm --out o --output image --image-size 5792x5792");
    let child = scratch.started(&format!("{line} --audit 0 --local-rays 20000"));
    wait_until(120, "there is no solution", || scratch.path("o/solution.json").exists());
    wait(0.5);
    let outcome = interrupted(child).exits(0);
    assert!(outcome.stdout.contains("no picture `view`") && !scratch.path("o/view.png").exists());
}

/// Rust raises SIGABRT if an allocation is refused. No test can have one refused at a chosen moment, so the signal is sent.
#[test]
fn an_aborted_call_has_the_code_of_errors() {
    let scratch = Scratch::new();
    let scene = scratch.generate(&Spec::new("desk-room"));
    let child = scratch.started(&format!("solve {scene} --error 1e-5 --out o --output none"));
    wait(1.0);
    signal("ABRT", child.id());
    Outcome::within(LATEST_END, child).exits(2);
}

/// Of a large solution an interruption leaves out the files that take long, and says which; the elements are written.
#[test]
#[ignore = "long: full size"]
fn an_interrupted_large_solution_is_written_as_elements() {
    let scratch = Scratch::new();
    let scene = scratch.forest(60, 2000);
    // Interrupted later and later, until there is light: a busy machine takes long to prepare the scene.
    let outcome = [6.0, 12.0, 24.0, 48.0].into_iter().find_map(|seconds| {
        let child = scratch.started(&format!("solve {scene} --error 0.002 --visibility exact --out o"));
        wait(seconds);
        let outcome = interrupted(child);
        let early = outcome.code == Some(2) && outcome.stderr.contains("stopped");
        assert!(early || outcome.code == Some(0), "{:?} {}", outcome.code, outcome.stderr);
        (!early).then_some(outcome)
    });
    outcome.expect("light after 48 s").prints("no `solution.glb`").prints("no pictures");
    assert!(scratch.path("o/solution.vtu").exists() && !scratch.path("o/solution.glb").exists());
    assert!(!scratch.path("o/view.png").exists());
}
