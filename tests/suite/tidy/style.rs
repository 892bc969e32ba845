//! Limits of size, names and messages.

use super::{CRATES, all_crates, project, read, rust_files, source, table, words};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Longest file, lines.
const MAX_FILE_LINES: usize = 600;
/// Longest function, lines.
const MAX_FUNCTION_LINES: usize = 80;
/// Longest line of a comment, characters.
const MAX_COMMENT_WIDTH: usize = 140;

/// Rooms whose messages may still name options as the command does, each with its reason.
const ROOMS_WITH_FLAGS: [(&str, &str); 3] = [
    ("cli", "the command knows its options"),
    ("reproduce", "its page, which the command alone writes, names commands that show what a table states"),
    ("plot", "names of variables of style sheets begin with two hyphens"),
];

/// All Rust files of the crates.
fn source_files() -> Vec<PathBuf> {
    CRATES.iter().flat_map(|folder| rust_files(&project(folder))).collect()
}

/// All Rust files of the project, tests and benchmarks included.
fn all_files() -> Vec<PathBuf> {
    let more = ["tests", "benches", "ffi/benches", "command/benches", "examples"];
    let folders = CRATES.into_iter().chain(more).map(project).filter(|folder| folder.exists());
    folders.flat_map(|folder| rust_files(&folder)).collect()
}

/// Name and number of lines of each function.
fn functions(text: &str) -> Vec<(String, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    let mut found = Vec::new();
    for (first, line) in lines.iter().enumerate() {
        let indent = &line[..line.len() - line.trim_start().len()];
        let mut code = line.trim_start();
        while let Some((word, rest)) = code.split_once(' ') {
            let qualifier = ["const", "async", "unsafe", "pub"].contains(&word) || word.starts_with("pub(");
            if !qualifier {
                break;
            }
            code = rest;
        }
        let Some(rest) = code.strip_prefix("fn ") else { continue };
        let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
        let end = format!("{indent}}}");
        let body = lines[first..].iter().position(|l| l.starts_with(&end) || l.trim_end().ends_with(';'));
        // A declaration without a body ends with a semicolon before any brace is opened.
        let declaration = body.is_some_and(|n| !lines[first..=first + n].iter().any(|l| l.contains('{')));
        let length = lines[first..].iter().position(|l| l.starts_with(&end)).map_or(1, |n| n + 1);
        found.push((name, if declaration || line.trim_end().ends_with('}') { 1 } else { length }));
    }
    found
}

#[test]
fn files_are_short() {
    let long = source_files().into_iter().filter_map(|path| {
        let lines = read(&path).lines().count();
        (lines > MAX_FILE_LINES).then(|| format!("{}: {lines} lines", path.display()))
    });
    let long: Vec<String> = long.collect();
    assert!(long.is_empty(), "files of more than {MAX_FILE_LINES} lines:\n{}", long.join("\n"));
}

#[test]
fn comments_are_wrapped() {
    let is_long =
        |line: &&str| line.trim_start().starts_with("//") && line.chars().count() > MAX_COMMENT_WIDTH;
    let long = all_files().into_iter().flat_map(|path| {
        let text = read(&path);
        text.lines().filter(is_long).map(|line| format!("{}: {line}", path.display())).collect::<Vec<_>>()
    });
    let long: Vec<String> = long.collect();
    assert!(long.is_empty(), "comments wider than {MAX_COMMENT_WIDTH} characters:\n{}", long.join("\n"));
}

#[test]
fn functions_are_short() {
    let mut long = Vec::new();
    for path in source_files() {
        for (name, lines) in functions(&read(&path)).into_iter().filter(|(_, n)| *n > MAX_FUNCTION_LINES) {
            long.push(format!("{}: `{name}` has {lines} lines", path.display()));
        }
    }
    assert!(long.is_empty(), "functions of more than {MAX_FUNCTION_LINES} lines:\n{}", long.join("\n"));
}

#[test]
fn lengths_of_functions_are_counted() {
    let text = "pub(super) const fn one(\n    a: u8,\n) -> u8 {\n    a;\n}\nimpl A {\n    fn two() {}\n    fn three(&self);\n    fn four() {\n    }\n}\n";
    let want = [("one", 5), ("two", 1), ("three", 1), ("four", 2)].map(|(name, n)| (name.to_owned(), n));
    assert_eq!(functions(text), want);
}

#[test]
fn the_diagram_names_every_room() {
    let text = read(&source().join("ARCHITECTURE.md"));
    let diagram = text.split("```").nth(1).expect("a diagram");
    let table = table();
    let missing: Vec<&String> = table.keys().filter(|room| words(diagram, room).next().is_none()).collect();
    assert!(missing.is_empty(), "the diagram of src/ARCHITECTURE.md lacks {missing:?}");
}

/// Rooms on a circle of uses that begins and ends at `room`, by depth-first search.
pub(super) fn circle<'a>(
    table: &'a BTreeMap<String, BTreeSet<String>>,
    room: &'a str,
    path: &mut Vec<&'a str>,
    done: &mut BTreeSet<&'a str>,
) -> Option<Vec<&'a str>> {
    if let Some(first) = path.iter().position(|r| *r == room) {
        return Some([&path[first..], &[room]].concat());
    }
    if done.contains(room) {
        return None;
    }
    path.push(room);
    let found = table.get(room).into_iter().flatten().find_map(|next| circle(table, next, path, done));
    path.pop();
    done.insert(room);
    found
}

#[test]
fn rooms_do_not_use_each_other_in_circles() {
    let table = table();
    let mut done = BTreeSet::new();
    for room in table.keys() {
        let found = circle(&table, room, &mut Vec::new(), &mut done);
        assert_eq!(found, None, "a circle of rooms in the table of src/ARCHITECTURE.md");
    }
    let of = |room: &str, uses: &[&str]| (room.to_owned(), uses.iter().map(|u| u.to_string()).collect());
    let bad = BTreeMap::from([of("a", &["b"]), of("b", &["c", "d"]), of("c", &[]), of("d", &["b"])]);
    let found = circle(&bad, "a", &mut Vec::new(), &mut BTreeSet::new());
    assert_eq!(found, Some(vec!["b", "d", "b"]));
}

/// A constant that limits something says what, with its unit: `MIN_ROW_RAYS`.
#[test]
fn limits_say_what_they_limit() {
    let mut wrong = Vec::new();
    for path in all_files() {
        for (number, line) in read(&path).lines().enumerate() {
            let name = line.trim_start().split("const ").nth(1).unwrap_or_default();
            let name: String = name.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            if name.split('_').any(|part| ["LEAST", "MOST"].contains(&part)) {
                wrong.push(format!("{}:{}: {name}", path.display(), 1 + number));
            }
        }
    }
    assert!(wrong.is_empty(), "use MIN_ or MAX_ and what is limited:\n{}", wrong.join("\n"));
}

/// Comments of constants state a formula, a bound, a source or figures, and not only that somebody chose the value.
#[test]
fn constants_state_their_origin() {
    let mut wrong = Vec::new();
    for path in source_files() {
        for (number, line) in read(&path).lines().enumerate() {
            let comment = line.split_once("//").map_or("", |(_, comment)| comment);
            if ["Chosen.", "Chosen:", "Both chosen", "re chosen."].iter().any(|word| comment.contains(word)) {
                wrong.push(format!("{}:{}", path.display(), 1 + number));
            }
        }
    }
    assert!(wrong.is_empty(), "state where the value comes from:\n{}", wrong.join("\n"));
}

/// The library names an option by its field; the command writes it as `--flag`.
#[test]
fn messages_of_the_library_name_fields() {
    let mut wrong = Vec::new();
    for file in all_crates().iter().filter(|f| !ROOMS_WITH_FLAGS.iter().any(|(room, _)| *room == f.room())) {
        for (at, _) in file.code.match_indices("--") {
            let line = file.code[..at].rfind('\n').map_or(0, |n| n + 1);
            let in_string = file.code[line..at].matches('"').count() % 2 == 1;
            let word = file.code[at + 2..].chars().take_while(char::is_ascii_lowercase).count() >= 3;
            // A string that continues over several lines opens on an earlier one.
            let continued =
                !file.code[line..at].contains('"') && file.code[..line].trim_end().ends_with('\\');
            if word && (in_string || continued) {
                wrong.push(file.at(at));
            }
        }
    }
    assert!(wrong.is_empty(), "name the option by its field:\n{}", wrong.join("\n"));
}
