//! The binary interface against its snapshot `tests/package/interface.txt`: declarations, sizes and offsets.
//!
//! The snapshot is made from the header, not by abidw from the library: abidw reads types from debug information, of which the library
//! has line numbers only, and its output depends on the compiler. Another test compares the header with the library.

use super::folder;
use crate::install::{output, project};
use std::fmt::Write;
use std::fs;
use std::process::Command;

/// The header without comments and directives, and its constants.
fn plain(header: &str) -> (String, Vec<String>) {
    let mut text = String::new();
    for part in header.split("*/") {
        text.push_str(part.split("/*").next().unwrap_or_default());
    }
    let (directives, code): (Vec<&str>, Vec<&str>) = text.lines().partition(|line| line.starts_with('#'));
    let constants = directives.iter().filter_map(|line| line.strip_prefix("#define "));
    let constants = constants.filter(|line| line.starts_with("MRV_") && !line.starts_with("MRV_VERSION"));
    let constants = constants.map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "));
    (code.join("\n").replace("extern \"C\" {\n", "").replace("\n}\n", "\n"), constants.collect())
}

/// Declarations, each on one line.
fn declarations(code: &str) -> Vec<String> {
    let (mut found, mut now, mut depth) = (Vec::new(), String::new(), 0);
    for c in code.chars() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if c == ';' && depth == 0 {
            found.push(now.split_whitespace().collect::<Vec<_>>().join(" "));
            now.clear();
        } else {
            now.push(c);
        }
    }
    found
}

/// A program that prints the size of each record and the offsets of its members.
fn layout_program(declarations: &[String]) -> String {
    let mut program = String::from("#include <mrvis.h>\n#include <stdio.h>\nint main(void) {\n");
    for declaration in declarations {
        let Some((body, name)) =
            declaration.strip_prefix("typedef struct ").and_then(|d| d.rsplit_once("} "))
        else {
            continue;
        };
        writeln!(program, "printf(\"size {name} %zu\\n\", sizeof({name}));").unwrap();
        let members = body.split_once('{').expect("a record").1;
        for declarator in members.split(';').flat_map(|member| member.split(',')) {
            let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
            let declarator = declarator.split('[').next().unwrap_or_default().trim();
            let member = declarator.rsplit(|c| !is_name(c)).next().unwrap_or_default();
            if !member.is_empty() {
                writeln!(program, "printf(\"offset {name}.{member} %zu\\n\", offsetof({name}, {member}));")
                    .unwrap();
            }
        }
    }
    program + "return 0;\n}\n"
}

#[test]
fn the_interface_is_that_of_the_snapshot() {
    let header = fs::read_to_string(project("ffi/include/mrvis.h")).expect("the header");
    let (code, mut lines) = plain(&header);
    let declarations = declarations(&code);
    let folder = folder();
    let source = folder.path().join("layout.c");
    fs::write(&source, layout_program(&declarations)).expect("a file");
    lines.extend(declarations);
    for compiler in ["gcc", "clang"] {
        let program = folder.path().join(compiler);
        let include = format!("-I{}", project("ffi/include").display());
        output(Command::new(compiler).arg(include).arg(&source).arg("-o").arg(&program));
        lines.extend(output(&mut Command::new(program)).lines().map(str::to_owned));
    }
    // Both compilers say the same.
    lines.sort();
    lines.dedup();
    let found = lines.join("\n") + "\n";
    let now = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("interface.txt");
    fs::write(&now, &found).expect("a file");
    let before = fs::read_to_string(project("tests/package/interface.txt")).unwrap_or_default();
    let differs = |from: &str, to: &str| -> String {
        let known: std::collections::BTreeSet<&str> = to.lines().collect();
        from.lines().filter(|line| !known.contains(line)).map(|line| format!("{line}\n")).collect()
    };
    let (gone, new) = (differs(&before, &found), differs(&found, &before));
    assert!(
        gone.is_empty() && new.is_empty(),
        "the binary interface changed.\nIn the snapshot only:\n{gone}In the header only:\n{new}Functions, constants and members at \
         the end of records may be added; whatever else changes raises the number of the soname in build.rs. Then copy {} to \
         tests/package/interface.txt.",
        now.display()
    );
}
