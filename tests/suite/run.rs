//! Runs the executable in a temporary folder.

use mrvis::internals::scene;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// Exit code and output of a call.
pub struct Outcome {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

/// A temporary folder for calls of the command.
pub struct Scratch(TempDir);

impl Scratch {
    pub fn new() -> Scratch {
        Scratch(tempfile::tempdir().expect("scratch folder"))
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).expect("scratch file");
    }

    /// Writes a generated scene as `NAME.obj`.
    pub fn generate(&self, spec: &scene::generate::Spec) -> String {
        let name = format!("{}.obj", spec.name);
        let soup = scene::generate::soup(spec).expect("a scene");
        scene::write_obj(&self.path(&name), &soup, &[]).expect("written");
        name
    }

    pub fn mrvis(&self, arguments: &[&str]) -> Outcome {
        let output = Command::new(env!("CARGO_BIN_EXE_mrvis"))
            .args(arguments)
            .current_dir(self.0.path())
            .output()
            .expect("the command runs");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Outcome { code: output.status.code(), stdout: text(&output.stdout), stderr: text(&output.stderr) }
    }

    /// The contents of a JSON file.
    pub fn json(&self, name: impl AsRef<Path>) -> serde_json::Value {
        let text = std::fs::read_to_string(self.0.path().join(name)).expect("a JSON file");
        serde_json::from_str(&text).expect("JSON")
    }
}
