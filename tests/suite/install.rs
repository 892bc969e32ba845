//! `make install`: what it copies, with the command and libraries of the tests instead of a release build of several minutes.
#![cfg(target_os = "linux")]

use std::fs::{self, read_dir};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// A folder or file of the project.
pub fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").join(path)
}

/// What a command prints, if it succeeds.
pub fn output(command: &mut Command) -> String {
    let Output { status, stdout, stderr } = command
        .output()
        .unwrap_or_else(|e| panic!("{command:?}: {e}; make test installs what the tests need"));
    let (stdout, stderr) = (String::from_utf8_lossy(&stdout), String::from_utf8_lossy(&stderr));
    assert!(status.success(), "{command:?}: {status}\n{stdout}\n{stderr}");
    stdout.into_owned()
}

/// A prefix with everything that `make install` lays down, which was moved since. The published package has no Makefile and thus none.
pub fn installed() -> Option<&'static Path> {
    static PREFIX: OnceLock<Option<PathBuf>> = OnceLock::new();
    PREFIX.get_or_init(|| project("Makefile").exists().then(install)).as_deref()
}

/// Installs into one folder and moves it to another, once for all tests of a run, each of which may be a process of its own.
fn install() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let work = folder.join("installed");
    let prefix = work.join("moved/to here");
    // The next test waits here until the first has installed; the lock ends with this function.
    let lock = fs::File::create(folder.join("installed.lock")).expect("a file");
    lock.lock().expect("a lock");
    let run = this_run();
    if fs::read_to_string(work.join("run")).is_ok_and(|made_by| made_by == run) {
        return prefix;
    }
    let _ = fs::remove_dir_all(&work);
    fs::create_dir_all(work.join("moved")).expect("a folder");
    let first = work.join("a prefix");
    let binary = env!("CARGO_BIN_EXE_mrvis");
    // Cargo leaves the libraries that tests depend on in `deps`.
    let libraries = Path::new(binary).parent().expect("a folder").join("deps");
    let mut make = Command::new("make");
    make.args(["install-files", &format!("PREFIX={}", first.display()), &format!("BINARY={binary}")]);
    make.arg(format!("LIBRARIES={}", libraries.display()));
    // Settings of a `make` that runs this test do not count.
    for name in ["MAKEFLAGS", "MFLAGS", "MAKELEVEL", "DESTDIR"] {
        make.env_remove(name);
    }
    output(make.current_dir(project("")));
    fs::rename(first, &prefix).expect("the folder is moved");
    fs::write(work.join("run"), run).expect("a file");
    prefix
}

/// What the processes of one run of the tests have in common: the parent, with its start as numbers are used again, and what is installed.
fn this_run() -> String {
    let parent = std::os::unix::process::parent_id();
    let about = fs::read_to_string(format!("/proc/{parent}/stat")).expect("Linux describes processes");
    // Of proc_pid_stat(5), the number after 19 others that follow the name.
    let start = about.rsplit(')').next().and_then(|rest| rest.split_whitespace().nth(19)).expect("a start");
    let files = [PathBuf::from(env!("CARGO_BIN_EXE_mrvis")), project("Makefile")];
    let times = files.map(|file| fs::metadata(file).and_then(|about| about.modified()).expect("a time"));
    format!("{parent} {start} {times:?}")
}

/// Sections of a program or library.
fn sections(file: &Path) -> String {
    output(Command::new("readelf").args(["--wide", "--sections"]).arg(file))
}

/// The installed command has no debug information, runs from another folder without the settings of a build, and finds an Embree of its
/// own; completions and manual pages are beside it.
#[test]
fn an_installed_command_is_complete() {
    let Some(prefix) = installed() else { return };
    let binary = env!("CARGO_BIN_EXE_mrvis");
    let installed = prefix.join("bin/mrvis");
    let said = output(Command::new(&installed).arg("--version").env_clear().current_dir("/"));
    assert!(said.starts_with("mrvis ") && said.contains("Embree 4."), "{said}");
    let linked = output(Command::new("ldd").arg(binary));
    if linked.contains("/.prefix/embree/") {
        let names = read_dir(prefix.join("lib/mrvis")).expect("a private Embree");
        let names = names.map(|entry| entry.expect("a name").file_name().to_string_lossy().into_owned());
        let names: Vec<String> = names.collect();
        assert!(names.iter().any(|name| name.starts_with("libembree4.so")), "{names:?}");
        assert!(names.iter().any(|name| name.contains("copyright")), "{names:?}");
    }
    let share = prefix.join("share");
    let completions = [
        "bash-completion/completions/mrvis",
        "zsh/site-functions/_mrvis",
        "fish/vendor_completions.d/mrvis.fish",
    ];
    for name in completions.into_iter().chain(["man/man1/mrvis.1", "man/man1/mrvis-solve.1"]) {
        let text = fs::read_to_string(share.join(name)).expect(name);
        assert!(text.contains("solve"), "{name}");
    }
}

/// Nothing installed has debug information or names a folder of the machine that built it.
#[test]
fn installed_files_are_free_of_the_build() {
    let Some(prefix) = installed() else { return };
    let lib = prefix.join("lib");
    for (file, run_path) in
        [(prefix.join("bin/mrvis"), "[$ORIGIN/../lib/mrvis]"), (lib.join("libmrvis.so"), "[$ORIGIN/mrvis]")]
    {
        // Rust's list of scripts for debuggers is loaded with the program and stays.
        let sections = sections(&file).replace(".debug_gdb_scripts", "");
        assert!(!sections.contains(".debug_"), "{sections}");
        let dynamic = output(Command::new("readelf").args(["--wide", "--dynamic"]).arg(&file));
        let paths: Vec<&str> =
            dynamic.lines().filter(|line| line.contains("(RUNPATH)") || line.contains("(RPATH)")).collect();
        assert!(paths.len() == 1 && paths[0].ends_with(run_path), "{}: {paths:?}", file.display());
    }
    // The archive has lines of the standard library, whatever the settings of the build.
    let built = Path::new(env!("CARGO_BIN_EXE_mrvis")).parent().expect("a folder").join("deps/libmrvis.a");
    assert!(sections(&built).contains(".debug_line"), "the archive of the build has debug information");
    assert!(!sections(&lib.join("libmrvis.a")).contains(".debug_line"));
    let descriptions =
        ["pkgconfig/mrvis.pc", "cmake/mrvis/mrvisConfig.cmake", "cmake/mrvis/mrvisConfigVersion.cmake"];
    for name in descriptions {
        let text = fs::read_to_string(lib.join(name)).expect(name);
        assert!(text.contains(env!("CARGO_PKG_VERSION")), "{name}");
        assert!(!text.contains("a prefix") && !text.contains('@') && !text.contains("=/"), "{name}: {text}");
    }
    let version = env!("CARGO_PKG_VERSION");
    for (link, to) in
        [("libmrvis.so", "libmrvis.so.0"), ("libmrvis.so.0", &*format!("libmrvis.so.{version}"))]
    {
        assert_eq!(fs::read_link(lib.join(link)).expect(link), Path::new(to));
    }
}
