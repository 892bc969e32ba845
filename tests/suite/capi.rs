//! The C interface: the header agrees with the library, and C and C++ programs get the answers of the crate.

mod expected;

use crate::install::{output, project};
use crate::run::assert_same_lines;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// The shared library that was built with these tests.
fn library() -> PathBuf {
    let folder = Path::new(env!("CARGO_BIN_EXE_mrvis")).parent().expect("a folder");
    // Tests do not depend on it: `.ci/tests` and `make test` build it beside them.
    let places = [folder.join("deps/libmrvis.so"), folder.join("libmrvis.so")];
    places.iter().find(|path| path.is_file()).unwrap_or_else(|| panic!("none of {places:?}")).clone()
}

/// Functions that the header declares.
pub fn declared() -> Vec<String> {
    let text = std::fs::read_to_string(project("ffi/include/mrvis.h")).expect("the header");
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut names: Vec<String> = text
        .lines()
        .filter(|line| !line.starts_with([' ', '/', '#', '}']) && !line.starts_with("typedef"))
        .filter_map(|line| {
            let before = line.split('(').next().filter(|before| before.len() < line.len())?;
            let name = before.rsplit(|c| !is_name(c)).next()?;
            name.starts_with("mrv_").then(|| name.to_owned())
        })
        .collect();
    names.sort();
    names
}

/// Compilers that this machine has; gcc and g++ are required.
fn compilers(all: [&str; 2]) -> Vec<&str> {
    let [first, second] = all;
    let has = |name: &str| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success());
    if has(second) { vec![first, second] } else { vec![first] }
}

/// A compiler with its warnings as errors, which reads a program.
fn compiler(name: &str, source: &str, flags: &[&str]) -> Command {
    let mut command = Command::new(name);
    command.args(["-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-pthread"]).args(flags);
    command.arg(format!("-I{}", project("ffi/include").display()));
    command.arg(project("tests/capi").join(source));
    command
}

/// Checks a program that is not run for warnings.
fn check(name: &str, source: &str, flags: &[&str]) {
    output(compiler(name, source, flags).arg("-fsyntax-only"));
}

/// Compiles a program without a warning; gives its path.
fn compiled(folder: &TempDir, name: &str, source: &str, flags: &[&str]) -> std::path::PathBuf {
    let program = folder.path().join(format!("{name}-{}", flags.join("").replace(['=', '/'], "")));
    let library = library();
    // Programs look for the soname.
    let soname = folder.path().join("libmrvis.so.0");
    if !soname.exists() {
        std::os::unix::fs::symlink(&library, &soname).expect("a link");
    }
    let mut command = compiler(name, source, flags);
    command.arg(&library).arg(format!("-Wl,-rpath,{}", folder.path().display()));
    output(command.args(["-lm", "-o"]).arg(&program));
    program
}

/// The program of gcc, after all compilers have read it without a warning; one run suffices, as its work takes seconds.
fn compiled_by_all(folder: &TempDir, source: &str) -> std::path::PathBuf {
    let flags = ["-std=c99"];
    let compilers = compilers(["gcc", "clang"]);
    compilers[1..].iter().for_each(|other| check(other, source, &flags));
    compiled(folder, compilers[0], source, &flags)
}

/// What a program prints, if it succeeds.
fn printed(program: &Path) -> String {
    output(&mut Command::new(program))
}

#[test]
fn c_programs_get_the_answers_of_the_crate() {
    let folder = tempfile::tempdir().expect("a folder");
    let expected = expected::all();
    let program = compiled_by_all(&folder, "answers.c");
    assert_same_lines(&printed(&program), &expected, "answers.c");
}

#[test]
fn cpp_programs_get_the_answers_of_the_crate() {
    let folder = tempfile::tempdir().expect("a folder");
    let expected = expected::bundles(&expected::model());
    for compiler in compilers(["g++", "clang++"]) {
        for (flags, run) in [
            (&["-std=c++17"][..], true),
            (&["-std=c++20"], false),
            (&["-std=c++17", "-DMRVIS_NO_EXCEPTIONS", "-fno-exceptions"], compiler == "g++"),
        ] {
            if run {
                let program = compiled(&folder, compiler, "wrapper.cpp", flags);
                assert_same_lines(&printed(&program), &expected, &format!("{compiler} {flags:?}"));
            } else {
                check(compiler, "wrapper.cpp", flags);
            }
        }
    }
}

#[test]
fn the_wrapper_refuses_other_versions() {
    let folder = tempfile::tempdir().expect("a folder");
    for compiler in compilers(["g++", "clang++"]) {
        printed(&compiled(&folder, compiler, "version.cpp", &["-std=c++17"]));
    }
}

#[test]
fn misuse_gets_a_status() {
    let folder = tempfile::tempdir().expect("a folder");
    let messages = printed(&compiled_by_all(&folder, "misuse.c"));
    assert!(messages.lines().count() > 250, "{} messages", messages.lines().count());
    messages.lines().for_each(check_words);
}

/// A message names its function, and uses words of the header alone: nothing of the crate's own names.
fn check_words(message: &str) {
    let header = std::fs::read_to_string(project("ffi/include/mrvis.h")).expect("the header");
    let words: BTreeSet<&str> = header.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').collect();
    let arguments = crate::run::words(ARGUMENTS);
    let (function, what) = message.split_once(": ").unwrap_or_else(|| panic!("{message}"));
    assert!(words.contains(function) && function.starts_with("mrv_"), "{message}");
    assert!(!what.contains("::") && !what.contains('⟨'), "a name of the crate: {message}");
    // What is wrong: an argument, or an entry or member of it.
    let argument = |quoted: &str| {
        let end = quoted.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(quoted.len());
        arguments.contains(&&quoted[..end])
    };
    let first = what.split(':').next().unwrap_or_default();
    // A file, or what a builder collected.
    let names_file = first == "arrays" || first.ends_with(".obj") || first.ends_with(".ply");
    assert!(
        names_file || what.split('`').skip(1).step_by(2).any(argument),
        "names neither argument nor file: {message}"
    );
    // What the program called its meshes, materials and so on.
    const OWN: [&str; 9] = ["m", "a", "b", "i", "floor", "lamp", "boxes", "grey", "red"];
    for quoted in what.split('`').skip(1).step_by(2) {
        let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '.';
        if OWN.contains(&quoted) || !quoted.chars().all(is_name) {
            continue;
        }
        assert!(
            quoted.split('.').all(|part| words.contains(part)),
            "`{quoted}` is not in the header: {message}"
        );
        // Members of records are named with their record.
        let mut path = quoted.split('.');
        let is_argument = path.next().is_some_and(|first| arguments.contains(&first));
        assert!(is_argument, "`{quoted}` is no argument: {message}");
    }
    // An option that stands at the beginning without its record.
    let first = what.split(' ').next().unwrap_or_default();
    assert!(!first.contains('_') || first.starts_with(['`', 'M']) || first.contains('.'), "{message}");
}

/// Arguments of functions, and the record that messages about other calls name.
const ARGUMENTS: &str = "answer answers approximation arrays builder camera changes cost data elements emission engine errors \
    factors flat folder format html images index info instance irradiance json kind lightmap lit \
    max_triangles mesh model mrv_load_options name normals options path place positions query radiance \
    reflectance report scene segments sizes sky solution sun text time transform updated";

/// Work that is cancelled in the middle, callbacks that use the library, and work that memory does not suffice for.
#[test]
fn callbacks_may_cancel_ask_and_release() {
    let folder = tempfile::tempdir().expect("a folder");
    printed(&compiled_by_all(&folder, "progress.c"));
}
