//! The scenes of `make scenes` that need no package of the system.

use crate::install::project;
use crate::run::Scratch;
use std::process::Command;

#[test]
fn scenes_without_furniture_are_assembled() {
    let scratch = Scratch::new();
    let script = project("scenes/assemble.py");
    let names = ["sponza", "garden", "valley"];
    let made = Command::new("python3")
        .arg(script)
        .args(names)
        .args(["--out", "."])
        .current_dir(scratch.path(""))
        .output();
    let made = made.expect("python3 runs");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    for name in names {
        let info = scratch.mrvis(&["info", &format!("{name}.obj"), "--json", "-", "--quiet"]);
        assert_eq!(info.code, Some(0), "{name}: {}", info.stderr);
        let about: serde_json::Value = serde_json::from_str(&info.stdout).expect("JSON");
        assert!(about["scene"]["triangles"].as_u64().is_some_and(|count| count > 50_000), "{name}: {about}");
        assert!(about["emitters"].as_array().is_some_and(|list| !list.is_empty()), "{name}: {about}");
    }
}
