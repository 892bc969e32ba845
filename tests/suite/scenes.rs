//! The scenes of `make scenes` that need no package of the system.

use crate::install::{output, project};
use crate::run::Scratch;
use std::process::Command;

#[test]
fn scenes_without_furniture_are_assembled() {
    let scratch = Scratch::new();
    let names = ["sponza", "garden", "valley"];
    let mut assemble = Command::new("python3");
    assemble.arg(project("scenes/assemble.py")).args(names).args(["--out", "."]);
    output(assemble.current_dir(scratch.path("")));
    for name in names {
        scratch.mrvis(&format!("info {name}.obj --json info.json --quiet")).exits(0);
        let about = scratch.json("info.json");
        assert!(about["scene"]["triangles"].as_u64().is_some_and(|count| count > 50_000), "{name}: {about}");
        assert!(about["emitters"].as_array().is_some_and(|list| !list.is_empty()), "{name}: {about}");
    }
}
