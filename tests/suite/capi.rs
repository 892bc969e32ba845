//! The C interface: the header agrees with the library, and C and C++ programs get the answers of the crate.

mod expected;
mod programs;

use crate::install::project;
use std::path::{Path, PathBuf};

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
