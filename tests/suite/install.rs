//! `make install`: what it copies, with the binary of the tests instead of a release build of several minutes.
#![cfg(target_os = "linux")]

use std::fs::read_dir;
use std::path::Path;
use std::process::{Command, Output};

fn output(command: &mut Command) -> String {
    let Output { status, stdout, stderr } = command.output().expect("the command runs");
    assert!(status.success(), "{command:?}: {}", String::from_utf8_lossy(&stderr));
    String::from_utf8_lossy(&stdout).into_owned()
}

/// The installed command has no debug information, runs from another folder without the settings of a build, and finds an Embree of its
/// own; completions and manual pages are beside it.
#[test]
fn an_installed_command_is_complete() {
    let project = Path::new(env!("CARGO_MANIFEST_DIR"));
    // The published package has no Makefile.
    if !project.join("Makefile").exists() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let prefix = folder.path().join("a prefix");
    let binary = env!("CARGO_BIN_EXE_mrvis");
    let mut make = Command::new("make");
    make.args(["install-files", &format!("PREFIX={}", prefix.display()), &format!("BINARY={binary}")]);
    // Settings of a `make` that runs this test do not count.
    for name in ["MAKEFLAGS", "MFLAGS", "MAKELEVEL", "DESTDIR"] {
        make.env_remove(name);
    }
    output(make.current_dir(project));
    let installed = prefix.join("bin/mrvis");
    let sections = |file: &Path| output(Command::new("readelf").args(["--wide", "--sections"]).arg(file));
    assert!(
        sections(Path::new(binary)).contains(".debug_line"),
        "the binary of the tests has debug information"
    );
    // Rust's list of scripts for debuggers is loaded with the program and stays.
    let stripped = sections(&installed).replace(".debug_gdb_scripts", "");
    assert!(!stripped.contains(".debug_"), "{stripped}");
    let said = output(Command::new(&installed).arg("--version").env_clear().current_dir("/"));
    assert!(said.starts_with("mrvis ") && said.contains("Embree 4."), "{said}");
    let dynamic = output(Command::new("readelf").args(["--wide", "--dynamic"]).arg(&installed));
    assert!(dynamic.contains("$ORIGIN/../lib/mrvis"), "{dynamic}");
    let linked = output(Command::new("ldd").arg(binary));
    if linked.contains("/.prefix/embree/") {
        let names = read_dir(prefix.join("lib/mrvis")).expect("a private Embree");
        let names = names.map(|entry| entry.expect("a name").file_name().to_string_lossy().into_owned());
        assert!(names.into_iter().any(|name| name.starts_with("libembree4.so")));
    }
    let share = prefix.join("share");
    let completions = [
        "bash-completion/completions/mrvis",
        "zsh/site-functions/_mrvis",
        "fish/vendor_completions.d/mrvis.fish",
    ];
    for name in completions.into_iter().chain(["man/man1/mrvis.1", "man/man1/mrvis-solve.1"]) {
        let text = std::fs::read_to_string(share.join(name)).expect(name);
        assert!(text.contains("solve"), "{name}");
    }
}
