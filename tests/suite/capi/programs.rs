//! C and C++ programs are compiled against the header and the library, and run.

use super::{expected, library, project};
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

/// Compilers that this machine has; gcc and g++ are required.
fn compilers(all: [&str; 2]) -> Vec<&str> {
    let [first, second] = all;
    let has = |name: &str| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success());
    if has(second) { vec![first, second] } else { vec![first] }
}

/// Compiles a program without a warning; gives its path.
fn compiled(folder: &TempDir, compiler: &str, source: &str, flags: &[&str]) -> std::path::PathBuf {
    let program = folder.path().join(format!("{compiler}-{}", flags.join("").replace(['=', '/'], "")));
    let library = library();
    // Programs look for the soname.
    let soname = folder.path().join("libmrvis.so.0");
    if !soname.exists() {
        std::os::unix::fs::symlink(&library, &soname).expect("a link");
    }
    let output = Command::new(compiler)
        .args(["-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-pthread"])
        .args(flags)
        .arg(format!("-I{}", project("ffi/include").display()))
        .arg(project("tests/capi").join(source))
        .arg(&library)
        .arg(format!("-Wl,-rpath,{}", folder.path().display()))
        .args(["-lm", "-o"])
        .arg(&program)
        .output()
        .unwrap_or_else(|e| panic!("{compiler}: {e}"));
    assert!(output.status.success(), "{compiler} {flags:?}: {}", String::from_utf8_lossy(&output.stderr));
    program
}

/// What a program prints, if it succeeds.
fn printed(program: &Path) -> String {
    let output = Command::new(program).output().expect("the program runs");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {:?}: {errors}", program.display(), output.status);
    String::from_utf8(output.stdout).expect("text")
}

/// Compares line by line, so that a failure names the first difference.
fn assert_same(found: &str, expected: &str, who: &str) {
    for (i, (found, expected)) in found.lines().zip(expected.lines()).enumerate() {
        assert_eq!(found, expected, "{who}: line {}", i + 1);
    }
    assert_eq!(found.lines().count(), expected.lines().count(), "{who}: lines");
}

#[test]
fn c_programs_get_the_answers_of_the_crate() {
    let folder = tempfile::tempdir().expect("a folder");
    let expected = expected::all();
    for compiler in compilers(["gcc", "clang"]) {
        let program = compiled(&folder, compiler, "answers.c", &["-std=c99"]);
        assert_same(&printed(&program), &expected, compiler);
    }
}

#[test]
fn cpp_programs_get_the_answers_of_the_crate() {
    let folder = tempfile::tempdir().expect("a folder");
    let expected = expected::bundles(&expected::model());
    for compiler in compilers(["g++", "clang++"]) {
        for flags in [
            &["-std=c++17"][..],
            &["-std=c++20"],
            &["-std=c++17", "-DMRVIS_NO_EXCEPTIONS", "-fno-exceptions"],
        ] {
            let program = compiled(&folder, compiler, "wrapper.cpp", flags);
            assert_same(&printed(&program), &expected, &format!("{compiler} {flags:?}"));
        }
    }
}

#[test]
fn misuse_gets_a_status() {
    let folder = tempfile::tempdir().expect("a folder");
    for compiler in compilers(["gcc", "clang"]) {
        printed(&compiled(&folder, compiler, "misuse.c", &["-std=c99"]));
    }
}
