//! The installed C library: found by CMake and pkg-config in a folder to which it was moved, from a third folder, shared and static, by
//! gcc and clang; in hosts that fork first, replace malloc or use two models; under checkers of memory; and its interface as a snapshot.
//!
//! The snapshot is made from the header, not by abidw from the library: abidw reads types from debug information, of which the library
//! has line numbers only, and its output depends on the compiler. Another test compares the header with the library.
#![cfg(target_os = "linux")]

use crate::capi::declared;
use crate::install::{installed, output, project};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

const WARNINGS: &str = "-Wall -Wextra -Wpedantic -Werror";

fn folder() -> TempDir {
    tempfile::tempdir().expect("a folder")
}

/// `pkg-config`, which finds the installed library and no other.
fn pkg_config(prefix: &Path) -> Command {
    let mut command = Command::new("pkg-config");
    command.env("PKG_CONFIG_LIBDIR", prefix.join("lib/pkgconfig")).env_remove("PKG_CONFIG_PATH");
    command
}

/// Arguments that `pkg-config` states for the shared or the static library. Spaces in them are quoted by backslashes.
fn stated(prefix: &Path, is_static: bool) -> Vec<String> {
    let mut command = pkg_config(prefix);
    if is_static {
        command.args(["--static", "--define-variable=library=:libmrvis.a"]);
    }
    let text = output(command.args(["--cflags", "--libs", "mrvis"]));
    let text = text.trim().replace("\\ ", "\u{1}");
    text.split_whitespace().map(|word| word.replace('\u{1}', " ")).collect()
}

/// Compiles a program of `tests/package`; it finds the shared library where it is installed.
fn compiled(folder: &TempDir, compiler: &str, source: &str, is_static: bool, more: &[&str]) -> PathBuf {
    let prefix = installed().expect("an installed library");
    let program = folder.path().join(format!("{compiler}-{is_static}"));
    let mut command = Command::new(compiler);
    command.args(WARNINGS.split(' ')).args(["-O1", "-pthread"]);
    command.arg(project("tests/package").join(source)).arg("-o").arg(&program);
    command.args(more).args(stated(prefix, is_static));
    if !is_static {
        command.arg(format!("-Wl,-rpath,{}", prefix.join("lib").display()));
    }
    output(command.current_dir(folder.path()));
    program
}

/// Runs a program in an empty environment and another folder. It prints "done".
fn run(program: &Path) {
    let said = output(Command::new(program).env_clear().current_dir("/"));
    assert_eq!(said, "done\n", "{}", program.display());
}

#[test]
fn cmake_finds_the_moved_library() {
    let Some(prefix) = installed() else { return };
    // Linking the static library takes a second; clang does so in another test.
    for (compiler, libraries) in [("gcc", &["mrvis", "static"][..]), ("clang", &["mrvis"])] {
        let folder = folder();
        let mut cmake = Command::new("cmake");
        cmake.arg("-S").arg(project("tests/package")).arg("-B").arg(folder.path());
        cmake.arg(format!("-DCMAKE_PREFIX_PATH={}", prefix.display()));
        cmake.args([&format!("-DCMAKE_C_COMPILER={compiler}"), &format!("-DCMAKE_C_FLAGS={WARNINGS}")]);
        output(&mut cmake);
        for library in libraries {
            let program = format!("smoke-{library}");
            output(Command::new("cmake").arg("--build").arg(folder.path()).args(["--target", &program]));
            run(&folder.path().join(program));
        }
    }
}

#[test]
fn pkg_config_finds_the_moved_library() {
    if installed().is_none() {
        return;
    }
    for (compiler, is_static) in [("gcc", false), ("clang", true)] {
        let folder = folder();
        let program = compiled(&folder, compiler, "smoke.c", is_static, &["-std=c99"]);
        run(&program);
        let linked = output(Command::new("ldd").arg(&program));
        assert_eq!(linked.contains("libmrvis.so.0"), !is_static, "{linked}");
    }
}

/// The programs of `docs/c-api.md` give the answer that it states.
#[test]
fn the_first_programs_run() {
    let Some(prefix) = installed() else { return };
    let text = std::fs::read_to_string(project("docs/c-api.md")).expect("the page");
    let folder = folder();
    for (language, compiler, standard) in [("c", "gcc", "-std=c99"), ("cpp", "g++", "-std=c++17")] {
        let code = text.split(&format!("```{language}\n")).nth(1).and_then(|rest| rest.split("```").next());
        let source = folder.path().join(format!("first.{language}"));
        std::fs::write(&source, code.expect("a program")).expect("a file");
        let program = folder.path().join(language);
        let mut command = Command::new(compiler);
        command.args(WARNINGS.split(' ')).arg(standard).arg(&source).arg("-o").arg(&program);
        command.args(stated(prefix, false)).arg(format!("-Wl,-rpath,{}", prefix.join("lib").display()));
        output(&mut command);
        let said = output(Command::new(program).env_clear().current_dir("/"));
        assert!(
            said.starts_with("0.90625, between 0.81") && text.contains("0.90625, between 0.81"),
            "{said}"
        );
    }
}

/// The examples in C++ are built with both libraries; they print what they compute and write what they promise.
#[test]
fn examples_in_cpp_are_built_and_run() {
    let Some(prefix) = installed() else { return };
    for (compiler, library) in [("g++", "mrvis"), ("clang++", "static")] {
        let folder = folder();
        let mut cmake = Command::new("cmake");
        cmake.arg("-S").arg(project("examples/cpp")).arg("-B").arg(folder.path());
        cmake.arg(format!("-DCMAKE_PREFIX_PATH={}", prefix.display()));
        cmake.args([
            &format!("-DCMAKE_CXX_COMPILER={compiler}"),
            &format!("-DCMAKE_CXX_FLAGS={WARNINGS} -O1"),
        ]);
        output(cmake.arg(format!("-DMRVIS={library}")));
        // One example shows that the static library can be linked, which takes a second each time; the others are checked below.
        let examples = if library == "static" { &["light"][..] } else { &["light", "solve", "compare"] };
        let mut build = Command::new("cmake");
        output(build.arg("--build").arg(folder.path()).args(["--parallel", "3", "--target"]).args(examples));
        let said = |name: &str, arguments: &[&str]| {
            output(
                Command::new(folder.path().join(name)).args(arguments).env_clear().current_dir(folder.path()),
            )
        };
        let light = said("light", &["light.ppm"]);
        assert!(light.starts_with("brightest "), "{light}");
        let image = std::fs::read(folder.path().join("light.ppm")).expect("an image");
        let head = b"P6\n128 128\n255\n";
        let red = |x: usize, y: usize| image[head.len() + 3 * (128 * y + x)];
        assert!(image.starts_with(head) && image.len() == head.len() + 128 * 128 * 3);
        assert!(image[head.len()..].contains(&255) && red(77, 64) < red(20, 64), "no shadow below the table");
        if library == "static" {
            for source in ["solve.cpp", "compare.cpp"] {
                let mut check = Command::new(compiler);
                check.args(WARNINGS.split(' ')).args(["-std=c++17", "-fsyntax-only"]);
                output(check.arg("-I").arg(prefix.join("include")).arg(project("examples/cpp").join(source)));
            }
            continue;
        }
        let mut generate = Command::new(env!("CARGO_BIN_EXE_mrvis"));
        output(generate.args(["generate", "cornell", "--out", "box.obj"]).current_dir(folder.path()));
        let done = said("solve", &["box.obj"]);
        assert!(done.contains("\ndone: mean irradiance "), "{done}");
        let cancelled = said("solve", &["box.obj", "0"]);
        assert!(cancelled.contains("\ncancelled; so far: mean irradiance "), "{cancelled}");
        let times = said("compare", &["1000"]);
        assert!(times.starts_with("exact ") && times.contains("RMS difference 0.0"), "{times}");
    }
}

#[test]
fn the_example_in_c_is_built_and_run() {
    let Some(prefix) = installed() else { return };
    for more in [None, Some("STATIC=yes")] {
        let folder = folder();
        // `make` and `gcc` split at spaces, and the moved folder has one.
        let plain = folder.path().join("prefix");
        std::os::unix::fs::symlink(prefix, &plain).expect("a link");
        let mut make = Command::new("make");
        make.arg("-f")
            .arg(project("examples/c/Makefile"))
            .arg(format!("VPATH={}", project("examples/c").display()));
        make.arg(format!("CFLAGS={WARNINGS}")).args(more);
        for name in ["MAKEFLAGS", "MFLAGS", "MAKELEVEL"] {
            make.env_remove(name);
        }
        output(make.env("PKG_CONFIG_LIBDIR", plain.join("lib/pkgconfig")).current_dir(folder.path()));
        let said = output(Command::new(folder.path().join("shadow")).env_clear().current_dir("/"));
        let rows: Vec<&str> = said.lines().collect();
        assert_eq!(rows.len(), 32);
        assert!(rows[16].as_bytes()[32] == b'#' && rows[0].as_bytes()[0] == b' ', "{said}");
    }
}

/// Global names of the static library are those of the header, as are those that the shared one exports: no symbol of Rust or of Embree.
#[test]
fn libraries_define_only_names_of_the_interface() {
    let Some(prefix) = installed() else { return };
    let names = |option: &str, file: &str| {
        let text = output(
            Command::new("nm")
                .args([option, "--defined-only", "--extern-only", "--format=just-symbols"])
                .arg(prefix.join("lib").join(file)),
        );
        let mut names: Vec<String> =
            text.lines().filter(|l| !l.is_empty() && !l.ends_with(':')).map(str::to_owned).collect();
        names.sort();
        names
    };
    let shared = names("--dynamic", "libmrvis.so");
    assert_eq!(shared, declared(), "exported (left), declared (right)");
    assert_eq!(names("--no-demangle", "libmrvis.a"), shared, "static (left), shared (right)");
}

/// A host may link another static library in Rust beside this one.
#[test]
fn the_static_library_stands_beside_another_in_rust() {
    if installed().is_none() {
        return;
    }
    let folder = folder();
    let other = folder.path().join("libother.a");
    let mut rustc = Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
    rustc.args(["--edition=2024", "--crate-type=staticlib", "--crate-name=other", "-o"]).arg(&other);
    output(rustc.arg(project("tests/package/rust.rs")));
    let other = other.to_string_lossy();
    for order in [&[&*other][..], &["-Wl,--whole-archive", &*other, "-Wl,--no-whole-archive"]] {
        run(&compiled(&folder, "gcc", "two.c", true, &[&["-std=c99"], order].concat()));
    }
}

/// Hosts that fork first, ask two models at once, or have a malloc of their own.
#[test]
fn hosts_may_fork_first_replace_malloc_and_use_two_models() {
    if installed().is_none() {
        return;
    }
    for (source, standard, is_static) in [
        ("fork.c", "-std=c99", false),
        ("fork.c", "-std=c99", true),
        ("models.c", "-std=c99", false),
        ("allocator.c", "-std=c11", false),
        ("allocator.c", "-std=c11", true),
    ] {
        run(&compiled(&folder(), "gcc", source, is_static, &[standard]));
    }
}

/// A host with an Embree device and a TBB of its own: that of the system, if it has one, beside the library's.
#[test]
fn a_host_has_its_own_embree_and_tbb() {
    let Some(prefix) = installed() else { return };
    let private = prefix.join("lib/mrvis");
    let embree = std::env::var("EMBREE_DIR").map_or_else(|_| project(".prefix/embree"), PathBuf::from);
    let include = format!("{}", embree.join("include").display());
    let search = format!("-L{}", private.display());
    let mut flags = vec!["-std=c++17", "-isystem", &include, &*search, "-lembree4", "-ltbb"];
    // The system's TBB comes first where there is one.
    let system = output(Command::new("g++").arg("-print-file-name=libtbb.so"));
    let system = Path::new(system.trim()).parent().map(|p| format!("-Wl,-rpath,{}", p.display()));
    let system = system.unwrap_or_default();
    let own = format!("-Wl,-rpath,{}", private.display());
    flags.extend([&*system, &*own].into_iter().filter(|flag| flag.contains("rpath,/")));
    run(&compiled(&folder(), "g++", "embree.cpp", false, &flags));
}

/// Hosts compiled with AddressSanitizer: no error, and no block that nothing points to.
#[test]
fn address_sanitizer_finds_nothing() {
    address_sanitizer(&[
        ("gcc", "-std=c99", "../capi/misuse.c"),
        ("g++", "-std=c++17", "../capi/wrapper.cpp"),
    ]);
}

#[test]
#[ignore = "long: all programs"]
fn address_sanitizer_finds_nothing_in_more() {
    address_sanitizer(
        &["smoke.c", "../capi/progress.c", "../capi/answers.c"].map(|c| ("gcc", "-std=c99", c)),
    );
}

fn address_sanitizer(programs: &[(&str, &str, &str)]) {
    if installed().is_none() {
        return;
    }
    let folder = folder();
    for &(compiler, standard, source) in programs {
        let flags = [standard, "-fsanitize=address", "-fno-omit-frame-pointer", "-lm"];
        let program = compiled(&folder, compiler, source, false, &flags);
        // glibc keeps the last error of dlopen of each thread until it ends; a thread of a pool may still run at the end of the program.
        let known = folder.path().join("known");
        std::fs::write(&known, "leak:_dlerror_run\n").expect("written");
        let mut host = Command::new(program);
        host.env("ASAN_OPTIONS", "detect_leaks=1");
        host.env("LSAN_OPTIONS", format!("print_suppressions=0:suppressions={}", known.display()));
        output(host.current_dir("/"));
    }
}

/// Embree and TBB give Valgrind no reason for suppressions.
#[test]
#[ignore = "long: Valgrind"]
fn valgrind_finds_nothing() {
    if installed().is_none() {
        return;
    }
    let folder = folder();
    for (source, arguments) in [("smoke.c", &[][..]), ("../capi/misuse.c", &["0"])] {
        let program = compiled(&folder, "gcc", source, false, &["-std=c99", "-lm"]);
        let mut valgrind = Command::new("valgrind");
        valgrind.args(["--quiet", "--error-exitcode=9", "--leak-check=full"]);
        valgrind.args(["--show-leak-kinds=definite", "--errors-for-leak-kinds=definite"]);
        output(valgrind.arg(program).args(arguments).current_dir("/"));
    }
}

/// The archive and the Debian package hold a command and a library that run where they are unpacked, and licences of all parts.
#[test]
fn packages_are_complete() {
    let Some(prefix) = installed() else { return };
    let folder = folder();
    let [stage, out, unpacked] = ["stage", "out", "unpacked"].map(|name| folder.path().join(name));
    std::fs::create_dir_all(&stage).and(std::fs::create_dir(&unpacked)).expect("folders");
    output(Command::new("cp").arg("-R").arg(prefix).arg(stage.join("usr")));
    // Without compression, or with the fastest.
    output(
        Command::new(project("ffi/package/dist"))
            .args([&stage, &out])
            .args(["Test <test@example.invalid>", "0"]),
    );
    let version = env!("CARGO_PKG_VERSION");
    let [archive, package] = [".tar.gz", ".deb"].map(|end| {
        let mut files = std::fs::read_dir(&out).expect("a folder").map(|entry| entry.expect("a file").path());
        files.find(|path| path.to_string_lossy().ends_with(end)).unwrap_or_else(|| panic!("no {end} file"))
    });
    let field = |name: &str| output(Command::new("dpkg-deb").arg("-f").arg(&package).arg(name));
    assert!(field("Depends").contains("libc6 (>= ") && field("Version").trim() == version);
    output(Command::new("dpkg-deb").arg("-x").args([&package, &unpacked]));
    output(Command::new("tar").arg("-xzf").arg(&archive).arg("-C").arg(&unpacked));
    let architecture = output(Command::new("uname").arg("-m"));
    let top = format!("mrvis-{version}-linux-{}", architecture.trim());
    for root in [unpacked.join("usr"), unpacked.join(top)] {
        let said = output(Command::new(root.join("bin/mrvis")).arg("--version").env_clear().current_dir("/"));
        assert!(said.contains("Embree 4."), "{said}");
        let linked = output(Command::new("ldd").arg(root.join("lib/libmrvis.so.0")));
        assert!(!linked.contains("not found") && !linked.contains("/.prefix/"), "{linked}");
        let read = |name: &str| std::fs::read_to_string(root.join("share/doc/mrvis").join(name)).expect(name);
        assert!(read("copyright").contains("Embree") && read("LICENSE").contains("Apache License"));
        let crates = output(
            Command::new("sh")
                .arg("-c")
                .arg("zcat -f licences-of-crates.txt*")
                .current_dir(root.join("share/doc/mrvis")),
        );
        assert!(crates.contains("\nrayon ") && crates.contains("Permission is hereby granted"));
    }
}

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
