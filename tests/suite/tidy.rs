//! Rules of the project that the compiler does not check. The tables of rooms in `src/ARCHITECTURE.md` state which
//! room may use which.

mod circles;
mod style;

use crate::install::project;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Folders of the crates in Rust. The first is the library.
const CRATES: [&str; 4] = ["src", "ffi/src", "command/src", "python/src"];

fn source() -> PathBuf {
    project("src")
}

/// All Rust files below a folder.
fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder of the project") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

/// A file of a crate with the path of its module: `["clusters", "tree"]`.
struct File {
    path: PathBuf,
    module: Vec<String>,
    /// Without comments and without what is compiled for tests only.
    code: String,
}

impl File {
    fn room(&self) -> &str {
        &self.module[0]
    }

    /// Path and line of a place in `code`, for messages.
    fn at(&self, offset: usize) -> String {
        format!("{}:{}", self.path.display(), 1 + self.code[..offset].matches('\n').count())
    }
}

/// The text without comments. A string that contains `//` is cut there.
fn without_comments(text: &str) -> String {
    text.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

fn library() -> Vec<File> {
    files_of(&source())
}

/// Files of all crates but the Python package, whose modules are those of its interface.
fn all_crates() -> Vec<File> {
    CRATES[..3].iter().flat_map(|folder| files_of(&project(folder))).collect()
}

/// Path of the module of a file below the folder of its crate.
fn module_path(root: &Path, file: &Path) -> Vec<String> {
    let relative = file.strip_prefix(root).expect("below src").with_extension("");
    let mut module: Vec<String> =
        relative.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
    module.pop_if(|last| last == "mod");
    module
}

/// Files below a folder of sources, without tests.
fn files_of(root: &Path) -> Vec<File> {
    let is_test = |module: &[String]| module.iter().any(|part| part == "tests" || part == "testing");
    let files = rust_files(root).into_iter().map(|path| (module_path(root, &path), path));
    let file = |(module, path): (Vec<String>, PathBuf)| {
        let text = without_comments(&read(&path));
        // Inline test modules are last in their files.
        let end = text.find("#[cfg(test)]\nmod tests {").unwrap_or(text.len());
        File { path, module, code: text[..end].to_owned() }
    };
    files.filter(|(module, _)| !is_test(module)).map(file).collect()
}

/// Offsets at which `word` occurs as a whole word.
fn words<'a>(code: &'a str, word: &'a str) -> impl Iterator<Item = usize> + 'a {
    let part = |c: char| c.is_alphanumeric() || c == '_';
    code.match_indices(word).map(|(i, _)| i).filter(move |&i| {
        !code[..i].chars().next_back().is_some_and(part)
            && !code[i + word.len()..].chars().next().is_some_and(part)
    })
}

/// First names after `crate::`, also in groups: `crate::{Error, math::Aabb}` uses `Error` and `math`.
fn uses(code: &str) -> Vec<(usize, String)> {
    names_after(code, "crate")
}

/// First names after a path and `::`, also in groups.
fn names_after(code: &str, path: &str) -> Vec<(usize, String)> {
    let name =
        |text: &str| -> String { text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect() };
    let mut found = Vec::new();
    for start in words(code, path) {
        let Some(rest) = code[start + path.len()..].strip_prefix("::") else { continue };
        let Some(group) = rest.strip_prefix('{') else {
            found.push((start, name(rest)));
            continue;
        };
        let (mut depth, mut fresh) = (1, true);
        for (i, c) in group.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 1 => fresh = true,
                c if fresh && c.is_alphanumeric() => {
                    found.push((start, name(&group[i..])));
                    fresh = false;
                }
                _ => {}
            }
            if depth == 0 {
                break;
            }
        }
    }
    found
}

/// Rows of the table in a section of the map: each room with the names in the cells after it.
fn rows(heading: &str) -> BTreeMap<String, Vec<BTreeSet<String>>> {
    let text = fs::read_to_string(source().join("ARCHITECTURE.md")).expect("the map");
    let section = text.split(&format!("\n# {heading}\n")).nth(1).expect("a section of the map");
    let section = section.split("\n# ").next().unwrap_or_default();
    let names =
        |cell: &str| -> BTreeSet<String> { cell.split('`').skip(1).step_by(2).map(str::to_owned).collect() };
    section
        .lines()
        .filter_map(|line| {
            let row = line.strip_prefix("| `")?;
            let mut cells = row.split('|');
            let room = cells.next()?.split('`').next()?.to_owned();
            Some((room, cells.map(names).collect()))
        })
        .collect()
}

/// Rooms of the library: what each may use besides `error` and `math`.
fn table() -> BTreeMap<String, BTreeSet<String>> {
    rows("Rooms").into_iter().map(|(room, mut cells)| (room, cells.swap_remove(0))).collect()
}

/// Rooms of the other crates: what each may use of its crate, and of the internals of the library.
fn other_table() -> BTreeMap<String, [BTreeSet<String>; 2]> {
    let rows = rows("Rooms of the other crates").into_iter();
    rows.map(|(room, cells)| (room, [cells[0].clone(), cells[1].clone()])).collect()
}

/// Rooms of the other crates with their files; the C library and the Python package are one room each.
fn other_rooms() -> Vec<(String, File)> {
    let command = files_of(&project("command/src")).into_iter();
    let command = command.filter(|f| !["lib", "main"].contains(&f.room())).map(|f| (f.room().to_owned(), f));
    let ffi = files_of(&project("ffi/src")).into_iter().map(|f| ("ffi".to_owned(), f));
    let python = files_of(&project("python/src")).into_iter().map(|f| ("python".to_owned(), f));
    command.chain(ffi).chain(python).collect()
}

#[test]
fn the_map_names_every_room_and_no_other() {
    let table = table();
    let rooms: BTreeSet<String> =
        library().iter().map(|f| f.room().to_owned()).filter(|r| r != "lib").collect();
    let named: BTreeSet<String> = table.keys().cloned().collect();
    assert_eq!(rooms, named, "rooms in src/ (left) and in the table of src/ARCHITECTURE.md (right)");
    for (room, may) in &table {
        let unknown: Vec<_> = may.difference(&rooms).collect();
        assert!(unknown.is_empty(), "`{room}` may use {unknown:?}, which do not exist");
    }
    let others: BTreeSet<String> = other_rooms().into_iter().map(|(room, _)| room).collect();
    let named: BTreeSet<String> = other_table().into_keys().collect();
    assert_eq!(others, named, "rooms of the other crates (left) and in src/ARCHITECTURE.md (right)");
}

#[test]
fn rooms_use_only_what_the_map_allows() {
    let table = table();
    let mut wrong = Vec::new();
    for file in library().iter().filter(|f| table.contains_key(f.room())) {
        for (at, name) in uses(&file.code) {
            let room = if name == "Error" || name == "Result" { "error" } else { &name };
            let open = room == "error" || room == "math" || room == file.room();
            if !open && !table[file.room()].contains(room) {
                wrong.push(format!("{}: `{}` may not use `{room}`", file.at(at), file.room()));
            }
        }
    }
    let others = other_table();
    for (room, file) in other_rooms() {
        let [own, internals] = &others[&room];
        let is_other = |name: &String| room != "python" && *name != room && !own.contains(name);
        let of_crate = uses(&file.code).into_iter().filter(|(_, name)| is_other(name));
        let inner =
            names_after(&file.code, "internals").into_iter().filter(|(_, name)| !internals.contains(name));
        wrong.extend(
            of_crate.chain(inner).map(|(at, name)| format!("{}: `{room}` may not use `{name}`", file.at(at))),
        );
    }
    for file in all_crates() {
        // A chain of `super` that leaves the room is as long as the module path or longer.
        for (at, _) in file.code.match_indices("super::") {
            let chain = file.code[at..].split("super::").take_while(|s| s.is_empty()).count();
            let is_room = file.module.len() > 1 || !file.path.starts_with(project("ffi"));
            if !file.code[..at].ends_with("super::") && chain >= file.module.len() && is_room {
                wrong.push(format!("{}: leaves the room by `super`", file.at(at)));
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "new uses are decisions to record in src/ARCHITECTURE.md:\n{}",
        wrong.join("\n")
    );
}

#[test]
fn every_allowed_use_is_used() {
    // An allowed use that does not occur is removed from the table.
    let mut used: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let own = library().into_iter().map(|file| (file.room().to_owned(), file));
    for (room, file) in own.chain(other_rooms()) {
        let names = uses(&file.code).into_iter().chain(names_after(&file.code, "internals"));
        used.entry(room).or_default().extend(names.map(|(_, name)| name));
    }
    let others = other_table().into_iter().map(|(room, may)| (room, may.into_iter().flatten().collect()));
    for (room, may) in table().into_iter().filter(|(room, _)| room != "bench").chain(others) {
        let idle: Vec<_> = may.iter().filter(|m| !used[&room].contains(*m)).collect();
        assert!(idle.is_empty(), "`{room}` does not use {idle:?}");
    }
}

/// The internals of the library name what the command, the C library, benches or tests use, and nothing else.
#[test]
fn internals_are_used() {
    let folders = ["command", "ffi/src", "ffi/benches", "python/src", "tests", "benches"];
    let users: Vec<String> =
        folders.iter().flat_map(|folder| rust_files(&project(folder))).map(|path| read(&path)).collect();
    let text = read(&source().join("internals.rs"));
    let mut exported = Vec::new();
    circles::exports(&syn::parse_file(&text).expect("Rust").items, &mut exported);
    assert!(exported.len() > 100, "exports are found");
    exported.retain(|name| !users.iter().any(|user| words(user, name).next().is_some()));
    assert!(exported.is_empty(), "nobody uses {exported:?} of src/internals.rs");
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).expect("a source file")
}

#[test]
fn rules_see_what_they_look_for() {
    let code = "use crate::{Error, math::{Aabb, area}, scene::Scene};\nlet x = crate::ray::LANES; mycrate::no; super::y";
    let names: Vec<String> = uses(code).into_iter().map(|(_, n)| n).collect();
    assert_eq!(names, ["Error", "math", "scene", "ray"]);
    assert_eq!(words("unsafe { } unsafe_code my_unsafe unsafe", "unsafe").collect::<Vec<_>>(), [0, 33]);
    assert_eq!(without_comments("a // unsafe\nb"), "a \nb");
    assert!(
        library().iter().filter(|f| f.room() == "embree").any(|f| words(&f.code, "unsafe").next().is_some())
    );
}

#[test]
fn unsafe_code_is_confined() {
    let may = |f: &File| {
        f.path.starts_with(project("ffi"))
            || f.path.starts_with(source()) && ["embree", "simd"].contains(&f.room())
    };
    for file in all_crates().iter().filter(|f| !may(f)) {
        if let Some(at) = words(&file.code, "unsafe").next() {
            panic!("{}: `unsafe` outside of the rooms that may have it", file.at(at));
        }
    }
}

/// The key of cache files hashes all source code that clusters and optics depend on.
#[test]
fn caches_know_the_code_that_made_them() {
    let build = fs::read_to_string(source().join("../build.rs")).expect("the build script");
    let table = table();
    let mut rooms = BTreeSet::from(["error".to_owned(), "math".to_owned()]);
    let mut waiting = vec!["optics".to_owned(), "clusters".to_owned()];
    while let Some(room) = waiting.pop() {
        waiting.extend(table[&room].difference(&rooms).cloned());
        rooms.insert(room);
    }
    let missing: Vec<_> = rooms
        .iter()
        .filter(|r| ["", ".rs"].iter().all(|e| !build.contains(&format!("\"src/{r}{e}\""))))
        .collect();
    assert!(missing.is_empty(), "TABLE_ROOMS in build.rs lacks {missing:?}");
}

/// Rooms `clusters` and `optics` do not read fields of the scene that the key of cache files omits.
#[test]
fn clusters_depend_only_on_what_their_cache_knows() {
    let left_out = [
        "triangle_material",
        "triangle_reflectance",
        "triangle_emitter",
        "materials",
        "emitters",
        "objects",
        "two_sided_emission",
        "unit",
        "closed_parts",
        "sheet_parts",
        "repairs",
    ];
    for file in library().iter().filter(|f| ["clusters", "optics"].contains(&f.room())) {
        for field in left_out {
            if let Some(at) = file.code.find(&format!(".{field}")) {
                panic!("{}: `{field}` is not in the key of `model::cache`", file.at(at));
            }
        }
    }
}

/// The library does not print and does not read the environment; only the command does.
#[test]
fn only_the_command_talks_and_listens() {
    let mut wrong = Vec::new();
    for file in all_crates().iter().filter(|f| !["cli", "main"].contains(&f.room())) {
        for word in ["println", "eprintln", "print", "eprint"] {
            wrong.extend(
                words(&file.code, word)
                    .filter(|at| file.code[at + word.len()..].starts_with('!'))
                    .map(|at| file.at(at)),
            );
        }
        wrong.extend(file.code.match_indices("env::var").map(|(at, _)| file.at(at)));
    }
    assert!(wrong.is_empty(), "prints or reads the environment:\n{}", wrong.join("\n"));
}

/// Crates that a program compiles which uses the library without features, the library included.
const MAX_CRATES: usize = 90;

#[test]
fn the_library_needs_few_crates() {
    let mut tree = std::process::Command::new("cargo");
    tree.args(["tree", "--locked", "--package=mrvis", "--edges=normal,build", "--prefix=none"]);
    let output = tree.current_dir(project("")).output().expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("text");
    let crates: BTreeSet<Vec<&str>> = text.lines().map(|l| l.split(' ').take(2).collect()).collect();
    assert!(crates.len() > 50, "crates are found");
    assert!(crates.len() <= MAX_CRATES, "{} crates, at most {MAX_CRATES}: {crates:?}", crates.len());
}
